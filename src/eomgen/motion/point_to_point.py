"""Programmed motions of the principal coordinates: from one point to another, at rest at either end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, InputError
from ..kernel.stepping.input_signals import Signal, Waves
from ..limits import LARGEST, is_usable
from ..names import show
from ..runtime.arrays import numbers_in
from ..shown import Shown
from .time_derivatives import Jump, by_time, order_in, times_in, waves

QUINTIC = 2  # continuous time derivatives of motions from rest to rest by default: of the quintic profile
SMOOTHEST = 6
MINIMUM_SNAP = "minimum_snap"
_SMOOTH_BY_NAME = {MINIMUM_SNAP: 3}  # polynomials of degree 2 k + 1 have the least square of the derivative k + 1


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

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, m); see ``with_series``."""
        return waves(np.asarray(self.load_data().wave), t, order)

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump: nowhere."""
        return by_time((), order)

    def load_data(self) -> Waves:
        """Return it as data for integrations in C."""
        amplitude = np.asarray(self.amplitude)
        columns = (amplitude, 2.0 * np.pi * np.asarray(self.frequency), self.phase, 0.0)
        return Waves(np.stack([np.broadcast_to(x, amplitude.shape) for x in columns], axis=1))


@dataclass(frozen=True)
class PointToPoint(Shown):
    """A straight line in joint space with a polynomial profile, by default s = 10 r^3 - 15 r^4 + 6 r^5.

    r is (t - begin) / duration.  Velocity and acceleration are zero at both ends, and with a profile of class C^k, of
    degree 2 k + 1, all time derivatives up to the k-th; before ``begin`` the motion rests at ``start``, after
    ``begin + duration`` at ``goal``.

    Attributes:
        start, goal: coordinates, (n,), m or rad; read-only.
        duration: s, greater than 0.
        begin: s.
        names: names of the coordinates for messages, (n,) or empty.
        smooth: k, from 2 (quintic; 3 septic, 4 of degree nine) to 6.

    Raises:
        ArrayError: an array of wrong shape, or with NaN or infinity.
        InputError: a duration that is not positive and finite, a begin that is not finite, or another smoothness.
    """

    start: Array
    goal: Array
    duration: float
    begin: float = 0.0
    names: tuple[str, ...] = ()
    smooth: int = QUINTIC

    def __post_init__(self) -> None:
        object.__setattr__(self, "smooth", smoothness(self.smooth))
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
        mine, theirs = (
            (m.duration, m.begin, m.names, m.smooth, m.start.tolist(), m.goal.tolist()) for m in (self, other)
        )
        return mine == theirs

    def __hash__(self) -> int:
        return hash((self.duration, self.begin, self.names, self.smooth, *self.start.tolist(), *self.goal.tolist()))

    @property
    def end(self) -> float:
        """The time from which the motion rests at its goal, s."""
        return self.begin + self.duration

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times t of any shape, (*t.shape, n) each; m, rad, s.

        Raises:
            ArrayError: a time that is no number.
        """
        if self.smooth != QUINTIC:
            q, v, a = self.series(t, 2)
            return q, v, a
        r = np.clip((times_in(t) - self.begin) / self.duration, 0.0, 1.0)[..., np.newaxis]
        span, rate = self.goal - self.start, 1.0 / self.duration
        s = r**3 * (10.0 + r * (6.0 * r - 15.0))
        ds = 30.0 * (r * (1.0 - r)) ** 2 * rate
        dds = 60.0 * r * (1.0 - r) * (1.0 - 2.0 * r) * rate**2
        return self.start + s * span, ds * span, dds * span

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, n); see ``with_series``."""
        r = ((times_in(t) - self.begin) / self.duration)[..., np.newaxis]
        by_r = rest_to_rest(np.clip(r, 0.0, 1.0), self.smooth, order_in(order))
        by_r[1:, (r < 0.0) | (r > 1.0)] = 0.0
        rates = (1.0 / self.duration) ** np.arange(order + 1)
        result = by_r * rates.reshape(-1, *(1,) * r.ndim) * (self.goal - self.start)
        result[0] += self.start
        return np.asarray(result)

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump, by time; see ``with_series``."""
        moves = bool((self.goal != self.start).any())
        return by_time((Jump(t, self.smooth + 1) for t in (self.begin, self.end) if moves), order)

    def as_signal(self) -> Signal:
        """Return it as data for integrations in C."""
        pieces = [profile_factors(self.smooth)]
        if self.smooth != QUINTIC:  # powers of the nearer end would cancel
            pieces.append(_from_the_middle(self.smooth))
        powers = np.zeros((len(pieces), pieces[0].size, self.start.size))
        for piece, factors in enumerate(pieces):
            for power in np.flatnonzero(factors).tolist():
                powers[piece, power] = factors[power] / self.duration**power * (self.goal - self.start)
        powers[:, 0] += self.start
        knots = [self.begin, self.begin + 0.5 * self.duration, self.end] if len(pieces) > 1 else [self.begin, self.end]
        return Signal(np.array(knots), powers)


def smoothness(smooth: Any, label: str = "smooth") -> int:
    """Return how many time derivatives of a motion from rest to rest are continuous; InputError where it is none."""
    if isinstance(smooth, str) and smooth in _SMOOTH_BY_NAME:
        return _SMOOTH_BY_NAME[smooth]
    is_whole = isinstance(smooth, (int, np.integer)) and not isinstance(smooth, bool)
    if not is_whole or not QUINTIC <= smooth <= SMOOTHEST:
        allowed = f"a whole number from {QUINTIC} to {SMOOTHEST}, or '{MINIMUM_SNAP}'"
        raise InputError(f"{label}: {show(smooth)}; allowed: {allowed}")
    return int(smooth)


def profile_factors(smooth: int) -> Array:
    """Return the polynomial from rest at 0 to rest at 1 of a smoothness, (2 smooth + 2,) of rising powers."""
    factors = np.zeros(2 * smooth + 2)
    for j in range(smooth + 1):
        factors[smooth + 1 + j] = (-1) ** j * math.comb(smooth + j, j) * math.comb(2 * smooth + 1, smooth - j)
    return factors


def _from_the_middle(smooth: int) -> Array:
    """Return the profile as a polynomial of r - 1/2, (2 smooth + 2,) of rising powers."""
    factors = [int(x) for x in profile_factors(smooth)]
    powers = range(len(factors))
    shifted = (sum(Fraction(math.comb(j, i) * factors[j], 2 ** (j - i)) for j in powers[i:]) for i in powers)
    return np.array([float(x) for x in shifted])


def rest_to_rest(r: Array, smooth: int, order: int) -> Array:
    """Return the profile at r from 0 to 1 and its derivatives by r, (order + 1, *r.shape).

    s(r) = 1 - s(1 - r), so that powers are of the nearer end, and derivatives there as exact as at the beginning.
    """
    polynomial = np.polynomial.Polynomial(profile_factors(smooth))
    late = r > 0.5
    near = np.where(late, 1.0 - r, r)
    rows = [polynomial.deriv(i)(near) if i else polynomial(near) for i in range(order + 1)]
    mirrored = [row if i % 2 else (1.0 if i == 0 else 0.0) - row for i, row in enumerate(rows)]
    return np.stack([np.where(late, other, row) for row, other in zip(rows, mirrored, strict=True)])


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
