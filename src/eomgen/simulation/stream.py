"""Motions that are written while they are integrated: a Zarr group whose writer may be killed at any time.

Layout: arrays ``t`` (T,), ``q`` and ``v`` (T, n), ``z`` (T, states) where laws have states, as long as they are to
become; times that are not reached are NaN.
Zarr renames chunks into place, and those of t come last, so that up to the first NaN everything is there.  Attributes
hold names, units, and what is simulated.
"""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from math import prod
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..files import open_regular, read_regular
from ..forms.plain import parse_json, printable, value_of
from ..limits import LARGEST_FINITE
from ..names import show
from ..npz import VARIABLE, most_bytes
from ..optional import optional_import
from ..robot.coordinates import unit_of
from ..shown import Shown
from ..state.turning import quaternion_columns
from .contents import check_coordinates, check_internal_states
from .result import Series

FORMAT = 1  # raised when a reader of the old one would misread it
ROWS = 256  # of a chunk
SECONDS = 1.0  # after which rows are written that fill no chunk
_NAMES = ("q", "v", "z", "t")  # in the order of writing
_MOST_METADATA = 1 << 24  # bytes: a scenario is in them
_CODECS = ["bytes", "zstd"]
_LONGEST_HEADER = 18  # bytes of a frame's header


@dataclass(frozen=True)
class StreamedMotion(Shown):
    """A motion read from a stream: t (T,), s; q and v (T, n), m, rad, per s; ``complete`` if it came to its end.

    meta: robot, robot_hash, scenario and versions as ``SimulationResult`` has them.  z: internal states, (T, states),
    by the names in ``internal_states``, in their ``internal_state_units``; None without any.
    """

    t: Array
    q: Array
    v: Array
    coordinates: tuple[str, ...]
    complete: bool
    meta: Mapping[str, Any]
    z: Array | None = None
    internal_states: tuple[str, ...] | None = None
    internal_state_units: tuple[str, ...] | None = None

    def series(self, name: str) -> Series:
        """Return a coordinate, its velocity (NAME.rate) or an internal state over time; InputError without it.

        Joints with alpha, beta and gamma have JOINT.qw, .qx, .qy and .qz as well, as ``SimulationResult.series`` says.
        """
        stem, rotations = name.removesuffix(".rate"), quaternion_columns(self.coordinates, self.q)
        if name in rotations:
            return Series(name, "", self.t, rotations[name])
        internal_states = self.internal_states or ()
        if self.z is not None and name in internal_states:
            i = internal_states.index(name)
            return Series(name, (self.internal_state_units or ())[i], self.t, self.z[:, i])
        if stem not in self.coordinates:
            known = ", ".join([f"{', '.join(self.coordinates)}, with .rate or without", *internal_states, *rotations])
            raise InputError(f"series: {show(name)} is unknown; known: {known}")
        values, unit = (self.q, unit_of(stem)) if stem == name else (self.v, f"{unit_of(stem)}/s")
        return Series(name, unit, self.t, values[:, self.coordinates.index(stem)])


class MotionStream:
    """Writes a motion of ``samples`` samples into a folder, row by row.

    Args:
        folder: that does not exist, or is empty.
        coordinates: n names.
        samples: T.
        meta: values that JSON holds.
        internal_states: units of internal states, by their names.

    Raises:
        InputError: Zarr is not installed, or the folder has something in it or cannot be written.
    """

    def __init__(
        self,
        folder: Path | str,
        coordinates: Sequence[str],
        samples: int,
        meta: Mapping[str, Any],
        internal_states: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        zarr, self._folder = _zarr(), Path(folder)
        shapes: dict[str, tuple[int, ...]] = {"t": (samples,), **dict.fromkeys("qv", (samples, len(coordinates)))}
        if internal_states:
            shapes["z"] = samples, len(internal_states)
        try:
            if self._folder.exists() and any(self._folder.iterdir()):
                raise InputError(f"{folder}: is not empty; allowed: a folder that does not exist, or is empty")
            group = zarr.open_group(str(folder), mode="a")
            self._arrays = {
                name: group.create_array(
                    name, shape=shape, chunks=(min(ROWS, samples), *shape[1:]), dtype="float64", fill_value=np.nan
                )
                for name, shape in shapes.items()
            }
            about = {"format": FORMAT, "coordinates": list(coordinates), "units": [unit_of(x) for x in coordinates]}
            names = {"internal_states": [*internal_states], "internal_state_units": [*internal_states.values()]}
            states = names if internal_states else {}
            group.attrs.update({**about, **states, "meta": dict(meta)})
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
        self._written = 0
        self._rows: dict[str, list[Array]] = {name: [] for name in _NAMES if name in shapes}
        self._last = time.monotonic()

    def append(self, t: Array, q: Array, v: Array, z: Array | None = None) -> None:
        """Take further samples, t (k,), q and v (k, n), z (k, states); written after a second, or of a full chunk."""
        for name, values in {"t": t, "q": q, "v": v, "z": z}.items():
            if name in self._rows:
                self._rows[name].append(np.array(values))
        if sum(map(len, self._rows["t"])) >= ROWS or time.monotonic() - self._last > SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write what was taken.

        Raises:
            InputError: the folder cannot be written any more.
        """
        self._last = time.monotonic()
        if not self._rows["t"]:
            return
        rows = {name: np.concatenate(pieces) for name, pieces in self._rows.items()}
        end = self._written + len(rows["t"])
        try:
            for name in rows:
                self._arrays[name][self._written : end] = rows[name]
                self._rows[name].clear()
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written: {error.strerror or error}") from None
        self._written = end


def load_stream(folder: Path | str) -> StreamedMotion:
    """Load a stream's samples, also while it is written, or after its writer was killed.

    Arrays may have 256 MB together; the environment's ``EOMGEN_NPZ_MB`` says otherwise.

    Raises:
        InputError: Zarr is not installed, or the folder is no stream; says what in it is wrong, and what is allowed.
    """
    zarr, most = _zarr(), most_bytes()
    try:
        about = _checked_layout(Path(folder), most)
        group = zarr.open_group(str(folder), mode="r", zarr_format=3, use_consolidated=False)
        t = np.asarray(group["t"][:], dtype=np.float64)
        unknown = np.flatnonzero(np.isnan(t))
        count = int(unknown[0]) if unknown.size else t.size
        names = ("q", "v", "z") if about.internal_states else ("q", "v")
        arrays = {name: np.asarray(group[name][:count], dtype=np.float64) for name in names}
    except InputError:
        raise
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError, OverflowError) as error:
        raise InputError(
            f"{folder}: is no stream of a simulation ({show(str(error))}); allowed: what eomgen wrote"
        ) from None
    for name, values in {"t": t[:count], **arrays}.items():
        if not (np.abs(values) <= LARGEST_FINITE).all():
            raise InputError(f"{folder}: array {name}: got a number that is none; allowed: finite ones up to its end")
    if (np.diff(t[:count]) <= 0.0).any():
        raise InputError(f"{folder}: array t: got times that do not increase; allowed: increasing times")
    q, v, z, meta = arrays["q"], arrays["v"], arrays.get("z"), MappingProxyType(dict(about.meta))
    states = (z, about.internal_states, about.internal_state_units) if about.internal_states else ()
    return StreamedMotion(t[:count], q, v, about.coordinates, count == t.size, meta, *states)


@dataclass(frozen=True)
class _About:
    """The group's attributes."""

    format: int
    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    meta: Mapping[str, Any]
    internal_states: tuple[str, ...] = ()
    internal_state_units: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Codec:
    """An entry of Zarr's metadata that has a name."""

    name: str
    configuration: Mapping[str, Any]


_KEYS = _Codec("default", MappingProxyType({"separator": "/"}))


@dataclass(frozen=True)
class _Stored:
    """Metadata of an array, as far as its size depends on them."""

    shape: tuple[int, ...]
    data_type: str
    chunk_grid: _Codec
    chunk_key_encoding: _Codec
    codecs: tuple[_Codec, ...]


def _checked_layout(folder: Path, most: int) -> _About:
    """Return the attributes of a stream; refuses what is no file, and arrays that are not as large as they should be.

    Zarr believes a folder's metadata: these are checked before Zarr reads them.
    """
    _check_files(folder)
    data = _metadata(folder)
    written = data.get("attributes")
    number = written.get("format") if isinstance(written, dict) else None
    if isinstance(number, int) and number > FORMAT:
        raise InputError(f"{folder}: written by a newer eomgen than this one; allowed: up to format {FORMAT}")
    about: _About = value_of(_About, written, f"{folder}: is no stream of a simulation: attributes")
    check_coordinates(about.coordinates, about.units, f"{folder}: attributes")
    check_internal_states(about.internal_states, about.internal_state_units, f"{folder}: attributes", "internal_states")
    n, states = len(about.coordinates), len(about.internal_states)
    samples = 0
    for name in ("t", "q", "v", *(("z",) if states else ())):
        where = f"{folder}: array {name}"
        declared = _metadata(folder / name)
        known = {field.name: declared[field.name] for field in fields(_Stored) if field.name in declared}
        stored: _Stored = value_of(_Stored, known, where)
        chunk: tuple[int, ...] = value_of(tuple[int, ...], stored.chunk_grid.configuration.get("chunk_shape"), where)
        samples = stored.shape[0] if name == "t" and stored.shape else samples
        wanted = (samples,) if name == "t" else (samples, states if name == "z" else n)
        if stored.data_type != "float64" or stored.shape != wanted or samples < 1:
            shown = f"{printable(stored.data_type)} {stored.shape}"
            raise InputError(f"{where}: is {shown:.80}; allowed: float64 {wanted}, one row for each time")
        if chunk != (min(ROWS, samples), *wanted[1:]):
            raise InputError(f"{where}: its chunks are {chunk!s:.40}; allowed: {ROWS} rows each")
        if stored.chunk_key_encoding != _KEYS:  # chunks of other names would not be looked at
            raise InputError(f"{where}: names its chunks in another way than eomgen; allowed: {_KEYS.name}, c/0/0")
        if [codec.name for codec in stored.codecs] != _CODECS:
            raise InputError(f"{where}: its codecs are others than eomgen's; allowed: {', '.join(_CODECS)}")
        _check_chunks(folder / name / "c", 8 * prod(chunk), where)
    size = 8 * samples * (1 + 2 * n + states)
    if size > most:
        raise InputError(
            f"{folder}: its arrays have {size} bytes; allowed: up to {most} (the environment's {VARIABLE} has their MB)"
        )
    return about


def _check_chunks(folder: Path, size: int, where: str) -> None:
    """Refuse chunks that are packed and would become larger, or smaller, than so many bytes."""
    for path in sorted(folder.rglob("*")):
        if not path.name.isdecimal() or not path.is_file():  # a folder, or not yet in its place
            continue
        with open_regular(path, 2 * size + 1024) as stream:
            unpacked = _unpacked_size(stream.read(_LONGEST_HEADER))
        if unpacked != size:
            raise InputError(f"{where}: chunk {path.name} has {unpacked} bytes; allowed: {size}, packed")


def _unpacked_size(frame: bytes) -> int | None:
    """Return the size in a Zstandard frame's header (RFC 8878, 3.1.1.1), bytes; None without one."""
    if len(frame) < 6 or frame[:4] != b"\x28\xb5\x2f\xfd":
        return None
    single = frame[4] >> 5 & 1
    start = 6 - single + (0, 1, 2, 4)[frame[4] & 3]
    width = (single, 2, 4, 8)[frame[4] >> 6]
    size = int.from_bytes(frame[start : start + width], "little") + (256 if width == 2 else 0)
    return size if width and len(frame) >= start + width else None


def _check_files(folder: Path) -> None:
    """Refuse entries that are neither files nor folders: a reader would wait for them."""
    try:
        if not stat.S_ISDIR(folder.stat().st_mode):
            raise InputError(f"{folder}: is no stream of a simulation (no folder); allowed: a folder that eomgen wrote")
        for place, folders, files in os.walk(folder):
            for name in (*folders, *files):
                if not _is_plain(Path(place) / name):
                    allowed = "allowed: files and folders, as eomgen wrote them"
                    raise InputError(f"{folder}: {show(name)} is no file; {allowed}")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or show(str(error))
        raise InputError(
            f"{folder}: is no stream of a simulation ({reason}); allowed: a folder that eomgen wrote"
        ) from None


def _is_plain(path: Path) -> bool:
    """Return whether a path is a file or a folder, or is not there any more: its writer has renamed it."""
    with suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        return stat.S_ISREG(mode) or stat.S_ISDIR(mode)
    return True


def _metadata(folder: Path) -> dict[str, Any]:
    """Return the metadata of a group or an array."""
    path = folder / "zarr.json"
    try:
        text = read_regular(path, _MOST_METADATA).decode("utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or show(str(error))
        raise InputError(
            f"{folder}: is no stream of a simulation ({path.name}: {reason}); allowed: what eomgen wrote"
        ) from None
    metadata = parse_json(text, str(path), 16 * _MOST_METADATA)
    if not isinstance(metadata, dict):
        raise InputError(f"{path}: got {show(metadata)}; allowed: a table")
    return metadata


def _zarr() -> Any:
    with optional_import("Zarr", "streams need"):
        import zarr
    return zarr
