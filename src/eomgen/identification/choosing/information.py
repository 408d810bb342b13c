"""Information of candidate poses about a robot's errors, and two measures of it: determinant, and error of the tool.

Rows are in units of their noise, columns in those of expected sizes, and only what candidates can show at all counts:
M_i = Y_i^T Y_i.  Before any pose there is the unit matrix, since errors have the sizes that are expected, and the
information of poses that were measured already.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...arrays import Array

DETERMINANT, ERROR = "D", "V"
PoseCriterion = Literal["D", "V"]
CRITERIA = (DETERMINANT, ERROR)


@dataclass(frozen=True)
class Information:
    """Information of candidates about p combinations of parameters.

    start: what is known before, (p, p).  Y: of every candidate, (N, m, p).
    tool: mean over the workspace of J^T J of the tool's position, (p, p), m^2.
    """

    start: Array
    Y: Array
    tool: Array

    @property
    def size(self) -> int:
        """Combinations, p."""
        return len(self.start)

    def total(self, weights: Array) -> Array:
        """Return information of all with candidates as often as the weights say, (N,), whole numbers or not."""
        there = np.flatnonzero(weights)
        scaled = (self.Y[there] * np.sqrt(weights[there])[:, np.newaxis, np.newaxis]).reshape(-1, self.size)
        return np.asarray(self.start + scaled.T @ scaled)

    def error(self, covariance: Array) -> float:
        """Return the root of the mean square of the tool's distance from where it is thought to be, m."""
        return float(np.sqrt(max(np.trace(self.tool @ covariance), 0.0)))


@dataclass(frozen=True)
class Criterion:
    """A concave function f of an information matrix A that is to be large, log det A or -tr(W A^-1).

    tool: W, (p, p); None for the determinant.
    """

    tool: Array | None

    def value(self, A: Array) -> float:
        """Return the function's value."""
        if self.tool is None:
            return float(np.linalg.slogdet(A)[1])
        return -float(np.trace(np.linalg.solve(A, self.tool)))

    def gains(self, Y: Array, covariance: Array) -> Array:
        """Return by how much the function grows with each of N candidates, (N, m, p), in turn, (N,)."""
        YC = Y @ covariance
        inner = np.eye(Y.shape[1]) + YC @ Y.transpose(0, 2, 1)
        if self.tool is None:
            return np.asarray(2.0 * np.log(np.diagonal(np.linalg.cholesky(inner), axis1=1, axis2=2)).sum(axis=1))
        seen = YC @ self.tool @ YC.transpose(0, 2, 1)
        return np.asarray(np.trace(np.linalg.solve(inner, seen), axis1=1, axis2=2))

    def slopes(self, Y: Array, covariance: Array) -> Array:
        """Return derivatives of the function by the weight of each of N candidates, (N,)."""
        YC = Y @ covariance
        if self.tool is None:
            return np.asarray(np.einsum("nmp,nmp->n", YC, Y))
        return np.asarray(np.einsum("nmp,nmp->n", YC @ self.tool, YC))

    def efficiency(self, reached: float, possible: float, size: int) -> float:
        """Return the share of what is possible that is reached, 0 to 1.

        Of the p-th root of the determinant, or of 1 / error^2.
        """
        if self.tool is None:
            return float(np.exp(min(reached - possible, 0.0) / size))
        return float(min(max(possible / reached, 0.0), 1.0))


def criterion_of(name: str, information: Information) -> Criterion:
    """Return the criterion of that name."""
    return Criterion(None if name == DETERMINANT else information.tool)


def added(covariance: Array, Y: Array) -> Array:
    """Return the inverse of the information with one candidate more, (m, p), by its m rows alone."""
    YC = Y @ covariance
    return np.asarray(covariance - YC.T @ np.linalg.solve(np.eye(len(Y)) + YC @ Y.T, YC))


def removed(covariance: Array, Y: Array) -> Array:
    """Return the inverse of the information with one candidate less, (m, p), by its m rows alone."""
    YC = Y @ covariance
    return np.asarray(covariance + YC.T @ np.linalg.solve(np.eye(len(Y)) - YC @ Y.T, YC))


def inverse(A: Array) -> Array:
    """Return the inverse of a symmetric and positive definite matrix."""
    root = np.linalg.inv(np.linalg.cholesky(A))
    return np.asarray(root.T @ root)
