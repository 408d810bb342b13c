"""The public arm with two flexible links, each a chain of rigid segments, as a robot of eomgen.

Numbers are those of github.com/shamilmamedov/flexible_arm at commit fe633ce7: envs/rfem.py,
models/three_dof/flexible_link_params.yml and the URDFs beside it.  The first joint turns about the vertical; the links
behind it bend in one vertical plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import eomgen
from eomgen.description import robot_from_toml

LENGTH, WIDTH, HEIGHT = 0.5, 0.05, 0.002  # of a flexible link, m
DENSITY = 7870.0  # kg/m^3
YOUNG, VISCOSITY = 1.9e11, 8.511e8  # Pa, Pa s
SECOND_MOMENT = WIDTH * HEIGHT**3 / 12.0  # m^4
TWIST = 1.57  # rad, from the first axis to the others: as published, not pi/2
LINKS = ("upper", "fore")
DRIVEN = ("joint1.gamma", "joint2.gamma", "joint3.gamma")

COLUMN_MASS, COLUMN_PLACE, COLUMN_INERTIA = 2.0, [0.0, 0.0, 0.12], (0.0061, 0.0061, 0.01125)  # kg, m, kg m^2
COLUMN_HEIGHT = 0.15  # m

COLUMN = f"""
name = "flexible_arm"

[[links]]
name = "column"
mass = {COLUMN_MASS}
com = {COLUMN_PLACE}
inertia = {{ xx = {COLUMN_INERTIA[0]}, yy = {COLUMN_INERTIA[1]}, zz = {COLUMN_INERTIA[2]} }}

[[joints]]
name = "joint1"
parent = "base"
child = "column"
type = "revolute"
"""

LINK = """
[[links]]
name = "{name}"
mass = {mass}
com = [{half}, 0.0, 0.0]
inertia = {{ xx = {xx}, yy = {yy}, zz = {zz} }}

[[joints]]
name = "{joint}"
parent = "{parent}"
child = "{name}"
type = "revolute"
placement = {{ xyz = {xyz}, rpy = {rpy} }}
{law}"""

TIP = """
[[frames]]
name = "tip"
link = "{link}"
placement = {{ xyz = [{length}, 0.0, 0.0] }}
"""


@dataclass(frozen=True)
class Body:
    """A rigid segment, its length, m, and stiffness and damping of the elastic joint before it, 0 of a driven one."""

    link: str
    joint: str
    parent: str
    length: float
    before: float  # length of the segment that carries it, m
    stiffness: float = 0.0  # N m/rad
    damping: float = 0.0  # N m s/rad

    @property
    def mass(self) -> float:
        return DENSITY * WIDTH * HEIGHT * self.length

    @property
    def inertia(self) -> tuple[float, float, float]:
        """About the centre of mass, along and across the link, kg m^2."""
        x, y, z = self.length**2, HEIGHT**2, WIDTH**2
        return self.mass / 12.0 * (y + z), self.mass / 12.0 * (x + z), self.mass / 12.0 * (x + y)


def bodies(segments: int) -> list[Body]:
    """Return the rigid segments of both links, from the column on: equal parts with elastic joints in their middles.

    With 0 segments the links are rigid.
    """
    part = LENGTH / max(segments, 1)
    lengths = [LENGTH] if segments == 0 else [part / 2, *[part] * (segments - 1), part / 2]
    law = (YOUNG * SECOND_MOMENT / part, VISCOSITY * SECOND_MOMENT / part)
    chain: list[Body] = []
    parent, before = "column", COLUMN_HEIGHT
    for number, link in enumerate(LINKS):
        for place, length in enumerate(lengths):
            joint = f"joint{number + 2}" if place == 0 else f"{link}{place}"
            chain.append(Body(f"{link}{place}", joint, parent, length, before, *(law if place else ())))
            parent, before = chain[-1].link, length
    return chain


def description(segments: int) -> str:
    """Return the arm as TOML."""
    text = COLUMN
    chain = bodies(segments)
    for body in chain:
        root = body.parent == "column"
        xx, yy, zz = body.inertia
        text += LINK.format(
            name=body.link,
            joint=body.joint,
            parent=body.parent,
            mass=body.mass,
            half=body.length / 2,
            xx=xx,
            yy=yy,
            zz=zz,
            xyz=[0.0, 0.0, body.before] if root else [body.before, 0.0, 0.0],
            rpy=[TWIST if root else 0.0, 0.0, 0.0],
            law=f"gamma = {{ stiffness = {body.stiffness}, damping = {body.damping} }}\n" if body.stiffness else "",
        )
    return text + TIP.format(link=chain[-1].link, length=chain[-1].length)


def arm(segments: int) -> eomgen.Robot:
    """Return the arm with so many elastic joints in each of the two links."""
    return robot_from_toml(description(segments))
