"""Measured poses: files of coordinates and of what was measured there, checked value by value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index, Mask
from ...errors import InputError
from ...files import as_path
from ...identifiers import check_kind
from ...motion.csv_columns import read_csv
from ...motion.files import named_by_coordinate
from ...motion.measured_numbers import ALLOWED_DIVISOR, checked_numbers, is_divisor
from ...names import listed, nearest, show, split_component
from ...npz import read_npz
from ...robot.coordinates import FORCES, MOTIONS
from ...shown import Shown
from .rotations import FOUR, READINGS

Table = TypeVar("Table")

POSES_RULE = (
    "coordinates such as joint1.gamma; F.x F.y F.z, F.rx F.ry F.rz (or F.qw F.qx F.qy F.qz), F.distance, F.travel,"
    " F.fx ... F.mz and F.sigma.x of a frame F; weight, series, body, temperature"
)
_OBSERVED = (
    "positions (F.x F.y F.z), orientations (F.rx F.ry F.rz or F.qw F.qx F.qy F.qz), F.distance from the device and"
    " F.travel from the row before, of a frame F"
)
ROTATIONS = ("rotvector", "rpy", "quaternion")
TURNED = MOTIONS[3:]
QUATERNION = ("qw", "qx", "qy", "qz")
SINGLE = ("distance", "travel")
WHOLE = ("weight", "series", "body", "temperature")  # columns of no frame
MOST_ROWS = 100_000


@dataclass(frozen=True, kw_only=True)
class Measured(Shown):
    """Measurements of one frame in R rows, in the axes of the measuring device.

    Attributes:
        frame: its name.
        position: (R, 3), m; NaN where not measured.
        orientation: (R, 3, 3); NaN where not measured.
        distance: of its origin from the device's, (R,), m; NaN where not measured.
        travel: of its origin from where it was in the row before, of the same series, (R,), m; NaN where not measured.
        wrench: known force (N) and moment (N m) at its origin, axes of the robot's base, (R, 6).
        sigma: standard deviations by component ("x", ..., "rz", "distance", "travel"), (R,) each, m or rad.
        written: the numbers of the orientation as the file has them, (R, 3 or 4), for other readings; or None.
    """

    frame: str
    position: Array
    orientation: Array
    distance: Array
    travel: Array
    wrench: Array
    sigma: Mapping[str, Array]
    written: Array | None = None

    @property
    def is_measured(self) -> bool:
        """Whether anything was: a frame may be there for its wrench alone."""
        parts = (self.position, self.orientation, self.distance, self.travel)
        return any(np.isfinite(array).any() for array in parts)


def blank_frame(frame: str, rows: int) -> Measured:
    """Return a frame of which nothing was measured in so many rows."""
    blank = np.full(rows, np.nan)
    return Measured(
        frame=frame,
        position=np.full((rows, 3), np.nan),
        orientation=np.full((rows, 3, 3), np.nan),
        distance=blank,
        travel=blank,
        wrench=np.zeros((rows, 6)),
        sigma={},
    )


def rows_at(table: Table, kept: Index | Mask) -> Table:
    """Return some rows of a dataclass: of its fields that are arrays, and of tables of arrays."""
    arrays: dict[str, Any] = {}
    for name, value in vars(table).items():
        if isinstance(value, np.ndarray):
            arrays[name] = value[kept]
        elif isinstance(value, Mapping) and all(isinstance(x, np.ndarray) for x in value.values()):
            arrays[name] = {key: x[kept] for key, x in value.items()}
    return replace(table, **arrays)  # type: ignore[type-var]


@dataclass(frozen=True, kw_only=True)
class MeasuredPoses(Shown):
    """Poses of a robot's frames as they were measured, R rows.

    Attributes:
        coordinates: names of the columns of q.
        q: readings of the coordinates, (R, k), m or rad.
        frames: what was measured, by frame.
        series: number of the series of each row, (R,); each has its base placement.
        body: number of what was measured at once, (R,), or None where the file says nothing.
        weight: by which each row's information counts, (R,).
        temperature: (R,), as the file has it, or None.
        source: the file.
        places: where a row is in it, for messages.
    """

    coordinates: tuple[str, ...]
    q: Array
    frames: Mapping[str, Measured]
    series: NDArray[np.int64]
    body: NDArray[np.int64] | None
    weight: Array
    temperature: Array | None
    source: str = "poses"
    lines: NDArray[np.int32] | None = None

    def part(self, kept: Index) -> MeasuredPoses:
        """Return those of some of the rows."""
        return rows_at(replace(self, frames={name: rows_at(m, kept) for name, m in self.frames.items()}), kept)

    def place(self, row: int) -> str:
        """Return the file and the line, or the row's number."""
        return f"{self.source}: line {self.lines[row]}" if self.lines is not None else f"{self.source}: row {row}"


def read_poses(
    path: Path | str,
    coordinates: Sequence[str],
    frames: Sequence[str],
    *,
    rotation: str = "rotvector",
    encoders: bool = False,
    principal: Mapping[str, str] | None = None,
) -> MeasuredPoses:
    """Read measured poses from a .csv or .npz.

    A .csv has a header with the columns; a cell of a measured column may be empty where a frame was not measured.  A
    .npz has arrays of these names, with NaN in the place of empty cells.

    Args:
        path: of the file.
        coordinates: names that columns of coordinates may have.
        frames: names that columns of frames may have.
        rotation: what F.rx F.ry F.rz are: "rotvector" or "rpy" (rad); or "quaternion", of F.qw F.qx F.qy F.qz.
        encoders: whether columns of coordinates will do, of a closed mechanism with more encoders than drives.
        principal: coordinates by the names of their joints, which columns may have instead
            (``Robot.principal_coordinates``); None: no column is named like a joint.

    Raises:
        InputError: with the file, line and column, the value and what is allowed.
    """
    path = as_path(path, "path")
    source = Path(path)
    if source.suffix not in (".csv", ".npz"):
        raise InputError(f"poses: {show(str(path))}; allowed: a path that ends in .csv or .npz")
    is_csv = source.suffix == ".csv"
    columns, lines = read_csv(source, rule=POSES_RULE, blanks=True) if is_csv else (read_npz(source), None)
    named = _by_coordinate(columns, principal or {}, str(source))
    return poses_from_columns(
        named, coordinates, frames, rotation=rotation, encoders=encoders, source=str(source), lines=lines
    )


def poses_from_columns(
    columns: Mapping[str, Array],
    coordinates: Sequence[str],
    frames: Sequence[str],
    *,
    rotation: str = "rotvector",
    encoders: bool = False,
    source: str = "poses",
    lines: NDArray[np.int32] | None = None,
) -> MeasuredPoses:
    """Return measured poses from arrays (R,) by the names that a file's columns have.

    Arguments and errors as ``read_poses``.

    source, lines: the file, and the line of each row, for messages.
    """
    check_kind("columns", columns, isinstance(columns, Mapping), "a mapping from names to columns")
    if rotation not in ROTATIONS:
        raise InputError(f"rotation: {show(rotation)}; allowed: {', '.join(ROTATIONS)}")
    table = _Table(_arrays(columns, source), source, lines)
    parts: dict[str, set[str]] = {}
    chosen = [name for name in table.columns if name in coordinates]
    for name in table.columns:
        if name not in chosen and name not in WHOLE:
            frame, key = _which(name, coordinates, frames, source)
            parts.setdefault(frame, set()).add(key)
    if not chosen:
        raise InputError(f"{source}: no column is a coordinate; allowed: {listed(coordinates)}")
    by_frame = {frame: table.frame(frame, keys, rotation) for frame, keys in parts.items()}
    if not (encoders or any(measured.is_measured for measured in by_frame.values())):
        raise InputError(f"{source}: nothing is measured; allowed: {POSES_RULE}")
    return MeasuredPoses(
        coordinates=tuple(chosen),
        q=np.stack([table.finite(name) for name in chosen], axis=1),
        frames=by_frame,
        series=table.whole("series", 0),
        body=table.whole("body", 0) if "body" in table.columns else None,
        weight=table.positive("weight") if "weight" in table.columns else np.ones(table.rows),
        temperature=table.finite("temperature") if "temperature" in table.columns else None,
        source=source,
        lines=lines,
    )


def _by_coordinate(columns: Mapping[str, Array], principal: Mapping[str, str], source: str) -> dict[str, Array]:
    """Return columns by coordinates where they are named like joints; InputError where a name is of something else."""
    for name in WHOLE:
        if name in columns and principal.get(name, name) not in columns:
            message = f"column {show(name)} is the name of a joint, too; allowed: with a column {show(principal[name])}"
            raise InputError(f"{source}: {message}")
    return named_by_coordinate(columns, {joint: x for joint, x in principal.items() if joint not in WHOLE}, source)


def _arrays(columns: Mapping[str, Array], source: str) -> dict[str, Array]:
    """Return the columns as float64, of one length."""
    arrays: dict[str, Array] = {}
    for name, values in columns.items():
        array = np.asarray(values)
        if array.dtype.kind not in "fiu" or array.ndim != 1:
            raise InputError(
                f"{source}: {show(name)} has dtype {array.dtype} and shape {array.shape}; allowed: numbers in one row"
            )
        arrays[name] = checked_numbers(name, array, lambda row: f"{source}: row {row}", blanks=True)
    sizes = {len(array) for array in arrays.values()}
    if len(sizes) != 1:
        raise InputError(f"{source}: columns of {len(sizes)} lengths; allowed: one length for all columns")
    if not 1 <= sizes.copy().pop() <= MOST_ROWS:
        raise InputError(f"{source}: {sizes.pop()} rows; allowed: 1 to {MOST_ROWS}")
    return arrays


def _which(name: str, coordinates: Sequence[str], frames: Sequence[str], source: str) -> tuple[str, str]:
    """Return the frame and component of a column: ("tcp", "x"), ("tcp", "sigma.x")."""
    owner, component = split_component(name)
    if owner.endswith(".sigma"):
        owner, component = owner.removesuffix(".sigma"), f"sigma.{component}"
    measured = (*MOTIONS, *QUATERNION, *SINGLE, *FORCES, *(f"sigma.{key}" for key in (*MOTIONS, *SINGLE)))
    if owner in frames and component in measured:
        return owner, component
    if component in measured and owner:
        raise InputError(
            f"{source}: column {show(name)}: there is no frame {show(owner)}{nearest(owner, frames)}; allowed:"
            f" {listed(frames)}, or a frame that is attached to a link (frames, --attach)"
        )
    hint = nearest(name, [*coordinates, *WHOLE, *(f"{frame}.{key}" for frame in frames for key in measured[:8])])
    raise InputError(f"{source}: column {show(name)} is unknown{hint}; allowed: {POSES_RULE}")


class _Table:
    """Columns of a file, and the checks of their values."""

    def __init__(self, columns: Mapping[str, Array], source: str, lines: NDArray[np.int32] | None) -> None:
        self.columns, self._source, self._lines = columns, source, lines
        self.rows = len(next(iter(columns.values())))

    def finite(self, name: str) -> Array:
        """Return a column without empty cells."""
        values = self.columns[name]
        self._refuse(name, ~np.isfinite(values), "a finite number")
        return values

    def positive(self, name: str) -> Array:
        """Return a column of positive numbers; blanks are not looked at in columns of standard deviations."""
        values = self.finite(name)
        self._refuse(name, ~is_divisor(values), f"{ALLOWED_DIVISOR} (to leave a row out, remove it)")
        return values

    def whole(self, name: str, default: int) -> NDArray[np.int64]:
        """Return a column of whole numbers, or the default in all rows."""
        if name not in self.columns:
            return np.full(self.rows, default, dtype=np.int64)
        values = self.finite(name)
        self._refuse(name, (values != np.round(values)) | (np.abs(values) > 1e9), "a whole number")
        return values.astype(np.int64)

    def frame(self, frame: str, columns: set[str], rotation: str) -> Measured:
        """Return measurements of a frame."""
        turned = QUATERNION if rotation == "quaternion" else TURNED
        wrong = columns & set(TURNED if rotation == "quaternion" else QUATERNION)
        if wrong:
            kind = "quaternion" if rotation != "quaternion" else "rotvector or rpy"
            raise InputError(
                f"{self._source}: column {show(f'{frame}.{min(wrong)}')} with rotation {rotation!r}; allowed: the"
                f" rotation {kind}"
            )
        position, written = self._together(frame, MOTIONS[:3], columns), self._together(frame, turned, columns)
        blank = blank_frame(frame, self.rows)
        orientation = blank.orientation
        if written is not None:
            there = np.isfinite(written).all(axis=1)
            if rotation == "quaternion":
                length = np.where(there, np.linalg.norm(np.where(np.isfinite(written), written, 1.0), axis=1), 1.0)
                self._refuse(f"{frame}.qw", np.abs(length - 1.0) > 1e-2, "quaternions of length 1")
            reading = FOUR[rotation] if rotation == "quaternion" else READINGS[rotation]
            orientation[there] = reading(written[there])
        sigma = {}
        for key in columns:
            if key.startswith("sigma."):
                name = f"{frame}.{key}"
                self._refuse(name, ~is_divisor(self.columns[name]) & np.isfinite(self.columns[name]), ALLOWED_DIVISOR)
                sigma[key.removeprefix("sigma.")] = self.columns[name]
        single = {key: self.columns[f"{frame}.{key}"] if key in columns else blank.distance for key in SINGLE}
        for key in SINGLE:
            self._refuse(f"{frame}.{key}", single[key] < 0.0, "a distance that is not negative")
        wrench = [self.finite(f"{frame}.{key}") if key in columns else np.zeros(self.rows) for key in FORCES]
        return replace(
            blank,
            position=blank.position if position is None else position,
            orientation=orientation,
            wrench=np.stack(wrench, axis=1),
            sigma=sigma,
            written=written,
            distance=single["distance"],
            travel=single["travel"],
        )

    def _together(self, frame: str, keys: Sequence[str], columns: set[str]) -> Array | None:
        """Return columns that go together, (R, k): all of them in a row, or none; None where the file has none."""
        there = [key for key in keys if key in columns]
        if not there:
            return None
        if len(there) != len(keys):
            missing = next(key for key in keys if key not in columns)
            raise InputError(
                f"{self._source}: the column {frame}.{missing} is missing; allowed: {frame}.{there[0]}"
                f" with {listed(f'{frame}.{key}' for key in keys)}, or none of them"
            )
        values = np.stack([self.columns[f"{frame}.{key}"] for key in keys], axis=1)
        known = np.isfinite(values)
        partial = np.flatnonzero(known.any(axis=1) & ~known.all(axis=1))
        if partial.size:
            row = int(partial[0])
            empty, full = (keys[int(i)] for i in (known[row].argmin(), known[row].argmax()))
            raise InputError(
                f"{self._source}: {self._place(row)}: column {show(f'{frame}.{empty}')} is empty (not measured) where"
                f" {frame}.{full} is measured; allowed: {_OBSERVED}; a single component, as of contact with a plane,"
                " is none of them"
            )
        return values

    def _place(self, row: int) -> str:
        return f"line {self._lines[row]}" if self._lines is not None else f"row {row}"

    def _refuse(self, name: str, bad: Mask, allowed: str) -> None:
        at = np.flatnonzero(bad)
        if at.size:
            row = int(at[0])
            value = self.columns[name][row] if name in self.columns else float("nan")
            raise InputError(f"{self._source}: {self._place(row)}: column {show(name)}: {value:g}; allowed: {allowed}")
