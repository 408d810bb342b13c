"""An arm of two links whose joints bend, for pictures."""

from __future__ import annotations

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Robot
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.random_springs import with_springs

ARM = f"""
name = "arm"
{link_table("link1", 3.0, (0.2, 0.0, 0.0), (0.01, 0.05, 0.05))}
{link_table("link2", 1.5, (0.15, 0.0, 0.0), (0.005, 0.02, 0.02))}
{joint_table("joint1", "base", "link1", "revolute")}
x = {{ stiffness = 2e5, damping = 80.0 }}
alpha = {{ stiffness = 4e3, damping = 3.0 }}
{joint_table("joint2", "link1", "link2", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }}
y = {{ stiffness = 1e5, damping = 60.0 }}
gamma = {{ damping = 0.2 }}
{frame_table("tcp", "link2", (0.3, 0.0, 0.0))}
"""


def bending_arm() -> Robot:
    """The arm with a spring of every kind between its links."""
    return with_springs(robot_from_toml(ARM), 0)
