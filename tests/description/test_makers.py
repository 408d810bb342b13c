"""Built-in arms of makers against the tables that they come from, as published, and against products of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.robot.value import Robot
from tests.support import makers
from tests.support.builds import Build
from tests.support.description_samples import homogeneous, link_poses

pytestmark = pytest.mark.usefixtures("unoptimised")

FOLDER = Path(eomgen.__path__[0]) / "robots"
STATES = np.random.default_rng(20).uniform(-3.0, 3.0, (5, 7))


def tool(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Pose of the frame tcp, (4, 4)."""
    (frame,) = robot.frames
    return link_poses(robot, q)[frame.link] @ homogeneous(frame.placement)


def centres(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Centres of mass of the links in the base frame, (n, 3), m."""
    poses = link_poses(robot, q)
    return np.array([(poses[link.name] @ [*link.com, 1.0])[:3] for link in robot.links])


def centres_in(frames: Sequence[np.ndarray], given: Sequence[Sequence[float]]) -> np.ndarray:
    """The same from the frames of a table, with centres of mass in them."""
    return np.array([(frame @ [*com, 1.0])[:3] for frame, com in zip(frames, given, strict=True)])


@pytest.mark.parametrize(
    ("name", "table", "frames_of"),
    [
        ("ur5e", makers.UR5E, makers.classic_frames),
        ("ur20", makers.UR20, makers.classic_frames),
        ("ufactory850", makers.UFACTORY850, makers.modified_frames),
        ("panda", makers.PANDA, makers.modified_frames),
    ],
)
def test_published_tables(name: str, table: tuple[tuple[float, ...], ...], frames_of: makers.FramesOf) -> None:
    """Pose of the tool, masses and centres of mass at random angles."""
    robot = eomgen.load_robot(name)
    assert [link.mass for link in robot.links] == [row[4] for row in table]
    for state in STATES:
        q = state[: len(table)]
        frames = frames_of(table, q)
        end = frames[-1] @ makers.about_z(0.0, makers.PANDA_FLANGE if name == "panda" else 0.0)
        np.testing.assert_allclose(tool(robot, q), end, atol=2e-14)
        np.testing.assert_allclose(centres(robot, q), centres_in(frames, [row[5] for row in table]), atol=2e-14)


def test_two_tables_of_one_arm() -> None:
    """The maker's standard table of the UFACTORY 850 gives the pose that its modified one gives."""
    robot = eomgen.load_robot("ufactory850")
    for state in STATES:
        q = state[:6]
        np.testing.assert_allclose(tool(robot, q), makers.classic_frames(makers.UFACTORY850_CLASSIC, q)[-1], atol=2e-14)


@pytest.mark.parametrize("name", makers.URDFS)
def test_published_urdfs(name: str) -> None:
    """Pose of the tool at random angles; masses and centres of mass where they are published."""
    robot, (table, rpy) = eomgen.load_robot(name), makers.URDFS[name]
    masses = makers.URDF_MASSES.get(name)
    for state in STATES:
        frames = makers.urdf_frames(table, state[:6])
        np.testing.assert_allclose(tool(robot, state[:6]), frames[-1] @ makers.turned(rpy), atol=2e-14)
        if masses is not None:
            assert [link.mass for link in robot.links] == [mass for mass, _ in masses]
            wanted = centres_in(frames, [com for _, com in masses])
            np.testing.assert_allclose(centres(robot, state[:6]), wanted, atol=2e-12)


def test_a_table_through_c(built: Build) -> None:
    """What C answers is the product of the table, too."""
    robot = eomgen.load_robot("panda")
    kernel = built(robot, "kinematics")
    for q in STATES:
        end = makers.modified_frames(makers.PANDA, q)[-1] @ makers.about_z(0.0, makers.PANDA_FLANGE)
        np.testing.assert_allclose(kernel.frame_pose(q, "tcp"), end, atol=2e-14)


@pytest.mark.parametrize("name", makers.MAKERS)
def test_sources_are_said(name: str) -> None:
    """With an address; and which numbers are assumed."""
    text = (FOLDER / f"{name}.toml").read_text(encoding="ascii")
    head = " ".join(line.removeprefix("#").strip() for line in text.splitlines() if line.startswith("#"))
    assert "[1]" in head
    assert "https://" in head
    assert ("ASSUMED" in head) == (name in ("ufactory850", "kr6_r900", "lrmate200id"))
    assert ("ROS-Industrial's URDF" in head) == (name in makers.URDFS)
