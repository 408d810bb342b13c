"""Programs in the double-double arithmetic of ``clib/double_double.h``, on many states at once, with the same bits.

Numbers are unevaluated sums of two doubles, beside each a bound of what rounding has moved it by; sources are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.program.ir import Program

Array = NDArray[Any]

UNIT, CALLED, LEAST = 2.0**-102, 2.0**-50, 2.0**-1000  # as in C
_UP, _DOWN = 1.0 + 2.0**-48, 1.0 - 2.0**-48
_FARTHEST = 2.0**30  # rad
_TERMS = {"sin": 13, "cos": 14}
_QUARTER = tuple(map(float.fromhex, ("0x1.921fb54442d18p+0", "0x1.1a62633145c07p-54", "-0x1.f1976b7ed8fbcp-110")))
_QUARTERS = float.fromhex("0x1.45f306dc9c883p-1")  # 2/pi


class Pair(NamedTuple):
    """A number, high + low."""

    high: Any
    low: Any

    def __neg__(self) -> Pair:
        return Pair(-self.high, -self.low)

    @property
    def above(self) -> Any:
        """Bound its size from above."""
        return np.abs(self.high) + np.abs(self.low)


class Bounded(NamedTuple):
    """A number and the bound of its error."""

    x: Pair
    error: Any

    @property
    def below(self) -> Any:
        """Bound the size of the exact number from below."""
        return (np.abs(self.x.high) - np.abs(self.x.low)) * _DOWN - self.error * _UP

    @property
    def is_nothing(self) -> Any:
        """Whether the number is exactly 0, as its products are then."""
        return (self.error <= 0.0) & (np.abs(self.x.high) <= 0.0)

    @property
    def is_sure(self) -> Any:
        """Whether the sign of the exact number is known; that of an exact one is, of 0 too."""
        return (self.error <= 0.0) | (self.below > 0.0)


def quick_sum(x: Any, y: Any) -> Pair:
    """Add, where x is not the smaller one."""
    total = x + y
    return Pair(total, y - (total - x))


def two_sum(x: Any, y: Any) -> Pair:
    """Add two doubles exactly."""
    total = x + y
    part = total - x
    return Pair(total, (x - (total - part)) + (y - part))


def two_product(x: Any, y: Any) -> Pair:
    """Multiply two doubles exactly."""
    product = x * y
    x_up, y_up = 134217729.0 * x, 134217729.0 * y
    x_head, y_head = x_up - (x_up - x), y_up - (y_up - y)
    x_tail, y_tail = x - x_head, y - y_head
    return Pair(product, (((x_head * y_head - product) + x_head * y_tail) + x_tail * y_head) + x_tail * y_tail)


def pair_sum(x: Pair, y: Pair) -> Pair:
    """Add two pairs."""
    s, t = two_sum(x.high, y.high), two_sum(x.low, y.low)
    v = quick_sum(s.high, s.low + t.high)
    return quick_sum(v.high, t.low + v.low)


def pair_product(x: Pair, y: Pair) -> Pair:
    """Multiply two pairs."""
    c = two_product(x.high, y.high)
    return quick_sum(c.high, c.low + (x.high * y.low + x.low * y.high))


def pair_quotient(x: Pair, y: Pair) -> Pair:
    """Divide two pairs."""
    high = x.high / y.high
    c = two_product(y.high, high)
    t = quick_sum(c.high, y.low * high)
    r = quick_sum(t.high, t.low + c.low)
    return quick_sum(high, ((x.high - r.high) + (x.low - r.low)) / y.high)


def pair_root(x: Pair) -> Pair:
    """Return the square root of a pair."""
    high = np.sqrt(x.high)
    square = two_product(high, high)
    rest = ((x.high - square.high) - square.low) + x.low
    return quick_sum(high, np.where(high > 0.0, rest / (2.0 * high), 0.0))


def _terms(op: str) -> list[Pair]:
    """Return Taylor's coefficients of (sin x - x) / x^3 or (cos x - 1) / x^2 by x^2, the last one first."""
    terms = []
    for k in range(_TERMS[op], 0, -1):
        exact = Fraction((-1) ** k, math.factorial(2 * k + (op == "sin")))
        terms.append(Pair(float(exact), float(exact - Fraction(float(exact)))))
    return terms


SERIES = {op: _terms(op) for op in _TERMS}


def pair_sine(x: Pair, quarter: int) -> Pair:
    """Return the sine of a pair and so many right angles; NaN of more than 2^30 rad."""
    quarters = np.floor(x.high * _QUARTERS + 0.5)
    r = x
    for part in _QUARTER:
        r = pair_sum(r, -two_product(quarters, part))
    turns = quarters - 4.0 * np.floor(quarters / 4.0) + quarter
    is_cosine = turns % 2.0 == 1.0
    z, sums = pair_product(r, r), []
    for op, terms in SERIES.items():
        total = terms[0]
        for term in terms[1:]:
            total = pair_sum(pair_product(total, z), term)
        total = pair_product(total, z)
        sums.append(pair_sum(pair_product(total, r), r) if op == "sin" else pair_sum(total, Pair(1.0, 0.0)))
    sign = np.where(turns % 4.0 >= 2.0, -1.0, 1.0)
    near = np.abs(x.high) <= _FARTHEST
    return Pair(*(np.where(near, sign * np.where(is_cosine, c, s), np.nan) for s, c in zip(*sums, strict=True)))


def _sum(x: Bounded, y: Bounded) -> Bounded:
    z = pair_sum(x.x, y.x)
    return Bounded(z, x.error + y.error + UNIT * z.above)


def _product(x: Bounded, y: Bounded) -> Bounded:
    z, least = pair_product(x.x, y.x), np.where(x.is_nothing | y.is_nothing, 0.0, LEAST)
    return Bounded(z, x.x.above * y.error + (y.x.above + y.error) * x.error + UNIT * z.above + least)


def _quotient(x: Bounded, y: Bounded) -> Bounded:
    z = pair_quotient(x.x, y.x)
    below, size, least = y.below, z.above, np.where(x.is_nothing, 0.0, LEAST)
    moved = ((x.error + (size + least) * _UP * y.error) * _UP) / below
    return Bounded(z, np.where(below > 0.0, moved + UNIT * size + least, np.inf))


def _sine(x: Bounded, quarter: int) -> Bounded:
    z = pair_sine(x.x, quarter)
    return Bounded(z, np.where(np.isnan(z.high), np.nan, x.error + 2.0 * UNIT))


def _root(x: Bounded) -> Bounded:
    z = pair_root(x.x)
    least, wide = np.abs(z.high) - np.abs(z.low), np.sqrt(x.error * _UP)
    moved = np.where(least > 0.0, np.fmin(x.error * _UP / least, wide), wide)
    return Bounded(z, moved + UNIT * z.above + LEAST)


def _magnitude(x: Bounded) -> Bounded:
    is_below = (x.x.high < 0.0) | ((x.x.high == 0.0) & (x.x.low < 0.0))
    return Bounded(Pair(np.where(is_below, -x.x.high, x.x.high), np.where(is_below, -x.x.low, x.x.low)), x.error)


def _larger(x: Bounded, y: Bounded) -> Bounded:
    is_above = (y.x.high > x.x.high) | ((y.x.high == x.x.high) & (y.x.low > x.x.low))
    z = Pair(np.where(is_above, y.x.high, x.x.high), np.where(is_above, y.x.low, x.x.low))
    apart = pair_sum(x.x, -y.x)
    is_sure = Bounded(apart, x.error + y.error + UNIT * apart.above).is_sure
    either = np.where(x.error >= y.error, x.error, y.error)
    error = np.where(is_sure, np.where(is_above, y.error, x.error), either)
    return Bounded(z, np.where(np.isnan(x.error + y.error), np.nan, error))


def _positive(x: Bounded) -> Bounded:
    return Bounded(Pair(np.where(x.x.high > 0.0, 1.0, 0.0), 0.0), np.where(x.is_sure, 0.0, 1.0))


def _choice(gate: Bounded, x: Bounded, y: Bounded) -> Bounded:
    is_first = gate.x.high > 0.0
    z = Pair(np.where(is_first, x.x.high, y.x.high), np.where(is_first, x.x.low, y.x.low))
    either = x.error + y.error + pair_sum(x.x, -y.x).above * _UP
    return Bounded(z, np.where(gate.is_sure, np.where(is_first, x.error, y.error), either))


def _exponential(x: Bounded) -> Bounded:
    high = np.exp(x.x.high)
    return Bounded(quick_sum(high, high * x.x.low), high * (CALLED + x.error * np.exp(x.error) * _UP) + LEAST)


def _logarithm(x: Bounded) -> Bounded:
    high, below = np.log(x.x.high), x.below
    moved = np.where(below > 0.0, x.error / below, np.inf)
    return Bounded(two_sum(high, x.x.low / x.x.high), CALLED * np.abs(high) + moved + UNIT)


def _angle(y: Bounded, x: Bounded) -> Bounded:
    angle = np.arctan2(y.x.high, x.x.high)
    moved = (np.abs(y.x.low) + np.abs(x.x.low) + y.error + x.error) * _UP
    left = np.fmax(np.abs(y.x.high), np.abs(x.x.high)) * _DOWN - moved
    cut = np.where((x.x.high > 0.0) | (y.below > 0.0), 0.0, 6.2832)
    error = 1.58 * moved / left + CALLED * np.abs(angle) + cut
    error = np.where(left > 0.0, error, 6.2832)
    return Bounded(Pair(angle, np.zeros_like(angle)), np.where(np.isnan(angle + moved), np.nan, error))


_OPERATIONS: Mapping[str, Callable[..., Bounded]] = {
    "neg": lambda x: Bounded(-x.x, x.error),
    "add": _sum,
    "sub": lambda x, y: _sum(x, Bounded(-y.x, y.error)),
    "mul": _product,
    "div": _quotient,
    "sin": lambda x: _sine(x, 0),
    "cos": lambda x: _sine(x, 1),
    "sqrt": _root,
    "abs": _magnitude,
    "max": _larger,
    "step": _positive,
    "choose": _choice,
    "exp": _exponential,
    "log": _logarithm,
    "atan2": _angle,
}


def run_extended(program: Program, inputs: Mapping[str, Any], dtype: np.dtype[Any], radii: Mapping[str, str]) -> Array:
    """Return high parts, low parts and bounds of a program's results, (3 results, states), as C writes them.

    Args:
        inputs: by the names of arrays, for every number of it that of all states, (states,).
        dtype: of the arrays.
        radii: of arrays that are no more than near the exact ones, the names of those that say how near.
    """
    values: list[Bounded] = []
    for op, args, leaf in program.instructions:
        if op in ("const", "input"):
            number = np.float64(leaf) if op == "const" else np.asarray(inputs[leaf[0]][leaf[1]], np.float64)
            radius = np.zeros_like(number)
            if op == "input" and leaf[0] in radii:
                radius = np.abs(np.asarray(inputs[radii[leaf[0]]][leaf[1]], np.float64))
            values.append(Bounded(Pair(number, np.zeros_like(number)), radius))
            continue
        z = _OPERATIONS[op](*[values[arg] for arg in args])
        values.append(Bounded(z.x, z.error * _UP))
    order = sorted(program.outputs, key=lambda key: key[1])
    rows = [_written(values[program.outputs[key]], dtype) for key in order]
    columns = max((np.size(x) for row in rows for x in row), default=1)
    whole = [[np.broadcast_to(x, (columns,)) for x in row] for row in rows]
    return np.array([row[k] for k in range(3) for row in whole], dtype).reshape(3 * len(rows), columns)


def _written(z: Bounded, dtype: np.dtype[Any]) -> tuple[Any, Any, Any]:
    """Split a number into parts of the arrays' dtype, with a bound for their sum."""
    high = dtype.type(z.x.high) if np.ndim(z.x.high) == 0 else z.x.high.astype(dtype)
    rest = (z.x.high - np.float64(high)) + z.x.low
    low = np.asarray(rest, dtype)
    if dtype == np.float64:
        return high, low, z.error
    error = (z.error + np.abs(rest - np.float64(low)) + 2.0**-52 * np.abs(rest)) * _UP
    wide = np.asarray(error * (1.0 + 2.0**-22), dtype) + np.float32(2.0**-149)
    return high, low, np.where(error > 0.0, wide, np.asarray(error, dtype))
