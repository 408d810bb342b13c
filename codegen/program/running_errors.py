"""Programs with bounds of their rounding errors: behind every value, how far rounding has moved it at most.

A value is either within k units u of its own size, where k is a number known here (inputs, sines, products and
quotients of such values), or within u e, where the program computes e >= 0.  Bounds are of the value as it is computed,
first and second order in u, and rounding of the bounds themselves is in a factor at the end; so they hold whether
products are fused with sums or not.  Bounds use no product that only sums take, so that a compiler fuses the same ones
as without them.  Underflow is taken into account where what comes behind enlarges it less than 1 / u times.
A bound that is infinite or no number says that there is none: of quotients whose divisor may be 0.

Source: N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM 2002, section 3.3.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .ir import Graph, Node, Program, Value, finish

UNITS: Mapping[str, float] = {"float64": 2.0**-53, "float32": 2.0**-24}  # largest relative error of an operation
SMALLEST: Mapping[str, float] = {"float64": 2.0**-1022, "float32": 2.0**-126}  # normal numbers
TURNED = 5.01  # units of a sine or cosine: 2.5 in the last place, as of clib/lanes.h
CALLED = 4.01  # units of an exponential function, logarithm or angle: 2 in the last place of C libraries
ABOVE = 1.001  # times u: for what a bound is compared by, more than its own rounding


class Error(NamedTuple):
    """Bound of a value's rounding error.

    Attributes:
        units: so many times u of the value's size, where that is known; 0 for exact values.
        size: else the bound by u.
        steps: roundings of the bound's own computation, each by a factor of 1 + u at most.
    """

    units: float | None
    size: Value = 0.0
    steps: int = 0


EXACT = Error(0.0)


@dataclass
class _Bounds:
    """Bounds of the values of a graph, by their indices."""

    graph: Graph
    unit: float
    least: float
    narrow: bool

    def __post_init__(self) -> None:
        self.errors: dict[int, Error] = {}
        self.sizes: dict[int, Value] = {}
        self.widened: dict[int, Value] = {}

    def magnitude(self, x: Node) -> Value:
        """Return |x|; of a product from its factors, so that a sum may take it before it is rounded."""
        op, args, leaf = self.graph.instructions[x.index]
        if op == "const":
            return abs(float(leaf))
        if op in ("sqrt", "exp", "step", "abs"):
            return x
        if op == "neg":
            return self.magnitude(Node(self.graph, args[0]))
        if op == "mul" and args[0] == args[1]:
            return x
        if x.index not in self.sizes:
            if op == "mul":
                one, other = (self.magnitude(Node(self.graph, arg)) for arg in args)
                self.sizes[x.index] = self.graph.mul(one, other)
            else:
                self.sizes[x.index] = self.graph.call("abs", x)
        return self.sizes[x.index]

    def size(self, x: Node) -> tuple[Value, int]:
        """Return the bound of x by u, and its steps."""
        error = self.errors[x.index]
        if error.units is None:
            return error.size, error.steps
        if error.units == 0.0:
            return 0.0, 0
        return error.units * self.magnitude(x), 2

    def of(self, x: Node) -> Error:
        """Return the bound of the next value, by those of its arguments."""
        op, args, leaf = self.graph.instructions[x.index]
        if op == "const":
            return EXACT if not self.narrow or _is_narrow(float(leaf)) else Error(1.0)
        nodes = [Node(self.graph, arg) for arg in args]
        errors = [self.errors[arg] for arg in args]
        rule = RULES.get(op)
        return EXACT if rule is None else rule(self, x, nodes, errors)

    def absolute(self, size: Value, steps: int) -> Error:
        """Return the bound by u; exact where it is 0."""
        return EXACT if not isinstance(size, Node) and size == 0.0 else Error(None, size, steps)

    def compound(self, *units: float) -> Error:
        """Return the bound of a product of values within so many units."""
        total = math.fsum(math.log1p(k * self.unit) for k in units)
        return Error(math.expm1(total) / self.unit * (1.0 + 2.0**-40) if any(units) else 0.0)

    def beyond(self, x: Node) -> Value:
        """Return |x| less than its error: more than 0 where its sign is sure."""
        return self.graph.sub(self.magnitude(x), self.graph.mul(ABOVE * self.unit, self.size(x)[0]))

    def at_least(self, x: Node) -> Value:
        """Return a bound of |x| from below, more than 0."""
        return self.graph.call("max", self.beyond(x), self.least)

    def where_unsure(self, x: Node, sure: Value, unsure: Value) -> Value:
        """Return ``unsure`` where x may have another sign than it has or is not bounded, else ``sure``."""
        g = self.graph
        vanishes = g.sub(self.least, self.size(x)[0])
        return g.choose(self.beyond(x), sure, g.choose(vanishes, sure, unsure))


def with_errors(program: Program, name: str, dtype: str) -> Program:
    """Return a program of the same results, to the bit, and behind them bounds of their rounding errors.

    Inputs are exact, and so are constants but those that ``dtype`` cannot hold.

    Args:
        program: without pivots and gates.
    """
    assert all(array == "out" for array, _ in program.outputs), f"{program.name} has outputs that are no results"
    graph, size = Graph(), 1 + max(place for _, place in program.outputs)
    bounds = _Bounds(graph, UNITS[dtype], SMALLEST[dtype], dtype == "float32")
    nodes: list[Node] = []
    for index, (op, args, leaf) in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        node = graph.insert(op, tuple([nodes[arg].index for arg in args]), leaf)
        nodes.append(node)
        if node.index not in bounds.errors:
            bounds.errors[node.index] = bounds.of(node)
    outputs: dict[tuple[str, int], Value] = {key: nodes[index] for key, index in program.outputs.items()}
    floor = bounds.least * len(program.instructions)
    for (array, place), index in program.outputs.items():
        found, steps = bounds.size(nodes[index])
        rounded = bounds.unit * (1.0 + 1.01 * (steps + 4) * bounds.unit)
        is_exact = not isinstance(found, Node) and found == 0.0
        outputs[array, size + place] = 0.0 if is_exact else graph.add(graph.mul(rounded, found), floor)
    return finish(graph, name, outputs)


def _is_narrow(number: float) -> bool:
    """Whether float32 holds a number."""
    try:
        return bool(struct.unpack("f", struct.pack("f", number))[0] == number)
    except OverflowError:
        return False


def _is_power_of_two(graph: Graph, x: Node) -> bool:
    number = graph.number(x)
    return number is not None and number != 0.0 and abs(math.frexp(number)[0]) == 0.5


def _whole(units: float) -> int:
    """Return steps of a factor of 1 + units u."""
    return math.ceil(units)


def _same(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    return errors[0]


def _sum(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    if all(error.units == 0.0 for error in errors):
        return Error(1.0)
    (one, s), (other, t) = (b.size(arg) for arg in args)
    return Error(None, b.graph.add(b.graph.add(one, other), b.magnitude(x)), max(s, t) + 2)


def _product(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    g = b.graph
    pairs = list(zip(args, errors, strict=True))
    if pairs[0][1].units is None or _is_power_of_two(g, args[1]):
        pairs.reverse()
    (first, one), (second, other) = pairs
    if _is_power_of_two(g, first) and one.units == 0.0:
        if other.units is not None:
            return other
        return Error(None, g.mul(b.magnitude(first), other.size), other.steps)
    if one.units is not None and other.units is not None:
        return b.compound(1.0, one.units, other.units)
    if one.units is not None:
        inner = g.add(g.mul(one.units + 1.0, b.magnitude(second)), other.size)
        return Error(None, g.mul(b.magnitude(first), inner), max(1, other.steps + _whole(one.units)) + 4)
    if first.index in b.widened:  # the size of the second factor is widened by its error
        (first, one), (second, other) = (second, other), (first, one)
    if second.index not in b.widened:
        b.widened[second.index] = g.add(b.magnitude(second), g.mul(b.unit, other.size))
    by_second = g.mul(b.magnitude(first), g.add(b.magnitude(second), other.size))
    by_first = g.mul(one.size, b.widened[second.index])
    return Error(None, g.add(by_second, by_first), one.steps + other.steps + 6)


def _quotient(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    g, (above, below) = b.graph, args
    over, under = errors
    quotient = b.magnitude(x)
    if under.units is not None:
        if over.units is not None:
            return b.compound(1.0, over.units, under.units / (1.0 - under.units * b.unit))
        share = g.div(over.size, b.magnitude(below))
        total = g.add(share, g.mul(under.units + 1.0, quotient))
        return Error(None, total, over.steps + 2 * _whole(under.units) + 5)
    size, steps = b.size(above)
    moved = g.div(g.add(size, g.mul(quotient, under.size)), b.at_least(below))
    return Error(None, g.add(moved, quotient), max(steps, under.steps) + 7)


def _root(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    (error,) = errors
    if error.units is not None:
        return b.compound(1.0, 0.5 * ABOVE * error.units)
    size, least = error.size, b.least**0.5
    moved = b.graph.mul(b.unit**0.5 / ABOVE, b.graph.call("sqrt", size))
    below = b.graph.call("max", b.graph.call("max", x, moved), least)
    return Error(None, b.graph.add(b.graph.div(size, below), x), error.steps + 5)


def _larger(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    for error, other in zip(errors, reversed(args), strict=True):
        if error.units is not None and b.graph.number(other) == 0.0:
            return error
    (one, s), (other_size, t) = (b.size(arg) for arg in args)
    return b.absolute(b.graph.add(one, other_size), max(s, t) + 1)  # a maximum would forget what is no number


def _step(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    if errors[0].units is not None:
        return EXACT
    return Error(None, b.where_unsure(args[0], 0.0, 1.0 / b.unit), 0)


def _chosen(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    g, (gate, one, other) = b.graph, args
    (first, s), (second, t) = b.size(one), b.size(other)
    taken, steps = g.choose(gate, first, second), max(s, t) + 4
    if errors[0].units is not None:
        return b.absolute(taken, steps)
    apart = g.call("abs", g.sub(one, other))
    either = g.add(g.add(first, second), g.mul(1.0 / b.unit, apart))
    return b.absolute(b.where_unsure(gate, taken, either), steps)


def _turn(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    if errors[0].units == 0.0:
        return Error(TURNED)
    size, steps = b.size(args[0])
    return Error(None, b.graph.add(size, b.graph.mul(TURNED, b.magnitude(x))), max(steps, 1) + 1)


def _exponential(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    if errors[0].units == 0.0:
        return Error(CALLED)
    g, (size, steps) = b.graph, b.size(args[0])
    grown = g.mul(size, g.call("exp", g.mul(ABOVE * b.unit, size)))
    return Error(None, g.mul(x, g.add(grown, CALLED)), steps + 12)


def _logarithm(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    if errors[0].units == 0.0:
        return Error(CALLED)
    g, (size, steps) = b.graph, b.size(args[0])
    own = g.mul(CALLED, b.magnitude(x))
    return Error(None, g.add(g.div(size, b.at_least(args[0])), own), steps + 6)


def _angle(b: _Bounds, x: Node, args: Sequence[Node], errors: Sequence[Error]) -> Error:
    """Return the bound of the angle of a point (x[1], x[0]); 1.58 > pi/2 is the arc over its chord."""
    g = b.graph
    (one, s), (other, t) = (b.size(arg) for arg in args)
    moved = g.add(one, other)
    far = g.call("max", b.magnitude(args[0]), b.magnitude(args[1]))
    left = g.call("max", g.sub(far, g.mul(ABOVE * b.unit, moved)), b.least)
    size = g.add(g.div(g.mul(1.58, moved), left), g.mul(CALLED, b.magnitude(x)))
    cut = g.choose(b.beyond(args[0]), 0.0, 6.2832 / b.unit)  # across the negative axis, where 0 has signs, too
    return Error(None, g.add(size, g.choose(args[1], 0.0, cut)), max(s, t) + 9)


Rule = Callable[[_Bounds, Node, Sequence[Node], Sequence[Error]], Error]
RULES: Mapping[str, Rule] = {
    "neg": _same,
    "abs": _same,
    "sin": _turn,
    "cos": _turn,
    "add": _sum,
    "sub": _sum,
    "mul": _product,
    "div": _quotient,
    "sqrt": _root,
    "max": _larger,
    "step": _step,
    "choose": _chosen,
    "exp": _exponential,
    "log": _logarithm,
    "atan2": _angle,
}
