"""Programs as they are rendered: what depends on parameters alone in front, in one line of instructions."""

from __future__ import annotations

from ..codegen.program.ir import ASIDE, Instruction, Program, select


def with_setup(program: Program, setup: Program) -> Program:
    """Return a program with the values of its array h computed in front, by the program of the parameters.

    Instructions, their order and their association are those of the C, which computes h once and reads what it stored.
    Outputs are the results alone; notes of the program stay.
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
    return select(program.name, instructions, outputs, notes)
