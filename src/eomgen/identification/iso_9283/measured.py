"""Poses and paths of measured files: a row for each sample, by the number of its pose or path and of its cycle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index
from ...errors import InputError, UnknownNameError
from ...motion.csv_columns import read_csv
from ...motion.measured_numbers import checked_numbers
from ...names import component_name, listed, nearest, show, split_component
from ...npz import read_npz
from ..geometry.poses import QUATERNION, ROTATIONS, TURNED, rows_at
from ..geometry.rotations import FOUR, READINGS
from .attained import Measured, Path, Pose, Record

AXES = ("x", "y", "z")
COMMAND = "command"  # F.command.x: the command beside what was attained
COLUMNS = "pose or path (its number), cycle, t, F.x, F.y, F.z (m), F.rx, F.ry, F.rz (rad), F.command.x and its like"
SAME = 1e-9  # m or rad: by less than that commands are the same
_UNIT = 1e-3  # by which the length of a quaternion may differ from 1


@dataclass(frozen=True)
class _Rows:
    """Columns of a file, and what messages call a row."""

    source: str
    columns: Mapping[str, Array]
    place: Callable[[int], str]

    @property
    def size(self) -> int:
        return len(next(iter(self.columns.values())))

    def fail(self, message: str, row: int | None = None) -> InputError:
        return InputError(f"{self.source if row is None else self.place(row)}: {message}")


def from_files(
    paths: Sequence[File], *, command: File | None = None, frame: str | None = None, rotation: str = "rotvector"
) -> Measured:
    """Return poses and paths of one or more files.

    Rows with a column ``pose`` are of poses, those with ``path`` of paths; numbers say which.  Rows of one pose are its
    cycles, unless ``cycle`` says which they are of; with ``t`` each cycle may have many rows, of which the last one is
    what was attained.  Cycles of several files are different ones.

    Args:
        paths: .csv or .npz with COLUMNS.
        command: file of the commands: ``pose`` or ``path``, and F.x and its like; else F.command.x beside F.x.
        frame: the F to look at, where there are several.
        rotation: what F.rx, F.ry and F.rz are, of ROTATIONS.

    Raises:
        InputError: with the file and the row; UnknownNameError of a frame that no column has.
    """
    if rotation not in ROTATIONS:
        raise InputError(f"rotation: {show(rotation)}; allowed: {', '.join(ROTATIONS)}")
    tables = [_read(path) for path in paths]
    command_rows = None if command is None else _read(command)
    frame = _frame(tables[0], frame)
    by_kind: dict[str, dict[int, _Gathered]] = {"pose": {}, "path": {}}
    for table in tables:
        kinds = [kind for kind in by_kind if kind in table.columns]
        if len(kinds) != 1:
            got = "both columns, pose and path" if kinds else "no column pose or path"
            raise table.fail(f"has {got}; allowed: {COLUMNS}, with one of the two")
        record = _record(table, frame, rotation)
        commands = _commands(table, command_rows, kinds[0], frame, rotation)
        before = [label for items in by_kind.values() for item in items.values() for label in item.cycles]
        _gather(table, kinds[0], record, commands, by_kind[kinds[0]], max(before, default=None))
    notes: list[str] = []
    for kind, items in by_kind.items():
        if command_rows is not None and kind in command_rows.columns and items:
            unused = sorted(set(_numbers(command_rows, kind).tolist()) - set(items))
            notes += [f"{kind} {number} is commanded and was never measured" for number in unused]
    records = [record for items in by_kind.values() for item in items.values() for record in item.cycles.values()]
    if any(record.rotation is None for record in records):
        wanted = ", ".join(component_name(frame, key) for key in TURNED)
        notes.append(f"no orientation was measured ({wanted}): figures are of positions alone")
    return Measured(
        source="measured",
        robot="",
        frame=frame,
        load="",
        rate="",
        poses=tuple(_pose(number, gathered) for number, gathered in sorted(by_kind["pose"].items())),
        paths=tuple(_path(number, gathered) for number, gathered in sorted(by_kind["path"].items())),
        exact=False,
        notes=tuple(notes),
    )


# Files


def _read(path: File) -> _Rows:
    if path.suffix == ".csv":
        columns, lines = read_csv(path, rule=COLUMNS)
        return _Rows(str(path), columns, lambda row: f"{path}: line {lines[row]}")
    if path.suffix != ".npz":
        raise InputError(f"{show(str(path))}: is no measured file; allowed: a path that ends in .csv or .npz")
    arrays = read_npz(path)
    for name, array in arrays.items():
        size = next(iter(arrays.values())).shape
        if array.dtype.kind not in "fiu" or array.ndim != 1 or array.shape != size or not array.size:
            raise InputError(
                f"{path}: array {show(name)} has dtype {array.dtype} and shape {array.shape};"
                " allowed: numbers, one for each row, equally many of each"
            )
    if not arrays:
        raise InputError(f"{path}: has no arrays; allowed: {COLUMNS}")
    checked = {name: checked_numbers(name, array, lambda row: f"{path}: row {row}") for name, array in arrays.items()}
    return _Rows(str(path), checked, lambda row: f"{path}: row {row}")


def _frame(table: _Rows, wanted: str | None) -> str:
    """Return the frame that is looked at: the one that is named, or the only one that has x, y and z."""
    owners = dict.fromkeys(split_component(name)[0] for name in table.columns if "." in name)
    whole = [owner for owner in owners if all(component_name(owner, axis) in table.columns for axis in AXES)]
    known = [owner for owner in whole if split_component(owner)[1] != COMMAND]
    if wanted is not None:
        if wanted not in known:
            raise UnknownNameError(
                f"{table.source}: the frame {show(wanted)} has no columns x, y and z{nearest(wanted, known)};"
                f" known: {listed(known) or 'none'}"
            )
        return wanted
    if len(known) != 1:
        got = f"those of {listed(known)}" if known else "no columns F.x, F.y and F.z of any frame F"
        raise table.fail(f"has {got}; allowed: of one frame, or say which ({COLUMNS})")
    return known[0]


def _numbers(table: _Rows, name: str) -> NDArray[np.int64]:
    values = table.columns[name]
    bad = np.flatnonzero((values != np.floor(values)) | (np.abs(values) > 1e9))
    if bad.size:
        row = int(bad[0])
        raise table.fail(f"column {name}: {values[row]:g}; allowed: whole numbers", row)
    return values.astype(np.int64)


def _record(table: _Rows, owner: str, rotation: str) -> Record:
    """Return all rows of an owner's columns: times, positions and rotations, as far as they are there."""
    t = table.columns.get("t")
    position = np.stack([table.columns[component_name(owner, axis)] for axis in AXES], axis=1)
    keys, others = (QUATERNION, TURNED) if rotation == "quaternion" else (TURNED, QUATERNION)
    names = [component_name(owner, key) for key in keys]
    missing = [name for name in names if name not in table.columns]
    if missing:
        present = [name for key in (*keys, *others) if (name := component_name(owner, key)) in table.columns]
        if present:
            raise table.fail(
                f"has {listed(present)} and not {listed(missing)}; allowed: all of {listed(names)} (rotation:"
                f" {rotation}), or none"
            )
        return Record(t, position, None)
    angles = np.stack([table.columns[name] for name in names], axis=1)
    if rotation == "quaternion":
        size = np.linalg.norm(angles, axis=1)
        bad = np.flatnonzero(np.abs(size - 1.0) > _UNIT)
        if bad.size:
            raise table.fail(f"a quaternion of length {size[bad[0]]:g}; allowed: 1", int(bad[0]))
        return Record(t, position, FOUR[rotation](angles))
    return Record(t, position, READINGS[rotation](angles))


# Cycles


@dataclass
class _Gathered:
    """Records of one pose or path by cycle, and its command."""

    command: Record
    cycles: dict[int, Record]


_Commands = Callable[[int, Index], Record]


def _commands(table: _Rows, command_rows: _Rows | None, kind: str, frame: str, rotation: str) -> _Commands:
    """Return a function that says what is commanded of the rows of one pose or path.

    It takes that from their columns, or from the other file.
    """
    owner = component_name(frame, COMMAND)
    beside = all(component_name(owner, axis) in table.columns for axis in AXES)
    if command_rows is None and not beside:
        wanted = ", ".join(component_name(owner, axis) for axis in AXES)
        raise table.fail(f"says no commands; allowed: columns {wanted}, or a file of commands")
    if command_rows is not None and beside:
        raise table.fail(f"has commands, and so has {command_rows.source}; allowed: one of them")
    source, owner = (table, owner) if command_rows is None else (command_rows, frame)
    if command_rows is not None:
        _frame(command_rows, frame)
        if kind not in command_rows.columns:
            raise command_rows.fail(f"has no column {kind}, which {table.source} has; allowed: with it")
    whole = _record(source, owner, rotation)
    known = None if command_rows is None else _numbers(command_rows, kind)
    rows_of = {} if known is None else {int(known[rows[0]]): rows for rows in _groups(known)}

    def commands(number: int, rows: Index) -> Record:
        chosen = rows_of.get(number) if command_rows is not None else rows
        if chosen is None:
            assert command_rows is not None
            raise command_rows.fail(
                f"has no command of {kind} {number}, which {table.source} has; allowed: one for each"
            )
        return rows_at(whole, chosen)

    return commands


def _gather(
    table: _Rows,
    kind: str,
    record: Record,
    commands: _Commands,
    into: dict[int, _Gathered],
    last: int | None,
) -> None:
    """Sort the rows of a file by pose or path and by cycle; ``last`` is the number of the last cycle of other files."""
    numbers = _numbers(table, kind)
    cycle = _cycles(table, kind, numbers)
    if last is not None:
        cycle = cycle + (last + 1 - cycle.min())
    for rows in _groups(numbers, cycle):
        number, label = int(numbers[rows[0]]), int(cycle[rows[0]])
        what = f"{kind} {number}, cycle {label}"
        _check_rows(table, kind, what, rows)
        command = commands(number, rows)
        gathered = into.setdefault(number, _Gathered(command, {}))
        _check_command(table, kind, what, gathered.command, command, int(rows[0]))
        gathered.cycles[label] = rows_at(record, rows)


def _groups(*keys: NDArray[np.int64]) -> list[Index]:
    """Return rows that have the same keys, in their order; groups by rising keys, the first key first."""
    order = np.lexsort(keys[::-1])
    changes = np.logical_or.reduce([np.diff(key[order]) != 0 for key in keys])
    return np.split(order, np.flatnonzero(changes) + 1)


def _cycles(table: _Rows, kind: str, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the cycle of each row, as the file says.

    Where it does not, rows of one pose are cycles, and a file with paths is one.
    """
    if "cycle" in table.columns:
        return _numbers(table, "cycle")
    if kind == "pose" and "t" in table.columns:
        raise table.fail("has t and no column cycle; allowed: both, where a cycle has many samples")
    cycle = np.ones(table.size, dtype=np.int64)
    if kind == "pose":
        for rows in _groups(numbers):
            cycle[rows] = np.arange(1, len(rows) + 1)
    return cycle


def _check_rows(table: _Rows, kind: str, what: str, rows: Index) -> None:
    t = table.columns.get("t")
    if t is None:
        if kind == "pose" and len(rows) > 1:
            raise table.fail(f"{what}: {len(rows)} rows; allowed: one, or a column t", int(rows[1]))
        return
    late = np.flatnonzero(np.diff(t[rows]) <= 0.0)
    if late.size:
        before, after = rows[late[0]], rows[late[0] + 1]
        raise table.fail(f"{what}: t is {t[after]:g} after {t[before]:g}; allowed: increasing times", int(after))


def _check_command(table: _Rows, kind: str, what: str, known: Record, new: Record, row: int) -> None:
    """Raise InputError where rows of one pose or path are commanded different things."""
    pairs = [(known.position, new.position)]
    if known.rotation is not None and new.rotation is not None:
        pairs.append((known.rotation, new.rotation))
    for ours, theirs in pairs:
        wanted = np.broadcast_to(ours[0], theirs.shape) if kind == "pose" else ours
        if wanted.shape != theirs.shape or np.abs(wanted - theirs).max() > SAME:
            raise table.fail(
                f"{what}: is commanded something else than before; allowed: one command of each {kind}", row
            )


def _pose(number: int, gathered: _Gathered) -> Pose:
    command = gathered.command
    rotation = None if command.rotation is None else np.asarray(command.rotation[0])
    labels = sorted(gathered.cycles)
    cycles = tuple(gathered.cycles[label] for label in labels)
    return Pose(str(number), np.asarray(command.position[0]), rotation, cycles, tuple(labels))


def _path(number: int, gathered: _Gathered) -> Path:
    labels = sorted(gathered.cycles)
    return Path(str(number), gathered.command, tuple(gathered.cycles[label] for label in labels))
