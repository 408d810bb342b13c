"""Mass and inertia of an MJCF body: those of <inertial>, or as MuJoCo computes them from geoms.

Source: MuJoCo documentation, XML reference, body/geom and compiler (inertiafromgeom, boundmass, boundinertia).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eomgen.names import show

from .values import Array, Item, Pose

SHAPES = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_SIZES = {"sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3}
_LINES = ("capsule", "cylinder", "ellipsoid", "box")  # shapes that fromto may place
_LEAST = 1e-15  # mass that counts, kg


@dataclass(frozen=True)
class Mass:
    """Mass (kg), centre of mass (m) and inertia about it (3, 3; kg m^2), in the axes of a body."""

    mass: float
    com: Array
    inertia: Array


NOTHING = Mass(0.0, np.zeros(3), np.zeros((3, 3)))


@dataclass(frozen=True)
class Rules:
    """Settings of inertias in <compiler>."""

    from_geoms: str = "auto"
    groups: tuple[int, int] = (0, 5)
    least_mass: float = 0.0
    least_inertia: float = 0.0
    balance: bool = False


def inertial_mass(item: Item) -> Mass:
    """Return the mass properties of an ``<inertial>`` element."""
    if "mass" not in item:
        item.fail("the attribute mass is missing; allowed: a mass in kg")
    mass = item.number("mass", minimum=0.0)
    full, diagonal = item.numbers("fullinertia", 6), item.numbers("diaginertia", 3)
    turn = item.rotation()
    if full and (diagonal or any(key in item for key in ("quat", "axisangle", "xyaxes", "zaxis", "euler"))):
        item.fail("fullinertia stands beside diaginertia or an orientation; allowed: fullinertia alone")
    if full:
        xx, yy, zz, xy, xz, yz = full
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        inertia = turn @ np.diag(diagonal or [0.0] * 3) @ turn.T
    return Mass(mass, item.vector("pos"), inertia)


def geom_mass(item: Item, frame: Pose, rules: Rules) -> Mass:
    """Return the mass properties of a ``<geom>`` placed in a frame of its body; NOTHING where it does not count."""
    shape = item.choice("type", SHAPES, "sphere")
    first, last = rules.groups
    if shape in ("plane", "hfield") or not first <= item.number("group") <= last:
        return NOTHING
    density, mass = item.number("density", 1000.0, 0.0), item.number("mass", 0.0, 0.0)
    if mass == 0.0 if "mass" in item else density == 0.0:
        return NOTHING
    if "mesh" in item or shape in ("mesh", "sdf"):
        item.leave(
            "its inertia is that of a mesh, which is not computed; allowed: an <inertial> in its body, or mass='0'"
        )
    if item.flag("shellinertia"):
        item.leave("shellinertia is 'true', which is not computed; allowed: an <inertial> in its body")
    size, pose = _placed(item, shape)
    volume, moments = _solid(shape, size)
    mass = mass if "mass" in item else density * volume
    if mass < _LEAST:
        return NOTHING
    pose = frame @ pose
    return Mass(mass, pose.xyz, pose.rotation @ np.diag(mass * moments) @ pose.rotation.T)


def _placed(item: Item, shape: str) -> tuple[list[float], Pose]:
    """Return sizes, and the geom's pose; by fromto, if there is one."""
    count, ends = _SIZES[shape], "fromto" in item
    if ends:
        if shape not in _LINES:
            item.fail(f"fromto places a {shape}; allowed for: {', '.join(_LINES)}")
        pose, half = item.line()
        size = [*item.numbers("size", 1, 3)[:1] * (count - 1), half]
    else:
        pose, size = item.pose(), item.numbers("size", 1, 3)
    if len(size) < count or min(size[:count]) <= 0.0:
        came = show(item.values["size"]) if "size" in item else "missing"
        item.fail(
            f"size is {came}; allowed for a {shape}: {count} numbers above 0 ({1 if ends else count} of them in size)"
        )
    return size[:count], pose


def _solid(shape: str, size: Sequence[float]) -> tuple[float, Array]:
    """Return volume (m^3) and principal moments of inertia over the mass (m^2), (3,)."""
    if shape in ("ellipsoid", "box"):
        a, b, c = (value * value for value in size)
        product = size[0] * size[1] * size[2]
        volume, divisor = (4.0 / 3.0 * math.pi * product, 5.0) if shape == "ellipsoid" else (8.0 * product, 3.0)
        return volume, np.array([b + c, a + c, a + b]) / divisor
    r = size[0]
    if shape == "sphere":
        return 4.0 / 3.0 * math.pi * r**3, np.full(3, 0.4 * r * r)
    height = 2.0 * size[1]
    across, along = (3.0 * r * r + height * height) / 12.0, 0.5 * r * r
    if shape == "cylinder":
        return math.pi * r * r * height, np.array([across, across, along])
    ends = 4.0 * r / (4.0 * r + 3.0 * height)  # share of the two half spheres
    across = (1.0 - ends) * across + ends * (0.4 * r * r + height * (3.0 * r + 2.0 * height) / 8.0)
    along = (1.0 - ends) * along + ends * 0.4 * r * r
    return math.pi * r * r * (height + 4.0 / 3.0 * r), np.array([across, across, along])


def combined_mass(masses: Sequence[Mass]) -> Mass:
    """Return the mass properties of several bodies as one."""
    masses = [body for body in masses if body.mass > 0.0]
    if not masses:
        return NOTHING
    if len(masses) == 1:
        return masses[0]
    mass = sum(body.mass for body in masses)
    com = np.asarray(sum(body.mass * body.com for body in masses) / mass)
    inertia = np.zeros((3, 3))
    for body in masses:
        arm = body.com - com
        inertia += body.inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Mass(float(mass), com, inertia)


def bounded(body: Mass, rules: Rules) -> Mass:
    """Return mass properties within the bounds of <compiler>: least mass, least moments, equal ones where needed."""
    mass, inertia = max(body.mass, rules.least_mass), body.inertia
    if rules.least_inertia > 0.0 or rules.balance:
        computed, axes = np.linalg.eigh(inertia)
        moments = np.maximum(computed, rules.least_inertia)
        if rules.balance and moments[0] + moments[1] < moments[2] * (1.0 - 1e-12):
            moments = np.full(3, moments.mean())
        if not np.array_equal(moments, computed):
            inertia = (axes * moments) @ axes.T
    return Mass(mass, body.com, inertia)
