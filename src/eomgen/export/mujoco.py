"""A robot as a model of MuJoCo (MJCF).

MuJoCo applies the joints of one body in their order, each about the axes that the ones before it have turned: three
slides along x, y, z and three hinges about x, y, z are eq. (3).  A motor behind a gear is a separate rotor on its
joint's link, of which its armature alone counts, and a tendon whose length is the transmission's deflection.
Angles that are damped alike in all directions are a ball (``mujoco_balls``).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..arrays import Array
from ..description import RobotLike, as_robot
from ..description.mjcf.poses import about, matrix, triple
from ..description.mjcf.read import VELOCITY
from ..description.xml_text import one_line
from ..errors import EomgenWarning, InputError
from ..files import as_path, write_atomically
from ..names import component_name, joint_of, kind_of, show
from ..pipeline.mechanisms import assembled_home
from ..robot.bounds import Limits
from ..robot.coordinates import coordinate_names
from ..robot.elements.matrices import entry_name
from ..robot.geometry import IDENTITY
from ..robot.inertia_policy import link_sizes, lowest_moments, second_moments
from ..robot.laws import active_laws
from ..robot.value import (
    ANGULAR,
    COORDINATES,
    MOTOR,
    Coordinate,
    Friction,
    Joint,
    Link,
    Placement,
    Robot,
    Spring,
)
from .equalities import add_equalities, held_softly, spring_values, text_of
from .mujoco_balls import ball_values, balls, damped_otherwise, hinge_damping, positions

Bodies = Mapping[str, ElementTree.Element]
INTEGRATORS = ("RK4", "Euler", "implicit", "implicitfast", "discrete")
LEAST = 1e-14  # mass (kg) and principal moments (kg m^2) of what has none: MuJoCo takes no less than 1e-15
_FAR = 1e9  # m or rad, of the end of a range at which nothing stops
_GROUND = "world"  # MuJoCo's name of the base


def export_mjcf(
    robot: RobotLike,
    path: str | Path,
    *,
    step: float | None = None,
    integrator: str = "RK4",
    approximate: bool = False,
    segments: int | None = None,
) -> Path:
    """Write a robot as a model of MuJoCo: the same coordinates in the same order and with the same names.

    Drives are motors of the coordinates' names, frames are sites, and loops and couplings equality constraints, which
    are soft; the keyframe "home" is the closed pose near the description's home.  Contacts are off; limits are written,
    but switched off where nothing stops at them here, and so are efforts; limits of speed are custom numbers.  Links
    without mass and thin rods get ``LEAST`` in its place.
    Angles with a damping of their joint become a ball or free joint of its name, without motors.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: file to write, usually with the suffix .xml.
        step: of MuJoCo's integrator, s; by default 1e-3, or what "RK4" needs if that is less.
        integrator: "RK4", "Euler", "implicit", "implicitfast", or "discrete" of MuJoCo 3.13 and later, implicit in
            position, too.
        approximate: write the robot without what MuJoCo has no equal for, with an ``EomgenWarning`` for each.
        segments: write links that bend as chains of so many rigid segments (``Robot.with_segments``), in the place of
            their modes; None refuses them.

    Returns:
        The path.

    Raises:
        InputError: MuJoCo has no equal for something, and ``approximate`` is False; an argument is none of these; or
            the file cannot be written.
        LoopError: loops do not close near the description's home.
    """
    path = as_path(path, "path")
    from .step import default_step

    robot = as_robot(robot)
    if segments is not None:
        robot = robot.with_segments(segments)
    _check(robot, integrator, approximate)
    if step is None:
        step = default_step(_without_friction(robot), integrator.lower())
    text = mjcf(robot, step, integrator, approximate=approximate, actuators=True)
    for what in left_out(robot):
        warnings.warn(f"{robot.name}: {what}", EomgenWarning, stacklevel=2)
    return write_atomically(Path(path), lambda stream: stream.write(text.encode("ascii")), read=_check_by_mujoco)


def _check_by_mujoco(path: Path) -> None:
    """Raise InputError where MuJoCo does not take a file; nothing is checked where it is not installed.

    ``load_robot`` reads less of MJCF than is written here: no slack tendons.
    """
    try:
        import mujoco
    except ImportError:
        return
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"MuJoCo {mujoco.__version__} says: {one_line(error)}") from None


def mjcf(
    robot: RobotLike, step: float, integrator: str = "RK4", *, approximate: bool = False, actuators: bool = False
) -> str:
    """Render the robot as MJCF; ``actuators``: with a motor per coordinate; else as ``export_mjcf``."""
    robot = as_robot(robot)
    _check(robot, integrator, approximate)
    if isinstance(step, bool) or not (isinstance(step, (int, float)) and 1e-9 <= step < 1e9):
        raise InputError(f"step: {step!r} is no length of a step; allowed: a finite number of at least 1e-9 s")
    robot = robot.without_states()
    root = ElementTree.Element("mujoco", model=robot.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    values = {"timestep": repr(float(step)), "gravity": text_of(robot.gravity), "integrator": integrator}
    option = ElementTree.SubElement(root, "option", values)
    ElementTree.SubElement(option, "flag", contact="disable")
    bodies = {robot.base: ElementTree.SubElement(root, "worldbody")}
    sizes = link_sizes({link.name: link for link in robot.links}, robot.joints)
    whole = balls(robot)
    for joint in robot.joints:
        link, as_one = robot.link(joint.child), whole.get(joint.name, ())
        bodies[joint.child] = _add_body(bodies[joint.parent], joint, link, sizes[joint.child], as_one)
    for frame in robot.frames:
        ElementTree.SubElement(bodies[frame.link], "site", {"name": frame.name, **_place(frame.placement)})
    _add_tendons(root, robot, bodies)
    if robot.loops or robot.couplings:
        add_equalities(root, robot, bodies, positions(robot, assembled_home(robot.with_constraints())), step)
    speeds = {name: robot.limits_of(name).velocity for name in coordinate_names(robot)}
    if any(speeds.values()):
        section = ElementTree.SubElement(root, "custom")
        for name, speed in speeds.items():
            if speed is not None:
                ElementTree.SubElement(section, "numeric", name=f"{name}{VELOCITY}", data=repr(speed))
    if actuators:
        section = ElementTree.SubElement(root, "actuator")
        for name in coordinate_names(robot):
            if kind_of(name) in whole.get(joint_of(name), ()):
                continue  # no motor of MuJoCo acts on an angle of these
            ElementTree.SubElement(section, "motor", name=name, joint=name)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _without_friction(robot: Robot) -> Robot:
    """Return the robot as MuJoCo integrates it: Coulomb friction is a constraint there, without internal states."""
    joints = []
    for joint in robot.without_states().joints:
        coordinates = {k: replace(x, friction=_viscous(x.friction)) for k, x in joint.coordinates.items()}
        motor = joint.motor and replace(joint.motor, friction=_viscous(joint.motor.friction))
        joints.append(replace(joint, coordinates=coordinates, motor=motor))
    return replace(robot.without_states(), joints=tuple(joints))


def _viscous(friction: Friction | None) -> Friction | None:
    return None if friction is None else Friction(viscous=friction.viscous)


def _check(robot: Robot, integrator: str, approximate: bool) -> None:
    """Raise InputError for what cannot be written."""
    if integrator not in INTEGRATORS:
        raise InputError(f"integrator: {integrator!r} is unknown; allowed: {', '.join(INTEGRATORS)}")
    if any(link.name == _GROUND for link in robot.links):
        raise InputError(f"{robot.name}: the link {_GROUND!r} has MuJoCo's name of the ground; allowed: another name")
    bending = [link.name for link in robot.links if link.modes is not None]
    if bending:
        raise InputError(
            f"links.{bending[0]}.modes: no link of MuJoCo bends; allowed: segments=N (--segments N), which makes chains"
            " of rigid segments of links that are beams, and [[beams]], which are such"
        )
    missing = [] if approximate else left_out(robot)
    if missing:
        more = f" (and {len(missing) - 4} more)" if len(missing) > 4 else ""
        way = "allowed: without, or approximate=True (--approximate), which writes the rest"
        raise InputError(f"{robot.name}: MuJoCo has no equal for {'; '.join(missing[:4])}{more}; {way}")


def left_out(robot: Robot) -> list[str]:
    """Return notes on all that MuJoCo has no equal for: its name, and what becomes of it."""
    notes = [*held_softly(robot), *damped_otherwise(robot)]
    for joint in robot.joints:
        for name in joint.coordinates:
            notes += [f"joints.{joint.name}.{name}.{what}" for what in _unknown(_by_itself(joint, name))]
        if joint.motor is not None:
            where = f"joints.{joint.name}.{MOTOR}"
            notes += [f"{where}.{what}" for what in (*_unknown(joint.motor.transmission), *_unknown(joint.motor.rotor))]
            if joint.motor.transmission.preload:
                notes.append(f"{where}.preload: left out")
        for table, element in joint.elements.items():
            notes += [f"joints.{joint.name}.{table}{what}" for what in element.mujoco_lacks()]
    for between in robot.link_elements:
        notes += [f"{between.prefix}{what}" for what in between.mujoco_lacks()]
    return notes


def _unknown(coordinate: Coordinate) -> Iterator[str]:
    """Yield numbers of a coordinate's forces that joints and tendons lack."""
    if coordinate.prescribed:
        yield "prescribed: free to move"
    numbers = coordinate.law() | ({} if coordinate.stiffness is None else {"stiffness": coordinate.stiffness})
    for law in active_laws(numbers):
        note = law.mjcf(numbers)
        if note:
            yield f"{law.name}: {note}"


def _add_body(
    parent: ElementTree.Element, joint: Joint, link: Link, size: float, as_one: Sequence[str]
) -> ElementTree.Element:
    """Add the link, which is so large (m), as a body in its frame, with its joints; ``as_one`` as of ``balls``.

    Offsets of angles that do not move are moved to the front, past the motions before them, whose axes they turn.
    """
    turn, behind = np.array(joint.axis_turn), np.eye(3)
    offset = dict(zip(COORDINATES, (value or 0.0 for value in joint.offset), strict=True))
    motions = []
    for name in reversed(COORDINATES):
        axis = np.eye(3)[COORDINATES.index(name) % 3]
        if name in joint.coordinates:
            motions.append((name, turn @ behind.T @ axis))
        elif name in ANGULAR and offset[name]:
            behind = about(axis, offset[name]) @ behind
    outer = np.array(joint.placement.rotation)
    still = np.array([0.0 if name in joint.coordinates else offset[name] for name in COORDINATES[:3]])
    placed = Placement(
        triple(np.array(joint.placement.xyz) + outer @ turn @ still),
        joint.placement.rotation if np.array_equal(behind, np.eye(3)) else matrix(outer @ turn @ behind @ turn.T),
    )
    body = ElementTree.SubElement(parent, "body", {"name": joint.child, **_place(placed)})
    if joint.coordinates or link.mass > 0.0:
        ElementTree.SubElement(body, "inertial", _inertial(link, size))
    for name, axis in reversed(motions):
        if name not in as_one:
            _add_joint(body, joint, name, axis, offset[name])
    if as_one:
        kind = "free" if len(as_one) == len(COORDINATES) else "ball"
        ElementTree.SubElement(body, "joint", {**ball_values(joint), "type": kind})
    if joint.motor is not None:
        name = component_name(joint.name, MOTOR)
        rotor = ElementTree.SubElement(body, "body", name=name, pos=text_of(link.com))
        least = {"mass": repr(LEAST), "pos": "0 0 0", "diaginertia": text_of([LEAST] * 3)}
        ElementTree.SubElement(rotor, "inertial", least)
        armature = max(joint.motor.inertia - LEAST, 0.0)  # the rest is the body's
        attributes = {"name": name, "type": "hinge", "axis": text_of(turn[:, 2]), "armature": repr(armature)}
        attributes |= _limited(joint.motor.rotor, joint.limits_of(MOTOR))
        ElementTree.SubElement(rotor, "joint", attributes | _friction(joint.motor.friction))
    return body


def _add_joint(body: ElementTree.Element, joint: Joint, name: str, axis: Array, offset: float) -> None:
    coordinate, more = _by_itself(joint, name), hinge_damping(joint, name)
    if more:
        coordinate = replace(coordinate, damping=(coordinate.damping or 0.0) + more)
    values = {
        "name": component_name(joint.name, name),
        "type": "hinge" if name in ANGULAR else "slide",
        "axis": text_of(axis),
    }
    values |= spring_values(coordinate)
    if coordinate.preload and coordinate.stiffness and not coordinate.cubic:
        values["springref"] = repr(-coordinate.preload / coordinate.stiffness)
    if coordinate.armature:
        values["armature"] = repr(coordinate.armature)
    if offset:
        values["ref"] = repr(-offset)
    values |= _limited(coordinate, joint.limits_of(name))
    friction = _friction(coordinate.friction)
    if "damping" in friction:
        friction["damping"] = repr(float(friction["damping"]) + (coordinate.damping or 0.0))
    ElementTree.SubElement(body, "joint", values | friction)


def _by_itself(joint: Joint, name: str) -> Coordinate:
    """Return a coordinate with what the diagonal and the preload of the joint's stiffness matrix add to it."""
    coordinate, matrix = joint.coordinates[name], joint.stiffness
    if matrix is None or name not in matrix.coordinates:
        return coordinate
    stiffness = (coordinate.stiffness or 0.0) + matrix.entries.get(entry_name(name, name), 0.0)
    preload = (coordinate.preload or 0.0) + matrix.preload.get(name, 0.0)
    return replace(coordinate, stiffness=stiffness or None, preload=preload or None)


def _limited(coordinate: Coordinate, limits: Limits) -> dict[str, str]:
    """Return ranges between a coordinate's stops, or of its limits and effort, which act only where switched on.

    MuJoCo's have two ends: a missing one is far away.
    """
    attributes = dict[str, str]()
    if "stops.stiffness" in coordinate.further:
        ends = coordinate.further.get("stops.lower", -_FAR), coordinate.further.get("stops.upper", _FAR)
        attributes = {"range": text_of(ends), "limited": "true" if coordinate.further["stops.stiffness"] else "false"}
    elif any(map(math.isfinite, limits.range)):
        attributes = {"range": text_of([max(limits.range[0], -_FAR), min(limits.range[1], _FAR)]), "limited": "false"}
    if limits.effort is not None:
        attributes["actuatorfrcrange"] = text_of([-limits.effort, limits.effort])
        attributes["actuatorfrclimited"] = "false"
    return attributes


def _friction(friction: Friction | None) -> dict[str, str]:
    """Return attributes: viscous friction as damping, Coulomb friction as frictionloss."""
    if friction is None:
        return {}
    viscous = {"damping": repr(friction.viscous)} if friction.viscous else {}
    return viscous | ({"frictionloss": repr(friction.coulomb)} if friction.coulomb else {})


def _inertial(link: Link, size: float) -> dict[str, str]:
    """Return the mass and inertia; principal moments of second moments of at least LEAST where one would be less."""
    xx, yy, zz, xy, xz, yz = link.inertia
    values = {"mass": repr(max(link.mass, LEAST)), "pos": text_of(link.com)}
    moments, axes = np.linalg.eigh(second_moments([link])[0])
    least = max(LEAST, 1e-13 * float(moments[2]))
    if moments[0] >= least:
        return {**values, "fullinertia": text_of([xx, yy, zz, xy, xz, yz])}
    if lowest_moments([link], [size])[0] < 0.0:
        raise InputError(
            f"links.{link.name}.inertia: no body can have {show(list(link.inertia))}, and MuJoCo takes none; "
            "allowed: a body's, as inertia = 'project' (--inertia project) makes it"
        )
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    a, b, c = np.maximum(moments, least)
    if link.inertia[3:] == (0.0, 0.0, 0.0):  # no round-off where the axes are the link's
        axes, (a, b, c) = np.eye(3), np.maximum(np.diag(second_moments([link])[0]), least)
    return {**values, "diaginertia": text_of([b + c, a + c, a + b]), "xyaxes": _axes(axes)}


def _add_tendons(root: ElementTree.Element, robot: Robot, bodies: Bodies) -> None:
    """Add point-to-point springs as straight tendons, transmissions as fixed ones."""
    motors = [joint for joint in robot.joints if joint.motor is not None]
    springs = [spring for spring in robot.springs if spring.curve is None]
    if not motors and not springs:
        return
    tendons = ElementTree.SubElement(root, "tendon")
    for joint in motors:
        assert joint.motor is not None
        transmission = joint.motor.transmission
        values = {"name": f"{joint.name}.transmission", "springlength": "0", **spring_values(transmission)}
        tendon = ElementTree.SubElement(tendons, "fixed", values)
        ends = ((MOTOR, 1.0 / joint.motor.ratio), (joint.principal, -1.0))
        for name, coefficient in ends:
            ElementTree.SubElement(tendon, "joint", joint=component_name(joint.name, name), coef=repr(coefficient))
    for spring in springs:
        _add_spring(tendons, bodies, spring)


def _add_spring(tendons: ElementTree.Element, bodies: Bodies, spring: Spring) -> None:
    rest = spring.free_length or 0.0
    slack = (0.0, rest + 0.5 * (spring.smoothing or 0.0)) if spring.tension_only else (rest,)
    damping = 0.0 if spring.tension_only else spring.damping or 0.0
    values = {"name": spring.name, "springlength": text_of(slack), "stiffness": repr(spring.stiffness or 0.0)}
    tendon = ElementTree.SubElement(tendons, "spatial", values | {"damping": repr(damping)})
    for end, (link, point) in enumerate(zip(spring.links, spring.points, strict=True)):
        ElementTree.SubElement(bodies[link], "site", name=f"{spring.name}.{end}", pos=text_of(point))
        ElementTree.SubElement(tendon, "site", site=f"{spring.name}.{end}")


def _place(placement: Placement) -> dict[str, str]:
    """Return pos, and the axes where they are turned."""
    place = {"pos": text_of(placement.xyz)}
    return place if placement.rotation == IDENTITY else place | {"xyaxes": _axes(np.array(placement.rotation))}


def _axes(rotation: Array) -> str:
    return text_of(np.concatenate([rotation[:, 0], rotation[:, 1]]))
