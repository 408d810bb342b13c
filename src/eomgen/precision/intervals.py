"""Intervals with outward rounding, one per box of inputs: ends (lower, upper) as arrays (boxes,).

Each end is moved to the next float64 outwards after it is computed, so that an interval holds the exact result; a sum
that is 0 is exact and stays.  Infinite ends bound nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interval = tuple[Array, Array]
Sloped = tuple[Interval, tuple[Interval, ...]]  # a value, and its derivative by each argument

ROOM = 1.0 + 2.0**-48  # times a sum or product of a few magnitudes: more than rounding takes from it
LEAST = 2.0**-1074  # the smallest number
TINY = 1e-300  # what underflow takes from a magnitude, at most
_FUNCTION = 4.0  # units in the last place: error of NumPy's exp, log, arctan2, and of sin and cos of 1
_FAR = 1e6  # rad, beyond which angles are whole turns apart for all that is known here


def outward(lower: Any, upper: Any) -> Interval:
    """Return ends that were rounded to nearest as an interval that holds the exact ones."""
    return np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)


def magnitude(x: Interval) -> Array:
    """Return the largest magnitude in each interval, (boxes,)."""
    return np.maximum(-x[0], x[1])


def _outward_sum(lower: Array, upper: Array) -> Interval:
    """Return sums as an interval; a sum of two numbers that is rounded to 0 is 0."""
    low, high = outward(lower, upper)
    return np.where(lower == 0.0, 0.0, low), np.where(upper == 0.0, 0.0, high)


def add(x: Interval, y: Interval) -> Interval:
    """Return x + y."""
    return _outward_sum(x[0] + y[0], x[1] + y[1])


def sub(x: Interval, y: Interval) -> Interval:
    """Return x - y of independent intervals."""
    return _outward_sum(x[0] - y[1], x[1] - y[0])


def mul(x: Interval, y: Interval) -> Interval:
    """Return x y of independent intervals."""
    a, b, c, d = x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1]
    return outward(np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d)))


def square(x: Interval) -> Interval:
    """Return x x, which is not negative."""
    ends = x[0] * x[0], x[1] * x[1]
    has_zero = (x[0] <= 0.0) & (x[1] >= 0.0)
    lower, upper = outward(np.where(has_zero, 0.0, np.minimum(*ends)), np.maximum(*ends))
    return np.maximum(lower, 0.0), upper


def reciprocal(x: Interval) -> Interval:
    """Return 1 / x; everything where x holds 0."""
    has_zero = (x[0] <= 0.0) & (x[1] >= 0.0)
    lower, upper = outward(1.0 / x[1], 1.0 / x[0])
    return np.where(has_zero, -np.inf, lower), np.where(has_zero, np.inf, upper)


def neg(x: Interval) -> Interval:
    """Return -x."""
    return -x[1], -x[0]


def widened(x: Interval, by: Array) -> Interval:
    """Return the interval with so much more on both sides."""
    return outward(x[0] - by, x[1] + by)


def common(x: Interval, y: Interval) -> Interval:
    """Return the intersection of two intervals of one value."""
    return np.maximum(x[0], y[0]), np.minimum(x[1], y[1])


def _between(function: Callable[[Array], Array], x: Interval) -> Interval:
    """Return a growing function of NumPy, whose error is a few units in the last place."""
    lower, upper = function(x[0]), function(x[1])
    error = _FUNCTION * 2.0**-52
    return outward(lower - np.abs(lower) * error - TINY, upper + np.abs(upper) * error + TINY)


def exp(x: Interval) -> Interval:
    """Return the exponential function."""
    lower, upper = _between(np.exp, x)
    return np.maximum(lower, 0.0), upper


def log(x: Interval) -> Interval:
    """Return the natural logarithm of what is positive."""
    return _between(np.log, x)


def cos(x: Interval) -> Interval:
    """Return the cosine."""
    return _turned(np.cos, x, 0.0)


def sin(x: Interval) -> Interval:
    """Return the sine."""
    return _turned(np.sin, x, 0.5 * math.pi)


def _turned(function: Callable[[Array], Array], x: Interval, crest: float) -> Interval:
    """Return sine or cosine, 1 at ``crest`` and whole turns from it; what may hold a crest or a trough holds it."""
    one, other = function(x[0]), function(x[1])
    error = _FUNCTION * 2.0**-52
    lower, upper = np.minimum(one, other) - error, np.maximum(one, other) + error
    near = 1e-9 * (1.0 + np.maximum(np.abs(x[0]), np.abs(x[1])))
    turn = 2.0 * math.pi
    first, last = (x[0] - near - crest) / turn, (x[1] + near - crest) / turn
    is_far = ~((x[0] >= -_FAR) & (x[1] <= _FAR))
    crests = (np.floor(last) >= np.ceil(first)) | is_far
    troughs = (np.floor(last - 0.5) >= np.ceil(first - 0.5)) | is_far
    return np.where(troughs, -1.0, np.maximum(lower, -1.0)), np.where(crests, 1.0, np.minimum(upper, 1.0))


def quotient(x: Interval, y: Interval) -> Sloped:
    """Return x / y of a y without 0, with slopes."""
    a, b, c, d = x[0] / y[0], x[0] / y[1], x[1] / y[0], x[1] / y[1]
    value = outward(np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d)))
    inverse = reciprocal(y)
    return value, (inverse, neg(mul(value, inverse)))


def sqrt(x: Interval) -> Interval:
    """Return the square root of what is not negative."""
    lower, upper = outward(np.sqrt(x[0]), np.sqrt(x[1]))
    return np.maximum(lower, 0.0), upper


def square_root(x: Interval) -> Sloped:
    """Return the square root of what is positive, with its slope."""
    root = sqrt(x)
    return root, (reciprocal((2.0 * root[0], 2.0 * root[1])),)


def angle(y: Interval, x: Interval) -> Sloped:
    """Return the angle of points that stay off the cut, with slopes: angles at corners are the extreme ones."""
    corners = np.stack([np.arctan2(a, b) for a in y for b in x])
    error = _FUNCTION * 2.0**-52 * 4.0
    inverse = reciprocal(add(square(x), square(y)))
    value = outward(corners.min(axis=0) - error, corners.max(axis=0) + error)
    return value, (mul(x, inverse), neg(mul(y, inverse)))


def absolute(x: Interval) -> Sloped:
    """Return the magnitude, with its slope."""
    value = (np.maximum(np.maximum(x[0], -x[1]), 0.0), np.maximum(-x[0], x[1]))
    return value, ((np.where(x[0] >= 0.0, 1.0, -1.0), np.where(x[1] <= 0.0, -1.0, 1.0)),)


def larger(x: Interval, y: Interval) -> Sloped:
    """Return the larger one; slopes are 0 to 1, and generalised ones where both may be equal."""
    first, second = (y[1] < x[0]).astype(np.float64), (x[1] < y[0]).astype(np.float64)
    slopes = ((first, 1.0 - second), (second, 1.0 - first))
    return (np.maximum(x[0], y[0]), np.maximum(x[1], y[1])), slopes


def step(x: Interval) -> Sloped:
    """Return 1 where x is greater than 0, else 0."""
    none = np.zeros_like(x[0])
    return ((x[0] > 0.0).astype(np.float64), (x[1] > 0.0).astype(np.float64)), ((none, none),)


def choose(gate: Interval, x: Interval, y: Interval) -> Sloped:
    """Return either; a gate that may be both is exact, so that the computed choice is the right one."""
    opened, shut = gate[0] > 0.0, gate[1] <= 0.0
    lower = np.where(opened, x[0], np.where(shut, y[0], np.minimum(x[0], y[0])))
    upper = np.where(opened, x[1], np.where(shut, y[1], np.maximum(x[1], y[1])))
    none = np.zeros_like(lower)
    is_first, is_second = opened.astype(np.float64), shut.astype(np.float64)
    return (lower, upper), ((none, none), (is_first, 1.0 - is_second), (is_second, 1.0 - is_first))
