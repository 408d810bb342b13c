"""Programs in single precision some of whose values are kept in double: which operations that takes, and constants.

A value is rounded to single precision unless it is wide.  An operation is in double where its result or one of its
arguments is wide: single arguments are converted, which is exact, and a result that is not wide is rounded once.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from .ir import Instruction, Program


def in_double(program: Program) -> frozenset[int]:
    """Return the operations that are computed in double precision, by their values."""
    wide = program.wide
    if not wide:
        return wide
    return frozenset(
        index
        for index, (_, args, _) in enumerate(program.instructions)
        if args and (index in wide or any(arg in wide for arg in args))
    )


def with_wide(program: Program, wide: Iterable[int]) -> Program:
    """Return the program with these values in double precision, and in operations with them constants as they are.

    A constant that operations in single precision take, too, is there twice.
    """
    program = replace(program, wide=frozenset(wide) - frozenset(program.outputs.values()))
    double = in_double(program)
    instructions: list[Instruction] = []
    moved: list[int] = []
    exact: dict[int, int] = {}  # constants as operations in double take them
    chosen: set[int] = set()
    for index, (op, args, leaf) in enumerate(program.instructions):
        taken = [moved[arg] for arg in args]
        if index in double:
            for place, arg in enumerate(args):
                if program.instructions[arg].op == "const" and arg not in program.wide:
                    if arg not in exact:
                        exact[arg] = len(instructions)
                        chosen.add(len(instructions))
                        instructions.append(program.instructions[arg])
                    taken[place] = exact[arg]
        moved.append(len(instructions))
        if index in program.wide:
            chosen.add(len(instructions))
        instructions.append(Instruction(op, tuple(taken), leaf))
    outputs = {key: moved[index] for key, index in program.outputs.items()}
    notes = {moved[index]: text for index, text in program.notes.items()}
    return Program(program.name, tuple(instructions), outputs, notes, frozenset(chosen))
