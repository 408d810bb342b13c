"""Points of the driven coordinates: their limits, what a user gives, and where a default motion goes."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError, UnknownNameError
from ..forms.unusual_sizes import is_unusual, unit_question
from ..identifiers import are_names, check_kind
from ..limits import LARGEST, is_usable
from ..names import joint_of, show
from ..robot.coordinates import unit_of
from ..robot.mechanism import leading_home, position_limits
from ..robot.model import movable_coordinates
from ..robot.value import Robot
from .point_to_point import PointToPoint

Point = Mapping[str, float] | Sequence[float] | Array

SPAN_ANGULAR, SPAN_LINEAR = np.pi / 4, 0.2  # rad, m: default motion of a joint, if its limits leave room for it


def principal_limits(robot: Robot, coordinate: str) -> tuple[float, float]:
    """Return limits of a driven coordinate, m or rad.

    They are infinite where there are none; both are home where the coordinate is fixed, as of a free joint.
    """
    check_kind("coordinate", coordinate, isinstance(coordinate, str), "the name of a coordinate")
    check_kind("robot", robot, isinstance(robot, Robot), "a Robot (from load_robot)")
    home = leading_home(robot).get(coordinate, 0.0)
    return position_limits(robot, coordinate) or (home, home)


def limits_beside(robot: Robot, coordinates: Sequence[str], driven: Container[str], q: Array) -> Array:
    """Return lower and upper limits, (n, 2), between which coordinates of a rigid robot are looked for.

    Driven ones within their limits, those that follow in a closed mechanism anywhere; all others stay.

    Args:
        robot: whose limits hold.
        coordinates: names, n.
        driven: those that may be moved.
        q: where the others stay, (n,).
    """
    follow = set(movable_coordinates(robot)) if robot.is_closed else set()
    limits = [
        principal_limits(robot, name) if name in driven else (-np.inf, np.inf) if name in follow else (x, x)
        for name, x in zip(coordinates, q.tolist(), strict=True)
    ]
    return np.array(limits)


def default_ends(robot: Robot, coordinates: Sequence[str]) -> tuple[Array, Array]:
    """Return start and goal of a default motion, (n,) each; from the description's home where it names a coordinate."""
    ends = []
    for name in coordinates:
        limits, home = position_limits(robot, name), leading_home(robot).get(name)
        ends.append((home or 0.0,) * 2 if limits is None else _default_span(limits, unit_of(name), home))
    start, goal = np.array(ends).reshape(-1, 2).T
    return start, goal


def _default_span(limits: tuple[float, float], unit: str, home: float | None) -> tuple[float, float]:
    """Start at home or near zero, well inside the limits, and a goal on the side where there is more room."""
    low, high = limits
    span = SPAN_ANGULAR if unit == "rad" else SPAN_LINEAR
    if not (np.isfinite(low) and np.isfinite(high)):
        low, high = max(low, -4.0 * span), min(high, 4.0 * span)
        if low >= high:  # one limit, beyond the default span
            low, high = (low, low + 4.0 * span) if np.isfinite(limits[0]) else (high - 4.0 * span, high)
    margin = 0.1 * (high - low)
    start = min(max(0.0, low + margin), high - margin) if home is None else home
    length = min(span, 0.4 * (high - low))
    return start, start + length if high - start >= start - low else start - length


def default_motion(
    robot: Robot,
    duration: float,
    coordinates: Sequence[str],
    *,
    start: Point | None = None,
    goal: Point | None = None,
) -> PointToPoint:
    """Return the point-to-point motion of these coordinates (those of ``robot.rigid()``).

    See ``simulate`` for start and goal.

    Raises:
        InputError: a value outside the joint's limits, a wrong number of them.
        UnknownNameError: a name that is no principal coordinate.
    """
    check_kind("coordinates", coordinates, are_names(coordinates), "a sequence of names")
    check_kind("robot", robot, isinstance(robot, Robot), "a Robot (from load_robot)")
    if not (is_usable(duration) and duration > 0.0):
        raise InputError(f"duration: {show(duration)} s; a motion takes a time above 0, up to {LARGEST:g}")
    default_start, default_goal = default_ends(robot, coordinates)
    first = point_of(robot, coordinates, "start", start, default_start)
    last = point_of(robot, coordinates, "goal", goal, default_goal)
    return PointToPoint(first, last, duration, names=tuple(coordinates))


def size_question(name: str, value: float) -> str:
    """Ask whether a coordinate's value, m or rad, is in millimetres or degrees; "" where it is of a usual size."""
    unit = unit_of(name)
    return unit_question(name, value, unit) if is_unusual(value, unit) else ""


def point_of(robot: Robot, coordinates: Sequence[str], label: str, requested: Point | None, default: Array) -> Array:
    """Return the point of all driven coordinates, as requested, inside the limits."""
    if requested is None:
        return default
    point: Array = default.copy()
    movable = [i for i, name in enumerate(coordinates) if position_limits(robot, name) is not None]
    if isinstance(requested, Mapping):
        places = {coordinates[i]: i for i in movable} | {joint_of(coordinates[i]): i for i in movable}
        for name, value in requested.items():
            if name not in places:
                known = ", ".join(coordinates[i] for i in movable)
                raise UnknownNameError(f"{label}: {name!r} is no principal coordinate; known: {known}")
            point[places[name]] = _number(f"{label}: {name}", value)
    else:
        try:
            values, size = list(requested) if np.ndim(requested) == 1 else [], str(np.size(requested))
        except (TypeError, ValueError):  # rows of different lengths
            values, size = [], show(requested)
        if len(values) != len(movable):
            names = ", ".join(coordinates[i] for i in movable)
            raise InputError(f"{label}: expected {len(movable)} numbers ({names}), got {size}")
        point[movable] = [_number(f"{label}: {coordinates[i]}", v) for i, v in zip(movable, values, strict=True)]
    for i in movable:
        low, high = principal_limits(robot, coordinates[i])
        if not low - 1e-9 <= point[i] <= high + 1e-9:
            unit = unit_of(coordinates[i])
            asked = size_question(coordinates[i], point[i])
            raise InputError(
                f"{label}: {coordinates[i]} = {point[i]:g} {unit}; its limits are {low:g} to {high:g} {unit}"
                f"{asked and f'; {asked}'}"
            )
    return point


def _number(label: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{label} = {show(value)} is not a number") from None
    if not np.isfinite(number):
        raise InputError(f"{label} = {number} is not finite")
    return number
