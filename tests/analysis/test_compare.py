"""Robots side by side: the figures against Pinocchio and simulations, the tool's line against its formula."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis.structures import compare
from eomgen.cli import entry as cli
from eomgen.errors import ArrayError, InputError
from eomgen.motion.ends import default_motion
from eomgen.motion.point_to_point import PointToPoint
from eomgen.motion.tool_path import ToolLine
from eomgen.robot.value import Link, Robot
from eomgen.simulation.run import simulate
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.random_robots import random_robot, seeds

pytestmark = pytest.mark.usefixtures("unoptimised")

KERNELS = ("inverse_dynamics", "kinematics")


def rigid_robots(seed: int) -> list[Robot]:
    """Two different arms with revolute joints, no springs."""
    made = [random_robot(seed + i, (3, 3), rigid=True, types=("revolute",), forces=False) for i in (0, 50)]
    return [replace(robot, name=f"arm{i}") for i, robot in enumerate(made)]


@pytest.mark.parametrize("seed", seeds(0, 1, 3))
def test_peaks_of_rigid_robots_are_those_of_pinocchio(seed: int) -> None:
    """A rigid robot follows the program, so its drives and reactions are those of inverse dynamics along it."""
    robots, goal = rigid_robots(seed), [0.7, -0.5, 0.6]
    found = compare(robots, duration=0.8, goal=goal)
    start = default_motion(robots[0], 0.64, ["joint1.gamma", "joint2.gamma", "joint3.gamma"]).start
    motion = PointToPoint(start, np.array(goal), 0.64)
    for entry, robot in zip(found.entries, robots, strict=True):
        oracle = PinocchioOracle(robot)
        states = list(zip(*motion.at(np.linspace(0.0, 0.8, 1001)), strict=True))
        drives = np.abs([oracle.inverse_dynamics(*state) for state in states]).max(axis=0)
        assert list(entry.drives.values()) == pytest.approx(drives, rel=1e-4)
        support = np.array([oracle.reactions(*state) for state in states])
        for k, pair in enumerate(entry.reactions.values()):
            assert pair[0] == pytest.approx(np.linalg.norm(support[:, k, :3], axis=1).max(), rel=1e-4)
            assert pair[1] == pytest.approx(np.linalg.norm(support[:, k, 3:], axis=1).max(), rel=1e-4)
        assert entry.mass == pytest.approx(sum(link.mass for link in robot.links))
        assert entry.tool_deviation is None
        places = np.array([oracle.frame_pose(state[0], "tcp")[:3, 3] for state in states])
        assert entry.tool_travel == pytest.approx(np.linalg.norm(np.diff(places, axis=0), axis=1).sum(), rel=1e-6)


@pytest.mark.soak
def test_twice_the_stiffness_is_half_the_deviation() -> None:
    soft = eomgen.load_robot("one_link")
    joint = soft.joints[0]
    stiffer = {**joint.coordinates, "x": replace(joint.coordinates["x"], stiffness=2e4)}
    hard = replace(soft, name="hard", joints=(replace(joint, coordinates=stiffer),))
    entries = {entry.robot: entry for entry in compare([soft, hard, replace(soft.rigid(), name="rigid")]).entries}
    alone = simulate(soft, goal=list(default_motion(soft, 1.0, ["joint1.gamma"]).goal)).summary()
    assert entries["one_link"].tool_deviation == pytest.approx(
        (alone["tool_deviation_max"], alone["tool_deviation_end"]), rel=1e-9
    )
    first, second = entries["one_link"].tool_deviation, entries["hard"].tool_deviation
    assert first is not None
    assert second is not None
    assert second[0] == pytest.approx(first[0] / 2, rel=0.15)
    assert entries["rigid"].tool_deviation is None
    assert entries["hard"].drives["joint1.gamma"] == pytest.approx(entries["rigid"].drives["joint1.gamma"], rel=0.02)
    kernel = eomgen.build(soft)
    count = kernel.operations["forward_dynamics"]
    assert entries["one_link"].operations["forward_dynamics"] == (count["mul"], count["add"])


def test_the_tool_moves_along_its_line(built: Build) -> None:
    """Place, velocity and acceleration of the tool are those of the profile on the line, by Pinocchio's kinematics."""
    robot = eomgen.load_robot("puma560").rigid()
    kernel, oracle = built(robot, *KERNELS), PinocchioOracle(robot)
    begin, end = np.array([0.4, 0.25, 0.2]), np.array([0.45, -0.2, 0.4])
    limits = np.tile([-np.inf, np.inf], (6, 1))
    line = ToolLine(kernel, "tcp", begin, end, 0.8, guess=np.full(6, 0.3), limits=limits)
    profile = PointToPoint(begin, end, 0.8)
    times, dt = np.linspace(0.0, 1.0, 41), 1e-5
    q, v, a = line.at(times)
    x, dx, ddx = profile.at(times)
    for i, t in enumerate(times):
        assert np.abs(oracle.frame_pose(q[i], "tcp")[:3, 3] - x[i]).max() < 1e-7
        assert np.abs(oracle.frame_jacobian(q[i], "tcp")[:3] @ v[i] - dx[i]).max() < 1e-5
        if dt < t < 0.8 - dt or t > 0.8 + dt:
            ahead, behind = line.at(t + dt)[1], line.at(t - dt)[1]
            assert np.abs((ahead - behind) / (2 * dt) - a[i]).max() < 1e-5 * max(1.0, np.abs(a).max())
    assert np.array_equal(line.start, q[0])
    assert np.abs(ddx[0]).max() == np.abs(a[0]).max() == 0.0


@pytest.mark.soak
def test_a_line_for_different_structures() -> None:
    """An arm of three joints and one of six; the tool's path has one length."""
    puma = eomgen.load_robot("puma560")
    locked = tuple(replace(j, type="fixed", coordinates={}, limits=None) for j in puma.joints[3:])
    robots = [eomgen.load_robot("ur5"), replace(puma, name="three", joints=(*puma.joints[:3], *locked))]
    line = ([0.4, 0.2, 0.2], [0.4, -0.1, 0.3])
    found = compare(robots, duration=0.5, line=line)
    for entry in found.entries:
        assert entry.tool_travel == pytest.approx(np.hypot(0.3, 0.1), rel=1e-5)
        assert max(entry.drives.values()) > 1.0
    assert [len(entry.drives) for entry in found.entries] == [6, 3]
    text = "\n".join(found.lines())
    for words in ("tool along the line (0.4, 0.2, 0.2)", "support moment joint3 [N m]", "drive joint6.gamma [N m]"):
        assert words in text


def test_wrong_input_is_said(built: Build) -> None:
    ur5, puma, rod = (eomgen.load_robot(name) for name in ("ur5", "puma560", "one_link"))
    for robots, options, words in (
        ([ur5], {}, "two or more"),
        ([ur5, ur5], {}, "different names"),
        ([ur5, rod], {}, "one_link has principal coordinates in rad, ur5 in rad, rad"),
        ([ur5, puma], {"goal": [0.0] * 6, "line": ([0, 0, 0], [1, 0, 0])}, "both set"),
        ([ur5, puma], {"goal": [0.0] * 5}, "6 numbers"),
        ([ur5, puma], {"line": ([9, 0, 0], [1, 0, 0])}, r"ur5_rigid: tcp does not reach \(9, 0, 0\) m"),
        ([ur5, puma], {"line": ([0.4, 0, 0.3], [5, 0, 0.3])}, "cannot follow the line"),
        ([ur5, puma], {"line": ([0.4, 0, 0], [0.4, 0, 0])}, "two different points"),
        ([ur5, puma], {"tool": "hand", "line": ([0.4, 0, 0.3], [0.4, 0.1, 0.3])}, "'hand' is unknown"),
    ):
        with pytest.raises(InputError, match=words):
            compare(robots, duration=0.5, **options)  # type: ignore[arg-type]
    kernel = built(ur5.rigid(), *KERNELS)
    with pytest.raises(ArrayError, match="three finite numbers"):
        ToolLine(kernel, "tcp", [0.4, np.nan, 0.1], [0.4, 0.1, 0.1], 1.0, guess=np.zeros(6), limits=np.zeros((6, 2)))
    limits = np.tile([-0.1, 0.1], (6, 1))
    with pytest.raises(InputError, match="ur5_rigid: tcp does not reach"):
        ToolLine(kernel, "tcp", [0.4, 0.1, 0.2], [0.4, -0.2, 0.3], 1.0, guess=np.zeros(6), limits=limits)
    with pytest.raises(InputError, match="motion stands beside start or goal"):
        simulate(rod, motion=PointToPoint(np.zeros(1), np.ones(1), 1.0), goal=[1.0])


@pytest.mark.soak
def test_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["compare", "ur5", "puma560", "--duration", "0.4", "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert [entry["robot"] for entry in plain["robots"]] == ["ur5", "puma560"]
    assert set(plain["robots"][0]["drives"]) == {f"joint{i}.gamma" for i in range(1, 7)}
    assert cli.main(["compare", "ur5", "puma560", "--line", "9", "0", "0", "0", "0", "0"]) == 1
    assert "does not reach" in capsys.readouterr().err


@pytest.mark.soak
def test_closed_mechanisms(capsys: pytest.CaptureFixture[str]) -> None:
    """Twice the masses take twice the forces, and the same motion; a line of the tool is refused in words."""
    one = eomgen.load_robot("four_bar")
    other = replace(one, name="heavier", links=tuple(twice(link) for link in one.links))
    light, heavy = compare([one, other], duration=0.05).entries
    assert light.tool_travel == pytest.approx(heavy.tool_travel, rel=1e-9)
    assert heavy.reactions["joint1"][0] == pytest.approx(2.0 * light.reactions["joint1"][0], rel=1e-4)
    assert heavy.drives["joint1.gamma"] == pytest.approx(2.0 * light.drives["joint1.gamma"], rel=1e-4)
    with pytest.raises(InputError, match=r"line: 'four_bar' is closed by loops or couplings; allowed: a goal"):
        compare([one, "one_link"], line=([0.5, 0.0, 0.5], [0.5, 0.1, 0.5]))
    assert cli.main(["compare", "four_bar", "ur5", "--line", "9", "0", "0", "0", "0", "0"]) != 0
    assert "closed by loops" in capsys.readouterr().err


def twice(link: Link) -> Link:
    return replace(link, mass=2.0 * link.mass, inertia=tuple(2.0 * x for x in link.inertia))
