"""Orders of a program's statements in which values live less long: the same values, in fewer places."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

import eomgen
from eomgen.codegen.c.contexts import _short_lived
from eomgen.codegen.c.statements import handed_on, split, trig_values, workspace
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import GATE, Graph, Program, evaluate, finish, first_values, gate_between, verify
from eomgen.codegen.program.orders import as_derived, long_lives, with_short_lives
from eomgen.robot.model import build_model
from tests.support.random_robots import random_robot


def tree(seed: int, joints: int) -> Program:
    """Return forward dynamics of a random tree."""
    robot = random_robot(seed, joints=(joints, joints), tree=True, max_coordinates=1, name="tree")
    return derive(build_model(robot), "forward_dynamics")


def gated() -> Program:
    """Return a program with a gate, whose second half reads the first one's values."""
    graph, rng = Graph(), random.Random(4)
    values = [graph.input("q", i) for i in range(3)]
    for _ in range(60):
        values.append(graph.add(graph.mul(rng.choice(values), rng.choice(values)), rng.choice(values)))
    gate, early = values[20], values[30]
    outputs = {("out", i): graph.choose(gate, values[-1 - i], early) for i in range(3)}
    return gate_between(finish(graph, "gated", {(GATE, 0): gate, ("first", 0): early, **outputs}))


def numbers(program: Program, seed: int) -> dict[str, list[float]]:
    """Return random numbers for all inputs."""
    rng, inputs = random.Random(seed), [x.leaf for x in program.instructions if x.op == "input"]
    sizes = {array: 1 + max(i for name, i in inputs if name == array) for array, _ in inputs}
    return {array: [rng.uniform(-1, 1) for _ in range(size)] for array, size in sorted(sizes.items())}


@pytest.mark.parametrize("seed", range(4))
def test_values_are_the_same_in_another_order(seed: int) -> None:
    program = gated() if seed == 0 else tree(seed, 4 + seed)
    short = verify(with_short_lives(program))
    assert sorted(x.op for x in short.instructions) == sorted(x.op for x in program.instructions)
    assert short.notes.keys() <= set(range(len(short.instructions)))
    assert set(short.notes.values()) == set(program.notes.values())
    given = numbers(program, seed)
    assert evaluate(short, given) == evaluate(program, given)
    early = first_values(short)
    assert early == sorted(early, reverse=True)  # nothing from behind the gate stands in front of it


def test_fewer_values_live_long() -> None:
    """What goes out to the tips of many branches is computed branch by branch."""
    program = tree(3, 16)
    plain, short = (long_lives(x, as_derived(x)) for x in (program, with_short_lives(program)))
    assert short < 0.8 * plain


@pytest.mark.parametrize(("seed", "chunk"), [(0, 9), (1, 25), (2, 60), (3, 7)])
def test_places_are_used_again_when_nothing_reads_them_any_more(seed: int, chunk: int) -> None:
    """Functions that know what they compute and the shared array find all values, in fewer places than values."""
    program = gated() if seed == 0 else tree(seed, 8)
    chunk_of = split(program, trig_values(program), chunk)
    slots = handed_on(program, chunk_of)
    shared: dict[int, int] = {}
    for index, here in chunk_of.items():
        for arg in program.instructions[index].args:
            if arg in chunk_of and chunk_of[arg] != here:
                assert shared[slots[arg]] == arg  # the last that was written there
        if index in slots:
            shared[slots[index]] = index
    assert set(shared) == set(range(workspace(slots)))
    assert workspace(slots) < len(slots)
    assert workspace({}) == 0


def test_short_programs_keep_their_order() -> None:
    """What a single function holds is written as it was derived."""
    program = derive(build_model(replace(eomgen.load_robot("ur5"), name="arm")), "forward_dynamics")
    assert _short_lived(program) is program
