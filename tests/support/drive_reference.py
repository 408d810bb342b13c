"""Equations of drives in cascade, written for numbers alone: what a table ``drive`` says, by its keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

Table = Mapping[str, Any]
LOOPS = ("position", "velocity", "current")


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
