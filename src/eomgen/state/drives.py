"""Derivatives of what drives with states do, beside those of inverse dynamics."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..robot.memory.drives import DRIVE
from ..runtime.kernel import Kernel


def has_drives(kernel: Kernel) -> bool:
    """Tell whether a kernel has drives with states, so that u is what ``Kernel.inputs`` says."""
    return bool(kernel.calls.raw.libraries.meta.get("inputs"))


def is_of_drive(state: str) -> bool:
    """Tell of a state of a law, by its name, whether it is one of a drive: "joint1.gamma.drive.current"."""
    return state.split(".")[2] == DRIVE


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
