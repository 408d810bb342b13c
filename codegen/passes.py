"""Passes over finished programs: verbs in one ordered list, the form verified after each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .ir import Graph, Instruction, Node, Program, Value, finish, select, users, verify

PARAMETERS = "p"  # the input array of run-time parameters


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
    moved = [Instruction(i.op, tuple(turned.get(arg, arg) for arg in i.args), i.leaf) for i in instructions]
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


def hoist_parameters(programs: Sequence[Program], parameters: int) -> tuple[Program, list[Program]]:
    """Split off what depends on parameters alone.

    Args:
        programs: kernels that read parameters from the input array "p".
        parameters: how many parameters there are.

    Returns:
        The setup program, which writes the array "h" (the parameters, then what is computed from them; shared by all
        kernels), and the programs with "h" in the place of "p".
    """
    setup = Graph()
    slots: dict[int, int] = {setup.input(PARAMETERS, i).index: i for i in range(parameters)}
    rewritten = [_hoist(program, setup, slots) for program in programs]
    outputs: dict[tuple[str, int], Value] = {("h", slot): Node(setup, index) for index, slot in slots.items()}
    return verify(finish(setup, "setup", outputs)), [verify(program) for program in rewritten]


def _hoist(program: Program, setup: Graph, slots: dict[int, int]) -> Program:
    """One program with every value that depends on parameters alone read from "h"."""
    count = len(program.instructions)
    reads_parameters = [False] * count
    reads_state = [False] * count
    for index, instruction in enumerate(program.instructions):
        if instruction.op == "input":
            reads_parameters[index] = instruction.leaf[0] == PARAMETERS
            reads_state[index] = not reads_parameters[index]
        for arg in instruction.args:
            reads_parameters[index] |= reads_parameters[arg]
            reads_state[index] |= reads_state[arg]
    early = [reads_parameters[i] and not reads_state[i] for i in range(count)]
    wanted = {arg for i, x in enumerate(program.instructions) if not early[i] for arg in x.args if early[arg]}
    wanted.update(index for index in program.outputs.values() if early[index])
    moved: dict[int, Node] = {}
    instructions = list(program.instructions)
    for index, instruction in enumerate(program.instructions):
        if early[index] or instruction.op == "const":
            args = tuple(moved[arg].index for arg in instruction.args)
            moved[index] = setup.insert(instruction.op, args, instruction.leaf)
        if index in wanted:
            slot = slots.setdefault(moved[index].index, len(slots))
            instructions[index] = Instruction("input", (), ("h", slot))
    return select(program.name, instructions, program.outputs, program.notes)
