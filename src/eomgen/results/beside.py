"""Files beside a result in its folder: what they are called, and which of them an older result has left there."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from ..files import FIGURE_ENDINGS, PAGE_ENDING, read_regular

NPZ, JSON = ".npz", ".json"  # endings of files of results
TRAJECTORY, SWEEP, STREAM = "trajectory.npz", "sweep.json", "zarr.json"  # by which folders say what they hold
SIMULATION_FIGURES = ("tool", "deviations", "journals", "tracking", "energy", "states")
SWEEP_FIGURES = ("distribution", "sensitivity")
PAGE = f"report{PAGE_ENDING}"  # of a simulation; of other results, behind the name of their file
TABLE, TABLE_ENDINGS = "samples", (".csv", ".parquet")
CREATOR = "eomgen"  # in the metadata of all figures

_MARKS = {  # bytes of a file by which it says that eomgen wrote it
    ".svg": f"<dc:title>{CREATOR}</dc:title>".encode("ascii"),
    ".pdf": f"/Creator ({CREATOR})".encode("ascii"),
    ".png": f"Software\0{CREATOR}".encode("ascii"),
    PAGE_ENDING: b'<meta name="generator" content="eomgen ',
}
_MOST_BYTES = 1 << 26


def _figures(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(f"{name}{ending}" for name in names for ending in FIGURE_ENDINGS)


BESIDE_SIMULATION = (*_figures(SIMULATION_FIGURES), PAGE)
BESIDE_SWEEP = (*_figures(SWEEP_FIGURES), *(f"{TABLE}{ending}" for ending in TABLE_ENDINGS))


def older_than(result: Path, names: Iterable[str], written: Iterable[Path] = ()) -> list[Path]:
    """Return the files of some names in a result's folder that are older than the result, without those just written.

    Args:
        result: the file whose date counts.
        names: of files beside it.
        written: by the command that asks.
    """
    fresh, dated = {path.name for path in written if path.parent == result.parent}, _date(result)
    places = [result.with_name(name) for name in names if name not in fresh]
    return [path for path in places if os.path.isfile(path) and _date(path) <= dated]


def is_ours(path: Path) -> bool:
    """Return whether a figure or page says that eomgen wrote it; a link, and what cannot be read, does not."""
    mark = _MARKS.get(path.suffix)
    if mark is None or os.path.islink(path):
        return False
    try:
        return mark in read_regular(path, _MOST_BYTES)
    except OSError:
        return False


def remove_ours(paths: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Remove those files of which it is sure that eomgen wrote them; return what was removed, and what was left."""
    removed: list[Path] = []
    left: list[Path] = []
    for path in paths:
        (removed if is_ours(path) and _is_removed(path) else left).append(path)
    return removed, left


def _is_removed(path: Path) -> bool:
    try:
        path.unlink()
    except OSError:
        return False
    return True


def _date(path: Path) -> int:
    return path.stat().st_mtime_ns
