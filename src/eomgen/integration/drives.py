"""Constant drives; and drives, wrenches and records of coordinates, for arrays with internal states behind these."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, InputError
from ..runtime.arrays import numbers_in
from ..runtime.kernel import Kernel
from ..runtime.methods.wrenches import WrenchLike
from ..runtime.stepping.input_signals import DriveData, Signal, Track
from ..runtime.stepping.reading_inputs import signals_of
from ..state.vectors import DriveFunction, WrenchFunction, state_vector
from .steps import Record


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
    """Return q and v of augmented arrays, with internal states behind the velocities, zeros by default.

    Raises:
        ArrayError: another shape, or a number that is not finite.
        InputError: z0 where no force law has internal states.
    """
    if z0 is not None and kernel.augmented is kernel:
        raise InputError(f"z0: no force law of {kernel.name} has internal states; allowed: none")
    q, v = (state_vector(label, x, kernel.calls.coordinates) for label, x in (("q0", q0), ("v0", v0)))
    still = np.zeros(kernel.augmented.n - kernel.n)
    z = still if z0 is None else state_vector("z0", z0, kernel.internal_states)
    return np.concatenate([q, still]), np.concatenate([v, z])


@dataclass(frozen=True, eq=False)
class DriveBesideStates:
    """A drive of coordinates, (t, q, v) -> (n,), for arrays that have internal states behind them.

    Attributes:
        drive: that of coordinates.
        n, states: numbers of coordinates and of states.
    """

    drive: DriveFunction
    n: int
    states: int

    @property
    def batched(self) -> bool:
        """Whether the drive takes many states at a time."""
        return bool(getattr(self.drive, "batched", False))

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        shape = (*q.shape[:-1], self.n)
        forces = self.drive(t, q[..., : self.n], v[..., : self.n])
        u = numbers_in(f"drive at t = {t:.6g} s", forces, f"numbers of shape {shape}", finite=False)
        if u.shape != shape:
            raise ArrayError(f"drive: expected forces of shape {shape}, got shape {u.shape} at t = {t:.6g} s")
        return np.concatenate([u, np.zeros((*shape[:-1], self.states))], axis=-1)

    def load_data(self) -> Any:
        """Return the drive's time-signal input for integrations in C; None where only Python knows it."""
        return signals_of(self.drive)


@dataclass(frozen=True, eq=False)
class SlopedDriveBesideStates(DriveBesideStates):
    """One whose drive has a method ``slopes``."""

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, ...]:
        """Return derivatives by q and v, (n + states, n + states) each."""
        drive: Any = self.drive
        return tuple(np.pad(x, (0, self.states)) for x in drive.slopes(t, q[: self.n], v[: self.n]))


def drive_beside_states(drive: DriveFunction | None, kernel: Kernel) -> DriveFunction | None:
    """Return a drive of a kernel's arrays for its augmented ones."""
    if drive is None or kernel.augmented is kernel:
        return drive
    kind = SlopedDriveBesideStates if hasattr(drive, "slopes") else DriveBesideStates
    return kind(drive, kernel.n, len(kernel.internal_states))


@dataclass(frozen=True, eq=False)
class _WrenchBesideStates:
    """A function (t, q, v) -> wrenches of coordinates, for arrays that have internal states behind them."""

    wrench: WrenchFunction
    n: int

    def __call__(self, t: float, q: Array, v: Array) -> WrenchLike:
        return self.wrench(t, q[..., : self.n], v[..., : self.n])

    def load_data(self) -> Any:
        """Return the wrenches' time-signal input for integrations in C; None where only Python knows it."""
        return signals_of(self.wrench)


def wrench_beside_states(
    wrench: WrenchFunction | WrenchLike | None, kernel: Kernel
) -> WrenchFunction | WrenchLike | None:
    """Return wrenches of a kernel's arrays for its augmented ones."""
    return _WrenchBesideStates(wrench, kernel.n) if callable(wrench) and kernel.augmented is not kernel else wrench


def record_apart(record: Record | None, kernel: Kernel) -> Record | None:
    """Return a function that passes states on to ``record`` as q, v, and internal states; as it is without these."""
    if record is None or kernel.augmented is kernel:
        return record
    n, whole = kernel.n, kernel.augmented.n
    columns = np.r_[:n, whole : 2 * whole]

    def passed(times: Array, states: Array) -> None:
        record(times, np.ascontiguousarray(states[:, columns]))

    return passed
