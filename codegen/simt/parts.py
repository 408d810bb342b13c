"""Kernel -> parts that threads compute one after the other: columns of Jacobians where they ask for less registers."""

from __future__ import annotations

from collections.abc import Iterator

from ..program.ir import Program, select
from .registers import SINE, Places, Schedule, scheduled

DIVISION = 8  # operations of a division or root
MOST_PARTS = 8
Part = tuple[Program, Schedule]


def split_columns(program: Program, columns: int, places: Places) -> tuple[Part, ...]:
    """Split a program that writes matrices into parts of their columns, or leave it whole: what costs less.

    Parts compute again what several columns share, but hold less at once; checks are those of the first part.
    There are no more parts than lower the cost one by one.

    Args:
        columns: of each matrix of "out".
        places: how many values fit where.
    """
    whole: tuple[Part, ...] = ((program, scheduled(program, places)),)
    if whole[0][1].stores == 0:
        return whole
    best = whole
    for count in range(2, min(columns, MOST_PARTS) + 1):
        parts = tuple((part, scheduled(part, places)) for part in _parts(program, columns, count))
        if _cost(parts) >= _cost(best):
            break
        best = parts
    return best


def _parts(program: Program, columns: int, count: int) -> Iterator[Program]:
    """Yield as many programs of neighbouring columns each, as even as it goes."""
    for part in range(count):
        outputs = {
            (array, place): index
            for (array, place), index in program.outputs.items()
            if (place % columns * count // columns == part if array == "out" else part == 0)
        }
        yield select(program.name, program.instructions, outputs, {}, program.operations)


def _cost(parts: tuple[Part, ...]) -> int:
    """Count operations of parts, and those for which accesses to memory stand."""
    return sum(_operations(program) + plan.operations for program, plan in parts)


def _operations(program: Program) -> int:
    count = program.count()
    weights = {"mul": 1, "add": 1, "div": DIVISION, "sincos": SINE}
    return sum(weight * count[key] for key, weight in weights.items())
