"""Tables of a scenario that have a type, and values that occur in several of its tables."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..forms.tables import DEGREES, Table
from ..motion.timetable import HOLD, TimeTable, inline_table, read_table
from ..names import show
from .keys import LEAST_TIME


def _present(table: Table, _: Path | None) -> dict[str, Any]:
    return table.present()


def _via(table: Table, _: Path | None) -> dict[str, Any]:
    timing = _timing(table, len(table.value("points")))
    return {**table.present(), **timing}


def _timing(table: Table, count: int) -> dict[str, Any]:
    """Return times of points, or mean speeds of the pieces between them."""
    if ("times" in table) == ("speed" in table):
        table.fail("needs times or speed; allowed: one of them")
    times = table.numbers("times", count)
    if times is not None and any(b - a < LEAST_TIME for a, b in pairwise(times)):
        table.fail(f"got {show(list(times))}; allowed: increasing times", "times")
    if times is not None and (times[0] < 0.0 or "begin" in table):
        table.fail("allowed: from 0 on, and without begin", "times")
    if isinstance(table.values.get("speed"), list):
        speed = table.numbers("speed", count - 1)
    else:
        speed = (table.value("speed"),) * (count - 1) if "speed" in table else None
    return {"times": times, "speed": speed}


def _spline(table: Table, _: Path | None) -> dict[str, Any]:
    points = [entry for _, entry in table.entries("points")]
    for entry in points:
        entry.require()
    places, turns = [entry.vector("xyz") for entry in points], [entry.angles("rpy") for entry in points]
    open_ones = [entry for entry, rpy in zip(points, turns, strict=True) if rpy is None]
    turned = len(open_ones) < len(points)
    if turned and open_ones:
        open_ones[0].fail("the key 'rpy' is missing, which other points have; allowed: at all points, or at none")
    if turned and "orientation" in table:
        table.fail("points have rpy; allowed: orientation = 'keep' where they have none", "orientation")
    timing = _timing(table, len(points))
    still = [i for i, (a, b) in enumerate(pairwise(places)) if a == b]
    if timing["speed"] is not None and still:
        points[still[0] + 1].fail("is where the point before is; allowed: another point, or times instead of speed")
    options = {key: table.value(key) for key in ("frame", "orientation", "begin", "smooth")}
    return {**options, "points": tuple(places), "rpy": tuple(turns) if turned else None, **timing}


def _file(table: Table, folder: Path | None, key: str = "file") -> str:
    name = table.text(key) or ""
    if folder is None:
        table.fail(f"got {show(name)}; allowed: the path of a file, relative to this file", key)
    if not _is_file(folder / name):
        table.fail(f"got {show(name)}, which does not exist in {str(folder)!a}; allowed: an existing file", key)
    return str(folder / name)


def _is_file(path: Path) -> bool:
    try:
        return os.path.isfile(path)
    except (OSError, ValueError):  # a name that is too long, or has a NUL
        return False


def read_sampled(table: Table, folder: Path | None) -> dict[str, Any]:
    """Return the path of a sampled motion's file, and of the motion that it corrects."""
    wanted = {"wanted": _file(table, folder, "wanted")} if "wanted" in table else {}
    return {"file": _file(table, folder), **wanted}


def _line(table: Table, _: Path | None) -> dict[str, Any]:
    if table.vector("from") == table.vector("to"):
        table.fail(f"got {show(table.values['to'])}, where the line begins; allowed: another point", "to")
    return {**table.present(), "orientation": _orientation(table)}


def _orientation(table: Table) -> Any:
    """Return ``"keep"``, or roll, pitch and yaw by "from" and "to", as far as set; None without the key."""
    orientation = table.value("orientation")
    if not isinstance(orientation, Table):
        return orientation
    if not orientation.values:
        orientation.fail("got an empty table; allowed: from, to, or both")
    return orientation.present()


def _circle(table: Table, _: Path | None) -> dict[str, Any]:
    center, normal, start = (np.array(table.vector(key)) for key in ("center", "normal", "from"))
    radius = np.linalg.norm(start - center)
    if not np.linalg.norm(normal) > 1e-9:
        table.fail(f"got {show(table.values['normal'])}; allowed: a direction, not zero", "normal")
    if not radius > 1e-9:
        table.fail(f"got {show(table.values['from'])}, the center; allowed: a point of the circle", "from")
    if abs(normal @ (start - center)) > 1e-6 * radius * np.linalg.norm(normal):
        table.fail(
            f"got {show(table.values['from'])}; allowed: a point in the plane through center, across normal", "from"
        )
    for key in ("angle", "angle" + DEGREES):
        if key in table and table.angle("angle") == 0.0:  # also where degrees are too few for a number of radians
            unit = table.keys[key].unit
            table.fail(f"got {show(table.values[key])}; allowed: an angle in {unit} other than 0", key)
    return {**table.present(), "orientation": _orientation(table)}


def time_table(table: Table, folder: Path | None, columns: Sequence[str] | None) -> TimeTable:
    """Return the time table of rows or of a file; ``columns`` are the required names, any where they are None."""
    hold = table.choice("interpolation") == HOLD
    if ("rows" in table) == ("file" in table):
        table.fail("needs rows or file; allowed: one of them")
    if "file" in table:
        return read_table(Path(_file(table, folder)), columns, hold)
    assert columns is not None
    return inline_table(table, "rows", tuple(columns), hold)


def _torque(table: Table, folder: Path | None) -> dict[str, Any]:
    if ("coordinates" in table) == ("file" in table):
        table.fail("needs coordinates with rows, or a file whose columns are called so; allowed: one of them")
    names = table.strings("coordinates") if "coordinates" in table else None
    return {"table": time_table(table, folder, names), "saturate": table.boolean("saturate")}


MOTION_READERS = {
    "point_to_point": _present,
    "via": _via,
    "sampled": read_sampled,
    "line": _line,
    "circle": _circle,
    "spline": _spline,
}
CONTROL_READERS = {
    **dict.fromkeys(("none", "reference", "pd", "computed_torque", "feedforward"), _present),
    "torque": _torque,
}
