"""Forces of one coordinate as a description gives them: which numbers go together, and the reading of their table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from .keys import Number
from .names import show
from .robot import MOTOR, PRINCIPAL, SMALLEST, Coordinate, Curve, Friction, Motor
from .robot_keys import COORDINATE, POINTS
from .schema import LARGEST, Table

_ROTOR = "role", "friction"  # of the motor's own coordinate; the rest of its table is the transmission's

_NUMBERS = tuple(key for key, kind in COORDINATE.keys.items() if isinstance(kind, Number))

ReadText = Callable[[str], str]  # the text of a file beside the description


def read_coordinate(table: Table, old: Coordinate, read_text: ReadText) -> Coordinate:
    """The coordinate ``old`` with what its table overrides.

    Args:
        table: of the keys ``robot_keys.COORDINATE``.
        old: what an URDF says of the coordinate, or Coordinate().
        read_text: gives the text of the file that a curve names.

    Raises:
        DescriptionError: a number out of range, a curve that does not rise, or numbers that do not go together.
    """
    given: dict[str, object] = {key: table.number(key) for key in _NUMBERS if key in table.values}
    friction, curve = _friction(table), read_curve(table, read_text)
    if friction is not None:
        given["friction"] = friction
    if curve is not None:
        given["curve"] = curve
    role = table.choice("role")
    if role == "locked" and given:
        table.fail(f"the coordinate is locked, so that its {', '.join(given)} would do nothing; leave it out", "role")
    merged = {**vars(old), **given, "prescribed": old.prescribed if role is None else role == "prescribed"}
    if "clearance" in given and "smoothing" not in given:
        merged["smoothing"] = None  # that of the new clearance
    made = Coordinate(**merged)
    found = conflict(made)
    if found is not None:
        key, message = found
        table.fail(message, key)
    return made


def read_motor(table: Table, read_text: ReadText) -> Motor:
    """The motor of a table of the keys ``robot_keys.MOTOR_FORM``; ``read_text`` and errors as ``read_coordinate``."""
    inertia, ratio = table.number("inertia"), table.number("ratio")
    assert inertia is not None
    assert ratio is not None
    if table.choice("role") == "locked":
        table.fail("a motor cannot be locked; leave its table out, and the drive acts on the joint itself", "role")
    spring = {key: value for key, value in table.values.items() if key in COORDINATE.keys and key not in _ROTOR}
    inner = COORDINATE.read(spring, table.where, table.source, table.path)
    transmission = read_coordinate(inner, Coordinate(), read_text)
    return Motor(inertia, ratio, transmission, _friction(table), table.text("role") == "prescribed")


def motor_conflict(given: Motor, kind: str, active: Mapping[str, Coordinate]) -> tuple[str, str] | None:
    """The key ("" for the table) and the message of what is wrong with a motor in a joint; None if nothing is.

    Args:
        kind: the joint's type.
        active: the joint's coordinates.
    """
    if kind not in PRINCIPAL:
        return "", f"a {kind} joint has no principal coordinate to drive; allowed for: {', '.join(PRINCIPAL)}"
    if PRINCIPAL[kind] not in active:
        return "", f"{PRINCIPAL[kind]} is locked, so that the motor would drive nothing; leave one of the two out"
    if not 0.0 < given.inertia <= LARGEST:
        return "inertia", f"got {given.inertia!r}; allowed: a finite number greater than 0, kg m^2"
    if not 1.0 / LARGEST <= abs(given.ratio) <= LARGEST:
        return "ratio", f"got {given.ratio!r}; allowed: a finite number that is not 0"
    spring = given.transmission
    if spring.stiffness is None and spring.curve is None:
        return "stiffness", "there is no spring between motor and joint; allowed: with a stiffness or a curve"
    if spring.friction is not None or spring.armature is not None or spring.prescribed:
        return "", f"friction and role belong to the {MOTOR} itself, and a transmission has no armature"
    return conflict(replace(spring, friction=given.friction))


def conflict(given: Coordinate) -> tuple[str, str] | None:
    """The key and the message of numbers that do not go together; None if all do."""
    springs = (given.stiffness, given.stiffness_negative)
    if given.clearance is not None:
        if given.stiffness is None or not any(springs):
            return "clearance", "there is no stiffness at the end of it; allowed: with stiffness > 0"
        if given.smoothing is None:
            return "clearance", f"got 0 and no smoothing; allowed: 0 with a smoothing of at least {SMALLEST:g}"
    for key in ("restitution_damping", "smoothing"):
        if given.clearance is None and getattr(given, key) is not None:
            return key, f"there is no clearance; allowed: {key} with clearance"
    if given.stiffness_negative is not None and given.stiffness is None:
        return "stiffness_negative", "there is no stiffness for positive values; allowed: with stiffness"
    if given.curve is not None:
        others = ("stiffness", "stiffness_negative", "cubic", "clearance")
        taken = [key for key in others if getattr(given, key) is not None]
        if taken:
            return "curve", f"{taken[0]} is given, too; allowed: a curve instead of {', '.join(others)}"
        found = curve_conflict(given.curve)
        if found is not None:
            return found
    return None if given.friction is None else _friction_conflict(given.friction)


def curve_conflict(curve: Curve, what: str = "deviation") -> tuple[str, str] | None:
    """The key and the message of what is wrong with a curve's points; None if nothing is.  ``what``: its abscissa."""
    fewest, most = POINTS
    if not fewest <= len(curve) <= most:
        return "curve", f"got {len(curve)} points; allowed: {fewest} to {most}"
    for i in range(1, len(curve)):
        if curve[i][0] - curve[i - 1][0] < SMALLEST:
            return "curve", (
                f"point {i} has the {what} {curve[i][0]!r} after {curve[i - 1][0]!r}; "
                f"allowed: {what}s that rise by at least {SMALLEST:g}"
            )
    return None


def _friction_conflict(given: Friction) -> tuple[str, str] | None:
    if (given.static is None) != (given.stribeck is None):
        return "friction", "static and stribeck belong together; allowed: both or none"
    if given.static is not None and given.static < given.coulomb:
        return "friction.static", f"got {given.static!r}; allowed: at least coulomb, {given.coulomb!r}"
    return None


def _friction(table: Table) -> Friction | None:
    inner = table.table("friction")
    if inner is None:
        return None
    coulomb = inner.number("coulomb")
    assert coulomb is not None
    return Friction(coulomb, **{key: inner.number(key) for key in ("static", "stribeck", "viscous", "smoothing")})


def read_curve(table: Table, read_text: ReadText, what: str = "deviation") -> Curve | None:
    """Points of the key ``curve``: an array, or the path of a CSV file of two columns, ``what`` and force."""
    if "curve" not in table:
        return None
    if not isinstance(table.values["curve"], str):
        return tuple((x, y) for x, y in table.rows("curve", 2))
    value: str = table.value("curve")
    rows: list[list[float]] = []
    named = False
    for number, line in enumerate(read_text(value).splitlines(), 1):
        cells = [cell.strip() for cell in line.split(",")]
        if line.strip().startswith("#") or not line.strip():
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            if not rows and not named and len(cells) == 2:
                named = True  # the columns' names
                continue
            row = []
        if len(row) != 2:
            table.fail(f"{value}, line {number}: got {show(line)}; allowed: {what},force", "curve")
        rows.append(row)
    checked = Table({"curve": rows}, table.where, table.source, table.keys)
    return tuple((x, y) for x, y in checked.rows("curve", 2))
