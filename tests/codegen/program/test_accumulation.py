"""Jacobians of programs by elimination of their values, against forward differentiation of the same graphs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eomgen.codegen.program.accumulation import jacobian
from eomgen.codegen.program.forward_mode import gradients
from eomgen.codegen.program.ir import Graph, Node, Value, evaluate, finish
from eomgen.codegen.program.passes import on_demand
from tests.support.random_robots import Array, seeds


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
