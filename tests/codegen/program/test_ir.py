"""The straight-line program: a golden one, folding, verification, passes, pairs of numbers, and its text in C."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eomgen
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.c.statements import write_function
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.program.complex_pairs import on_pairs
from eomgen.codegen.program.ir import Graph, Instruction, Node, Program, Value, evaluate, finish, users, verify
from eomgen.codegen.program.passes import PASSES, factor_sums, hoist_parameters, run_passes
from eomgen.robot.model import build_model
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

DOUBLE = SCALARS["float64"]


def pendulum() -> Program:
    """M a + m g l sin(q) of a pendulum with m l^2 = 0.75 and m l = 1.5, gravity a parameter: 10 instructions."""
    graph = Graph()
    q, a, g = graph.input("q", 0), graph.input("a", 0), graph.input("p", 0)
    sin, cos = graph.sincos(q)
    graph.note("weight")
    graph_out = {("out", 0): 0.75 * a + 1.5 * (g * sin), ("out", 1): cos * 0.0}
    return finish(graph, "pendulum", graph_out)


def test_golden_program() -> None:
    program = pendulum()
    assert program.instructions == (
        Instruction("input", (), ("q", 0)),
        Instruction("input", (), ("a", 0)),
        Instruction("input", (), ("p", 0)),
        Instruction("sin", (0,)),
        Instruction("const", (), 0.75),
        Instruction("mul", (4, 1)),
        Instruction("mul", (2, 3)),
        Instruction("const", (), 1.5),
        Instruction("mul", (7, 6)),
        Instruction("add", (5, 8)),
        Instruction("const", (), 0.0),  # the cosine is gone: its product with zero folds
    )
    assert dict(program.outputs) == {("out", 0): 9, ("out", 1): 10}
    assert program.count() == {"mul": 3, "add": 1, "div": 0, "sincos": 1}
    assert program.inputs() == {"q", "a", "p"}
    assert program.notes == {4: "weight"}
    found = evaluate(program, {"q": [0.5], "a": [2.0], "p": [-9.81]})
    assert found == {("out", 0): 0.75 * 2.0 + 1.5 * (-9.81 * math.sin(0.5)), ("out", 1): 0.0}
    (lines,) = write_function(program, DOUBLE, turning=False).chunks
    assert lines == (
        "out[1] = 0.0;",
        "const double t3 = sin(q[0]);",
        "/* weight */",
        "out[0] = 0.75*a[0] + 1.5*(p[0]*t3);",
    )


def test_golden_program_after_passes() -> None:
    program = run_passes(pendulum())
    assert program == pendulum()
    setup, (hoisted,) = hoist_parameters([program], 1)
    assert dict(setup.outputs) == {("h", 0): 0}
    assert hoisted.instructions[2] == Instruction("input", (), ("h", 0))


Fold = Callable[[Graph, Node, Node], Any]
FOLDS: dict[str, tuple[Fold, Fold]] = {
    "x + 0": (lambda g, x, y: x + 0.0, lambda g, x, y: x),
    "0 + x": (lambda g, x, y: 0.0 + x, lambda g, x, y: x),
    "x - 0": (lambda g, x, y: x - 0.0, lambda g, x, y: x),
    "0 - x": (lambda g, x, y: 0.0 - x, lambda g, x, y: -x),
    "x - x": (lambda g, x, y: x - x, lambda g, x, y: 0.0),
    "x * 0": (lambda g, x, y: x * 0.0, lambda g, x, y: 0.0),
    "x * 1": (lambda g, x, y: 1.0 * x, lambda g, x, y: x),
    "x * -1": (lambda g, x, y: x * -1.0, lambda g, x, y: -x),
    "x / 1": (lambda g, x, y: x / 1.0, lambda g, x, y: x),
    "0 / x": (lambda g, x, y: 0.0 / x, lambda g, x, y: 0.0),
    "--x": (lambda g, x, y: g.neg(-x), lambda g, x, y: x),
    "x + -y": (lambda g, x, y: x + -y, lambda g, x, y: x - y),
    "-x + y": (lambda g, x, y: -x + y, lambda g, x, y: y - x),
    "-x - y": (lambda g, x, y: -x - y, lambda g, x, y: -(x + y)),
    "x - -y": (lambda g, x, y: x - -y, lambda g, x, y: x + y),
    "-x * -y": (lambda g, x, y: -x * -y, lambda g, x, y: x * y),
    "-x * y": (lambda g, x, y: -x * y, lambda g, x, y: -(x * y)),
    "2 (3 x)": (lambda g, x, y: 2.0 * (3.0 * x), lambda g, x, y: 6.0 * x),
    "-2 x": (lambda g, x, y: -2.0 * x, lambda g, x, y: -(2.0 * x)),
    "2 (x / 2)": (lambda g, x, y: 2.0 * (x / 2.0), lambda g, x, y: x),
    "x + y, y + x": (lambda g, x, y: x + y, lambda g, x, y: y + x),
    "x y, y x": (lambda g, x, y: x * y, lambda g, x, y: y * x),
    "(x + y) - y": (lambda g, x, y: (x + y) - y, lambda g, x, y: x),
    "(x - y) + y": (lambda g, x, y: (x - y) + y, lambda g, x, y: x),
    "x - (x + y)": (lambda g, x, y: x - (x + y), lambda g, x, y: -y),
    "(x + 2) + (y + 3)": (lambda g, x, y: (x + 2.0) + (y + 3.0), lambda g, x, y: (x + y) + 5.0),
    "y - x after x - y": (lambda g, x, y: y - x, lambda g, x, y: -(x - y)),
    "sin x twice": (lambda g, x, y: g.sincos(x)[0], lambda g, x, y: g.sincos(x)[0]),
}


@pytest.mark.parametrize("name", FOLDS)
def test_folding(name: str) -> None:
    """Both sides are the same node, or the same number."""
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    before, after = FOLDS[name]
    if name.startswith("y - x after"):
        assert isinstance(x - y, Node)
    left, right = before(graph, x, y), after(graph, x, y)
    if isinstance(right, Node):
        assert left.index == right.index
    else:
        assert left == right


def test_numbers_stay_numbers() -> None:
    graph = Graph()
    assert graph.add(1.0, 2.0) == 3.0
    assert graph.sub(1.0, 2.0) == -1.0
    assert graph.mul(3.0, 2.0) == 6.0
    assert graph.div(3.0, 2.0) == 1.5
    assert graph.neg(3.0) == -3.0
    assert graph.sincos(0.5) == (math.sin(0.5), math.cos(0.5))
    assert graph.instructions == []


BAD: dict[str, tuple[Sequence[Instruction], Mapping[tuple[str, int], int], str]] = {
    "unknown operation": ([Instruction("pow", (0, 0))], {}, "pow"),
    "too few arguments": ([Instruction("input", (), ("q", 0)), Instruction("add", (0,))], {}, "takes 2 arguments"),
    "too many arguments": ([Instruction("input", (), ("q", 0)), Instruction("neg", (0, 0))], {}, "takes 1 arg"),
    "a later argument": ([Instruction("neg", (1,)), Instruction("input", (), ("q", 0))], {}, "uses a later one"),
    "itself": ([Instruction("neg", (0,))], {}, "uses a later one"),
    "a negative argument": ([Instruction("input", (), ("q", 0)), Instruction("neg", (-1,))], {}, "uses a later one"),
    "a constant without a number": ([Instruction("const")], {}, "leaf None"),
    "a leaf too many": ([Instruction("input", (), ("q", 0)), Instruction("neg", (0,), 1.0)], {}, "leaf 1.0"),
    "not a number": ([Instruction("const", (), math.nan)], {}, "nan"),
    "infinite": ([Instruction("const", (), math.inf)], {}, "inf"),
    "an output that is not there": ([Instruction("const", (), 1.0)], {("out", 0): 1}, "output"),
}


@pytest.mark.parametrize("name", BAD)
def test_verify_refuses(name: str) -> None:
    instructions, outputs, message = BAD[name]
    refused(AssertionError, re.escape(message), verify, Program("bad", tuple(instructions), outputs))


# Random programs.  Their values are numbers modulo a prime, so that folding may not lose a bit.
PRIME = 2**61 - 1
OPERATIONS = ("add", "sub", "mul", "div", "neg", "sin", "cos")
CONSTANTS = (0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5, 3.0, 0.75)


@dataclass(frozen=True)
class Mod:
    """A number modulo PRIME; floats that are sums of powers of two convert exactly."""

    value: int

    @classmethod
    def of(cls, number: Any) -> Mod:
        if isinstance(number, Mod):
            return number
        exact = Fraction(number)
        return cls(exact.numerator * pow(exact.denominator, -1, PRIME) % PRIME)

    def __add__(self, other: Any) -> Mod:
        return Mod((self.value + Mod.of(other).value) % PRIME)

    def __sub__(self, other: Any) -> Mod:
        return Mod((self.value - Mod.of(other).value) % PRIME)

    def __mul__(self, other: Any) -> Mod:
        return Mod(self.value * Mod.of(other).value % PRIME)

    def __truediv__(self, other: Any) -> Mod:
        return Mod(self.value * pow(Mod.of(other).value, -1, PRIME) % PRIME)

    def __neg__(self) -> Mod:
        return Mod(-self.value % PRIME)

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: Any) -> Mod:
        return Mod.of(other) - self

    def __rtruediv__(self, other: Any) -> Mod:
        return Mod.of(other) / self


def opaque_sincos(x: Any) -> tuple[Any, Any]:
    """Two functions of which nothing is known; any will do."""
    return Mod.of(x) * 5 + 7, Mod.of(x) * 11 + 13


steps = st.lists(
    st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 40), st.integers(0, 40)), min_size=1, max_size=40
)


def build_both(plan: Sequence[tuple[str, int, int]], pool: Sequence[Any], graph: Graph) -> tuple[list[Any], list[Any]]:
    """The plan's last values as folded nodes, and as numbers that nothing folded."""
    nodes: list[Any] = [*pool, *CONSTANTS]
    numbers = [*(Mod(12345 + 678 * i * i) for i in range(len(pool))), *map(Mod.of, CONSTANTS)]
    for op, i, j in plan:
        i, j = i % len(nodes), j % len(nodes)
        x, y = nodes[i], nodes[j]
        if op in ("sin", "cos"):
            found = graph.sincos(x)[op == "cos"] if isinstance(x, Node) else x
            if isinstance(found, Node):  # of a number, also one that folding found, the graph takes the true sine
                nodes.append(found)
                numbers.append(opaque_sincos(numbers[i])[op == "cos"])
        elif op == "neg":
            nodes.append(graph.neg(x))
            numbers.append(-numbers[i])
        elif op == "div":
            number = graph.instructions[y.index][2] if isinstance(y, Node) else y  # folding makes numbers of nodes
            exact = not isinstance(number, float) or abs(number) in (0.5, 1.0, 2.0)
            if numbers[j].value != 0 and exact:
                nodes.append(graph.div(x, y))
                numbers.append(numbers[i] / numbers[j])
        else:
            nodes.append(getattr(graph, op)(x, y))
            numbers.append({"add": Mod.__add__, "sub": Mod.__sub__, "mul": Mod.__mul__}[op](numbers[i], numbers[j]))
    return nodes[-6:], numbers[-6:]


def random_program(plan: Sequence[tuple[str, int, int]]) -> tuple[Program, dict[str, list[Mod]], list[Mod]]:
    graph = Graph()
    pool = [graph.input("q", 0), graph.input("q", 1), graph.input("p", 0), graph.input("p", 1)]
    nodes, numbers = build_both(plan, pool, graph)
    inputs = {"q": [Mod(12345), Mod(12345 + 678)], "p": [Mod(12345 + 678 * 4), Mod(12345 + 678 * 9)]}
    return finish(graph, "random", {("out", i): node for i, node in enumerate(nodes)}), inputs, numbers


def values(program: Program, inputs: Mapping[str, Sequence[Any]]) -> list[Mod]:
    found = evaluate(program, inputs, opaque_sincos)
    return [Mod.of(found["out", i]) for i in range(len(found))]


@settings(max_examples=300, deadline=None)
@given(steps)
def test_folding_keeps_values(plan: Sequence[tuple[str, int, int]]) -> None:
    """And leaves no product with 0, 1 or -1, sum with 0, double sign, nothing twice, nothing that no output needs."""
    program, inputs, numbers = random_program(plan)
    assert values(verify(program), inputs) == numbers
    instructions = program.instructions
    for op, args in ((i.op, i.args) for i in instructions):
        arguments = [instructions[arg] for arg in args]
        constants = [argument.leaf for argument in arguments if argument.op == "const"]
        assert len(constants) < len(args) or not args
        if op == "mul":
            assert not {0.0, 1.0, -1.0} & set(constants)
        if op in ("add", "sub"):
            assert 0.0 not in constants
            assert all(argument.op != "neg" for argument in arguments)
        if op == "neg":
            assert arguments[0].op != "neg"
    assert len(set(instructions)) == len(instructions)
    assert 0 not in users(program)


def test_common_factors_of_a_sum() -> None:
    """a f + (c - b f) + a g: one product with f, though c stands between; a product that is used twice stays."""
    graph = Graph()
    a, b, c, f, g = (graph.input("q", i) for i in range(5))
    sum_ = a * f + (c - b * f) + a * g
    kept, both = a * c, b * c
    program = finish(graph, "sums", {("out", 0): sum_, ("out", 1): kept + both, ("out", 2): kept})
    factored = factor_sums(program)
    assert (program.count()["mul"], factored.count()["mul"]) == (5, 4)
    assert factored.count()["add"] == program.count()["add"]
    inputs = {"q": [2.0, 3.0, 5.0, 7.0, 11.0]}
    assert evaluate(factored, inputs) == evaluate(program, inputs)


def test_a_sum_that_cancels_once_factored() -> None:
    """a f - (b f + (a - b) f) is 0, and what is made of it folds: C has no vector of products of literals."""
    graph = Graph()
    a, b, f, g = (graph.input("q", i) for i in range(4))
    nothing = a * f - (b * f + (a - b) * f)
    used = g * nothing
    outputs = {("out", 0): used + a, ("out", 1): 0.5 * nothing, ("out", 2): b - used, ("out", 3): graph.sincos(used)[1]}
    program = finish(graph, "nothing", outputs)
    factored = factor_sums(program)
    assert sum(factored.count().values()) == 0
    inputs = {"q": [2.0, 3.0, 5.0, 7.0]}
    assert evaluate(factored, inputs) == evaluate(program, inputs)


@pytest.mark.parametrize("step", PASSES, ids=lambda step: step.__name__)
@settings(max_examples=300, deadline=None)
@given(plan=steps)
def test_every_pass_keeps_values(step: Callable[[Program], Program], plan: Sequence[tuple[str, int, int]]) -> None:
    program, inputs, numbers = random_program(plan)
    changed = verify(step(program))
    assert values(changed, inputs) == numbers
    assert all(changed.count()[key] <= number for key, number in program.count().items())


@settings(max_examples=300, deadline=None)
@given(steps, steps)
def test_hoisting_keeps_values(plan: Sequence[tuple[str, int, int]], other: Sequence[tuple[str, int, int]]) -> None:
    """Two kernels share one setup; after it no kernel reads a parameter or does what the setup can do."""
    made = [random_program(plan), random_program(other)]
    setup, hoisted = hoist_parameters([run_passes(program) for program, _, _ in made], 2)
    assert setup.inputs() <= {"p"}
    found = evaluate(setup, {"p": made[0][1]["p"]}, opaque_sincos)
    h = [found["h", slot] for slot in range(len(found))]
    assert h[:2] == made[0][1]["p"]
    for program, (_, inputs, numbers) in zip(hoisted, made, strict=True):
        assert values(program, {"q": inputs["q"], "h": h}) == numbers
        assert program.inputs() <= {"q", "h"}
        for instruction in program.instructions:
            arguments = [program.instructions[arg] for arg in instruction.args]
            early = [x.op == "const" or (x.op == "input" and x.leaf[0] == "h") for x in arguments]
            assert not arguments or not all(early)


def test_comparisons_and_roots_fold() -> None:
    """Numbers are computed, the same value is its own maximum, and what is no number stays so."""
    graph = Graph()
    x = graph.input("q", 0)
    f = graph.call
    assert (f("max", 1.0, 2.0), f("step", 0.0), f("step", 3.0), f("sqrt", 9.0)) == (2.0, 0.0, 1.0, 3.0)
    same = f("max", x, x)
    assert isinstance(same, Node)
    assert same.index == x.index
    outputs = {("out", 0): f("max", x, 0.0), ("out", 1): f("step", x), ("out", 2): f("sqrt", x * x)}
    program = run_passes(finish(graph, "calls", outputs))
    assert list(evaluate(program, {"q": [-2.0]}).values()) == [0.0, 0.0, 2.0]
    assert list(evaluate(program, {"q": [2.0]}).values()) == [2.0, 1.0, 2.0]
    assert math.isnan(evaluate(program, {"q": [math.nan]})["out", 0])
    assert program.count() == {"mul": 1, "add": 2, "div": 1, "sincos": 0}


def test_evaluate_on_arrays_and_symbols() -> None:
    """The same program on NumPy arrays, and read back into SymPy."""
    import sympy as sp

    program = pendulum()
    q, a = np.linspace(-1, 1, 5), np.linspace(0, 1, 5)
    found = evaluate(program, {"q": [q], "a": [a], "p": [9.81]}, lambda x: (np.sin(x), np.cos(x)))
    assert np.allclose(found["out", 0], 0.75 * a + 1.5 * 9.81 * np.sin(q), rtol=1e-15)
    x, y, g = sp.symbols("x y g")
    symbolic = evaluate(program, {"q": [x], "a": [y], "p": [g]}, lambda s: (sp.sin(s), sp.cos(s)))
    assert sp.nsimplify(symbolic["out", 0] - (sp.Rational(3, 4) * y + sp.Rational(3, 2) * g * sp.sin(x))) == 0


def test_the_source_is_a_value() -> None:
    """Everything that is compiled is text; two derivations give equal sources."""
    model = build_model(eomgen.load_robot("one_link"))
    first, second = (render(derive_equations(model)) for _ in range(2))
    assert isinstance(first, Source)
    assert first == second


LENGTH = 3  # of every array


def paired_program(rng: random.Random, operations: int = 40) -> Program:
    """A program of the arrays "x" and "z": functions of x alone, and sums, products, quotients and choices of all."""
    graph = Graph()
    single: list[Value] = [graph.input("x", i) for i in range(LENGTH)]
    whole: list[Value] = [*single, *(graph.input("z", i) for i in range(LENGTH)), 2.0, -0.5]
    for _ in range(operations):
        x, y = rng.choice(whole), rng.choice(whole)
        one, other = rng.choice(single), rng.choice(single)
        found: Value
        match rng.randrange(9):
            case 0:
                found = graph.add(x, y)
            case 1:
                found = graph.sub(x, y)
            case 2 | 3:
                found = graph.mul(x, y)
            case 4:
                found = graph.div(x, graph.add(graph.mul(y, y), 40.0))
            case 5:
                found = graph.neg(x)
            case 6:
                found = graph.choose(one, x, y)
            case 7:
                found = graph.call(rng.choice(["max", "atan2"]), one, graph.add(graph.mul(other, other), 1.0))
                single.append(found)
            case _:
                found = graph.sincos(one)[rng.randrange(2)]
                single.append(found)
        whole.append(found)
    return finish(graph, "random", {**{("out", i): x for i, x in enumerate(whole[-4:])}, ("aside", 0): single[-1]})


@pytest.mark.parametrize("seed", range(60))
def test_pairs_are_pythons_complex_numbers(seed: int) -> None:
    rng = random.Random(seed)
    program = paired_program(rng)
    pairs = verify(on_pairs(program, {"z": LENGTH}))
    x = [rng.uniform(-1.0, 1.0) for _ in range(LENGTH)]
    z = [complex(rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)) for _ in range(LENGTH)]
    expected = evaluate(program, {"x": x, "z": z})
    found = evaluate(pairs, {"x": x, "z": [*(w.real for w in z), *(w.imag for w in z)]})
    is_complex = len([key for key in found if key[0] == "out"]) > 4
    for (array, place), value in expected.items():
        imaginary = found["out", 4 + place] if array == "out" and is_complex else 0.0
        here = complex(found[array, place], imaginary)
        assert abs(here - value) <= 1e-12 * max(1.0, abs(value))
    assert ("aside", 1) not in found


def test_what_stays_real_stays_single() -> None:
    """A product of real numbers is one product, one with a complex number two, one of two of them four."""
    graph = Graph()
    x, y, z, w = graph.input("x", 0), graph.input("x", 1), graph.input("z", 0), graph.input("z", 1)
    counts = []
    for value in (x * y, x * z, z * w, z / x, z / w):
        program = on_pairs(finish(graph, "one", {("out", 0): value}), {"z": 2})
        counts.append({name: number for name, number in program.count().items() if number})
    assert counts == [
        {"mul": 1},
        {"mul": 2},
        {"mul": 4, "add": 2},
        {"mul": 2, "div": 1},
        {"mul": 8, "add": 3, "div": 1},
    ]


def test_a_result_is_complex_where_one_of_its_numbers_is() -> None:
    graph = Graph()
    program = finish(
        graph, "two", {("out", 0): graph.input("x", 0), ("out", 1): graph.input("z", 0), ("pivot", 0): 1.0}
    )
    assert list(on_pairs(program, {"z": 1}).outputs) == [("out", 0), ("out", 2), ("out", 1), ("out", 3), ("pivot", 0)]
    assert ("pivot", 0) not in on_pairs(program, {"z": 1}, dropped=("pivot",)).outputs


def test_a_result_is_complex_if_that_is_asked_for() -> None:
    """One that depends on no complex number has imaginary parts, too: they are 0."""
    graph = Graph()
    program = finish(graph, "none", {("out", 0): graph.input("x", 0), ("out", 1): 2.0, ("aside", 0): 1.0})
    pairs = verify(on_pairs(program, {"z": 1}, results=("out",)))
    found = evaluate(pairs, {"x": [3.0], "z": [0.0, 0.0]})
    assert found == {("out", 0): 3.0, ("out", 1): 2.0, ("out", 2): 0.0, ("out", 3): 0.0, ("aside", 0): 1.0}


@pytest.mark.parametrize("op", ["abs", "max", "step", "sqrt", "exp", "log", "atan2", "sin", "choose"])
def test_what_has_no_meaning_is_refused(op: str) -> None:
    graph = Graph()
    z = graph.input("z", 0)
    if op == "sin":
        value = graph.sincos(z)[0]
    elif op == "choose":
        value = graph.choose(z, graph.input("x", 0), 1.0)
    else:
        value = graph.call(op, *[z, graph.input("x", 0)][: 2 if op in ("max", "atan2") else 1])
    refused(AssertionError, f"one: {op} ", on_pairs, finish(graph, "one", {("out", 0): value}), {"z": 1})


def test_notes_stay_where_they_were() -> None:
    graph = Graph()
    z = graph.input("z", 0)
    graph.note("here")
    value = graph.mul(z, z)
    pairs = on_pairs(finish(graph, "noted", {("out", 0): value}), {"z": 1})
    ((place, text),) = pairs.notes.items()
    assert text == "here"
    assert pairs.instructions[place].op == "mul"
