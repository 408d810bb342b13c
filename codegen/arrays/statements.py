"""Program -> statements of Python on arrays, one per value, in the order of the program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ..program.ir import Program, needed

FORMS: Mapping[str, str] = MappingProxyType(  # every operation that has arguments
    {
        "neg": "-{0}",
        "add": "{0} + {1}",
        "sub": "{0} - {1}",
        "mul": "{0}*{1}",
        "div": "{0}/{1}",
        "sin": "sin({0})",
        "cos": "cos({0})",
        "sqrt": "sqrt({0})",
        "exp": "exp({0})",
        "log": "log({0})",
        "atan2": "atan2({0}, {1})",
        "abs": "abs({0})",
        "max": "larger({0}, {1})",
        "step": "positive({0})",
        "choose": "chosen({0}, {1}, {2})",
    }
)


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
            lines.append(f"t{index} = {FORMS[op].format(*(names[arg] for arg in args))}")
            names[index] = f"t{index}"
    results = tuple(names[places[i]] if i in places else "0.0" for i in range(size))
    return Statements({array: tuple(sorted(reads)) for array, reads in inputs.items()}, tuple(lines), results)
