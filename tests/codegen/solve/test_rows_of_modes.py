"""Rows of loops and elastic elements on links that bend: modes eliminated in O(n) beside their leaders' matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.kernels.accelerations import REDUCED, implicit_step, step_has_rows
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive, derive_cheapest
from eomgen.codegen.kernels.stages import derive_pair_stage, derive_stage, stage_has_rows
from eomgen.codegen.program.ir import Program, finish
from eomgen.codegen.program.passes import run_passes
from eomgen.description.load import robot_from_toml
from eomgen.robot.elements import Bushing
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.support.bending_robots import bent
from tests.support.dense_stages import run
from tests.support.random_robots import State, random_placement, random_robot, seeds, with_random_loops
from tests.support.random_springs import with_springs

Array = NDArray[np.float64]
TYPES = ("revolute", "prismatic", "fixed", "free")
NUMBERS = {"stiffness": (80.0, 60.0, 90.0, 5.0, 6.0, 7.0), "damping": (2.0, 3.0, 1.0, 0.2, 0.1, 0.3)}


def drawn(seed: int, *, loop: bool) -> tuple[Robot, State]:
    """A tree of two to four joints whose links bend, with springs and a bushing at its last link, and perhaps a loop.

    Nodes are links: ends of springs, bushings and loops stand on them as on others.  Rows of loops are independent:
    others contradict each other where a loop is open.
    """
    for number in range(seed, seed + 20000, 1000):
        robot, s = tied(number, loop=loop)
        if not loop or np.linalg.matrix_rank(loop_rows(robot, s), 1e-3) == 3:
            return robot, s
    raise AssertionError("no robot among twenty has independent rows")


def loop_rows(robot: Robot, s: State) -> Array:
    given = inputs_of(robot, s)
    return run(derive(build_model(robot), "constraint_jacobian"), {"q": given["q"], "p": given["p"]}).reshape(3, -1)


def tied(seed: int, *, loop: bool) -> tuple[Robot, State]:
    bending = bent(random_robot(seed, (2, 4), 3, tree=True, types=TYPES, name="tied"), seed, (1, 2, 3))
    robot, rng = with_springs(bending.robot, seed, ("linear", "damper")), np.random.default_rng(seed)
    last, placements = robot.links[-1].name, (random_placement(rng), random_placement(rng))
    mount = Bushing("mount", (robot.base, last), placements=placements, **NUMBERS)
    robot = replace(robot, elements=(*robot.elements, mount))
    return (with_random_loops(robot, seed, ["spherical"]) if loop else robot), bending.state(seed)


def inputs_of(robot: Robot, s: State) -> dict[str, list[float]]:
    model = build_model(robot)
    numbers = [*model.parameters.values(), *[0.0] * len(model.turning)]
    return {"q": [*s.q], "v": [*s.v], "u": [*s.u], "p": numbers, "added": [0.0] * len(s.q)}


def close(found: Array, expected: Array, limit: float = 1e-10) -> None:
    assert np.isfinite(expected).all()
    assert np.abs(found - expected).max() <= limit * np.abs(expected).max()


@pytest.mark.parametrize("seed", seeds(0, 4, 40))
@pytest.mark.parametrize("loop", [False, True])
def test_steps_are_those_of_the_leaders_matrix(seed: int, loop: bool) -> None:
    robot, s = drawn(seed, loop=loop)
    assert step_has_rows(Derivation(build_model(robot)))
    found = []
    for by_leaders in (False, True):
        d = Derivation(build_model(robot))
        program = finish(d.graph, "step", implicit_step(d, by_leaders=by_leaders))
        found.append(run(program, inputs_of(robot, s) | {"dt": [0.05, 0.0025]}))
    close(*found)


@pytest.mark.parametrize("seed", seeds(100, 3, 30))
@pytest.mark.parametrize("is_pair", [False, True])
def test_stages_are_those_of_the_leaders_matrix(seed: int, is_pair: bool) -> None:
    robot, s = drawn(seed, loop=seed % 2 == 0)
    n, before = len(s.q), "pair_" if is_pair else ""
    assert stage_has_rows(Derivation(build_model(robot)))
    rates, shifts = np.random.default_rng(seed).normal(size=(2, 2 * n if is_pair else n)).tolist()
    state = inputs_of(robot, s) | {"kp": [0.0] * n, "kd": [0.0] * n, "spans": [0.36, 0.13], f"{before}rates": rates}
    state |= {f"{before}shifts": shifts, f"{before}times": [0.2, -0.05, 0.3, 0.12] if is_pair else [0.2, 0.04]}
    found = []
    for by_leaders in (False, True):
        write = derive_pair_stage if is_pair else derive_stage
        first, second = write(Derivation(build_model(robot)), by_leaders=by_leaders).values()
        found.append(run(second, state | {f"{before}kept": run(first, state).tolist()}))
    close(*found)


LINK = """[[links]]
name = "beam{i}"
[links.beam]
length = 0.5
E = 7.0e10
G = 2.6e10
density = 2700.0
section = {{ bar = [0.02, 0.01] }}
modes = {{ y = 2, z = 2 }}
[[joints]]
name = "joint{i}"
parent = "{parent}"
{node}
child = "beam{i}"
type = "revolute"
placement = {{ xyz = [0.0, 0.0, 0.0], rpy = [0.3, 0.2, 0.1] }}
"""
ENDS = {
    "bushing": '[[bushings]]\nname = "mount"\nlinks = ["base", "{last}"]\nnodes = ["root", "tip"]\n'
    "stiffness = [1e5, 1e5, 1e5, 50.0, 60.0, 70.0]\n",
    "loop": '[[loops]]\nname = "ball"\ntype = "spherical"\nlinks = ["base", "{last}"]\nnodes = ["root", "tip"]\n',
}


def arm(links: int, end: str) -> Robot:
    """Return beams on revolute joints, one behind the other, the tip of the last held by a bushing or closed."""
    parts = []
    for i in range(1, links + 1):
        parent, node = ("base", "") if i == 1 else (f"beam{i - 1}", 'node = "tip"')
        parts.append(LINK.format(i=i, parent=parent, node=node))
    return robot_from_toml('name = "arm"\n' + "".join(parts) + ENDS[end].format(last=f"beam{links}"))


def cost(program: Program) -> int:
    count = program.count()
    return count["mul"] + count["add"]


def dense_step(model: Model) -> Program:
    d = Derivation(model)
    return run_passes(finish(d.graph, "implicit_step", implicit_step(d, by_leaders=True)))


def test_what_costs_less_is_taken() -> None:
    """By the matrix with one beam, by elimination with five."""
    one, five = (build_model(arm(links, "bushing")) for links in (1, 5))
    assert derive(one, "implicit_step").count() == dense_step(one).count()
    assert cost(derive(five, "implicit_step")) < 0.7 * cost(dense_step(five))


@pytest.mark.soak
@pytest.mark.parametrize(("end", "kernel"), [("bushing", "implicit_step"), ("loop", "constrained_dynamics")])
def test_operations_grow_with_the_number_of_links(end: str, kernel: str) -> None:
    """From four beams to eight not much more than twofold, where those of the leaders' matrix grow fourfold."""
    four, eight = (build_model(arm(links, end)) for links in (4, 8))
    assert cost(derive(eight, kernel)) < 2.5 * cost(derive(four, kernel))
    if kernel == "implicit_step":
        dense = dense_step(eight)
    else:
        dense = derive_cheapest(eight, kernel, REDUCED)[0]
    assert cost(derive(eight, kernel)) < 0.5 * cost(dense)
