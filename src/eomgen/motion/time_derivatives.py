"""Time derivatives of reference trajectories to any order, and where these jump."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, InputError
from ..names import show
from ..runtime.arrays import numbers_in

MOST = 16  # the highest time derivative that one asks for


class Jump(NamedTuple):
    """Time, s, at which a time derivative jumps, and the lowest order of which one does: 3 is the jerk."""

    t: float
    order: int


class SmoothProgram(Protocol):
    """Reference trajectory of drives that gives its time derivatives, defined at all times."""

    @property
    def start(self) -> Array:
        """Coordinates at the beginning, (n,), m or rad."""

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times t; each of shape (*t.shape, n)."""

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return q and its time derivatives up to an order, (order + 1, *t.shape, n); see ``with_series``."""

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where time derivatives up to an order jump, by time; see ``with_series``."""


def with_series(program: Any, label: str = "motion") -> SmoothProgram:
    """Return a reference trajectory that gives its time derivatives by ``series`` and ``jumps``.

    Where a derivative jumps, ``series`` has the value behind the jump, at the last time of a motion that before it.

    Raises:
        InputError: a program that has q, v and a alone.
    """
    if not (hasattr(program, "series") and hasattr(program, "jumps")):
        raise InputError(
            f"{label}: {type(program).__name__} gives no time derivatives beyond accelerations; allowed: a program"
            " with the methods series(t, order) and jumps(order), as PointToPoint, Spline, ToolPath and Standstill"
            " have them"
        )
    smooth: SmoothProgram = program
    return smooth


def order_in(order: Any) -> int:
    """Return the order of a time derivative; InputError where it is none."""
    is_whole = isinstance(order, (int, np.integer)) and not isinstance(order, bool)
    if not is_whole or not 0 <= order <= MOST:
        raise InputError(f"order: {show(order)}; allowed: a whole number from 0 to {MOST}")
    return int(order)


def times_in(t: ArrayLike) -> Array:
    """Return times as an array of float64; ArrayError where one is no number."""
    if isinstance(t, float) and t == t:  # in every evaluation
        return np.asarray(t, dtype=np.float64)
    times = numbers_in("t", t, "times, s", finite=False)
    if np.isnan(times).any():
        raise ArrayError("t: holds NaN; allowed: times, s")
    return times


def by_time(jumps: Iterable[Jump], order: int) -> tuple[Jump, ...]:
    """Return jumps up to an order by time, at each time that of the lowest order."""
    lowest: dict[float, int] = {}
    for t, jumping in jumps:
        if jumping <= order_in(order):
            lowest[t] = min(jumping, lowest.get(t, jumping))
    return tuple(Jump(t, lowest[t]) for t in sorted(lowest))


def waves(wave: Array, t: ArrayLike, order: int) -> Array:
    """Return offset + amplitude sin(w t + phase) and its time derivatives, (order + 1, *t.shape, m).

    Args:
        wave: amplitude, angular frequency (rad/s), phase (rad) and offset, (m, 4).
        t: s.
        order: the highest derivative.
    """
    amplitude, omega, phase, offset = wave.T
    angle = omega * times_in(t)[..., np.newaxis] + phase
    turned = [np.sin(angle), np.cos(angle), -np.sin(angle), -np.cos(angle)]
    rows = [amplitude * omega**i * turned[i % 4] for i in range(order_in(order) + 1)]
    rows[0] = rows[0] + offset
    return np.stack(rows)


def spline_series(spline: Any, t: Array, order: int) -> Array:
    """Return SciPy's spline at times within it and its derivatives up to an order, (order + 1, *t.shape, n)."""
    rows = [spline(t, nu=i) for i in range(min(order, spline.k) + 1)]
    rows += [np.zeros_like(rows[0])] * (order - spline.k)
    return np.stack(rows)


def composed(outer: Array, inner: Array) -> Array:
    """Return the time derivatives of f(s(t)) of those of f by s and of s by time.

    Truncated Taylor series are put into each other by Horner's rule (Faa di Bruno's formula).

    Args:
        outer: f and its derivatives by s, (order + 1, ..., n).
        inner: s and its time derivatives, (order + 1, ..., 1 or n).
    """
    order = len(outer) - 1
    scale = np.array([1.0 / math.factorial(i) for i in range(order + 1)]).reshape(-1, *(1,) * (outer.ndim - 1))
    f, s = outer * scale, inner * scale
    result = np.zeros_like(f)
    for i in range(order, -1, -1):
        product = np.zeros_like(f)
        for j in range(1, order + 1):
            product[j:] += s[j] * result[: order + 1 - j]
        result = product
        result[0] += f[i]
    return np.asarray(result / scale)
