"""Programs as they are rendered: what depends on parameters alone in front, in one line of instructions."""

from __future__ import annotations

from itertools import compress

from ..codegen.program.ir import ASIDE, Instruction, Program, needed, select


def with_setup(program: Program, setup: Program) -> Program:
    """Return a program with the values of its array h computed in front, by the program of the parameters.

    Instructions, their order and their association are those of the C, which computes h once and reads what it stored.
    Outputs are the results alone; notes of the program stay, and so do values in double precision.
    """
    return with_origins(program, setup)[0]


def with_origins(program: Program, setup: Program) -> tuple[Program, list[tuple[bool, int]]]:
    """Return ``with_setup``, and of each value whether it is of the program, and its place there or in the setup."""
    instructions = list(setup.instructions)
    origins = [(False, index) for index in range(len(instructions))]
    moved: list[int] = []
    for index, (op, args, leaf) in enumerate(program.instructions):
        if op == "input" and leaf[0] == "h":
            moved.append(setup.outputs["h", leaf[1]])
            continue
        moved.append(len(instructions))
        origins.append((True, index))
        instructions.append(Instruction(op, tuple([moved[arg] for arg in args]), leaf))
    outputs = {key: moved[index] for key, index in program.outputs.items() if key[0] not in ASIDE}
    notes = {moved[index]: text for index, text in program.notes.items() if moved[index] >= len(setup.instructions)}
    wide = (*setup.wide, *(moved[index] for index in program.wide))
    whole = select(program.name, instructions, outputs, notes, wide)
    return whole, list(compress(origins, needed(instructions, outputs.values())))
