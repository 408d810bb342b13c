"""Lengths and angles of robots, whose sizes show millimetres and degrees whatever format they are read from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ..forms.unusual_sizes import Quantity
from ..names import parameter_name, split_component
from ..robot.coordinates import unit_of
from ..robot.value import Robot

_UNITS = {  # of numbers, by how their names end
    "m": re.compile(r"\.(com|offset)\.[xyz]$|\.xyz\.[0-9]$|\.(clearance|length|radius)$"),
    "rad": re.compile(r"\.offset\.(alpha|beta|gamma)$|\.rpy\.[0-9]$"),
}
_ENDLESS = 1e4  # m or rad: limits of such sizes stand for none


def inherited_sizes(robot: Robot, values: Mapping[str, Any] | None) -> Iterator[Quantity]:
    """Yield sizes that no TOML gives: of another format where ``values`` is None, or of a URDF that a TOML refines."""
    if values is not None and "urdf" not in values:
        return
    own = {entry.get("name") for key in ("links", "joints") for entry in (values or {}).get(key, ())}
    for where, number, unit in sizes_of(robot):
        family, _, rest = where.partition(".")
        if values is None or (family in ("links", "joints") and rest.partition(".")[0] not in own):
            yield where, number, unit


def sizes_of(robot: Robot) -> Iterator[Quantity]:
    """Yield place, value and unit of lengths and angles: of links, joints and elements, limits, and the home."""
    for name, number in robot.numbers():
        unit = next((unit for unit, ending in _UNITS.items() if ending.search(name)), "")
        if unit and number is not None:
            yield name, number, unit
    for name in robot.coordinates:
        limits = robot.limits_of(name)
        for side, number in (("lower", limits.lower), ("upper", limits.upper)):
            if number is not None and abs(number) < _ENDLESS:
                yield parameter_name("joints", *split_component(name), "limits", side), number, unit_of(name)
    for name, number in robot.home.items():
        yield f"home.{name}", number, unit_of(name)
