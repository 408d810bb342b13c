"""Covariances of Kalman filters, dense as textbooks have them: P itself, or its square root U with P = U^T U.

Source: G. J. Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977; square roots by orthogonal
transformations as in T. Kailath, A. H. Sayed, B. Hassibi, "Linear Estimation", 2000, section 12.
"""

from __future__ import annotations

from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import IntegrationError

Numbers = NDArray[Any]  # of either precision


class Uncertain(Protocol):
    """How a filter keeps the covariance of its state: a value, which steps and measurements make others of."""

    @property
    def covariance(self) -> Numbers:
        """The covariance P, (N, N)."""
        ...

    @property
    def is_finite(self) -> bool:
        """Whether P is finite."""
        ...

    def carried(self, F: Numbers, G: Numbers) -> Self:
        """Return P after a step, F P F^T + G G^T: F is the transition matrix, (N, N), noise is along columns of G."""
        ...

    def measured(self, H: Numbers, deviations: Numbers, innovation: Numbers) -> tuple[Self, Numbers, Numbers]:
        """Return P after measurements, the change of the state, (N,), and normalized innovations, (m,).

        Args:
            H: derivatives of what is measured by the state, (m, N).
            deviations: standard deviations of the measurements, (m,).
            innovation: measured less predicted, (m,).
        """
        ...


class Covariance:
    """P itself: the extended Kalman filter as it is in textbooks."""

    def __init__(self, P: Numbers) -> None:
        """Keep a covariance P, (N, N)."""
        self._P = P

    @classmethod
    def of(cls, deviations: Numbers) -> Self:
        """Return the covariance of independent numbers of these standard deviations, (N,)."""
        return cls(np.diag(deviations * deviations))

    @property
    def covariance(self) -> Numbers:
        """The covariance P, (N, N)."""
        return np.array(self._P)

    @property
    def is_finite(self) -> bool:
        """Whether P is finite."""
        return bool(np.isfinite(self._P).all())

    def carried(self, F: Numbers, G: Numbers) -> Self:
        """Return P after a step: F P F^T + G G^T."""
        P = F @ self._P @ F.T + G @ G.T
        return type(self)((P + P.T) / 2)

    def measured(self, H: Numbers, deviations: Numbers, innovation: Numbers) -> tuple[Self, Numbers, Numbers]:
        """Return P after measurements; see Uncertain.

        Raises:
            IntegrationError: the covariance of what is measured is not positive, by round-off.
        """
        PH = self._P @ H.T
        S = H @ PH + np.diag(deviations * deviations)
        try:
            L = np.linalg.cholesky((S + S.T) / 2)
        except np.linalg.LinAlgError:
            raise IntegrationError(
                "observer: the covariance of what is measured is not positive any more, by round-off; allowed: the"
                " square-root form, or float64"
            ) from None
        normalized = np.linalg.solve(L, innovation)
        scaled = np.linalg.solve(L, PH.T)  # (m, N)
        return type(self)(self._P - scaled.T @ scaled), scaled.T @ normalized, normalized


class SquareRoot:
    """The upper triangle U, P = U^T U: P cannot lose its sign, and counts twice as many digits."""

    def __init__(self, U: Numbers) -> None:
        """Keep an upper triangle U, (N, N)."""
        self._U = U

    @classmethod
    def of(cls, deviations: Numbers) -> Self:
        """Return the square root of the covariance of independent numbers of these standard deviations, (N,)."""
        return cls(np.diag(deviations))

    @property
    def covariance(self) -> Numbers:
        """The covariance P, (N, N)."""
        return np.asarray(self._U.T @ self._U)

    @property
    def is_finite(self) -> bool:
        """Whether P is finite: variances are, and so what is between them."""
        return bool(np.isfinite(np.einsum("ij,ij->j", self._U, self._U)).all())

    def carried(self, F: Numbers, G: Numbers) -> Self:
        """Return P after a step: F P F^T + G G^T."""
        return type(self)(_triangle(np.vstack([self._U @ F.T, G.T])))

    def measured(self, H: Numbers, deviations: Numbers, innovation: Numbers) -> tuple[Self, Numbers, Numbers]:
        """Return P after measurements; see Uncertain."""
        m, N = H.shape
        whole = np.zeros((m + N, m + N), H.dtype)
        whole[:m, :m] = np.diag(deviations)
        whole[m:, :m], whole[m:, m:] = self._U @ H.T, self._U
        R = _triangle(whole)
        sign = np.where(np.diag(R)[:m] < 0.0, -1.0, 1.0).astype(H.dtype)
        L, scaled = (sign[:, None] * R[:m, :m]).T, sign[:, None] * R[:m, m:]
        normalized = np.linalg.solve(L, innovation)
        return type(self)(R[m:, m:]), scaled.T @ normalized, normalized


def _triangle(A: Numbers) -> Numbers:
    """Return an upper triangle R with R^T R = A^T A."""
    return np.asarray(np.linalg.qr(A, mode="r"))
