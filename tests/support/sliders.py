"""Masses on rails and at tips: with springs whose results have closed forms, with any forces, or without inertia."""

from __future__ import annotations

from typing import Any

import eomgen
from eomgen.description.load import robot_from_toml, robot_from_urdf
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


TIP = f"""
name = "tip"
tunable = ["joints.k.gamma.armature"]
gravity = [0.0, -9.81, 0.0]

{link_table("a", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}

{link_table("b", 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))}

{joint_table("j", "base", "a", "revolute")}

{joint_table("k", "a", "b", "revolute")}
placement = {{ xyz = [0.5, 0.0, 0.0] }}
gamma = {{ stiffness = 10.0, damping = 1.0 }}
"""
WHEEL = """
<robot name="cart">
  <link name="base"/>
  <link name="arm"><inertial>
    <mass value="2"/><origin xyz="0.2 0 0"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <link name="wheel"/>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
  <joint name="spin" type="continuous">
    <parent link="arm"/><child link="wheel"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><dynamics damping="0.1"/>
  </joint>
</robot>
"""


def massless_tip() -> eomgen.Robot:
    """Return an arm whose tip, a link without mass on a spring and damper, goes from 0.5 rad as 0.5 exp(-10 t)."""
    return robot_from_toml(TIP)


def massless_wheel() -> eomgen.Robot:
    """Return an arm with a wheel that has neither mass nor inertia, on a damper, as many URDFs have them."""
    return robot_from_urdf(WHEEL, urdf_damping=True)
