"""Tables of a scenario that have a type, and values that occur in several of its tables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from .names import is_identifier, show
from .schema import Table
from .timetable import HOLD, INTERPOLATIONS, TimeTable, inline_table, read_table

LEAST_TIME = 1e-9  # s


def positive(table: Table, key: str) -> float | None:
    """A number that is at least LEAST_TIME."""
    value = table.number(key)
    if value is not None and value < LEAST_TIME:
        table.fail(f"got {value:g}; allowed: a number that is at least {LEAST_TIME:g}", key)
    return value


def boolean(table: Table, key: str) -> bool | None:
    """True or false."""
    value = table.values.get(key)
    if value is not None and not isinstance(value, bool):
        table.fail(f"got {show(value)}; allowed: true or false", key)
    return value


def numbers_by_name(table: Table, key: str) -> dict[str, float]:
    """Numbers by the names of joints or coordinates; ``joint1.x = 1`` and ``joint1 = { x = 1 }`` are the same TOML."""
    if key not in table:
        return {}
    found: dict[str, float] = {}

    def walk(inner: object, path: tuple[str, ...]) -> None:
        where = ".".join((key, *path))
        if isinstance(inner, dict) and len(path) < 3:
            for name, value in inner.items():
                if not all(is_identifier(part) for part in name.split(".")):
                    table.fail(f"got the name {show(name)}; allowed: names of joints or coordinates", where)
                walk(value, (*path, *name.split(".")))
        elif path:
            name = ".".join(path)
            if name in found:
                table.fail(f"{show(name)} is given twice; allowed: once", key)
            found[name] = table.number_of(inner, where)
        else:
            table.fail(f"got {show(inner)}; allowed: a table of numbers by joint or coordinate", key)

    walk(table.values[key], ())
    return found


def _point(table: Table, key: str) -> dict[str, float] | list[float] | None:
    """Numbers by name, or in the order of the coordinates."""
    value = table.values.get(key)
    if value is None:
        return None
    if isinstance(value, list):
        return [table.number_of(item, f"{key}.{i}") for i, item in enumerate(value)]
    return numbers_by_name(table, key)


def _gain(table: Table, key: str) -> dict[str, float] | float | None:
    value = table.values.get(key)
    if isinstance(value, dict):
        found = numbers_by_name(table, key)
        for name, number in found.items():
            if number < 0.0:
                table.fail(f"got {number:g}; allowed: a number that is at least 0", f"{key}.{name}")
        return found
    return table.number(key, 0.0)


def _point_to_point(table: Table, _: Path | None) -> dict[str, Any]:
    return {"start": _point(table, "start"), "goal": _point(table, "goal"), **_span(table)}


def _span(table: Table) -> dict[str, Any]:
    return {"begin": table.number("begin", 0.0), "duration": positive(table, "duration")}


def _via(table: Table, _: Path | None) -> dict[str, Any]:
    table.require("points", "an array of two or more points, each an array of numbers or a table by joint")
    given = table.values["points"]
    if not isinstance(given, list) or len(given) < 2:
        table.fail(f"got {show(given)}; allowed: an array of two or more points", "points")
    rows = {str(i): x for i, x in enumerate(given)}
    inner = Table(rows, f"{table.where}.points", table.source, rows)
    points = [_point(inner, str(i)) for i in range(len(given))]
    if ("times" in table) == ("speed" in table):
        table.fail("needs times or speed; allowed: one of them")
    times = table.numbers("times", len(given))
    if times is not None and any(b - a < LEAST_TIME for a, b in pairwise(times)):
        table.fail(f"got {show(list(times))}; allowed: increasing times", "times")
    if times is not None and (times[0] < 0.0 or "begin" in table):
        table.fail("allowed: from 0 on, and without begin", "times")
    speed: Any = table.values.get("speed")
    if isinstance(speed, list):
        speed = table.numbers("speed", len(given) - 1)
    elif speed is not None:
        speed = (table.number("speed"),) * (len(given) - 1)
    if speed is not None and min(speed) <= 0.0:
        table.fail(f"got {show(table.values['speed'])}; allowed: numbers greater than 0", "speed")
    return {"points": points, "times": times, "speed": speed, "begin": table.number("begin", 0.0)}


def _file(table: Table, folder: Path | None, suffixes: tuple[str, ...] = (".csv", ".npz")) -> str:
    table.require("file", f"the path of a {' or '.join(suffixes)} file, relative to this file")
    name = table.text("file") or ""
    if folder is None or not name.endswith(suffixes):
        table.fail(
            f"got {show(name)}; allowed: the path of a {' or '.join(suffixes)} file, relative to this file", "file"
        )
    if not _is_file(folder / name):
        table.fail(f"got {show(name)}, which does not exist in {str(folder)!a}; allowed: an existing file", "file")
    return str(folder / name)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that is too long, or has a NUL
        return False


def read_sampled(table: Table, folder: Path | None) -> dict[str, Any]:
    """The path of a sampled motion's file."""
    return {"file": _file(table, folder)}


def _line(table: Table, _: Path | None) -> dict[str, Any]:
    for key in ("from", "to"):
        table.require(key, "a point, three numbers in m, base axes")
    ends = {key: table.vector(key) for key in ("from", "to")}
    if ends["from"] == ends["to"]:
        table.fail(f"got {show(table.values['to'])}, where the line begins; allowed: another point", "to")
    return {"frame": table.text("frame"), **ends, **_span(table)}


def _circle(table: Table, _: Path | None) -> dict[str, Any]:
    for key in ("center", "normal", "from"):
        table.require(key, "three numbers, base axes")
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
    angle = table.number("angle")
    if angle == 0.0:
        table.fail("got 0; allowed: an angle in rad other than 0", "angle")
    ends = {"center": tuple(center), "normal": tuple(normal), "from": tuple(start)}
    return {"frame": table.text("frame"), **ends, "angle": angle, **_span(table)}


def _nothing(_: Table, __: Path | None) -> dict[str, Any]:
    return {}


def time_table(table: Table, folder: Path | None, columns: Sequence[str] | None) -> TimeTable:
    """Rows or a file's; ``columns`` are the names to have, any where they are None."""
    hold = table.choice("interpolation", INTERPOLATIONS) == HOLD
    if ("rows" in table) == ("file" in table):
        table.fail("needs rows or file; allowed: one of them")
    if "file" in table:
        return read_table(Path(_file(table, folder, (".csv",))), columns, hold)
    assert columns is not None
    return inline_table(table, "rows", tuple(columns), hold)


def _torque(table: Table, folder: Path | None) -> dict[str, Any]:
    if ("coordinates" in table) == ("file" in table):
        table.fail("needs coordinates with rows, or a file whose columns are called so; allowed: one of them")
    names = table.strings("coordinates") if "coordinates" in table else None
    if names is not None and (not names or len(set(names)) < len(names)):
        table.fail(f"got {show(names)}; allowed: one or more different names", "coordinates")
    return {"table": time_table(table, folder, names)}


def _pd(table: Table, _: Path | None) -> dict[str, Any]:
    for key in ("kp", "kd"):
        table.require(key, "a number, or a table of numbers by joint")
    return {"kp": _gain(table, "kp"), "kd": _gain(table, "kd"), "gravity": boolean(table, "gravity")}


def _computed(table: Table, _: Path | None) -> dict[str, Any]:
    bandwidth = table.number("bandwidth")
    if bandwidth is not None and bandwidth <= 0.0:
        table.fail(f"got {bandwidth:g}; allowed: a number in rad/s greater than 0", "bandwidth")
    return {"bandwidth": bandwidth}


MOTION_READERS = {
    "point_to_point": _point_to_point,
    "via": _via,
    "sampled": read_sampled,
    "line": _line,
    "circle": _circle,
}
CONTROL_READERS = {"none": _nothing, "torque": _torque, "pd": _pd, "computed_torque": _computed}
