"""Robots whose vibrations have closed forms: masses in a row between springs, and a slider-crank on a spring."""

from __future__ import annotations

from eomgen.robot.value import Coordinate, Frame, Joint, Link, Placement, Robot
from tests.support.joint_table import joint_table, link_table, loop_table

STIFFNESS, MASS, DAMPING = 4e4, 2.5, 3.0


def chain(n: int, *, ends: str = "fixed-free", damping: float | None = None) -> Robot:
    """n masses in a row between springs: links on fixed joints that give way along x, "fixed-free" or "free-free"."""
    table = {"x": Coordinate(stiffness=STIFFNESS, damping=damping)}
    joints, links = [], []
    for i in range(n):
        free = i == 0 and ends == "free-free"
        given = {"x": Coordinate()} if free else table
        parent = f"m{i}" if i else "base"
        joints.append(Joint(f"j{i + 1}", parent, f"m{i + 1}", "fixed", Placement(), coordinates=given))
        links.append(Link(f"m{i + 1}", MASS, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)))
    return Robot("chain", (0.0, 0.0, 0.0), tuple(links), tuple(joints), (Frame("tcp", f"m{n}"),))


LOOP = f"""
name = "slider_crank"
gravity = [0.0, -9.81, 0.0]
{link_table("crank", 0.7, (0.1, 0.0, 0.0), (1e-3, 4e-3, 4e-3))}
{link_table("rod", 0.5, (0.2, 0.0, 0.0), (1e-3, 7e-3, 7e-3))}
{link_table("slider", 0.9, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))}
{joint_table("turn", "base", "crank", "revolute")}
{joint_table("pin", "crank", "rod", "revolute")}
placement = {{ xyz = [0.2, 0.0, 0.0] }}
{joint_table("guide", "base", "slider", "fixed")}
x = {{ stiffness = 3000.0, damping = 8.0, preload = 40.0 }}
{loop_table("ball", "rod", "slider", "revolute")}
placements = [{{ xyz = [0.4, 0.0, 0.0] }}, {{}}]
"""
