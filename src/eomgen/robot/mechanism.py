"""Rules of a mechanism as a whole: drives, home and couplings of coordinates.

Each rule returns the place and the message of the first conflict, so that readers of files and the model
(``robot.model``) refuse alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..limits import LARGEST
from ..names import joint_of, kind_of, listed, nearest, show
from .bounds import Limits
from .coordinates import coordinate_names, unit_of
from .internal_states.drives import DRIVE, has_drive
from .joint_types import JOINT_TYPES, OWN_COORDINATES
from .laws import states_of
from .rules import cut_conflict
from .value import (
    ACROSS,
    ANGULAR,
    LINEAR,
    MOTOR,
    Coordinate,
    Coupling,
    Robot,
    carriers,
    first_contradiction,
)

Refused = tuple[str, str]  # place, message

AT_HOME = 1e-6  # m or rad, relative above 1: allowed difference of a follower's home from its leaders'


def mechanism_conflict(robot: Robot) -> Refused | None:
    """Return the place and the message of what is wrong with drives, home, couplings or loads; None if nothing is."""
    known = coordinate_names(robot)
    return next(_refusals(robot, known), None)


def _refusals(robot: Robot, known: tuple[str, ...]) -> Iterator[Refused]:
    yield from _pitch_refusals(robot)
    yield from _drive_refusals(robot, known)
    yield from _home_refusals(robot, known)
    for coupling in robot.couplings:
        yield from _coupling_refusals(robot, coupling, known)
    yield from _load_refusals(robot)
    contradiction = first_contradiction(robot.couplings)
    if contradiction is not None:
        allowed = "rigid couplings of different coordinates that do not contradict each other"
        yield f"couplings.{contradiction[0].name}", f"{contradiction[1]}; allowed: {allowed}"


def _pitch_refusals(robot: Robot) -> Iterator[Refused]:
    """Refuse screws without a pitch, a pitch of other joints, and screws whose own coordinates do not both move."""
    names = [coupling.name for coupling in robot.couplings]
    owners = {joint_of(x.of): x.name for x in robot.couplings if x.pitch is not None}
    able = [name for name, kind in JOINT_TYPES.items() if kind.has_pitch]
    for joint in robot.joints:
        where, has_pitch = f"joints.{joint.name}", joint.type in able
        if joint.pitch is None and not has_pitch:
            continue
        if joint.pitch is None or not has_pitch:
            message = f"a {joint.type} joint has no pitch" if joint.pitch is not None else "the key 'pitch' is missing"
            yield f"{where}.pitch", f"{message}; allowed: m per revolution, for {listed(able)}"
        elif not 1.0 / LARGEST <= abs(joint.pitch) <= LARGEST:
            allowed = "a finite number that is not 0, m per revolution (a revolute joint has no lead)"
            yield f"{where}.pitch", f"got {show(joint.pitch)}; allowed: {allowed}"
        elif names.count(owners[joint.name]) > 1:
            message = f"its z follows gamma by a coupling of the name {owners[joint.name]}, which is taken"
            yield where, f"{message}; allowed: another name of either"
        for name in OWN_COORDINATES[joint.type] if has_pitch else ():
            if name not in joint.coordinates:
                yield f"{where}.{name}", f"it is locked, and z follows gamma in a {joint.type}; allowed: that both move"
            elif name != joint.principal and joint.coordinates[name].prescribed:
                yield f"{where}.{name}", f"it follows {joint.principal}; allowed: a prescribed {joint.principal}"


def _drive_refusals(robot: Robot, known: tuple[str, ...]) -> Iterator[Refused]:
    seen: dict[str, str] = {}
    for name in robot.driven or ():
        if name not in known:
            yield "driven", f"{unknown(name, known)} (allowed: {listed(known)})"
            continue
        leaders = [x for x, ratio in _leaders(robot).get(name, {name: 1.0}).items() if ratio != 0.0]
        if len(leaders) != 1:
            message = f"{show(name)} follows {listed(leaders) if leaders else 'nothing that moves'}"
            yield "driven", f"{message}; allowed: coordinates that follow no others, or one alone"
            continue
        drive = drive_of(robot, leaders[0])
        if coordinate_of(robot, drive).prescribed:
            yield "driven", f"the motion of {show(drive)} is prescribed; allowed: coordinates that are not"
        if drive in seen:
            twin = f"{show(name)} is there twice" if seen[drive] == name else f"{show(drive)} drives {show(name)}, too"
            yield "driven", f"{twin}; allowed: one name for each drive"
        seen[drive] = name
    actuated = driven_coordinates(robot, known)
    for name in known:
        if name not in actuated and has_drive(coordinate_of(robot, name).law()):
            allowed = f"coordinates that are driven: {listed(actuated) or 'none here'}"
            yield f"joints.{name}.{DRIVE}", f"nothing drives {show(name)} (see driven); allowed: {allowed}"


def _home_refusals(robot: Robot, known: tuple[str, ...]) -> Iterator[Refused]:
    for name, value in robot.home.items():
        if name not in known:
            yield "home", f"{unknown(name, known)} (allowed: {listed(known)})"
            continue
        low, high = robot.limits_of(name).range
        if not low <= value <= high:
            yield f"home.{name}", f"got {show(value)}; allowed: within the limits, {low:g} to {high:g} {unit_of(name)}"
    leaders = _leaders(robot)
    for name, there in follower_positions(robot, leading_home(robot)).items():
        said = robot.home.get(name, there)
        if abs(said - there) > AT_HOME * max(1.0, abs(there)):
            message = f"got {show(said)}, but it follows {listed(leaders[name]) or 'nothing that moves'}"
            yield f"home.{name}", f"{message}; allowed: {there:.9g} {unit_of(name)}, or nothing"


def _load_refusals(robot: Robot) -> Iterator[Refused]:
    """Refuse load-dependent friction without a load, or where its radius is missing or means nothing."""
    places: list[tuple[str, str, Mapping[str, Coordinate]]] = []
    for kind, owners in (("joints", robot.joints), ("loops", robot.loops)):
        places += [(f"{kind}.{x.name}.{name}", name, x.coordinates) for x in owners for name in x.coordinates]
    for where, name, coordinates in places:
        friction = coordinates[name].friction
        if friction is None or friction.coefficient is None:
            continue
        if name in ANGULAR and friction.radius is None:
            yield f"{where}.friction.coefficient", "there is no radius; allowed: with the friction radius, m"
        if name in LINEAR and friction.radius is not None:
            yield f"{where}.friction.radius", f"{name} does not turn; allowed: in alpha, beta and gamma"
        if not carriers(name, coordinates):
            which = " or ".join(ACROSS[name])
            message = f"there is no load: no spring or damper carries a force across it; allowed: with {which} active"
            yield f"{where}.friction.coefficient", f"{message} beside it, with a stiffness, damping, or another force"
        for other in carriers(name, coordinates):
            laws = dict.fromkeys(law for law, _ in states_of(coordinates[other].law()) if law != "friction")
            if laws:
                message = f"{other} carries a part of the load by a law with internal states, {', '.join(laws)}"
                yield f"{where}.friction.coefficient", f"{message}; allowed: springs, contacts and dampers across it"
    alone = [(f"joints.{x.name}.{MOTOR}", x.motor.friction) for x in robot.joints if x.motor is not None]
    alone += [(f"couplings.{x.name}", x.law.friction) for x in robot.couplings if x.law is not None]
    for where, friction in alone:
        if friction is not None and friction.coefficient is not None:
            message = "no joint load acts on it; allowed: in coordinates of joints and of loop joints"
            yield f"{where}.friction.coefficient", message


def _coupling_refusals(robot: Robot, coupling: Coupling, known: tuple[str, ...]) -> Iterator[Refused]:
    where = f"couplings.{coupling.name}"
    for key, name in (("of", coupling.of), *(("to", name) for name in coupling.to)):
        if name not in known:
            yield f"{where}.{key}", f"{unknown(name, known)} (allowed: {listed(known)})"
            return
    if coupling.of in coupling.to:
        yield f"{where}.to", f"{show(coupling.of)} is coupled to itself; allowed: other coordinates than that of 'of'"
    if coupling.law is None:
        if coordinate_of(robot, coupling.of).prescribed:
            message = f"the motion of {show(coupling.of)} is prescribed; allowed: a coordinate that is not"
            yield f"{where}.of", f"{message}, which may follow one that is, or a coupling with a stiffness"
        return
    conflict = cut_conflict(coupling.law)
    if conflict is not None:
        yield ".".join(filter(None, (where, conflict[0]))), conflict[1]


def driven_coordinates(robot: Robot, coordinates: Iterable[str]) -> list[str]:
    """Return those of some coordinates that are actuated: motors, and principal ones without, in their order.

    None that is prescribed or follows others in a rigid coupling.  Where the description names them, those: a motor in
    the place of the coordinate that it drives, a leader in that of its follower.
    """
    if robot.driven is not None:
        drives = {drive_of(robot, leading_coordinate(robot, name)) for name in robot.driven}
        return [name for name in coordinates if name in drives]
    principal = [f"{joint.name}.{joint.principal}" for joint in robot.joints if joint.principal]
    drives = {drive_of(robot, name) for name in principal}
    drives -= {coupling.of for coupling in robot.couplings if coupling.law is None}
    return [name for name in coordinates if name in drives and not coordinate_of(robot, name).prescribed]


def leading_coordinate(robot: Robot, name: str) -> str:
    """Return the coordinate that a drive at a coordinate moves: of a follower its leader; itself otherwise."""
    return next((x for x, ratio in _leaders(robot).get(name, {}).items() if ratio != 0.0), name)


def leading_home(robot: Robot) -> dict[str, float]:
    """Return the home of coordinates that follow no other, m or rad, by name.

    The home of a follower determines that of its leader, where it has one leader alone without a home.
    """
    home, shares = dict(robot.home), _leaders(robot)
    if home.keys().isdisjoint(shares):
        return home
    offsets = follower_positions(robot, {})
    for name in shares.keys() & home.keys():
        leader, ratio = next(iter(shares[name].items()), ("", 0.0))
        if len(shares[name]) == 1 and leader not in robot.home and ratio != 0.0:
            home[leader] = (home[name] - offsets[name]) / ratio
    return {name: value for name, value in home.items() if name not in shares}


def follower_limits(robot: Robot, name: str) -> tuple[float, float]:
    """Return the range, m or rad, in which a coordinate keeps followers of it alone within limits; may be infinite."""
    low, high, offsets = -math.inf, math.inf, follower_positions(robot, {})
    for follower, share in _leaders(robot).items():
        joint = robot.joint(joint_of(follower))
        ratio = share.get(name, 0.0)
        if len(share) > 1 or ratio == 0.0 or joint.principal != kind_of(follower):
            continue
        ends = sorted((x - offsets[follower]) / ratio for x in joint.range)
        low, high = max(low, ends[0]), min(high, ends[1])
    return low, high


def position_limits(robot: Robot, name: str) -> tuple[float, float] | None:
    """Return limits of a principal coordinate, m or rad, infinite without any; None of one that is not principal.

    Those of what follows it count, as far as they leave room.
    """
    if name in robot.modal_coordinates:
        return None
    joint = robot.joint(joint_of(name))
    if joint.principal != kind_of(name):
        return None
    low, high = joint.range
    least, most = follower_limits(robot, name)
    return (max(low, least), min(high, most)) if max(low, least) < min(high, most) else (low, high)


def following_text(robot: Robot, name: str) -> str:
    """Say which coordinates one follows, by its name or, where it is principal, its joint's; "" where it is none."""
    for follower, coupling in robot.followers.items():
        joint = robot.joint(joint_of(follower))
        if name == follower or (name == joint.name and joint.principal == kind_of(follower)):
            leaders = listed(list(coupling.to)) or "nothing that moves"
            return f"{follower} follows {leaders} by the coupling {coupling.name} and is no independent coordinate"
    return ""


def _leaders(robot: Robot) -> dict[str, dict[str, float]]:
    """Return ratios of every follower by its leaders, through other followers too."""
    ratios: dict[str, dict[str, float]] = {}
    for name, coupling in robot.followers.items():
        share: dict[str, float] = {}
        for other, ratio in coupling.to.items():
            for leader, behind in ratios.get(other, {other: 1.0}).items():
                share[leader] = share.get(leader, 0.0) + ratio * behind
        ratios[name] = share
    return ratios


def follower_positions(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return positions of followers by the description's numbers, m or rad, by name.

    Args:
        robot: whose couplings count.
        values: numbers or arrays of their leaders, by name; default 0.
    """
    positions: dict[str, Any] = {}
    for name, coupling in robot.followers.items():
        positions[name] = coupling.value(lambda x: positions.get(x, values.get(x, 0.0)))
    return positions


def unknown(name: str, known: tuple[str, ...]) -> str:
    """Say that there is no coordinate of that name."""
    return f"there is no coordinate {show(name)}{nearest(name, known)}"


def coordinate_of(robot: Robot, name: str) -> Coordinate:
    """Return the properties of a coordinate by its name; of a motor those of its rotor."""
    return robot.coordinates[name]


def effort_of(robot: Robot, name: str) -> float | None:
    """Return the greatest force of the drive at a coordinate, N or N m; None where there is no limit.

    A joint's limit holds behind the gear of its motor, too.
    """
    if name in robot.modal_coordinates:
        return None
    joint, kind = robot.joint(joint_of(name)), kind_of(name)
    limits = joint.limits_of(kind)
    if kind == MOTOR and joint.motor is not None:
        at_joint = Limits(effort=joint.limits_of(joint.principal).effort)
        limits = limits.within(at_joint.behind(1.0 / joint.motor.ratio))
    return limits.effort


def drive_of(robot: Robot, name: str) -> str:
    """Return the coordinate that a drive at a coordinate acts on: the motor, where one drives it."""
    if name in robot.modal_coordinates:
        return name
    joint = robot.joint(joint_of(name))
    return f"{joint.name}.{MOTOR}" if joint.motor is not None and kind_of(name) == joint.principal else name
