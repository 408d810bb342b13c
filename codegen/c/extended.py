"""Programs as tables that ``clib/double_double.h`` runs: a row per value, with places that are taken again."""

from __future__ import annotations

from dataclasses import dataclass

from eomgen.errors import InputError

from ..kernels.derived import radii_of
from ..kernels.signatures import SIGNATURES
from ..program.ir import Program
from ..program.operations import OPERATIONS

ORDER = (  # of the operations of clib/double_double.h
    *("const", "input", "neg", "add", "sub", "mul", "div", "sin", "cos", "sqrt", "abs", "max", "step"),
    *("choose", "exp", "log", "atan2"),
)
MOST = 2**16  # numbers of a column are unsigned short
assert set(ORDER) == set(OPERATIONS)


@dataclass(frozen=True)
class Table:
    """A program as rows of numbers.

    name: the function's, without the robot's in front.
    text: what it computes.
    reads: arrays that the function takes, "h" first.
    steps: operation, place, and three arguments each.
    constants: literals of C, doubles.
    results: places of the results.
    places: how many there are.
    """

    name: str
    text: str
    reads: tuple[str, ...]
    steps: tuple[tuple[int, int, int, int, int], ...]
    constants: tuple[str, ...]
    results: tuple[int, ...]
    places: int


def tabulate(program: Program) -> Table:
    """Write a program of results alone as a table.

    Raises:
        InputError: it has too many values at once, or reads from behind an array's first 65,536 numbers.
    """
    return rows_of(program, ("h", *SIGNATURES[program.name].reads), SIGNATURES[program.name].text)


def rows_of(program: Program, reads: tuple[str, ...], text: str = "") -> Table:
    """Write a program that reads these arrays as a table; see ``tabulate``."""
    order = sorted(program.outputs, key=lambda key: key[1])
    written = [program.outputs[key] for key in order]
    assert order == [("out", i) for i in range(len(order))], f"{program.name} has gaps"
    radii = radii_of(reads)
    last = _last_uses(program, written)
    free, places, taken = list[int](), 0, dict[int, int]()
    constants: dict[float, int] = {}
    steps = []
    for index, (op, args, leaf) in enumerate(program.instructions):
        row = [taken[arg] for arg in args]
        if op == "input":
            radius = radii.get(leaf[0])
            row = [reads.index(leaf[0]), leaf[1], 0 if radius is None else reads.index(radius)]
        elif op == "const":
            row = [constants.setdefault(leaf, len(constants))]
        for arg in dict.fromkeys(args):
            if last[arg] == index:
                free.append(taken[arg])
        if free:
            taken[index] = free.pop()
        else:
            taken[index], places = places, places + 1
        first, second, third = (*row, 0, 0, 0)[:3]
        steps.append((ORDER.index(op), taken[index], first, second, third))
    if max([places, *(number for step in steps for number in step)]) >= MOST:
        raise InputError(f"kernels: {program.name!r} is too long for tables of programs; allowed: {MOST - 1} places")
    results = tuple(taken[index] for index in written)
    return Table(program.name, text, reads, tuple(steps), tuple(map(repr, constants)), results, places)


def _last_uses(program: Program, written: list[int]) -> list[int]:
    """Return, per value, the last instruction that reads it; of results one that never comes."""
    last = list(range(len(program.instructions)))
    for index, instruction in enumerate(program.instructions):
        for arg in instruction.args:
            last[arg] = index
    for index in written:
        last[index] = len(program.instructions)
    return last
