"""Bounds of the rounding errors of outputs: interval adjoints times the rounding of each instruction.

The computed value of an instruction is v_i = op_i(arguments) + r_i.  Along v_i(t) = op_i(arguments(t)) + t r_i, from
exact values at t = 0 to computed ones at t = 1, the error of an output is the integral of sum_i adj_i(t) r_i, and all
v_i(t) stay in their intervals.  So |error| <= sum_i max |adj_i| |r_i| over the intervals, without a remainder.

Where products may be fused with sums, a product is rounded for some of its uses and not for others: its adjoint is
then a sum over any choice of the uses that can be fused.

Adjoints are intervals whose ends are arrays (outputs, boxes).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..codegen.program.operations import ANGULAR
from . import intervals
from .intervals import LEAST, ROOM, TINY, Array, Interval
from .values import PRECISIONS, ProgramIntervals, circle

GROUP = 64  # outputs at once


class _Use(NamedTuple):
    """Share of an adjoint: what one use of a value adds to it.

    turn: function and angle, where the use is a product with a sine or cosine; ``outer`` is then the product's adjoint.
    is_sum: whether it is a summand, which a product may be fused into.
    """

    share: Interval
    turn: tuple[str, int] | None = None
    outer: Interval | None = None
    is_sum: bool = False

    def negated(self) -> _Use:
        """Return the use of the negative value."""
        outer = None if self.outer is None else intervals.neg(self.outer)
        return self._replace(share=intervals.neg(self.share), outer=outer)


@dataclass(frozen=True)
class Bounds:
    """Bounds of the errors of some outputs, the largest over the boxes.

    Attributes:
        plain, fused: (outputs,), each operation rounded, and products fused with sums wherever a compiler may.
        worst: the instruction that contributes most to each; -1 where none rounds.
        share: (outputs,), its part in ``plain``.
    """

    plain: Array
    fused: Array
    worst: Sequence[int]
    share: Array


def bound_outputs(found: ProgramIntervals, outputs: Sequence[int]) -> Bounds:
    """Bound the errors of outputs, given as indices of values; none of them has an obstacle."""
    groups = [_bound_group(found, outputs[i : i + GROUP]) for i in range(0, len(outputs), GROUP)]
    plain, fused, share = (np.concatenate([getattr(x, name) for x in groups]) for name in ("plain", "fused", "share"))
    return Bounds(plain, fused, [index for group in groups for index in group.worst], share)


def contributions(found: ProgramIntervals, output: int) -> Array:
    """Return what each instruction adds to the bound of an output, (instructions, boxes)."""
    each = np.zeros((len(found.program.instructions), *found.rounding[0].shape))
    _bound_group(found, (output,), each)
    return each


def _bound_group(found: ProgramIntervals, outputs: Sequence[int], each: Array | None = None) -> Bounds:
    """Go once backwards through the program; ``each`` takes what instructions add to the first output."""
    instructions, shape = found.program.instructions, (len(outputs), *found.rounding[0].shape)
    backward = _Backward(found)
    for row, index in enumerate(outputs):
        seed = np.zeros(shape)
        seed[row] = 1.0
        backward.uses[index].append(_Use((seed, seed)))
    plain, fused, largest = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    worst = np.full(shape, -1)
    for index in range(len(instructions) - 1, -1, -1):
        here, backward.uses[index] = backward.uses[index], []
        rounding = found.rounding[index]
        if not here or not (instructions[index].args or rounding.any()):
            continue
        adjoint = backward.total(here)
        if rounding.any():
            size = intervals.magnitude(adjoint)
            error = size * rounding + LEAST * (size > 0.0)
            plain += error
            if each is not None:
                each[index] = error[0]
            if instructions[index].op == "mul" and len(here) > 1 and any(use.is_sum for use in here):
                size = np.maximum(_any_choice(here), size)
            fused += size * rounding + LEAST * (size > 0.0)
            worst[error > largest] = index
            np.maximum(error, largest, out=largest)
        backward.spread(index, adjoint, here)
    up = (1.0 + (len(instructions) + 4.0) * 2.0**-52) * ROOM  # more than rounding takes from these sums
    at, rows = plain.argmax(axis=1), np.arange(len(outputs))
    share = largest[rows, at] / np.where(plain[rows, at] > 0.0, plain[rows, at], 1.0)
    return Bounds(plain.max(axis=1) * up, fused.max(axis=1) * up, [int(x) for x in worst[rows, at]], share)


class _Backward:
    """Adds up adjoints of values and hands them on to arguments."""

    def __init__(self, found: ProgramIntervals) -> None:
        self.found = found
        self.instructions = found.program.instructions
        self.uses: list[list[_Use]] = [[] for _ in self.instructions]
        self.circle = circle(PRECISIONS[found.dtype].unit)

    def total(self, uses: Sequence[_Use]) -> Interval:
        """Add what uses bring; pairs c x + s y by sine and cosine of one angle are no longer than (x, y)."""
        parts = [use.share for use in uses if use.turn is None]
        for angle in dict.fromkeys(use.turn[1] for use in uses if use.turn is not None):
            turned = [use for use in uses if use.turn is not None and use.turn[1] == angle]
            share = _sum([use.share for use in turned])
            outer = {
                op: [use.outer for use in turned if use.turn == (op, angle) and use.outer is not None] for op in ANGULAR
            }
            if all(outer.values()):
                sizes = [intervals.magnitude(_sum(of_function)) for of_function in outer.values()]
                length = (np.hypot(*sizes) + TINY * (sizes[0] + sizes[1] > 0.0)) * self.circle
                share = intervals.common(share, (-length, length))
            parts.append(share)
        return _sum(parts)

    def spread(self, index: int, adjoint: Interval, here: Sequence[_Use]) -> None:
        """Hand the adjoint of a value on to its arguments."""
        op, args, _ = self.instructions[index]
        if op == "neg":  # a sign is no operation of its own for what is fused
            self.uses[args[0]].extend(use.negated() for use in here)
        elif signs := self.found.program.operations[op].signs:
            for arg, sign in zip(args, signs, strict=True):
                self.uses[arg].append(_Use(adjoint if sign > 0 else intervals.neg(adjoint), is_sum=True))
        elif op == "mul":
            for arg, other in (args, args[::-1]):
                by, angle, _ = self.instructions[other]
                turn = (by, angle[0]) if by in ANGULAR else None
                self.uses[arg].append(_Use(_scaled(adjoint, self.found.values[other]), turn, adjoint))
        elif op in ANGULAR:
            (slope,) = self.found.slopes[index]
            turn = ("cos" if op == "sin" else "sin", args[0])
            outer = adjoint if op == "sin" else intervals.neg(adjoint)
            self.uses[args[0]].append(_Use(_scaled(adjoint, slope), turn, outer))
        else:
            for arg, slope in zip(args, self.found.slopes.get(index, ()), strict=False):
                self.uses[arg].append(_Use(_scaled(adjoint, slope)))


def _scaled(adjoint: Interval, slope: Interval) -> Interval:
    """Return an adjoint times a slope; outputs that do not depend on the value keep their zeros."""
    lower, upper = intervals.mul(adjoint, slope)
    none = (adjoint[0] == 0.0) & (adjoint[1] == 0.0)
    return np.where(none, 0.0, lower), np.where(none, 0.0, upper)


def _sum(parts: Sequence[Interval]) -> Interval:
    total = parts[0]
    for part in parts[1:]:
        total = intervals.add(total, part)
    return total


def _any_choice(uses: Sequence[_Use]) -> Array:
    """Bound the sum of the uses of a product over any choice of those that are summands."""
    ends = [(np.minimum(low, 0.0), np.maximum(high, 0.0)) if s else (low, high) for (low, high), _, _, s in uses]
    return intervals.magnitude(_sum(ends))
