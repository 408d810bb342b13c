"""Finite elements and exact frequencies of one plane of a Timoshenko beam, from closed forms of textbooks.

Masses and stiffness of an element as J. S. Przemieniecki prints them ("Theory of Matrix Structural Analysis", 1968,
chapters 5 and 11); frequencies of the continuous beam from its field matrix (E. C. Pestel and F. A. Leckie, "Matrix
Methods in Elastomechanics", 1963).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, expm
from scipy.optimize import brentq

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plane:
    """A beam clamped at its root: EI (N m^2), k G A (N), rho A (kg/m), rho I (kg m), length (m)."""

    bend: float
    shear: float
    along: float
    second: float
    length: float

    def element(self, count: int) -> tuple[Array, Array]:
        """Masses and stiffness of one of ``count`` elements, over v and dv/dx of both ends."""
        span = self.length / count
        p = 12 * self.bend / (self.shear * span**2)
        t = np.diag([1, span, 1, span])
        K = np.array([[12, 6, -12, 6], [6, 4 + p, -6, 2 - p], [-12, -6, 12, -6], [6, 2 - p, -6, 4 + p]])
        K = self.bend / (span**3 * (1 + p)) * t @ K @ t
        a, b = 13 / 35 + 7 * p / 10 + p**2 / 3, 11 / 210 + 11 * p / 120 + p**2 / 24
        c, d = 9 / 70 + 3 * p / 10 + p**2 / 6, 13 / 420 + 3 * p / 40 + p**2 / 24
        e, f = 1 / 105 + p / 60 + p**2 / 120, 1 / 140 + p / 60 + p**2 / 120
        moves = np.array([[a, b, c, -d], [b, e, d, -f], [c, d, a, -b], [-d, -f, -b, e]])
        g, h, i = 1 / 10 - p / 2, 2 / 15 + p / 6 + p**2 / 3, -1 / 30 - p / 6 + p**2 / 6
        turns = np.array([[6 / 5, g, -6 / 5, g], [g, h, -g, i], [-6 / 5, -g, 6 / 5, -g], [g, i, -g, h]])
        M = t @ (self.along * span * moves + self.second / span * turns) @ t / (1 + p) ** 2
        return M, K

    def matrices(self, count: int, tip: float = 0.0) -> tuple[Array, Array]:
        """Masses and stiffness of the clamped beam with a point mass at its tip, (2 count, 2 count)."""
        M, K = np.zeros((2, 2 * count + 2, 2 * count + 2))
        element = self.element(count)
        for k in range(count):
            at = slice(2 * k, 2 * k + 4)
            M[at, at] += element[0]
            K[at, at] += element[1]
        M[-2, -2] += tip
        return M[2:, 2:], K[2:, 2:]

    def frequencies(self, count: int, how_many: int, tip: float = 0.0) -> Array:
        """The lowest frequencies by elements, rad/s."""
        M, K = self.matrices(count, tip)
        periods = eigh(M, K, eigvals_only=True)[::-1]  # squares by 4 pi^2: the longest have all their digits
        return np.array(1.0 / np.sqrt(periods[:how_many]))

    def exact_frequency(self, near: float, tip: float = 0.0, about: float = 0.0) -> float:
        """The frequency of the continuous beam within 2 % of a number, rad/s.

        With a body at its tip: mass, and moment of inertia about the axis of bending.
        """

        def at_tip(w: float) -> float:
            # of v, rotation, moment, shear force
            field = np.zeros((4, 4))
            field[0, 1], field[0, 3] = 1.0, 1.0 / self.shear
            field[1, 2] = 1.0 / self.bend
            field[2, 1], field[2, 3] = -self.second * w * w, -1.0
            field[3, 0] = -self.along * w * w
            end = expm(field * self.length)[:, 2:]
            return float(np.linalg.det([end[2] - about * w * w * end[1], end[3] - tip * w * w * end[0]]))

        return float(brentq(at_tip, 0.98 * near, 1.02 * near, xtol=1e-13 * near, rtol=1e-14))
