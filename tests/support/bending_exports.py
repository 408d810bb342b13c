"""Robots with links that bend, of each kind that exporters meet."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Robot
from tests.support.bending_robots import bent
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.random_robots import random_robot

SPATIAL = f"""
name = "spatial"
gravity = [0.3, -0.2, -9.81]
[[links]]
name = "arm"
modal_damping = 0.02
[links.beam]
length = 0.8
E = 7.0e10
G = 2.63e10
density = 2700.0
section = {{ bar = [0.004, 0.006] }}
modes = {{ y = 1, z = 1, torsion = 1 }}
{link_table("hand", 0.5, (0.05, 0.01, 0.0), (0.01, 0.02, 0.02))}
{joint_table("shoulder", "base", "arm", "revolute")}
{joint_table("wrist", "arm", "hand", "revolute")}
node = "tip"
placement = {{ xyz = [0.02, 0.0, 0.01], rpy = [0.4, 0.2, 0.1] }}
{frame_table("tcp", "hand", (0.1, 0.0, 0.0))}
"""
BENDING: Mapping[str, Callable[[], Robot]] = {  # modes that work on each other first
    "tree": lambda: bent(random_robot(1, (1, 1)), 1, (2,), second=True).robot,
    "spatial": lambda: robot_from_toml(SPATIAL),
    "flexible_arm": lambda: eomgen.load_robot("flexible_arm"),
}
