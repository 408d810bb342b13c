"""Coefficients of integration methods: conditions of order, and the programs of a Rosenbrock method's stages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from itertools import accumulate
from typing import get_args

import numpy as np
import pytest
import sympy

import eomgen
from eomgen.codegen.c.tableaus import Exact, exact
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.stages import STAGES
from eomgen.kernel.stepping.methods import (
    ADAPTIVE,
    COST,
    EXPLICIT,
    METHODS,
    ROSENBROCK,
    TABLE,
    IntegrationMethod,
    Method,
    StepMethod,
    tableaus,
)
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.rollouts import FIXED
from eomgen.state.springs import damping_matrix, stiffness_matrix
from tests.support.builds import Build
from tests.support.method_rows import BS3, RODAS4
from tests.support.programs import staged
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import random_robot, random_state, some_prescribed

pytestmark = pytest.mark.usefixtures("unoptimised")

ROUND_OFF = Fraction(1, 10**13)  # of coefficients, which are doubles; sums of these are exact
PAIRS = [row for row in tableaus(EXPLICIT) if row.embedded]


def coefficients(method: IntegrationMethod) -> tuple[Exact, Exact, Exact, Exact]:
    """Exact a, gamma, weights and weights of the embedded method."""
    n = len(method.a)
    b, error = (np.array([Fraction(x) for x in row], dtype=object) for row in (method.weights, method.error or [0] * n))
    return exact(method.a, n), exact(method.gamma, n), b, b - error


def largest(residuals: Iterable[Fraction]) -> Fraction:
    return max(abs(x) for x in residuals)


def conditions(
    a: Exact, b: Exact, order: int, *, matrix: Exact | None = None, single: Exact | None = None
) -> list[Fraction]:
    """What b sums over trees of up to so many nodes, less what the solution has there (E. Hairer, G. Wanner, IV.7).

    A node is the function, with any number of branches, or the matrix, with one branch; the latter is nowhere in the
    solution, so that the method is of this order with any matrix.

    Args:
        matrix: gamma, of Rosenbrock methods with any matrix.
        single: of nodes with one branch; alpha + gamma, of Rosenbrock methods whose matrix is the Jacobian.
    """
    trees: list[list[tuple[Exact, Fraction]]] = [[], [(np.array([Fraction(1)] * len(b), dtype=object), Fraction(1))]]
    for nodes in range(2, order + 1):
        smaller = [(k, tree) for k in range(1, nodes - 1) for tree in trees[k]]
        several = [(value, density / nodes) for value, density in bushes(a, smaller, nodes - 1)]
        one = [((a if single is None else single) @ value, density / nodes) for value, density in trees[nodes - 1]]
        matrices = [] if matrix is None else [(matrix @ value, Fraction(0)) for value, _ in trees[nodes - 1]]
        trees.append([*one, *several, *matrices])
    return [b @ value - density for kind in trees for value, density in kind]


def bushes(
    alpha: Exact, trees: list[tuple[int, tuple[Exact, Fraction]]], nodes: int
) -> Iterator[tuple[Exact, Fraction]]:
    """Products of all choices of trees, taken once or more, that have so many nodes together."""
    if nodes == 0:
        yield np.array([Fraction(1)] * len(alpha), dtype=object), Fraction(1)
    for place, (size, (value, density)) in enumerate(trees):
        if size <= nodes:
            for others, rest in bushes(alpha, trees[place:], nodes - size):
                yield (alpha @ value) * others, density * rest


def test_names_are_those_of_the_rows() -> None:
    assert sorted(get_args(StepMethod)) == sorted([*FIXED, *ADAPTIVE])
    assert get_args(Method) == METHODS
    assert all(row.source and row.order >= 1 for row in TABLE)
    assert list(COST) == list(ADAPTIVE)[: len(COST)]


def test_trees_are_as_many_as_are_known() -> None:
    """Of rooted trees (J. Butcher), and of those with nodes of a matrix."""
    a, gamma, b, _ = coefficients(tableaus(ROSENBROCK)[0])
    for kind, counts in ((None, (1, 1, 2, 4, 9)), (gamma, (1, 2, 5, 13, 37))):
        assert [len(conditions(a, b, order, matrix=kind)) for order in range(1, 6)] == list(accumulate(counts))


@pytest.mark.parametrize("method", tableaus(ROSENBROCK), ids=lambda x: x.name)
def test_rosenbrock_methods_have_their_orders_with_any_matrix(method: IntegrationMethod) -> None:
    a, gamma, b, embedded = coefficients(method)
    for weights, order in ((b, method.order), (embedded, method.embedded)):
        assert largest(conditions(a, weights, order, matrix=gamma)) <= ROUND_OFF
        assert largest(conditions(a, weights, order + 1, matrix=gamma)) > 1e-4
    assert largest(conditions(a, b, method.order)) <= ROUND_OFF


def test_rodas4_has_its_order_with_the_jacobian_alone() -> None:
    """With the matrix of springs, dampers and gains it is of order 1: why it is no row of ours."""
    a, gamma, b, embedded = coefficients(RODAS4)
    for weights, order in ((b, 4), (embedded, 3)):
        assert largest(conditions(a, weights, order, single=a + gamma)) <= ROUND_OFF
        assert largest(conditions(a, weights, order + 1, single=a + gamma)) > 1e-4
    assert largest(conditions(a, b, 1, matrix=gamma)) <= ROUND_OFF
    assert largest(conditions(a, b, 2, matrix=gamma)) > 0.03


@pytest.mark.parametrize("method", [*tableaus(ROSENBROCK), RODAS4], ids=lambda x: x.name)
def test_rosenbrock_methods_are_l_stable_and_stiffly_accurate(method: IntegrationMethod) -> None:
    """|R(iy)| <= 1 for all y, all poles being at 1 / gamma, and R(inf) = 0, with R = P / Q of the exact coefficients.

    With the roundings of doubles E(y) = |Q(iy)|^2 - |P(iy)|^2 has powers below that of the order, which are no larger
    than these; without them it has no root but 0.
    """
    a, gamma, b, _ = coefficients(method)
    whole, n = a + gamma, len(b)
    assert np.abs(whole[-1] - b).max() <= ROUND_OFF
    assert abs(a[-1].sum() - 1) <= ROUND_OFF  # the last stage is at the end
    assert (np.diagonal(gamma) == gamma[0, 0]).all()
    z, y = sympy.symbols("z y", real=True)
    rational = sympy.Matrix(n, n, [sympy.Rational(x.numerator, x.denominator) for x in whole.ravel()])
    weights = sympy.Matrix(1, n, [sympy.Rational(x.numerator, x.denominator) for x in b])
    identity, one = sympy.eye(n), sympy.ones(n, 1)
    numerator = sympy.Poly((identity - z * rational + z * one * weights).det(method="berkowitz"), z)
    denominator = sympy.Poly((1 - z * rational[0, 0]) ** n, z)
    assert abs(numerator.coeff_monomial(z**n)) <= 1e-13 * abs(denominator.coeff_monomial(z**n))  # R(inf)
    powers = [
        sympy.Poly(sympy.expand(x.as_expr().subs(z, sympy.I * y) * x.as_expr().subs(z, -sympy.I * y)), y)
        for x in (denominator, numerator)
    ]
    difference = powers[0] - powers[1]
    lowest = method.order + 2 - method.order % 2
    assert all(k % 2 == 0 for (k,), _ in difference.terms())
    assert all(abs(c) <= 1e-13 for (k,), c in difference.terms() if k < lowest)
    rest = sympy.Poly({(k - lowest,): c for (k,), c in difference.terms() if k >= lowest}, y)
    assert rest.degree() > 0
    assert rest.eval(0) > 0
    assert rest.count_roots() == 0  # real ones, by Sturm's theorem


def test_the_second_stage_of_rosenbrock_is_at_the_beginning() -> None:
    method = tableaus(ROSENBROCK)[0]
    a, gamma, b, _ = (x.astype(float) for x in coefficients(method))
    assert not a[1].any()
    growth = 1 - a @ np.linalg.solve(a + gamma, np.ones(len(b)))
    assert np.abs(growth).max() <= 1.5  # nor do stages grow at infinity


@pytest.mark.parametrize("method", [*tableaus(EXPLICIT), BS3], ids=lambda x: x.name)
def test_explicit_methods_have_their_orders(method: IntegrationMethod) -> None:
    a, _, b, embedded = coefficients(method)
    for weights, order in ((b, method.order), (embedded, method.embedded))[: 1 + (method.embedded > 0)]:
        assert largest(conditions(a, weights, order)) <= ROUND_OFF
        assert largest(conditions(a, weights, order + 1)) > 1e-5
    assert not method.embedded or list(a[-1]) == list(b)  # the last stage is the next step's first


@pytest.mark.parametrize("method", [row for row in PAIRS if row.within], ids=lambda x: x.name)
def test_weights_within_a_step_are_of_order_4(method: IntegrationMethod) -> None:
    a, _, b, _ = coefficients(method)
    within = np.array([[Fraction(x) for x in row] for row in method.within], dtype=object)
    assert largest(within.sum(axis=1) - b) <= ROUND_OFF
    for share in (Fraction(1, 10), Fraction(1, 2), Fraction(9, 10)):  # a method of its own, of longer steps
        weights = within @ np.array([share**k for k in range(within.shape[1])], dtype=object)
        assert largest(conditions(a / share, weights, 4)) <= 1000 * ROUND_OFF


@pytest.mark.parametrize("name", ["worn_arm", "balanced_arm", "andrews"])
def test_a_complex_stage_is_the_real_one_where_its_numbers_are_real(name: str) -> None:
    """Laws, frictions and loops among them: with a real c, rates and shifts imaginary parts vanish."""
    model = build_model(eomgen.load_robot(name))
    s, parts = random_state(model.robot, 7), np.random.default_rng(7).uniform(-1.0, 1.0, (2, 2, model.size))
    parts[:, 1] = 0.0
    state = {"q": s.q, "v": s.v, "p": list(model.parameters.values())}
    pairs, real = staged(model, state, 0.02 + 0.0j, *parts), staged(model, state, 0.02, *parts)
    assert np.abs(pairs.real - real).max() <= 1e-11 * np.abs(real).max()
    assert np.abs(pairs.imag).max() <= 1e-13 * np.abs(real).max()


def test_a_step_computes_its_factors_once() -> None:
    """What depends on a stage is a third of a step's elimination."""
    model = build_model(eomgen.load_robot("puma560_elastic"))
    first, second = (sum(derive(model, name).count().values()) for name in STAGES)
    assert second <= 0.6 * first
    assert derive(model, STAGES[1]).count()["div"] == 0


STAGED: dict[str, Callable[[], Robot]] = {
    "springs": lambda: random_robot(1450, joints=(1, 3), types=("revolute", "prismatic", "free")),
    "motors": lambda: geared_robot(1452, (1, 3)),
    "prescribed": lambda: some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453),
}


@pytest.mark.parametrize("name", STAGED)
@pytest.mark.parametrize("c", [0.03, 0.02 - 0.03j])
def test_a_stage_solves_with_springs_and_dampers(name: str, c: complex, built: Build) -> None:
    """(M + c B + c^2 K) w = -((c B + c^2 K) r + c K s), by the whole matrix; what is prescribed has no change."""
    robot = STAGED[name]()
    kernel, rng, model = built(robot, "mass_matrix"), np.random.default_rng(5), build_model(robot)
    s = motor_state(robot, 5) if any(joint.motor for joint in robot.joints) else random_state(robot, 5)
    parts, (kp, kd) = rng.uniform(-1.0, 1.0, (2, 2, kernel.n)), rng.uniform(0.0, 1.0, (2, kernel.n))
    free = np.array([name not in kernel.prescribed for name in kernel.coordinates])
    assert free.all() != (name == "prescribed")
    acting = np.isin(np.arange(kernel.n), model.driven)
    found = staged(model, {"q": s.q, "v": s.v, "kp": kp, "kd": kd, "p": list(model.parameters.values())}, c, *parts)
    rates, shifts = (x[0] + 1j * x[1] if isinstance(c, complex) else x[0] for x in parts)
    K = stiffness_matrix(kernel) + np.diag(np.where(acting, kp, 0.0))
    B = damping_matrix(kernel) + np.diag(np.where(acting, kd, 0.0))
    slope, expected = c * B + c * c * K, 0.0 * rates
    right, grid = -(slope @ rates + c * K @ shifts), np.ix_(free, free)
    expected[free] = np.linalg.solve((kernel.mass_matrix(s.q) + slope)[grid], right[free])
    assert np.abs(found - expected).max() <= 1e-11 * np.abs(expected).max()
