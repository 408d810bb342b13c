"""An elastic arm with LuGre friction, and the same with Maxwell branches and a servo drive."""

from __future__ import annotations

import eomgen
from eomgen.description.load import robot_from_toml
from tests.support.joint_table import frame_table, joint_table, link_table

ARM = f"""
name = "bristled"
gravity = [0.0, -9.81, 0.0]
{link_table("upper", 2.0, (0.2, 0.01, 0.0), (0.02, 0.12, 0.13))}
{link_table("lower", 1.0, (0.2, 0.0, 0.05), (0.02, 0.03, 0.04))}
{joint_table("j1", "base", "upper", "revolute")}
gamma = {{ friction = {{ model = "lugre", coulomb = 1.0, static = 1.5, stribeck = 0.1, bristle_stiffness = 1e4, \
bristle_damping = 30.0, viscous = 0.5, fade = 0.05 }} }}
{joint_table("j2", "upper", "lower", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0] }}
x = {{ stiffness = 1e5, damping = 100.0 }}
beta = {{ stiffness = 1e3, damping = 1.0, friction = {{ model = "lugre", coulomb = 0.1, bristle_stiffness = 2e3 }} }}
{frame_table("tcp", "lower", (0.4, 0.0, 0.0))}
"""
SERVO = ARM.replace('name = "bristled"', 'name = "served"').replace(
    "x = { stiffness = 1e5, damping = 100.0 }",
    "x = { stiffness = 1e5, damping = 100.0, maxwell = [{ stiffness = 2e4, damping = 50.0 },"
    " { stiffness = 2e4, damping = 500.0 }] }\ngamma = { armature = 0.1, drive = { winding = { resistance = 0.5,"
    " inductance = 1e-3, torque_constant = 2.0 }, controller = { position = { kp = 5.0 }, velocity = { kp = 20.0,"
    " ki = 50.0 }, current = { kp = 2.0, ki = 400.0 } } } }",
)


def served_arm() -> eomgen.Robot:
    """Return the bristled arm with Maxwell branches, and a servo drive at the second joint."""
    return robot_from_toml(SERVO)


def bristled_arm() -> eomgen.Robot:
    """Return an arm of two links, elastic at the second joint, with bristles in both."""
    return robot_from_toml(ARM)
