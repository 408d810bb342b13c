"""Small robots with LuGre friction: an elastic arm, a linkage, and joints that a gear couples."""

from __future__ import annotations

from pathlib import Path

import eomgen
from eomgen.description.load import robot_from_toml

ARM = """
name = "bristled"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "upper"
mass = 2.0
com = [0.2, 0.01, 0.0]
inertia = { xx = 0.02, yy = 0.12, zz = 0.13 }
[[links]]
name = "lower"
mass = 1.0
com = [0.2, 0.0, 0.05]
inertia = { xx = 0.02, yy = 0.03, zz = 0.04 }
[[joints]]
name = "j1"
type = "revolute"
parent = "base"
child = "upper"
gamma = { friction = { model = "lugre", coulomb = 1.0, static = 1.5, stribeck = 0.1, bristle_stiffness = 1e4, \
bristle_damping = 30.0, viscous = 0.5, fade = 0.05 } }
[[joints]]
name = "j2"
type = "revolute"
parent = "upper"
child = "lower"
placement = { xyz = [0.4, 0.0, 0.0] }
x = { stiffness = 1e5, damping = 100.0 }
beta = { stiffness = 1e3, damping = 1.0, friction = { model = "lugre", coulomb = 0.1, bristle_stiffness = 2e3 } }
[[frames]]
name = "tcp"
link = "lower"
placement = { xyz = [0.4, 0.0, 0.0] }
"""
FRICTION = (
    'gamma = { friction = { model = "lugre", coulomb = 0.3, static = 0.4, stribeck = 0.1, bristle_stiffness = 300.0,'
    " bristle_damping = 0.5, fade = 0.5 } }"
)
GEARED = f"""
name = "geared"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "a"
mass = 1.0
com = [0.2, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.02, zz = 0.02 }}
[[links]]
name = "b"
mass = 0.5
com = [0.1, 0.0, 0.0]
inertia = {{ xx = 0.01, yy = 0.01, zz = 0.01 }}
[[joints]]
name = "j1"
parent = "base"
child = "a"
type = "revolute"
{FRICTION}
[[joints]]
name = "j2"
parent = "a"
child = "b"
type = "revolute"
placement = {{ xyz = [0.4, 0.0, 0.0] }}
{FRICTION}
[[couplings]]
name = "gear"
of = "j2.gamma"
to = {{ "j1.gamma" = -2.0 }}
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


def bristled_linkage() -> eomgen.Robot:
    """Return the built-in four-bar linkage with bristles in two joints."""
    text = (Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml").read_text(encoding="utf-8")
    for name in ("joint1", "joint2"):
        text = text.replace(f'name = "{name}"\n', f'name = "{name}"\n{FRICTION}\n')
    return robot_from_toml(text)


def geared_arm() -> eomgen.Robot:
    """Return an arm whose second joint follows the first, with bristles in both."""
    return robot_from_toml(GEARED)
