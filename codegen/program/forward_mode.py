"""Derivatives of finished programs along a direction: forward differentiation of straight-line code, exact.

Every value x gets a rate dx by the chain rule, and the outputs become their rates.  Where two values meet in a maximum
the rate is that of the larger one, of the second if they are equal: of max(x, 0) at x = 0 that of 0, as ``step`` has
it in formulas that are differentiated by hand.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, section 3.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from .ir import GATE, Graph, Node, Program, Value, finish, needed


def tangent(
    program: Program, rates: Mapping[str, str], name: str, lengths: Mapping[str, int] = MappingProxyType({})
) -> Program:
    """Return the program of the outputs' rates.

    Args:
        program: of which all outputs are differentiated but pivots, which say whether there are others, and stay.
        rates: names of the input arrays that move, with the name of the input array of their rates.
        lengths: of the first numbers of arrays that move, where others do not.
    """
    graph = Graph(program.operations)
    values: list[Node] = []
    moving: dict[int, Value] = {}
    for index, (op, args, leaf) in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        value = graph.insert(op, tuple(values[arg].index for arg in args), leaf)
        values.append(value)
        if op != "input":
            _move(graph, value.index, moving)
        elif leaf[0] in rates and leaf[1] < lengths.get(leaf[0], math.inf):
            moving[value.index] = graph.input(rates[leaf[0]], leaf[1])
    outputs: dict[tuple[str, int], Value] = {}
    for key, index in program.outputs.items():
        if key[0] in ("pivot", "first_pivot", GATE):
            outputs[key] = values[index]
        else:
            outputs[key] = moving.get(values[index].index, 0.0)
    return finish(graph, name, outputs)


def _rate(graph: Graph, index: int, rates: Mapping[int, Value]) -> Value:
    """Return the rate of a value of a graph by those of its arguments, 0 where there is none."""
    op, args, _ = graph.instructions[index]
    rule = graph.operations[op].rate
    if rule is None or rates.keys().isdisjoint(args):
        return 0.0
    dx = [rates.get(arg, 0.0) for arg in args]
    rate: Value = rule(graph, [Node(graph, arg) for arg in args], Node(graph, index), dx)
    return rate


def _move(graph: Graph, index: int, rates: dict[int, Value]) -> None:
    """Add the rate of a value to those of its arguments, if it has one."""
    rate = _rate(graph, index, rates)
    if isinstance(rate, Node) or rate != 0.0:
        rates[index] = rate


def local_slopes(graph: Graph, index: int) -> dict[int, Value]:
    """Differentiate a value of a graph by its arguments, by their indices."""
    return {arg: _rate(graph, index, {arg: 1.0}) for arg in graph.instructions[index][1]}


def gradients(graph: Graph, values: Sequence[Value], inputs: Sequence[Node]) -> list[list[Value]]:
    """Differentiate values by inputs of the same graph, (values, inputs), written behind them.

    What many of the derivatives share is written once.
    """
    wanted = needed(graph.instructions, [value.index for value in values if isinstance(value, Node)])
    order, columns = [index for index, is_needed in enumerate(wanted) if is_needed], []
    for moved in inputs:
        rates: dict[int, Value] = {moved.index: 1.0}
        for index in order:
            _move(graph, index, rates)
        columns.append([rates.get(value.index, 0.0) if isinstance(value, Node) else 0.0 for value in values])
    return [[column[place] for column in columns] for place in range(len(values))]  # rows without inputs, too
