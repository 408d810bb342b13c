"""Bounds of rounding errors are never less than errors at 60 digits, and near what the worst roundings reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, cast

import mpmath
import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program import running_errors
from eomgen.codegen.program.ir import Graph, Instruction, Node, Program, Value, evaluate, finish
from eomgen.codegen.program.operations import CALLS, OPERATIONS, VALUES
from eomgen.codegen.program.running_errors import CALLED, EXACT, TURNED, UNITS, Error, with_errors
from eomgen.robot.model import build_model

pytestmark = pytest.mark.quick

Numbers = dict[str, list[Any]]
NARROW = np.float32
HIGH: dict[str, Callable[..., Any]] = {
    "neg": lambda x: -x,
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "sqrt": mpmath.sqrt,
    "abs": abs,
    "max": lambda x, y: y if x < y else x,
    "step": lambda x: mpmath.mpf(x > 0),
    "choose": lambda gate, x, y: x if gate > 0 else y,
    "exp": mpmath.exp,
    "log": mpmath.log,
    "atan2": mpmath.atan2,
}
ROUNDED = {"neg": 0.0, "abs": 0.0, "max": 0.0, "step": 0.0, "choose": 0.0} | {"sin": TURNED, "cos": TURNED}
ROUNDED |= dict.fromkeys(("exp", "log", "atan2"), CALLED)


@pytest.fixture(autouse=True)
def digits() -> Iterator[None]:
    with mpmath.workdps(60):
        yield


def at_high(program: Program, inputs: Numbers, roundings: dict[int, Any] | None = None) -> list[Any]:
    """Return all values of a program; with factors of 1 + rounding by their indices."""
    values: list[Any] = []
    for index, (op, args, leaf) in enumerate(program.instructions):
        if op == "const":
            value = mpmath.mpf(float(leaf))
        elif op == "input":
            value = mpmath.mpf(float(inputs[leaf[0]][leaf[1]]))
        else:
            value = HIGH[op](*[values[arg] for arg in args])
        values.append(value * (1 + roundings[index]) if roundings and index in roundings else value)
    return values


def in_c(program: Program, inputs: Numbers, dtype: str) -> list[float]:
    """Return what C writes in the arithmetic of a dtype."""
    if dtype == "float64":
        outputs = evaluate(program, inputs)
    else:
        calls = {op: (lambda *x, op=op: NARROW(VALUES[op](*map(float, x)))) for op in CALLS}
        instructions = tuple(x._replace(leaf=NARROW(x.leaf)) if x.op == "const" else x for x in program.instructions)
        program = Program(program.name, instructions, program.outputs)
        outputs = evaluate(program, inputs, lambda x: (NARROW(math.sin(x)), NARROW(math.cos(x))), calls)
    return [float(outputs["out", i]) for i in range(len(outputs))]


def check(program: Program, inputs: Numbers, dtype: str) -> list[float]:
    """Check the bounds of a program's results; return errors by their bounds."""
    high = at_high(program, inputs)
    results = in_c(with_errors(program, "bounded", dtype), inputs, dtype)
    values, bounds = results[: len(results) // 2], results[len(results) // 2 :]
    ratios = []
    for (_, place), index in program.outputs.items():
        if isinstance(high[index], mpmath.mpc) or not mpmath.isfinite(high[index]):
            continue
        error = abs(high[index] - mpmath.mpf(values[place]))
        if math.isnan(values[place]):
            continue
        assert not error > bounds[place], (program.instructions[index], values[place], float(error), bounds[place])
        ratios.append(float(error / bounds[place]) if bounds[place] > 0.0 and math.isfinite(bounds[place]) else 0.0)
    return ratios


def random_program(rng: np.random.Generator, length: int) -> Program:
    """Write a program with all operations, whose cases are often unsure and whose differences cancel."""
    graph = Graph()
    values: list[Node] = [graph.input("q", i) for i in range(4)]

    def pick() -> Node:
        return values[int(rng.integers(max(0, len(values) - 8), len(values)))]

    def near(x: Node) -> Value:
        """Return about x, another way: x t - x (t - 1)."""
        t = pick()
        return graph.sub(graph.mul(x, t), graph.mul(x, graph.sub(t, 1.0)))

    def bounded(x: Node) -> Value:
        return graph.sincos(x)[0]

    makers: list[Callable[[], Value]] = [
        lambda: graph.add(pick(), pick()),
        lambda: graph.sub(pick(), pick()),
        lambda: graph.mul(pick(), pick()),
        lambda: graph.mul(float(rng.choice([0.1, 2.0, -0.3, 1e3])), pick()),
        lambda: graph.sincos(pick())[int(rng.integers(2))],
        lambda: near(pick()),
        lambda: graph.div(pick(), graph.add(1.5, bounded(pick()))),
        lambda: graph.div(bounded(pick()), pick()),
        lambda: graph.call("sqrt", graph.call("max", pick(), 0.0)),
        lambda: graph.call("sqrt", graph.mul(x := pick(), x)),
        lambda: graph.call("abs", graph.sub(near(x := pick()), x)),
        lambda: graph.call("max", pick(), near(pick())),
        lambda: graph.call("step", graph.sub(near(x := pick()), x)),
        lambda: graph.choose(graph.sub(near(x := pick()), x), pick(), pick()),
        lambda: graph.call("exp", bounded(pick())),
        lambda: graph.call("log", graph.add(1.001, bounded(pick()))),
        lambda: graph.call("atan2", pick(), pick()),
        lambda: graph.call("atan2", graph.sub(near(x := pick()), x), graph.neg(graph.mul(y := pick(), y))),
    ]
    while len(values) < length:
        value = makers[int(rng.integers(len(makers)))]()
        if isinstance(value, Node):
            values.append(value)
    return finish(graph, "random", {("out", i): value for i, value in enumerate(values)})


def fuzz(count: int, seed: int) -> None:
    rng, seen = np.random.default_rng(seed), set[str]()
    for _ in range(count):
        program = random_program(rng, 24)
        seen |= {x.op for x in program.instructions}
        for dtype, number in (("float64", float), ("float32", NARROW)):
            q = rng.choice([0.0, 1.0, -0.5, 3.0, *rng.normal(size=4), 1e-3 * rng.normal()], 4)
            with np.errstate(all="ignore"):
                try:
                    check(program, {"q": [number(x) for x in q]}, dtype)
                except (ZeroDivisionError, OverflowError, ValueError):
                    continue  # no numbers
    assert seen >= set(OPERATIONS) - {"const"}


def test_random_programs_with_every_operation() -> None:
    fuzz(60, 1)


@pytest.mark.soak
def test_many_random_programs() -> None:
    fuzz(6000, 2)


def test_every_operation_has_a_rule() -> None:
    assert {*running_errors.RULES, "const", "input"} == set(OPERATIONS)


def states(program: Program, rng: np.random.Generator, parameters: list[float], number: Any) -> Numbers:
    arrays: Numbers = {name: [number(x) for x in rng.uniform(-2.0, 2.0, 99)] for name in ("q", "v", "a", "u")}
    arrays["wrench"] = [number(x) for x in rng.uniform(-2.0, 2.0, 999)]
    return arrays | {"p": [number(x) for x in parameters] + [number(0.0)] * 20}


def kernels_are_within_bounds(name: str, kernels: tuple[str, ...], count: int, dtype: str) -> list[float]:
    model, rng = build_model(eomgen.load_robot(name)), np.random.default_rng(3)
    parameters = [float(x) for x in model.parameters.values()]
    number = float if dtype == "float64" else NARROW
    ratios = []
    for kernel in kernels:
        program = derive(model, kernel, dtype)
        for _ in range(count):
            ratios += check(program, states(program, rng, parameters, number), dtype)
    return ratios


def test_kernels_of_a_worn_arm() -> None:
    """Contacts, frictions, measured curves."""
    ratios = kernels_are_within_bounds("worn_arm", ("inverse_dynamics", "mass_matrix"), 2, "float64")
    assert max(ratios) > 0.02, "bounds are near errors"
    kernels_are_within_bounds("one_link", ("residual_jacobian", "energy"), 4, "float32")


@pytest.mark.soak
@pytest.mark.parametrize("name", ["ur5", "puma560_elastic", "shaken_arm", "worn_arm", "four_bar", "balanced_arm"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_kernels_of_robots(name: str, dtype: str) -> None:
    kernels = ("tree_inverse_dynamics",) if name == "four_bar" else ("inverse_dynamics",)
    kernels_are_within_bounds(name, (*kernels, "mass_matrix", "energy", "kinematics"), 10, dtype)


def args_of(program: Program, index: int) -> list[Instruction]:
    """Return the factors of a product."""
    op, args, _ = program.instructions[index]
    return [program.instructions[arg] for arg in args] if op == "mul" else []


def worst(program: Program, inputs: Numbers, place: int) -> float:
    """Return the error of a result where every step is rounded by u in the direction that adds to it."""
    unit = mpmath.mpf(UNITS["float64"])
    exact = at_high(program, inputs)
    output, small = program.outputs["out", place], mpmath.mpf(10) ** -25
    roundings = {}
    for index, instruction in enumerate(program.instructions):
        units = ROUNDED.get(instruction.op, 1.0) if instruction.args else 0.0
        if any(math.frexp(x.leaf)[0] == 0.5 for x in args_of(program, index) if x.op == "const"):
            units = 0.0  # by a power of two
        if units:
            by = at_high(program, inputs, {index: small})[output] - exact[output]
            roundings[index] = units * unit * mpmath.sign(by)
    return float(abs(at_high(program, inputs, roundings)[output] - exact[output]))


def _sum_alone(b: Any, x: Node, args: Any, errors: Any) -> Error:
    """Add what a sum's terms have, without its own rounding."""
    (one, s), (other, t) = (b.size(arg) for arg in args)
    return cast("Error", b.absolute(b.graph.add(one, other), max(s, t) + 1))


def _product_alone(b: Any, x: Node, args: Any, errors: Any) -> Error:
    """Bound a product, without its own rounding where both factors are within units."""
    found = running_errors._product(b, x, args, errors)
    return found if found.units is None else Error(max(found.units - 1.0, 0.0))


OMISSIONS: dict[str, Any] = {"add": _sum_alone, "mul": _product_alone, "sin": lambda *_: EXACT}


def test_worst_roundings_are_near_the_bounds_and_an_omission_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    model, rng = build_model(eomgen.load_robot("one_link")), np.random.default_rng(4)
    program = derive(model, "inverse_dynamics")
    inputs = states(program, rng, [float(x) for x in model.parameters.values()], float)
    reached = [worst(program, inputs, place) for place in range(model.size)]

    def bounds() -> list[float]:
        return in_c(with_errors(program, "bounded", "float64"), inputs, "float64")[model.size :]

    for error, bound in zip(reached, bounds(), strict=True):
        assert error <= bound <= 3.0 * error
    for op, omits in OMISSIONS.items():
        monkeypatch.setattr(running_errors, "RULES", {**running_errors.RULES, op: omits})
        assert any(error > bound for error, bound in zip(reached, bounds(), strict=True)), op
        monkeypatch.undo()
