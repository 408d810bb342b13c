"""Programs along a tree, taken apart: what every node computes beyond the nodes in front of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from .ir import Instruction, Program, select, verify
from .operations import ANGULAR

KEPT, GIVEN = "kept", "given"  # one array: a run writes to it, runs behind it read from it
LENGTH = 600  # values of a run that has several nodes, at most: such a run stays one function of C


@dataclass(frozen=True)
class Goal:
    """Place of an output: the node that writes it, and its place in the array that is written instead."""

    node: int
    array: str
    index: int


@dataclass(frozen=True)
class Run:
    """Nodes that follow each other, which one program computes.

    behind: the node that it follows, or -1.
    stops: by the index of an instruction, the last node that is complete in front of it.
    """

    program: Program
    behind: int
    stops: Mapping[int, int]


@dataclass(frozen=True)
class Shares:
    """Shares of the nodes of a tree, in runs of nodes; a node's number is above that of the node in front of it.

    What an output needs is computed by the runs from the root to its node, in that order, the last one up to this node.
    Their operations are those of the whole program, and so are the bits.

    run_of: per node the number of its run.
    angles: the program that writes all angles whose sines and cosines runs read, one run's behind the other's.
    turned: per node how many of these its run needs up to it.
    kept: size of the array that hands values on.
    """

    runs: tuple[Run, ...]
    run_of: tuple[int, ...]
    angles: Program
    turned: tuple[int, ...]
    kept: int

    def way(self, node: int) -> tuple[int, ...]:
        """Return, per run from the root to this node, the last node that is wanted of it."""
        path = [node]
        while (behind := self.runs[self.run_of[path[-1]]].behind) >= 0:
            path.append(behind)
        return tuple(reversed(path))

    def count(self) -> dict[str, int]:
        """Count operations of the path that costs most; all angles are known to all of them."""
        return max(map(self._count, range(len(self.run_of))), key=lambda count: sum(count.values()))

    def _count(self, node: int) -> dict[str, int]:
        counts = self.angles.count()
        for last in self.way(node):
            run = self.runs[self.run_of[last]]
            end = min((index for index, done in run.stops.items() if done >= last), default=None)
            count = replace(run.program, instructions=run.program.instructions[:end], outputs={}).count()
            counts = {key: number + count[key] for key, number in counts.items()}
            counts["sincos"] += self.turned[last]
        return counts


def share(program: Program, goals: Mapping[tuple[str, int], Goal], parents: Sequence[int], leaves: int) -> Shares:
    """Split a program among nodes: a value belongs to the last node in front of all that need it.

    Args:
        goals: per output of the program; one without is left out.
        parents: per node, -1 of the root, which is the first; parents come before their children.
        leaves: so many nodes at the end stay out of others' runs.
    """
    nodes, angles = _nodes(program, goals, parents)
    values: list[list[int]] = [[] for _ in parents]
    for index, node in nodes.items():
        if program.instructions[index].args:
            values[node].append(index)
    run_of = _runs([len(node_values) for node_values in values], parents, leaves)
    writers = [_Writer(program, parents[run_of.index(run)]) for run in range(max(run_of) + 1)]
    slots: dict[int, int] = {}
    turned = []
    for node, run in enumerate(run_of):
        writer = writers[run]
        writer.angles += [angle for angle, owner in angles.items() if owner == node]
        turned.append(len(writer.angles))
        if parents[node] >= 0 and run_of[parents[node]] == run:
            writer.stops[len(writer.instructions)] = parents[node]
        for index in values[node]:
            writer.compute(index, slots)
    for key, goal in goals.items():
        writer = writers[run_of[goal.node]]
        writer.outputs[goal.array, goal.index] = writer.value(program.outputs[key], slots)
    for index, slot in slots.items():
        writer = writers[run_of[nodes[index]]]
        writer.outputs[KEPT, slot] = writer.known[index]
    wanted = [angle for writer in writers for angle in writer.angles]
    outputs = {("angle", place): angle for place, angle in enumerate(wanted)}
    return Shares(
        tuple(writer.run(f"{program.name}{number}") for number, writer in enumerate(writers)),
        tuple(run_of),
        verify(select(f"{program.name}_angles", program.instructions, outputs, {}, program.operations)),
        tuple(turned),
        len(slots),
    )


def _runs(sizes: Sequence[int], parents: Sequence[int], leaves: int) -> list[int]:
    """Return per node the number of its run: its parent's, if it is the only one that goes on from there."""
    inner = parents[: len(parents) - leaves]
    run_of: list[int] = []
    length: list[int] = []
    for node, parent in enumerate(parents):
        goes_on = node < len(inner) and parent >= 0 and inner.count(parent) == 1
        if goes_on and length[run_of[parent]] + sizes[node] <= LENGTH:
            run_of.append(run_of[parent])
        else:
            run_of.append(len(length))
            length.append(0)
        length[run_of[node]] += sizes[node]
    return run_of


def _nodes(
    program: Program, goals: Mapping[tuple[str, int], Goal], parents: Sequence[int]
) -> tuple[dict[int, int], dict[int, int]]:
    """Return the node of every value that a share needs, in order, and of every angle with its sine and cosine."""
    nodes: dict[int, int] = {}
    angles: dict[int, int] = {}

    def join(node_of: dict[int, int], index: int, node: int) -> None:
        node_of[index] = _common(node_of.get(index, node), node, parents)

    for key, goal in goals.items():
        join(nodes, program.outputs[key], goal.node)
    for index in range(len(program.instructions) - 1, -1, -1):
        if index in nodes:
            op, args, _ = program.instructions[index]
            for arg in args:
                join(angles if op in ANGULAR else nodes, arg, nodes[index])
    for index in nodes:
        op, args, _ = program.instructions[index]
        if op in ANGULAR:
            nodes[index] = angles[args[0]]
    return dict(sorted(nodes.items())), dict(sorted(angles.items()))


def _common(one: int, other: int, parents: Sequence[int]) -> int:
    """Return the last node that is in front of both, or one of them."""
    while one != other:
        one, other = (parents[one], other) if one > other else (one, parents[other])
    return one


class _Writer:
    """Writes one run."""

    def __init__(self, whole: Program, behind: int) -> None:
        self.whole, self.behind = whole, behind
        self.angles: list[int] = []  # by their indices in the whole program
        self.instructions: list[Instruction] = []
        self.known: dict[int, int] = {}  # values of the whole program, and their indices here
        self.outputs: dict[tuple[str, int], int] = {}
        self.stops: dict[int, int] = {}

    def compute(self, index: int, slots: dict[int, int]) -> None:
        """Compute a value of the whole program here."""
        op, args, leaf = self.whole.instructions[index]
        if op in ANGULAR:
            instruction = Instruction("input", (), (ANGULAR[op], self.angles.index(args[0])))
        else:
            instruction = Instruction(op, tuple(self.value(arg, slots) for arg in args), leaf)
        self.known[index] = self._append(instruction)

    def value(self, index: int, slots: dict[int, int]) -> int:
        """Return the index here of a value of the whole program; one that a run in front computes is read."""
        if index not in self.known:
            instruction = self.whole.instructions[index]
            if instruction.args:
                instruction = Instruction("input", (), (GIVEN, slots.setdefault(index, len(slots))))
            self.known[index] = self._append(instruction)
        return self.known[index]

    def _append(self, instruction: Instruction) -> int:
        self.instructions.append(instruction)
        return len(self.instructions) - 1

    def run(self, name: str) -> Run:
        program = Program(name, tuple(self.instructions), self.outputs, operations=self.whole.operations)
        return Run(verify(program), self.behind, self.stops)
