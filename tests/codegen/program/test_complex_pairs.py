"""Programs over pairs of numbers, beside the same programs on Python's complex numbers."""

from __future__ import annotations

import random

import pytest

from eomgen.codegen.program.complex_pairs import on_pairs
from eomgen.codegen.program.ir import Graph, Program, Value, evaluate, finish, verify

LENGTH = 3  # of every array


def random_program(rng: random.Random, operations: int = 40) -> Program:
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
    program = random_program(rng)
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
    with pytest.raises(AssertionError, match=f"one: {op} "):
        on_pairs(finish(graph, "one", {("out", 0): value}), {"z": 1})


def test_notes_stay_where_they_were() -> None:
    graph = Graph()
    z = graph.input("z", 0)
    graph.note("here")
    value = graph.mul(z, z)
    pairs = on_pairs(finish(graph, "noted", {("out", 0): value}), {"z": 1})
    ((place, text),) = pairs.notes.items()
    assert text == "here"
    assert pairs.instructions[place].op == "mul"
