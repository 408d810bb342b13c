"""Inputs and outputs of linear systems: drives and wrenches, coordinates and frames, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from ..arrays import Array
from ..errors import InputError, UnknownNameError
from ..kernel.complete import Kernel
from ..names import show, split_component
from ..robot.coordinates import FORCES, MOTIONS, unit_of
from ..state.drives import drive_slopes, has_drives
from .holding import Fixation
from .tangent_system import frame_hessian

PortKind = Literal["displacement", "velocity", "acceleration"]
KINDS: tuple[str, ...] = get_args(PortKind)


def input_matrix(
    kernel: Kernel, state: tuple[Array, Array, Array | None], names: Sequence[str], fixation: Fixation
) -> Array:
    """Return generalized forces per unit of each input, with rows of internal states behind, (n + m, inputs).

    An input is a coordinate's name (its drive, as ``Kernel.inputs`` has it, or a force like one; N or N m), or a frame
    or link with a component of a wrench at its origin, base frame: "tcp.fx", "link3.mz".

    Args:
        kernel: of the robot.
        state: q, v with internal states behind, and the drives' inputs; None: drives are within their limits.
        names: of the inputs.
        fixation: what is locked.

    Raises:
        UnknownNameError: a name is neither.
        InputError: a coordinate is locked, and its drive cannot move it.
    """
    columns, drives, (q, v, u) = [], np.eye(kernel.calls.rates), state
    if has_drives(kernel):
        drives = drive_slopes(kernel, q, v, u)[2]
    for name in names:
        if name in kernel.coordinates:
            i = kernel.coordinates.index(name)
            if fixation.locked[i]:
                raise InputError(f"input: {name} does not move; allowed: drives that are free or pd, or another input")
            columns.append(drives[:, i])
            continue
        frame, component = _component("input", name, kernel, FORCES)
        columns.append(np.append(kernel.frame_jacobian(q, frame)[component], np.zeros(len(kernel.internal_states))))
    return np.asarray(np.array(columns).reshape(-1, kernel.calls.rates).T)


def output_matrices(kernel: Kernel, q: Array, v: Array, names: Sequence[str]) -> tuple[Array, Array]:
    """Return displacements of the outputs per change of coordinates, and their rate along the motion.

    They are (outputs, n + m) each, with columns of internal states behind.

    An output is a coordinate's name, a frame or link with a component of its motion, base frame ("tcp.x", "tcp.rz"), or
    an internal state ("joint1.gamma.friction.z").  With J the first matrix and J' the second, velocities change by
    J dv + J' dq.

    Raises:
        UnknownNameError: a name is none of these.
    """
    (n, size), known = (kernel.n, kernel.calls.rates), kernel.calls.rate_names
    rows, rates = np.zeros((2, len(names), size))
    for i, name in enumerate(names):
        if name in known:
            rows[i, known.index(name)] = 1.0
            continue
        frame, component = _component("output", name, kernel, MOTIONS)
        J = kernel.frame_jacobian(q, frame)
        rows[i, :n] = J[component]
        rates[i, :n] = v[:n] @ frame_hessian(J)[component]
    return rows, rates


def checked_kind(kind: str) -> str:
    """Return the kind of an output; InputError if it is none of KINDS."""
    if kind not in KINDS:
        raise InputError(f"kind: {kind!r} is unknown; allowed: {', '.join(KINDS)}")
    return kind


def units_of_outputs(kernel: Kernel, names: Sequence[str]) -> tuple[str, ...]:
    """Return the units of outputs as displacements: "m", "rad", and of internal states their own."""
    internal_states = dict(zip(kernel.internal_states, kernel.internal_state_units, strict=True))
    return tuple(internal_states[name] if name in internal_states else unit_of(name) for name in names)


def per_time(unit: str, kind: str) -> str:
    """Return the unit of an output of a kind by that of its displacement: "m", "rad/s", "m/s^2", ..."""
    return unit + {"displacement": "", "velocity": "/s", "acceleration": "/s^2"}[kind]


def _component(label: str, name: str, kernel: Kernel, parts: Sequence[str]) -> tuple[str, int]:
    frame, component = split_component(str(name))
    if component in parts and frame in kernel.frames:
        return frame, parts.index(component)
    laws = (
        f", an internal state ({', '.join(kernel.internal_states)})"
        if kernel.internal_states and label == "output"
        else ""
    )
    raise UnknownNameError(
        f"{label}: {show(str(name))} is unknown; allowed: a coordinate ({', '.join(kernel.coordinates)}){laws}, or one"
        f" of {', '.join(kernel.frames)} with .{', .'.join(parts)}"
    )
