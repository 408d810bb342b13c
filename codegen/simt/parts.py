"""Kernel -> parts that threads compute one after the other: columns of Jacobians where they ask for less registers."""

from __future__ import annotations

from collections.abc import Iterator

from ..program.ir import Program, select
from .registers import SINE, Schedule, scheduled

DIVISION = 8  # operations of a division or root
SPILL = 4  # operations of an access to memory
MOST_PARTS = 8
Part = tuple[Program, Schedule]


def split_columns(program: Program, columns: int, room: int) -> tuple[Part, ...]:
    """Split a program that writes matrices into parts of their columns, or leave it whole: what costs less.

    Parts compute again what several columns share, but hold less at once; checks are those of the first part.

    Args:
        columns: of each matrix of "out".
        room: values that fit into registers.
    """
    whole: tuple[Part, ...] = ((program, scheduled(program, room)),)
    if whole[0][1].stores == 0:
        return whole
    candidates = [whole]
    for count in range(2, min(columns, MOST_PARTS) + 1):
        if columns % count == 0:
            parts = _parts(program, columns, count)
            candidates.append(tuple((part, scheduled(part, room)) for part in parts))
    return min(candidates, key=_cost)


def _parts(program: Program, columns: int, count: int) -> Iterator[Program]:
    """Yield as many programs of neighbouring columns each."""
    width = columns // count
    for part in range(count):
        outputs = {
            (array, place): index
            for (array, place), index in program.outputs.items()
            if (place % columns // width == part if array == "out" else part == 0)
        }
        yield select(program.name, program.instructions, outputs, {})


def _cost(parts: tuple[Part, ...]) -> int:
    """Count operations of parts, and what accesses to memory stand for."""
    beside = sum(SPILL * (plan.stores + plan.loads) + SINE * plan.sines_again for _, plan in parts)
    return beside + sum(_operations(program) for program, _ in parts)


def _operations(program: Program) -> int:
    count = program.count()
    weights = {"mul": 1, "add": 1, "div": DIVISION, "sincos": SINE}
    return sum(weight * count[key] for key, weight in weights.items())
