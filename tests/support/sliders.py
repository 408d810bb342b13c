"""A mass on a spring, for sweeps whose results have closed forms."""

from __future__ import annotations

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Robot

SLIDER = """
name = "slider"
gravity = [0.0, 0.0, 0.0]
links = [{ name = "mass", mass = 2.0, com = [0.0, 0.0, 0.0] }]
[[joints]]
name = "rail"
parent = "base"
child = "mass"
type = "prismatic"
z = { stiffness = 800.0, damping = 0.0 }
"""
RELEASE = {"duration": 0.7, "initial": {"q": {"rail": 0.1}}}
STIFF = "[[vary]]\nparameter = 'joints.rail.z.stiffness'\n"


def slider() -> Robot:
    return robot_from_toml(SLIDER)
