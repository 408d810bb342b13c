"""Bounds of the rounding errors of outputs: adjoints over enclosures times what each instruction rounds by.

The computed value of an instruction is v_i = op_i(arguments) + r_i.  Along v_i(t) = op_i(arguments(t)) + t r_i, from
exact values at t = 0 to computed ones at t = 1, the error of an output is the integral of sum_i adj_i(t) r_i, and all
v_i(t) stay in their enclosures.  So |error| <= sum_i max |adj_i| |r_i| over these is a proof without a remainder.

Where products may be fused with sums, a product is rounded for some of its uses and not for others: its adjoint is
then a sum over any choice of the uses that can be fused.

Adjoints are (middle, radius), arrays (outputs, boxes): a product of two such has the product of their magnitudes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .enclosures import PRECISIONS, Enclosures, circle
from .intervals import LEAST, ROOM, TINY, Array, Interval

_ROUNDED = 2.0**-51  # of a middle: more than its product or sum was rounded by
GROUP = 64  # outputs at once


class _Ball(NamedTuple):
    middle: Array
    radius: Array

    @property
    def magnitude(self) -> Array:
        """Largest magnitude."""
        return (np.abs(self.middle) + self.radius) * ROOM


class _Use(NamedTuple):
    """A share of an adjoint: what one use of a value adds to it.

    turn: function and angle, where the use is a product with a sine or cosine; ``outer`` is then the product's adjoint.
    is_sum: whether it is a summand, which a product may be fused into.
    """

    share: _Ball
    turn: tuple[str, int] | None = None
    outer: _Ball | None = None
    is_sum: bool = False


@dataclass(frozen=True)
class Bounds:
    """Bounds of errors of some outputs, the largest over the boxes.

    Attributes:
        plain, fused: (outputs,), each operation rounded, and products fused with sums wherever a compiler likes to.
        worst: (outputs,), the instruction that contributes most to each.
        share: (outputs,), how much of ``plain`` that is.
        each: (boxes, outputs), ``plain`` per box.
    """

    plain: Array
    fused: Array
    worst: Sequence[int]
    share: Array
    each: Array


def bound_outputs(found: Enclosures, outputs: Sequence[int]) -> Bounds:
    """Bound the errors of outputs, by the indices of their values; none of them has an obstacle."""
    groups = [_bound_group(found, outputs[i : i + GROUP]) for i in range(0, len(outputs), GROUP)]
    return Bounds(
        np.concatenate([group.plain for group in groups]),
        np.concatenate([group.fused for group in groups]),
        [index for group in groups for index in group.worst],
        np.concatenate([group.share for group in groups]),
        np.concatenate([group.each for group in groups], axis=1),
    )


def contributions(found: Enclosures, outputs: Sequence[int]) -> Array:
    """Return what each instruction adds to the bounds of outputs, (instructions, outputs), the largest over the boxes.

    Outputs are indices of values, none of which has an obstacle; a column adds up to its output's bound or more.
    """
    kept = np.zeros((len(found.program.instructions), len(outputs)))
    for first in range(0, len(outputs), GROUP):
        _bound_group(found, outputs[first : first + GROUP], kept[:, first : first + GROUP])
    return kept


def _bound_group(found: Enclosures, outputs: Sequence[int], kept: Array | None = None) -> Bounds:
    """Go once backwards through the program; ``kept`` takes what each instruction adds, (instructions, outputs)."""
    instructions = found.program.instructions
    boxes = found.rounding[0].shape
    shape = (len(outputs), *boxes)
    uses: list[list[_Use]] = [[] for _ in instructions]
    for row, index in enumerate(outputs):
        seed = np.zeros(shape)
        seed[row] = 1.0
        uses[index].append(_Use(_Ball(seed, np.zeros(shape))))
    plain, fused, largest = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    worst = np.full(shape, -1)
    backward = _Backward(found, uses)
    count = 0
    for index in range(len(instructions) - 1, -1, -1):
        here, uses[index] = uses[index], []
        rounding = found.rounding[index]
        rounds = bool(rounding.any())
        if not here or not (rounds or instructions[index].args):
            continue
        adjoint = backward.total(here)
        if rounds:
            count += 1
            size = adjoint.magnitude
            error = size * rounding + LEAST * (size > 0.0)
            plain += error
            if kept is not None:
                kept[index] = error.max(axis=1)
            loose = _loose(here) if instructions[index].op == "mul" and len(here) > 1 else None
            fused += error if loose is None else np.maximum(loose * rounding + LEAST * (loose > 0.0), error)
            greater = error > largest
            worst[greater] = index
            np.maximum(error, largest, out=largest)
        backward.spread(index, adjoint, here)
    up = (1.0 + (count + 4.0) * 2.0**-52) * ROOM
    plain, fused = plain * up, fused * up
    at = plain.argmax(axis=1)
    rows = np.arange(len(outputs))
    of_worst = largest[rows, at] / np.where(plain[rows, at] > 0.0, plain[rows, at], 1.0)
    return Bounds(plain.max(axis=1), fused.max(axis=1), [int(x) for x in worst[rows, at]], of_worst, plain.T)


class _Backward:
    """Adds up adjoints of values and hands them on to arguments."""

    def __init__(self, found: Enclosures, uses: list[list[_Use]]) -> None:
        self.found, self.uses = found, uses
        self.instructions = found.program.instructions
        self.circle = circle(PRECISIONS[found.dtype].unit)
        self.balls: dict[int, _Ball] = {}

    def total(self, uses: Sequence[_Use]) -> _Ball:
        """Add what uses bring; pairs c x + s y by sine and cosine of one angle are no longer than (x, y)."""
        by_angle: dict[int, list[_Use]] = {}
        parts: list[_Ball] = []
        for use in uses:
            if use.turn is None:
                parts.append(use.share)
            else:
                by_angle.setdefault(use.turn[1], []).append(use)
        for turned in by_angle.values():
            sines = [use.outer for use in turned if use.turn and use.turn[0] == "sin" and use.outer]
            cosines = [use.outer for use in turned if use.turn and use.turn[0] == "cos" and use.outer]
            share = _sum([use.share for use in turned])
            if sines and cosines:
                length = (np.hypot(_sum(sines).magnitude, _sum(cosines).magnitude) + TINY) * self.circle
                share = _clipped(share, length)
            parts.append(share)
        return _sum(parts)

    def spread(self, index: int, adjoint: _Ball, here: Sequence[_Use]) -> None:
        """Hand the adjoint of a value on to its arguments."""
        op, args, _ = self.instructions[index]
        if op == "neg":  # a sign is no operation of its own for what is fused
            self.uses[args[0]].extend(_turned_round(use) for use in here)
        elif op in ("add", "sub"):
            self.uses[args[0]].append(_Use(adjoint, is_sum=True))
            second = adjoint if op == "add" else _Ball(-adjoint.middle, adjoint.radius)
            self.uses[args[1]].append(_Use(second, is_sum=True))
        elif op == "mul":
            for arg, other in (args, args[::-1]):
                by, angle, _ = self.instructions[other]
                turn = (by, angle[0]) if by in ("sin", "cos") else None
                self.uses[arg].append(_Use(_product(adjoint, self._ball(other)), turn, adjoint))
        elif op in ("sin", "cos"):
            (slope,) = self.found.slopes[index]
            turn = ("cos" if op == "sin" else "sin", args[0])
            outer = adjoint if op == "sin" else _Ball(-adjoint.middle, adjoint.radius)
            self.uses[args[0]].append(_Use(_product(adjoint, _ball(slope)), turn, outer))
        else:
            for arg, slope in zip(args, self.found.slopes.get(index, ()), strict=False):
                self.uses[arg].append(_Use(_product(adjoint, _ball(slope))))

    def _ball(self, index: int) -> _Ball:
        if index not in self.balls:
            self.balls[index] = _ball(self.found.values[index])
        return self.balls[index]


def _ball(x: Interval) -> _Ball:
    middle = 0.5 * (x[0] + x[1])
    radius = np.maximum(np.nextafter(x[1] - middle, np.inf), np.nextafter(middle - x[0], np.inf))
    return _Ball(middle, np.where(x[0] == x[1], 0.0, radius))


def _product(x: _Ball, y: _Ball) -> _Ball:
    middle = x.middle * y.middle
    size = np.abs(x.middle)
    radius = size * y.radius + x.radius * (np.abs(y.middle) + y.radius)
    return _Ball(middle, radius * ROOM + (np.abs(middle) * _ROUNDED + TINY * ((size > 0.0) | (x.radius > 0.0))))


def _sum(parts: Sequence[_Ball]) -> _Ball:
    if len(parts) == 1:
        return parts[0]
    middle, radius, size = parts[0].middle, parts[0].radius, np.abs(parts[0].middle)
    for part in parts[1:]:
        middle = middle + part.middle
        radius = radius + part.radius
        size = size + np.abs(part.middle)
    return _Ball(middle, (radius + size * (len(parts) * _ROUNDED)) * (1.0 + len(parts) * _ROUNDED))


def _clipped(x: _Ball, length: Array) -> _Ball:
    """Return the part of a ball between -length and length."""
    lower = np.maximum(np.nextafter(x.middle - x.radius, -np.inf), -length)
    upper = np.minimum(np.nextafter(x.middle + x.radius, np.inf), length)
    narrower = upper - lower < 2.0 * x.radius
    cut = _ball((lower, upper))
    return _Ball(np.where(narrower, cut.middle, x.middle), np.where(narrower, cut.radius, x.radius))


def _turned_round(use: _Use) -> _Use:
    share = _Ball(-use.share.middle, use.share.radius)
    outer = None if use.outer is None else _Ball(-use.outer.middle, use.outer.radius)
    return _Use(share, use.turn, outer, use.is_sum)


def _loose(uses: Sequence[_Use]) -> Array | None:
    """Bound the sum of the uses of a product over any choice of those that are no sums; None where all are fixed."""
    if not any(use.is_sum for use in uses):
        return None
    lower = upper = np.zeros_like(uses[0].share.middle)
    for use in uses:
        low = (use.share.middle - use.share.radius) - np.abs(use.share.middle) * _ROUNDED
        high = (use.share.middle + use.share.radius) + np.abs(use.share.middle) * _ROUNDED
        lower = lower + (np.minimum(low, 0.0) if use.is_sum else low)
        upper = upper + (np.maximum(high, 0.0) if use.is_sum else high)
    return np.maximum(np.maximum(-lower, upper), 0.0) * (1.0 + len(uses) * _ROUNDED)
