"""Drives as functions of time and state, and states at the beginning of motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import DriveData, Signal, Track
from ..state.vectors import DriveFunction, state_vector


@dataclass(frozen=True, eq=False)
class ConstantDrive:
    """Constant forces u, (n,), N or N m, as a drive of ``integrate``."""

    u: Array
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return np.array(np.broadcast_to(self.u, q.shape))

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return derivatives by q and v, (n, n) each: zero."""
        nothing = np.zeros((q.size, q.size))
        return nothing, nothing

    def load_data(self) -> DriveData:
        """Return the time-signal input for integrations in C."""
        return DriveData(torque=Track(Signal.constant(self.u), np.arange(self.u.size)))


def drive_of(kernel: Kernel, drive: DriveFunction | ArrayLike | None) -> DriveFunction | None:
    """Return a drive as a function of (t, q, v): one as it is, constant forces wrapped; None stays.

    Raises:
        ArrayError: forces that are not finite, or not as many as there are coordinates.
    """
    if drive is None or callable(drive):
        return drive
    return ConstantDrive(state_vector("drive", drive, kernel.calls.coordinates))


def begin_of(kernel: Kernel, q0: ArrayLike, v0: ArrayLike, z0: ArrayLike | None) -> tuple[Array, Array]:
    """Return q, and v with internal states behind it, zeros by default.

    Raises:
        ArrayError: another shape, or a number that is not finite.
        InputError: z0 where no force law has internal states.
    """
    if z0 is not None and not kernel.internal_states:
        raise InputError(f"z0: no force law of {kernel.name} has internal states; allowed: none")
    q, v = (state_vector(label, x, kernel.coordinates) for label, x in (("q0", q0), ("v0", v0)))
    states = kernel.internal_states
    return q, np.append(v, np.zeros(len(states)) if z0 is None else state_vector("z0", z0, states))
