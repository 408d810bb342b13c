"""Equations of drives in cascade, written for numbers alone: what a table ``drive`` says, by its keys."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from typing import Any

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Robot
from tests.support.joint_table import joint_table, link_table

Table = Mapping[str, Any]
LOOPS = ("position", "velocity", "current")


AXIS = f"""
name = "servo"
{link_table("arm", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}
{joint_table("joint1", "base", "arm", "revolute")}
"""
INERTIA, DAMPING = 0.08, 0.05
WINDING = "winding = { resistance = 1.0, inductance = 1e-3, torque_constant = 0.5 }"
LIMITS = "current_limit = 5.0, voltage_limit = 20.0"
POSITION = "position = { kp = 20.0, ki = 5.0, kd = 0.3, filter = 0.01, limit = 3.0 }"
VELOCITY = "velocity = { kp = 4.0, ki = 40.0, kd = 0.02, filter = 0.01, limit = 9.0 }"
CURRENT = "current = { kp = 3.0, ki = 300.0, kd = 1e-3, filter = 1e-2 }"
DRIVES: Mapping[str, tuple[str, float]] = {  # tables of drives, and what their inputs become
    "cascade": (f"{WINDING}, {LIMITS}, controller = {{ {POSITION}, {VELOCITY}, {CURRENT} }}", 2.0),
    "without current loop": (f"{WINDING}, {LIMITS}, controller = {{ {POSITION}, {VELOCITY} }}", 1.0),
    "position": (f"{WINDING}, {LIMITS}, controller = {{ kp = 20.0, ki = 5.0, kd = 0.3 }}", 0.3),
    "voltage": (f"{WINDING}, {LIMITS}", 12.0),
    "current": (f"{WINDING}, {LIMITS}, controller = {{ {CURRENT} }}", 3.0),
    "lag": ("lag = 0.05", 0.5),
    "lagging cascade": (f"lag = 0.005, controller = {{ {POSITION}, {VELOCITY} }}", 1.0),
    "torque": ("controller = { kp = 30.0, kd = 1.0, limit = 5.0 }", 1.0),
    "velocity": ("controller = { velocity = { kp = 3.0, ki = 10.0, limit = 2.0, tracking_time = 0.2 } }", 1.5),
}


def servo(table: str, more: str = "") -> Robot:
    """Return one link on a joint with a drive of that table."""
    return robot_from_toml(f"{AXIS}gamma = {{ damping = {DAMPING}, armature = 0.02, drive = {{ {table} }}{more} }}\n")


def numbers_of(table: str) -> Any:
    """Return a table of a description as a mapping."""
    return tomllib.loads(f"drive = {{ {table} }}")["drive"]


def _clip(x: float, limit: float) -> float:
    return min(max(x, -limit), limit)


def loops_of(table: Table) -> dict[str, Table]:
    """Return the loops of a drive, from the outside; numbers alone are those of a position loop."""
    controller = table.get("controller", {})
    if controller and not any(loop in controller for loop in LOOPS):
        return {"position": controller}
    return {loop: controller[loop] for loop in LOOPS if loop in controller}


def drive(table: Table, s: float, v: float, z: Mapping[str, float], u: float) -> tuple[float, dict[str, float], float]:
    """Return force, rates of the states and voltage of a drive at s, v with states z and the input u."""
    loops, winding, rates = loops_of(table), table.get("winding"), dict[str, float]()
    names = list(loops)

    def enters(x: float, behind: str) -> float:
        if behind == "current":
            return _clip(x, table.get("current_limit", math.inf))
        if behind or winding is None:
            return x
        if "current_limit" in table and "current" not in loops:
            induced, most = winding["torque_constant"] * v, winding["resistance"] * table["current_limit"]
            x = min(max(x, induced - most), induced + most)
        return _clip(x, table.get("voltage_limit", math.inf))

    signal = enters(u, names[0] if names else "")
    for place, (loop, numbers) in enumerate(loops.items()):
        measured = {"position": s, "velocity": v, "current": z.get("current", 0.0)}[loop]
        error = signal - measured
        x = numbers.get("kp", 0.0) * error
        if "kd" in numbers:
            x -= numbers["kd"] * _derivative(loop, numbers, measured, v, z, rates)
        if "ki" in numbers:
            x += numbers["ki"] * z[f"integral_{loop}"]
        y = _clip(x, numbers.get("limit", math.inf))
        y = enters(y, names[place + 1] if place + 1 < len(names) else "")
        if "ki" in numbers:
            back = numbers["ki"] * numbers.get("tracking_time", numbers.get("kp", 0.0) / numbers["ki"])
            rates[f"integral_{loop}"] = error if y == x else error + (y - x) / back
        signal = y
    if winding is not None:
        left = signal - winding["resistance"] * z["current"] - winding["torque_constant"] * v
        rates["current"] = left / winding["inductance"]
        return winding["torque_constant"] * z["current"], rates, signal
    if "lag" in table:
        rates["force"] = (signal - z["force"]) / table["lag"]
        return z["force"], rates, 0.0
    return signal, rates or {"input": -z["input"]}, 0.0


def _derivative(
    loop: str, numbers: Table, measured: float, v: float, z: Mapping[str, float], rates: dict[str, float]
) -> float:
    if "filter" not in numbers:
        return v
    state = z[f"filter_{loop}"]
    rates[f"filter_{loop}"] = ((v if loop == "position" else measured) - state) / numbers["filter"]
    return state if loop == "position" else rates[f"filter_{loop}"]


def rates_of(
    table: Table, names: list[str], u: float, acceleration: Callable[[float, float, float], float]
) -> Callable[[float, Any], list[float]]:
    """Return (t, (s, v, z...)) -> rates of one coordinate with a drive; acceleration: of s, v and the force."""

    def rates(_: float, y: Any) -> list[float]:
        force, z_rates, _ = drive(table, y[0], y[1], dict(zip(names, y[2:], strict=True)), u)
        return [y[1], acceleration(y[0], y[1], force), *(z_rates[name] for name in names)]

    return rates
