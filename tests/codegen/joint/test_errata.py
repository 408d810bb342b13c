"""The slips of the paper: each test shows that what is printed is wrong, and that the corrected formula is right.

``docs/errata.md`` lists them with the names of these tests.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray
from sympy.physics.mechanics import dynamicsymbols

from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.joint.lemmas import joint_transform, step
from eomgen.codegen.joint.zeros import zero_map
from eomgen.robot.geometry import rotation_from_rpy
from eomgen.robot.model import build_model
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR, Coordinate, Joint, Link, Placement, Robot
from tests.oracles.lagrange import LagrangeOracle
from tests.oracles.paper_example import equal, gravity, length, m, one_link, stiffness

pytestmark = pytest.mark.quick

Array = NDArray[np.float64]
ERRATA = Path(__file__).parents[3] / "docs" / "errata.md"
t = dynamicsymbols._t


def joint_in_time(active: tuple[str, ...], suffix: str = "") -> tuple[Any, dict[str, Any]]:
    """A_(i-1)i of eq. (3) with coordinates that are functions of time, and these functions."""
    functions = {name: dynamicsymbols(name + suffix) for name in active}
    return joint_transform(active).xreplace({step(name).symbol: s for name, s in functions.items()}), functions


def chain(joints: int, active: tuple[str, ...] = COORDINATES) -> Robot:
    """A chain of equal joints and links, placements and inertias without symmetry."""
    placement = Placement.from_rpy((0.3, -0.2, 0.5), (0.4, 0.7, -0.5))
    names = ["base", *(f"link{i + 1}" for i in range(joints))]
    links = tuple(Link(name, 2.0, (0.1, 0.2, 0.15), (0.05, 0.06, 0.07, 0.01, 0.005, -0.008)) for name in names[1:])
    made = tuple(
        Joint(f"joint{i + 1}", names[i], names[i + 1], "free", placement, coordinates={c: Coordinate() for c in active})
        for i in range(joints)
    )
    return Robot("chain", (0.0, 0.0, -9.81), links, made)


# -- eq. (5) --------------------------------------------------------------------------------------------------------


@pytest.mark.soak
def test_eq_5_needs_the_derivative_by_the_velocity() -> None:
    """The trace equals d/dt(dE/ds_dot) - dE/ds; with the printed d/dt(dE/ds) it does not."""
    A, functions = joint_in_time(("x", "gamma"))
    moment = m * length / 2
    H = sp.Matrix([[m * length**2 / 3, 0, 0, moment], [0] * 4, [0] * 4, [moment, 0, 0, m]])
    E = (A.diff(t) * H * A.diff(t).T).trace() / 2
    for s in functions.values():
        right = (A.diff(s) * H * A.diff(t, 2).T).trace()
        assert equal(E.diff(s.diff(t)).diff(t) - E.diff(s), right)
        assert not equal(E.diff(s).diff(t) - E.diff(s), right)


# -- eqs. (6) and (10) ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def second_rate() -> dict[str, Array]:
    """d2A/dt2 of one joint with all six coordinates in numbers, and the sums of eqs. (6) and (10)."""
    A, s = joint_in_time(COORDINATES)
    rng = np.random.default_rng(0)
    numbers: dict[Any, float] = {}
    for f in s.values():
        numbers |= {f.diff(t, k): sp.Float(value) for k, value in enumerate(rng.uniform(0.2, 0.9, 3))}

    def term(first: str, second: str, rate: str, other: str) -> Any:
        return A.diff(s[first]).diff(s[second]) * s[rate].diff(t) * s[other].diff(t)

    def rows(kinds: tuple[str, ...], others: tuple[str, ...]) -> Any:
        return sum((term(p, q, p, q) for p in kinds for q in others), sp.zeros(4, 4))

    linear = sum((A.diff(f) * f.diff(t, 2) for f in s.values()), sp.zeros(4, 4))
    turning = rows(("beta", "gamma"), ANGULAR)
    printed_1 = sum((term("alpha", w, "x", w) for w in ANGULAR), turning)  # first row: x_dot for alpha_dot
    printed_2 = rows(("beta", "gamma"), LINEAR)
    printed_2 += term("x", "x", "alpha", "x") + term("x", "y", "alpha", "y") + term("alpha", "z", "alpha", "z")
    sums = {
        "exact": A.diff(t, 2),
        "printed": linear + printed_1 + printed_2,
        "indices": linear + rows(ANGULAR, ANGULAR) + rows(ANGULAR, LINEAR),
        "corrected": linear + rows(ANGULAR, ANGULAR) + 2 * rows(ANGULAR, LINEAR),
    }

    def evaluate(expression: Any) -> Array:
        values: Array = np.array(expression.doit().xreplace(numbers).evalf(), dtype=np.float64)
        return values

    return {name: evaluate(expression) for name, expression in sums.items()}


@pytest.mark.soak
def test_eq_6_has_wrong_indices(second_rate: dict[str, Array]) -> None:
    assert not np.allclose(second_rate["printed"], second_rate["exact"], atol=1e-3)
    assert not np.allclose(second_rate["printed"], second_rate["indices"], atol=1e-3)


@pytest.mark.soak
def test_eq_6_counts_mixed_terms_once(second_rate: dict[str, Array]) -> None:
    """With the indices put right, an angle and a translation still need the 2 that eq. (10) has.

    In one joint the mixed derivatives vanish (sharper lemma), so two joints show it.
    """
    assert np.allclose(second_rate["corrected"], second_rate["exact"], atol=1e-12)
    A1, s1 = joint_in_time(("gamma",), "_1")
    A2, s2 = joint_in_time(("x",), "_2")
    A, gamma, x = A1 * A2, s1["gamma"], s2["x"]
    squares = A.diff(gamma, 2) * gamma.diff(t) ** 2 + A.diff(gamma) * gamma.diff(t, 2) + A.diff(x) * x.diff(t, 2)
    mixed = A.diff(gamma).diff(x) * gamma.diff(t) * x.diff(t)
    assert sp.simplify(A.diff(t, 2) - squares - mixed) != sp.zeros(4, 4)
    assert sp.simplify(A.diff(t, 2) - squares - 2 * mixed) == sp.zeros(4, 4)


# -- eqs. (8) and (9) -----------------------------------------------------------------------------------------------


def two_joints() -> tuple[list[Array], list[Array], Callable[[Array], Array]]:
    """R_(i-1)i and X_i of two joints (identity placements), and X_02 as a function of X_2."""
    angles = ((0.3, -0.4, 0.5), (-0.2, 0.6, 0.7))
    X = [np.array([0.1, 0.2, 0.3]), np.array([-0.3, 0.4, 0.2])]
    R = [
        np.array(rotation_from_rpy((a, 0, 0))) @ rotation_from_rpy((0, b, 0)) @ rotation_from_rpy((0, 0, c))
        for a, b, c in angles
    ]

    def origin(X2: Array) -> Array:
        A = np.eye(4)
        for rotation, shift in zip(R, (X[0], X2), strict=True):
            block = np.eye(4)
            block[:3, :3], block[:3, 3] = rotation, shift
            A = A @ block
        return np.asarray(A[:3, 3])

    return R, X, origin


def test_eq_8_takes_the_rotation_before_the_joint() -> None:
    R, X, origin = two_joints()
    assert not np.allclose(R[0] @ X[0] + R[1] @ X[1], origin(X[1]), atol=1e-2)  # printed: R_(i-1)i X_i
    assert np.allclose(X[0] + R[0] @ X[1], origin(X[1]), atol=1e-15)  # R_0(i-1) X_i


def test_eq_9_has_columns_of_a_rotation() -> None:
    """The derivative by x_2, y_2, z_2 is a column of R_01 each, not R_12 times a vector of ones."""
    R, X, origin = two_joints()
    columns = np.array([(origin(X[1] + e) - origin(X[1] - e)) / 2 for e in np.eye(3)]).T
    assert np.allclose(columns, R[0], atol=1e-15)
    for column in columns.T:
        assert not np.allclose(column, R[1] @ np.ones(3), atol=1e-2)


# -- eq. (14) -------------------------------------------------------------------------------------------------------


def moment_forces(active: tuple[str, ...]) -> tuple[Array, Array, Array]:
    """Q_F of a pure moment on a link, for one joint: LagrangesMethod, closed form, and as printed in eq. (14)."""
    robot = chain(1, active)
    q = np.linspace(0.3, 0.8, len(active))
    zero, moment = np.zeros(len(active)), np.array([1.0, -2.0, 3.0])
    oracle, form = LagrangeOracle(robot, wrenches=True), closed_form(build_model(robot), external_forces=True)
    by_lagrange = oracle.residual(q, zero, zero, zero) - oracle.residual(
        q, zero, zero, zero, {"link1": (0.0, 0.0, 0.0, *moment)}
    )
    force = form.function("generalized_force")
    corrected = force(q, zero, zero, zero, [[0.0, 0.0, 0.0, *moment]]) - force(q, zero, zero, zero)
    A = joint_transform(active).subs({step(name).symbol: value for name, value in zip(active, q, strict=True)})
    R_01 = np.array(robot.joints[0].placement.rotation) @ np.array(A[:3, :3], dtype=float)
    printed = np.full(len(active), moment @ R_01 @ (0.0, 0.0, 1.0))  # theta_i = 1: the hinge is a rotary one
    return by_lagrange, corrected, printed


@pytest.fixture(scope="module")
def moments() -> tuple[Array, Array, Array]:
    return moment_forces(("x", *ANGULAR))


@pytest.mark.soak
def test_eq_14_moment_term_is_right_for_gamma_only(moments: tuple[Array, Array, Array]) -> None:
    by_lagrange, corrected, printed = moments
    assert np.allclose(corrected, by_lagrange, atol=1e-12)
    alpha, beta, gamma = 1, 2, 3
    assert printed[gamma] == pytest.approx(by_lagrange[gamma], abs=1e-12)
    for index in (alpha, beta):
        assert abs(printed[index] - by_lagrange[index]) > 0.1


@pytest.mark.soak
def test_eq_14_moment_does_no_work_on_a_translation(moments: tuple[Array, Array, Array]) -> None:
    """As printed, theta_i = 1 belongs to the hinge, so a deviation x of a rotary hinge would feel the moment."""
    by_lagrange, corrected, printed = moments
    assert by_lagrange[0] == pytest.approx(0.0, abs=1e-12)
    assert corrected[0] == pytest.approx(0.0, abs=1e-12)
    assert abs(printed[0]) > 0.1


# -- eq. (19) -------------------------------------------------------------------------------------------------------


def test_eq_19_matches_no_gravity_vector() -> None:
    """A torque -1/2 l m g sin(gamma) means gravity along +X0, and then Q_x has m g, which eq. (19) lacks."""
    form = one_link()
    (x, gamma), g = form.q, sp.Symbol("g", positive=True)
    printed = (-stiffness * x, -m * g * length / 2 * sp.sin(gamma))

    def forces(*vector: Any) -> tuple[Any, ...]:
        swap = dict(zip(gravity, vector, strict=True))
        return tuple(Q.xreplace(swap) for Q in form.generalized_force)

    along_x = forces(g, 0, 0)
    assert equal(along_x[1], printed[1])
    assert equal(along_x[0], printed[0] + m * g)
    against_y = forces(0, -g, 0)
    assert equal(against_y[0], printed[0])
    assert equal(against_y[1], -m * g * length / 2 * sp.cos(gamma))
    general = [sp.expand(Q - P) for Q, P in zip(form.generalized_force, printed, strict=True)]
    conditions = [general[0], general[1].coeff(sp.sin(gamma)), general[1].coeff(sp.cos(gamma))]
    assert sp.solve([sp.nsimplify(c) for c in conditions], gravity) == []


# -- sections 4 and 7 -----------------------------------------------------------------------------------------------


def test_section_4_elements_of_c_vanish_in_the_general_case() -> None:
    """ "In the general case, their elements are not equal to zero": 13,374 of 23,976 are, whatever the geometry."""
    C = zero_map(build_model(chain(6))).christoffel
    assert (C.total, C.total - C.survivors) == (23_976, 13_374)


def test_section_7_traces_grow_with_the_cube() -> None:
    """Twice the joints give about eight times the trace scalars of eq. (10), zeros counted or not."""
    counts = {n: zero_map(build_model(chain(n))).christoffel for n in (6, 12)}
    assert 7.5 < counts[12].total / counts[6].total < 8.0
    assert 7.5 < counts[12].survivors / counts[6].survivors < 8.5


# -- the document ---------------------------------------------------------------------------------------------------


def test_document_names_tests_that_exist() -> None:
    """Every test that docs/errata.md names is defined, and every test of this file but this one is named there."""
    named = set(re.findall(r"`(test_\w+)`", ERRATA.read_text(encoding="utf-8")))
    files = list(Path(__file__).parents[2].rglob("test_*.py"))
    defined = {name for path in files for name in re.findall(r"^def (test_\w+)", path.read_text("utf-8"), re.M)}
    assert named <= defined | {path.stem for path in files}
    here = {name for name in globals() if name.startswith("test_")} - {"test_document_names_tests_that_exist"}
    assert here <= named
