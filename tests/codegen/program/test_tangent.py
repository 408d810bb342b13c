"""Derivatives of programs along a direction, against complex steps of the programs themselves."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.derived import RATES
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.codegen.program.forward_mode import tangent
from eomgen.codegen.program.ir import Graph, evaluate, finish
from eomgen.codegen.program.operations import CALLS, OPERATIONS
from eomgen.errors import ArrayError
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.complex_step import COMPLEX
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_mixtures import mixture
from tests.support.builds import Build
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import random_robot, seeds
from tests.support.random_springs import with_springs

TANGENTS = ("energy_tangent", "external_force_tangent", "reactions_tangent", "external_reactions_tangent")
CLOSED = tuple(
    f"{name}_tangent"
    for name in ("constrained_dynamics", "constrained_drives", "settling", "constraint_jacobian", "constraint_bias")
)


def inputs(robot: Robot, seed: int) -> dict[str, np.ndarray]:
    """A state, wrenches, and rates of all of them, flat."""
    rng, state, links = np.random.default_rng(seed), motor_state(robot, seed), len(build_model(robot).links)
    values = {"q": state.q, "v": state.v, "a": state.a, "u": state.u, "wrench": rng.uniform(-5.0, 5.0, 6 * links)}
    return values | {rate: rng.uniform(-1.0, 1.0, values[name].size) for name, rate in RATES.items()}


def complex_derivative(robot: Robot, kernel: str, values: dict[str, np.ndarray]) -> np.ndarray:
    """The derivative of a kernel's program along the rates, exact to round-off."""
    model = build_model(robot)
    moved = {name: list(values[name] + 1e-30j * values[rate]) for name, rate in RATES.items()}
    moved["p"] = [complex(x) for x in model.parameters.values()]
    found = evaluate(derive(model, kernel), moved, lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
    return np.array([complex(found[key]).imag * 1e30 for key in sorted(found) if key[0] == "out"])


def close(one: np.ndarray, other: np.ndarray) -> None:
    np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * max(1.0, np.abs(other).max()))


def robot_of(seed: int) -> Robot:
    """In turns a plain one, one with force laws, springs between points and often servo drives, and one with motors.

    Links of every twelfth bend, with all of these.
    """
    if seed % 12 == 1:
        return mixture(seed, ("laws", "drives", "motors", "springs")).robot
    if seed % 3 == 2:
        return geared_robot(seed, joints=(2, 3))
    robot = random_robot(seed, joints=(2, 3), max_size=8, tree=True)
    if seed % 3 == 0:
        return robot
    robot = with_springs(with_laws(robot, seed), seed)
    return with_drives(robot, seed) if seed % 2 == 0 else robot


@pytest.mark.parametrize("seed", seeds(0, 1, 60))
def test_tangents_are_the_derivatives_of_their_programs(seed: int) -> None:
    robot = robot_of(seed)
    model, values = build_model(robot), inputs(robot, seed)
    for name in TANGENTS:
        program = derive(model, name)
        found = evaluate(program, {**values, "p": list(model.parameters.values())})
        close(
            np.array([found[key] for key in sorted(found)]),
            complex_derivative(robot, KERNELS[name].derivative_of, values),
        )


@pytest.mark.parametrize(
    ("name", "tangents"), [("worn_arm", TANGENTS), ("four_bar", (*TANGENTS[:2], "tree_reactions_tangent", *CLOSED))]
)
def test_tangents_in_c(name: str, tangents: tuple[str, ...], built: Build) -> None:
    robot = eomgen.load_robot(name)
    kernel, values = built(robot, *tangents), inputs(robot, 5)
    for name in tangents:
        of = KERNELS[name].derivative_of
        arrays = [values[label].reshape(kernel.raw.shapes[label]) for label in KERNELS[name].reads]
        half = len(arrays) // 2
        found = kernel.jvp(of, arrays[:half], arrays[half:])
        close(found.ravel(), complex_derivative(robot, of, values))
        twice = [np.stack([x, x]) for x in arrays]
        both = kernel.jvp(of, twice[:half], twice[half:])
        np.testing.assert_array_equal(both[1], found)


def test_every_operation_has_its_rate() -> None:
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    sine, cosine = graph.sincos(x)
    values = [x + y, x - y, x * y, x / y, -x, sine, cosine, 2.0, y * 3.0]
    values += [graph.call(name, *(y, x, x * y)[: operation.arity]) for name, operation in CALLS.items()]
    program = finish(graph, "all", {("out", i): value for i, value in enumerate(values)})
    assert {instruction.op for instruction in program.instructions} == set(OPERATIONS)
    made = tangent(program, {"q": "dq"}, "all_tangent")
    for x0, y0 in ((0.7, 1.9), (1.9, 0.7)):
        state = [complex(x0, 0.3e-30), complex(y0, -0.8e-30)]
        exact = evaluate(program, {"q": state}, lambda z: (cmath.sin(z), cmath.cos(z)), COMPLEX)
        found = evaluate(made, {"q": [x0, y0], "dq": [0.3, -0.8]})
        for key, value in exact.items():
            assert found[key] == pytest.approx(complex(value).imag * 1e30, abs=1e-15), key


def test_tangents_are_there_on_request_alone(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "energy", "energy_tangent")
    with pytest.raises(eomgen.UnknownNameError, match="without derivatives of 'reactions'"):
        kernel.jvp("reactions", [], [])
    with pytest.raises(eomgen.InputError, match=r"^energy: got 1 arguments; allowed: \(q, v\)"):
        kernel.jvp("energy", [np.zeros(2)], [np.zeros(2)])
    assert not set(TANGENTS) & set(built(eomgen.load_robot("one_link"), "all").operations)


@pytest.mark.parametrize("component", [0, 5])
def test_rates_of_wrenches_that_are_not_finite_are_named(component: int, built: Build) -> None:
    """Also where a wrench has more components than the robot has coordinates."""
    kernel = built(eomgen.load_robot("one_link"), "external_force", "external_force_tangent")
    still, wrench, rates = np.zeros(kernel.n), np.zeros((1, 6)), np.zeros((1, 6))
    rates[0, component] = np.nan
    named = ("force.x", "moment.z")[component // 5]
    with pytest.raises(ArrayError, match=rf"^dwrench: {named} of link link1 is nan; numbers must be finite"):
        kernel.jvp("external_force", [still, wrench], [still, rates])
