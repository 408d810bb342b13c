"""Least squares over time behind filters: what noise adds on average, variances by a jackknife over blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Array, Mask
from ...motion.smoothing import bell, filtered
from ...optional import optional_import
from ..estimating import SIGNAL, block_count
from .result import Estimate

INDEPENDENT = 1e-10  # of the greatest eigenvalue of the scaled normal equations: below it a direction is undetermined
SHARE = 1e-4  # of a parameter in an undetermined direction: with less it is determined


@dataclass(frozen=True)
class Noise:
    """White noise of k coordinates, which columns and right sides of f equations take on.

    sigma: standard deviations, (k,).  shares: of deviations and rates in the columns, (p, f, k, 2).  inertia: of the
    equations by second derivatives, (f, k); 0 where rates were measured.  weights: of the first filter by order of the
    derivative, (3, w).  is_derived: whether rates are derivatives of the coordinates.
    """

    sigma: Array
    shares: Array
    inertia: Array
    weights: Array
    is_derived: bool

    def behind(self, wide: Array) -> tuple[Array, Array]:
        """Return its average share in products of columns, (p, p), and in those with right sides, (p,), filtered."""
        both = np.stack([np.convolve(row, wide) for row in self.weights])
        powers, variance = both @ both.T, self.sigma**2
        size = variance[:, np.newaxis] * np.diagonal(powers)[:2]
        if not self.is_derived:  # with measured velocities or accelerations, the noise of q is in no other term
            size[:, 1] = 0.0
            return np.einsum("pfkd,qfkd,kd->pq", self.shares, self.shares, size), np.zeros(len(self.shares))
        of_right = np.einsum("pfk,fk,k->p", self.shares[..., 0], self.inertia, variance * powers[0, 2])
        return np.einsum("pfkd,qfkd,kd->pq", self.shares, self.shares, size), -of_right


@dataclass(frozen=True)
class System:
    """Equations of some parameters: columns, (T, f, p), and right sides, (T, f).

    noise: of a tree's coordinates; None of a mechanism, where nothing is taken off.  of_one: of one coordinate, whose
    columns are s and s_dot, which of them are sought, (2,); s has to move.
    """

    columns: Array
    right: Array
    noise: Noise | None = None
    of_one: Mask | None = None

    def moving(self, square: Array, of_noise: Array) -> Mask:
        """Return which columns are more than noise, (p,), by their mean squares and those of noise."""
        moving = square > (1.0 + SIGNAL) * of_noise + 1e-30
        if self.of_one is not None:
            moving &= moving[0] & self.of_one
        return np.asarray(moving)

    def solved(self, half: int, width: int) -> Solution:
        """Return least squares behind a bell of that half width; variances are the jackknife's over blocks of time.

        width: half width of all filters together, samples.
        """
        samples, motions, count = self.columns.shape
        wide = bell(half)
        X = filtered(self.columns.reshape(samples, -1), wide).reshape(-1, motions, count)
        y = filtered(self.right, wide)
        of_X, of_y = (np.zeros((count, count)), np.zeros(count)) if self.noise is None else self.noise.behind(wide)
        square = np.mean(X**2, axis=(0, 1))
        moving = self.moving(square, np.diagonal(of_X) / motions)
        blocks, size = block_count(len(X), max(width, 1)), np.sqrt(square[moving])
        values, replicates = np.full(count, np.nan), np.full((blocks, count), np.nan)
        freedoms = blocks - (1 if self.of_one is None else int(moving.sum()))
        if not moving.any():
            return Solution(values, replicates, square, width, freedoms, 1.0)
        X, of_X, of_y = X[..., moving] / size, of_X[np.ix_(moving, moving)] / np.outer(size, size), of_y[moving] / size
        parts = list(zip(np.array_split(X, blocks), np.array_split(y, blocks), strict=True))
        A = np.stack([np.einsum("tfp,tfq->pq", x, x) - len(x) * of_X for x, _ in parts])
        c = np.stack([np.einsum("tfp,tf->p", x, r) - len(x) * of_y for x, r in parts])
        normal, right = (np.concatenate([x.sum(axis=0, keepdims=True), x.sum(axis=0) - x]) for x in (A, c))
        eigenvalues, vectors = np.linalg.eigh(normal)  # of all, then without one block each
        kept = np.abs(eigenvalues) > INDEPENDENT * np.abs(eigenvalues).max(axis=1, keepdims=True)
        lost = (np.linalg.norm(np.where(kept[:, np.newaxis], 0.0, vectors), axis=2) > SHARE).any(axis=0)
        inverse = (
            np.where(kept, 1.0 / np.where(kept, eigenvalues, 1.0), 0.0)[:, np.newaxis]
            * vectors
            @ vectors.swapaxes(1, 2)
        )
        solved = np.einsum("bpq,bq->bp", inverse, right)
        solved += np.einsum("bpq,bq->bp", inverse, right - np.einsum("bpq,bq->bp", normal, solved))  # of round-off
        residual = y - X @ solved[0]
        explained = float(np.sqrt(np.mean(residual**2) / max(float(np.mean(y**2)), 1e-300)))
        values[moving] = np.where(lost, np.nan, solved[0] / size)
        replicates[:, moving] = np.where(lost, np.nan, solved[1:] / size)
        return Solution(values, replicates, square, width, freedoms, explained)


@dataclass(frozen=True)
class Solution:
    """Values of all parameters behind one filter, (p,), and without one block of time each, (B, p); NaN: not known.

    square: mean squares of their columns, (p,).  half: width of all filters, samples.
    """

    values: Array
    replicates: Array
    square: Array
    half: int
    freedoms: int
    unexplained: float

    @cached_property
    def variances(self) -> Array:
        """Variances by the jackknife, (p,); infinite of what is not determined."""
        blocks = len(self.replicates)
        off = self.replicates - self.values
        return np.where(np.isnan(self.values), np.inf, (off**2).sum(axis=0) * (blocks - 1) / blocks)

    def deviation_of(self, value: float, replicates: Array) -> float:
        """Return the standard error of a function of the parameters, by its value and those without a block, (B,)."""
        blocks = len(replicates)
        return float(np.sqrt(((replicates - value) ** 2).sum() * (blocks - 1) / blocks))

    def estimate(self, place: int, confidence: float, described: float, step: float) -> Estimate:
        """Return a parameter with its interval, by Student's t."""
        with optional_import("SciPy", "fit needs"):
            from scipy.stats import t as student
        quantile = float(student.ppf(0.5 + confidence / 2, self.freedoms))
        value, error = float(self.values[place]), float(np.sqrt(float(self.variances[place])))
        low, high = value - quantile * error, value + quantile * error
        return Estimate(value, error, low, high, described, 2 * self.half * step, self.unexplained)


def best_of(solutions: Sequence[Solution], places: Sequence[int]) -> Solution:
    """Return the solution that determines most of these parameters, then with the least variance of their forces."""

    def rank(solution: Solution) -> tuple[int, float]:
        known = [place for place in places if np.isfinite(solution.values[place])]
        return -len(known), float((solution.variances[known] * solution.square[known]).sum())

    return min(solutions, key=rank)
