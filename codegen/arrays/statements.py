"""Program -> statements of Python on arrays, one per value, in the order of the program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..program.ir import Program, needed


@dataclass(frozen=True)
class Statements:
    """A program as text.

    Attributes:
        inputs: arrays and the places that are read of each.
        lines: assignments, one per value that the results need.
        results: expressions of the outputs, by their places; 0.0 where a result is nothing else.
    """

    inputs: Mapping[str, tuple[int, ...]]
    lines: tuple[str, ...]
    results: tuple[str, ...]


def write_statements(program: Program, output: str, size: int) -> Statements:
    """Write statements that compute one of a program's outputs, and what they need alone.

    Args:
        output: the array, "out" of kernels, "h" of the setup.
    """
    places = {place: index for (array, place), index in program.outputs.items() if array == output}
    names: dict[int, str] = {}
    inputs: dict[str, set[int]] = {}
    lines = []
    wanted = needed(program.instructions, places.values())
    for index, (op, args, leaf) in enumerate(program.instructions):
        if not wanted[index]:
            continue
        if op == "const":
            names[index] = repr(float(leaf)) if leaf >= 0 else f"({float(leaf)!r})"
        elif op == "input":
            inputs.setdefault(leaf[0], set()).add(leaf[1])
            names[index] = f"{leaf[0]}{leaf[1]}"
        else:
            lines.append(f"t{index} = {program.operations[op].form.format(*(names[arg] for arg in args))}")
            names[index] = f"t{index}"
    results = tuple(names[places[i]] if i in places else "0.0" for i in range(size))
    return Statements({array: tuple(sorted(reads)) for array, reads in inputs.items()}, tuple(lines), results)
