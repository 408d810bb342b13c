"""Motions that are written while they are integrated: a Zarr group whose writer may be killed at any time.

Layout: arrays ``t`` (T,), ``q`` and ``v`` (T, n), as long as they are to become; times that are not reached are NaN.
Zarr renames chunks into place, and those of t come last, so that up to the first NaN everything is there.  Attributes
hold names, units, and what is simulated.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..optional import optional_import
from ..robot.coordinates import unit_of
from ..shown import Shown
from .result import Series

Array = NDArray[np.float64]

FORMAT = 1  # raised when a reader of the old one would misread it
ROWS = 256  # of a chunk
SECONDS = 1.0  # after which rows are written that fill no chunk
_NAMES = ("q", "v", "t")  # in the order of writing


@dataclass(frozen=True)
class StreamedMotion(Shown):
    """A motion read from a stream: t (T,), s; q and v (T, n), m, rad, per s; ``complete`` if it came to its end.

    meta: robot, robot_hash, scenario and versions as ``SimulationResult`` has them.
    """

    t: Array
    q: Array
    v: Array
    coordinates: tuple[str, ...]
    complete: bool
    meta: Mapping[str, Any]

    def series(self, name: str) -> Series:
        """A coordinate, or its rate (NAME.rate), over time; InputError if there is none of that name."""
        stem = name.removesuffix(".rate")
        if stem not in self.coordinates:
            raise InputError(
                f"series: {name!r} is unknown; known: {', '.join(self.coordinates)}, with .rate or without"
            )
        values, unit = (self.q, unit_of(stem)) if stem == name else (self.v, f"{unit_of(stem)}/s")
        return Series(name, unit, self.t, values[:, self.coordinates.index(stem)])


class MotionStream:
    """Writes a motion of ``samples`` samples into a folder, row by row.

    Args:
        folder: that does not exist, or is empty.
        coordinates: n names.
        samples: T.
        meta: values that JSON holds.

    Raises:
        InputError: Zarr is not installed, or the folder has something in it or cannot be written.
    """

    def __init__(self, folder: Path | str, coordinates: Sequence[str], samples: int, meta: Mapping[str, Any]) -> None:
        zarr, self._folder = _zarr(), Path(folder)
        shapes = {"t": (samples,), "q": (samples, len(coordinates)), "v": (samples, len(coordinates))}
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
            group.attrs.update({**about, "meta": dict(meta)})
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
        self._written = 0
        self._rows: dict[str, list[Array]] = {name: [] for name in _NAMES}
        self._last = time.monotonic()

    def append(self, t: Array, q: Array, v: Array) -> None:
        """Take further samples, t (k,), q and v (k, n); written after a second, or when a chunk is full."""
        for name, values in zip(("t", "q", "v"), (t, q, v), strict=True):
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
        rows = {name: np.concatenate(parts) for name, parts in self._rows.items()}
        end = self._written + len(rows["t"])
        try:
            for name in _NAMES:
                self._arrays[name][self._written : end] = rows[name]
                self._rows[name].clear()
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written: {error.strerror or error}") from None
        self._written = end


def load_stream(folder: Path | str) -> StreamedMotion:
    """Load what a stream has, also while it is written, or after its writer was killed.

    Raises:
        InputError: Zarr is not installed, or the folder is no stream.
    """
    zarr = _zarr()
    try:
        group = zarr.open_group(str(folder), mode="r")
        about = dict(group.attrs)
        if about["format"] > FORMAT:
            raise InputError(f"{folder}: written by a newer eomgen than this one")
        t = np.asarray(group["t"][:], dtype=np.float64)
        unknown = np.flatnonzero(np.isnan(t))
        count = int(unknown[0]) if unknown.size else t.size
        q, v = (np.asarray(group[name][:count], dtype=np.float64) for name in ("q", "v"))
        names = tuple(str(name) for name in about["coordinates"])
        return StreamedMotion(t[:count], q, v, names, count == t.size, MappingProxyType(about["meta"]))
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{folder}: is no stream of a simulation ({error})") from None


def _zarr() -> Any:
    with optional_import("Zarr (Python 3.11 or later)", "streams need"):
        import zarr
    return zarr
