"""Modes, deflection and linearisation of robots with motors and with springs between points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.analysis.modal import modes
from eomgen.analysis.statics import deflection
from eomgen.description.load import robot_from_toml
from eomgen.integration.solve import integrate
from eomgen.robot.value import Motor, Robot, Spring
from tests.support.builds import Build
from tests.support.swinging import NEEDED

pytestmark = pytest.mark.usefixtures("unoptimised")


def geared(stiffness: float = 5e3, inertia: float = 2e-4, ratio: float = 80.0) -> Robot:
    """A rod of 1 m and 3 kg behind a gear, turning about a vertical axis."""
    robot = robot_from_toml(
        f"""
name = "geared_rod"
gravity = [0.0, 0.0, -9.81]
[[links]]
name = "rod"
mass = 3.0
com = [0.5, 0.0, 0.0]
inertia = {{ xx = 0.0, yy = 0.25, zz = 0.25 }}
[[joints]]
name = "hinge"
parent = "base"
child = "rod"
type = "revolute"
motor = {{ inertia = {inertia}, ratio = {ratio}, stiffness = {stiffness} }}
[[frames]]
name = "tip"
link = "rod"
placement = {{ xyz = [1.0, 0.0, 0.0] }}
"""
    )
    assert isinstance(robot.joints[0].motor, Motor)
    return robot


def test_a_locked_motor_leaves_the_gears_resonance() -> None:
    """sqrt(k / J) with the motor locked; sqrt(k (1 / J + 1 / (J_m N^2))) and a rigid turn with it free."""
    robot, J, k, rotor = geared(), 1.0, 5e3, 2e-4 * 80.0**2
    locked = modes(robot, drives="locked")
    assert np.abs(locked.frequencies - np.sqrt(k / J) / (2 * np.pi)).max() <= 1e-10
    free = np.sort(modes(robot, drives="free").frequencies)
    assert np.abs(free - [0.0, np.sqrt(k * (1 / J + 1 / rotor)) / (2 * np.pi)]).max() <= 1e-9


def test_a_gear_gives_way_under_a_load() -> None:
    """A force across the rod's tip winds the gear up by F l / k; the motor stays at ratio times the pose."""
    found = deflection(geared(), 0.4, frame="tip", loads={"tip": [-10 * np.sin(0.4), 10 * np.cos(0.4), 0, 0, 0, 0]})
    gamma, motor = found.q
    assert found.coordinates == ("hinge.gamma", "hinge.motor")
    assert abs(motor - 80.0 * 0.4) <= 1e-12
    wound = gamma - 0.4
    assert 0.9 * 10.0 / 5e3 <= wound <= 10.0 / 5e3


def test_springs_between_points_hold_what_has_no_spring(built: Build) -> None:
    """A passive slider between two springs swings at sqrt(2 k / m), in the modes as in time."""
    robot = eomgen.load_robot("one_link")
    joint = replace(robot.joints[0], coordinates={"x": replace(robot.joints[0].coordinates["x"], stiffness=None)})
    joint = replace(joint, type="fixed")
    pulls = tuple(
        Spring(f"pull{i}", ("base", "link1"), ((end, 0.0, 0.0), (0.0, 0.0, 0.0)), stiffness=300.0, free_length=0.2)
        for i, end in enumerate((0.5, -0.5))
    )
    robot = replace(robot, joints=(joint,), springs=pulls, name="between", gravity=(0.0, 0.0, 0.0), tunable=())
    mass = robot.links[0].mass
    expected = np.sqrt(2 * 300.0 / mass) / (2 * np.pi)
    found = modes(robot)
    assert np.abs(found.frequencies - expected).max() <= 1e-9
    kernel = built(robot, *NEEDED)
    swing = integrate(kernel, [1e-4], [0.0], 1.0 / expected, rtol=1e-9)
    assert abs(swing.q[-1, 0] - 1e-4) <= 1e-8
