"""What a description says of a mechanism as a whole: drives, home and couplings of coordinates.

Each rule returns the place and the message of the first thing that is wrong, so that readers of files and the model
(``robot.model``) refuse alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..names import joint_of, kind_of, listed, nearest, show
from .bounds import Limits
from .coordinates import coordinate_names, unit_of
from .rules import cut_conflict
from .value import (
    ACROSS,
    ANGULAR,
    LINEAR,
    MOTOR,
    PRINCIPAL,
    Coordinate,
    Coupling,
    Robot,
    carriers,
    first_contradiction,
)

Refused = tuple[str, str]  # place, message


def mechanism_conflict(robot: Robot) -> Refused | None:
    """The place and the message of what is wrong with drives, home, couplings or loads; None if nothing is."""
    known = coordinate_names(robot)
    return next(_refusals(robot, known), None)


def _refusals(robot: Robot, known: tuple[str, ...]) -> Iterator[Refused]:
    yield from _drive_refusals(robot, known)
    yield from _home_refusals(robot, known)
    for coupling in robot.couplings:
        yield from _coupling_refusals(robot, coupling, known)
    yield from _load_refusals(robot)
    found = first_contradiction(robot.couplings)
    if found is not None:
        allowed = "rigid couplings of different coordinates, each of what others do not make of it"
        yield f"couplings.{found[0].name}", f"{found[1]}; allowed: {allowed}"


def _drive_refusals(robot: Robot, known: tuple[str, ...]) -> Iterator[Refused]:
    seen: dict[str, str] = {}
    for name in robot.driven or ():
        if name not in known:
            yield "driven", f"{unknown(name, known)} (allowed: {listed(known)})"
            continue
        drive = drive_of(robot, name)
        if coordinate_of(robot, drive).prescribed:
            yield "driven", f"the motion of {show(drive)} is prescribed; allowed: coordinates that are not"
        if drive in seen:
            twin = f"{show(name)} is there twice" if seen[drive] == name else f"{show(drive)} drives {show(name)}, too"
            yield "driven", f"{twin}; allowed: one name for each drive"
        seen[drive] = name


def _home_refusals(robot: Robot, known: tuple[str, ...]) -> Iterator[Refused]:
    for name, value in robot.home.items():
        if name not in known:
            yield "home", f"{unknown(name, known)} (allowed: {listed(known)})"
            continue
        low, high = robot.limits_of(name).range
        if not low <= value <= high:
            yield f"home.{name}", f"got {show(value)}; allowed: within the limits, {low:g} to {high:g} {unit_of(name)}"


def _load_refusals(robot: Robot) -> Iterator[Refused]:
    """Refuse friction with a coefficient where nothing presses, or where its radius is missing or means nothing."""
    places: list[tuple[str, str, Mapping[str, Coordinate]]] = []
    for kind, owners in (("joints", robot.joints), ("loops", robot.loops)):
        places += [(f"{kind}.{x.name}.{name}", name, x.coordinates) for x in owners for name in x.coordinates]
    for where, name, coordinates in places:
        given = coordinates[name].friction
        if given is None or given.coefficient is None:
            continue
        if name in ANGULAR and given.radius is None:
            yield f"{where}.friction.coefficient", "there is no radius; allowed: with the radius at which it rubs, m"
        if name in LINEAR and given.radius is not None:
            yield f"{where}.friction.radius", f"{name} does not turn; allowed: in alpha, beta and gamma"
        if not carriers(name, coordinates):
            which = " or ".join(ACROSS[name])
            message = f"nothing presses: no spring or damper carries a force across it; allowed: with {which} active"
            yield f"{where}.friction.coefficient", f"{message} beside it, with a stiffness, damping, or another force"
    alone = [(f"joints.{x.name}.{MOTOR}", x.motor.friction) for x in robot.joints if x.motor is not None]
    alone += [(f"couplings.{x.name}", x.law.friction) for x in robot.couplings if x.law is not None]
    for where, given in alone:
        if given is not None and given.coefficient is not None:
            message = "no joint presses on it; allowed: in coordinates of joints and of cut joints"
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
    found = cut_conflict(coupling.law)
    if found is not None:
        yield ".".join(filter(None, (where, found[0]))), found[1]


def unknown(name: str, known: tuple[str, ...]) -> str:
    """Say that there is no coordinate of that name."""
    return f"there is no coordinate {show(name)}{nearest(name, known)}"


def coordinate_of(robot: Robot, name: str) -> Coordinate:
    """Properties of a coordinate by its name; of a motor those of its rotor."""
    return robot.joint(joint_of(name)).all_coordinates[kind_of(name)]


def effort_of(robot: Robot, name: str) -> float | None:
    """Return the greatest force of the drive at a coordinate, N or N m; None where there is no limit.

    A joint's own limit holds behind the gear of its motor, too.
    """
    joint, kind = robot.joint(joint_of(name)), kind_of(name)
    found = joint.limits_of(kind)
    if kind == MOTOR and joint.motor is not None:
        at_joint = Limits(effort=joint.limits_of(PRINCIPAL[joint.type]).effort)
        found = found.within(at_joint.behind(1.0 / joint.motor.ratio))
    return found.effort


def drive_of(robot: Robot, name: str) -> str:
    """The coordinate that a drive at a coordinate acts on: the motor, where one drives it."""
    joint = robot.joint(joint_of(name))
    return f"{joint.name}.{MOTOR}" if joint.motor is not None and kind_of(name) == PRINCIPAL[joint.type] else name
