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
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .named import to_float
from .operations import ANGULAR, OPERATIONS, Operations

Array = NDArray[Any]
SinCos = Callable[[Any], tuple[Any, Any]]

GATE = "gate"  # output: what says whether a program goes on
FIRST = {"first": "out", "first_pivot": "pivot"}  # outputs: what is written if it does not, and where
ASIDE = ("pivot", GATE, *FIRST)  # outputs that are no results


class Instruction(NamedTuple):
    """One value: an operation, its arguments by index; ``leaf`` is a constant's number or an input's (array, index)."""

    op: str
    args: tuple[int, ...] = ()
    leaf: Any = None


Written = tuple[str, tuple[int, ...], Any]  # an Instruction in a graph; plain tuples cost the collector nothing


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

    def __init__(self, operations: Operations = OPERATIONS) -> None:
        self.operations = operations
        self.instructions: list[Written] = []
        self.notes: dict[int, str] = {}
        self._interned: dict[tuple[Any, ...], int] = {}

    def note(self, text: str) -> None:
        """Put a comment in front of the next value."""
        self.notes[len(self.instructions)] = text

    def input(self, array: str, index: int) -> Node:
        """Read element ``index`` of the input array of that name."""
        return self._node("input", (), (array, index))

    def constant(self, number: float) -> Node:
        """Return the number as a node (arithmetic takes plain floats just as well)."""
        return self._node("const", (), to_float(number) + 0.0)

    def insert(self, op: str, args: tuple[int, ...], leaf: Any = None) -> Node:
        """Copy a value from another program as it is, without folding."""
        return self._node(op, args, leaf)

    def sincos(self, x: Value) -> tuple[Value, Value]:
        """Return sine and cosine of x."""
        if isinstance(x, Node):
            number = self.number(x)
            if number is None:
                return self._node("sin", (x.index,)), self._node("cos", (x.index,))
            x = number
        return math.sin(x), math.cos(x)

    def call(self, op: str, *args: Value) -> Value:
        """Write an operation by its name; of max(x, y), x is where no number may come."""
        operation = self.operations[op]
        if op in ANGULAR:
            return self.sincos(args[0])[op == "cos"]
        if not operation.function:
            arithmetic: Value = getattr(self, op)(*args)
            return arithmetic
        folded: Value | None = None if operation.fold is None else operation.fold(self, *args)
        if folded is not None:
            return folded
        numbers = [self.number(x) if isinstance(x, Node) else to_float(x) for x in args]
        known = [x for x in numbers if x is not None]
        value = operation.compute(*known) if len(known) == len(args) else None
        if value is not None:
            return value
        nodes = [x if isinstance(x, Node) else self.constant(x) for x in args]
        return self._node(op, tuple(x.index for x in nodes))

    def choose(self, gate: Value, x: Value, y: Value) -> Value:
        """Return x where the gate is greater than 0, else y."""
        return self.call("choose", gate, x, y)

    def is_same(self, x: Value, y: Value) -> bool:
        """Whether two values are the same node or number."""
        return x.index == y.index if isinstance(x, Node) and isinstance(y, Node) else x is y or x == y

    def add(self, x: Value, y: Value) -> Value:
        """Return x + y."""
        if not isinstance(x, Node):
            x, y = y, x
        if not isinstance(x, Node):
            return x + y
        if not isinstance(y, Node):
            if y == 0.0:
                return x
            y = self.constant(y)
        i, j = x.index, y.index
        (op, args, _), (other_op, other_args, _) = self.instructions[i], self.instructions[j]
        if op == "neg":
            minus_x = Node(self, args[0])
            return self.neg(self.add(minus_x, Node(self, other_args[0]))) if other_op == "neg" else self.sub(y, minus_x)
        if other_op == "neg":
            return self.sub(x, Node(self, other_args[0]))
        if op == "sub" and args[1] == j:  # (a - b) + b
            return Node(self, args[0])
        if other_op == "sub" and other_args[1] == i:
            return Node(self, other_args[0])
        merged = self._merged_constants(x, y)
        if merged is not None:
            return merged
        if i == j and op == "mul" and self.instructions[args[0]][0] == "const":  # c z + c z
            return self._scaled(2.0, x)
        return self._node("add", (i, j) if i <= j else (j, i))

    def sub(self, x: Value, y: Value) -> Value:
        """Return x - y."""
        if not isinstance(y, Node):
            return self.add(x, -y)
        if not isinstance(x, Node):
            if x == 0.0:
                return self.neg(y)
            op, args, _ = self.instructions[y.index]
            if op == "neg":
                return self.add(Node(self, args[0]), x)
            return self._binary("sub", self.constant(x), y)
        if x.index == y.index:
            return 0.0
        (op, args, _), (other_op, other_args, _) = self.instructions[x.index], self.instructions[y.index]
        if other_op == "neg":
            return self.add(x, Node(self, other_args[0]))
        if op == "neg":
            return self.neg(self.add(Node(self, args[0]), y))
        cancelled = self._cancelled(x, y)
        if cancelled is not None:
            return cancelled
        turned = self._interned.get(("sub", (y.index, x.index), None))
        return self._binary("sub", x, y) if turned is None else self.neg(Node(self, turned))

    def _cancelled(self, x: Node, y: Node) -> Value | None:
        """Fold x - y where a summand of one is the other: (a + y) - y, x - (x + b), x - (x - b), (y - b) - y."""
        for one, other, sign in ((x, y.index, 1), (y, x.index, -1)):
            op, args, _ = self.instructions[one.index]
            if op == "add" and other in args:
                rest = Node(self, args[1] if args[0] == other else args[0])
                return rest if sign > 0 else self.neg(rest)
            if op == "sub" and args[0] == other:
                rest = Node(self, args[1])
                return self.neg(rest) if sign > 0 else rest
        return None

    def _merged_constants(self, x: Node, y: Node) -> Value | None:
        """Return x + y with one constant where both bring one."""
        (rest_x, c), (rest_y, d) = self._split_constant(x), self._split_constant(y)
        if c is None or d is None:
            return None
        return self.add(self.add(rest_x, rest_y), c + d)

    def _split_constant(self, x: Node) -> tuple[Value, float | None]:
        """Split x into (rest, constant): a constant itself, c + rest, or c - rest."""
        op, args, leaf = self.instructions[x.index]
        if op == "const":
            return 0.0, leaf
        if op in ("add", "sub"):
            for arg, other in (args, args[::-1]) if op == "add" else (args,):
                kind, _, number = self.instructions[arg]
                if kind == "const":
                    rest = Node(self, other)
                    return (rest if op == "add" else self.neg(rest)), number
        return x, None

    def mul(self, x: Value, y: Value) -> Value:
        """Return x y; signs move outwards, constants inwards."""
        if not isinstance(x, Node):
            x, y = y, x
        if not isinstance(x, Node):
            return x * y
        if not isinstance(y, Node):
            return self._scaled(y, x)
        i, j = x.index, y.index
        (op, args, leaf), (other_op, other_args, other_leaf) = self.instructions[i], self.instructions[j]
        if op == "neg" or other_op == "neg":
            product = self.mul(
                Node(self, args[0]) if op == "neg" else x, Node(self, other_args[0]) if other_op == "neg" else y
            )
            return product if op == other_op else self.neg(product)
        if op == "const":  # c x y: keep the constant where it can meet another one
            return self._scaled(leaf, y)
        if other_op == "const":
            return self._scaled(other_leaf, x)
        return self._node("mul", (i, j) if i <= j else (j, i))

    def div(self, x: Value, y: Value) -> Value:
        """Return x / y."""
        if not isinstance(y, Node):
            return x * (1.0 / y)
        if not isinstance(x, Node):
            if x == 0.0:
                return 0.0
            x = self.constant(x)
        return self._binary("div", x, y)

    def neg(self, x: Value) -> Value:
        """Return -x."""
        if not isinstance(x, Node):
            return -x
        op, args, leaf = self.instructions[x.index]
        if op == "const":
            number: float = leaf
            return -number
        return Node(self, args[0]) if op == "neg" else self._node("neg", (x.index,))

    def _scaled(self, factor: float, x: Node) -> Value:
        if factor == 0.0:
            return 0.0
        if factor < 0.0:
            return self.neg(self._scaled(-factor, x))
        op, args, leaf = self.instructions[x.index]
        if op == "neg":
            return self.neg(self._scaled(factor, Node(self, args[0])))
        if factor == 1.0:
            return x
        if op == "const":
            number: float = leaf
            return factor * number
        if op == "mul":
            kind, _, inner = self.instructions[args[0]]
            if kind == "const":
                return self._scaled(factor * inner, Node(self, args[1]))
        return self._binary("mul", self.constant(factor), x)

    def _binary(self, op: str, x: Node, y: Node) -> Value:
        a, b = self.number(x), self.number(y)
        folded = None if a is None or b is None else self.operations[op].compute(a, b)
        return self._node(op, (x.index, y.index)) if folded is None else folded

    def number(self, x: Node) -> float | None:
        """Return the number of a constant node, or None."""
        op, _, leaf = self.instructions[x.index]
        return to_float(leaf) if op == "const" else None

    def _node(self, op: str, args: tuple[int, ...], leaf: Any = None) -> Node:
        key = (op, args, leaf)
        index = self._interned.get(key)
        if index is None:
            index = self._interned[key] = len(self.instructions)
            self.instructions.append(key)
        return Node(self, index)


@dataclass(frozen=True)
class Program:
    """A finished program: ``outputs`` maps (array, index) to the value written there, in order of writing."""

    name: str
    instructions: tuple[Instruction, ...]
    outputs: Mapping[tuple[str, int], int]
    notes: Mapping[int, str] = field(default_factory=dict)
    operations: Operations = field(default_factory=lambda: OPERATIONS, repr=False, compare=False)

    def count(self) -> dict[str, int]:
        """Count operations of one run up to the gate, if there is one, by their ``cost``; sine and cosine are one."""
        here = list(compress(self.instructions, first_values(self)))
        counts = Counter(self.operations[instruction.op].cost for instruction in here)
        angles = {i.args[0] for i in here if i.op in ANGULAR}
        return {
            "mul": counts["mul"],
            "add": counts["add"],
            "div": counts["div"],
            "sincos": counts["sincos"] + len(angles),
        }

    def inputs(self) -> set[str]:
        """Name the input arrays that are read."""
        return {instruction.leaf[0] for instruction in self.instructions if instruction.op == "input"}


def copied(graph: Graph, program: Program) -> list[Node]:
    """Write a program's values and notes into a graph as they are; their nodes, in the program's order."""
    nodes: list[Node] = []
    for index, (op, args, leaf) in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        nodes.append(graph.insert(op, tuple([nodes[arg].index for arg in args]), leaf))
    return nodes


def first_values(program: Program) -> list[bool]:
    """Say of every value whether it is computed before the gate; all are where there is none."""
    if (GATE, 0) not in program.outputs:
        return [True] * len(program.instructions)
    wanted = {index for (array, _), index in program.outputs.items() if array in (GATE, *FIRST)}
    needs_gate = [False] * len(program.instructions)
    for index, instruction in enumerate(program.instructions):
        gated = instruction.op == "choose" and instruction.args[0] == program.outputs[GATE, 0]
        needs_gate[index] = gated or any(needs_gate[arg] for arg in instruction.args)
    wanted |= {index for key, index in program.outputs.items() if not needs_gate[index]}
    return needed(program.instructions, wanted)


def needed(instructions: Sequence[Written], wanted: Iterable[int]) -> list[bool]:
    """Say of every value whether some of them need it, themselves among them."""
    marked = [False] * len(instructions)
    last = -1
    for index in wanted:
        marked[index] = True
        last = max(last, index)
    for index in range(last, -1, -1):
        if marked[index]:
            for arg in instructions[index][1]:
                marked[arg] = True
    return marked


def reordered(program: Program, order: Sequence[int], notes: Mapping[int, str]) -> Program:
    """Return the program with its values in another order, and with these notes."""
    number = {index: place for place, index in enumerate(order)}
    moved = (program.instructions[index] for index in order)
    instructions = tuple(Instruction(x.op, tuple([number[arg] for arg in x.args]), x.leaf) for x in moved)
    outputs = {key: number[index] for key, index in program.outputs.items()}
    moved_notes = {number[index]: text for index, text in notes.items()}
    return Program(program.name, instructions, outputs, moved_notes, program.operations)


def gate_between(program: Program) -> Program:
    """Put what is computed before the gate in front of what is computed behind it."""
    early = first_values(program)
    if all(early):
        return program
    return reordered(program, sorted(range(len(early)), key=lambda index: not early[index]), program.notes)


def finish(graph: Graph, name: str, outputs: Mapping[tuple[str, int], Value]) -> Program:
    """Finish a graph: the program of what the outputs need, renumbered in order."""
    wanted = {
        key: value.index if isinstance(value, Node) else graph.constant(value).index for key, value in outputs.items()
    }
    return select(name, graph.instructions, wanted, graph.notes, graph.operations)


def select(
    name: str,
    instructions: Sequence[Written],
    outputs: Mapping[tuple[str, int], int],
    notes: Mapping[int, str],
    operations: Operations,
) -> Program:
    """Keep the instructions that the outputs need, renumbered; notes move to the next instruction that stays."""
    alive = needed(instructions, outputs.values())
    staying = list(compress(range(len(alive)), alive))
    renumbered = [-1] * len(alive)
    for place, index in enumerate(staying):
        renumbered[index] = place
    kept, make = list[Instruction](), tuple.__new__  # which takes half the time of Instruction(...)
    for index in staying:
        op, args, leaf = instructions[index]
        kept.append(make(Instruction, (op, tuple([renumbered[arg] for arg in args]), leaf)))
    places = {index: bisect_left(staying, index) for index in sorted(notes)}
    kept_notes = {place: notes[index] for index, place in places.items() if place < len(kept)}
    kept_outputs = {key: renumbered[index] for key, index in outputs.items()}
    return Program(name, tuple(kept), kept_outputs, kept_notes, operations)


def verify(program: Program) -> Program:
    """Check a program's form and return it; a violation is a bug of ours.

    Raises:
        AssertionError: an unknown operation, a wrong number of arguments, an argument that is not defined before, a
            constant that is not finite, or an output that does not exist.
    """
    arities = {name: operation.arity for name, operation in program.operations.items()}
    for index, (op, args, leaf) in enumerate(program.instructions):
        arity = arities.get(op)
        assert arity is not None, f"{program.name}: value {index}, unknown operation {op}"
        assert len(args) == arity, f"{program.name}: value {index}, {op} takes {arity} arguments"
        for arg in args:
            assert 0 <= arg < index, f"{program.name}: value {index} uses a later one"
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
    rounded: Callable[[int, str, Any], Any] | None = None,
) -> dict[tuple[str, int], Any]:
    """Run the program on floats, or on anything that has arithmetic (SymPy expressions, NumPy arrays).

    ``sincos`` and ``calls`` (functions by the names of their operations, which arithmetic does not give) are those of
    its kind; of floats where there are none.  ``rounded`` (index, operation, value) returns what a value is kept as.
    """
    values, turned = list[Any](), dict[int, tuple[Any, Any]]()
    functions = {name: operation.value for name, operation in program.operations.items()} | dict(calls)
    for index, (op, args, leaf) in enumerate(program.instructions):
        if op == "const":
            value = leaf
        elif op == "input":
            value = inputs[leaf[0]][leaf[1]]
        elif op in ANGULAR:
            if args[0] not in turned:
                turned[args[0]] = sincos(values[args[0]])
            value = turned[args[0]][op == "cos"]
        else:
            value = functions[op](*[values[arg] for arg in args])  # type: ignore[misc]  # none of leaves alone
        values.append(value if rounded is None else rounded(index, op, value))
    return {key: values[index] for key, index in program.outputs.items()}


def sine_and_cosine(x: Any) -> tuple[Array, Array]:
    """Return the sines and cosines of x, computed in double precision and rounded to the dtype of x."""
    wide = np.asarray(x, np.float64)
    return np.sin(wide).astype(x.dtype), np.cos(wide).astype(x.dtype)


def evaluate_lanes(
    program: Program,
    inputs: Mapping[str, Any],
    dtype: str,
    *,
    rounding: Array | None = None,
    sincos: SinCos = sine_and_cosine,
) -> dict[str, Array]:
    """Evaluate a program in many states at once.

    Args:
        program: what is evaluated.
        inputs: arrays of the dtype by name, (size, lanes), or (size,) for numbers that are the same in all lanes.
        dtype: "float64" or "float32".
        rounding: factors (rows, lanes) near 1: the result of instruction i is multiplied by row i modulo rows, as if it
            had been rounded less accurately (Monte Carlo arithmetic).  None: results are as they are.
        sincos: function that returns the sines and cosines of an array, in its dtype.

    Returns:
        Arrays (size, lanes) that the program writes, by name, with the dtype.
    """
    lanes = max((np.size(row) for rows in inputs.values() for row in rows[:1]), default=1)
    number, rows = np.dtype(dtype).type, [] if rounding is None else list(rounding.astype(dtype))

    def rounded(index: int, op: str, value: Any) -> Any:
        if op == "const":
            return number(value)
        return value * rows[index % len(rows)] if rows and program.operations[op].error else value

    arrays_of = {name: operation.numpy for name, operation in program.operations.items() if operation.numpy}
    found, sizes = evaluate(program, inputs, sincos, arrays_of, rounded), dict[str, int]()
    for array, place in program.outputs:
        sizes[array] = max(sizes.get(array, 0), place + 1)
    arrays = {array: np.zeros((size, lanes), dtype) for array, size in sizes.items()}
    for (array, place), value in found.items():
        arrays[array][place] = value
    return arrays


def users(program: Program) -> list[int]:
    """Count the uses of each value, outputs included."""
    count = [0] * len(program.instructions)
    for instruction in program.instructions:
        for arg in instruction.args:
            count[arg] += 1
    for index in program.outputs.values():
        count[index] += 1
    return count
