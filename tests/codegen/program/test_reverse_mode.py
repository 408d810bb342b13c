"""Derivatives of programs, forwards and backwards, of both orders, against complex steps of the programs themselves."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.derived import FRAMED, RATES
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.signatures import DERIVATIVES, KERNELS, available, shapes, signatures_of
from eomgen.codegen.program.accumulation import jacobian
from eomgen.codegen.program.forward_mode import gradients, tangent
from eomgen.codegen.program.ir import Graph, Node, Program, Value, evaluate, finish
from eomgen.codegen.program.operations import CALLS, OPERATIONS
from eomgen.codegen.program.passes import on_demand, run_passes
from eomgen.codegen.program.reverse_mode import adjoint, hessian
from eomgen.errors import ArrayError
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.oracles.complex_step import COMPLEX
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_mixtures import mixture
from tests.support.builds import Build
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, random_robot, seeds
from tests.support.random_springs import with_springs

STEP = 1e-30
OF_STATES = ("inverse_dynamics", "forward_dynamics", "energy", "external_force", "generalized_force", "reactions")
SMALL = ("mass_matrix", "bias_force", "residual", "coriolis_matrix", "external_reactions", "euler_cosines")
CLOSED = ("inverse_dynamics", "forward_dynamics", "constraint_forces", "reactions", "loop_reactions", "constraint")
MOST = 4.0  # operations of a gradient by those of its program
OF_FIRST = 6.0  # operations of second derivatives of inverse dynamics by those of the first


class Inputs:
    """Numbers of all arrays that a kernel's derivatives read, and what these are at them."""

    def __init__(self, model: Model, name: str, seed: int, q: np.ndarray | None = None) -> None:
        self.model, self.name, self.rng = model, name, np.random.default_rng(seed)
        size = {array: math.prod(shape) for array, shape in shapes(model).items()}
        *self.reads, self.weights = signatures_of(model)[f"{name}_adjoint"].reads
        self.values = {array: self.rng.uniform(-1.0, 1.0, size[array]) for array in (*self.reads, self.weights)}
        if q is not None:
            self.values["q"] = q
        self.values["p"] = np.array([*model.parameters.values()], dtype=float)
        self.sizes = [size[array] for array in self.reads]

    def run(self, program: Program | str, **changed: np.ndarray) -> np.ndarray:
        """What a program writes, with some of its inputs changed, also to complex numbers."""
        found = derive(self.model, program) if isinstance(program, str) else program
        values = {array: list(x) for array, x in (self.values | changed).items()}
        is_real = all(np.isrealobj(x) for x in changed.values())
        kind = () if is_real else (lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
        written = evaluate(found, values, *kind)
        numbers = [complex(written["out", i]) for i in range(sum(key[0] == "out" for key in written))]
        return np.array(numbers).real if is_real else np.array(numbers)

    def along(self, program: Program | str, rates: Mapping[str, np.ndarray]) -> np.ndarray:
        """The derivative of what a program writes along rates of its inputs, exact to round-off."""
        moved = {array: self.values[array] + STEP * 1j * rate for array, rate in rates.items()}
        return self.run(program, **moved).imag / STEP


def close(one: np.ndarray, other: np.ndarray, tolerance: float = 1e-11) -> None:
    np.testing.assert_allclose(one, other, rtol=tolerance, atol=tolerance * max(1.0, np.abs(other).max(initial=0.0)))


def check(given: Inputs) -> None:
    """All derivatives of a kernel against those of the program that its adjoint gives the gradient of."""
    name, rng = given.name, given.rng
    rates = {array: rng.uniform(-1.0, 1.0, given.values[array].size) for array in given.reads}
    parameters = rng.uniform(-1.0, 1.0, given.values["p"].size)
    along = given.run(f"{name}_tangent", **{f"d{array}": rate for array, rate in rates.items()})
    weights, x = given.values[given.weights], np.concatenate([rates[array] for array in given.reads])
    gradient = given.run(f"{name}_adjoint")
    assert gradient @ x == pytest.approx(
        weights @ along, rel=1e-10, abs=1e-10 * np.abs(weights * along).max(initial=1.0)
    )
    second = given.run(f"{name}_hessian").reshape(x.size, x.size)
    np.testing.assert_array_equal(second, second.T)
    close(second @ x, given.along(f"{name}_adjoint", rates), 1e-9)
    if parameters.size:
        by = given.run(f"{name}_parameter_tangent", dp=parameters)
        whole = given.run(f"{name}_parameter_adjoint")
        close(whole[: x.size], gradient)
        assert whole[x.size :] @ parameters == pytest.approx(
            weights @ by, rel=1e-10, abs=1e-10 * np.abs(weights * by).max(initial=1.0)
        )
    if name in KERNELS and not given.model.constraints:  # that of the kernel's own program
        close(along, given.along(name, rates))
        if parameters.size:
            close(by, given.along(name, {"p": parameters}))


@pytest.mark.parametrize("name", CLOSED)
def test_derivatives_of_closed_mechanisms(name: str) -> None:
    """Those of the function with its loops closed, which a template puts together from several programs."""
    model = build_model(eomgen.load_robot("four_bar"))
    check(Inputs(model, name, 3, np.array([0.5, 0.2, 1.2])))


@pytest.mark.soak
def test_every_derivative_has_as_many_results_as_its_signature_says() -> None:
    for name in ("one_link", "four_bar"):
        model = build_model(eomgen.load_robot(name))
        known, size = available(model), shapes(model)
        for kernel, signature in DERIVATIVES.compiled.items():
            if kernel in known:
                written = [key for key in derive(model, kernel).outputs if key[0] == "out"]
                assert len(written) == math.prod(size[signature.writes]), kernel


@pytest.mark.parametrize(
    "name", ["puma560", pytest.param("puma560_elastic", marks=pytest.mark.soak), "worn_arm", "four_bar"]
)
def test_operations(name: str) -> None:
    """A gradient takes a few times what its program takes, whatever the number of coordinates is."""
    model = build_model(eomgen.load_robot(name))
    for kernel in ("inverse_dynamics", "forward_dynamics", "energy"):
        if not model.constraints or kernel == "energy":
            once, back = (sum(derive(model, x).count().values()) for x in (kernel, f"{kernel}_adjoint"))
            assert back <= MOST * once, (kernel, once, back)
    if not model.constraints:
        kernels = ("residual_jacobian", "inverse_dynamics_hessian")
        first, second = (sum(derive(model, kernel).count().values()) for kernel in kernels)
        assert second <= OF_FIRST * first, (first, second)


def robot_of(seed: int, most: int = 8) -> Robot:
    """In turns a plain one, one with force laws, springs between points and often servo drives, and one with motors.

    Links of every twelfth bend, with all of these.
    """
    if seed % 12 == 1:
        return mixture(seed, ("laws", "drives", "motors", "springs")).robot
    if seed % 3 == 2:
        return geared_robot(seed, joints=(2, 3))
    robot = random_robot(seed, joints=(2, 3), max_size=most, tree=True)
    if seed % 3 == 0:
        return robot
    robot = with_springs(with_laws(robot, seed), seed)
    return with_drives(robot, seed) if seed % 2 == 0 else robot


def every_operation(*more: str) -> Program:
    """A program of q, (2,), with every operation once; ``more``: also rotations, which series of time know."""
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    sine, cosine = graph.sincos(x)
    values = [x + y, x - y, x * y, x / y, -x, sine, cosine, 2.0, y * 3.0, x * x, (x * y) * (x * y), 1.0 / y]
    values += [graph.call(name, *(y, x, x * y)[: operation.arity]) for name, operation in CALLS.items()]
    if more:
        values += [sine * y + cosine * x, cosine * y - sine * x]
    program = finish(graph, "all", {("out", i): value for i, value in enumerate(values)})
    assert {instruction.op for instruction in program.instructions} == set(OPERATIONS)
    return program


@pytest.mark.parametrize(
    ("seed", "names"),
    [
        *((seed, ("energy", "external_force", "reactions")) for seed in (0, 1)),
        *(pytest.param(seed, (), marks=pytest.mark.soak) for seed in range(60)),
    ],
)
def test_derivatives_of_random_robots(seed: int, names: tuple[str, ...]) -> None:
    model = build_model(robot_of(seed, 6))
    for name in names or (*OF_STATES, *(SMALL if seed % 3 == 0 else ()), *FRAMED):
        check(Inputs(model, name, seed))


def test_every_operation_has_its_rate_and_its_transpose() -> None:
    program, kind = every_operation(), (lambda z: (cmath.sin(z), cmath.cos(z)), COMPLEX)
    weights = np.random.default_rng(1).uniform(-1.0, 1.0, len(program.outputs)).tolist()
    first, along = run_passes(adjoint(program, "w", {"q": 2}, "first")), tangent(program, {"q": "dq"}, "along")
    second = run_passes(hessian(first, {"q": 2}, "second"))
    for state in ([0.7, 1.9], [1.9, 0.7]):
        rows = evaluate(second, {"q": state, "w": weights})
        for i in range(2):
            moved = [value + STEP * 1j * (k == i) for k, value in enumerate(state)]
            exact = evaluate(program, {"q": moved}, *kind)
            rates = evaluate(along, {"q": state, "dq": [float(k == i) for k in range(2)]})
            for key, value in exact.items():
                assert rates[key] == pytest.approx(complex(value).imag / STEP, abs=1e-14), key
            found = evaluate(first, {"q": state, "w": weights})["out", i]
            assert found == pytest.approx(sum(w * rates["out", k] for k, w in enumerate(weights)), rel=1e-13)
            slope = evaluate(first, {"q": moved, "w": weights}, *kind)
            for k in range(2):
                assert rows["out", 2 * k + i] == pytest.approx(complex(slope["out", k]).imag / STEP, rel=1e-13)


TANGENTS = ("energy_tangent", "external_force_tangent", "reactions_tangent", "external_reactions_tangent")
CLOSED_TANGENTS = tuple(
    f"{name}_tangent"
    for name in ("constrained_dynamics", "constrained_drives", "settling", "constraint_jacobian", "constraint_bias")
)


def inputs(robot: Robot, seed: int) -> dict[str, np.ndarray]:
    """A state, wrenches, and rates of all of them, flat."""
    rng, state, links = np.random.default_rng(seed), motor_state(robot, seed), len(build_model(robot).links)
    values = {"q": state.q, "v": state.v, "a": state.a, "u": state.u, "wrench": rng.uniform(-5.0, 5.0, 6 * links)}
    return values | {RATES[name]: rng.uniform(-1.0, 1.0, x.size) for name, x in values.items()}


def complex_derivative(robot: Robot, kernel: str, values: dict[str, np.ndarray]) -> np.ndarray:
    """The derivative of a kernel's program along the rates, exact to round-off."""
    model = build_model(robot)
    moved = {name: list(values[name] + 1e-30j * values[rate]) for name, rate in RATES.items() if name in values}
    moved["p"] = [complex(x) for x in model.parameters.values()]
    found = evaluate(derive(model, kernel), moved, lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
    return np.array([complex(found[key]).imag * 1e30 for key in sorted(found) if key[0] == "out"])


@pytest.mark.parametrize(
    ("name", "tangents"),
    [("worn_arm", TANGENTS), ("four_bar", (*TANGENTS[:2], "tree_reactions_tangent", *CLOSED_TANGENTS))],
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


def random_values(graph: Graph, rng: np.random.Generator, inputs: list[Node], count: int) -> list[Value]:
    """Values of all operations on inputs, numbers, and values before them; their sizes stay moderate."""
    values: list[Value] = [*inputs, 2.0, -1.0]
    for _ in range(count):
        x, y = (values[int(i)] for i in rng.integers(len(values), size=2))
        small = graph.sincos(x)[0]
        kind = int(rng.integers(9))
        if kind < 4:
            found = (x + y, x - y, small * y, -(x * small))[kind]
        elif kind == 4:
            found = y / (2.0 + small)
        elif kind == 5:
            found = graph.call("sqrt", 2.0 + small)
        elif kind == 6:
            found = graph.call("max", x, y)
        elif kind == 7:
            found = graph.call("exp", small)
        else:
            found = graph.call("atan2", y, 2.0 + small)
        values.append(found)
    return values


def numbers(graph: Graph, rows: list[list[Value]], x: Array) -> Array:
    flat = {("out", i): value for i, value in enumerate(value for row in rows for value in row)}
    found = evaluate(finish(graph, "slopes", flat), {"q": list(x)})
    return np.array([float(found["out", i]) for i in range(len(flat))]).reshape(len(rows), -1)


@pytest.mark.parametrize("seed", seeds(0, 8, 200))
def test_of_random_programs(seed: int) -> None:
    """Outputs that others use, inputs that are outputs, and numbers among them."""
    rng, graph = np.random.default_rng(seed), Graph()
    inputs = [graph.input("q", i) for i in range(4)]
    values = random_values(graph, rng, inputs, 120)
    outputs = [value for value in values[-20:] if isinstance(value, Node)] + [inputs[1]]
    found = jacobian(graph, [x.index for x in outputs], [x.index for x in inputs], {})
    expected = gradients(graph, outputs, inputs)
    x = rng.uniform(-1.0, 1.0, 4)
    one, other = numbers(graph, found, x), numbers(graph, expected, x)
    np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * np.abs(other).max())


def test_what_passes_a_narrow_place_is_differentiated_by_it_alone() -> None:
    """Five outputs of one value of five inputs: products of the places before and behind it, not of all paths."""
    graph = Graph()
    inputs = [graph.input("q", i) for i in range(5)]
    narrow: Value = 0.0
    for x in inputs:
        narrow = narrow + graph.sincos(x)[0]
    outputs = [graph.call("exp", graph.call("exp", graph.call("exp", narrow * float(i)))) for i in range(2, 7)]
    before = finish(graph, "values", {("out", i): x for i, x in enumerate(outputs)}).count()["mul"]
    found = jacobian(graph, [x.index for x in outputs if isinstance(x, Node)], [x.index for x in inputs], {})
    written = {("out", i): x for i, x in enumerate(x for row in found for x in row)}
    assert finish(graph, "slopes", written).count()["mul"] - before <= 5 * 3 + 25


def test_one_reciprocal_of_a_divisor() -> None:
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    outputs = [x / y, (x + 1.0) / y, 1.0 / y]
    found = jacobian(graph, [value.index for value in outputs if isinstance(value, Node)], [x.index, y.index], {})
    written = {("out", i): value for i, value in enumerate(value for row in found for value in row)}
    assert finish(graph, "slopes", written).count()["div"] == 3  # both quotients, whose values are needed, and 1 / y
    assert numbers(graph, found, np.array([3.0, 2.0])) == pytest.approx(
        np.array([[0.5, -0.75], [0.5, -1.0], [0.0, -0.25]])
    )


def test_given_derivatives_of_unknowns() -> None:
    """Unknowns of a system, s = x^2 - 3 z with z = sin(x) + 2 s eliminated: only what is given counts."""
    graph = Graph()
    x = graph.input("q", 0)
    sine = graph.sincos(x)[0]
    assert isinstance(sine, Node)
    given = {
        "s": {"left": 1.0 / 7.0},
        "left": {x.index: 2.0 * x, sine.index: -3.0},
        "z": {sine.index: 1.0, "s": 2.0},
    }
    found = numbers(graph, jacobian(graph, ["s", "z"], [x.index], given), np.array([0.4]))
    by_x = (2.0 * 0.4 - 3.0 * math.cos(0.4)) / 7.0
    assert found.ravel() == pytest.approx([by_x, math.cos(0.4) + 2.0 * by_x], rel=1e-14)


def test_values_stand_where_outputs_need_them() -> None:
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    late, early = graph.sincos(y)[0], graph.sincos(x)[0]
    program = finish(graph, "values", {("out", 1): early * x, ("out", 0): late * y})
    found = on_demand(program)
    assert list(found.outputs) == [("out", 1), ("out", 0)]
    assert [i.op for i in found.instructions] == ["input", "sin", "mul", "input", "sin", "mul"]
    state = {"q": [0.3, 0.7]}
    assert evaluate(found, state) == evaluate(program, state)
