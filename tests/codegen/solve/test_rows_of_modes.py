"""Systems of rows against dense linear algebra; modes of links that bend are eliminated beside their leaders."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from eomgen.codegen.kernels.accelerations import REDUCED, implicit_step, step_has_rows
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive, derive_cheapest
from eomgen.codegen.kernels.stages import derive_pair_stage, derive_stage, stage_has_rows
from eomgen.codegen.program.ir import Program, finish
from eomgen.codegen.program.passes import run_passes
from eomgen.codegen.solve.rows import PRECISIONS, Response, Row, RowSystem, elastic_row, elimination_order
from eomgen.description.load import robot_from_toml
from eomgen.robot.elements import Bushing
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.support.bending_robots import bent
from tests.support.joint_table import beam_table, joint_table
from tests.support.programs import run
from tests.support.random_robots import Array, State, random_placement, random_robot, seeds, with_random_loops
from tests.support.random_springs import with_springs

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


ENDS = {
    "bushing": '[[bushings]]\nname = "mount"\nlinks = ["base", "{last}"]\nnodes = ["root", "tip"]\n'
    "stiffness = [1e5, 1e5, 1e5, 50.0, 60.0, 70.0]\n",
    "loop": '[[loops]]\nname = "ball"\ntype = "spherical"\nlinks = ["base", "{last}"]\nnodes = ["root", "tip"]\n',
}


def arm(links: int, end: str) -> Robot:
    """Return beams on revolute joints, one behind the other, the tip of the last held by a bushing or closed."""
    text = 'name = "arm"\n'
    for i in range(1, links + 1):
        parent, node = ("base", "") if i == 1 else (f"beam{i - 1}", 'node = "tip"')
        text += f"""{beam_table(f"beam{i}", 0.5, "{ bar = [0.02, 0.01] }", "{ y = 2, z = 2 }")}
{joint_table(f"joint{i}", parent, f"beam{i}", "revolute")}
{node}
placement = {{ xyz = [0.0, 0.0, 0.0], rpy = [0.3, 0.2, 0.1] }}
"""
    return robot_from_toml(text + ENDS[end].format(last=f"beam{links}"))


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


EXACT = PRECISIONS["float64"]


def random_rows(rng: np.random.Generator, m: int, n: int, density: float) -> Array:
    return np.where(rng.random((m, n)) < density, rng.normal(size=(m, n)), 0.0)


def responses(J: Array, pivots: Array) -> list[Response]:
    """Those of a tree whose mass matrix is diagonal."""
    found = []
    for row in J:
        response = Response()
        for i, x in enumerate(row.tolist()):
            response.put(i, x, x / float(pivots[i]))
        found.append(response)
    return found


def rows_of(J: Array) -> list[Row]:
    return [Row({i: x for i, x in enumerate(row.tolist()) if x}, group="all") for row in J]


@pytest.mark.parametrize("seed", range(6))
def test_multipliers_solve_the_normal_equations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J, pivots, right = random_rows(rng, 7, 16, 0.4), rng.uniform(0.5, 2.0, 16), rng.normal(size=7)
    system = RowSystem(rows_of(J), responses(J, pivots), EXACT)
    found = system.multipliers(lambda r: float(right[r]))
    assert np.allclose(J @ np.diag(1.0 / pivots) @ J.T @ found, right, rtol=1e-11, atol=1e-11)


def test_redundant_rows_have_the_accelerations_of_the_others() -> None:
    """Rows that follow from others, and a row without arms, change no acceleration; multipliers stay finite."""
    rng = np.random.default_rng(3)
    J, pivots = random_rows(rng, 4, 9, 0.7), rng.uniform(0.5, 2.0, 9)
    a = rng.normal(size=9)
    twice = np.vstack([J, J[0] + J[1], 2.0 * J[3], np.zeros(9)])
    system = RowSystem(rows_of(twice), responses(twice, pivots), EXACT)
    found = np.array(system.multipliers(lambda r: float(twice[r] @ a)))
    lone = RowSystem(rows_of(J), responses(J, pivots), EXACT).multipliers(lambda r: float(J[r] @ a))
    assert np.allclose(twice.T @ found, J.T @ lone, rtol=1e-12, atol=1e-12)
    assert found[-1] == 0.0
    assert np.abs(found).max() < 100.0 * np.abs(lone).max()


@pytest.mark.parametrize("seed", range(4))
def test_elastic_rows_with_accelerations_that_stay_unknown(seed: int) -> None:
    """Many rows that end at one body: the system with its accelerations in it has the same solution."""
    rng = np.random.default_rng(seed)
    legs, each, hub = 8, 5, 3
    n = hub + legs * each
    J = np.zeros((legs * each, n))
    for leg in range(legs):
        own = slice(leg * each, (leg + 1) * each)
        J[own, :hub] = rng.normal(size=(each, hub))
        J[own, hub + leg * each : hub + (leg + 1) * each] = rng.normal(size=(each, each))
    A = rng.normal(size=(hub, hub))
    M = np.diag(rng.uniform(0.5, 2.0, n))
    M[:hub, :hub] = A @ A.T + np.eye(hub)
    rows = [elastic_row(dict(enumerate(row.tolist())), 1.0) for row in J]
    found_responses = []
    for row in J:
        response = Response()
        for i, (left, free) in enumerate(zip(row.tolist(), np.linalg.solve(M, row).tolist(), strict=True)):
            response.put(i, left, free)
        found_responses.append(response)
    block = {(i, j): float(M[i, j]) for i in range(hub) for j in range(i, hub)}
    right = rng.normal(size=len(J))
    wanted = np.linalg.solve(np.eye(len(J)) + J @ np.linalg.solve(M, J.T), right)
    for pivots, size in (([], len(J)), ([block], len(J) + hub)):
        system = RowSystem(rows, found_responses, EXACT, pivots)
        assert len(system.unknowns) == size
        assert np.allclose(system.multipliers(lambda r: float(right[r])), wanted, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_elastic_rows_of_any_slope(seed: int) -> None:
    """Slack ones, soft and stiff ones, some that follow from others; against the dense system with 50 digits."""
    rng, n = np.random.default_rng(seed), 6
    J = random_rows(rng, 7, n, 0.7)
    J[4], J[5] = J[0], 2.0 * J[1] - J[2]
    slopes = np.where(rng.random(7) < 0.7, 10.0 ** rng.uniform(-6.0, 8.0, 7), 0.0)
    pivots, a = rng.uniform(0.5, 2.0, n), rng.normal(size=n)
    rows = [
        elastic_row({i: x for i, x in enumerate(r) if x}, s) for r, s in zip(J.tolist(), slopes.tolist(), strict=True)
    ]
    found = np.array(RowSystem(rows, responses(J, pivots), EXACT).multipliers(lambda r: -float(J[r] @ a)))
    with mpmath.workdps(50):
        exact = mpmath.matrix(J)
        M = mpmath.diag(pivots.tolist())
        wanted = mpmath.lu_solve(M + exact.T * mpmath.diag(slopes.tolist()) * exact, M * mpmath.matrix(a))
    assert np.allclose(a + J.T @ found / pivots, np.array(wanted, dtype=float).ravel(), rtol=0.0, atol=1e-11)
    assert (found[slopes == 0.0] == 0.0).all()


@pytest.mark.parametrize("seed", range(4))
def test_elastic_rows_beside_rigid_ones(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 9
    J, pivots, a = random_rows(rng, 6, n, 0.7), rng.uniform(0.5, 2.0, n), rng.normal(size=n)
    slopes = np.array([0.0, 1e-3, 10.0, 1e4])
    rigid, right = rows_of(J[:2]), rng.normal(size=2)
    elastic = [
        elastic_row({i: x for i, x in enumerate(r) if x}, s) for r, s in zip(J[2:].tolist(), slopes, strict=True)
    ]
    goal = np.concatenate([right, np.zeros(4)]) - J @ a
    found = np.array(RowSystem([*rigid, *elastic], responses(J, pivots), EXACT).multipliers(lambda r: float(goal[r])))
    stiff = np.diag(pivots) + J[2:].T @ np.diag(slopes) @ J[2:]
    whole = np.block([[stiff, -J[:2].T], [J[:2], np.zeros((2, 2))]])
    wanted = np.linalg.solve(whole, np.concatenate([pivots * a, right]))[:n]
    assert np.allclose(a + J.T @ found / pivots, wanted, rtol=1e-10, atol=1e-10)


def test_the_order_leaves_a_chain_without_fill() -> None:
    """Of a star, the middle comes last; of a chain, every row couples one other at most when it is eliminated."""
    star = {(0, i): 1.0 for i in range(1, 8)}
    assert elimination_order(range(8), star)[-1] in (0, 7)
    chain = {(i, i + 1): 1.0 for i in range(20)}
    J = [Row({0: 1.0})] * 21
    assert len(J) == 21
    order = elimination_order(range(21), chain)
    left = set(order)
    for r in order:
        left.discard(r)
        assert sum((min(r, s), max(r, s)) in chain for s in left) <= 1
