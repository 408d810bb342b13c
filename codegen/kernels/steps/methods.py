"""Coefficients of the methods with error control that kernels integrate with.

W643: a W-method of six stages, of order 4 with any matrix and with an embedded method of order 3, L-stable and stiffly
accurate.  Its coefficients come of a numerical search among the solutions of the conditions in E. Hairer, G. Wanner,
Solving Ordinary Differential Equations II, IV.7: those that took the fewest steps to errors of 1e-3 to 1e-7 of motions
of elastic and worn robots.  Its second stage is where the first one is, at the beginning of a step.

Tsit5: Ch. Tsitouras, "Runge-Kutta Pairs of Order 5(4) Satisfying Only the First Column Simplifying Assumption",
Computers & Mathematics with Applications 62 (2011), pp. 770-775.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.arrays import Array


@dataclass(frozen=True)
class Rosenbrock:
    """A Rosenbrock method: alpha, gamma with its diagonal, b and those of the embedded method."""

    alpha: Array
    gamma: Array
    b: Array
    embedded: Array

    @property
    def diagonal(self) -> float:
        """The gamma that multiplies the matrix in every stage."""
        return float(self.gamma[0, 0])

    def transformed(self) -> tuple[Array, Array, Array, Array]:
        """Return a, c, m and the error's weights, by which nothing is multiplied by the matrix.

        With u = gamma k of all stages: (1 / (gamma h) - A) u_i = f(y + sum a_ij u_j) + sum c_ij / h u_j, and the step
        is sum m_i u_i (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.7).
        """
        alpha, gamma, b, embedded = (_exact(x) for x in (self.alpha, self.gamma, self.b, self.embedded))
        inverse = _inverse(gamma)
        c = np.diag(np.diagonal(inverse)) - inverse
        coefficients = (alpha @ inverse, c, b @ inverse, (b - embedded) @ inverse)
        a, back, weight, wrong = (x.astype(np.float64) for x in coefficients)
        return a, back, weight, wrong


@dataclass(frozen=True)
class RungeKutta:
    """An explicit method; ``error``: weights of its error, 0 where it has none.

    The last stage of one with error control is the first one of the next step.

    between: weights at a share x of a step, of order 4: rows of stages, columns of x, x^2, ...; sums of rows are b;
    None where no sample lies between steps.
    """

    a: Array
    b: Array
    error: Array
    between: Array | None = None


def _exact(x: Array) -> NDArray[Any]:
    """Return the numbers as fractions, whose sums are the same on every machine."""
    return np.array([Fraction(float(value)) for value in x.ravel()], dtype=object).reshape(x.shape)


def _inverse(lower: NDArray[Any]) -> NDArray[Any]:
    """Invert a lower triangle of fractions."""
    inverse = _exact(np.zeros(lower.shape))
    for j in range(len(lower)):
        inverse[j, j] = 1 / lower[j, j]
        for i in range(j + 1, len(lower)):
            inverse[i, j] = -sum(lower[i, k] * inverse[k, j] for k in range(j, i)) / lower[i, i]
    return inverse


def _triangle(rows: list[list[float]]) -> Array:
    """Return a square matrix of rows that are as long as they need to be."""
    matrix = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = row
    return matrix


_W643_G = 0.3032708221029452
_W643_ALPHA = _triangle(
    [
        [],
        [0.0],
        [0.5773525738043817, 0.029189070401508733],
        [-1.0516617993412487, 1.3579323629433484, -0.6626169008279115],
        [1.2405907991282574, 0.3449296715200169, 0.35547366885438325, -0.7841782368606712],
        [1.3427872516796397, -0.47904413738636936, 0.6316703579914312, -0.550874271861307, 0.055460799576605456],
    ]
)
_W643_GAMMA = _triangle(
    [
        [_W643_G],
        [-0.17001581705693392, _W643_G],
        [-2.166055475292428, 0.9711269696883563, _W643_G],
        [-0.6710695843531077, -0.6594477670416309, 0.945467722877543, _W643_G],
        [0.0749343811131921, -0.6908385845588948, 0.16613965910401227, 0.7788384853090684, _W643_G],
        [1.32047081491303, -1.8120445514476855, -0.13869246041196245, 0.4897134231986971, -0.1627180483550241, _W643_G],
    ]
)
_W643_B = _W643_ALPHA[-1] + _W643_GAMMA[-1]  # stiffly accurate
_W643_ERROR = np.array(
    [
        0.1614975242929427,
        -0.1868409690760965,
        0.009123932770449029,
        0.013322280951927673,
        -0.023492070397267827,
        0.026389301458044932,
    ]
)

W643 = Rosenbrock(_W643_ALPHA, _W643_GAMMA, _W643_B, embedded=_W643_B - _W643_ERROR)
RK4 = RungeKutta(
    a=_triangle([[], [0.5], [0.0, 0.5], [0.0, 0.0, 1.0]]),
    b=np.array([1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0]),
    error=np.zeros(4),
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
