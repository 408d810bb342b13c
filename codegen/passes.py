"""Passes over finished programs: verbs in one ordered list, the form verified after each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .ir import Instruction, Program, select, users, verify


def absorb_negations(program: Program) -> Program:
    """Move a negation into the only place that makes its argument: a constant factor, or a difference turned round.

    The graph moves signs outwards so that sums meet them; what is left at the end stands in front of an output.
    """
    count = users(program)
    instructions = list(program.instructions)
    turned: dict[int, int] = {}  # negation -> the value that now is the negative itself
    for index, instruction in enumerate(program.instructions):
        if instruction.op == "neg":
            (arg,) = instruction.args
            negative = _negative(instructions, arg, count)
            if negative is not None:
                for position, replacement in negative:
                    instructions[position] = replacement
                turned[index] = arg
    if not turned:
        return program
    moved = [
        Instruction(i.op, tuple(turned.get(arg, arg) for arg in i.args), i.leaf) for i in instructions
    ]
    outputs = {key: turned.get(index, index) for key, index in program.outputs.items()}
    return select(program.name, moved, outputs, program.notes)


def _negative(
    instructions: list[Instruction], index: int, count: Sequence[int]
) -> list[tuple[int, Instruction]] | None:
    """Replacements that turn the sign of a value nobody else uses; None where that would cost an operation."""
    found = instructions[index]
    if count[index] != 1:
        return None
    if found.op == "sub":
        return [(index, Instruction("sub", (found.args[1], found.args[0])))]
    if found.op in ("mul", "div"):
        for arg in found.args:
            if instructions[arg].op == "const" and count[arg] == 1:
                return [(arg, Instruction("const", (), -instructions[arg].leaf))]
            inner = _negative(instructions, arg, count)
            if inner is not None:
                return inner
    if found.op == "add":  # -(a + b) = (-a) - b where -a is free
        for arg, other in (found.args, found.args[::-1]):
            inner = _negative(instructions, arg, count)
            if inner is not None:
                return [*inner, (index, Instruction("sub", (arg, other)))]
    return None


PASSES: Sequence[Callable[[Program], Program]] = (absorb_negations,)


def run_passes(program: Program) -> Program:
    """All passes in order, the program's form checked after each."""
    verify(program)
    for step in PASSES:
        program = verify(step(program))
    return program
