"""Coefficients of the methods with error control that kernels integrate with.

ROS34PW2: J. Rang, L. Angermann, "New Rosenbrock W-Methods of Order 3 for Partial Differential Algebraic Equations of
Index 1", BIT Numerical Mathematics 45 (2005), pp. 761-787: order 3 with any matrix, L-stable, an embedded method of
order 2.  Tsit5: Ch. Tsitouras, "Runge-Kutta Pairs of Order 5(4) Satisfying Only the First Column Simplifying
Assumption", Computers & Mathematics with Applications 62 (2011), pp. 770-775.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LOOK = 2000  # steps and rejections between two looks at whether they lead anywhere, twenty times what an impact takes
GAUSS = {  # rule of five points on [0, 1], exact for polynomials of degree 9
    "nodes": (0.04691007703066802, 0.23076534494715845, 0.5, 0.7692346550528415, 0.9530899229693319),
    "weights": (0.11846344252809454, 0.23931433524968324, 0.2844444444444444, 0.23931433524968324, 0.11846344252809454),
}
LEAST_PART = 1e-7  # of the duration by which they do; with less all of it would take 2e10 of them, that is days


@dataclass(frozen=True)
class Rosenbrock:
    """A method by its own coefficients: alpha, gamma with its diagonal, b and those of the embedded method."""

    alpha: Array
    gamma: Array
    b: Array
    embedded: Array

    @property
    def diagonal(self) -> float:
        """The gamma that multiplies the matrix in every stage."""
        return float(self.gamma[0, 0])

    def transformed(self) -> tuple[Array, Array, Array, Array]:
        """a, c, m and the error's weights, by which nothing is multiplied by the matrix.

        With u = gamma k of all stages: (1 / (gamma h) - A) u_i = f(y + sum a_ij u_j) + sum c_ij / h u_j, and the step
        is sum m_i u_i (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.7).
        """
        alpha, gamma, b, embedded = (_exact(x) for x in (self.alpha, self.gamma, self.b, self.embedded))
        inverse = _inverse(gamma)
        c = np.diag(np.diagonal(inverse)) - inverse
        found = (alpha @ inverse, c, b @ inverse, (b - embedded) @ inverse)
        a, back, weight, wrong = (x.astype(np.float64) for x in found)
        return a, back, weight, wrong


@dataclass(frozen=True)
class RungeKutta:
    """An explicit method whose last stage is the first one of the next step; ``error``: weights of its error.

    between: weights at a share x of a step, of order 4: rows of stages, columns of x, x^2, ...; sums of rows are b.
    """

    a: Array
    b: Array
    error: Array
    between: Array


def _exact(x: Array) -> NDArray[Any]:
    """The same numbers as fractions, whose sums are the same on every machine."""
    return np.array([Fraction(float(value)) for value in x.ravel()], dtype=object).reshape(x.shape)


def _inverse(lower: NDArray[Any]) -> NDArray[Any]:
    """The inverse of a lower triangle of fractions."""
    found = _exact(np.zeros(lower.shape))
    for j in range(len(lower)):
        found[j, j] = 1 / lower[j, j]
        for i in range(j + 1, len(lower)):
            found[i, j] = -sum(lower[i, k] * found[k, j] for k in range(j, i)) / lower[i, i]
    return found


def _triangle(rows: list[list[float]]) -> Array:
    """A square matrix of rows that are as long as they need to be."""
    found = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        found[i, : len(row)] = row
    return found


_G = 4.3586652150845900e-01

ROS34PW2 = Rosenbrock(
    alpha=_triangle(
        [
            [],
            [8.7173304301691801e-01],
            [8.4457060015369423e-01, -1.1299064236484185e-01],
            [0.0, 0.0, 1.0],
        ]
    ),
    gamma=_triangle(
        [
            [_G],
            [-8.7173304301691801e-01, _G],
            [-9.0338057013044082e-01, 5.4180672388095326e-02, _G],
            [2.4212380706095346e-01, -1.2232505839045147e00, 5.4526025533510214e-01, _G],
        ]
    ),
    b=np.array([2.4212380706095346e-01, -1.2232505839045147e00, 1.5452602553351020e00, 4.3586652150845900e-01]),
    embedded=np.array([3.7810903145819369e-01, -9.6042292212423178e-02, 5.0e-01, 2.1793326075422950e-01]),
)
_TSIT5_B = [
    0.09646076681806523,
    0.01,
    0.4798896504144996,
    1.379008574103742,
    -3.290069515436081,
    2.324710524099774,
    0.0,
]
TSIT5 = RungeKutta(
    a=_triangle(
        [
            [],
            [0.161],
            [-0.008480655492356989, 0.335480655492357],
            [2.8971530571054935, -6.359448489975075, 4.3622954328695815],
            [5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525],
            [5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401, -0.028269050394068383],
            _TSIT5_B[:6],
        ]
    ),
    b=np.array(_TSIT5_B),
    error=np.array(
        [
            -0.001780011052225771,
            -0.0008164344596567469,
            0.007880878010261995,
            -0.1447110071732629,
            0.5823571654525552,
            -0.45808210592918697,
            1.0 / 66.0,
        ]
    ),
    between=np.array(
        [
            [1.0, -2.763706197274826, 2.9132554618219126, -1.0530884977290216],
            [0.0, 0.1317, -0.2234, 0.1017],
            [0.0, 3.9302962368947516, -5.941033872131505, 2.490627285651253],
            [0.0, -12.411077166933676, 30.33818863028232, -16.548102889244902],
            [0.0, 37.50931341651104, -88.1789048947664, 47.37952196281928],
            [0.0, -27.896526289197286, 65.09189467479366, -34.87065786149661],
            [0.0, 1.5, -4.0, 2.5],
        ]
    ),
)
