"""Reading of the tables of forces: of one coordinate, a motor, a joint as a whole, elements between two links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import DescriptionError, InputError
from ..forms.keys import Either, Key, Listed, Number
from ..forms.plain import value_of
from ..forms.tables import Pair, Sub, Table
from ..names import listed, show
from ..robot.bounds import LIMIT_KEYS, Limits
from ..robot.elements import JOINT_ELEMENTS, KINDS, JointElement, LinkElement
from ..robot.elements.joint_element import MatrixElement, missing_table
from ..robot.elements.joint_stiffness import JointStiffness
from ..robot.elements.matrices import Rows, matrix_conflict
from ..robot.geometry import ZERO
from ..robot.internal_states.branches import BRANCHES
from ..robot.internal_states.bristles import BRISTLES, LUGRE
from ..robot.internal_states.drives import DRIVE, LOOPS
from ..robot.laws import GAUSSIAN
from ..robot.rules import ROTORS, coordinate_conflict
from ..robot.value import COORDINATES, Coordinate, Curve, Motor, Placement
from .keys import COORDINATE
from .matrix_files import ENDINGS, read_matrix

_ROTOR = ("role", "limits", *ROTORS)  # of the motor's coordinate; the rest of its table is the transmission's
ReadText = Callable[[str], str]  # the text of a file beside the description


def read_coordinate(table: Table, old: Coordinate, read_text: ReadText, notes: list[str]) -> Coordinate:
    """Return the coordinate ``old`` with the overrides of its table.

    Args:
        table: of the keys ``COORDINATE``.
        old: the coordinate of a URDF, or Coordinate().
        read_text: returns the text of the file that a curve names.
        notes: is told how well Maxwell branches have a loss factor.

    Raises:
        DescriptionError: a number out of range, a curve that does not rise, or numbers that do not go together.
    """
    numbers: dict[str, float] = {}
    for key, kind in table.keys.items():
        if isinstance(kind, Sub):
            numbers |= {} if key == "limits" else _inner_numbers(table, key)
        elif isinstance(kind, Number) and (number := table.number(key)) is not None:
            numbers[key] = number
    if BRANCHES in table:
        numbers |= _branches(table, numbers.get("stiffness", old.stiffness), notes)
    curve, role = read_curve(table, read_text), table.choice("role") if "role" in table.keys else None
    if role == "locked" and len(table.values) > 1:
        others = ", ".join(key for key in table.keys if key in table and key != "role")
        table.fail(f"the coordinate is locked, so that its {others} would do nothing; leave it out", "role")
    made = replace(
        old.with_numbers(numbers),
        curve=old.curve if curve is None else curve,
        prescribed=old.prescribed if role is None else role == "prescribed",
        limits=_limits(table, old.limits),
    )
    conflict = coordinate_conflict(made)
    if conflict is not None:
        key, message = conflict
        table.fail(message, key)
    return made


def read_motor(table: Table, read_text: ReadText, notes: list[str]) -> Motor:
    """Return the motor of a table of the keys ``MOTOR_FORM``; other arguments and errors as ``read_coordinate``."""
    inertia, ratio = table.number("inertia"), table.number("ratio")
    assert inertia is not None
    assert ratio is not None
    if table.choice("role") == "locked":
        table.fail("a motor cannot be locked; leave its table out, and the drive acts on the joint itself", "role")
    spring = {key: value for key, value in table.values.items() if key in COORDINATE.keys and key not in _ROTOR}
    inner = COORDINATE.read(spring, table.where, table.source, table.path)
    transmission = read_coordinate(inner, Coordinate(), read_text, notes)
    rotor_numbers = {key: number for name in ROTORS for key, number in _inner_numbers(table, name).items()}
    rotor = Coordinate().with_numbers(rotor_numbers)
    prescribed, limits = table.text("role") == "prescribed", _limits(table, None)
    return Motor(inertia, ratio, transmission, rotor.friction, prescribed, rotor.further, limits)


def _limits(table: Table, old: Limits | None) -> Limits | None:
    """Return the limits of a coordinate or motor, with the overrides of its table's key ``limits``, if any."""
    inner = table.table("limits") if "limits" in table.keys else None
    if inner is None:
        return old
    numbers = {key: number for key in LIMIT_KEYS if (number := inner.number(key)) is not None}
    if not numbers:
        table.fail(f"there is none; allowed: one or more of {', '.join(LIMIT_KEYS)}", "limits")
    return replace(old or Limits(), **numbers)


def joint_elements(
    entry: Table,
    coordinates: Mapping[str, Coordinate],
    folder: Path | None,
    notes: list[str],
    free: Sequence[str] = (),
) -> dict[str, Any]:
    """Return force elements of a tree or loop joint as a whole, which has these coordinates, by their keys.

    Args:
        entry: the joint's table.
        folder: where files of matrices are looked for; None where there is none.
        notes: is told what is left out.
        free: coordinates that move, too, and have no table.

    Raises:
        DescriptionError: a number is missing or out of range, or the coordinates do not go with an element.
    """
    elements: dict[str, Any] = {}
    for key, kind in JOINT_ELEMENTS.items():
        table = entry.table(key) if key in entry.keys else None
        if table is not None:
            elements[key] = whole_element(kind, table, coordinates, folder, notes, free)
            conflict = elements[key].conflict(coordinates) or missing_table(elements, key)
            if conflict is not None:
                table.fail(conflict[1], conflict[0])
    return elements


def whole_element(
    kind: type[JointElement],
    table: Table,
    coordinates: Mapping[str, Any],
    folder: Path | None,
    notes: list[str],
    free: Sequence[str] = (),
) -> JointElement:
    """Return the element of a table of numbers, or of a matrix of which the rows of what does not move are left out.

    Arguments and errors as of ``joint_elements``.
    """
    if issubclass(kind, MatrixElement) and "matrix" in table:
        return _of_matrix(kind, table, coordinates, folder, notes, free)
    if kind is JointStiffness:
        table.require_one("matrix", f"rows over {', '.join(coordinates) or 'coordinates'}, or six rows")
    if "at" in table:
        table.fail("there is no matrix; allowed: a frame of a matrix of six rows", "at")
    element: JointElement = value_of(kind, _numbers_in(table), table.where)
    return element


def _of_matrix(
    kind: type[MatrixElement],
    table: Table,
    coordinates: Mapping[str, Any],
    folder: Path | None,
    notes: list[str],
    free: Sequence[str],
) -> MatrixElement:
    """Return an element with a matrix; errors and notes as of ``joint_elements``."""
    matrix, labels = _matrix_in(table, folder)
    active = [name for name in COORDINATES if name in coordinates]
    names = COORDINATES if len(matrix) == len(COORDINATES) else tuple(active)
    if len(matrix) != len(names):
        fewer = f"{len(active)}, for {', '.join(active)}, or " if 0 < len(active) < len(COORDINATES) else ""
        rows = "1 row" if len(matrix) == 1 else f"{len(matrix)} rows"
        table.fail(f"got {rows}; allowed: {fewer}six, for {', '.join(COORDINATES)}", "matrix")
    if labels and labels != names:
        said = f"{table.values['matrix']}: its rows are of {', '.join(labels)}"
        table.fail(f"{said}; allowed: {', '.join(names)}", "matrix")
    conflict = matrix_conflict(matrix, names)
    if conflict is not None:
        table.fail(": ".join(filter(None, conflict)), "matrix")
    arguments: dict[str, Any] = {"preload": table.numbers("preload", len(names))} if "preload" in table else {}
    place = table.table("at")
    if place is not None:
        if len(names) != len(COORDINATES):
            table.fail(f"the matrix has {len(names)} rows; allowed: a frame of a matrix of six rows", "at")
        arguments["at"] = read_placement(place)
    whole = kind.of(matrix, names, **arguments)
    struck = [name for name in whole.coordinates if name not in active]
    loose = [name for name in struck if name in free]
    if loose:
        table.fail(f"{loose[0]} is free and has no table; allowed: {loose[0]} = {{}}, or rows of 0", "matrix")
    left = whole.left_with(coordinates)
    assert left is None or isinstance(left, MatrixElement)
    if left is None and struck:
        table.fail(f"it has rows of {', '.join(struck)} alone, which do not move; allowed: rows of {listed(active)}")
    if struck:
        notes.append(f"{table.where}: rows of coordinates that do not move are left out: {', '.join(struck)}")
    return replace(left or whole, **{key: x for key, x in _numbers_in(table).items() if key in kind.NUMBERS})


def _matrix_in(table: Table, folder: Path | None) -> tuple[Rows, tuple[str, ...]]:
    """Return the rows of the key ``matrix``, of the table or of a file, and their names where the file has them."""
    value = table.value("matrix")
    if not isinstance(value, str):
        return value, ()
    if folder is None:
        allowed = f"the path of a file that ends in {', '.join(ENDINGS)}, relative to this file"
        table.fail(f"got {show(value)}; allowed: {allowed}", "matrix")
    try:
        read = read_matrix(folder / value)
    except DescriptionError:
        raise
    except InputError as error:
        table.fail(str(error), "matrix")
    return read.rows, read.names


def read_placement(table: Table) -> Placement:
    """Read the pose of a table of ``xyz`` (m) and ``rpy`` (rad) or ``rpy_deg``; what is left out is zero."""
    xyz, rpy = table.vector("xyz") or ZERO, table.angles("rpy")
    return Placement(xyz) if rpy is None else Placement.from_rpy(xyz, rpy)


def _numbers_in(table: Table) -> dict[str, Any]:
    """Return the numbers of a table and of the tables in it."""
    read: dict[str, Any] = {key: table.number(key) for key, form in table.keys.items() if isinstance(form, Number)}
    inner = {key: table.table(key) for key, form in table.keys.items() if isinstance(form, Sub)}
    read |= {key: _numbers_in(below) for key, below in inner.items() if below is not None}
    return {key: value for key, value in read.items() if value is not None}


def _branches(table: Table, stiffness: float | None, notes: list[str]) -> dict[str, float]:
    """Return the numbers of Maxwell branches, listed or fitted to a loss factor."""
    given: list[Table] | Table = table.value(BRANCHES)
    if isinstance(given, Table):
        pairs = _fitted_pairs(given, stiffness, notes)
    else:
        pairs = [(k, c) for k, c in ((one.number("stiffness"), one.number("damping")) for one in given) if k and c]
    numbers: dict[str, float] = {}
    for i, (k, c) in enumerate(pairs):
        numbers |= {f"{BRANCHES}.{i}.stiffness": k, f"{BRANCHES}.{i}.damping": c}
    return numbers


def _fitted_pairs(table: Table, stiffness: float | None, notes: list[str]) -> list[tuple[float, float]]:
    """Return stiffness and damping of branches that have a loss factor over a band; a note says how well."""
    loss_factor, band = table.number("loss_factor"), table.numbers("band_hz")
    assert loss_factor is not None
    assert band is not None
    low, high = band
    if not stiffness:
        table.fail("the coordinate has no stiffness that branches lose a part of; allowed: with stiffness > 0")
    if not 0.0 < low < high:
        table.fail(f"got {show(list(band))}; allowed: two frequencies that rise, greater than 0", "band_hz")
    from ..robot.elements.loss_factor import fitted_branches  # NumPy, which new files do without

    fit = fitted_branches(loss_factor, (low, high), table.whole("branches", 4))
    notes.append(
        f"{table.where}: from {low:g} to {high:g} Hz the loss factor of {len(fit.branches)} branches is {loss_factor:g}"
        f" within {fit.deviation:.2g}"
    )
    return [(stiffness * k, stiffness * c) for k, c in fit.branches]


def _inner_numbers(table: Table, name: str) -> dict[str, float]:
    """Return the numbers of a law that has a separate table, by their names: "friction.coulomb"."""
    inner = table.table(name)
    if inner is not None and name == "friction" and "coefficient" not in inner:
        inner.require_one("coulomb", "a force in N or N m, or a coefficient")
    if inner is None:
        return {}
    if name == DRIVE:
        return _drive_numbers(inner)
    read = {f"{name}.{key}": inner.number(key) for key in inner.keys if key not in ("shape", "model")}
    numbers = {key: number for key, number in read.items() if number is not None}
    shape = inner.text("shape") if "shape" in inner else None
    if shape is not None and f"{name}.stribeck" not in numbers:
        inner.fail(f"got {show(shape)}, and there is no stribeck; allowed: with static and stribeck", "shape")
    if name == "friction":
        _check_model(inner, numbers)
    elif "model" in inner:
        inner.choice("model")
    if shape == GAUSSIAN or (BRISTLES in numbers and shape is None and f"{name}.stribeck" in numbers):
        numbers[f"{name}.{GAUSSIAN}"] = numbers.pop(f"{name}.stribeck")
    return numbers


def _drive_numbers(table: Table) -> dict[str, float]:
    """Return the numbers of a drive, by their names: "drive.controller.velocity.kp"."""
    numbers = _plain_numbers(table, DRIVE)
    winding, controller = table.table("winding"), table.table("controller")
    numbers |= {} if winding is None else _plain_numbers(winding, f"{DRIVE}.winding")
    if controller is not None:
        alone = _plain_numbers(controller, f"{DRIVE}.controller.{LOOPS[0]}")
        loops = [loop for loop in LOOPS if loop in controller]
        if alone and loops:
            key = next(iter(alone)).rpartition(".")[2]
            allowed = f"numbers in the tables {', '.join(LOOPS)}, or those of one loop alone"
            controller.fail(f"{loops[0]} has a table, too; allowed: {allowed}", key)
        numbers |= alone
        for loop in loops:
            inner = controller.table(loop)
            assert inner is not None
            numbers |= _plain_numbers(inner, f"{DRIVE}.controller.{loop}")
    if not numbers:
        table.fail("there is nothing in it; allowed: one or more of lag, winding, controller")
    return numbers


def _plain_numbers(table: Table, name: str) -> dict[str, float]:
    """Return the numbers of a table, below a name."""
    read = {key: table.number(key) for key, form in table.keys.items() if isinstance(form, Number)}
    return {f"{name}.{key}": number for key, number in read.items() if number is not None}


def _check_model(inner: Table, numbers: Mapping[str, float]) -> None:
    """Refuse LuGre friction without a stiffness, and its numbers without ``model = "lugre"``."""
    is_lugre = "model" in inner and inner.text("model") == LUGRE
    if is_lugre and BRISTLES not in numbers:
        inner.require_one("bristle_stiffness", "a stiffness in N/m or N m/rad, greater than 0")
    elif not is_lugre and BRISTLES in numbers:
        inner.fail(f'the model is not {LUGRE}; allowed: with model = "{LUGRE}"', "bristle_stiffness")
    if is_lugre and "shape" in inner and inner.text("shape") != GAUSSIAN:
        inner.fail(f"got {show(inner.text('shape'))}, and the model is {LUGRE}; allowed: {GAUSSIAN}, or none", "shape")


def read_element(table: str, name: str, entry: Table, read_text: ReadText, folder: Path | None) -> LinkElement:
    """Read one entry of force elements between two links, such as [[springs]].

    Args:
        table: key that lists such elements, one of ``robot.elements.KINDS``.
        entry: of the keys ``ELEMENTS[table]``.
        read_text: returns the text of the file that a curve names.
        folder: where files of matrices are looked for; None where there is none.

    Raises:
        DescriptionError: a key is missing or wrong, or keys do not go together.
    """
    entry.require()
    links = entry.strings("links")
    if links[0] == links[1]:
        entry.fail(f"got {show(links)}; both ends are on one link; allowed: two different links", "links")
    values: dict[str, Any] = {
        key: _element_value(entry, key, form, read_text, folder)
        for key, form in entry.keys.items()
        if key not in ("name", "links", "nodes") and key in entry
    }
    element = KINDS[table](name, (links[0], links[1]), **values)
    conflict = element.conflict()
    if conflict is not None:
        entry.fail(conflict[1], conflict[0])
    return element


def _element_value(entry: Table, key: str, form: Key, read_text: ReadText, folder: Path | None) -> Any:
    """Return the value of a key as its field has it."""
    if key == "curve":
        return read_curve(entry, read_text, "elongation")
    if isinstance(form, Either) and isinstance(entry.values[key], dict):
        return whole_element(JOINT_ELEMENTS[key], entry.value(key), dict.fromkeys(COORDINATES), folder, [])
    value = entry.value(key)
    if isinstance(form, Pair):
        return tuple(read_placement(table) for table in value)
    return tuple(value) if isinstance(form, Listed) else value


def read_curve(table: Table, read_text: ReadText, what: str = "deviation") -> Curve | None:
    """Return points of the key ``curve``: an array, or the path of a CSV file of two columns, ``what`` and force."""
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
