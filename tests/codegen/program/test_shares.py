"""Programs taken apart along a tree, cut in two, and in orders in which values live less long."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.contexts import _short_lived
from eomgen.codegen.c.statements import handed_on, split, trig_values, workspace
from eomgen.codegen.kernels.bodies import first_frame, frame_bodies, share_among_bodies
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.program import shares as taken_apart
from eomgen.codegen.program.cutting import cut
from eomgen.codegen.program.ir import (
    GATE,
    Graph,
    Instruction,
    Program,
    evaluate,
    finish,
    first_values,
    gate_between,
    verify,
)
from eomgen.codegen.program.orders import as_derived, long_lives, with_short_lives
from eomgen.codegen.program.shares import Goal, Shares, share
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.random_robots import random_robot, random_state, seeds, with_offsets

Values = Mapping[str, list[float]]
NEVER = Instruction("const", (), np.nan)  # in the place of what is not computed


def results(shares: Shares, inputs: Values, node: int) -> dict[tuple[str, int], float]:
    """What the runs on the way to a node write, the last values of all that they read handed on."""
    turning = list(evaluate(shares.angles, inputs).values())
    starts = [0]
    for number in range(len(shares.runs)):
        starts.append(starts[-1] + max(t for t, run in zip(shares.turned, shares.run_of, strict=True) if run == number))
    found: dict[tuple[str, int], float] = {}
    kept = [np.nan] * shares.kept
    for last in shares.way(node):
        number = shares.run_of[last]
        run, own = shares.runs[number], turning[starts[number] : starts[number + 1]]
        end = min((index for index, done in run.stops.items() if done >= last), default=len(run.program.instructions))
        before = [i if at < end or not i.args else NEVER for at, i in enumerate(run.program.instructions)]
        given = {**inputs, "sine": np.sin(own).tolist(), "cosine": np.cos(own).tolist(), "given": kept}
        written = evaluate(replace(run.program, instructions=tuple(before)), given)
        for (array, place), value in written.items():
            if array == "kept":
                kept[place] = value
            else:
                found[array, place] = value
    return found


def offset_tree(seed: int) -> Robot:
    """Branches, joints with several coordinates, and parameters: placements, and offsets of angles that do not move."""
    robot = with_offsets(random_robot(seed, joints=(4, 6), tree=True, types=("revolute", "prismatic", "free")), seed)
    placed = tuple(f"joints.{j.name}.placement.xyz.{i}" for j in robot.joints for i in range(3))
    return replace(robot, tunable=(*robot.tunable, *placed))


@pytest.mark.parametrize("seed", seeds(4100, 3, 12))
@pytest.mark.parametrize("length", [10**6, 30])
def test_a_way_writes_what_the_program_writes(seed: int, length: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same bits, with long runs and with short ones, from nothing but what the way has computed."""
    monkeypatch.setattr(taken_apart, "LENGTH", length)
    model = build_model(offset_tree(seed))
    program = derive_equations(model, ("kinematics",)).programs["kinematics"]
    shares = share_among_bodies(model, program)
    inputs = {
        "q": random_state(model.robot, seed).q.tolist(),
        "h": np.random.default_rng(seed).normal(size=999).tolist(),
    }
    whole = list(evaluate(program, inputs, sincos=lambda x: (np.sin(x), np.cos(x))).values())
    origins, bodies = 12 * len(model.frames), frame_bodies(model)
    for frame, body in enumerate(bodies):
        found = results(shares, inputs, first_frame(model) + frame)
        assert [found["pose", i] for i in range(12)] == whole[12 * frame : 12 * frame + 12]
        while body >= 0:
            assert [found["origins", 3 * body + i] for i in range(3)] == whole[origins + 3 * body :][:3]
            first = origins + 3 * len(model.bodies)
            for i in range(3 * model.bodies[body].first, 3 * model.bodies[body].indices.stop):
                assert found["axes", i] == whole[first + i]
            body = model.bodies[body].parent


def test_no_way_computes_what_other_branches_need() -> None:
    """Of a column that two arms stand on: a frame needs one of them, and nothing is there twice."""
    model = build_model(eomgen.load_robot("two_arms"))
    program = derive_equations(model, ("kinematics",)).programs["kinematics"]
    shares = share_among_bodies(model, program)
    of_runs = [run.program.count() for run in shares.runs]
    whole = program.count()
    for key in ("mul", "add"):
        assert sum(count[key] for count in of_runs) == whole[key]
    assert len(shares.angles.outputs) == whole["sincos"]
    assert shares.count()["mul"] <= whole["mul"] / 2
    assert shares.count()["sincos"] == 9


def test_values_of_several_branches_belong_where_they_part() -> None:
    """And a value that one branch alone needs does not burden the node that could compute it already."""
    graph = Graph()
    x, y, z = (graph.input("q", i) for i in range(3))
    shared, own = x * x, x * y
    sine, cosine = graph.sincos(x)
    outputs = {("out", 0): shared * y + sine, ("out", 1): shared * z + cosine, ("out", 2): own * own}
    goals = {("out", 0): Goal(2, "end", 0), ("out", 1): Goal(3, "end", 0), ("out", 2): Goal(2, "end", 1)}
    shares = share(finish(graph, "fork", outputs), goals, (-1, 0, 1, 1), 0)
    assert [shares.runs[shares.run_of[node]].program.count()["mul"] for node in (1, 2, 3)] == [1, 3, 1]
    assert shares.run_of == (0, 0, 1, 2)
    assert [shares.way(node) for node in (1, 2, 3)] == [(1,), (1, 2), (1, 3)]
    assert shares.turned == (0, 1, 0, 0)
    assert shares.kept == 3  # x * x, and the sine and the cosine
    given = {"q": [0.5, 2.0, -3.0]}
    assert results(shares, given, 3)["end", 0] == 0.25 * -3.0 + np.cos(0.5)
    assert shares.count() == {"mul": 4, "add": 1, "div": 0, "sincos": 1}


@pytest.mark.parametrize("length", [10**6, 20])
def test_compiled_ways_have_the_same_bits(length: int, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of many bodies and of one; one state and many; parameters that have changed."""
    monkeypatch.setattr(taken_apart, "LENGTH", length)
    robot = replace(offset_tree(4101), name=f"ways_{length}")
    kernel = built(robot, "kinematics")
    rng = np.random.default_rng(1)
    for name in list(kernel.parameters)[::3]:
        kernel.parameters[name] = float(kernel.parameters[name] + rng.normal())
    q = rng.uniform(-2.0, 2.0, (11, len(kernel.coordinates)))
    for frame in kernel.frames:
        many = kernel.frame_jacobian(q, frame), kernel.frame_pose(q, frame)
        for row, jacobian, pose in zip(q, *many, strict=True):
            assert np.array_equal(kernel.frame_jacobian(row, frame), jacobian)
            assert np.array_equal(kernel.frame_pose(row, frame), pose)


@pytest.mark.parametrize("seed", range(8))
def test_both_halves_are_the_whole(seed: int) -> None:
    """Of random programs, with outputs that are early, late, numbers, and inputs as they are."""
    rng, graph = np.random.default_rng(seed), Graph()
    arrays = {"p": rng.uniform(0.5, 2.0, 2), "q": rng.uniform(0.5, 2.0, 3), "late": rng.uniform(0.5, 2.0, 3)}
    nodes = [graph.input(name, i) for name, values in arrays.items() for i in range(len(values))]
    for _ in range(60):
        one, other = (nodes[i] for i in rng.integers(len(nodes), size=2))
        found = [graph.add, graph.sub, graph.mul, graph.div][rng.integers(4)](one, other)
        if not isinstance(found, float):
            nodes.append(found)
    chosen = [nodes[i] for i in rng.integers(len(nodes), size=6)]
    outputs = {("out", i): node for i, node in enumerate([*chosen, nodes[0], nodes[2], nodes[-1]])}
    whole = finish(graph, "whole", outputs)
    first, second = cut(whole, ("late",), ("p",), "kept")
    assert first.inputs() <= {"p", "q"}
    assert second.inputs() <= {"p", "late", "kept"}
    early = evaluate(first, arrays)
    kept = [early["out", i] for i in range(len(early))]
    together = evaluate(second, {"p": arrays["p"], "late": arrays["late"], "kept": kept})
    assert together == evaluate(whole, arrays)  # the same operations, and so the same bits
    operations = [sum(program.count().values()) for program in (first, second, whole)]
    assert max(operations[:2]) <= operations[2] <= sum(operations[:2])


def test_what_the_first_half_writes_may_not_wait() -> None:
    graph = Graph()
    late = graph.input("late", 0)
    program = finish(graph, "whole", {("out", 0): late, ("pivot", 0): late * 2.0})
    with pytest.raises(AssertionError):
        cut(program, ("late",), (), "kept")


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
