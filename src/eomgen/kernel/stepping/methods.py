"""Integration methods, one row each: stability, orders, coefficients and source.

A new explicit Runge-Kutta or Rosenbrock method is a row of ``TABLE`` and a name in ``StepMethod`` and ``Method``;
``make methods`` writes the coefficients for C, ``clib/tableaus.h``.  Such a method with error control ends with a stage
at the end of its step: explicit pairs are FSAL (first same as last), Rosenbrock methods stiffly accurate, so that the
last rows are the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Rows = Sequence[Sequence[float]]

EXPLICIT, ROSENBROCK, IMPLICIT = "explicit", "Rosenbrock", "implicit"  # stability
C, SCIPY, SUNDIALS_LIBRARY = "C", "SciPy", "SUNDIALS"  # whose steps

StepMethod = Literal["rk4", "implicit", "rosenbrock", "tsit5", "radau"]
Method = Literal[
    "auto",
    "rosenbrock",
    "tsit5",
    "radau",
    "scipy:Radau",
    "scipy:BDF",
    "scipy:LSODA",
    "CVODE",
    "IDA",
    "scipy:DOP853",
    "scipy:RK45",
    "rk4",
]


@dataclass(frozen=True, eq=False)
class IntegrationMethod:
    """One method.

    Attributes:
        name: by which users choose it.
        stability: EXPLICIT, ROSENBROCK (linearly implicit, with the matrix of springs, dampers and gains), or IMPLICIT.
        order: of the steps; of methods of variable order the highest.
        embedded: order of the embedded method of error control; 0 for steps of fixed length.
        source: publication, or how the coefficients were found.
        library: C, SCIPY or SUNDIALS_LIBRARY.
        evaluations: of accelerations in a step.
        cost: of a step in evaluations, with factors and solves, for automatic stiffness switching.
        a: rows of stages; of Rosenbrock methods alpha.
        gamma: of Rosenbrock methods, with the diagonal.
        b: weights, where these are not those of the last stage.
        error: weights less those of the embedded method.
        within: weights up to a share x of a step, rows of stages, columns of x, x^2, ...; without it work integrals
            within a step are cubic.
    """

    name: str
    stability: str
    order: int
    embedded: int
    source: str
    library: str = C
    evaluations: int = 0
    cost: int = 0
    a: Rows = ()
    gamma: Rows = ()
    b: Sequence[float] = ()
    error: Sequence[float] = ()
    within: Rows = ()

    @property
    def weights(self) -> list[float]:
        """Return b, as floats are added."""
        if self.b:
            return list(self.b)
        if self.stability == EXPLICIT:
            return [*self.a[-1], 0.0]
        return [x + y for x, y in zip((*self.a[-1], 0.0), self.gamma[-1], strict=True)]


_SCIPY = "SciPy, scipy.integrate"
_DIAGONAL = 0.3032708221029452
TABLE = (
    IntegrationMethod(
        "rosenbrock",
        ROSENBROCK,
        4,
        3,
        # of 6 stages, L-stable and stiffly accurate, of orders 4 and 3 with any matrix (a W-method)
        "numerical search: 21 conditions of order 4 and 8 of the embedded order 3 (E. Hairer, G. Wanner, Solving"
        " Ordinary Differential Equations II, IV.7) leave 9 numbers free; of the L-stable solutions with the second"
        " stage at the beginning, those with the fewest steps to errors of 1e-3 to 1e-7 in motions of elastic and worn"
        " robots",
        evaluations=5,
        cost=15,
        a=(
            (),
            (0.0,),
            (0.5773525738043817, 0.029189070401508733),
            (-1.0516617993412487, 1.3579323629433484, -0.6626169008279115),
            (1.2405907991282574, 0.3449296715200169, 0.35547366885438325, -0.7841782368606712),
            (1.3427872516796397, -0.47904413738636936, 0.6316703579914312, -0.550874271861307, 0.055460799576605456),
        ),
        gamma=(
            (_DIAGONAL,),
            (-0.17001581705693392, _DIAGONAL),
            (-2.166055475292428, 0.9711269696883563, _DIAGONAL),
            (-0.6710695843531077, -0.6594477670416309, 0.945467722877543, _DIAGONAL),
            (0.0749343811131921, -0.6908385845588948, 0.16613965910401227, 0.7788384853090684, _DIAGONAL),
            (
                1.32047081491303,
                -1.8120445514476855,
                -0.13869246041196245,
                0.4897134231986971,
                -0.1627180483550241,
                _DIAGONAL,
            ),
        ),
        error=(
            0.16149752429294262,
            -0.18684096907609637,
            0.00912393277044904,
            0.013322280951927667,
            -0.023492070397267834,
            0.02638930145804491,
        ),
    ),
    IntegrationMethod(
        "tsit5",
        EXPLICIT,
        5,
        4,
        "Ch. Tsitouras, Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying assumption,"
        " Computers and Mathematics with Applications 62 (2011) 770",
        evaluations=6,
        cost=6,
        a=(
            (),
            (0.161,),
            (-0.008480655492356989, 0.335480655492357),
            (2.8971530571054935, -6.359448489975075, 4.3622954328695815),
            (5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525),
            (5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401, -0.028269050394068383),
            (
                0.09646076681806523,
                0.01,
                0.4798896504144996,
                1.379008574103742,
                -3.290069515436081,
                2.324710524099774,
            ),
        ),
        error=(
            -0.001780011052225771,
            -0.0008164344596567469,
            0.007880878010261995,
            -0.1447110071732629,
            0.5823571654525552,
            -0.45808210592918697,
            0.015151515151515152,
        ),
        within=(
            (1.0, -2.763706197274826, 2.9132554618219126, -1.0530884977290216),
            (0.0, 0.1317, -0.2234, 0.1017),
            (0.0, 3.9302962368947516, -5.941033872131505, 2.490627285651253),
            (0.0, -12.411077166933676, 30.33818863028232, -16.548102889244902),
            (0.0, 37.50931341651104, -88.1789048947664, 47.37952196281928),
            (0.0, -27.896526289197286, 65.09189467479366, -34.87065786149661),
            (0.0, 1.5, -4.0, 2.5),
        ),
    ),
    IntegrationMethod(
        "radau",
        IMPLICIT,
        9,
        5,
        # Radau IIA, whose matrix is in clib/methods.h; its error begins with the weight of the rates at the beginning
        "E. Hairer, G. Wanner, Stiff differential equations solved by Radau methods, Journal of Computational and"
        " Applied Mathematics 111 (1999) 93",
        evaluations=15,  # about
        error=(
            0.15906584442746913,
            -0.2523433122495464,
            0.16035712210296996,
            -0.11627313434096281,
            0.08100664894556402,
            -0.03181316888549383,
        ),
        within=(
            (0.0,),
            (1.5864079001863283, -5.939631780296785, 9.977775909015968, -7.763720273930764, 2.282881805816479),
            (-1.008117881498373, 10.780734269705055, -24.444768723212707, 21.98658623905105, -7.033077888895562),
            (0.7309748661597875, -8.510911966412785, 26.82627186871281, -29.484574687947706, 10.750066442463638),
            (-0.5092648848477427, 6.069809477004513, -20.759279054516067, 26.46170872282742, -11.039870359384553),
            (0.2, -2.4, 8.4, -11.2, 5.04),
        ),
    ),
    IntegrationMethod("scipy:Radau", IMPLICIT, 5, 3, _SCIPY, SCIPY),
    IntegrationMethod("scipy:BDF", IMPLICIT, 5, 5, _SCIPY, SCIPY),
    IntegrationMethod("scipy:LSODA", IMPLICIT, 12, 12, _SCIPY, SCIPY),
    IntegrationMethod("CVODE", IMPLICIT, 5, 5, "SUNDIALS, through scikit-sundae", SUNDIALS_LIBRARY),
    IntegrationMethod("IDA", IMPLICIT, 5, 5, "SUNDIALS, through scikit-sundae", SUNDIALS_LIBRARY),
    IntegrationMethod("scipy:DOP853", EXPLICIT, 8, 5, _SCIPY, SCIPY),
    IntegrationMethod("scipy:RK45", EXPLICIT, 5, 4, _SCIPY, SCIPY),
    IntegrationMethod(
        "rk4",
        EXPLICIT,
        4,
        0,
        "W. Kutta, Beitrag zur naeherungsweisen Integration totaler Differentialgleichungen, Zeitschrift fuer"
        " Mathematik und Physik 46 (1901) 435",
        evaluations=4,
        a=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
        b=(1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
    ),
    IntegrationMethod("implicit", IMPLICIT, 1, 0, "linearly implicit Euler method", evaluations=1),
)

AUTO = "auto"  # automatic stiffness switching: methods with error control in turn
RADAU = "radau"
_OURS = [row for row in TABLE if row.library == C]
ADAPTIVE = {row.name: i for i, row in enumerate(row for row in _OURS if row.embedded)}  # numbers in C
IN_C = tuple(ADAPTIVE)
SCIPY_IMPLICIT = tuple(row.name for row in TABLE if row.library == SCIPY and row.stability == IMPLICIT)
SUNDIALS = tuple(row.name for row in TABLE if row.library == SUNDIALS_LIBRARY)
METHODS = (AUTO, *(row.name for row in TABLE if row.name != "implicit"))  # of ``eomgen.integration.integrate``
EXPLICIT_METHODS = tuple(row.name for row in TABLE if row.stability == EXPLICIT)
EVALUATIONS = {row.name: row.evaluations for row in _OURS}
COST = {row.name: row.cost for row in _OURS if row.cost}  # in the order of their numbers


def tableaus(stability: str, table: Sequence[IntegrationMethod] = TABLE) -> list[IntegrationMethod]:
    """Return the explicit or Rosenbrock methods whose coefficients C reads; of the former rk4 is the first one."""
    rows = [row for row in table if row.library == C and row.stability == stability and row.a]
    return sorted(rows, key=lambda row: row.embedded > 0)


# Derivatives of steps: the kernel's kind, and the number of the method in it.
STEP_CODES = {
    **{row.name: (EXPLICIT, i) for i, row in enumerate(tableaus(EXPLICIT))},
    "implicit": (IMPLICIT, 0),
    **{row.name: ("rosenbrock", i) for i, row in enumerate(tableaus(ROSENBROCK))},
}
