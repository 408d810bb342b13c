"""Random closed mechanisms against Pinocchio, and against another cut of the same one; a ladder in closed form."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import null_space

import eomgen
from benchmarks.ladder import GRAVITY, ladder, ladder_state
from eomgen.names import joint_of
from eomgen.robot.joint_types import CUTS
from eomgen.robot.model import build_model
from tests.oracles.by_singular_values import ClosedLoops
from tests.oracles.closed_mechanisms import NO_WRENCH, RANK, ROWS, SIZES, Closed, ClosedOracle, Wrench
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.linkages import KERNELS
from tests.support.random_mechanisms import Mechanism, mechanism
from tests.support.random_robots import Array, seeds
from tests.support.recuts import recuts

CHECKED = ("forward_dynamics", "constraint_forces")
USED = (*(name for name in KERNELS if name not in ("energy", "kinematics")), "external_force", *CHECKED)


def closed_dynamics(kernel: eomgen.Kernel, q: Array, v: Array, u: Array, wrench: Wrench = NO_WRENCH) -> Closed:
    """Accelerations, multipliers and wrenches in the cuts of one state, with the loops closed.

    The one place that says which of this project's functions tests of random mechanisms check.
    """
    outside = np.array([wrench.get(name, np.zeros(6)) for name in kernel.links]) if wrench else None
    a = kernel.forward_dynamics(q, v, u, wrench=outside)
    multipliers = kernel.constraint_forces(q, v, u, wrench=outside)
    loops = ClosedLoops(kernel)
    undetermined = loops.redundancy(q).undetermined
    unique = np.array([name not in undetermined for name in kernel.constraints])
    return Closed(a, multipliers, unique, loops.reactions(q, multipliers))


pytestmark = pytest.mark.usefixtures("unoptimised")

LIMIT = 1e-10  # relative to the greatest number of the result
DRIVEN = 1e-8  # the same of a motion's drives, which are found by least squares
CLOSING = ("constraint", "constraint_jacobian", "inverse_dynamics")


def relative(found: Array, expected: Array, size: float | None = None) -> float:
    if size is None:
        size = float(np.abs(expected).max(initial=0.0))
    return float(np.abs(found - expected).max(initial=0.0)) / max(size, 1e-12)


def compare(found: Closed, expected: Closed, oracle: ClosedOracle, m: Mechanism, figures: Figures) -> None:
    """Accelerations, and multipliers and wrenches where rigid bodies determine them."""
    figures.at_most("accelerations", relative(found.a, expected.a), LIMIT)
    assert np.array_equal(found.unique, expected.unique), "which multipliers are unique"
    J = oracle.constraint(m.q, m.v)[1]
    size = float(np.abs(expected.multipliers).max())
    unique = expected.unique
    figures.at_most("multipliers", relative(found.multipliers[unique], expected.multipliers[unique], size), LIMIT)
    figures.at_most("forces of the cuts", relative(J.T @ found.multipliers, J.T @ expected.multipliers), LIMIT)
    whole = _whole(m, unique)
    size = float(np.abs(expected.reactions).max())
    figures.at_most("wrenches", relative(found.reactions[whole], expected.reactions[whole], size), LIMIT)
    figures.count("mechanisms")
    figures.count("loops", len(whole))
    figures.count("loops with redundant rows", len(whole) - sum(whole))
    figures.count("prescribed coordinates", int((~oracle.free).sum()))


def _whole(m: Mechanism, unique: Array) -> list[bool]:
    """Whether all multipliers of a loop are unique, of every loop."""
    rows = np.cumsum([0, *(len(ROWS[loop.type]) for loop in m.robot.loops)])
    return [bool(unique[a:b].all()) for a, b in pairwise(rows)]


@pytest.mark.parametrize("number", [8, *seeds(0, 0, 500)])
def test_pinocchio_says_the_same(number: int, built: Build, figures: Figures) -> None:
    m = mechanism(number)
    oracle = ClosedOracle(m.robot)
    found = closed_dynamics(built(m.robot, *USED), m.q, m.v, m.u, m.wrench)
    compare(found, oracle.solve(m.q, m.v, m.u, m.wrench), oracle, m, figures)


@pytest.mark.soak
@pytest.mark.parametrize("number", seeds(6, 1, 500))
def test_another_cut_says_the_same(number: int, built: Build, figures: Figures) -> None:
    """The joint that is cut there takes no drive; all others move as before, and the new cut carries what it has to."""
    m = mechanism(number, ("revolute",), wanted=lambda robot: any(recuts(robot)))
    others = list(recuts(m.robot))
    other = others[number % len(others)]
    names, first = build_model(m.robot).coordinates, ClosedOracle(m.robot)
    u = m.u.copy()
    u[names.index(other.cut)] = 0.0
    angle, rate = (other.sense * x for x in first.turn(m.q, m.v, joint_of(other.kept)))
    q, v, drives = (other.spread(names, *x) for x in ((m.q, angle), (m.v, rate), (u, 0.0)))
    second, kernel = ClosedOracle(other.robot), built(other.robot, *USED)
    assert np.abs(second.constraint(q, v)[0]).max() <= 1e-14
    assert np.abs(second.constraint(q, v)[1] @ v).max() <= 1e-13
    found = closed_dynamics(kernel, q, v, drives, m.wrench)
    one, again = first.solve(m.q, m.v, u, m.wrench), second.solve(q, v, drives, m.wrench)
    expected = other.spread(names, one.a, np.nan)
    shared = ~np.isnan(expected)
    figures.at_most("accelerations by another cut", relative(found.a[shared], expected[shared]), LIMIT)
    compare(found, again, second, Mechanism(m.family, other.robot, q, v, drives), figures)
    if again.unique.all():
        place = [loop.name for loop in other.robot.loops].index(joint_of(other.cut))
        joints = [joint.name for joint in m.robot.joints if joint.coordinates]
        carried = first.reactions(m.q, m.v, one, m.wrench)[joints.index(joint_of(other.cut))]
        figures.at_most("wrench in the joint that is cut", relative(found.reactions[place], carried), LIMIT)
        figures.count("mechanisms without redundant rows")


@pytest.mark.parametrize("number", seeds(9, 1, 500))
def test_reactions_of_a_motion_by_as_many_drives_as_freedoms(number: int, built: Build, figures: Figures) -> None:
    """The drives that make a motion, and what the cuts and all other joints bear in it, where they are unique."""
    m = mechanism(number, wanted=lambda robot: not any(joint.motor for joint in robot.joints))
    oracle, names = ClosedOracle(m.robot), build_model(m.robot).coordinates
    moved = _drives(oracle.constraint(m.q, m.v)[1], oracle.free)
    u = np.where(oracle.free & ~moved, 0.0, m.u)
    expected = oracle.solve(m.q, m.v, u, m.wrench)
    driven = tuple(name for name, moves in zip(names, moved, strict=True) if moves)
    kernel = built(
        replace(m.robot, driven=driven), *CLOSING, "loop_reactions", "reactions", "external_force", "external_reactions"
    )
    wrench = np.array([m.wrench.get(name, np.zeros(6)) for name in kernel.links]) if m.wrench else None
    found = kernel.inverse_dynamics(m.q, m.v, expected.a, wrench=wrench)
    figures.at_most(
        "drives", relative(found[moved], u[moved], float(np.abs(oracle.forces(m.q, m.v, expected.a)).max())), DRIVEN
    )
    carried, size = kernel.loop_reactions(m.q, m.v, expected.a, wrench=wrench), float(np.abs(expected.reactions).max())
    whole = _whole(m, expected.unique)
    figures.at_most("wrenches in cuts", relative(carried[whole], expected.reactions[whole], size), DRIVEN)
    figures.count("loops", int(sum(whole)))
    if expected.unique.all():
        joints = oracle.reactions(m.q, m.v, expected, m.wrench)
        figures.at_most(
            "wrenches in joints", relative(kernel.reactions(m.q, m.v, expected.a, wrench=wrench), joints), DRIVEN
        )
        figures.count("mechanisms without redundant rows")


def _drives(J: Array, free: Array) -> Array:
    """Free coordinates, (n,), as many as there are freedoms, that hold the mechanism as well as any."""
    left, found = null_space(J[:, free], RANK).T, np.zeros(len(free), bool)
    for _ in range(len(left)):
        best = int(np.linalg.norm(left, axis=0).argmax())
        found[np.flatnonzero(free)[best]] = True
        unit = left[:, best] / np.linalg.norm(left[:, best])
        left = left - np.outer(unit, unit @ left)
    return found


@pytest.mark.parametrize("number", seeds(0, 5, 100))
def test_the_oracle_agrees_with_pinocchios_own_solver(number: int, figures: Figures) -> None:
    """Its constraintDynamics knows spherical and fixed cuts; wrenches where they are unique."""
    m = mechanism(number, tuple(SIZES), plain=True)
    oracle = ClosedOracle(m.robot)
    found = oracle.solve(m.q, m.v, m.u)
    a, wrenches = oracle.by_pinocchio(m.q, m.v, m.u)
    figures.at_most("accelerations, constraintDynamics", relative(a, found.a), LIMIT)
    if found.unique.all():
        figures.at_most("wrenches, constraintDynamics", relative(wrenches, found.reactions), LIMIT)
        figures.count("mechanisms without redundant rows")


@pytest.mark.soak
def test_the_mechanisms_are_of_all_kinds(figures: Figures) -> None:
    """Every cut type, law, motor, spring, size of a joint, in loops with and without redundant rows."""
    kinds, sizes, n = set(), set(), []
    for number in range(500):
        m = mechanism(number)
        n.append(len(m.q))
        figures.count("wrenches on links", len(m.wrench))
        kinds |= {loop.type for loop in m.robot.loops} | {"spring" for _ in m.robot.springs}
        for joint in m.robot.joints:
            sizes.add(len(joint.coordinates))
            kinds |= {"motor"} if joint.motor else set()
            kinds |= {key.split(".")[0] for c in joint.coordinates.values() for key in c.law()}
            kinds |= {"prescribed" for c in joint.all_coordinates.values() if c.prescribed}
        figures.count(m.family)
    assert kinds >= {*CUTS, "spring", "motor", "prescribed", "friction", "clearance", "curve", "preload", "cubic"}
    assert sizes == {0, 1, 2, 3, 4, 5, 6}
    assert (min(n), max(n)) == (3, 14)


@pytest.mark.soak
@pytest.mark.parametrize("windows", [1, 3])
def test_a_ladder_moves_as_one_upright_does(windows: int, built: Build) -> None:
    """N + 1 uprights turn and N bars go round without turning: ((N + 1) / 3 + N) theta'' = -g ((N + 1) / 2 + N) cos."""
    kernel, angle = built(ladder(windows), *USED), 1.2
    q, v = ladder_state(windows, angle, 0.7)
    found = closed_dynamics(kernel, q, v, np.zeros(kernel.n))
    uprights = windows + 1
    expected = -GRAVITY * (uprights / 2 + windows) * np.cos(angle) / (uprights / 3 + windows)
    assert np.abs(found.a - ladder_state(windows, angle, expected)[1]).max() <= 1e-12 * abs(expected)
