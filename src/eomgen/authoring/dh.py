"""Descriptions of serial arms from tables of Denavit-Hartenberg parameters; what ``eomgen new --dh`` writes.

Conventions, q added to theta (revolute) or d (prismatic):

    modified (Craig; Khalil and Kleinfinger): T_(i-1,i) = Rx(alpha) Tx(a) Rz(theta) Tz(d)
    classic (Denavit and Hartenberg; Paul, Spong): T_(i-1,i) = Rz(theta) Tz(d) Tx(a) Rx(alpha)

Joint frames of a description are modified ones.  A classic frame i is the modified one moved by Tx(a_i) Rx(alpha_i): so
are centres of mass and inertia tensors that a classic table gives, and the tool's frame.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

from ..description.load import robot_from_toml
from ..errors import InputError
from ..files import csv_cells
from ..forms.toml_text import read_text
from ..identifiers import (
    IDENTIFIER_RULE,
    ROBOT_RULE,
    check_kind,
    is_identifier,
    is_robot_name,
    plain_path,
    show_path,
    to_robot_name,
)
from ..limits import MOST_ENTRIES
from ..names import listed, nearest, show
from ..robot.geometry import IDENTITY, ZERO, Matrix, Placement, Vector, turn_inertia
from ..robot.joint_types import OWN_COORDINATES, PRINCIPAL
from ..robot.value import INERTIA_KEYS, LINEAR, Robot
from .schema_files import schema_path

CONVENTIONS = ("classic", "modified")
JOINTS = tuple(name for name, own in OWN_COORDINATES.items() if len(own) <= 1)
_LENGTHS, _ANGLES, _ENDS = ("a", "d"), ("alpha", "theta"), ("lower", "upper")
_COM, _INERTIA = ("com_x", "com_y", "com_z"), tuple(f"i{key}" for key in INERTIA_KEYS)
COLUMNS = (
    *("joint", "type", "a", "a_mm", "alpha", "alpha_deg", "d", "d_mm", "theta", "theta_deg"),
    *("lower", "lower_deg", "upper", "upper_deg", "mass", *_COM, *_INERTIA),
)
ASSUMED_MASS = 1.0  # kg, of links whose mass the table does not give
ASSUMED_RADIUS = 0.05  # of the arm's length: of the ball whose inertia a link has where the table gives none
_MOST = 1e8  # m, rad, deg, kg or kg m^2: what follows from so many rows stays within the limits of descriptions
_SIZE = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?"
_NUMBER = re.compile(  # 0.5, -1e-3, pi/2, -3 pi / 4; no two repeats of blanks or digits side by side: in linear time
    rf"(?P<sign>[+-]?) *(?:(?:(?P<factor>{_SIZE}) *)?(?:\* *)?(?P<pi>pi)|(?P<number>{_SIZE}))"
    rf"(?: */ *(?P<divisor>{_SIZE}))?"
)
_SIGNS = str.maketrans({"\N{GREEK SMALL LETTER PI}": "pi", "\N{MINUS SIGN}": "-"})
Table = str | Path | Sequence[Mapping[str, object]]


@dataclass(frozen=True)
class _Row:
    """One row: numbers in m, rad, kg by their columns; ``degrees``: angles that the table has in degrees, as there."""

    where: str
    joint: str
    type: str
    numbers: Mapping[str, float]
    degrees: Mapping[str, float]

    def get(self, key: str) -> float:
        """Return a number, 0 where the table has none."""
        return self.numbers.get(key, 0.0)

    @property
    def link(self) -> tuple[float, Vector, tuple[float, ...]] | None:
        """Mass, centre of mass and inertia in the table's frame; None where the table has no mass."""
        if "mass" not in self.numbers:
            return None
        x, y, z = map(self.get, _COM)
        return self.numbers["mass"], (x, y, z), tuple(map(self.get, _INERTIA)) if self.has_inertia else ()

    @property
    def has_inertia(self) -> bool:
        """Whether the table gives an inertia tensor."""
        return any(key in self.numbers for key in _INERTIA)


def dh_file_text(name: str, table: Table, convention: str) -> str:
    """Write the description of a serial arm as TOML.

    Args:
        name: of the robot.
        table: path of a .csv file whose header names columns of ``COLUMNS``, or a mapping from such names for each row.
            Rows stand in the order of the joints; a last row of the type "fixed" places the frame tcp on the last link.
        convention: "classic" or "modified", see above.

    Raises:
        InputError: the table is none; says line and column, what came and what is allowed.
    """
    check_kind("name", name, isinstance(name, str), "a name")
    check_kind("convention", convention, isinstance(convention, str), "classic or modified")
    check_kind("table", table, isinstance(table, (str, Path, list, tuple)), "the path of a table, or its rows")
    if not is_robot_name(name):
        hint = f", such as {to_robot_name(name)!r}" if name else ""
        raise InputError(f"new: got the name {show(name)}; allowed: {ROBOT_RULE}{hint}")
    if convention not in CONVENTIONS:
        raise InputError(
            f"convention: got {show(convention)}; allowed: classic, which is Rz(theta) Tz(d) Tx(a) Rx(alpha), or"
            " modified, which is Rx(alpha) Tx(a) Rz(theta) Tz(d)"
        )
    if isinstance(table, (str, Path)):
        rows, source, place = _rows(Path(table)), show_path(Path(table).name), plain_path(table)
    else:
        whole = all(isinstance(row, Mapping) for row in table)
        check_kind("table", table, whole, "the path of a table, or its rows as mappings")
        rows, source, place = [_row(f"row {i + 1}", i, row.items()) for i, row in enumerate(table)], "rows", "table"
    _check_rows(rows, place)
    return "\n".join(_lines(name, rows, convention, source)) + "\n"


def robot_from_dh(name: str, table: Table, convention: str) -> Robot:
    """Read the robot that ``dh_file_text`` describes; arguments and errors as there."""
    return robot_from_toml(dh_file_text(name, table, convention), source=f"{name}.toml")


# The table


def _rows(path: Path) -> list[_Row]:
    """Read the rows of a .csv file; lines that are empty or begin with # are left out."""
    source = plain_path(path)
    lines = enumerate(io.StringIO(read_text(path, str(path), ".csv file"), newline=None), 1)
    places = [(f"{source}:{i}", line) for i, line in lines if line.strip() and line.lstrip()[0] != "#"]
    if not places:
        raise InputError(f"{source}: is empty; allowed: a header of {', '.join(COLUMNS)}, and a row for each joint")
    (head, first), *rest = places
    header = [name.strip() for name in csv_cells(head, first, skip_spaces=True)]
    for column in header:
        _check_column(head, column)
    if len(set(header)) < len(header):
        raise InputError(f"{head}: a column is there twice; allowed: each once")
    rows: list[_Row] = []
    for where, line in rest:
        cells = csv_cells(where, line, skip_spaces=True)
        if len(cells) != len(header):
            raise InputError(f"{where}: has {len(cells)} cells; allowed: {len(header)}, as the header has")
        rows.append(_row(where, len(rows), zip(header, cells, strict=True)))
    return rows


def _check_column(where: str, column: object) -> None:
    if column not in COLUMNS:
        near = nearest(column, COLUMNS) if isinstance(column, str) else ""
        raise InputError(f"{where}: there is no column {show(column)}{near} (allowed: {', '.join(COLUMNS)})")


def _row(where: str, index: int, cells: Iterable[tuple[str, object]]) -> _Row:
    """Return the row of cells by their columns; those that are None or blank are left out."""
    numbers: dict[str, float] = {}
    degrees: dict[str, float] = {}
    words = {"joint": f"joint{index + 1}", "type": JOINTS[0]}
    for column, cell in cells:
        _check_column(where, column)
        if cell is None or (isinstance(cell, str) and not cell.strip()):
            continue
        if column in words:
            words[column] = cell.strip() if isinstance(cell, str) else show(cell)
            continue
        key, _, unit = column.partition("_") if column not in _COM else (column, "", "")
        if key in numbers:
            raise InputError(f"{where}: {key} stands in two units; allowed: one of them")
        value = _number(f"{where}: {column}", cell)
        if unit == "deg":
            degrees[key] = value
        numbers[key] = math.radians(value) if unit == "deg" else value / (1e3 if unit == "mm" else 1.0)
    joint, kind = words["joint"], words["type"]
    if kind not in JOINTS:
        raise InputError(f"{where}: type: got {show(kind)}{nearest(kind, JOINTS)} (allowed: {', '.join(JOINTS)})")
    if not is_identifier(joint):
        raise InputError(f"{where}: joint: got {show(joint)}; allowed: {IDENTIFIER_RULE}")
    if numbers.get("mass", 0.0) < 0.0:
        raise InputError(f"{where}: mass: got {numbers['mass']:g}; allowed: a number that is at least 0")
    return _Row(where, joint, kind, numbers, degrees)


def _number(where: str, cell: object) -> float:
    """Read a number, or a fraction of pi as tables have it: pi/2, -pi, 3 pi/4."""
    value = math.nan
    if isinstance(cell, str):
        match = _NUMBER.fullmatch(cell.translate(_SIGNS).strip().lower())
        if match is not None:
            factor, number, divisor = (float(match[key] or 1.0) for key in ("factor", "number", "divisor"))
            size = (-1.0 if match["sign"] == "-" else 1.0) * (factor * math.pi if match["pi"] else number)
            value = size / divisor if 0.0 < divisor < math.inf else math.nan
    elif isinstance(cell, Real) and not isinstance(cell, bool):
        with suppress(OverflowError):  # of a whole number
            value = float(cell)
    if not abs(value) <= _MOST:
        raise InputError(f"{where}: got {show(cell)}; allowed: a number of magnitude up to {_MOST:g}, or as pi/2")
    return value + 0.0


def _check_rows(rows: Sequence[_Row], place: str) -> None:
    """Raise an InputError where rows do not go together; ``place``: of the table, for messages."""
    moving = [row for row in rows if OWN_COORDINATES[row.type]]
    if not moving or len(rows) > MOST_ENTRIES:
        raise InputError(f"{place}: has {len(rows)} rows; allowed: one and more that move, up to {MOST_ENTRIES}")
    for row in rows[:-1]:
        if not OWN_COORDINATES[row.type]:
            raise InputError(
                f"{row.where}: type: got {row.type!r}; allowed: in the last row, which places the frame tcp"
            )
    names = [row.joint for row in moving]
    for row in moving:
        if names.count(row.joint) > 1:
            raise InputError(f"{row.where}: joint: {show(row.joint)} is there twice; allowed: each name once")
        ends = [end for end in _ENDS if end in row.numbers]
        if len(ends) == 1 or (ends and row.get("lower") > row.get("upper")):
            raise InputError(f"{row.where}: limits: allowed: lower and upper, lower <= upper, or none of them")
        if PRINCIPAL.get(row.type) in LINEAR and row.degrees.keys() & set(_ENDS):
            raise InputError(f"{row.where}: a {row.type} joint has limits in m; allowed: lower and upper")
        inertial = [key for key in (*_COM, *_INERTIA) if key in row.numbers]
        if "mass" not in row.numbers and inertial:
            raise InputError(f"{row.where}: {inertial[0]} stands without mass; allowed: with it")
        missing = [key for key in _INERTIA[:3] if key not in row.numbers]
        if row.has_inertia and missing:
            raise InputError(f"{row.where}: {missing[0]} is missing; allowed: ixx, iyy and izz, or no inertia")
    foreign = [
        key for row in rows if not OWN_COORDINATES[row.type] for key in row.numbers if key not in _LENGTHS + _ANGLES
    ]
    if foreign:
        raise InputError(f"{rows[-1].where}: {foreign[0]} of a fixed row; allowed: a, alpha, d, theta")


# The description


def _lines(name: str, rows: Sequence[_Row], convention: str, source: str) -> Iterator[str]:
    """Write the lines of the description."""
    moving = [row for row in rows if OWN_COORDINATES[row.type]]
    classic = convention == "classic"
    about = "Rz(theta) Tz(d) Tx(a) Rx(alpha)" if classic else "Rx(alpha) Tx(a) Rz(theta) Tz(d)"
    yield f"#:schema ./{schema_path('robot').name}"
    yield f"# A serial arm from the {convention} Denavit-Hartenberg parameters of {source}, {about}; SI units."
    if classic:
        yield "# Frames here are modified ones, Rx(alpha) Tx(a) Rz(theta) Tz(d): those of the table moved back by"
        yield "# Tx(a) Rx(alpha), and with them centres of mass and inertia tensors."
    assumed = [row.joint for row in moving if row.link is None]
    if assumed:
        yield f"# Not in the table, so assumed: the mass of the links of {listed(assumed)}."
    balls = [row.joint for row in moving if not row.has_inertia and row.numbers.get("mass", ASSUMED_MASS)]
    if balls:
        yield f"# Not in the table, so assumed: the inertia of the links of {listed(balls)}, that of a ball."
    yield f'name = "{name}"'
    yield "gravity = [0.0, 0.0, -9.81]"
    length = sum(abs(row.get("a")) + abs(row.get("d")) for row in rows) or 1.0
    for i, row in enumerate(moving):
        yield from _link(f"link{i + 1}", row, classic, ASSUMED_RADIUS * length)
    last: _Row | None = None
    for i, row in enumerate(moving):
        yield from _joint(i, row, last if classic else row)
        last = row
    yield from _tool(moving, rows, classic)


def _link(name: str, row: _Row, classic: bool, radius: float) -> Iterator[str]:
    """Write a link in the modified frame of its joint."""
    move = Placement.from_dh(row.get("a"), row.get("alpha"), 0.0, 0.0) if classic else Placement()
    mass, com, inertia = row.link or (ASSUMED_MASS, ZERO, ())
    placed = _point(move, com) if row.link is not None else ZERO
    yield from ("", "[[links]]", f'name = "{name}"')
    yield f"mass = {mass!r}{'' if row.link is not None else '  # kg, assumed'}"
    yield f"com = [{', '.join(repr(x) for x in placed)}]"
    if inertia:
        xx, yy, zz, xy, xz, yz = turn_inertia((*inertia[:3], *inertia[3:]), move.rotation)  # type: ignore[arg-type]
        numbers = zip(INERTIA_KEYS, (xx, yy, zz, xy, xz, yz), strict=True)
        yield f"inertia = {{ {', '.join(f'{key} = {x + 0.0!r}' for key, x in numbers if x or key[0] == key[1])} }}"
    elif mass:
        ball = float(f"{0.4 * mass * radius**2:.3g}")
        yield f"inertia = {{ xx = {ball!r}, yy = {ball!r}, zz = {ball!r} }}  # kg m^2, assumed"


def _joint(index: int, row: _Row, before: _Row | None) -> Iterator[str]:
    """Write a joint; a and alpha are those of the row before it in a classic table, of this row in a modified one."""
    yield from ("", "[[joints]]", f'name = "{row.joint}"')
    yield f'parent = "{f"link{index}" if index else "base"}"'
    yield f'child = "link{index + 1}"'
    yield f'type = "{row.type}"'
    a, alpha = (before.get("a"), _angle(before, "alpha")) if before is not None else (0.0, "alpha = 0.0")
    yield f"dh = {{ a = {a!r}, {alpha}, d = {row.get('d')!r}, {_angle(row, 'theta')} }}"
    if "lower" in row.numbers:
        yield f"limits = [{row.get('lower')!r}, {row.get('upper')!r}]"


def _angle(row: _Row, key: str) -> str:
    """Write an angle in the unit in which the table has it."""
    return f"{key}_deg = {row.degrees[key]!r}" if key in row.degrees else f"{key} = {row.get(key)!r}"


def _tool(moving: Sequence[_Row], rows: Sequence[_Row], classic: bool) -> Iterator[str]:
    """Write the frame tcp: of the last row of a classic table, then of the fixed row."""
    end = moving[-1]
    pose = Placement.from_dh(end.get("a"), end.get("alpha"), 0.0, 0.0) if classic else Placement()
    if not OWN_COORDINATES[rows[-1].type]:
        a, alpha, d, theta = (rows[-1].get(key) for key in ("a", "alpha", "d", "theta"))
        if classic:  # Rz(theta) Tz(d) and Tx(a) Rx(alpha)
            pose = _product(pose, Placement.from_dh(0.0, 0.0, d, theta))
            pose = _product(pose, Placement.from_dh(a, alpha, 0.0, 0.0))
        else:
            pose = _product(pose, Placement.from_dh(a, alpha, d, theta))
    yield from ("", "[[frames]]", 'name = "tcp"', f'link = "link{len(moving)}"')
    turned = f", rpy = [{', '.join(repr(x) for x in _rpy(pose.rotation))}]" if pose.rotation != IDENTITY else ""
    yield f"placement = {{ xyz = [{', '.join(repr(x) for x in pose.xyz)}]{turned} }}"


def _point(pose: Placement, point: Vector) -> Vector:
    """Return a point of a placed frame in the frame in which it is placed."""
    x, y, z = (
        origin + sum(row[j] * point[j] for j in range(3)) + 0.0
        for origin, row in zip(pose.xyz, pose.rotation, strict=True)
    )
    return x, y, z


def _product(first: Placement, second: Placement) -> Placement:
    """Return the pose of a frame that is placed in a placed frame."""
    a, b = first.rotation, second.rotation
    rows = [[sum(a[i][k] * b[k][j] for k in range(3)) + 0.0 for j in range(3)] for i in range(3)]
    rotation: Matrix = tuple(tuple(row) for row in rows)  # type: ignore[assignment]
    return Placement(_point(first, second.xyz), rotation)


def _rpy(rotation: Matrix) -> Vector:
    """Return roll, pitch and yaw of a rotation Rz(yaw) Ry(pitch) Rx(roll), rad; yaw is 0 where pitch is +-pi/2."""
    across = math.hypot(rotation[0][0], rotation[1][0])
    pitch = math.atan2(-rotation[2][0], across)
    if across > 1e-9:
        return math.atan2(rotation[2][1], rotation[2][2]), pitch, math.atan2(rotation[1][0], rotation[0][0])
    return math.atan2(-rotation[1][2], rotation[1][1]), pitch, 0.0
