"""Straight-line programs: what the recursion writes and what C is rendered from.

A ``Graph`` is under construction; a ``Program`` is finished and immutable.  A value's name is its index, and its
arguments have smaller indices, so single assignment and topological order hold by construction.  Values are real
scalars.  There is no control flow, no loop, no array and no call but those of ``operations``: a kernel that needs more
has it in its template.

Nodes are interned (the same operation on the same arguments is one node) and 0, 1 and -1 fold where a node is built,
so sharing is a dictionary and most pruning is free.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from .operations import CALLS, OPERATIONS, VALUES


@dataclass(frozen=True)
class Instruction:
    """One value: an operation, its arguments by index; ``leaf`` is a constant's number or an input's (array, index)."""

    op: str
    args: tuple[int, ...] = ()
    leaf: Any = None


class Node:
    """A value of a graph, with the operators of arithmetic."""

    __slots__ = ("graph", "index")

    def __init__(self, graph: Graph, index: int) -> None:
        self.graph, self.index = graph, index

    def __add__(self, other: Node | float) -> Node | float:
        return self.graph.add(self, other)

    __radd__ = __add__

    def __sub__(self, other: Node | float) -> Node | float:
        return self.graph.sub(self, other)

    def __rsub__(self, other: float) -> Node | float:
        return self.graph.sub(other, self)

    def __mul__(self, other: Node | float) -> Node | float:
        return self.graph.mul(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Node | float) -> Node | float:
        return self.graph.div(self, other)

    def __rtruediv__(self, other: float) -> Node | float:
        return self.graph.div(other, self)

    def __neg__(self) -> Node | float:
        return self.graph.neg(self)


Value = Node | float


class Graph:
    """A program under construction.

    Constants are plain floats until they meet a node; ``notes`` are comments that belong in front of a node.
    """

    def __init__(self) -> None:
        self.instructions: list[Instruction] = []
        self.notes: dict[int, str] = {}
        self._interned: dict[tuple[Any, ...], int] = {}

    def note(self, text: str) -> None:
        """Put a comment in front of the next value."""
        self.notes[len(self.instructions)] = text

    def input(self, array: str, index: int) -> Node:
        """Element ``index`` of the input array of that name."""
        return self._node("input", (), (array, index))

    def constant(self, number: float) -> Node:
        """The number as a node (arithmetic takes plain floats just as well)."""
        return self._node("const", (), float(number) + 0.0)

    def insert(self, op: str, args: tuple[int, ...], leaf: Any = None) -> Node:
        """A value copied from another program as it is, without folding."""
        return self._node(op, args, leaf)

    def sincos(self, x: Value) -> tuple[Value, Value]:
        """Sine and cosine of x."""
        if isinstance(x, Node):
            number = self._number(x)
            if number is None:
                return self._node("sin", (x.index,)), self._node("cos", (x.index,))
            x = number
        return math.sin(x), math.cos(x)

    def call(self, op: str, *args: Value) -> Value:
        """A function of values, by its name in ``operations.CALLS``; of max(x, y), x is where no number may come."""
        operation, first = CALLS[op], args[0]
        if operation.idempotent and len({(x.index,) if isinstance(x, Node) else x for x in args}) == 1:
            return first
        numbers = [self._number(x) if isinstance(x, Node) else float(x) for x in args]
        known = [x for x in numbers if x is not None]
        found = operation.compute(*known) if len(known) == len(args) else None
        if found is not None:
            return found
        nodes = [x if isinstance(x, Node) else self.constant(x) for x in args]
        return self._node(op, tuple(x.index for x in nodes))

    def add(self, x: Value, y: Value) -> Value:
        """x + y."""
        if not isinstance(x, Node):
            x, y = y, x
        if not isinstance(x, Node):
            return x + y
        minus_x = self._negated(x)
        if not isinstance(y, Node):
            if y == 0.0:
                return x
            y = self.constant(y)
        minus_y = self._negated(y)
        if minus_x is not None and minus_y is not None:
            return self.neg(self.add(minus_x, minus_y))
        if minus_y is not None:
            return self.sub(x, minus_y)
        if minus_x is not None:
            return self.sub(y, minus_x)
        for one, other in ((x, y), (y, x)):  # (a - b) + b
            difference = self._args("sub", one)
            if difference is not None and difference[1] == other.index:
                return Node(self, difference[0])
        merged = self._merged_constants(x, y)
        if merged is not None:
            return merged
        return self._binary("add", x, y) if x.index <= y.index else self._binary("add", y, x)

    def sub(self, x: Value, y: Value) -> Value:
        """x - y."""
        if not isinstance(y, Node):
            return self.add(x, -y)
        if not isinstance(x, Node):
            if x == 0.0:
                return self.neg(y)
            minus_y = self._negated(y)
            return self._binary("sub", self.constant(x), y) if minus_y is None else self.add(minus_y, x)
        if x.index == y.index:
            return 0.0
        minus_x, minus_y = self._negated(x), self._negated(y)
        if minus_y is not None:
            return self.add(x, minus_y)
        if minus_x is not None:
            return self.neg(self.add(minus_x, y))
        cancelled = self._cancelled(x, y)
        if cancelled is not None:
            return cancelled
        turned = self._interned.get(("sub", (y.index, x.index), None))
        return self._binary("sub", x, y) if turned is None else self.neg(Node(self, turned))

    def _cancelled(self, x: Node, y: Node) -> Value | None:
        """x - y where a summand of one is the other: (a + y) - y, x - (x + b), x - (x - b), (y - b) - y."""
        for one, other, sign in ((x, y, 1), (y, x, -1)):
            total = self._args("add", one)
            if total is not None and other.index in total:
                rest = Node(self, total[1] if total[0] == other.index else total[0])
                return rest if sign > 0 else self.neg(rest)
            difference = self._args("sub", one)
            if difference is not None and difference[0] == other.index:
                rest = Node(self, difference[1])
                return self.neg(rest) if sign > 0 else rest
        return None

    def _merged_constants(self, x: Node, y: Node) -> Value | None:
        """x + y with one constant where both bring one."""
        (rest_x, c), (rest_y, d) = self._split_constant(x), self._split_constant(y)
        if c is None or d is None:
            return None
        return self.add(self.add(rest_x, rest_y), c + d)

    def _split_constant(self, x: Node) -> tuple[Value, float | None]:
        """x as (rest, constant): a constant itself, c + rest, or c - rest."""
        found = self.instructions[x.index]
        if found.op == "const":
            return 0.0, found.leaf
        for op in ("add", "sub"):
            if found.op == op:
                for arg, other in (found.args, found.args[::-1]) if op == "add" else (found.args,):
                    if self.instructions[arg].op == "const":
                        rest = Node(self, other)
                        return (rest if op == "add" else self.neg(rest)), self.instructions[arg].leaf
        return x, None

    def _args(self, op: str, x: Node) -> tuple[int, ...] | None:
        found = self.instructions[x.index]
        return found.args if found.op == op else None

    def mul(self, x: Value, y: Value) -> Value:
        """x y; signs move outwards, constants inwards."""
        if not isinstance(x, Node):
            x, y = y, x
        if not isinstance(x, Node):
            return x * y
        if not isinstance(y, Node):
            return self._scaled(y, x)
        minus_x, minus_y = self._negated(x), self._negated(y)
        if minus_x is not None or minus_y is not None:
            product = self.mul(x if minus_x is None else minus_x, y if minus_y is None else minus_y)
            return product if minus_x is not None and minus_y is not None else self.neg(product)
        for inner, other in ((x, y), (y, x)):  # c x y: keep the constant where it can meet another one
            found = self.instructions[inner.index]
            if found.op == "const":
                return self._scaled(found.leaf, other)
        return self._binary("mul", x, y) if x.index <= y.index else self._binary("mul", y, x)

    def div(self, x: Value, y: Value) -> Value:
        """x / y."""
        if not isinstance(y, Node):
            return x * (1.0 / y)
        if not isinstance(x, Node):
            if x == 0.0:
                return 0.0
            x = self.constant(x)
        return self._binary("div", x, y)

    def neg(self, x: Value) -> Value:
        """-x."""
        if not isinstance(x, Node):
            return -x
        minus_x, number = self._negated(x), self._number(x)
        if number is not None:
            return -number
        return self._node("neg", (x.index,)) if minus_x is None else minus_x

    def _scaled(self, factor: float, x: Node) -> Value:
        if factor == 0.0:
            return 0.0
        if factor < 0.0:
            return self.neg(self._scaled(-factor, x))
        minus_x = self._negated(x)
        if minus_x is not None:
            return self.neg(self._scaled(factor, minus_x))
        if factor == 1.0:
            return x
        found = self.instructions[x.index]
        if found.op == "const":
            return factor * float(found.leaf)
        if found.op == "mul" and self.instructions[found.args[0]].op == "const":
            return self._scaled(factor * self.instructions[found.args[0]].leaf, Node(self, found.args[1]))
        return self._binary("mul", self.constant(factor), x)

    def _negated(self, x: Node) -> Node | None:
        """The node that x is the negative of, or None."""
        found = self.instructions[x.index]
        return Node(self, found.args[0]) if found.op == "neg" else None

    def _binary(self, op: str, x: Node, y: Node) -> Value:
        a, b = self._number(x), self._number(y)
        found = None if a is None or b is None else OPERATIONS[op].compute(a, b)
        return self._node(op, (x.index, y.index)) if found is None else found

    def _number(self, x: Node) -> float | None:
        """The number of a constant node, or None."""
        found = self.instructions[x.index]
        return float(found.leaf) if found.op == "const" else None

    def _node(self, op: str, args: tuple[int, ...], leaf: Any = None) -> Node:
        key = (op, args, leaf)
        index = self._interned.get(key)
        if index is None:
            index = self._interned[key] = len(self.instructions)
            self.instructions.append(Instruction(op, args, leaf))
        return Node(self, index)


@dataclass(frozen=True)
class Program:
    """A finished program: ``outputs`` maps (array, index) to the value written there, in order of writing."""

    name: str
    instructions: tuple[Instruction, ...]
    outputs: Mapping[tuple[str, int], int]
    notes: Mapping[int, str] = field(default_factory=dict)

    def count(self) -> dict[str, int]:
        """Operations of one run, by their ``cost``; sine and cosine of an angle are one."""
        found = Counter(OPERATIONS[instruction.op].cost for instruction in self.instructions)
        angles = {i.args[0] for i in self.instructions if i.op in ("sin", "cos")}
        return {
            "mul": found["mul"],
            "add": found["add"],
            "div": found["div"],
            "sincos": found["sincos"] + len(angles),
        }

    def inputs(self) -> set[str]:
        """Names of the input arrays that are read."""
        return {instruction.leaf[0] for instruction in self.instructions if instruction.op == "input"}


def finish(graph: Graph, name: str, outputs: Mapping[tuple[str, int], Value]) -> Program:
    """Graph -> Program: what the outputs need, renumbered in order."""
    wanted = {
        key: value.index if isinstance(value, Node) else graph.constant(value).index for key, value in outputs.items()
    }
    return select(name, graph.instructions, wanted, graph.notes)


def select(
    name: str,
    instructions: Sequence[Instruction],
    outputs: Mapping[tuple[str, int], int],
    notes: Mapping[int, str],
) -> Program:
    """The instructions that the outputs need, renumbered; notes move to the next instruction that stays."""
    alive = [False] * len(instructions)
    for index in outputs.values():
        alive[index] = True
    for index in range(len(instructions) - 1, -1, -1):
        if alive[index]:
            for arg in instructions[index].args:
                alive[arg] = True
    renumbered: dict[int, int] = {}
    kept: list[Instruction] = []
    kept_notes: dict[int, str] = {}
    for index, instruction in enumerate(instructions):
        if index in notes:
            kept_notes[len(kept)] = notes[index]
        if alive[index]:
            renumbered[index] = len(kept)
            args = tuple(renumbered[arg] for arg in instruction.args)
            kept.append(Instruction(instruction.op, args, instruction.leaf))
    kept_notes.pop(len(kept), None)
    return Program(name, tuple(kept), {key: renumbered[index] for key, index in outputs.items()}, kept_notes)


def verify(program: Program) -> Program:
    """The program itself, after checking its form; a violation is a bug of ours.

    Raises:
        AssertionError: an unknown operation, a wrong number of arguments, an argument that is not defined before, a
            constant that is not finite, or an output that does not exist.
    """
    for index, (op, args, leaf) in enumerate((i.op, i.args, i.leaf) for i in program.instructions):
        assert op in OPERATIONS, f"{program.name}: value {index}, unknown operation {op}"
        arity = OPERATIONS[op].arity
        assert len(args) == arity, f"{program.name}: value {index}, {op} takes {arity} arguments"
        assert all(0 <= arg < index for arg in args), f"{program.name}: value {index} uses a later one"
        assert (leaf is None) == (arity > 0), f"{program.name}: value {index}, leaf {leaf!r} of {op}"
        assert op != "const" or math.isfinite(leaf), f"{program.name}: value {index} is {leaf!r}"
    for key, index in program.outputs.items():
        assert 0 <= index < len(program.instructions), f"{program.name}: output {key} is not defined"
    return program


def evaluate(
    program: Program,
    inputs: Mapping[str, Sequence[Any]],
    sincos: Callable[[Any], tuple[Any, Any]] = lambda x: (math.sin(x), math.cos(x)),
    calls: Mapping[str, Callable[..., Any]] = MappingProxyType({}),
) -> dict[tuple[str, int], Any]:
    """Run the program on floats, or on anything that has arithmetic (SymPy expressions, NumPy arrays).

    ``sincos`` and ``calls`` (functions by the names of their operations, which arithmetic does not give) are those of
    its kind; of floats where there are none.
    """
    values: list[Any] = []
    for instruction in program.instructions:
        args = [values[arg] for arg in instruction.args]
        values.append(_apply(instruction, args, inputs, sincos, calls))
    return {key: values[index] for key, index in program.outputs.items()}


def _apply(
    instruction: Instruction,
    args: list[Any],
    inputs: Mapping[str, Sequence[Any]],
    sincos: Callable[[Any], tuple[Any, Any]],
    calls: Mapping[str, Callable[..., Any]],
) -> Any:
    op = instruction.op
    if op == "const":
        return instruction.leaf
    if op == "input":
        return inputs[instruction.leaf[0]][instruction.leaf[1]]
    if op in ("sin", "cos"):
        return sincos(args[0])[op == "cos"]
    return (calls.get(op) or VALUES[op])(*args)


def users(program: Program) -> list[int]:
    """Number of uses of each value, outputs included."""
    count = [0] * len(program.instructions)
    for instruction in program.instructions:
        for arg in instruction.args:
            count[arg] += 1
    for index in program.outputs.values():
        count[index] += 1
    return count
