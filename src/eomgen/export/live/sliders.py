"""Ranges in which run-time parameters are moved on a page, and how they are grouped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...identifiers import parameter_path
from ...robot.parameter_names import leasts
from ...robot.value import Robot
from ..fmu.variables import parameter_unit

DECADES = 100.0  # a slider goes from a value over this to a value times it
GRAVITY = 25.0  # m/s^2: that of Jupiter
FIRST = {"m": 1e-3, "rad": 1e-2}  # the upper end where a length or angle begins at 0
SCALES = {  # numbers that are also moved together
    "stiffness": "all stiffness",
    "damping": "all damping",
    "clearance": "all clearances",
    "friction": "all friction",
}


def parameter_sliders(robot: Robot, values: Mapping[str, float], hidden: frozenset[str]) -> list[dict[str, Any]]:
    """Return sliders of parameters with label, owner, group, unit and range, as JSON holds them.

    Args:
        robot: of the kernel.
        values: of the parameters as they begin.
        hidden: names of parameters that something else on the page moves.
    """
    return [_slider(robot, name, value) for name, value in values.items() if name not in hidden]


def scales_of(sliders: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Return groups of which there are several that are not 0, with their labels."""
    counts = {key: sum(s["group"] == key and s["value"] > 0.0 for s in sliders) for key in SCALES}
    return [{"key": key, "label": label} for key, label in SCALES.items() if counts[key] > 1]


def _slider(robot: Robot, name: str, value: float) -> dict[str, Any]:
    path, unit, least = (
        parameter_path(name),
        parameter_unit(robot, name).replace(".", " ").replace("s2", "s^2"),
        leasts(robot, [name]).get(name),
    )
    owner, group = _owner(path), _group(path)
    label = f"gravity {path[-1]}" if group == "gravity" else ".".join(path[2:]) or name
    about = {"name": name, "label": label, "owner": owner, "group": group, "unit": unit, "value": value}
    return {**about, "about": name, "least": least, **_range(group, unit, value, least)}


def _owner(path: tuple[str, ...]) -> str:
    return " ".join(path[:2]) if len(path) > 2 else path[0]


def _group(path: tuple[str, ...]) -> str:
    if path[0] == "gravity":
        return "gravity"
    return next((key for key in SCALES if key in path[2:]), path[-1])


def _range(group: str, unit: str, value: float, least: float | None) -> dict[str, Any]:
    if group == "gravity":
        return {"low": -GRAVITY, "high": GRAVITY, "log": False}
    if value > 0.0 and least is not None:
        return {"low": value / DECADES, "high": value * DECADES, "log": True}
    if value == 0.0:
        high = FIRST.get(unit, 1.0)
        return {"low": 0.0 if least is not None else -high, "high": high, "log": False}
    return {"low": min(2.0 * value, -value), "high": max(2.0 * value, -value), "log": False}
