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
from collections.abc import Mapping, Sequence
from heapq import heapify, heappop, heappush
from itertools import compress

from .ir import GATE, Graph, Node, Program, Value, finish, needed, reordered
from .operations import ANGULAR
from .orders import users_of
from .rotations import Rotation, Turned, find_rotations
from .series import Series, convolved, shares, squared

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
        self.program, self.series, self.graph = program, series, Graph(program.operations)
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
        if op in ANGULAR:
            return self._angle(args[0]).upto(k)[op == "cos"]
        if index in self.turned:
            return self._rotated(index, k)
        rule = self.graph.operations[op].taylor
        value: Value = 0.0 if rule is None else rule(self.graph, x, self.values[index], k)
        return value

    def _angle(self, index: int) -> _Angle:
        if index not in self.angles:
            self.angles[index] = _Angle(self.graph, self.values[index])
        return self.angles[index]

    def _rotated(self, index: int, k: int) -> Value:
        """Return a coefficient of the sine or cosine of a moving angle times a value of a pair that it turns."""
        rotation, is_second = self.turned[index]
        if rotation not in self.rotations:
            pair = self.values[rotation.x], self.values[rotation.y]
            self.rotations[rotation] = _Turning(self._angle(rotation.angle), *pair, rotation.sense)
        turn = next(
            i
            for i in map(self.program.instructions.__getitem__, self.program.instructions[index].args)
            if i.op in ANGULAR and i.args[0] == rotation.angle
        )
        fixed = self._angle(rotation.angle).start[turn.op == "cos"]
        return self.graph.mul(fixed, self.rotations[rotation].coefficient(is_second, k))


def _moves(series: Series, order: int) -> bool:
    """Whether any coefficient behind the first, up to an order, is more than a zero."""
    return any(isinstance(x, Node) or x != 0.0 for x in series[1 : order + 1])


class _Angle:
    """Sine and cosine of an angle, and the tangent of half of what it has turned by, as series."""

    def __init__(self, graph: Graph, angle: Series) -> None:
        self.angle = angle
        self.start = graph.sincos(angle[0])
        self._sine, self._cosine = ([x] for x in self.start)
        self._half: list[Value] = [0.0]

    def upto(self, k: int) -> tuple[Value, Value]:
        """Return the coefficients of order k of sine and cosine."""
        for order in range(len(self._sine), k + 1):
            terms = shares(self.angle, order)
            sine, cosine = convolved(terms, self._cosine, order, 1), -convolved(terms, self._sine, order, 1)
            self._sine.append(sine)
            self._cosine.append(cosine)
        return self._sine[k], self._cosine[k]

    def half_tangent(self, k: int) -> Value:
        """Return the coefficient of order k of tau: 2 tau' = (1 + tau^2) q'."""
        tau = self._half
        for order in range(len(tau), k + 1):
            total = float(order) * self.angle[order]
            for i in range(2, order):
                rate = float(order - i) * self.angle[order - i]
                total = total + squared(tau, i) * rate
            tau.append(0.5 / order * total)
        return tau[k]


class _Turning:
    """Series of a pair of values, turned by what an angle has turned by since time 0."""

    def __init__(self, angle: _Angle, x: Series, y: Series, sense: int) -> None:
        self.angle, self.before = angle, (x, y)
        self.behind: tuple[list[Value], list[Value]] = ([x[0]], [y[0]])
        self.senses = (sense, -sense)

    def coefficient(self, which: int, k: int) -> Value:
        """Return the coefficient of order k of X, or of Y where ``which`` is 1; lower ones of both come first."""
        turned = self.behind[which]
        while len(turned) <= k:
            order, other = len(turned), 1 - which
            total = 2.0 * self.angle.half_tangent(order) * self.before[other][0]
            for i in range(1, order):
                both = self.before[other][i] + self.coefficient(other, i)
                total = total + self.angle.half_tangent(order - i) * both
            start = self.before[which][order]
            turned.append(start + total if self.senses[which] > 0 else start - total)
        return turned[k]


def _gathered(program: Program, homes: Sequence[int]) -> Program:
    """Put values as near as their arguments allow to those that were made for the same value of the program before.

    Written order by order, most values would wait for the next order in memory.
    """
    instructions = program.instructions
    waiting = [len(set(instruction.args)) for instruction in instructions]
    users = users_of(program)
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
