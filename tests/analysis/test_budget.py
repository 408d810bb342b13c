"""What deviations contribute: exact sums, Pinocchio's Jacobians, the order of the remainder."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.analysis.tool_budget import budget
from eomgen.cli import entry as cli
from eomgen.errors import InputError, UnknownNameError
from eomgen.integration.trajectory import Trajectory
from eomgen.robot.coordinates import index_of
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Robot
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import simulate
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, seeds

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
    motion = Trajectory(t, q, 0 * q, 0 * q, np.zeros((41, 2)), names, "none")
    program_q = program[:, index_of(names, driven)]
    return SimulationResult(
        robot=robot.name,
        trajectory=motion,
        program_coordinates=driven,
        program_q=program_q,
        tool="tcp",
        pose=pose,
        program_pose=ideal,
        notes=(),
        versions=MappingProxyType({}),
    )


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
    motion = Trajectory(t, q, 0 * q, 0 * q, np.zeros((t.size, 2)), build_model(robot).coordinates, "none")
    moved = pose.copy()
    moved[:, 0, 3] += q[:, 0]
    program = np.zeros((t.size, 1))
    result = SimulationResult(
        robot="one_link",
        trajectory=motion,
        program_coordinates=("joint1.gamma",),
        program_q=program,
        tool="tcp",
        pose=moved,
        program_pose=pose,
        notes=(),
        versions=MappingProxyType({}),
    )
    found = budget(result, robot)
    x, gamma, left = found.table()
    assert (x.name, gamma.name, left.name) == ("joint1.x", "joint1.gamma", "remainder")
    assert x.rms == pytest.approx(1e-4 / np.sqrt(3.0), rel=1e-6)
    assert (x.peak, x.peak_at, x.share) == pytest.approx((1e-4, 1.0, 1.0))
    assert (gamma.rms, gamma.share) == (0.0, 0.0)
    assert left.rms < 1e-15


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
    with pytest.raises(InputError, match="has not the coordinates of ur5"):
        budget(result, eomgen.load_robot("ur5"))
    with pytest.raises(UnknownNameError, match="'hand' is unknown"):
        budget(result, robot, frame="hand")
    with pytest.raises(InputError, match="allowed: displacement, rotation"):
        budget(result, robot).table("speed")
    with pytest.raises(InputError, match="allowed: coordinate, joint"):
        budget(result, robot).table(by="link")
    changed = replace(robot, frames=(replace(robot.frames[0], placement=eomgen.Placement((0.9, 0.0, 0.0))),))
    assert "have changed since" in budget(result, changed).notes[0]


@pytest.mark.soak
def test_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = str(simulate(eomgen.load_robot("one_link"), duration=0.2).save(tmp_path / "trajectory.npz"))
    figure = tmp_path / "budget.svg"
    assert cli.main(["budget", path, "-o", str(figure)]) == 0
    text = capsys.readouterr().out
    for words in ("joint1.x", "remainder", "share", "displacement: rms"):
        assert words in text
    assert re.search(r"displacement, [mun]m", figure.read_text())
    assert cli.main(["budget", path, "--json", "--frame", "link1"]) == 0
    assert json.loads(capsys.readouterr().out)["frame"] == "link1"
    assert cli.main(["budget", path, "--robot", "ur5"]) == 1
    assert "has not the coordinates" in capsys.readouterr().err
    other = replace(eomgen.load_robot("one_link"), name="mine")
    path = str(simulate(other, duration=0.1).save(tmp_path / "other.npz"))
    assert cli.main(["budget", path]) == 1
    assert "give --robot" in capsys.readouterr().err
