"""Limits of a motion, read from a description and from arguments: positions, rates, accelerations, drives, places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...errors import ArrayError, InputError, UnknownNameError
from ...limits import LARGEST, SMALLEST, is_usable
from ...motion.ends import principal_limits
from ...names import joint_of, listed, nearest_or_all, show
from ...robot.coordinates import unit_of
from ...robot.mechanism import leading_home
from ...robot.value import Robot

Amounts = float | Mapping[str, float]

TRAVEL = {"rad": np.pi, "m": 0.5}  # on either side of home, where nothing is said
RATES = {"rad": 1.0, "m": 0.2}  # per s, where nothing is said


@dataclass(frozen=True, eq=False)
class Region:
    """Region for the origin of a frame: n . p from ``low`` on for every normal, or so far from a point.

    Attributes:
        frame: its name.
        text: what it is called, such as "tcp half space".
        normals: unit vectors, (k, 3); None of a distance.
        low: (k,), m.
        point: (3,), m, where the distance is from; None of normals.
    """

    frame: str
    text: str
    low: Array
    normals: Array | None = None
    point: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its numbers."""
        if self.normals is None or len(self.low) == 1:
            return (self.text,)
        return tuple(f"{self.text} {side}{axis}" for side in "+-" for axis in "xyz")


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the coordinates that move, (m,) each, infinite where there is none.

    Attributes:
        names: of the coordinates.
        low, high: m or rad.
        rates, accelerations: per s and s^2.
        drives: N or N m.
        regions: where frames have to be.
        notes: what was assumed.
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    rates: Array
    accelerations: Array
    drives: Array
    regions: tuple[Region, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class RequestedLimits:
    """Limits that ``excite`` is asked to keep; its arguments say what each of them is."""

    ranges: Mapping[str, Sequence[float]] | None = None
    rates: Amounts | None = None
    accelerations: Amounts | None = None
    drives: Amounts | None = None
    boxes: Mapping[str, ArrayLike] | None = None
    half_spaces: Sequence[tuple[str, ArrayLike, float]] = ()
    clear_of: Sequence[tuple[str, ArrayLike, float]] = ()


def limits_of(robot: Robot, names: tuple[str, ...], frames: Sequence[str], requested: RequestedLimits) -> Limits:
    """Return the limits of coordinates and frames, from a description and from what is requested.

    Raises:
        InputError: a limit allows nothing, or is no number.
        UnknownNameError: there is no coordinate or frame of a name.
    """
    for label, entry in (("ranges", requested.ranges), ("boxes", requested.boxes)):
        if entry is not None and not isinstance(entry, Mapping):
            raise InputError(f"{label}: {show(entry)}; allowed: a table by names")
    notes: list[str] = []
    low, high = _ranges(robot, names, requested.ranges or {}, notes)
    described = [robot.rigid().limits_of(name) for name in names]
    fastest = _within(amounts("rates", requested.rates, names), [limits.velocity for limits in described])
    strongest = _within(amounts("drives", requested.drives, names), [limits.effort for limits in described])
    for unit, usual in RATES.items():
        unknown = [i for i, name in enumerate(names) if np.isinf(fastest[i]) and unit_of(name) == unit]
        fastest[unknown] = usual
        if unknown:
            notes.append(f"rates of {these(names, unknown)} without a limit: {usual:g} {unit}/s is assumed")
    if requested.accelerations is None and np.isinf(strongest).all():
        notes.append("no limits of accelerations and drives: harmonics and rates alone hold them")
    regions = [_box(frame, box) for frame, box in (requested.boxes or {}).items()]
    regions += [_half_space(*entry) for entry in _triples("half_spaces", requested.half_spaces)]
    regions += [_distance(*entry) for entry in _triples("clear_of", requested.clear_of)]
    for region in regions:
        if region.frame not in frames:
            raise UnknownNameError(
                f"{region.text}: there is no frame or link {region.frame!r}{nearest_or_all(region.frame, frames)}"
            )
    return Limits(
        names,
        low,
        high,
        fastest,
        amounts("accelerations", requested.accelerations, names),
        strongest,
        tuple(regions),
        tuple(notes),
    )


def amounts(label: str, requested: Amounts | None, names: tuple[str, ...]) -> Array:
    """Return positive numbers of coordinates, (m,): one for all, or by the name of coordinate or joint.

    Infinite elsewhere.

    Raises:
        InputError: a number is not positive and finite.
        UnknownNameError: there is no coordinate of a name.
    """
    if requested is None:
        return np.full(len(names), np.inf)
    if not isinstance(requested, Mapping):
        return np.full(len(names), _positive(label, requested))
    limits = np.full(len(names), np.inf)
    for name, value in requested.items():
        limits[_place(label, name, names)] = _positive(f"{label}: {name}", value)
    return limits


def _within(requested: Array, limits: Sequence[float | None]) -> Array:
    """Return requested amounts, and those of the description elsewhere, (m,)."""
    described = np.array([np.inf if value is None else value for value in limits], dtype=np.float64)
    return np.where(np.isinf(requested), described, requested)


def these(names: Sequence[str], places: Sequence[int]) -> str:
    """Return coordinates at some places, for notes."""
    return "all coordinates" if len(places) == len(names) else listed(names[i] for i in places)


def _ranges(
    robot: Robot, names: tuple[str, ...], requested: Mapping[str, Sequence[float]], notes: list[str]
) -> tuple[Array, Array]:
    """Return ends of all coordinates, requested ones or limits; what is assumed is noted."""
    ends = np.array([principal_limits(robot, name) for name in names], dtype=np.float64)
    for name, values in requested.items():
        ends[_place("ranges", name, names)] = _array(f"ranges: {name}", values, (2,))
    for i, name in enumerate(names):
        is_open = ~np.isfinite(ends[i])
        if is_open.any():
            unit, other = unit_of(name), ends[i][::-1]
            half = TRAVEL[unit] * np.array([-1.0, 1.0])
            free = leading_home(robot).get(name, 0.0) + half if is_open.all() else other + 2.0 * half
            ends[i] = np.where(is_open, free, ends[i])
            notes.append(f"{name} has no limits: {ends[i][0]:.4g} to {ends[i][1]:.4g} {unit} is assumed")
        if not ends[i][0] < ends[i][1]:
            raise InputError(
                f"ranges: {name}: {ends[i][0]:g} to {ends[i][1]:g} leaves no room; allowed: a lower end below the upper"
                " one"
            )
    return ends[:, 0], ends[:, 1]


def _box(frame: str, corners: ArrayLike) -> Region:
    corners = _array(f"boxes: {frame}", corners, (2, 3))
    if not (corners[0] < corners[1]).all():
        raise InputError(
            f"boxes: {frame}: {show(corners.tolist())}; allowed: the lower corner, then the upper one, (2, 3)"
        )
    normals = np.vstack([np.eye(3), -np.eye(3)])
    return Region(frame, f"{frame} box", np.concatenate([corners[0], -corners[1]]), normals)


def _half_space(frame: str, normal: Any, distance: Any) -> Region:
    direction = _array(f"half_spaces: {frame}", normal, (3,))
    size = float(np.linalg.norm(direction))
    if not size > 0.0:
        raise InputError(f"half_spaces: {frame}: normal {show(direction.tolist())}; allowed: a direction, not zero")
    low = _array(f"half_spaces: {frame}: distance", distance, ())
    return Region(frame, f"{frame} half space", np.array([low]), direction[np.newaxis] / size)


def _distance(frame: str, point: Any, radius: Any) -> Region:
    place = _array(f"clear_of: {frame}", point, (3,))
    low = _positive(f"clear_of: {frame}: distance", radius)
    return Region(frame, f"{frame} distance", np.array([low]), None, place)


def _triples(label: str, entries: Sequence[Any]) -> list[tuple[Any, Any, Any]]:
    rows: list[Any] = list(entries) if isinstance(entries, (list, tuple)) else [entries]
    for row in rows:
        if not isinstance(row, (list, tuple)) or len(row) != 3 or not isinstance(row[0], str):
            raise InputError(f"{label}: {show(row)}; allowed: rows of a frame, a vector (3,) and a number")
    return rows


def _place(label: str, name: str, names: tuple[str, ...]) -> int:
    """Place of a coordinate by its name or its joint's."""
    if name in names:
        return names.index(name)
    owners = [joint_of(component) for component in names]
    if name in owners:
        return owners.index(name)
    raise UnknownNameError(f"{label}: no coordinate that moves is called {name!r}{nearest_or_all(name, names)}")


def _positive(label: str, number: Any) -> float:
    value = float(_array(label, number, ()))
    if not (is_usable(value) and value > 0.0):
        raise InputError(f"{label}: {value:g}; allowed: a number above 0, from {SMALLEST:g} to {LARGEST:g}")
    return value


def _array(label: str, numbers: Any, shape: tuple[int, ...]) -> Array:
    try:
        values = np.array(numbers, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.full(1, np.nan)
    if isinstance(numbers, (str, bytes, bool)):  # NumPy makes numbers of these
        values = np.full(1, np.nan)
    if values.shape != shape or not (np.abs(values) <= LARGEST).all():
        what = f"finite numbers of shape {shape}" if shape else "a finite number"
        raise ArrayError(f"{label}: {show(str(numbers))}; allowed: {what}")
    return values
