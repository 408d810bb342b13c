"""Loops and couplings of a robot as equality constraints and tendons of MuJoCo.

MuJoCo has two points that stay together and two frames that do: a ball is one pair of points, a hinge two along its
axis, a rigid joint a pair of frames.  Rigid couplings are polynomials of two joints, or of a tendon's length where they
have more; elastic ones are tendons.  All constraints are soft, and as stiff here as the step allows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from ..arrays import Array
from ..description.mjcf.poses import about
from ..robot.joint_types import CUTS, JOINT_TYPES
from ..robot.laws import active_laws
from ..robot.value import COORDINATES, Coordinate, Coupling, Loop, Robot

Bodies = Mapping[str, Element]
STIFF = 2.0  # steps, the shortest time constant that MuJoCo takes
_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)
_SOFT = "soft in MuJoCo"


def held_softly(robot: Robot) -> Iterator[str]:
    """Yield notes on what becomes of loops and couplings: the name, and what MuJoCo has in its place."""
    for loop in robot.loops:
        where = f"loops.{loop.name}"
        if not JOINT_TYPES[loop.type].equality:
            yield f"{where}: left open (MuJoCo has no {loop.type} joint among its constraints)"
            continue
        yield f"{where}: {_SOFT}"
        blocked = {component.name for component in CUTS[loop.type]}
        for table in loop.elements:
            yield f"{where}.{table}: {'without clearance' if loop.elements[table] is loop.radial else 'left out'}"
        for name in loop.coordinates:
            yield f"{where}.{name}: {'without clearance or spring' if name in blocked else 'without force'}"
    for coupling in robot.couplings:
        where = f"couplings.{coupling.name}"
        if coupling.law is None:
            yield f"{where}: {_SOFT}"
            continue
        if coupling.law.preload:
            yield f"{where}.preload: left out"
        numbers = coupling.law.law() | {"stiffness": coupling.law.stiffness or 0.0}
        for law in active_laws(numbers):
            note = law.mjcf(numbers) and ("left out" if law.name == "stops" else law.mjcf(numbers))
            if note and law.name != "preload":
                yield f"{where}.{law.name}: {note}"


def add_equalities(root: Element, robot: Robot, bodies: Bodies, start: Sequence[float], step: float) -> None:
    """Write the constraints behind all bodies, and what they need: sites, tendons, and the closed pose as a keyframe.

    Args:
        start: coordinates of the closed home, (n,), m or rad.
        step: of MuJoCo's integrator, s.
    """
    if not robot.loops and not robot.couplings:
        return
    stiff = {"solref": f"{STIFF * step!r} 1", "solimp": text_of(_IMPEDANCE)}
    equality = Element("equality")
    for loop in robot.loops:
        if JOINT_TYPES[loop.type].equality:
            _add_loop(equality, loop, bodies, stiff)
    tendons = root.find("tendon")
    if tendons is None:
        tendons = Element("tendon")
    offsets = _references(robot)
    for coupling in robot.couplings:
        _add_coupling(equality, tendons, coupling, offsets, stiff)
    if len(tendons) and root.find("tendon") is None:
        root.append(tendons)
    root.append(equality)
    SubElement(SubElement(root, "keyframe"), "key", name="home", qpos=text_of(start))


def _add_loop(equality: Element, loop: Loop, bodies: Bodies, stiff: Mapping[str, str]) -> None:
    """Add pairs of sites that stay together."""
    frames = [(np.array(placement.rotation), np.array(placement.xyz)) for placement in loop.placements]
    turn, shift = _kept(loop)
    frames[0] = (frames[0][0] @ turn, frames[0][1] + frames[0][0] @ shift)
    kind = JOINT_TYPES[loop.type]
    for number, arm in enumerate(kind.points):
        sites = []
        for end, (link, (rotation, origin)) in enumerate(zip(loop.links, frames, strict=True)):
            sites.append(f"loops.{loop.name}.{end}" + (f".{number}" if number else ""))
            place = {
                "pos": text_of(origin + arm * rotation[:, 2]),
                "xyaxes": text_of(rotation[:, :2].T.ravel()),
            }
            SubElement(bodies[link], "site", {"name": sites[-1], **place})
        name = loop.name + (f".{number}" if number else "")
        SubElement(equality, kind.equality, {"name": name, "site1": sites[0], "site2": sites[1], **stiff})


def _kept(loop: Loop) -> tuple[Array, Array]:
    """Return the rotation and translation by which a loop joint's offset is kept, without those of free coordinates."""
    blocked = {component.name for component in CUTS[loop.type]}
    offsets = [value or 0.0 if x in blocked else 0.0 for x, value in zip(COORDINATES, loop.offset, strict=True)]
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), offsets[3:], strict=True):
        turn = turn @ about(axis, angle)
    return turn, np.array(offsets[:3])


def _references(robot: Robot) -> dict[str, float]:
    """Return coordinates in MuJoCo's reference position: minus the offsets of those that move."""
    return {
        f"{joint.name}.{name}": -(value or 0.0)
        for joint in robot.joints
        for name, value in zip(COORDINATES, joint.offset, strict=True)
        if name in joint.coordinates
    }


def _add_coupling(
    equality: Element, tendons: Element, coupling: Coupling, references: Mapping[str, float], stiff: Mapping[str, str]
) -> None:
    """Add the equality value(of) - sum of ratio * value = offset, counted from the reference position."""
    offset, tendon = coupling.offset or 0.0, f"couplings.{coupling.name}"
    ends = {coupling.of: 1.0, **{name: -ratio for name, ratio in coupling.to.items()}}
    begin = sum(factor * references.get(name, 0.0) for name, factor in ends.items())
    if coupling.law is not None:
        _add_tendon(tendons, tendon, ends, spring_values(coupling.law), offset)
        return
    values = {"name": coupling.name, **stiff}
    if len(ends) > 2:
        _add_tendon(tendons, tendon, ends, {}, None)
        SubElement(equality, "tendon", {**values, "tendon1": tendon, "polycoef": text_of([offset - begin, 0.0])})
        return
    others = {f"joint{number}": name for number, name in enumerate(ends, 1)}
    slope = sum(coupling.to.values())
    SubElement(equality, "joint", {**values, **others, "polycoef": text_of([offset - begin, slope, 0.0, 0.0, 0.0])})


def _add_tendon(
    tendons: Element, name: str, ends: Mapping[str, float], spring: Mapping[str, str], rest: float | None
) -> None:
    """Add a fixed tendon; the other way round where its rest length would be negative, which MuJoCo reads as none."""
    sign = -1.0 if rest is not None and rest < 0.0 else 1.0
    values = {} if rest is None else {"springlength": repr(sign * rest)}
    tendon = SubElement(tendons, "fixed", {"name": name, **values, **spring})
    for joint, factor in ends.items():
        SubElement(tendon, "joint", joint=joint, coef=repr(sign * factor))


def spring_values(coordinate: Coordinate) -> dict[str, str]:
    """Return the stiffness, with its cubic term where there is one, and damping, as attributes."""
    cubic = [0.0, coordinate.cubic] if coordinate.cubic else []
    return {"stiffness": text_of([coordinate.stiffness or 0.0, *cubic]), "damping": repr(coordinate.damping or 0.0)}


def text_of(values: Array | Sequence[float]) -> str:
    """Return numbers as MuJoCo reads them; none is a negative zero."""
    return " ".join(repr(float(value) + 0.0) for value in values)
