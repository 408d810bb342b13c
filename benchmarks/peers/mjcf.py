"""A robot as MuJoCo's MJCF.

MuJoCo applies the joints of one body in their order, each about the axes that the ones before it have turned: three
slides along x, y, z and three hinges about x, y, z are eq. (3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from eomgen.robot import ANGULAR, COORDINATES, Joint, Link, Robot, Spring

Array = NDArray[np.float64]
AXES = ("1 0 0", "0 1 0", "0 0 1")


def mjcf(robot: Robot, step: float, integrator: str = "RK4") -> str:
    """The robot as MJCF text: no contacts, no limits, coordinates in the robot's order.

    Links need masses and inertias above zero: MuJoCo takes no massless body and no thin rod.  Springs between points
    become tendons; a cable is slack up to the middle of its smoothing, where MuJoCo's has a kink.

    Raises:
        ValueError: a spring follows a curve, or a cable has damping, which MuJoCo's tendons know only in all positions.
    """
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    option = {"timestep": repr(step), "gravity": _text(robot.gravity), "integrator": integrator}
    ElementTree.SubElement(root, "option", option)
    bodies = {robot.base: (ElementTree.SubElement(root, "worldbody"), np.eye(3))}
    for joint in robot.joints:
        parent, back = bodies[joint.parent]
        bodies[joint.child] = _add_body(parent, back, joint, robot.link(joint.child))
    if robot.springs:
        tendons = ElementTree.SubElement(root, "tendon")
        for spring in robot.springs:
            _add_tendon(tendons, bodies, spring)
    return ElementTree.tostring(root, encoding="unicode")


def _add_body(parent: ElementTree.Element, back: Array, joint: Joint, link: Link) -> tuple[ElementTree.Element, Array]:
    """The link as a body whose axes are the joint's; returns it, and the rotation from link axes to its axes."""
    turn = np.array(joint.axis_turn)
    rotation = back @ np.array(joint.placement.rotation) @ turn
    place = {"name": joint.child, "pos": _text(back @ np.array(joint.placement.xyz)), "xyaxes": _axes(rotation)}
    body = ElementTree.SubElement(parent, "body", place)
    xx, yy, zz, xy, xz, yz = link.inertia
    inertia = turn.T @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn
    full = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    if link.mass > 0 or joint.coordinates:  # a massless frame is fine where nothing moves it
        values = {"mass": repr(link.mass), "pos": _text(turn.T @ np.array(link.com)), "fullinertia": _text(full)}
        ElementTree.SubElement(body, "inertial", values)
    for name, given in joint.coordinates.items():
        values = {"name": f"{joint.name}.{name}", "type": "hinge" if name in ANGULAR else "slide"}
        values["axis"] = AXES[COORDINATES.index(name) % 3]
        values |= {key: repr(getattr(given, key) or 0.0) for key in ("stiffness", "damping", "armature")}
        ElementTree.SubElement(body, "joint", values)
    return body, turn.T


def _add_tendon(
    tendons: ElementTree.Element, bodies: Mapping[str, tuple[ElementTree.Element, Array]], spring: Spring
) -> None:
    """A straight tendon between two sites."""
    if spring.curve is not None or (spring.tension_only and spring.damping):
        raise ValueError(f"springs.{spring.name}: MuJoCo has no tendon with a curve, and no cable with damping")
    rest = spring.free_length or 0.0
    slack = (0.0, rest + 0.5 * (spring.smoothing or 0.0)) if spring.tension_only else (rest,)
    values = {key: repr(getattr(spring, key) or 0.0) for key in ("stiffness", "damping")}
    tendon = ElementTree.SubElement(tendons, "spatial", name=spring.name, springlength=_text(slack), **values)
    for end, (link, point) in enumerate(zip(spring.links, spring.points, strict=True)):
        body, back = bodies[link]
        ElementTree.SubElement(body, "site", name=f"{spring.name}.{end}", pos=_text(back @ np.array(point)))
        ElementTree.SubElement(tendon, "site", site=f"{spring.name}.{end}")


def _axes(rotation: Array) -> str:
    return _text(np.concatenate([rotation[:, 0], rotation[:, 1]]))


def _text(values: Array | Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
