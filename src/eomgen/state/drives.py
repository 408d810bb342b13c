"""Derivatives of what drives with states do, beside those of inverse dynamics."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..names import split_state
from ..robot.memory.drives import DRIVE
from ..runtime.kernel import Kernel

ROUNDS = 20  # of Newton's method for states of drives at rest, which are linear within limits
SETTLED = 1e-9  # of the states, their residual


def has_drives(kernel: Kernel) -> bool:
    """Tell whether a kernel has drives with states, so that u is what ``Kernel.inputs`` says."""
    return kernel.calls.arrays.has_drives


def is_of_drive(state: str) -> bool:
    """Tell of a state of a law, by its name, whether it is one of a drive: "joint1.gamma.drive.current"."""
    return split_state(state)[1] == DRIVE


def inputs_at(kernel: Kernel, q: Array, v: Array) -> Array:
    """Return u, (n,), by which drives have no control error: references are what they measure, other inputs 0."""
    u = np.zeros(kernel.n)
    for i, one in enumerate(kernel.inputs.values()):
        measured = {"reference of position": q[i], "reference of velocity": v[i]}
        u[i] = measured.get(one.meaning, 0.0)
    return u


def drive_jacobian(kernel: Kernel, q: Array, v: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return derivatives of what drives and u do on all rows by q, v and u, (n, n) each.

    Args:
        q, v, u: a state with those of laws, (n,), u as ``Kernel.forward_dynamics`` takes it.
    """
    by_q, by_v, by_u = kernel.calls.run("drive_jacobian", None, (q, v, u))
    inputs = np.eye(kernel.n)
    for name, (_, _, place) in kernel.calls.raw.libraries.meta["inputs"].items():
        i = kernel.coordinates.index(name)
        inputs[:, place], inputs[i, place] = 0.0, 1.0  # a force beside the drive
        inputs[:, i] = by_u[:, i]
    return by_q, by_v, inputs


def settled(kernel: Kernel, q: Array, v: Array, u: Array, forces: Array) -> tuple[Array, tuple[str, ...]]:
    """Return v with states of drives that hold a robot at rest, and the coordinates of drives that cannot.

    Their rates vanish then, control errors of integrators among them, and they exert the forces that are asked for.  Of
    drives that cannot, as without an integral, states stay as they are.

    Args:
        q, v: a state at rest, (n,), with states of laws behind velocities.
        u: inputs of the drives, (n,).
        forces: on coordinates that hold it, (n,), N or N m.
    """
    v, inertia, lost = v.copy(), np.diagonal(kernel.mass_matrix(q)), list[str]()
    names = kernel.velocities
    for name in kernel.calls.raw.libraries.meta["inputs"]:
        i = kernel.coordinates.index(name)
        states = [k for k, x in enumerate(names) if x.startswith(f"{name}.{DRIVE}.")]
        begin = v[states].copy()
        for _ in range(ROUNDS):
            _, by_v, _ = drive_jacobian(kernel, q, v, u)
            rates, exerted = kernel.forward_dynamics(q, v, u)[states], kernel.drive_forces(q, v, u)[i]
            left = np.append(-rates, forces[i] - exerted)
            rows = np.vstack([by_v[np.ix_(states, states)] / inertia[states, np.newaxis], by_v[i, states]])
            scale = np.maximum(np.abs(rows).max(axis=1), 1e-300)
            if np.abs(left / scale).max() <= SETTLED * max(1.0, float(np.abs(v[states]).max())):
                break
            v[states] += np.linalg.lstsq(rows / scale[:, np.newaxis], left / scale, rcond=None)[0]
        else:
            v[states] = begin
            lost.append(name)
    return v, tuple(lost)
