"""Programs as the C runs them, what depends on parameters alone in front; their values at many states by NumPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..codegen.program.ir import ASIDE, Instruction, Program, evaluate_lanes, select
from .intervals import Array


def with_setup(program: Program, setup: Program) -> Program:
    """Return a program with the values of its array h computed in front, by the program of the parameters.

    Instructions, their order and their association are those of the C, which computes h once and reads what it stored.
    Outputs are the results alone.
    """
    instructions = list(setup.instructions)
    moved: list[int] = []
    for op, args, leaf in program.instructions:
        if op == "input" and leaf[0] == "h":
            moved.append(setup.outputs["h", leaf[1]])
            continue
        moved.append(len(instructions))
        instructions.append(Instruction(op, tuple([moved[arg] for arg in args]), leaf))
    outputs = {key: moved[index] for key, index in program.outputs.items() if key[0] not in ASIDE}
    notes = {moved[index]: text for index, text in program.notes.items() if moved[index] >= len(setup.instructions)}
    return select(program.name, instructions, outputs, notes, program.operations)


def output_values(program: Program, inputs: Mapping[str, Sequence[Array]], dtype: str, size: int) -> Array:
    """Return the outputs of a program at many states in the arithmetic of a dtype, (size, states).

    Args:
        program: of ``with_setup``.
        inputs: per array the values of each element, (states,).
        dtype: "float64" or "float32".
        size: number of outputs; those that are not written are 0.
    """
    given = {array: [row.astype(dtype) for row in rows] for array, rows in inputs.items()}
    with np.errstate(all="ignore"):
        out = evaluate_lanes(program, given, dtype, sincos=lambda x: (np.sin(x), np.cos(x)))["out"]
    found = np.zeros((size, out.shape[1]))
    found[: len(out)] = out
    return found


def describe(program: Program, index: int) -> str:
    """Describe an instruction: its operation and number, and the comment of the C in front of it."""
    return f"{program.instructions[index].op} {index} ({note_of(program, index)})"


def note_of(program: Program, index: int) -> str:
    """Return the comment of the C that an instruction belongs to."""
    return next((program.notes[i] for i in sorted(program.notes, reverse=True) if i <= index), "in front")
