"""Splines of degree 5 that satisfy equations at equally spaced times, and of all those the one of least norm.

Their knots are the times but the second and the last but one.  N + 3 coefficients c_j of coordinates, (n,) each, are
unknown; at the time k only WIDTH of them count, from s_k on, so that the linearized equations are
sum_j B_j[k] c_s_k+j = b_k with blocks (n, n), k = 0 ... N.  There are 2 n fewer of them than unknowns: what is free is
how the motion begins and ends.  Conditions there keep out what decays forwards at the first time, and what decays
backwards at the last one, as far as times resolve it, and keep the outputs' rates; of what is left the least norm has
nothing that grows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Array, Index
from ...errors import IntegrationError
from ...optional import optional_import

DEGREE = 5
WIDTH = 6  # coefficients that count at a time
OUTER = 3  # times at which the first two coefficients count, or the last two
SWEEPS = 30  # of equilibrating
SHIFTS = (0.0, 1e-15, 1e-13, 1e-11)  # of the normal equations, as parts of their diagonal, 1
REFINEMENTS, EXACT, ENOUGH = 60, 1e-9, 1e-5  # of a solution, and what is left of the right side


@dataclass(frozen=True, eq=False)
class CollocationSpline:
    """A spline over N equal steps, with coefficients (N + 3, n).

    Attributes:
        t: times of the equations, (N + 1,), s.
        knots: as SciPy has them.
        coefficients: (N + 3, n).
        starts: the first coefficient that counts at each time, (N + 1,).
        weights: of WIDTH coefficients there, for value, first and second derivative, (3, N + 1, WIDTH).
    """

    t: Array
    knots: Array
    coefficients: Array
    starts: Index
    weights: Array

    @classmethod
    def through(cls, t: Array, points: Array, rates: Array) -> CollocationSpline:
        """Make the spline through points, (N + 1, n), with velocities at its first and last time, (2, n).

        Raises:
            InputError: SciPy is not installed.
        """
        with optional_import("SciPy", "a stable inversion needs"):
            from scipy.interpolate import BSpline, make_interp_spline
        knots = np.concatenate([np.repeat(t[0], DEGREE + 1), t[2:-2], np.repeat(t[-1], DEGREE + 1)])
        ends: Any = ([(1, rates[0])], [(1, rates[1])])
        spline = make_interp_spline(t, points, k=DEGREE, t=knots, bc_type=ends)
        last = t.size + 1 - (WIDTH - 1)
        starts = np.clip(np.arange(t.size) - 1, 0, last)
        starts[-2:] = last
        count, places = t.size + 2, starts[:, np.newaxis] + np.arange(WIDTH)
        pulses = np.zeros((count, 2 * WIDTH))  # of every twelfth coefficient, so that none meets another at a time
        pulses[np.arange(count), np.arange(count) % (2 * WIDTH)] = 1.0
        column = places % (2 * WIDTH)
        values = (BSpline(knots, pulses, DEGREE)(t, nu=order) for order in range(3))
        weights = np.stack([np.take_along_axis(x, column, axis=1) for x in values])
        return cls(t, knots, spline.c, starts, weights)

    @property
    def times(self) -> Array:
        """Times of the equations and those halfway between them, (2 N + 1,), s."""
        return np.sort(np.concatenate([self.t, 0.5 * (self.t[1:] + self.t[:-1])]))

    def moved(self, change: Array) -> CollocationSpline:
        """Return the spline whose coefficients differ by a change, (N + 3, n)."""
        return replace(self, coefficients=self.coefficients + change)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations at times within it, (T, n) each."""
        from scipy.interpolate import BSpline

        spline = BSpline(self.knots, self.coefficients, DEGREE)
        return spline(t), spline(t, nu=1), spline(t, nu=2)


def equilibrated(sizes: Array) -> tuple[Array, Array]:
    """Return factors of rows and columns, (n,) each, that make the norms of all rows and columns of (n, n) alike."""
    rows, columns = np.ones(len(sizes)), np.ones(len(sizes))
    for _ in range(SWEEPS):
        scaled = rows[:, np.newaxis] * sizes * columns
        rows /= _root(np.linalg.norm(scaled, axis=1))
        scaled = rows[:, np.newaxis] * sizes * columns
        columns /= _root(np.linalg.norm(scaled, axis=0))
    return rows, columns


def _root(norms: Array) -> Array:
    """Return square roots, of zeros 1."""
    return np.asarray(np.sqrt(np.where(norms > 0.0, norms, 1.0)))


def least_norm(blocks: Array, starts: Index, right: Array, ends: tuple[Array, Array]) -> Array:
    """Return coefficients (N + 3, n) of least norm with sum_j blocks[j, k] c_(starts[k] + j) = right[k].

    Args:
        blocks: (WIDTH, N + 1, n, n), rows and columns about as large as each other.
        starts: (N + 1,), of a ``CollocationSpline``.
        right: (N + 1, n).
        ends: orthonormal rows, (r, 2 n) each, to which the first and the last two coefficients are orthogonal.

    Raises:
        IntegrationError: the equations do not determine them to a part ENOUGH of the right side.
    """
    with optional_import("SciPy", "a stable inversion needs"):
        from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
    band, size = _normal_band(blocks, starts, ends), max(float(np.abs(right).max()), 1e-300)
    left = np.inf
    for shift in SHIFTS:
        try:
            factor = cholesky_banded(band + shift * (np.arange(len(band)) == 0)[:, np.newaxis], lower=True)
        except LinAlgError:
            continue
        solution = np.zeros((len(right) + 2, right.shape[1]))
        rest, along, before = right, np.zeros_like(right), np.inf
        for _ in range(REFINEMENTS):  # conjugate gradients, since a shift leaves a few directions that it hides
            better = cho_solve_banded((factor, True), rest.ravel()).reshape(right.shape)
            descent = float((rest * better).sum())
            along = better + descent / before * along
            change = _without(_transposed_product(blocks, starts, along), ends)
            length = descent / max(float((change**2).sum()), 1e-300)
            solution, before = solution + length * change, descent
            rest = right - _product(blocks, starts, solution)
            left = float(np.abs(rest).max()) / size
            if left <= EXACT or not np.isfinite(left):
                break
        if left <= ENOUGH:
            return solution
    raise IntegrationError(
        f"the equations at the samples leave {left:.3g} of their right side: samples are too near to each other for"
        " float64; allowed: a longer step"
    )


def _without(coefficients: Array, ends: tuple[Array, Array]) -> Array:
    """Return coefficients, (N + 3, n), without what of the first and the last two is along these rows."""
    result, n = np.array(coefficients), coefficients.shape[1]
    for rows, place in zip(ends, (slice(0, 2), slice(-2, None)), strict=True):
        result[place] -= (rows.T @ (rows @ coefficients[place].ravel())).reshape(2, n)
    return np.asarray(result)


def _normal_band(blocks: Array, starts: Index, ends: tuple[Array, Array]) -> Array:
    """Return the lower band of B P B^T, P the projection ``_without``, as SciPy has it, (WIDTH n, (N + 1) n)."""
    count, n = blocks.shape[1], blocks.shape[2]
    band = np.zeros((WIDTH * n, count * n))
    i, j = (x.ravel() for x in np.indices((n, n)))
    for off in range(WIDTH):
        later = np.zeros((count - off, n, n))
        between = starts[off:] - starts[: count - off]
        for apart in np.unique(between).tolist():
            rows = np.flatnonzero(between == apart)
            for k in range(WIDTH - apart):
                later[rows] += blocks[k, rows + off] @ np.swapaxes(blocks[k + apart, rows], 1, 2)
        below = off * n + i - j >= 0
        place = n * np.arange(count - off)[:, np.newaxis]
        band[(off * n + i - j)[below], place + j[below]] = later[:, i[below], j[below]]
    for conditions, first, kept in zip(ends, (0, count - OUTER), ((0, 1), (count, count + 1)), strict=True):
        corner = np.zeros((OUTER, n, 2, n))
        for k in range(OUTER):
            for side, coefficient in enumerate(kept):
                offset = coefficient - int(starts[first + k])
                if 0 <= offset < WIDTH:
                    corner[k, :, side] = blocks[offset, first + k]
        along = corner.reshape(OUTER * n, 2 * n) @ conditions.T
        row, column = np.tril_indices(OUTER * n)
        band[row - column, first * n + column] -= (along @ along.T)[row, column]
    return band


def _product(blocks: Array, starts: Index, coefficients: Array) -> Array:
    result = np.zeros((blocks.shape[1], blocks.shape[2]))
    for j in range(WIDTH):
        result += (blocks[j] @ coefficients[starts + j][..., np.newaxis])[..., 0]
    return result


def _transposed_product(blocks: Array, starts: Index, weights: Array) -> Array:
    result = np.zeros((blocks.shape[1] + 2, blocks.shape[2]))
    for j in range(WIDTH):
        np.add.at(result, starts + j, (weights[:, np.newaxis, :] @ blocks[j])[:, 0])
    return result
