"""Measured motions: files of sampled coordinates, checked value by value."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError
from ..files import as_path, check_ending, write_csv
from ..identifiers import are_names, check_kind
from ..names import listed, nearest, show
from ..npz import read_npz
from ..robot.value import Robot
from ..shown import Shown
from .csv_columns import COLUMNS_RULE, read_csv
from .measured_numbers import SHORTEST, checked_numbers

SUFFIXES = {"": "q", ".rate": "v", ".acceleration": "a", ".drive": "u"}  # of a coordinate's columns
STATE = re.compile(r"\.(?:(?:friction|hysteresis|maxwell\.[0-9])\.z|drive\.[a-z_]+)$")  # behind a coordinate
Column = TypeVar("Column")
_MOST_NUMBERS = 10_000_000  # of all coordinates at all times: a motion has up to four arrays of so many


@dataclass(frozen=True, kw_only=True)
class MeasuredMotion(Shown):
    """Measured motion, sampled at T times.

    Attributes:
        coordinates: names of all n coordinates of the robot.
        t: times, (T,), s, increasing.
        q: coordinates, (T, n), m or rad; zero where not measured.
        v, a: velocities and accelerations, (T, n), or None where the file does not have them.
        u: drives, (T, n), N or N m; zero where not known.
        measured, driven: names of the coordinates that q has, and of those whose drive is known.
        source: the file.
        states: those of laws that are known, (T,) each, by their names, such as currents of drives.
    """

    coordinates: tuple[str, ...]
    t: Array
    q: Array
    v: Array | None
    a: Array | None
    u: Array
    measured: tuple[str, ...]
    driven: tuple[str, ...]
    source: str = ""
    states: Mapping[str, Array] = field(default_factory=dict)


def read_motion(
    path: Path | str, coordinates: Sequence[str], *, principal: Mapping[str, str] | None = None
) -> MeasuredMotion:
    """Read a motion of a robot with these coordinates from a .csv or .npz.

    A .csv has a header with the columns t (s), then names of coordinates (m, rad); NAME.rate, NAME.acceleration and
    NAME.drive are optional.  Commas, semicolons or tabs separate values, as in the header; with the latter two decimal
    commas are read, too.  Lines that begin with # are comments.  A .npz has arrays of these names, or, as
    ``eomgen simulate`` writes it, t, q (T, k) and coordinates (k names), optionally v, a and u.  Coordinates that the
    file does not have are zero.  Rates (accelerations) are there for all measured coordinates or for none.  Internal
    states, such as NAME.drive.current, may be there.

    Args:
        path: of the file.
        coordinates: names of all coordinates of the robot.
        principal: coordinates by the names of their joints, which columns may have instead
            (``Robot.principal_coordinates``); None: no column is named like a joint.

    Raises:
        InputError: with the file, line and column (or array and element), the value and what is allowed.
    """
    source = as_path(path, "motion")
    if source.suffix not in (".csv", ".npz"):
        raise InputError(f"motion: {show(str(path))}; allowed: a path that ends in .csv or .npz")
    columns, lines = read_columns(source)
    full = named_by_coordinate(columns, {**(principal or {}), "t": "t"}, str(source), SUFFIXES)
    return _motion(full, tuple(coordinates), str(source), lines)


def write_motion(path: Path | str, motion: MeasuredMotion, comments: Sequence[str] = ()) -> Path:
    """Write a motion as the .csv that ``read_motion`` reads, numbers so that they round-trip, and return the path.

    Columns are t, the measured coordinates, their .rate and .acceleration where the motion has them, and .drive of the
    driven ones.

    Args:
        path: ends in .csv.
        motion: as read, or made of arrays.
        comments: lines in front of the header.

    Raises:
        InputError: another ending, or the file cannot be written, or cannot be read back.
    """
    check_kind("motion", motion, hasattr(motion, "t"), "a MeasuredMotion")
    target = check_ending(path, ".csv")
    columns = {"t": motion.t}
    for suffix, key in SUFFIXES.items():
        values = getattr(motion, key)
        if values is not None:
            names = motion.driven if key == "u" else motion.measured
            columns |= {name + suffix: values[:, motion.coordinates.index(name)] for name in names}
    columns |= motion.states
    rows = np.column_stack(list(columns.values())).tolist()
    return write_csv(target, [columns, *rows], comments, read=partial(read_motion, coordinates=motion.coordinates))


def read_columns(path: Path) -> tuple[dict[str, Array], NDArray[np.int32] | None]:
    """Return columns (T,) of a .csv or .npz by name, and the line of each row of a .csv; errors as ``read_motion``."""
    return read_csv(path) if path.suffix == ".csv" else (_read_npz(path), None)


def named_by_coordinate(
    columns: Mapping[str, Column], principal: Mapping[str, str], source: str, suffixes: Iterable[str] = ("",)
) -> dict[str, Column]:
    """Return columns with the name of a joint's principal coordinate in the place of the joint's.

    Args:
        columns: by their names in the file.
        principal: coordinates by joint.
        source: the file, for messages.
        suffixes: that may stand behind either name.

    Raises:
        InputError: two columns are of one coordinate.
    """
    longer = {joint + end: name + end for joint, name in principal.items() for end in suffixes}
    named: dict[str, Column] = {}
    for column, values in columns.items():
        name = longer.get(column, column)
        if name in named or (name != column and name in columns):
            raise InputError(
                f"{source}: columns {show(column)} and {show(name)} are one coordinate; allowed: one of them"
            )
        named[name] = values
    return named


def measured_motion(robot: Robot, motion: MeasuredMotion | Path | str, coordinates: tuple[str, ...]) -> MeasuredMotion:
    """Return the motion, read if it is a file's path.

    Raises:
        InputError: it cannot be read, or is of other coordinates than that robot's.
    """
    if not isinstance(motion, (MeasuredMotion, Path, str)):
        raise InputError(f"motion: got {show(motion)}; allowed: a MeasuredMotion, or the path of a .csv or .npz file")
    measured = (
        motion
        if isinstance(motion, MeasuredMotion)
        else read_motion(motion, coordinates, principal=robot.principal_coordinates)
    )
    if measured.coordinates != coordinates:
        raise InputError(
            f"motion: is of other coordinates than {robot.name}'s: {', '.join(measured.coordinates[:6])}, ..."
        )
    return measured


def motion_from_columns(
    columns: Mapping[str, Array], coordinates: Sequence[str], source: str = "motion"
) -> MeasuredMotion:
    """Return a motion from arrays (T,) by the names that a file's columns have; errors as ``read_motion``."""
    check_kind("coordinates", coordinates, are_names(coordinates), "a sequence of names")
    check_kind("columns", columns, isinstance(columns, Mapping), "a mapping from names to columns")
    arrays = {
        name: checked_numbers(name, values, lambda row: f"{source}: sample {row}") for name, values in columns.items()
    }
    for name, values in arrays.items():
        if values.ndim != 1 or values.shape != arrays[next(iter(arrays))].shape:
            raise InputError(f"{source}: {name} has shape {values.shape}; allowed: one length for all columns")
    return _motion(arrays, tuple(coordinates), source, None)


def _read_npz(path: Path) -> dict[str, Array]:
    arrays = read_npz(path)
    if "t" not in arrays:
        raise InputError(f"{path}: has no array t; allowed: {COLUMNS_RULE}")
    size = arrays["t"].shape
    if "q" in arrays and "coordinates" in arrays:
        names = [str(name) for name in arrays["coordinates"].ravel()]
        twice = [name for name, many in Counter(names).items() if many > 1]
        if twice:
            raise InputError(f"{path}: array coordinates: {show(twice[0])} is there twice; allowed: once")
        chosen = {"t": arrays["t"]}
        for suffix, key in SUFFIXES.items():
            if key in arrays:
                if arrays[key].shape != (*size, len(names)):
                    expected = f"({size[0] if size else 0}, {len(names)})"
                    raise InputError(f"{path}: array {key} has shape {arrays[key].shape}; allowed: {expected}")
                chosen |= {name + suffix: arrays[key][:, i] for i, name in enumerate(names)}
        states = arrays.get("internal_states", arrays.get("memory"))  # its name in older files
        if states is not None and "z" in arrays and arrays["z"].shape == (*size, states.size):
            chosen |= {str(name): arrays["z"][:, i] for i, name in enumerate(states.ravel())}
        arrays = chosen
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu" or array.ndim != 1 or array.shape != size:
            raise InputError(
                f"{path}: array {show(name)} has dtype {array.dtype} and shape {array.shape};"
                f" allowed: numbers of the shape of t, {size}"
            )
    if size == (0,):
        raise InputError(f"{path}: array t has no values; allowed: one or more times")
    total = sum(array.size for array in arrays.values())
    if total > 2 * _MOST_NUMBERS:
        raise InputError(f"{path}: its arrays have {total} numbers; allowed: up to {2 * _MOST_NUMBERS}")
    return {name: checked_numbers(name, array, lambda row: f"{path}: sample {row}") for name, array in arrays.items()}


def _motion(
    columns: Mapping[str, Array], coordinates: tuple[str, ...], source: str, lines: NDArray[np.int32] | None
) -> MeasuredMotion:
    def place(row: int) -> str:
        return f"{source}: line {lines[row]}" if lines is not None else f"{source}: sample {row}"

    if "t" not in columns:
        raise InputError(f"{source}: there is no column t; allowed: {COLUMNS_RULE}")
    parts: dict[str, dict[int, Array]] = {key: {} for key in SUFFIXES.values()}
    states = {name: values for name, values in columns.items() if _is_state(name, coordinates)}
    for name, values in columns.items():
        if name != "t" and name not in states:
            key, index = _which(name, coordinates, source)
            parts[key][index] = values
    t = columns["t"]
    if t.size * len(coordinates) > _MOST_NUMBERS:
        message = f"{t.size} times of {len(coordinates)} coordinates; allowed: up to {_MOST_NUMBERS} numbers"
        raise InputError(f"{source}: {message}")
    back = np.flatnonzero(np.diff(t) < SHORTEST)
    if back.size:
        late = int(back[0]) + 1
        raise InputError(
            f"{place(late)}: column 't': {t[late]:.17g} after {t[late - 1]:.17g}; allowed: increasing times, at least"
            f" {SHORTEST:g} s apart"
        )
    measured = sorted(parts["q"])
    if not measured:
        raise InputError(f"{source}: no column is a coordinate; allowed: {listed(coordinates)}")
    for suffix, key in ((".rate", "v"), (".acceleration", "a")):
        missing = [i for i in measured if i not in parts[key]] if parts[key] else []
        foreign = [i for i in parts[key] if i not in parts["q"]]
        if missing or foreign:
            name = coordinates[(missing or foreign)[0]]
            lack = name + suffix if missing else name
            raise InputError(
                f"{source}: the column {lack} is missing; allowed: {suffix} of all measured coordinates, or none"
            )
    if parts["a"] and not parts["v"]:
        raise InputError(f"{source}: accelerations without rates; allowed: columns .rate as well")
    filled = {key: _filled(by_index, len(t), len(coordinates)) for key, by_index in parts.items()}
    return MeasuredMotion(
        coordinates=coordinates,
        t=t,
        q=filled["q"],
        v=filled["v"] if parts["v"] else None,
        a=filled["a"] if parts["a"] else None,
        u=filled["u"],
        measured=tuple(coordinates[i] for i in measured),
        driven=tuple(coordinates[i] for i in sorted(parts["u"])),
        source=source,
        states=states,
    )


def _is_state(name: str, coordinates: Sequence[str]) -> bool:
    """Tell whether a column is a state of a coordinate's law, such as "joint1.gamma.drive.current"."""
    return bool(STATE.search(name)) and STATE.sub("", name) in coordinates


def _which(name: str, coordinates: Sequence[str], source: str) -> tuple[str, int]:
    """Return the kind of a column ("q", "v", "a", "u") and the index of its coordinate."""
    for suffix, key in SUFFIXES.items():
        stem = name.removesuffix(suffix) if suffix else name
        if name.endswith(suffix) and stem in coordinates:
            return key, coordinates.index(stem)
    hint = nearest(name, coordinates)
    raise InputError(f"{source}: column {show(name)} is unknown{hint}; allowed: {COLUMNS_RULE}")


def _filled(by_index: Mapping[int, Array], samples: int, n: int) -> Array:
    whole = np.zeros((samples, n))
    for i, values in by_index.items():
        whole[:, i] = values
    return whole
