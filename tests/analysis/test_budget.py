"""What deviations contribute, by Pinocchio's Jacobians; robots compared, by Pinocchio and simulations."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.analysis.structures import compare
from eomgen.analysis.tool_budget import budget
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.integration.trajectory import Trajectory
from eomgen.motion.ends import default_motion
from eomgen.motion.point_to_point import PointToPoint
from eomgen.motion.tool_path import ToolLine
from eomgen.names import joint_of, kind_of
from eomgen.robot.coordinates import index_of
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Robot
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import simulate
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.commands import command, errors_of, facts
from tests.support.random_robots import Array, random_robot, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")


def made_up(robot: Robot, seed: int, size: float) -> SimulationResult:
    """A result of that robot with smooth deviations of a size, not simulated; poses by Pinocchio."""
    names, oracle = build_model(robot).coordinates, PinocchioOracle(robot)
    driven = build_model(robot.rigid()).coordinates
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 2.0, 41)
    program = np.zeros((41, len(names)))
    program[:, index_of(names, driven)] = np.sin(np.outer(t, rng.uniform(0.3, 1.0, len(driven))))
    q = program + size * np.cos(np.outer(t, rng.uniform(1.0, 5.0, len(names))) + rng.uniform(0, 6, len(names)))
    pose, ideal = (np.array([oracle.frame_pose(x, "tcp") for x in rows]) for rows in (q, program))
    return result_of(robot, t, q, driven, program[:, index_of(names, driven)], pose, ideal)


def result_of(
    robot: Robot, t: Array, q: Array, driven: tuple[str, ...], program: Array, *poses: Array
) -> SimulationResult:
    """A result with a motion, a program of driven coordinates, and poses of the tool: attained, and of the program."""
    motion = Trajectory(t, q, 0 * q, 0 * q, np.zeros((t.size, 2)), build_model(robot).coordinates, "none")
    more = {"tool": "tcp", "pose": poses[0], "program_pose": poses[1], "notes": (), "versions": MappingProxyType({})}
    return SimulationResult(robot=robot.name, trajectory=motion, program_coordinates=driven, program_q=program, **more)


@pytest.mark.parametrize("seed", seeds(0, 1, 6))
def test_random_robots(seed: int, built: Build) -> None:
    """Contributions are Pinocchio's columns times the deviations, and what is left falls with their square."""
    robot = random_robot(seed, joints=(2, 3), tree=seed % 2 == 0, types=("revolute", "prismatic"))
    kernel, oracle = built(robot, "kinematics"), PinocchioOracle(robot)
    left: list[Array] = []
    for size in (1e-3, 5e-4):
        result = made_up(robot, seed, size)
        found = budget(result, robot, kernel=kernel)
        motion = result.trajectory
        program = np.zeros_like(motion.q)
        program[:, index_of(motion.coordinates, result.program_coordinates)] = result.program_q
        for k in (0, 13, 40):
            J = oracle.frame_jacobian(program[k], "tcp")
            assert found.contributions[k] == pytest.approx((J * (motion.q - program)[k]).T, abs=1e-14)
            turn = Rotation.from_matrix(result.pose[k, :3, :3] @ result.program_pose[k, :3, :3].T).as_rotvec()
            assert found.deviation[k, 3:] == pytest.approx(turn, abs=1e-12)
        assert found.deviation[:, :3] == pytest.approx(result.tool_deviation, abs=1e-13)
        left.append(np.abs(found.remainder).max(axis=0))
        for part in ("displacement", "rotation"):
            rows = found.table(part)
            if found.deviation[:, :3].any() and part == "displacement":
                assert sum(row.share for row in rows) == pytest.approx(1.0)
            assert [row.rms for row in rows[:-1]] == sorted((row.rms for row in rows[:-1]), reverse=True)
            by_joint = found.table(part, "joint")
            assert sum(row.share for row in by_joint) == pytest.approx(sum(row.share for row in rows))
            assert {row.name for row in by_joint[:-1]} == {name.partition(".")[0] for name in found.coordinates}
        joints = found.joints()
        assert sum(joints.values()) == pytest.approx(found.contributions.sum(axis=1), abs=1e-15)
    big = left[0] > 1e-9
    assert left[0].max() < 1e-5 * 20
    assert left[1][big] == pytest.approx(left[0][big] / 4, rel=0.05)


def test_rows_have_closed_forms() -> None:
    """One coordinate that moves as s = c t: rms c / sqrt(3), peak at the end, share 1."""
    robot = eomgen.load_robot("one_link")
    t = np.linspace(0.0, 1.0, 2001)
    q = np.stack([1e-4 * t, np.zeros_like(t)], axis=1)
    pose = np.tile(np.eye(4), (t.size, 1, 1))
    pose[:, 0, 3] = 1.0
    moved = pose.copy()
    moved[:, 0, 3] += q[:, 0]
    result = result_of(robot, t, q, ("joint1.gamma",), np.zeros((t.size, 1)), moved, pose)
    found = budget(result, robot)
    x, gamma, left = found.table()
    assert (x.name, gamma.name, left.name) == ("joint1.x", "joint1.gamma", "remainder")
    assert x.rms == pytest.approx(1e-4 / np.sqrt(3.0), rel=1e-6)
    assert (x.peak, x.peak_at, x.share) == pytest.approx((1e-4, 1.0, 1.0))
    assert (gamma.rms, gamma.share) == (0.0, 0.0)
    assert left.rms < 1e-15
    rows = found.as_rows()
    columns = {column.name: column.values for column in rows.columns}
    assert np.array_equal(rows.values, t)
    assert list(columns) == ["deviation", "joint1.x", "joint1.gamma", "remainder"]
    for name in ("deviation", "joint1.x"):
        assert columns[name][:, 0] == pytest.approx(1e-4 * t, abs=1e-15)


def test_a_budget_has_links_that_bend() -> None:
    """Contributions of modes are first differences of poses; those of a link stand apart from those of its joint."""
    robot = eomgen.load_robot("flexible_arm")
    kernel = eomgen.build(robot, kernels=("kinematics",))
    names, t = kernel.coordinates, np.linspace(0.0, 1.0, 21)
    driven = ("shoulder.gamma", "elbow.gamma")
    left = []
    for size in (1e-3, 5e-4):
        rng, program = np.random.default_rng(0), np.zeros((21, len(names)))
        program[:, index_of(names, driven)] = np.sin(np.outer(t, [0.5, 0.9]))
        q = program + size * np.cos(np.outer(t, rng.uniform(1.0, 5.0, len(names))))
        pose, ideal = (np.asarray(kernel.frame_pose(x, "tcp")) for x in (q, program))
        result = result_of(robot, t, q, driven, program[:, index_of(names, driven)], pose, ideal)
        found = budget(result, robot, kernel=kernel)
        left.append(np.abs(found.remainder).max())
        for k, name in enumerate(names):
            if kind_of(name).startswith("mode"):
                off = np.zeros_like(q)
                off[:, k] = (q - program)[:, k]
                ends = [np.asarray(kernel.frame_pose(program + 0.5 * sense * off, "tcp")) for sense in (1.0, -1.0)]
                moved = (ends[0] - ends[1])[:, :3, 3]
                assert found.contributions[:, k, :3] == pytest.approx(moved, rel=2e-5, abs=1e-12), name
        by_owner = found.joints()
        for owner, own in (("upper.modes", "upper"), ("forearm.modes", "forearm")):
            columns = [k for k, name in enumerate(names) if joint_of(name) == own]
            assert by_owner[owner] == pytest.approx(found.contributions[:, columns].sum(axis=1))
        assert sum(by_owner.values()) + found.remainder == pytest.approx(found.deviation, abs=1e-15)
        assert sum(row.share for row in found.table("displacement", "joint")) == pytest.approx(1.0)
    assert left[1] == pytest.approx(0.25 * left[0], rel=0.05)


@pytest.mark.soak
def test_a_simulation_is_explained() -> None:
    """The shares of a simulated elastic arm add up, and the remainder is of second order."""
    robot = eomgen.load_robot("shaken_arm")
    joints = tuple(replace(j, coordinates={} if j.name == "mount" else j.coordinates) for j in robot.joints)
    robot = replace(robot, name="standing_arm", joints=joints)
    result = simulate(robot, duration=0.4)
    found = budget(result, robot)
    assert found.deviation[:, :3] == pytest.approx(result.tool_deviation, abs=1e-12)
    rows = found.table()
    assert sum(row.share for row in rows) == pytest.approx(1.0)
    largest = np.linalg.norm(found.deviation[:, :3], axis=1).max()
    assert rows[-1].peak < 20 * largest**2
    assert rows[0].name in ("shoulder.beta", "shoulder.gamma", "elbow.gamma", "shoulder.alpha")
    other = budget(result, robot, frame="link2")
    assert np.array_equal(other.contributions[:, found.coordinates.index("elbow.gamma")], np.zeros((len(found.t), 6)))


@pytest.mark.soak
def test_a_closed_mechanism_is_explained() -> None:
    """An elastic crank joint moves the coupler by what follows it in the loop: little is left, of second order."""
    robot = eomgen.load_robot("four_bar")
    pivot = replace(robot.joints[2], coordinates={**robot.joints[2].coordinates, "x": Coordinate(2e4, 50.0)})
    soft = replace(robot, name="soft_four_bar", joints=(*robot.joints[:2], pivot))
    result = simulate(soft, duration=0.3)
    found = budget(result, soft)
    assert result.passive == ("joint2.gamma", "joint3.gamma")
    size = np.linalg.norm(found.deviation[:, :3], axis=1).max()
    assert size > 1e-6
    assert np.linalg.norm(found.remainder[:, :3], axis=1).max() < 1e-3 * size
    rows = {row.name: row for row in found.table()}
    assert rows["joint3.x"].share > 0.9
    assert rows["joint3.x"].share + rows["joint1.gamma"].share == pytest.approx(1.0, abs=2e-3)  # and the drive's error
    assert rows["joint2.gamma"].rms < 3e-3 * rows["joint3.x"].rms


def test_input_that_is_refused() -> None:
    robot = eomgen.load_robot("one_link")
    result = made_up(robot, 0, 1e-4)
    for call, kind, words in (
        (lambda: budget(result, eomgen.load_robot("ur5")), InputError, "has not the coordinates of ur5"),
        (lambda: budget(result, robot, frame="hand"), UnknownNameError, "'hand' is unknown"),
        (lambda: budget(result, robot).table("speed"), InputError, "allowed: displacement, rotation"),
        (lambda: budget(result, robot).table(by="link"), InputError, "allowed: coordinate, joint"),
    ):
        refused(kind, words, call)
    changed = replace(robot, frames=(replace(robot.frames[0], placement=eomgen.Placement((0.9, 0.0, 0.0))),))
    assert "have changed since" in budget(result, changed).notes[0]


@pytest.mark.soak
def test_command(tmp_path: Path) -> None:
    path = simulate(eomgen.load_robot("one_link"), duration=0.2).save(tmp_path / "trajectory.npz")
    figure = tmp_path / "budget.svg"
    text = command("budget", path, "-o", figure)
    for words in ("joint1.x", "remainder", "share", "displacement: rms"):
        assert words in text
    assert re.search(r"displacement, [mun]m", figure.read_text())
    assert facts("budget", path, "--frame", "link1")["frame"] == "link1"
    assert "has not the coordinates" in errors_of("budget", path, "--robot", "ur5")
    other = simulate(replace(eomgen.load_robot("one_link"), name="mine"), duration=0.1)
    assert "give --robot" in errors_of("budget", other.save(tmp_path / "other.npz"))


# Robots side by side


NEEDED = ("inverse_dynamics", "kinematics")


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
    alone = (alone["tool_deviation_max"], alone["tool_deviation_end"])
    assert entries["one_link"].tool_deviation == pytest.approx(alone, rel=1e-9)
    first, second = entries["one_link"].tool_deviation, entries["hard"].tool_deviation
    assert second[0] == pytest.approx(first[0] / 2, rel=0.15)
    assert entries["rigid"].tool_deviation is None
    assert entries["hard"].drives["joint1.gamma"] == pytest.approx(entries["rigid"].drives["joint1.gamma"], rel=0.02)
    kernel = eomgen.build(soft)
    count = kernel.operations["forward_dynamics"]
    assert entries["one_link"].operations["forward_dynamics"] == (count["mul"], count["add"])


def test_the_tool_moves_along_its_line(built: Build) -> None:
    """Place, velocity and acceleration of the tool are those of the profile on the line, by Pinocchio's kinematics."""
    robot = eomgen.load_robot("puma560").rigid()
    kernel, oracle = built(robot, *NEEDED), PinocchioOracle(robot)
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
        refused(InputError, words, compare, robots, duration=0.5, **options)
    kernel, limits = built(ur5.rigid(), *NEEDED), np.tile([-0.1, 0.1], (6, 1))
    moved = PointToPoint(np.zeros(1), np.ones(1), 1.0)
    more = {"guess": np.zeros(6), "limits": limits}
    for call, kind, words in (
        (
            lambda: ToolLine(kernel, "tcp", [0.4, np.nan, 0.1], [0.4, 0.1, 0.1], 1.0, **more),
            ArrayError,
            "three finite numbers",
        ),
        (
            lambda: ToolLine(kernel, "tcp", [0.4, 0.1, 0.2], [0.4, -0.2, 0.3], 1.0, **more),
            InputError,
            "ur5_rigid: tcp does not reach",
        ),
        (lambda: simulate(rod, motion=moved, goal=[1.0]), InputError, "motion stands beside start or goal"),
    ):
        refused(kind, words, call)


@pytest.mark.soak
def test_compare_command() -> None:
    plain = facts("compare", "ur5", "puma560", "--duration", 0.4)
    assert [entry["robot"] for entry in plain["robots"]] == ["ur5", "puma560"]
    assert set(plain["robots"][0]["drives"]) == {f"joint{i}.gamma" for i in range(1, 7)}
    assert "does not reach" in command("compare", "ur5", "puma560", "--line", 9, 0, 0, 0, 0, 0, code=1)


@pytest.mark.soak
def test_closed_mechanisms() -> None:
    """Twice the masses take twice the forces, and the same motion; a line of the tool is refused in words."""
    one = eomgen.load_robot("four_bar")
    heavier = (replace(x, mass=2.0 * x.mass, inertia=tuple(2.0 * i for i in x.inertia)) for x in one.links)
    other = replace(one, name="heavier", links=tuple(heavier))
    light, heavy = compare([one, other], duration=0.05).entries
    assert light.tool_travel == pytest.approx(heavy.tool_travel, rel=1e-9)
    assert heavy.reactions["joint1"][0] == pytest.approx(2.0 * light.reactions["joint1"][0], rel=1e-4)
    assert heavy.drives["joint1.gamma"] == pytest.approx(2.0 * light.drives["joint1.gamma"], rel=1e-4)
    with pytest.raises(InputError, match=r"line: 'four_bar' is closed by loops or couplings; allowed: a goal"):
        compare([one, "one_link"], line=([0.5, 0.0, 0.5], [0.5, 0.1, 0.5]))
    assert "closed by loops" in command("compare", "four_bar", "ur5", "--line", 9, 0, 0, 0, 0, 0, code=1)
