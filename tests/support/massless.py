"""Robots with a coordinate that moves no inertia."""

from __future__ import annotations

import eomgen
from eomgen.description.load import robot_from_toml, robot_from_urdf
from tests.support.joint_table import joint_table, link_table

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
