"""Corrections as splines: few numbers for many samples, so that they excite nothing that is faster than their knots."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ...arrays import Array
from ...optional import optional_import

DEGREE = 5


class Basis:
    """B-splines of degree 5 over equal intervals, N of them, at sample times.

    Args:
        t: times, (T,), s.
        intervals: between knots.
        resting: whether rates vanish at the first and at the last time.
    """

    def __init__(self, t: Array, intervals: int, resting: tuple[bool, bool]) -> None:
        with optional_import("SciPy", "splines need"):
            from scipy.interpolate import BSpline
        knots = np.concatenate([np.full(DEGREE, t[0]), np.linspace(t[0], t[-1], intervals + 1), np.full(DEGREE, t[-1])])
        whole = BSpline(knots, np.eye(intervals + DEGREE), DEGREE)
        self.intervals = intervals
        self.values, self.rates, self.accelerations = (
            _joined(x, resting) for x in (whole(t), whole.derivative(1)(t), whole.derivative(2)(t))
        )

    @cached_property
    def _square(self) -> Array:
        return regular(self.values.T @ self.values)

    def fit(self, samples: Array) -> Array:
        """Return coefficients, (N, m), of the splines that are nearest to samples, (T, m)."""
        return np.asarray(np.linalg.solve(self._square, self.values.T @ samples))


def regular(square: Array) -> Array:
    """Return a positive semidefinite matrix, (N, N), with so much on its diagonal that it can be solved with."""
    return np.asarray(square + 1e-12 * np.trace(square) / len(square) * np.eye(len(square)))


def _joined(columns: Array, resting: tuple[bool, bool]) -> Array:
    """Return columns (T, N) with the first two, and the last two, added up where the splines rest there."""
    begin, end = (2 if rests else 1 for rests in resting)
    inner = columns[:, begin : columns.shape[1] - end]
    first, last = columns[:, :begin].sum(axis=1), columns[:, columns.shape[1] - end :].sum(axis=1)
    return np.column_stack([first, inner, last])
