"""Functions of a kernel in double-double arithmetic, with bounds, as arrays of doubles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..calls import Calls
from ..raw import Array

IN_EXTENDED = "_extended"  # ends the name of a function in double-double arithmetic
AROUND = "_around"  # of one of arrays that are known within radii
EPS = 2.0**-52  # more than the rounding of an operation of doubles


class Extended(NamedTuple):
    """Numbers high + low, and bounds of what they are off by."""

    high: Array
    low: Array
    bound: Array

    def __sub__(self, other: Extended) -> Extended:
        """Subtract without rounding, but of the low parts."""
        total = self.high - other.high
        part = total - self.high
        lost = (self.high - (total - part)) - (other.high + part)
        low = lost + (self.low - other.low)
        size = np.abs(lost) + np.abs(self.low) + np.abs(other.low)
        return Extended(total, low, (self.bound + other.bound + 3.0 * EPS * size) * (1.0 + 4.0 * EPS))

    def at(self, *place: Any) -> Extended:
        """Select numbers by their place in all three arrays."""
        return Extended(self.high[place], self.low[place], self.bound[place])

    @property
    def rounded(self) -> tuple[Array, Array]:
        """Return doubles, and bounds of what these are off by."""
        value = self.high + self.low
        return value, (self.bound + EPS * np.abs(value)) * (1.0 + EPS)


def run_extended(calls: Calls, name: str, arrays: Sequence[Any], inner: int = 0) -> Extended:
    """Run a function in double-double arithmetic; the last ``inner`` leading axes are not of states."""
    axes = len(calls.raw.shapes[calls.raw.functions[name].writes])
    high, low, bound = np.moveaxis(calls.run(name, None, arrays, inner=inner).astype(np.float64), -axes, 0)
    return Extended(high, low, bound)


def distance(value: Array, exact: Extended) -> Array:
    """Bound how far values of a kernel are from exact ones."""
    zero = np.zeros_like(exact.high)
    off, bound = (Extended(np.asarray(value, np.float64), zero, zero) - exact).rounded
    total: Array = (np.abs(off) + bound) * (1.0 + EPS)
    return total


def as_bound(bound: Array, dtype: np.dtype[Any]) -> Array:
    """Round bounds up to a kernel's dtype; where there is none, infinity."""
    with np.errstate(over="ignore"):
        up = np.nextafter(np.where(np.isnan(bound), np.inf, bound).astype(dtype), np.asarray(np.inf, dtype))
    result: Array = np.where(bound == 0.0, np.zeros_like(up), up)
    return result
