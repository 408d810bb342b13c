"""Errors that go on from row to row: how much neighbours have in common, and what that makes of deviations.

The residuals of a component are taken as a process of first order, with correlation rho^d between rows d apart.  A fit
takes away some of what neighbours share, so rho is the one whose residuals, behind such a fit, have on average the
estimated correlation.  Deviations follow from (S^T S)^-1 S^T R S (S^T S)^-1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index
from ..geometry.observations import Observations

_ERRORS = 3.0  # standard errors of a correlation that is none
_LEAST = 0.05  # correlation that is not worth a word
_MOST = 0.98  # more is indistinguishable from a drift
_HALVINGS = 12
_FEW = 10  # pairs of neighbours, at least


@dataclass(frozen=True)
class Serial:
    """Correlation of errors in neighbouring rows, and what follows from it.

    rho: of neighbours, 0 where none shows.  freedoms: effective ones of the residuals.  scale: by which the variance of
    estimated noise is too small.  steps: distance in rows of every number from the one before it, by sequence, for
    ``correlated``.
    """

    rho: float
    freedoms: float
    scale: float
    steps: tuple[tuple[Index, Array], ...]

    @property
    def effective(self) -> float:
        """Share of the numbers that independent ones would need to be: of a mean over many rows."""
        return (1.0 - self.rho) / (1.0 + self.rho)

    def widened(self, covariance: Array, S: Array, *, estimated: bool) -> Array:
        """Return the covariance of values, (P, P), with errors that go on; ``S``: whitened sensitivities, (M, P).

        estimated: whether the noise is, so that it has to grow by ``scale``, too.
        """
        Y = S @ covariance
        widened = covariance + Y.T @ (correlated(self.steps, self.rho, Y) - Y)
        return np.asarray((self.scale if estimated else 1.0) * 0.5 * (widened + widened.T))


def serial_of(seen: Observations, series: NDArray[np.int64], white: Array, U: Array) -> Serial | None:
    """Return the correlation of neighbouring rows in whitened residuals, (M,); None where none shows.

    U: orthonormal basis of what the fit takes away, (M, k).
    """
    steps = tuple(_sequences(seen, series))
    pairs = sum(int((d == 1.0).sum()) * places.shape[1] for places, d in steps)
    if pairs < _FEW or white.size <= U.shape[1] + 1 or not white.any():  # a loss may leave no number any weight
        return None
    estimate = float(white @ _neighbours(steps, white[:, np.newaxis])[:, 0]) / float(white @ white)
    LU = _neighbours(steps, U)
    taken = U.T @ LU

    def expected(rho: float) -> float:
        RU = correlated(steps, rho, U)
        of_R = U.T @ RU
        shared = pairs * rho - 2.0 * float((LU * RU).sum()) + float((taken * of_R).sum())
        return float(shared / (white.size - np.trace(of_R)))

    without = expected(0.0)
    error = float(np.sqrt(pairs)) / (white.size - U.shape[1])
    if estimate - without < _ERRORS * error:
        return None
    low, high = 0.0, _MOST
    for _ in range(_HALVINGS if expected(high) > estimate else 0):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if expected(middle) > estimate else (middle, high)
    return None if high < _LEAST else _at(high, steps, U, white.size)


def _at(rho: float, steps: tuple[tuple[Index, Array], ...], U: Array, many: int) -> Serial:
    """Return the effective degrees of freedom.

    Those of a chi-square with the mean and variance of the sum of squares.
    """
    RU = correlated(steps, rho, U)
    of_R = U.T @ RU
    left = many - float(np.trace(of_R))
    squares = float(correlated(steps, rho**2, np.ones((many, 1))).sum())
    variance = squares - 2.0 * float((RU**2).sum()) + float((of_R**2).sum())
    return Serial(rho, max(left**2 / max(variance, 1e-300), 1.0), (many - U.shape[1]) / max(left, 1e-300), steps)


def correlated(steps: tuple[tuple[Index, Array], ...], rho: float, X: Array) -> Array:
    """Return R X, (M, k), with R_ij = rho^(distance in rows) between numbers of one sequence, else 0."""
    product = np.array(X)
    for places, distance in steps:
        factor = np.where(np.isfinite(distance), rho ** np.where(np.isfinite(distance), distance, 0.0), 0.0)
        ahead = X[places]
        behind = ahead.copy()
        for i in range(1, len(places)):
            if factor[i]:
                ahead[i] += factor[i] * ahead[i - 1]
        for i in range(len(places) - 2, -1, -1):
            if factor[i + 1]:
                behind[i] += factor[i + 1] * behind[i + 1]
        product[places] = ahead + behind - X[places]
    return product


def _sequences(seen: Observations, series: NDArray[np.int64]) -> Iterator[tuple[Index, Array]]:
    """Yield indices of a block's numbers, (R, width), and distances to the row before, infinite in a new series."""
    first = 0
    for block in seen.blocks:
        many = block.rows.size * block.width
        places = np.arange(first, first + many, dtype=np.intp).reshape(-1, block.width)
        first += many
        distance = np.full(block.rows.size, np.inf)
        same = series[block.rows[1:]] == series[block.rows[:-1]]
        distance[1:][same] = np.diff(block.rows)[same]
        yield places, distance


def _neighbours(steps: tuple[tuple[Index, Array], ...], X: Array) -> Array:
    """Return L X, (M, k), with 1/2 between numbers of neighbouring rows of one sequence, else 0."""
    sums = np.zeros_like(X)
    for places, distance in steps:
        at = np.flatnonzero(distance == 1.0)
        sums[places[at]] += 0.5 * X[places[at - 1]]
        sums[places[at - 1]] += 0.5 * X[places[at]]
    return sums
