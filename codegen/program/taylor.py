"""Time derivatives of finished programs: truncated Taylor series through straight-line code, exact.

Every value x becomes its coefficients x_0, x_1, ..., x = x_0 + x_1 t + x_2 t^2 + ..., and a product becomes a Cauchy
product.  Zeros fold, so that what does not move costs nothing.  Of a maximum the coefficients are those of the larger
one, of the second if both are equal; a choice is made by the values themselves.

Two values x, y that turn by an angle q take no series of sine and cosine.  With (X, Y) the pair turned by q - q_0,

    X - x = sense tau (y + Y),    Y - y = -sense tau (x + X),    tau = tan((q - q_0) / 2),

and the plain rotation by q_0 behind it.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, chapter 13.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from heapq import heapify, heappop, heappush
from itertools import compress

from .ir import GATE, Graph, Node, Program, Value, finish, needed, reordered
from .rotations import Rotation, Turned, find_rotations

Series = list[Value]  # coefficients of powers of time, from that of order 0 on
Rule = Callable[[Graph, Sequence[Series], Series, int], Value]
STAYING = ("pivot", "first_pivot", GATE)  # outputs that say whether there are others


def jet(program: Program, series: Mapping[str, Sequence[str]], order: int, name: str) -> Program:
    """Return the program of the outputs and of their time derivatives up to an order.

    Derivatives of an output array of m numbers stand behind it, m numbers per order.

    Args:
        program: of which all outputs are differentiated but pivots and gates, which stay.
        series: names of the input arrays that move, with those of the arrays of their values and time derivatives, of
            order 0 to ``order``; the others are constant.
        order: 1 or more.
    """
    expansion = _Expansion(program, series)
    for _ in range(order + 1):
        expansion.advance()
    graph, sizes = expansion.graph, _sizes(program)
    outputs: dict[tuple[str, int], Value] = {}
    for k in range(order + 1):
        for (array, place), index in program.outputs.items():
            if array not in STAYING:
                value = graph.mul(float(math.factorial(k)), expansion.values[index][k])
                outputs[array, k * sizes[array] + place] = value
            elif k == 0:
                outputs[array, place] = expansion.values[index][0]
            expansion.settle(index)
    wanted = [value.index for value in outputs.values() if isinstance(value, Node)]
    homes = list(compress(expansion.homes, needed(graph.instructions, wanted)))
    finished = finish(graph, name, outputs)
    return _gathered(finished, homes + [len(program.instructions)] * (len(finished.instructions) - len(homes)))


def _sizes(program: Program) -> dict[str, int]:
    """Return how many numbers each output array has."""
    sizes: dict[str, int] = {}
    for array, place in program.outputs:
        sizes[array] = max(sizes.get(array, 0), place + 1)
    return sizes


class _Expansion:
    """Coefficients of all values of a program, order by order."""

    def __init__(self, program: Program, series: Mapping[str, Sequence[str]]) -> None:
        self.program, self.series, self.graph = program, series, Graph()
        self.values: list[Series] = [[] for _ in program.instructions]
        self.turned: Mapping[int, Turned] = find_rotations(program)
        self.angles: dict[int, _Angle] = {}
        self.rotations: dict[Rotation, _Turning] = {}
        self.homes: list[int] = []  # per value of the graph the one of the program that it was made for

    def advance(self) -> None:
        """Add the coefficients of one order more."""
        order = len(self.values[0]) if self.values else 0
        for index in range(len(self.values)):
            if order == 0 and index in self.program.notes:
                self.graph.note(self.program.notes[index])
            self.values[index].append(self._start(index) if order == 0 else self._coefficient(index, order))
            self.settle(index)

    def settle(self, index: int) -> None:
        """Say that the newest values of the graph were made for this one of the program."""
        self.homes += [index] * (len(self.graph.instructions) - len(self.homes))

    def _start(self, index: int) -> Value:
        """Return the value itself."""
        op, args, leaf = self.program.instructions[index]
        if op == "input" and leaf[0] in self.series:
            return self.graph.input(self.series[leaf[0]][0], leaf[1])
        nodes = [self.values[arg][0] for arg in args]
        places = [(x if isinstance(x, Node) else self.graph.constant(x)).index for x in nodes]
        return self.graph.insert(op, tuple(places), leaf)

    def _coefficient(self, index: int, k: int) -> Value:
        op, args, leaf = self.program.instructions[index]
        if op == "input":
            names = self.series.get(leaf[0])
            return 0.0 if names is None else (1.0 / math.factorial(k)) * self.graph.input(names[k], leaf[1])
        x = [self.values[arg] for arg in args]
        if not any(_moves(series, k) for series in x):
            return 0.0
        if op in ("sin", "cos"):
            return self._angle(args[0]).upto(k)[op == "cos"]
        if index in self.turned:
            return self._rotated(index, k)
        return RULES[op](self.graph, x, self.values[index], k)

    def _angle(self, index: int) -> _Angle:
        if index not in self.angles:
            self.angles[index] = _Angle(self.graph, self.values[index])
        return self.angles[index]

    def _rotated(self, index: int, k: int) -> Value:
        """Return a coefficient of the sine or cosine of a moving angle times a value of a pair that it turns."""
        rotation, is_second = self.turned[index]
        if rotation not in self.rotations:
            pair = self.values[rotation.x], self.values[rotation.y]
            self.rotations[rotation] = _Turning(self.graph, self._angle(rotation.angle), *pair, rotation.sense)
        turn = next(
            i
            for i in map(self.program.instructions.__getitem__, self.program.instructions[index].args)
            if i.op in ("sin", "cos") and i.args[0] == rotation.angle
        )
        fixed = self._angle(rotation.angle).start[turn.op == "cos"]
        return self.graph.mul(fixed, self.rotations[rotation].coefficient(is_second, k))


def _moves(series: Series, order: int) -> bool:
    """Whether any coefficient behind the first, up to an order, is more than a zero."""
    return any(isinstance(x, Node) or x != 0.0 for x in series[1 : order + 1])


def _convolved(graph: Graph, x: Series, y: Series, k: int, first: int = 0, last: int | None = None) -> Value:
    """Return the sum of x_i y_(k - i) for i from first to last, k by default."""
    total: Value = 0.0
    for i in range(first, (k if last is None else last) + 1):
        total = graph.add(total, graph.mul(x[i], y[k - i]))
    return total


def _squared(graph: Graph, x: Series, k: int, first: int = 0) -> Value:
    """Return the sum of x_i x_(k - i) for i from first to k - first."""
    twice: Value = 0.0
    for i in range(first, (k + 1) // 2):
        twice = graph.add(twice, graph.mul(x[i], x[k - i]))
    total = graph.add(twice, twice)
    return graph.add(total, graph.mul(x[k // 2], x[k // 2])) if k % 2 == 0 and k // 2 >= first else total


def _rates(graph: Graph, x: Series, k: int) -> Series:
    """Return i x_i for i up to k: coefficients of t x'."""
    return [graph.mul(float(i), x[i]) for i in range(k + 1)]


def _shares(graph: Graph, x: Series, k: int) -> Series:
    """Return i x_i / k for i up to k: the last one is x_k itself, and whoever needs the others shares them."""
    return [graph.mul(i / k, x[i]) for i in range(k + 1)]


def _product(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    return _squared(graph, x[0], k) if x[0] is x[1] else _convolved(graph, x[0], x[1], k)


def _quotient(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    rest = graph.sub(x[0][k], _convolved(graph, z, x[1], k, 0, k - 1))
    return graph.mul(rest, graph.div(1.0, x[1][0]))


def _root(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    return graph.mul(graph.sub(x[0][k], _squared(graph, z, k, 1)), graph.div(0.5, z[0]))


def _larger(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    gate = graph.call("step", graph.sub(x[0][0], x[1][0]))
    return graph.add(x[1][k], graph.mul(gate, graph.sub(x[0][k], x[1][k])))


def _exponential(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    return _convolved(graph, _shares(graph, x[0], k), z, k, 1)  # t z' = z t x'


def _logarithm(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    lower = _convolved(graph, _rates(graph, z, k - 1), x[0], k, 1, k - 1)  # x t z' = t x'
    return graph.div(graph.sub(x[0][k], graph.mul(1.0 / k, lower)), x[0][0])


def _bearing(graph: Graph, x: Sequence[Series], z: Series, k: int) -> Value:
    """Solve (x^2 + y^2) t z' = x t y' - y t x' for z = atan2(y, x)."""
    y, x_ = x
    squares = [graph.add(_squared(graph, x_, i), _squared(graph, y, i)) for i in range(k)]
    turned = graph.sub(
        _convolved(graph, _rates(graph, y, k), x_, k, 1), _convolved(graph, _rates(graph, x_, k), y, k, 1)
    )
    lower = _convolved(graph, _rates(graph, z, k - 1), squares, k, 1, k - 1)
    return graph.div(graph.mul(1.0 / k, graph.sub(turned, lower)), squares[0])


RULES: Mapping[str, Rule] = {  # of operations with arguments, but for sine and cosine, which have one rule for both
    "neg": lambda g, x, z, k: g.neg(x[0][k]),
    "add": lambda g, x, z, k: g.add(x[0][k], x[1][k]),
    "sub": lambda g, x, z, k: g.sub(x[0][k], x[1][k]),
    "mul": _product,
    "div": _quotient,
    "sqrt": _root,
    "abs": lambda g, x, z, k: g.choose(x[0][0], x[0][k], g.neg(x[0][k])),
    "max": _larger,
    "step": lambda g, x, z, k: 0.0,
    "choose": lambda g, x, z, k: g.choose(x[0][0], x[1][k], x[2][k]),
    "exp": _exponential,
    "log": _logarithm,
    "atan2": _bearing,
}


class _Angle:
    """Sine and cosine of an angle, and the tangent of half of what it has turned by, as series."""

    def __init__(self, graph: Graph, angle: Series) -> None:
        self.graph, self.angle = graph, angle
        self.start = graph.sincos(angle[0])
        self._sine, self._cosine = ([x] for x in self.start)
        self._half: Series = [0.0]

    def upto(self, k: int) -> tuple[Value, Value]:
        """Return the coefficients of order k of sine and cosine."""
        for order in range(len(self._sine), k + 1):
            shares = _shares(self.graph, self.angle, order)
            sine = _convolved(self.graph, shares, self._cosine, order, 1)
            cosine = self.graph.neg(_convolved(self.graph, shares, self._sine, order, 1))
            self._sine.append(sine)
            self._cosine.append(cosine)
        return self._sine[k], self._cosine[k]

    def half_tangent(self, k: int) -> Value:
        """Return the coefficient of order k of tau: 2 tau' = (1 + tau^2) q'."""
        graph, tau = self.graph, self._half
        for order in range(len(tau), k + 1):
            total = graph.mul(float(order), self.angle[order])
            for i in range(2, order):
                rate = graph.mul(float(order - i), self.angle[order - i])
                total = graph.add(total, graph.mul(_squared(graph, tau, i), rate))
            tau.append(graph.mul(0.5 / order, total))
        return tau[k]


class _Turning:
    """Series of a pair of values, turned by what an angle has turned by since time 0."""

    def __init__(self, graph: Graph, angle: _Angle, x: Series, y: Series, sense: int) -> None:
        self.graph, self.angle, self.before = graph, angle, (x, y)
        self.behind: tuple[Series, Series] = ([x[0]], [y[0]])
        self.senses = (sense, -sense)

    def coefficient(self, which: int, k: int) -> Value:
        """Return the coefficient of order k of X, or of Y where ``which`` is 1; lower ones of both come first."""
        graph, turned = self.graph, self.behind[which]
        while len(turned) <= k:
            order, other = len(turned), 1 - which
            total = graph.mul(graph.mul(2.0, self.angle.half_tangent(order)), self.before[other][0])
            for i in range(1, order):
                both = graph.add(self.before[other][i], self.coefficient(other, i))
                total = graph.add(total, graph.mul(self.angle.half_tangent(order - i), both))
            add = graph.add if self.senses[which] > 0 else graph.sub
            turned.append(add(self.before[which][order], total))
        return turned[k]


def _gathered(program: Program, homes: Sequence[int]) -> Program:
    """Put values as near as their arguments allow to those that were made for the same value of the program before.

    Written order by order, most values would wait for the next order in memory.
    """
    instructions = program.instructions
    waiting = [len(set(instruction.args)) for instruction in instructions]
    users: list[list[int]] = [[] for _ in instructions]
    for index, instruction in enumerate(instructions):
        for arg in set(instruction.args):
            users[arg].append(index)
    ready = [(homes[index], index) for index, count in enumerate(waiting) if count == 0]
    heapify(ready)
    order: list[int] = []
    while ready:
        _, index = heappop(ready)
        order.append(index)
        for user in users[index]:
            waiting[user] -= 1
            if waiting[user] == 0:
                heappush(ready, (homes[user], user))
    return reordered(program, order, program.notes)
