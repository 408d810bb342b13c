"""Interval of every value of a program over boxes of inputs, with a bound of the error that its rounding adds.

An interval holds the value as exact arithmetic has it, as it may be computed, and all between: the exact result of the
arguments' intervals, widened by the bound of the value's own rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ..codegen.program.ir import Program
from ..codegen.program.operations import ANGULAR, ROUNDED, TURNED
from . import intervals
from .intervals import ROOM, Array, Interval
from .ranges import Deflection


@dataclass(frozen=True)
class Precision:
    """Numbers of a precision: half a unit in the last place of 1, what underflow takes, and the largest number."""

    unit: float
    underflow: float
    largest: float


PRECISIONS: Mapping[str, Precision] = {
    "float64": Precision(2.0**-53, 2.0**-1074, float(np.finfo(np.float64).max)),
    "float32": Precision(2.0**-24, 2.0**-150, float(np.finfo(np.float32).max)),
}


@dataclass
class ProgramIntervals:
    """Intervals of the values of a program, one per instruction.

    Attributes:
        program: the program.
        dtype: of the numbers that C computes with.
        values: ends, (boxes,) each, of what the value may be.
        rounding: (boxes,), bounds of the error that each instruction itself adds; 0 for none.
        slopes: derivatives by each argument, of instructions that are no sums, products or signs.
        is_exact: whether a value is an input, or what signs make of inputs: it has the sign of the exact one.
        obstacles: per value the instruction that leaves it without a bound; -1 for none.
        reasons: of these instructions, why they have no bound.
    """

    program: Program
    dtype: str
    values: list[Interval] = field(default_factory=list)
    rounding: list[Array] = field(default_factory=list)
    slopes: dict[int, tuple[Interval, ...]] = field(default_factory=dict)
    is_exact: list[bool] = field(default_factory=list)
    obstacles: list[int] = field(default_factory=list)
    reasons: dict[int, str] = field(default_factory=dict)


def program_intervals(
    program: Program,
    dtype: str,
    inputs: Mapping[str, Sequence[Interval]],
    gears: Sequence[Deflection] = (),
    rounded: Mapping[str, Sequence[float]] = MappingProxyType({}),
) -> ProgramIntervals:
    """Return the intervals of all values of a program.

    Args:
        program: with what it reads of parameters in front (``programs.with_setup``).
        dtype: of the numbers that C computes with; the constants of C are of it, too.
        inputs: per array an interval per element.
        gears: how far motors are from their joints: a sum that is a deflection is no larger.
        rounded: per array how far its elements are from the numbers that the exact result is for; 0 if not named.
    """
    found = ProgramIntervals(program, dtype)
    boxes = np.shape(next((row[0][0] for row in inputs.values() if len(row)), np.zeros(1)))
    with np.errstate(all="ignore"):
        writer = _Writer(found, boxes, gears)
        for index, (op, args, leaf) in enumerate(program.instructions):
            if op == "input":
                off = rounded[leaf[0]][leaf[1]] if leaf[0] in rounded else 0.0
                writer.keep(inputs[leaf[0]][leaf[1]], np.full(boxes, off), exact=True)
            elif op == "const":
                writer.constant(leaf)
            else:
                writer.operation(index, op, args)
    return found


class _Writer:
    """Appends intervals, value by value."""

    def __init__(self, found: ProgramIntervals, boxes: tuple[int, ...], gears: Sequence[Deflection]) -> None:
        self.gears = {(gear.motor, gear.joint): gear for gear in gears}
        self.found, self.boxes, self.operations = found, boxes, found.program.operations
        self.precision = PRECISIONS[found.dtype]
        self.zero = np.zeros(boxes)
        self.everything: Interval = (np.full(boxes, -np.inf), np.full(boxes, np.inf))

    def keep(self, value: Interval, rounding: Array, *, exact: bool = False, obstacle: int = -1) -> None:
        """Append a value, widened by its own rounding."""
        self.found.values.append(intervals.widened(value, rounding) if rounding.any() else value)
        self.found.rounding.append(rounding)
        self.found.is_exact.append(exact)
        self.found.obstacles.append(obstacle)

    def constant(self, number: float) -> None:
        """Append a constant, which C has as a number of the dtype."""
        held = float(np.dtype(self.found.dtype).type(number))
        error = math.nextafter(abs(held - number), math.inf) if held != number else 0.0
        value = np.full(self.boxes, number)
        self.keep((value, value), np.full(self.boxes, error), exact=held == number)

    def operation(self, index: int, op: str, args: tuple[int, ...]) -> None:
        """Append the result of an operation, or say why it has no bound."""
        found = self.found
        before = next((found.obstacles[arg] for arg in args if found.obstacles[arg] >= 0), -1)
        if before >= 0:
            self.keep(self.everything, self.zero, obstacle=before)
            return
        values = [found.values[arg] for arg in args]
        exact = all(found.is_exact[arg] for arg in args)
        reason = self._obstacle(op, args)
        if not reason:
            value, slopes = self._result(op, args)
            if not (intervals.magnitude(value) <= self.precision.largest).all():
                reason = f"{op} of {' and '.join(map(_range, values))} may be no number of {found.dtype}"
        if reason:
            found.reasons[index] = reason
            self.keep(self.everything, self.zero, obstacle=index)
            return
        if slopes:
            found.slopes[index] = slopes
        if self.operations[op].error == 0.0:
            self.keep(value, self.zero, exact=exact or self._is_decided(args, value, slopes))
        elif (known := self._with_zero(op, args)) is not None:
            self.keep(known[0], self.zero, exact=known[1])
        else:
            self.keep(value, self._rounding(op, args, value))

    def _rounding(self, op: str, args: tuple[int, ...], value: Interval) -> Array:
        """Bound what the operation rounds its exact result by."""
        size, unit, least = intervals.magnitude(value), self.precision.unit, self.precision.underflow
        error = self.operations[op].error
        if op in ANGULAR:  # results are less than 1 in magnitude, or 1 exactly
            exponent = np.minimum(np.frexp(size)[1], 0)
            return np.ldexp(error * unit, exponent) + least
        if error > ROUNDED:
            return size * (2.0 * error * unit * ROOM) + least
        if op == "mul" and any(self._is_power_of_two(arg) for arg in args):
            return np.full(self.boxes, least)
        return size * unit + least

    def _is_decided(self, args: tuple[int, ...], value: Interval, slopes: Sequence[Interval]) -> bool:
        """Whether an operation on signs gives the same number or the same exact argument everywhere."""
        taken = [arg for arg, (lower, _) in zip(args, slopes, strict=False) if lower[0] != 0.0]
        fixed = slopes if taken else (value,)
        same = all((lower == upper).all() and (lower == lower[0]).all() for lower, upper in fixed)
        return same and all(self.found.is_exact[arg] for arg in taken)

    def _with_zero(self, op: str, args: tuple[int, ...]) -> tuple[Interval, bool] | None:
        """Return what an operation with an exact 0 makes of its other argument, and whether that is exact; or None."""
        values, is_exact = self.found.values, self.found.is_exact
        zeros = [is_exact[arg] and not values[arg][0].any() and not values[arg][1].any() for arg in args]
        if op in ("mul", "div") and (zeros[0] or (op == "mul" and zeros[1])):
            return (self.zero, self.zero), True
        if op in ("add", "sub") and any(zeros):
            other = args[1] if zeros[0] else args[0]
            turned = op == "sub" and zeros[0]
            return (intervals.neg(values[other]) if turned else values[other]), is_exact[other]
        return None

    def _is_power_of_two(self, index: int) -> bool:
        """Whether a factor is a power of two, a constant or a parameter at its value."""
        lower, upper = self.found.values[index]
        if not self.found.is_exact[index] or not (lower == upper).all():
            return False
        return bool((np.abs(np.frexp(lower)[0]) == 0.5).all())

    def _obstacle(self, op: str, args: tuple[int, ...]) -> str:
        """Say why an operation has no bound over its arguments; nothing where it has one."""
        operation, values = self.operations[op], [self.found.values[arg] for arg in args]
        if operation.barrier is None or (operation.by_sign and self.found.is_exact[args[0]]):
            return ""
        text, is_beyond = operation.barrier
        return text.format(*map(_range, values), op=op) if is_beyond(*values).any() else ""

    def _result(self, op: str, args: tuple[int, ...]) -> tuple[Interval, tuple[Interval, ...]]:
        """Return an interval and slopes; a rotated pair, c x + s y, is no longer than (x, y)."""
        values, rule = [self.found.values[arg] for arg in args], self.operations[op].interval
        assert rule is not None, op
        value, slopes = rule(intervals, *values)
        if op == "mul" and args[0] == args[1]:
            value = intervals.square(values[0])
        if op in ("add", "sub"):
            pair = _rotated_pair(self.found.program, args)
            if pair is not None:
                sizes = [intervals.magnitude(self.found.values[x]) for x in pair]
                length = (np.hypot(*sizes) + intervals.TINY) * circle(self.precision.unit)
                length = (length + self.found.rounding[args[0]] + self.found.rounding[args[1]]) * ROOM
                value = intervals.common(value, (-length, length))
            deflection = self._deflection(op, args)
            if deflection is not None:
                value = intervals.common(value, (-deflection, deflection))
        return value, slopes

    def _deflection(self, op: str, args: tuple[int, ...]) -> Array | None:
        """Bound joint + c motor, or their difference, which is the deflection but for c + 1 / ratio; None of others."""
        instructions, values = self.found.program.instructions, self.found.values
        for first, second in (args, args[::-1]) if self.gears else ():
            product, joint = instructions[first], instructions[second]
            if product.op != "mul" or joint.op != "input" or joint.leaf[0] != "q":
                continue
            for factor, turned in (product.args, product.args[::-1]):
                motor = instructions[turned]
                gear = self.gears.get((motor.leaf[1], joint.leaf[1])) if motor.op == "input" else None
                if gear is None or motor.leaf[0] != "q":
                    continue
                inverse = np.full(self.boxes, 1.0 / gear.ratio)
                near = intervals.widened((inverse, inverse), np.abs(inverse) * 2.0**-52)
                off = (intervals.add if op == "add" else intervals.sub)(values[factor], near)
                size = intervals.magnitude(off) * intervals.magnitude(values[turned])
                return (gear.most * ROOM + size * ROOM + self.found.rounding[first]) * ROOM + intervals.TINY
        return None


def circle(unit: float) -> float:
    """Bound the length of (c, s), a computed cosine and sine: each is off by TURNED units in the last place of 1."""
    return (1.0 + 4.0 * TURNED * unit) * ROOM


def _rotated_pair(program: Program, products: Sequence[int]) -> tuple[int, int] | None:
    """Return x and y of two products s x and c y with the sine and cosine of one angle; None of others."""
    turned: dict[str, tuple[int, int]] = {}
    for product in products:
        op, factors, _ = program.instructions[product]
        angular = [x for x in factors if program.instructions[x].op in ANGULAR] if op == "mul" else []
        if len(angular) != 1:
            return None
        function, (angle,), _ = program.instructions[angular[0]]
        turned[function] = angle, factors[1] if factors[0] == angular[0] else factors[0]
    if len(turned) != 2 or turned["sin"][0] != turned["cos"][0]:
        return None
    return turned["sin"][1], turned["cos"][1]


def _range(x: Interval) -> str:
    return f"[{x[0].min():.6g}, {x[1].max():.6g}]"
