"""Coefficients of integration methods: conditions of order, and the programs of a Rosenbrock method's stages."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.stages import STAGES
from eomgen.codegen.kernels.steps.methods import TSIT5, W643, Array, Rosenbrock
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.state.springs import damping_matrix, stiffness_matrix
from tests.support.builds import Build
from tests.support.programs import staged
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import random_robot, random_state, some_prescribed

pytestmark = pytest.mark.usefixtures("unoptimised")

ROUND_OFF = 1e-13


def rooted_trees(b: Array, a: Array, order: int) -> list[float]:
    """What b sums over every rooted tree of up to so many nodes, less 1 / its density (J. Butcher)."""
    c = a.sum(axis=1)
    found = [b.sum() - 1]
    if order > 1:
        found += [b @ c - 1 / 2]
    if order > 2:
        found += [b @ c**2 - 1 / 3, b @ a @ c - 1 / 6]
    if order > 3:
        found += [b @ c**3 - 1 / 4, b @ (c * (a @ c)) - 1 / 8, b @ a @ c**2 - 1 / 12, b @ a @ a @ c - 1 / 24]
    if order > 4:
        found += [b @ c**4 - 1 / 5, b @ (c**2 * (a @ c)) - 1 / 10, b @ (a @ c) ** 2 - 1 / 20]
        found += [b @ (c * (a @ c**2)) - 1 / 15, b @ a @ c**3 - 1 / 20, b @ (c * (a @ a @ c)) - 1 / 30]
        found += [b @ a @ (c * (a @ c)) - 1 / 40, b @ a @ a @ c**2 - 1 / 60, b @ a @ a @ a @ c - 1 / 120]
    return [float(x) for x in found]


def w_conditions(method: Rosenbrock, b: Array, order: int) -> list[float]:
    """What b sums over trees of up to so many nodes, less what the solution has there (E. Hairer, G. Wanner, IV.7).

    A node is the function, with any number of branches, or the matrix, with one; the latter is nowhere in the solution.
    """
    trees: list[list[tuple[Array, float]]] = [[], [(np.ones(len(b)), 1.0)]]
    for nodes in range(2, order + 1):
        smaller = [(k, tree) for k in range(1, nodes) for tree in trees[k]]
        functions = [(value, density / nodes) for value, density in bushes(method.alpha, smaller, nodes - 1)]
        trees.append([*functions, *((method.gamma @ value, 0.0) for value, _ in trees[nodes - 1])])
    return [float(b @ value) - density for kind in trees for value, density in kind]


def bushes(alpha: Array, trees: list[tuple[int, tuple[Array, float]]], nodes: int) -> Iterator[tuple[Array, float]]:
    """Products of all choices of trees, taken once or more, that have so many nodes together."""
    if nodes == 0:
        yield np.ones(len(alpha)), 1.0
    for place, (size, (value, density)) in enumerate(trees):
        if size <= nodes:
            for others, rest in bushes(alpha, trees[place:], nodes - size):
                yield (alpha @ value) * others, density * rest


def test_trees_with_a_matrix_are_as_many_as_are_known() -> None:
    method, before = W643, 0
    for order, count in enumerate((1, 2, 5, 13, 37), 1):
        found = len(w_conditions(method, method.b, order))
        assert found - before == count
        before = found


def test_the_rosenbrock_method_is_of_orders_4_and_3_with_any_matrix() -> None:
    method = W643
    assert np.abs(w_conditions(method, method.b, 4)).max() <= ROUND_OFF
    assert np.abs(w_conditions(method, method.embedded, 3)).max() <= ROUND_OFF
    assert np.abs(rooted_trees(method.b, method.alpha, 4)).max() <= ROUND_OFF
    assert np.abs(w_conditions(method, method.b, 5)).max() > 1e-4
    assert np.abs(w_conditions(method, method.embedded, 4)).max() > 1e-4


def test_the_rosenbrock_method_is_stiffly_accurate_and_damps() -> None:
    whole, one = W643.alpha + W643.gamma, np.ones(len(W643.b))
    assert (whole[-1] == W643.b).all()
    assert abs(W643.alpha[-1].sum() - 1.0) <= ROUND_OFF  # the last stage is at the end
    assert not W643.alpha[1].any()  # and the second one at the beginning
    assert (np.diagonal(W643.gamma) == W643.diagonal).all()
    for z in (*(1j * np.logspace(-3, 6, 400)), *np.logspace(-3, 6, 50) * -1.0):
        growth = 1 + z * W643.b @ np.linalg.solve(np.eye(len(one)) - z * whole, one)
        assert abs(growth) <= 1.0 + 1e-12
    assert abs(1 - W643.b @ np.linalg.solve(whole, one)) <= 1e-12  # at infinity
    assert np.abs(1 - W643.alpha @ np.linalg.solve(whole, one)).max() <= 1.5  # nor do stages swing out there


def test_the_explicit_pair_is_of_orders_5_and_4() -> None:
    assert np.abs(rooted_trees(TSIT5.b, TSIT5.a, 5)).max() <= ROUND_OFF
    embedded = TSIT5.b - TSIT5.error
    assert np.abs(rooted_trees(embedded, TSIT5.a, 4)).max() <= ROUND_OFF
    assert np.abs(rooted_trees(embedded, TSIT5.a, 5)).max() > 1e-5
    assert (TSIT5.a[-1] == TSIT5.b).all()  # the last stage is the next step's first


def test_weights_within_a_step_are_of_order_4() -> None:
    assert np.abs(TSIT5.between.sum(axis=1) - TSIT5.b).max() <= ROUND_OFF
    for share in (0.1, 0.5, 0.9):  # a method of its own, of steps that are as much longer than their part
        weights = TSIT5.between @ share ** np.arange(4)
        assert np.abs(rooted_trees(weights, TSIT5.a / share, 4)).max() <= 1e3 * ROUND_OFF


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
