"""A mass on a rail: with a spring for sweeps whose results have closed forms, or with any forces."""

from __future__ import annotations

from typing import Any

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Coordinate, Joint, Link, Robot
from tests.support.joint_table import joint_table, link_table

SLIDER = f"""
name = "slider"
gravity = [0.0, 0.0, 0.0]
links = [{{ name = "mass", mass = 2.0, com = [0.0, 0.0, 0.0] }}]
{joint_table("rail", "base", "mass", "prismatic")}
z = {{ stiffness = 800.0, damping = 0.0 }}
"""
RELEASE = {"duration": 0.7, "initial": {"q": {"rail": 0.1}}}
STIFF = "[[vary]]\nparameter = 'joints.rail.z.stiffness'\n"


def on_rail(law: str, name: str = "slide", mass: float = 1.0) -> str:
    """Describe a mass on a prismatic joint across gravity; the law is that of its coordinate, in TOML."""
    return f"""
name = "{name}"
gravity = [0.0, -9.81, 0.0]
{link_table("body", mass, inertia=(0.1, 0.1, 0.1))}
{joint_table("rail", "base", "body", "prismatic")}
z = {{ {law} }}
"""


def slider() -> Robot:
    return robot_from_toml(SLIDER)


def mass_on_rail(mass: float = 2.0, name: str = "slider", **forces: Any) -> Robot:
    """Return a mass on a prismatic joint without gravity; forces are those of its coordinate."""
    link = Link("block", mass, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    joint = Joint("rail", "base", "block", "prismatic", coordinates={"z": Coordinate(**forces)})
    return Robot(name, (0.0, 0.0, 0.0), (link,), (joint,))
