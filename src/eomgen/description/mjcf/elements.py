"""Joints of MJCF one by one, and the attributes that elements of bodies have."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eomgen.names import show
from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.value import Coordinate, Friction

from .defaults import Defaults
from .joints import Moving
from .values import ORIENTATIONS, Array, Item, Pose, Reading

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_POSE = ("pos", *ORIENTATIONS)
_SHOWN = ("name", "class", "group", "material", "rgba", "user")
_SOLVER = ("solref", "solimp", "margin", "gap", "friction", "condim", "priority", "solmix", "contype", "conaffinity")
BODY_KEYS = ("name", "childclass", *_POSE, "mocap", "gravcomp", "user", "sleep", "simple", "fuse")
FRAME_KEYS = ("name", "childclass", *_POSE)
INERTIAL_KEYS = (*_POSE, "mass", "diaginertia", "fullinertia")
SITE_KEYS = (*_SHOWN, *_POSE, "type", "size", "fromto")
GEOM_KEYS = (
    *(*_SHOWN, *_POSE, *_SOLVER, "type", "size", "fromto", "mass", "density", "shellinertia", "mesh", "hfield"),
    *("fitscale", "fluidshape", "fluidcoef", "adhesion", "surfacevel", "castshadow"),
)
JOINT_KEYS = (
    *("name", "class", "group", "user", "type", "pos", "axis", "ref", "springref", "stiffness", "damping", "armature"),
    *("frictionloss", "range", "limited", "margin", "springdamper", "springyield", "solreflimit", "solimplimit"),
    *("solreffriction", "solimpfriction", "actuatorfrcrange", "actuatorfrclimited", "actuatorgravcomp", "align"),
)
FREE_KEYS = ("name", "group", "align")
LIMITED = ("auto", "true", "false")
_OF_QUATERNIONS = ("stiffness", "armature", "frictionloss")


@dataclass(frozen=True)
class JointReader:
    """Reads <joint> and <freejoint>; ``note`` takes a remark and the name of its subject."""

    reading: Reading
    defaults: Defaults
    flags: Mapping[str, bool]
    note: Callable[[str, str], None]

    def joint(self, element: Element, frame: Pose, childclass: str | None, body: str) -> Moving:
        """Read a joint of a body, in the body's axes; ``frame``: the frame of its pos and axis."""
        name = element.get("name", "")
        where = f"joint {show(name)}" if name else f"{body}, <{element.tag}>"
        if element.tag == "freejoint":
            Item(self.reading, element, where, FREE_KEYS)
            return Moving(name, "free", np.array([0.0, 0.0, 1.0]), np.zeros(3))
        values = self.defaults.values(element, "joint", where, childclass)
        item = Item(self.reading, element, where, JOINT_KEYS, values)
        kind = item.choice("type", ("hinge", "slide", "ball", "free"), "hinge")
        axis = np.asarray(frame.rotation @ item.direction("axis", (0.0, 0.0, 1.0)))
        for key in ("springdamper", "springyield"):
            if any(item.numbers(key, 1, 2)):
                refuse = item.leave if key == "springdamper" else item.fail
                refuse(f"{key} is {show(item.values[key])}, which is not supported; allowed: stiffness and damping")
        anchor = frame.point(item.vector("pos"))
        if kind in ("ball", "free"):
            return self._quaternion(item, name, kind, anchor)
        unit = self.reading.angle if kind == "hinge" else 1.0
        ref, springref = item.number("ref") * unit, item.number("springref") * unit
        limits = self._limits(item, unit, name or body)
        return Moving(
            *(name, kind, axis, anchor, self._coordinate(item, springref, name or body)),
            offset=-ref if ref else None,
            limits=limits,
            spring_offset=springref - ref,
            limited=limits is not None and item.choice("limited", LIMITED, "auto") != "false",
            effort=self._effort(item, name or body),
        )

    def _quaternion(self, item: Item, name: str, kind: str, anchor: Array) -> Moving:
        """Read a ball or free joint; forces on its quaternion, but for damping, are others than those on angles."""
        for key in _OF_QUATERNIONS:
            if any(item.numbers(key, 1, 3)):
                message = f"{key} is {show(item.values[key])}, which acts otherwise on the angles of eomgen"
                way = "<freejoint/>" if kind == "free" else "three hinges about x, y and z"
                item.fail(f"{message}; allowed: 0 (or {way})")
        value, made = self._damping(item), None
        if value and self.flags["damper"]:
            made = JointDamping(linear=value if kind == "free" else None, angular=value)
        origin = np.zeros(3) if kind == "free" else anchor
        return Moving(name, kind, np.array([0.0, 0.0, 1.0]), origin, damping=made)

    def _damping(self, item: Item) -> float:
        """Return the damping of any joint, which must be linear."""
        first, *others = _polynomial(item, "damping")
        if any(others):
            item.fail(f"damping is {show(item.values['damping'])}; allowed: a linear term")
        return first

    def _coordinate(self, item: Item, springref: float, name: str) -> Coordinate:
        stiffness, quadratic, cubic = _polynomial(item, "stiffness")
        if quadratic:
            item.fail(f"stiffness is {show(item.values['stiffness'])}; allowed: a linear and a cubic term")
        damping = self._damping(item)
        if cubic and springref:
            item.fail(f"springref is {item.values['springref']} beside a cubic stiffness; allowed: springref 0")
        armature, friction = item.number("armature", minimum=0.0), item.number("frictionloss", minimum=0.0)
        if not self.flags["spring"]:
            stiffness = cubic = 0.0
        if friction and self.flags["frictionloss"]:
            self.note("frictionloss is read as Coulomb friction that reverses smoothly", name)
        return Coordinate(
            stiffness=stiffness or None,
            damping=(damping or None) if self.flags["damper"] else None,
            armature=armature or None,
            preload=-stiffness * springref or None,
            cubic=cubic or None,
            friction=Friction(friction) if friction and self.flags["frictionloss"] else None,
        )

    def _effort(self, item: Item, name: str) -> float | None:
        """Return the greatest total force of the joint's actuators, N or N m."""
        item.choice("actuatorfrclimited", LIMITED, "auto")
        ends = item.numbers("actuatorfrcrange", 2)
        if ends and ends[0] > ends[1]:
            item.fail(f"actuatorfrcrange is {show(item.values['actuatorfrcrange'])}; allowed: lower <= upper")
        if ends and ends[0] != -ends[1]:
            self.note("effort is the greater end of actuatorfrcrange, which is not symmetric", name)
        return max(map(abs, ends), default=0.0) or None

    def _limits(self, item: Item, unit: float, name: str) -> tuple[float, float] | None:
        """Return the range, rad or m; nothing stops at it unless stops are asked for."""
        limited = item.choice("limited", LIMITED, "auto")
        ends = item.numbers("range", 2)
        if not ends:
            return None
        lower, upper = (value * unit for value in ends)
        if lower > upper or not (math.isfinite(lower) and math.isfinite(upper)):
            item.fail(f"range is {show(item.values['range'])}; allowed: lower <= upper")
        if limited != "false":
            self.reading.draft.unstopped.append(name)
        return lower, upper


def _polynomial(item: Item, key: str) -> tuple[float, float, float]:
    """Return the coefficients of a force of up to three powers."""
    coefficients = item.numbers(key, 1, 3)
    if any(value < 0.0 for value in coefficients):
        item.fail(f"{key} is {show(item.values[key])}; allowed: numbers that are at least 0")
    first, second, third = (*coefficients, 0.0, 0.0, 0.0)[:3]
    return first, second, third
