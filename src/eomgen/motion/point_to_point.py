"""Programmed motions of the principal coordinates: from one point to another without a jerk at either end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, InputError
from ..limits import LARGEST, is_usable
from ..names import show
from ..runtime.arrays import numbers_in
from ..runtime.stepping.input_signals import Signal, Waves
from ..shown import Shown


class Program(Protocol):
    """Reference trajectory of drives, defined at all times."""

    @property
    def start(self) -> Array:
        """Coordinates at the beginning, (n,), m or rad."""

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times t; each of shape (*t.shape, n)."""


@dataclass(frozen=True, eq=False)  # arrays have no one truth
class Harmonic(Shown):
    """A shake: q = amplitude sin(2 pi frequency t + phase), as ``integrate`` takes it for prescribed coordinates.

    Attributes:
        amplitude: (m,), m or rad, in the order of ``kernel.prescribed``.
        frequency: Hz, one number or (m,).
        phase: rad, one number or (m,).

    Raises:
        ArrayError: an array of wrong shape, or with NaN or infinity.
    """

    amplitude: ArrayLike
    frequency: ArrayLike
    phase: ArrayLike = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", _vector("amplitude", self.amplitude, ()))
        for name in ("frequency", "phase"):
            allowed = f"a finite number, or one for each of the {np.size(self.amplitude)} amplitudes"
            numbers = numbers_in(name, getattr(self, name), allowed)
            if numbers.shape not in ((), np.shape(self.amplitude)):
                raise ArrayError(f"{name}: got shape {numbers.shape}; allowed: {allowed}")
            object.__setattr__(self, name, numbers)

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """Return q, v and a at a time (s), (m,) each."""
        rate = 2.0 * np.pi * np.asarray(self.frequency)
        angle = rate * t + np.asarray(self.phase)
        amplitude = np.asarray(self.amplitude)
        q = amplitude * np.sin(angle)
        return q, amplitude * rate * np.cos(angle), -(rate**2) * q

    def load_data(self) -> Waves:
        """Return it as data for integrations in C."""
        amplitude = np.asarray(self.amplitude)
        columns = (amplitude, 2.0 * np.pi * np.asarray(self.frequency), self.phase, 0.0)
        return Waves(np.stack([np.broadcast_to(x, amplitude.shape) for x in columns], axis=1))


@dataclass(frozen=True)
class PointToPoint(Shown):
    """A straight line in joint space with the quintic profile s = 10 r^3 - 15 r^4 + 6 r^5, r = (t - begin) / duration.

    Velocity and acceleration are zero at both ends; before ``begin`` the motion rests at ``start``, after
    ``begin + duration`` at ``goal``.

    Attributes:
        start, goal: coordinates, (n,), m or rad; read-only.
        duration: s, greater than 0.
        begin: s.
        names: names of the coordinates for messages, (n,) or empty.

    Raises:
        ArrayError: an array of wrong shape, or with NaN or infinity.
        InputError: a duration that is not positive and finite, or a begin that is not finite.
    """

    start: Array
    goal: Array
    duration: float
    begin: float = 0.0
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("start", "goal"):
            object.__setattr__(self, name, _vector(name, getattr(self, name), self.names))
        if self.start.shape != self.goal.shape:
            raise ArrayError(f"goal: expected {self.start.size} values as in start, got {self.goal.size}")
        if not (is_usable(self.duration) and self.duration > 0.0):
            raise InputError(f"duration: {show(self.duration)} s; a motion takes a time above 0, up to {LARGEST:g}")
        if not is_usable(self.begin):
            raise InputError(f"begin: {show(self.begin)} s; allowed: a finite time, up to {LARGEST:g}")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PointToPoint):
            return NotImplemented
        mine, theirs = ((m.duration, m.begin, m.names, m.start.tolist(), m.goal.tolist()) for m in (self, other))
        return mine == theirs

    def __hash__(self) -> int:
        return hash((self.duration, self.begin, self.names, *self.start.tolist(), *self.goal.tolist()))

    @property
    def end(self) -> float:
        """The time from which the motion rests at its goal, s."""
        return self.begin + self.duration

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times t of any shape, (*t.shape, n) each; m, rad, s.

        Raises:
            ArrayError: a time that is no number.
        """
        r = np.clip((times_in(t) - self.begin) / self.duration, 0.0, 1.0)[..., np.newaxis]
        span, rate = self.goal - self.start, 1.0 / self.duration
        s = r**3 * (10.0 + r * (6.0 * r - 15.0))
        ds = 30.0 * (r * (1.0 - r)) ** 2 * rate
        dds = 60.0 * r * (1.0 - r) * (1.0 - 2.0 * r) * rate**2
        return self.start + s * span, ds * span, dds * span

    def as_signal(self) -> Signal:
        """Return it as data for integrations in C."""
        powers = np.zeros((6, self.start.size))
        powers[0] = self.start
        for power, factor in ((3, 10.0), (4, -15.0), (5, 6.0)):
            powers[power] = factor / self.duration**power * (self.goal - self.start)
        return Signal(np.array([self.begin, self.end]), powers[np.newaxis])


def times_in(t: ArrayLike) -> Array:
    """Return times as an array of float64; ArrayError where one is no number."""
    if isinstance(t, float) and t == t:  # in every evaluation
        return np.asarray(t, dtype=np.float64)
    times = numbers_in("t", t, "times, s", finite=False)
    if np.isnan(times).any():
        raise ArrayError("t: holds NaN; allowed: times, s")
    return times


def _vector(label: str, value: Any, names: tuple[str, ...]) -> Array:
    """Return a read-only copy of a vector of finite numbers."""
    array = numbers_in(label, value, "finite numbers of shape (n,)", finite=False)
    if array.ndim != 1 or array.size == 0 or (names and array.size != len(names)):
        expected = f"({len(names)},)" if names else "(n,)"
        raise ArrayError(f"{label}: expected numbers of shape {expected}, got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        place = names[bad[0]] if names else f"element {bad[0]}"
        raise ArrayError(f"{label}: {place} is {array[bad[0]]}; numbers must be finite")
    array.flags.writeable = False
    return array
