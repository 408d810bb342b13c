"""Rules of numbers that exclude or need each other, of a coordinate and of a motor.

Each rule returns the key and the message of the first conflict, so that readers of files can say where it stands
(``description``) and the model can refuse a robot that was made in Python (``robot.model``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from ..limits import LARGEST
from ..names import listed, nearest, show
from .bounds import limits_conflict
from .internal_states.drives import DRIVE, has_drive
from .laws import LAWS, NUMBERS, active_laws, curve_conflict, law_conflict
from .value import CUT_NUMBERS, MOTOR, PRINCIPAL, Coordinate, Motor

ROTORS = tuple(law.name for law in LAWS.values() if law.of_rotor)
STIFF = (  # springs by themselves, of robots without internal states, too
    "stiffness",
    *(law.name for law in LAWS.values() if law.stiffness and not (law.takes_stiffness or law.states)),
)
FURTHER = tuple(  # numbers of laws that a Coordinate has no field for
    key for key in NUMBERS if key.partition(".")[0] not in {item.name for item in fields(Coordinate)}
)


def motor_conflict(motor: Motor, kind: str, active: Mapping[str, Coordinate]) -> tuple[str, str] | None:
    """Return the key ("" for the table) and the message of what is wrong with a motor in a joint; None if nothing is.

    Args:
        kind: the joint's type.
        active: the joint's coordinates.
    """
    if kind not in PRINCIPAL:
        return "", f"a {kind} joint has no principal coordinate to drive; allowed for: {', '.join(PRINCIPAL)}"
    if PRINCIPAL[kind] not in active:
        return "", f"{PRINCIPAL[kind]} is locked, so that the motor would drive nothing; leave one of the two out"
    if not 0.0 < motor.inertia <= LARGEST:
        return "inertia", f"got {motor.inertia!r}; allowed: a finite number greater than 0, kg m^2"
    if not 1.0 / LARGEST <= abs(motor.ratio) <= LARGEST:
        return "ratio", f"got {motor.ratio!r}; allowed: a finite number that is not 0"
    spring = motor.transmission
    if spring.stiffness is None and not any(law.name in STIFF for law in active_laws(spring.law())):
        return "stiffness", f"there is no spring between motor and joint; allowed: with one of {', '.join(STIFF)}"
    of_rotor = [law.name for law in active_laws(spring.law()) if law.of_rotor]
    if of_rotor or spring.armature is not None or spring.prescribed or spring.limits is not None:
        which = ", ".join((*ROTORS, "limits"))
        return "", f"{which} and role belong to the {MOTOR} itself, and a transmission has no armature"
    for law in active_laws(motor.rotor.law()):
        if not law.of_rotor:
            return "further", f"{law.name} is no law of a rotor; allowed: {', '.join(ROTORS)}"
    return coordinate_conflict(spring) or coordinate_conflict(motor.rotor)


def coordinate_conflict(coordinate: Coordinate) -> tuple[str, str] | None:
    """Return the key and the message of numbers of a coordinate that do not go together; None if all do."""
    for key in coordinate.further:
        if key not in FURTHER:
            known = listed(FURTHER) or "none"
            return "further", f"{show(key)} is no number of a law{nearest(key, FURTHER)}; allowed: {known}"
    first = limits_conflict(coordinate.limits) if coordinate.limits is not None else None
    if first is not None:
        return first
    numbers = coordinate.law()
    if coordinate.prescribed and has_drive(numbers):
        return "drive", "the motion is prescribed, so that a drive would do nothing; allowed: coordinates that are not"
    if coordinate.stiffness is not None:
        numbers["stiffness"] = coordinate.stiffness
    first = law_conflict(numbers)
    return curve_conflict(coordinate.curve) if first is None and coordinate.curve is not None else first


def cut_conflict(coordinate: Coordinate) -> tuple[str, str] | None:
    """Return the key and the message of what is wrong with forces in a loop joint or coupling; None if nothing is."""
    if coordinate.armature is not None:
        laws = [name for name in LAWS if name != DRIVE]
        return "armature", f"it moves no inertia; allowed: {', '.join((*CUT_NUMBERS, *laws))}"
    if coordinate.prescribed:
        return "", "it has no motion to prescribe; allowed: prescribed coordinates of joints"
    if has_drive(coordinate.law()):
        return DRIVE, "nothing drives it; allowed: drives of joints' coordinates, and of motors"
    if coordinate.limits is not None:
        return "limits", "it has no drive and no motion; allowed: limits of joints' coordinates"
    return coordinate_conflict(coordinate)


def unmoved(first: str, second: str) -> str:
    """Return the message about two links of a loop or force element between which no joint moves."""
    return (
        f"the links {show(first)} and {show(second)} do not move against each other; allowed: links with a moving joint"
        " between them"
    )
