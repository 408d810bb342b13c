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

from .ir import GATE, Graph, Instruction, Node, Program, Value, finish, needed


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
    moving: list[Value] = []
    for index, instruction in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        args = tuple(values[arg].index for arg in instruction.args)
        values.append(graph.insert(instruction.op, args, instruction.leaf))
        still = instruction.op == "input" and instruction.leaf[1] >= lengths.get(instruction.leaf[0], math.inf)
        moving.append(0.0 if still else _rate(graph, instruction, values, moving, rates))
    outputs: dict[tuple[str, int], Value] = {}
    for key, index in program.outputs.items():
        if key[0] in ("pivot", "first_pivot", GATE):
            outputs[key] = values[index]
        else:
            outputs[key] = moving[index]
    return finish(graph, name, outputs)


def local_slopes(graph: Graph, index: int) -> dict[int, Value]:
    """Differentiate a value of a graph by its arguments, by their indices."""
    op, args, _ = graph.instructions[index]
    derivative = graph.operations[op].rate
    if derivative is None:
        return {}
    x, y = [Node(graph, arg) for arg in args], Node(graph, index)
    return {arg: derivative(graph, x, y, [float(other == arg) for other in args]) for arg in args}


def gradients(graph: Graph, values: Sequence[Value], inputs: Sequence[Node]) -> list[list[Value]]:
    """Differentiate values by inputs of the same graph, (values, inputs), written behind them.

    What many of the derivatives share is written once.
    """
    wanted = needed(graph.instructions, [value.index for value in values if isinstance(value, Node)])
    order, columns = [index for index, is_needed in enumerate(wanted) if is_needed], []
    for moved in inputs:
        rates: dict[int, Value] = {moved.index: 1.0}
        for index in order:
            op, args, _ = graph.instructions[index]
            derivative = graph.operations[op].rate
            if derivative is None or not any(arg in rates for arg in args):
                continue
            x = [Node(graph, arg) for arg in args]
            rate: Value = derivative(graph, x, Node(graph, index), [rates.get(arg, 0.0) for arg in args])
            if isinstance(rate, Node) or rate != 0.0:
                rates[index] = rate
        columns.append([rates.get(value.index, 0.0) if isinstance(value, Node) else 0.0 for value in values])
    return [[column[place] for column in columns] for place in range(len(values))]  # rows without inputs, too


def _rate(
    graph: Graph, instruction: Instruction, values: list[Node], moving: list[Value], rates: Mapping[str, str]
) -> Value:
    """Return the rate of the newest value, by those of its arguments."""
    op, this = instruction.op, values[-1]
    if op == "input":
        array, place = instruction.leaf
        return graph.input(rates[array], place) if array in rates else 0.0
    x = [values[arg] for arg in instruction.args]
    dx = [moving[arg] for arg in instruction.args]
    derivative = graph.operations[op].rate
    if derivative is None or not any(isinstance(rate, Node) or rate != 0.0 for rate in dx):
        return 0.0
    slope: Value = derivative(graph, x, this, dx)
    return slope
