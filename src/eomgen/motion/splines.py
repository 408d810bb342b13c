"""Programs of some coordinates over time: splines through points, one that rests, and columns of another one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..kernel.stepping.input_signals import Signal
from ..optional import optional_import
from ..shown import Shown
from .point_to_point import QUINTIC, Program, smoothness
from .time_derivatives import Jump, by_time, order_in, spline_series, times_in, with_series

DEGREE = 5  # of splines: accelerations, and their rates too, are continuous
STANDS = 1e-9  # of the largest value of a time derivative, up to which it is none at an end


@dataclass(frozen=True, eq=False)  # arrays have no one truth
class Standstill(Shown):
    """Reference trajectory that stays at ``start``, (n,)."""

    start: Array

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations; see ``Program``."""
        q = np.broadcast_to(self.start, (*np.shape(t), self.start.size)).copy()
        return q, np.zeros_like(q), np.zeros_like(q)

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, n); see ``with_series``."""
        rows = np.zeros((order_in(order) + 1, *times_in(t).shape, self.start.size))
        rows[0] = self.start
        return rows

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump: nowhere."""
        return by_time((), order)

    def as_signal(self) -> Signal:
        """Return it as data for integrations in C."""
        return Signal.constant(self.start)


class Spline:
    """A spline of degree 5 through points (or less, if there are fewer); it rests before and after them.

    From rest to rest it may be smoother: of degree 2 k + 1, which has the least integral of the square of the
    derivative of order k + 1, so that that of ``smooth=3`` is the minimum-snap trajectory.

    Args:
        t: times, (T,), s.
        points: (T, n), m or rad.
        at_rest: whether velocities and accelerations are zero at both ends; else the points alone say what they are.
        smooth: k, from 2 to 6, of a motion from rest to rest: all time derivatives up to the k-th are continuous.
        degree: the highest of a motion that is not from rest to rest.

    Raises:
        InputError: SciPy is not installed, or another smoothness.
    """

    def __init__(
        self, t: ArrayLike, points: ArrayLike, *, at_rest: bool, smooth: int = QUINTIC, degree: int = DEGREE
    ) -> None:
        with optional_import("SciPy", "splines need"):
            from scipy.interpolate import make_interp_spline
        self.t, points = np.asarray(t, dtype=np.float64), np.asarray(points, dtype=np.float64)
        zero = np.zeros(points.shape[1])
        continuous = smoothness(smooth)
        ends = [(order, zero) for order in range(1, continuous + 1)]
        degree = 2 * continuous + 1 if at_rest else min(degree, self.t.size - 1)
        ending: Any = (ends, ends) if at_rest else None
        spline = make_interp_spline(self.t, points, k=degree, bc_type=ending)
        self._splines = (
            (spline, spline.derivative(1), spline.derivative(2)) if degree > 1 else (spline, spline.derivative(1))
        )
        self._end_order = continuous + 1 if at_rest else 1

    @property
    def start(self) -> Array:
        """Coordinates at the first time, (n,)."""
        return self.at(self.t[0])[0]

    @property
    def end(self) -> float:
        """The time from which the motion rests at its last point, s."""
        return float(self.t[-1])

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations; see ``Program``."""
        times = times_in(t)
        inside = ((times >= self.t[0]) & (times <= self.t[-1]))[..., np.newaxis]
        times = np.clip(times, self.t[0], self.t[-1])
        q, v, *a = (spline(times) for spline in self._splines)
        return q, np.where(inside, v, 0.0), np.where(inside, a[0], 0.0) if a else np.zeros_like(q)

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, n); see ``with_series``."""
        times = times_in(t)
        rows = spline_series(self._splines[0], np.clip(times, self.t[0], self.t[-1]), order_in(order))
        rows[1:, (times < self.t[0]) | (times > self.t[-1])] = 0.0
        return rows

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump, by time; see ``with_series``."""
        spline = self._splines[0]
        found = [Jump(t, spline.k) for t in inner_knots(spline).tolist()]
        size = np.abs(spline_series(spline, self.t, order_in(order))).max(axis=(1, 2))
        for end in (self.t[0], self.t[-1]):
            rates = np.abs(spline_series(spline, end, order)).max(axis=1)
            found += [Jump(float(end), k) for k in range(self._end_order, order + 1) if rates[k] > STANDS * size[k]]
        return by_time(found, order)

    def as_signal(self) -> Signal:
        """Return it as data for integrations in C."""
        return spline_signal(self._splines[0])


@dataclass(frozen=True)
class Columns:
    """Reference trajectory of some coordinates of another one: those at ``index``."""

    program: Program
    index: Index

    @property
    def start(self) -> Array:
        """Coordinates at the beginning."""
        return self.program.start[self.index]

    @property
    def end(self) -> float:
        """The time from which the motion rests, s; 0 where it always does."""
        return float(getattr(self.program, "end", 0.0))

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations; see ``Program``."""
        q, v, a = (x[..., self.index] for x in self.program.at(t))
        return q, v, a

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, n); see ``with_series``."""
        return with_series(self.program).series(t, order)[..., self.index]

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives of the whole program up to an order jump, by time; see ``with_series``."""
        return with_series(self.program).jumps(order)

    def as_signal(self) -> Signal | None:
        """Return it as data for integrations in C; None where the program has none."""
        whole = signal_of(self.program)
        return None if whole is None else replace(whole, coefficients=whole.coefficients[..., self.index])


def signal_of(program: Program) -> Signal | None:
    """Return a reference trajectory as a time-signal input of C; None of one that only Python can evaluate."""
    method: Callable[[], Signal | None] | None = getattr(program, "as_signal", None)
    return None if method is None else method()


def spline_signal(spline: Any, profile: Signal | None = None) -> Signal:
    """Return SciPy's spline through points (T, n) as a signal, over time or over the column of a profile."""
    knots = np.unique(spline.t[spline.k : spline.t.size - spline.k])
    powers = [spline(knots[:-1])]
    for power in range(1, spline.k + 1):
        powers.append(spline.derivative(power)(knots[:-1]) / math.factorial(power))
    return Signal(knots, np.stack(powers, axis=1), profile)


def inner_knots(spline: Any) -> Array:
    """Return knots of SciPy's spline between its ends, where its derivative of the order of its degree jumps."""
    return np.asarray(np.unique(spline.t[spline.k + 1 : spline.t.size - spline.k - 1]))
