"""A pendulum whose joint the tests describe."""

from __future__ import annotations

from typing import Any

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Coordinate, Joint, Link, Robot, Spring
from tests.support.joint_table import joint_table, link_table

MOTOR = "motor = { inertia = 1e-4, ratio = 100, stiffness = 2e4 }"


def described(motor: str, kind: str = "revolute", more: str = "", tunable: str = "[]") -> Robot:
    """A pendulum with that line in its joint."""
    return robot_from_toml(description(motor, kind, more, tunable))


def description(motor: str, kind: str = "revolute", more: str = "", tunable: str = "[]") -> str:
    """The same as TOML."""
    return f"""
name = "pendulum"
gravity = [0.0, -9.81, 0.0]
tunable = {tunable}
{link_table("rod", 2.0, (0.25, 0.0, 0.0), (0.0, 0.05, 0.05))}
{joint_table("joint1", "base", "rod", kind)}
{motor}
{more}
"""


def pendulum(springs: tuple[Spring, ...], mass: float = 2.0, com: float = 0.3, **gamma: Any) -> Robot:
    """A rod that turns about the base's z; weight along -y; rod along x at 0."""
    link = Link("rod", mass, (com, 0.0, 0.0), (0.01, 0.05, 0.05, 0.0, 0.0, 0.0))
    joint = Joint("pivot", "base", "rod", "revolute", coordinates={"gamma": Coordinate(**gamma)})
    return Robot("pendulum", (0.0, -9.81, 0.0), (link,), (joint,), springs=springs)
