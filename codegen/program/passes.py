"""Passes over finished programs: verbs in one ordered list, the form verified after each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .ir import Graph, Instruction, Node, Program, Value, finish, gate_between, reordered, select, users, verify
from .orders import depth_first

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
    moved = [(op, tuple([turned.get(arg, arg) for arg in args]), leaf) for op, args, leaf in instructions]
    outputs = {key: turned.get(index, index) for key, index in program.outputs.items()}
    return select(program.name, moved, outputs, program.notes, program.operations)


def _negative(
    instructions: list[Instruction], index: int, count: Sequence[int]
) -> list[tuple[int, Instruction]] | None:
    """Return replacements that turn the sign of a value nobody else uses; None where that would cost an operation."""
    instruction = instructions[index]
    if count[index] != 1:
        return None
    if instruction.op == "sub":
        return [(index, Instruction("sub", (instruction.args[1], instruction.args[0])))]
    if instruction.op in ("mul", "div"):
        for arg in instruction.args:
            if instructions[arg].op == "const" and count[arg] == 1:
                return [(arg, Instruction("const", (), -instructions[arg].leaf))]
            inner = _negative(instructions, arg, count)
            if inner is not None:
                return inner
    if instruction.op == "add":  # -(a + b) = (-a) - b where -a is free
        for arg, other in (instruction.args, instruction.args[::-1]):
            inner = _negative(instructions, arg, count)
            if inner is not None:
                return [*inner, (index, Instruction("sub", (arg, other)))]
    return None


def factor_sums(program: Program) -> Program:
    """Write a f + b f as (a + b) f, also where other summands stand between; products that others use stay."""
    count = users(program)
    inner, sums = _inner_sums(program, count), _sums(program)
    plans: dict[int, list[_Group]] = {}
    for index, instruction in enumerate(program.instructions):
        if instruction.op in sums and not inner[index]:
            groups = _groups(_summands(program, index, inner), program, count)
            if groups:
                plans[index] = groups
    return _rebuilt(program, plans) if plans else program


@dataclass
class _Group:
    """Summands with a common factor, (sign, what is left of each); a summand by itself has no factor."""

    factor: int | None
    parts: list[tuple[int, int]]


def _inner_sums(program: Program, count: Sequence[int]) -> list[bool]:
    """Whether a value is a sum that only another sum uses, once."""
    inner, sums = [False] * len(program.instructions), _sums(program)
    for op, args, _ in program.instructions:
        if op in sums:
            for arg in args:
                inner[arg] = count[arg] == 1 and program.instructions[arg].op in sums
    return inner


def _sums(program: Program) -> set[str]:
    """Return the operations that add up their arguments, with signs."""
    return {name for name, operation in program.operations.items() if operation.signs}


def _summands(program: Program, index: int, inner: Sequence[bool]) -> list[tuple[int, int]]:
    """Return (sign, value) of everything that a sum adds up, from left to right."""
    terms: list[tuple[int, int]] = []
    waiting = [(1, index)]
    while waiting:
        sign, value = waiting.pop()
        op, args, _ = program.instructions[value]
        if value != index and not inner[value]:
            terms.append((sign, value))
        else:
            signs = program.operations[op].signs
            waiting += [(sign * of, arg) for of, arg in zip(signs[::-1], args[::-1], strict=True)]
    return terms


def summands(program: Program) -> dict[int, list[tuple[int, int]]]:
    """Return, per sum that no other one contains, (sign, value) of what it adds up."""
    inner, sums = _inner_sums(program, users(program)), _sums(program)
    tops = (i for i, instruction in enumerate(program.instructions) if instruction.op in sums and not inner[i])
    return {index: _summands(program, index, inner) for index in tops}


def _groups(terms: list[tuple[int, int]], program: Program, count: Sequence[int]) -> list[_Group]:
    """Group summands with a common factor, at the place of the first of them; none if all stay alone."""
    products = {value for _, value in terms if count[value] == 1 and program.instructions[value].op == "mul"}
    factors = [arg for value in products for arg in set(program.instructions[value].args)]
    if len(set(factors)) == len(factors):
        return []
    often = Counter(factors)
    groups: list[_Group] = []
    open_groups: dict[int, _Group] = {}
    for sign, value in terms:
        args = program.instructions[value].args if value in products else ()
        factor = max(args, key=lambda arg: (arg in open_groups, often[arg]), default=None)
        if factor is None or often[factor] < 2:
            groups.append(_Group(None, [(sign, value)]))
            continue
        rest = args[1] if args[0] == factor else args[0]
        often[rest] -= rest != factor
        if factor not in open_groups:
            open_groups[factor] = _Group(factor, [])
            groups.append(open_groups[factor])
        open_groups[factor].parts.append((sign, rest))
    return groups if any(len(group.parts) > 1 for group in groups) else []


def _rebuilt(program: Program, plans: Mapping[int, list[_Group]]) -> Program:
    """Write the program anew with the planned sums."""
    graph, made = Graph(program.operations), list[Node]()
    folded: set[int] = set()  # values that have turned out to be numbers

    def total(parts: list[tuple[int, Value]]) -> Value:
        parts = sorted(parts, key=lambda term: term[0] < 0)  # a positive one in front saves the sign
        value: Value = 0.0
        for sign, term in parts:
            value = graph.add(value, term) if sign > 0 else graph.sub(value, term)
        return value

    for index, (op, args, leaf) in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        if index in plans:
            parts: list[tuple[int, Value]] = []
            for group in plans[index]:
                sign = max(sign for sign, _ in group.parts)
                inside = total([(sign * s, made[value]) for s, value in group.parts])
                parts.append((sign, inside if group.factor is None else graph.mul(inside, made[group.factor])))
            value = total(parts)
        elif folded and not folded.isdisjoint(args):
            value = _folded(graph, op, [made[arg] for arg in args])
        else:
            made.append(graph.insert(op, tuple([made[arg].index for arg in args]), leaf))
            continue
        made.append(value if isinstance(value, Node) else graph.constant(value))
        if graph.number(made[index]) is not None:
            folded.add(index)
    return finish(graph, program.name, {key: made[index] for key, index in program.outputs.items()})


def _folded(graph: Graph, op: str, nodes: Sequence[Node]) -> Value:
    """Write a value anew, because one of its arguments has turned out to be a number."""
    numbers = [graph.number(node) for node in nodes]
    return graph.call(op, *(node if x is None else x for node, x in zip(nodes, numbers, strict=True)))


PASSES: Sequence[Callable[[Program], Program]] = (factor_sums, absorb_negations)


def run_passes(program: Program) -> Program:
    """Run the passes in order, and check the program's form after each."""
    verify(program)
    for step in (*PASSES, gate_between):
        changed = step(program)
        program = program if changed is program else verify(changed)
    return program


def on_demand(program: Program) -> Program:
    """Put every value right before the first output that needs it, in the order of the outputs.

    Where thousands of values stay for others that come much later, it is the memory between them that takes time.
    Steps that notes speak of are torn apart, so that notes are left out.
    """
    return verify(reordered(program, depth_first(program), {}))


def hoist_parameters(programs: Sequence[Program], parameters: int) -> tuple[Program, list[Program]]:
    """Split off what depends on parameters alone.

    Args:
        programs: kernels that read parameters from the input array "p".
        parameters: how many parameters there are.

    Returns:
        The setup program, which writes the array "h" (the parameters, then what is computed from them; shared by all
        kernels), and the programs with "h" in the place of "p".
    """
    setup = Graph(programs[0].operations)
    slots: dict[int, int] = {setup.input(PARAMETERS, i).index: i for i in range(parameters)}
    rewritten = [_hoist(program, setup, slots) for program in programs]
    outputs: dict[tuple[str, int], Value] = {("h", slot): Node(setup, index) for index, slot in slots.items()}
    return verify(finish(setup, "setup", outputs)), [verify(program) for program in rewritten]


def _hoist(program: Program, setup: Graph, slots: dict[int, int]) -> Program:
    """Read every value that depends on parameters alone from "h", and so what is computed of numbers that are known."""
    reads: list[int] = []  # 1: parameters, 2: the state, 3: both, 0: neither
    for op, args, leaf in program.instructions:
        origin = 0 if op != "input" else 1 if leaf[0] == PARAMETERS else 2
        for arg in args:
            origin |= reads[arg]
        reads.append(origin)
    early = [origin < 2 and x.op != "const" for origin, x in zip(reads, program.instructions, strict=True)]
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
    return select(program.name, instructions, program.outputs, program.notes, program.operations)
