"""Ranges of inputs and parameters: defaults, and what the caller gives by name."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..codegen.kernels.signatures import shapes
from ..errors import InputError, UnknownNameError
from ..identifiers import check_kind
from ..names import component_name, joint_of, kind_of, parameter_name, show
from ..robot.mechanism import position_limits
from ..robot.model import Model
from ..robot.value import ANGULAR, MOTOR
from .intervals import Array, Interval

Range = tuple[float, float]
ANGLE = 3.0  # rad, either way, of a coordinate without limits
LENGTH = 1.0  # m
DEVIATION = 0.01  # rad or m: of a coordinate that is not principal, and of modes
VELOCITY = {"angle": 3.0, "length": 1.0, "deviation": 0.1}  # rad/s or m/s
ACCELERATION = 10.0  # rad/s^2 or m/s^2
FORCE = 100.0  # N or N m: of drives and of wrenches
OTHER = 1.0  # of all else that a kernel reads: internal states, rows of derivatives
USUAL = {"a": ACCELERATION, **dict.fromkeys(("u", "forces", "wrench", "multipliers"), FORCE)}
DEFLECTION = "deflection"  # of a gear: "deflection:joint2"
APART = ("v", "a", "u")  # arrays whose elements are named with a prefix: "v:joint2.gamma"


def usual_ranges(model: Model, reads: Sequence[str]) -> dict[str, list[Range]]:
    """Return ranges of the elements of arrays that a kernel reads, without those of parameters."""
    known = shapes(model)
    ranges = {array: [_about(USUAL.get(array, OTHER))] * math.prod(known[array]) for array in reads}
    for place, name in enumerate(model.coordinates):
        kind = _kind(model, name)
        if "q" in ranges:
            ranges["q"][place] = _position(model, name, kind)
        if "v" in ranges:
            ranges["v"][place] = _about(VELOCITY[kind] * _ratio(model, name))
        if "a" in ranges:
            ranges["a"][place] = _about(ACCELERATION * _ratio(model, name))
    return ranges


def _about(size: float) -> Range:
    return -size, size


def _kind(model: Model, name: str) -> str:
    """Return whether a coordinate is an "angle", a "length" or a "deviation"."""
    if name in model.robot.modal_coordinates:
        return "deviation"
    joint, kind = model.robot.joint(joint_of(name)), kind_of(name)
    if kind == MOTOR:
        return "angle"
    if joint.principal and kind != joint.principal:
        return "deviation"
    return "angle" if kind in ANGULAR else "length"


def _ratio(model: Model, name: str) -> float:
    """Return by how much faster a motor turns than its joint; 1 for other coordinates."""
    if name in model.robot.modal_coordinates or kind_of(name) != MOTOR:
        return 1.0
    motor = model.robot.joint(joint_of(name)).motor
    return 1.0 if motor is None else abs(motor.ratio)


def _position(model: Model, name: str, kind: str) -> Range:
    """Return the limits of a principal coordinate, or what is usual."""
    lower, upper = position_limits(model.robot, name) or (-math.inf, math.inf)
    least, most = _about({"angle": ANGLE, "length": LENGTH, "deviation": DEVIATION}[kind] * _ratio(model, name))
    return (lower if math.isfinite(lower) else min(least, upper)), (upper if math.isfinite(upper) else max(most, lower))


def chosen_ranges(
    model: Model, reads: Sequence[str], ranges: Mapping[str, Sequence[float]], dtype: str
) -> dict[str, list[Range]]:
    """Return ranges of all that a kernel and its parameters read: the caller's, else defaults.

    Args:
        model: the robot's model.
        reads: names of the arrays that the kernel reads, without those of parameters.
        ranges: as of ``rounding_bound``, checked; those of arrays that the kernel does not read are of other kernels.
        dtype: of the kernel's numbers; a parameter at its value is the nearest of them.

    """
    values = [float(np.dtype(dtype).type(value)) for value in model.parameters.values()]
    chosen = usual_ranges(model, reads)
    chosen["p"] = [(value, value) for value in (*values, *[0.0] * _turned(model))]
    places = _places(model)
    gears = deflections(model, ranges) if "q" in chosen else ()
    following = {("q", gear.motor) for gear in gears}  # motors, whose joints have ranges
    for gear in gears:
        ends = ranges.get(model.coordinates[gear.joint], ranges.get("q"))
        lower, upper = chosen["q"][gear.joint] if ends is None else _checked("q", ends)
        turned = gear.ratio * (lower - gear.most), gear.ratio * (upper + gear.most)
        chosen["q"][gear.motor] = min(turned), max(turned)
    for name, ends in ranges.items():
        pair = _checked(name, ends)
        array, place = places[name]
        if array in chosen and array != DEFLECTION:
            for k in range(len(chosen[array])) if place is None else (place,):
                if place is not None or (array, k) not in following:
                    chosen[array][k] = pair
    return chosen


@dataclass(frozen=True)
class Deflection:
    """A gear's deflection |motor / ratio - joint| <= most, of the coordinates at two places of q."""

    motor: int
    joint: int
    ratio: float
    most: float


def deflections(model: Model, ranges: Mapping[str, Sequence[float]]) -> tuple[Deflection, ...]:
    """Return how far gears are deflected: the caller's "deflection:joint2", else +-0.01 where the motor has no range.

    Where the caller gives a range of the motor, alone or with all of "q", or of the ratio, nothing is assumed.
    """
    places = {name: place for place, name in enumerate(model.coordinates)}
    found = []
    for joint in model.robot.joints:
        motor, name = component_name(joint.name, MOTOR), component_name(joint.name, joint.principal)
        if joint.motor is None or motor not in places or name not in places:
            continue
        given = ranges.get(f"{DEFLECTION}:{joint.name}")
        apart = parameter_name("joints", joint.name, MOTOR, "ratio") in ranges
        if apart or (given is None and (motor in ranges or "q" in ranges)):
            continue
        lower, upper = _checked(name, given) if given is not None else (-DEVIATION, DEVIATION)
        found.append(Deflection(places[motor], places[name], joint.motor.ratio, max(abs(lower), abs(upper))))
    return tuple(found)


def random_states(
    ranges: Mapping[str, Sequence[Range]], gears: Sequence[Deflection], count: int, dtype: str = "float64"
) -> dict[str, list[Array]]:
    """Draw inputs by array and element, (count,) each, even in their ranges, as numbers that ``dtype`` holds.

    A motor follows its joint within the gear's deflection; where its own range does not let it, there is no number.
    """
    rng = np.random.default_rng(0)
    drawn = {array: [rng.uniform(*ends, count) for ends in rows] for array, rows in ranges.items()}
    for gear in gears if "q" in drawn else ():
        room = max(map(abs, ranges["q"][gear.joint])) * 2.0**-22  # for what single precision rounds of both angles
        deflection = rng.uniform(-1.0, 1.0, count) * max(gear.most - room, 0.0)
        turned = gear.ratio * (drawn["q"][gear.joint] + deflection)
        lower, upper = ranges["q"][gear.motor]
        drawn["q"][gear.motor] = np.where((turned >= lower) & (turned <= upper), turned, np.nan)
    return {array: [row.astype(dtype).astype(np.float64) for row in rows] for array, rows in drawn.items()}


def check_ranges(model: Model, ranges: Mapping[str, Sequence[float]]) -> None:
    """Check names and ends of ranges.

    Raises:
        InputError: an unknown name, or ends that are no range.
    """
    check_kind("ranges", ranges, isinstance(ranges, Mapping), "a mapping from names to (least, largest)")
    places = _places(model)
    for name, ends in ranges.items():
        if name not in places:
            raise UnknownNameError(f"range of {show(name)}: no such input; known: {', '.join(places)}")
        _checked(name, ends)


def _turned(model: Model) -> int:
    """Count what parameters have behind them: how joints of three rotations are turned; as described here."""
    return len(model.turning)


def _places(model: Model) -> dict[str, tuple[str, int | None]]:
    """Return array and place of every name of a range; None for a whole array."""
    places: dict[str, tuple[str, int | None]] = {name: ("q", i) for i, name in enumerate(model.coordinates)}
    for array in APART:
        places |= {f"{array}:{name}": (array, i) for i, name in enumerate(model.coordinates)}
    places |= {f"z:{name}": ("z", i) for i, name in enumerate(model.internal_states)}
    places |= {f"forces:{model.coordinates[i]}": ("forces", k) for k, i in enumerate(model.drives)}
    places |= {name: ("p", i) for i, name in enumerate(model.parameters)}
    geared = [joint.name for joint in model.robot.joints if joint.motor is not None]
    places |= {f"{DEFLECTION}:{name}": (DEFLECTION, i) for i, name in enumerate(geared)}
    return places | {array: (array, None) for array in ("q", *APART, "z", "forces", "wrench") if array in shapes(model)}


def input_name(model: Model, array: str, place: int) -> str:
    """Name an element of an input array as ranges do, or by its place where these have no name for it."""
    known = {where: name for name, where in _places(model).items()}
    return known.get((array, place), f"{array}[{place}]")


def _checked(name: str, ends: Sequence[float]) -> Range:
    """Return the ends of a range as floats."""
    try:
        lower, upper = (float(end) for end in ends)
    except (TypeError, ValueError):
        raise InputError(f"range of {show(name)}: {show(ends)}, not two numbers, least and largest") from None
    if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
        raise InputError(f"range of {show(name)}: {lower} to {upper}, not finite numbers, the least first")
    return lower, upper


def as_intervals(ranges: Mapping[str, Sequence[Range]]) -> dict[str, list[Interval]]:
    """Return ranges as intervals of one box."""
    return {array: [(np.array([lower]), np.array([upper])) for lower, upper in rows] for array, rows in ranges.items()}


def shown_ranges(
    model: Model,
    ranges: Mapping[str, Sequence[Range]],
    read: Collection[tuple[str, int]],
    gears: Sequence[Deflection] = (),
) -> dict[str, Range]:
    """Return ranges of what is read, by the names of inputs; parameters at their values are left out."""
    shown = {}
    for array, place in sorted(read):
        lower, upper = ranges[array][place]
        if array != "p" or lower < upper:
            shown[input_name(model, array, place)] = (lower, upper)
    for gear in gears:
        if {("q", gear.motor), ("q", gear.joint)} <= set(read):
            shown[f"{DEFLECTION}:{joint_of(model.coordinates[gear.joint])}"] = (-gear.most, gear.most)
    return shown
