"""Inverse kinematics of kernels, of trees and closed mechanisms, by Pinocchio's forward kinematics and by closure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, DescriptionError, InputError, ReachError, UnknownNameError
from eomgen.motion import inverse_kinematics
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]


def limited(robot: eomgen.Robot, size: float) -> eomgen.Robot:
    joints = [replace(x, limits=(-size, size)) if x.coordinates else x for x in robot.joints]
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("seed", seeds(0, 2, 12))
def test_random_arms_reach_random_poses(seed: int, built: Build) -> None:
    drawn = random_robot(seed, types=("revolute", "prismatic"), rigid=True, forces=False, counts=[1] * (5 + seed % 3))
    robot = limited(drawn, 2.5)
    kernel, oracle, rng = built(robot, "kinematics"), PinocchioOracle(robot), np.random.default_rng(seed)
    assert kernel.limits == dict.fromkeys(kernel.coordinates, (-2.5, 2.5))
    there = rng.uniform(-2.3, 2.3, (2, 3, kernel.n))
    poses = np.array([[oracle.frame_pose(q, "tcp") for q in row] for row in there])
    q = kernel.inverse_kinematics(poses, "tcp", q0=there + 0.1)
    assert q.shape == there.shape
    assert (np.abs(q) <= 2.5 + 1e-9).all()
    for solution, pose in zip(q.reshape(-1, kernel.n), poses.reshape(-1, 4, 4), strict=True):
        assert np.abs(oracle.frame_pose(solution, "tcp") - pose).max() < 1e-10
    points = kernel.inverse_kinematics(poses[0, :, :3, 3], q0=np.zeros(kernel.n))
    found = kernel.frame_pose(points, "tcp")[:, :3, 3]
    assert np.abs(found - poses[0, :, :3, 3]).max() < 1e-10
    assert np.array_equal(inverse_kinematics(kernel, poses, robot=robot, guess=there + 0.1), q)


@pytest.mark.parametrize("number", seeds(0, 1, 40))
def test_closed_mechanisms_reach_poses_that_they_have(number: int, built: Build) -> None:
    m = mechanism(number)
    kernel, rng = built(m.robot), np.random.default_rng(number)
    frame = kernel.frames[-1]
    moving = [name for name in kernel.coordinates if name not in kernel.prescribed]
    moves = np.array([name in moving for name in kernel.coordinates])
    there = m.q + 0.05 * moves * m.v / max(1.0, float(np.abs(m.v).max()))
    pose = kernel.frame_pose(kernel.assemble(there), frame)
    q = kernel.inverse_kinematics(pose, frame, q0=m.q, limits=False, moving=moving)
    assert np.abs(kernel.frame_pose(q, frame) - pose).max() < 1e-9
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-11
    away = pose[:3, 3] + 1e3 * rng.choice([-1.0, 1.0], 3)
    with pytest.raises(ReachError, match=f"{frame} does not reach .* m: it gets as near as .* mm") as caught:
        kernel.inverse_kinematics(away, frame, q0=m.q, moving=moving, starts=1)
    assert np.abs(kernel.functions.constraint(caught.value.q)).max() < 1e-11


@pytest.mark.soak
def test_a_platform_keeps_its_legs_within_limits() -> None:
    kernel = eomgen.build("gough")
    legs = [name for name, ends in kernel.limits.items() if np.isfinite(ends).any()]
    assert len(legs) == 6
    pose = np.eye(4)
    pose[:3, :3] = eomgen.robot.rotation_from_rpy((0.1, -0.05, 0.15))
    pose[:3, 3] = 0.05, -0.04, 1.15
    q = kernel.inverse_kinematics(pose)
    assert np.abs(kernel.frame_pose(q, "tcp") - pose).max() < 1e-10
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-11
    at = [kernel.coordinates.index(name) for name in legs]
    shorter = dict.fromkeys(legs, (1.0, float(q[at].max()) - 0.01))
    with pytest.raises(
        ReachError, match=r"as near as \S+ mm and \S+ deg; .*leg\d\.z is at its limit 1\.\d+ m"
    ) as caught:
        kernel.inverse_kinematics(pose, limits=shorter, starts=2)
    assert np.abs(kernel.functions.constraint(caught.value.q)).max() < 1e-11
    assert caught.value.q[at].max() <= q[at].max() - 0.01 + 1e-9


def test_deviations_stay(built: Build) -> None:
    elastic = built(eomgen.load_robot("shaken_arm"), "kinematics")
    assert set(elastic.limits).isdisjoint(elastic.prescribed)
    rng = np.random.default_rng(1)
    begun = elastic.home + rng.uniform(-0.01, 0.01, elastic.n)
    moved = [elastic.coordinates.index(name) for name in elastic.limits]
    there = begun.copy()
    there[moved] += 0.3
    point = elastic.frame_pose(there, elastic.frames[0])[:3, 3]
    q = elastic.inverse_kinematics(point, elastic.frames[0], q0=begun)
    still = np.setdiff1d(np.arange(elastic.n), moved)
    assert np.array_equal(q[still], begun[still])
    assert np.abs(elastic.frame_pose(q, elastic.frames[0])[:3, 3] - point).max() < 1e-10
    one = list(elastic.limits)[-1]
    free = elastic.inverse_kinematics(elastic.frame_pose(begun, "tcp"), q0=begun, moving=[one])
    assert np.array_equal(free, begun)


SPLIT_ARM = """
name = "split_arm"
gravity = [0.0, -9.81, 0.0]
links = [
  {name = "arm", mass = 1.0, inertia = {xx = 0.1, yy = 0.1, zz = 0.1}},
  {name = "left", mass = 1.0, inertia = {xx = 0.1, yy = 0.1, zz = 0.1}},
  {name = "right", mass = 1.0, inertia = {xx = 0.1, yy = 0.1, zz = 0.1}},
]
joints = [
  {name = "joint1", parent = "base", child = "arm", type = "revolute", limits = [-2.0, 2.0]},
  {name = "left", parent = "arm", child = "left", type = "fixed", x = {stiffness = 1e4}, gamma = {stiffness = 1e3}},
  {name = "right", parent = "arm", child = "right", type = "fixed", x = {stiffness = 1e4}, gamma = {stiffness = 1e3}},
]
loops = [{name = "pin", links = ["left", "right"], type = "revolute"}]
frames = [{name = "tcp", link = "right", placement = {xyz = [1.0, 0.0, 0.0]}}]
"""


def test_deviations_stay_where_loops_need_them(built: Build, tmp_path: Path) -> None:
    path = tmp_path / "split_arm.toml"
    path.write_text(SPLIT_ARM)
    robot = eomgen.load_robot(path)
    refused(DescriptionError, "do not move against each other", eomgen.build, robot.rigid(), kernels=("kinematics",))
    kernel = built(robot)
    assert kernel.limits == {"joint1.gamma": (-2.0, 2.0)}
    point = [np.cos(0.7), np.sin(0.7), 0.0]
    for q in (kernel.inverse_kinematics(point), inverse_kinematics(kernel, point, robot=robot)):
        assert abs(q[0] - 0.7) < 1e-10
        assert not q[1:].any()


def test_motors_turn_with_their_joints(built: Build) -> None:
    kernel = built(eomgen.load_robot("geared_arm"), "kinematics")
    assert kernel.motors
    assert set(kernel.motors).isdisjoint(kernel.limits)
    there = kernel.home.copy()
    there[[kernel.coordinates.index(name) for name in kernel.limits]] += 0.1
    point = kernel.frame_pose(there, kernel.frames[0])[:3, 3]
    q = kernel.inverse_kinematics(point, kernel.frames[0])
    for motor, principal in kernel.motors.items():
        turned = kernel.ratio(motor) * q[kernel.coordinates.index(principal)]
        assert q[kernel.coordinates.index(motor)] == turned != 0.0


def test_float32(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"), "kinematics", dtype="float32")
    begun = np.array([0.3, -1.4, 1.8, -1.97, -1.57, 0.0], np.float32)
    pose = kernel.frame_pose(begun + np.float32(0.2), "tcp")
    q = kernel.inverse_kinematics(pose, q0=begun)
    assert q.dtype == np.float32
    assert np.abs(kernel.frame_pose(q, "tcp") - pose).max() < 3e-5
    turned = kernel.frame_pose(begun + np.float32([0.2, 0.0, 0.0, 0.0, 0.0, 0.0]), "tcp")
    with pytest.raises(ReachError, match=r"joint1\.gamma is at its limit 0\.4 rad") as caught:
        kernel.inverse_kinematics(turned, q0=begun, limits={"joint1": (0.1, 0.4)}, moving=["joint1"], starts=0)
    assert caught.value.q[0] <= 0.4
    point = kernel.frame_pose(begun + np.float32([-0.2, 0.1, 0.1, 0.0, 0.0, 0.0]), "tcp")[:3, 3]
    for ends in ((0.1, 0.1), (0.1, 0.1 + 1e-12)):  # float32 has no number between them
        q = kernel.inverse_kinematics(point, q0=begun, limits={"joint1": ends})
        assert q[0] == np.float32(0.1)
        assert np.abs(kernel.frame_pose(q, "tcp")[:3, 3] - point).max() < 3e-5


def test_what_is_no_number_is_shown(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"), "kinematics")
    point = np.array([0.3, 0.2, 0.4])
    for pose, said in (
        ("here", "'here'; allowed"),
        (["0.3", "0.2", "0.4"], r"\['0.3', '0.2', '0.4'\]; allowed"),
        (point + 1j, r"array\(\[0.3\+1.j, .*allowed"),
        (np.ma.array(point, mask=[True, False, False]), "masked_array.*allowed"),
        ([0.3, np.nan, 0.4], r"\[0.3, nan, 0.4\] has numbers that are not finite; allowed"),
        ([1e160, 0.2, 0.4], r"\[1e\+160, 0.2, 0.4\]; allowed: .*up to 1e\+30 m"),
        (2.0 * np.eye(4), r"its last row is \[0.0, 0.0, 0.0, 2.0\]; allowed"),
    ):
        refused(ArrayError, f"^pose: {said}", kernel.inverse_kinematics, pose)
    for begun, said in (
        ("x", "'x'"),
        ([np.nan] * 6, r"\[nan, .* has numbers that are not finite"),
        ([0.0], "got shape"),
    ):
        with pytest.raises(ArrayError, match=rf"^q0: {said}.*; allowed: finite numbers \(6,\)$"):
            kernel.inverse_kinematics(point, q0=begun)
    ranges = np.tile([-1.0, 1.0], (6, 1))
    for pair in ([np.nan, 1.0], [1.0, -1.0], [np.inf, np.inf], [-np.inf, -np.inf]):
        ranges[2] = pair
        for limits in (ranges, {"joint3.gamma": pair}):
            with pytest.raises(ArrayError, match=r"^limits: joint3.gamma: \[.*\]; allowed: "):
                kernel.inverse_kinematics(point, limits=limits)
        with pytest.raises(ArrayError, match=r"^limits: joint3.gamma: \[.*\]; allowed: "):
            inverse_kinematics(kernel, point, limits=ranges)
    refused(ArrayError, r"^limits: 'x'; allowed", inverse_kinematics, kernel, point, limits="x")
    single = built(eomgen.load_robot("ur5"), "kinematics", dtype="float32")
    with pytest.raises(ArrayError, match=r"^q0: .*allowed: .*up to 3.4e\+38 \(float32\)"):
        single.inverse_kinematics(point, q0=[1e300] * 6)
    wide = np.tile([-1e300, 1e300], (6, 1))
    assert single.inverse_kinematics(point, limits=wide).dtype == np.float32


def test_what_cannot_be_asked(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"), "kinematics")
    for wrong in (np.eye(3)[:2, :2], np.full(3, np.nan), "here", 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])):
        refused(ArrayError, "pose", kernel.inverse_kinematics, wrong)
    refused(ArrayError, r"q0: .*allowed", kernel.inverse_kinematics, np.eye(4), q0=[0.0])
    for limits in ([0.0, 1.0], {"joint1": 3.0}, {"joint1": (1.0, -1.0)}):
        refused(ArrayError, r"limits: .*allowed", kernel.inverse_kinematics, np.eye(4), limits=limits)
    with pytest.raises(UnknownNameError, match=r"limits: 'joint9' is unknown; did you mean 'joint\d'"):
        kernel.inverse_kinematics(np.eye(4), limits={"joint9": (0.0, 1.0)})
    with pytest.raises(UnknownNameError, match=r"moving: 'elbow' is unknown; known: joint1, joint2"):
        kernel.inverse_kinematics(np.eye(4), moving=["elbow"])
    refused(UnknownNameError, "frame: 'hand' is unknown; known: tcp", kernel.inverse_kinematics, np.eye(4), "hand")
    for starts in (-1, 1.5, True, "many"):
        with pytest.raises(InputError, match=r"starts: .*allowed: a whole number"):
            kernel.inverse_kinematics(np.eye(4), starts=starts)  # type: ignore[arg-type]
    point = kernel.frame_pose(np.zeros(6), "tcp")[:3, 3] + [9.0, 0.0, 0.0]
    with pytest.raises(ReachError, match=r"ur5: tcp does not reach .* m: it gets as near as \d+ mm") as caught:
        kernel.inverse_kinematics(point, starts=0)
    assert caught.value.distance > 7.0
    assert caught.value.angle == 0.0
