"""Derivatives of finished programs along a direction: forward differentiation of straight-line code, exact.

Every value x gets a rate dx by the chain rule, and the outputs become their rates.  Where two values meet in a maximum
the rate is that of the larger one, of the first if they are equal.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, section 3.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .ir import Graph, Instruction, Node, Program, Value, finish
from .operations import OPERATIONS


def tangent(program: Program, rates: Mapping[str, str], name: str) -> Program:
    """The program of the outputs' rates.

    Args:
        program: of which all outputs are differentiated.
        rates: names of the input arrays that move, with the name of the input array of their rates.
        name: of the program that is made.
    """
    graph = Graph()
    values: list[Node] = []
    moving: list[Value] = []
    for index, instruction in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        args = tuple(values[arg].index for arg in instruction.args)
        values.append(graph.insert(instruction.op, args, instruction.leaf))
        moving.append(_rate(graph, instruction, values, moving, rates))
    return finish(graph, name, {key: moving[index] for key, index in program.outputs.items()})


def partials(graph: Graph, values: Sequence[Value], inputs: Sequence[Value]) -> list[list[Value]]:
    """Derivatives of values of a graph by its inputs, a row per value; what depends on no input costs nothing.

    Args:
        graph: where they are, and where the derivatives go.
        values: any of its values.
        inputs: of its inputs; numbers among them move nothing.
    """
    wanted = {value.index for value in values if isinstance(value, Node)}
    for index in range(max(wanted, default=-1), -1, -1):
        if index in wanted:
            wanted.update(graph.instructions[index].args)
    order = sorted(wanted)
    columns = [_moved(graph, order, x.index) if isinstance(x, Node) else {} for x in inputs]
    return [[moved.get(v.index, 0.0) if isinstance(v, Node) else 0.0 for moved in columns] for v in values]


def _moved(graph: Graph, order: Sequence[int], moving: int) -> dict[int, Value]:
    """Derivatives by one input of those of the values that depend on it."""
    found: dict[int, Value] = {moving: 1.0}
    for index in order:
        instruction = graph.instructions[index]
        dx = [found.get(arg, 0.0) for arg in instruction.args]
        derivative = OPERATIONS[instruction.op].rate
        if derivative is not None and any(isinstance(rate, Node) or rate != 0.0 for rate in dx):
            found[index] = derivative(graph, [Node(graph, arg) for arg in instruction.args], Node(graph, index), dx)
    return found


def _rate(
    graph: Graph, instruction: Instruction, values: list[Node], moving: list[Value], rates: Mapping[str, str]
) -> Value:
    """Rate of the newest value, by those of its arguments."""
    op, this = instruction.op, values[-1]
    if op == "input":
        array, place = instruction.leaf
        return graph.input(rates[array], place) if array in rates else 0.0
    x = [values[arg] for arg in instruction.args]
    dx = [moving[arg] for arg in instruction.args]
    derivative = OPERATIONS[op].rate
    if derivative is None or not any(isinstance(rate, Node) or rate != 0.0 for rate in dx):
        return 0.0
    found: Value = derivative(graph, x, this, dx)
    return found
