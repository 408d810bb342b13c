"""Plane rotations in finished programs: pairs c x + s y and c y - s x of the same two values by the same angle."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from .ir import Program, users
from .operations import ANGULAR
from .passes import summands


@dataclass(frozen=True)
class Rotation:
    """Two values x and y turned by an angle: c x + sense s y and c y - sense s x.

    Attributes:
        angle, x, y: indices of the values.
        sense: 1 or -1.
    """

    angle: int
    x: int
    y: int
    sense: int


class Turned(NamedTuple):
    """Product of a sine or cosine with x of a rotation, or with y where ``is_second``."""

    rotation: Rotation
    is_second: bool


class _Term(NamedTuple):
    """Signed product of a sine or cosine with a value, one summand of a sum."""

    sign: int
    product: int
    angle: int
    op: str
    value: int


def find_rotations(program: Program) -> Mapping[int, Turned]:
    """Return, by their indices, the products that are one of the four of a plane rotation.

    Products that more than one sum uses are left alone.
    """
    rows = _rows(program)
    places = defaultdict[tuple[int, str, int], list[tuple[int, _Term]]](list)  # by angle, function and value
    for top, terms in rows.items():
        for term in terms:
            places[term.angle, term.op, term.value].append((top, term))
    found: dict[int, Turned] = {}
    for top, terms in rows.items():
        for first in terms:
            for second in terms:
                if first.op == "cos" and second.op == "sin" and first.angle == second.angle:
                    _match(top, first, second, places, rows, found)
    return found


def _rows(program: Program) -> dict[int, list[_Term]]:
    """Return, per sum, its products of a sine or cosine with something else; of sums with one of each at least."""
    count, instructions = users(program), program.instructions
    rows: dict[int, list[_Term]] = {}
    for top, terms in summands(program).items():
        row = []
        for sign, product in terms:
            op, args, _ = instructions[product]
            if op != "mul" or count[product] != 1:
                continue
            turns = [arg for arg in args if instructions[arg].op in ANGULAR]
            if len(turns) == 1:
                turn = instructions[turns[0]]
                value = args[1] if args[0] == turns[0] else args[0]
                row.append(_Term(sign, product, turn.args[0], turn.op, value))
        if len(row) > 1:
            rows[top] = row
    return rows


def _match(
    top: int,
    first: _Term,
    second: _Term,
    places: Mapping[tuple[int, str, int], list[tuple[int, _Term]]],
    rows: Mapping[int, list[_Term]],
    found: dict[int, Turned],
) -> None:
    """Find the other sum of a rotation whose first one has these terms, c x and s y, and add its four products."""
    if first.product in found or second.product in found:
        return
    for other, third in places.get((first.angle, "sin", first.value), ()):
        if other == top or third.product in found:
            continue
        for fourth in rows[other]:
            turned = (fourth.angle, fourth.op, fourth.value) == (first.angle, "cos", second.value)
            if turned and fourth.product not in found and first.sign * second.sign * third.sign * fourth.sign < 0:
                rotation = Rotation(first.angle, first.value, second.value, first.sign * second.sign)
                found |= {first.product: Turned(rotation, False), second.product: Turned(rotation, True)}
                found |= {third.product: Turned(rotation, False), fourth.product: Turned(rotation, True)}
                return
