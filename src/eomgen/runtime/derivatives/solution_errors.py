"""Bounds of the errors of solutions, by what they leave of the equations: K x = b with an approximate inverse R.

With |1 - R K| <= G and a norm of G below 1, K can be inverted, and a solution x that leaves r = b - K x is off by
(1 - R K)^-1 R r at most: |R r| and G / (1 - norm) times its largest entry.  K is enclosed by equations in double-double
arithmetic at unit vectors, r is what they give at x; so |R r| is nearly the error itself.

Source: S. M. Rump, "Verification methods: rigorous results using floating-point arithmetic", Acta Numerica 19, 2010,
section 10.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..raw import Array
from .extended import EPS, Extended

Equations = Callable[[Array], Extended]  # points (N, P, unknowns) -> (N, P, equations), affine in the points
DEPENDENT = 1e-9  # singular values below this share of the largest one belong to equations that follow from others
SWEEPS = 4  # of scaling


@dataclass(frozen=True)
class SolutionErrors:
    """Bounds of the errors of solutions.

    Attributes:
        bound: of each unknown, (N, unknowns).
        proved: whether it is proved, (N,); else it is an estimate: the equations are singular, or may be.
    """

    bound: Array
    proved: Array


@dataclass(frozen=True)
class Matrix:
    """A matrix K of equations, (N, equations, unknowns), with bounds of its errors, and an inverse if there is one.

    Attributes:
        value, error: of K.
        inverse: R.
        off: G, a bound of |1 - R K|.
        scale: sizes of the unknowns, by which norms are weighted, (N, unknowns).
        proved: whether the norm of G is below 1, (N,).
    """

    value: Array
    error: Array
    inverse: Array
    off: Array
    scale: Array
    proved: Array

    def errors(self, left: Extended) -> SolutionErrors:
        """Bound the errors of solutions by what they leave of the equations, (N, equations)."""
        rest, of_rest = left.rounded
        size = np.abs(self.inverse)
        terms = rest.shape[-1] + 2
        near = np.abs(np.einsum("nij,nj->ni", self.inverse, rest))
        near = near + np.einsum("nij,nj->ni", size, of_rest + 2.0 * terms * EPS * np.abs(rest))
        near = near * (1.0 + terms * EPS)
        weighed = near / self.scale
        row = (self.off * self.scale[:, None, :]).sum(axis=-1) / self.scale
        norm = np.where(self.proved, row.max(axis=-1, initial=0.0), 0.0)
        more = np.where(self.proved[:, None], row, 0.0) / (1.0 - norm)[:, None]
        bound = (weighed + more * weighed.max(axis=-1, initial=0.0)[:, None]) * self.scale * (1.0 + 16.0 * EPS)
        return SolutionErrors(bound, self.proved & np.isfinite(bound).all(axis=-1))


def matrix_of(equations: Equations, count: int, unknowns: int, dtype: np.dtype[np.floating]) -> tuple[Array, Array]:
    """Return the matrix of affine equations, (N, equations, unknowns), and bounds of its errors.

    Args:
        count: N.
        unknowns: how many.
        dtype: of the points.
    """
    points = np.zeros((count, unknowns + 1, unknowns), dtype)
    points[:, 1:] = np.eye(unknowns, dtype=dtype)
    found = equations(points)
    value, error = (found.at(slice(None), slice(1, None)) - found.at(slice(None), slice(0, 1))).rounded
    return np.swapaxes(value, 1, 2), np.swapaxes(error, 1, 2)


def enclosed_inverse(value: Array, error: Array) -> Matrix:
    """Invert matrices, (N, m, m), that are known within errors, and verify it; of singular ones a pseudoinverse."""
    rows, columns = _scales(value)
    scaled = value * rows[:, :, None] * columns[:, None, :]
    inverse = _inverse(scaled) * columns[:, :, None] * rows[:, None, :]
    off = _off(inverse, value, error)
    norm = (off * columns[:, None, :]).sum(axis=-1) / columns
    is_square = value.shape[1] == value.shape[2]
    proved = (norm.max(axis=-1, initial=0.0) * (1.0 + 64.0 * EPS) < 1.0) & is_square
    for state in np.flatnonzero(~proved):
        if np.isfinite(scaled[state]).all():
            pseudo = np.linalg.pinv(scaled[state], rcond=DEPENDENT)
            inverse[state] = pseudo * columns[state, :, None] * rows[state, None, :]
    return Matrix(value, error, inverse, off, columns, proved)


def _inverse(matrices: Array) -> Array:
    """Invert square matrices; what cannot be inverted is zero."""
    if matrices.shape[1] != matrices.shape[2]:
        return np.zeros((matrices.shape[0], matrices.shape[2], matrices.shape[1]))
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return np.concatenate([_inverse(x[np.newaxis]) for x in matrices]) if len(matrices) > 1 else 0.0 * matrices


def _off(inverse: Array, value: Array, error: Array) -> Array:
    """Bound |1 - R K|, with rounding of the product and errors of K."""
    size, terms = np.abs(inverse), value.shape[1] + 2
    one = np.eye(value.shape[2])
    product = np.einsum("nij,njk->nik", inverse, value)
    rounding = terms * EPS * (np.einsum("nij,njk->nik", size, np.abs(value)) + one)
    off: Array = np.abs(one - product) + np.einsum("nij,njk->nik", size, error) + rounding
    off *= 1.0 + terms * EPS
    return off


def _scales(value: Array) -> tuple[Array, Array]:
    """Return factors of rows and columns by which the largest entries of both become about 1."""
    rows, columns = np.ones(value.shape[:2]), np.ones((value.shape[0], value.shape[2]))
    size = np.abs(value)
    for _ in range(SWEEPS):
        now = size * rows[:, :, None] * columns[:, None, :]
        for factors, axis in ((rows, 2), (columns, 1)):
            largest = np.sqrt(now.max(axis=axis, initial=0.0))
            factors /= np.where((largest > 0.0) & np.isfinite(largest), largest, 1.0)
    return rows, columns
