"""Gradients and second derivatives of programs, against complex steps of the programs themselves."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.derived import FRAMED
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.signatures import DERIVATIVES, KERNELS, available, shapes
from eomgen.codegen.program.ir import Graph, Program, evaluate, finish
from eomgen.codegen.program.operations import CALLS, OPERATIONS
from eomgen.codegen.program.passes import run_passes
from eomgen.codegen.program.reverse_mode import adjoint
from eomgen.codegen.program.second_order import hessian
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.oracles.complex_step import COMPLEX
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_mixtures import mixture
from tests.support.random_motors import geared_robot
from tests.support.random_robots import random_robot, seeds
from tests.support.random_springs import with_springs

STEP = 1e-30
OF_STATES = ("inverse_dynamics", "forward_dynamics", "energy", "external_force", "generalized_force", "reactions")
SMALL = ("mass_matrix", "bias_force", "residual", "coriolis_matrix", "external_reactions", "euler_cosines")
CLOSED = ("inverse_dynamics", "forward_dynamics", "constraint_forces", "reactions", "loop_reactions", "constraint")
MOST = 4.0  # operations of a gradient by those of its program
OF_FIRST = 6.0  # operations of second derivatives of inverse dynamics by those of the first


def robot_of(seed: int) -> Robot:
    """In turns a plain one, one with force laws, springs between points and often servo drives, and one with motors.

    Links of every twelfth bend, with all of these.
    """
    if seed % 12 == 1:
        return mixture(seed, ("laws", "drives", "motors", "springs")).robot
    if seed % 3 == 2:
        return geared_robot(seed, joints=(2, 3))
    robot = random_robot(seed, joints=(2, 3), max_size=6, tree=True)
    if seed % 3 == 0:
        return robot
    robot = with_springs(with_laws(robot, seed), seed)
    return with_drives(robot, seed) if seed % 2 == 0 else robot


class Inputs:
    """Numbers of all arrays that a kernel's derivatives read, and what these are at them."""

    def __init__(self, model: Model, name: str, seed: int, q: np.ndarray | None = None) -> None:
        self.model, self.name, self.rng = model, name, np.random.default_rng(seed)
        size = {array: math.prod(shape) for array, shape in shapes(model).items()}
        *self.reads, self.weights = KERNELS[f"{name}_adjoint"].reads
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


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 60))
def test_derivatives_of_random_robots(seed: int) -> None:
    model = build_model(robot_of(seed))
    for name in (*OF_STATES, *(SMALL if seed % 3 == 0 else ()), *FRAMED):
        check(Inputs(model, name, seed))


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
        for kernel, signature in DERIVATIVES.items():
            if kernel in known:
                written = [key for key in derive(model, kernel).outputs if key[0] == "out"]
                parts = (
                    3 if kernel.endswith(("_extended", "_around")) else 1
                )  # a table gives high and low parts, and bounds
                assert parts * len(written) == math.prod(size[signature.writes]), kernel


def test_every_operation_has_its_transpose() -> None:
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    sine, cosine = graph.sincos(x)
    values = [x + y, x - y, x * y, x / y, -x, sine, cosine, 2.0, y * 3.0, x * x]
    values += [graph.call(name, *(y, x, x * y)[: operation.arity]) for name, operation in CALLS.items()]
    program = finish(graph, "all", {("out", i): value for i, value in enumerate(values)})
    assert {instruction.op for instruction in program.instructions} == set(OPERATIONS)
    weights = np.random.default_rng(1).uniform(-1.0, 1.0, len(values)).tolist()
    first = run_passes(adjoint(program, "w", {"q": 2}, "first"))
    second = run_passes(hessian(first, {"q": 2}, "second"))
    for state in ([0.7, 1.9], [1.9, 0.7]):
        for i in range(2):
            moved = [value + STEP * 1j * (k == i) for k, value in enumerate(state)]
            kind = (lambda z: (cmath.sin(z), cmath.cos(z)), COMPLEX)
            exact = evaluate(program, {"q": moved}, *kind)
            found = evaluate(first, {"q": state, "w": weights})["out", i]
            wanted = sum(w * complex(exact["out", k]).imag / STEP for k, w in enumerate(weights))
            assert found == pytest.approx(wanted, rel=1e-14)
            slope = evaluate(first, {"q": moved, "w": weights}, *kind)
            rows = evaluate(second, {"q": state, "w": weights})
            for k in range(2):
                assert rows["out", 2 * k + i] == pytest.approx(complex(slope["out", k]).imag / STEP, rel=1e-13)


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
