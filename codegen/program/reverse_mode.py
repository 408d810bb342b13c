"""Gradients of finished programs: reverse differentiation of straight-line code, exact.

Behind the program stands its reverse sweep: every value x gets the derivative of the outputs' weighted sum by x, from
the values that use it.  That differentiated forward, in all directions at once, gives second derivatives.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, sections 3.2, 4.6 and 5.1.
"""

from __future__ import annotations

from collections.abc import Mapping

from .forward_mode import gradients, local_slopes
from .ir import ASIDE, Graph, Node, Program, Value, copied, finish


def adjoint(program: Program, seed: str, wanted: Mapping[str, int], name: str) -> Program:
    """Return the program of the gradient of sum_i seed_i out_i.

    Args:
        program: of which all outputs are weighted but pivots, which only say whether there are others.
        seed: name of the input array of weights, one for each output.
        wanted: names of the input arrays that the gradient is taken by, with their lengths; their derivatives are
            written one array behind the other.
    """
    graph = Graph(program.operations)
    values = copied(graph, program)
    by_value: dict[int, Value] = {}
    for key, index in program.outputs.items():
        if key[0] not in ASIDE:
            here = values[index].index
            by_value[here] = by_value.get(here, 0.0) + graph.input(seed, key[1])
    graph.note("reverse sweep")
    _sweep(graph, max(node.index for node in values), by_value)
    outputs: dict[tuple[str, int], Value] = {("out", i): 0.0 for i in range(sum(wanted.values()))}
    begins = {array: sum(list(wanted.values())[:k]) for k, array in enumerate(wanted)}
    for index, slope in by_value.items():
        op, _, leaf = graph.instructions[index]
        array, place = leaf if op == "input" else ("", 0)
        if place < wanted.get(array, 0):
            outputs["out", begins[array] + place] = slope
    outputs |= {key: values[index] for key, index in program.outputs.items() if key[0] == "pivot"}
    return finish(graph, name, outputs)


def hessian(first: Program, wanted: Mapping[str, int], name: str) -> Program:
    """Return the program of the second derivatives of sum_i seed_i out_i, a symmetric matrix, row by row.

    Args:
        first: the program of its first derivatives, which ``adjoint`` makes.
    """
    graph = Graph(first.operations)
    values = copied(graph, first)
    inputs = [graph.input(array, place) for array, size in wanted.items() for place in range(size)]
    slopes: list[Value] = [values[first.outputs["out", i]] for i in range(len(inputs))]
    rows = gradients(graph, slopes, inputs)
    outputs: dict[tuple[str, int], Value] = {}
    for i in range(len(inputs)):
        for j in range(len(inputs)):  # slopes by arrays further behind are shorter, and so are their derivatives
            outputs["out", i * len(inputs) + j] = rows[max(i, j)][min(i, j)]
    outputs |= {key: values[index] for key, index in first.outputs.items() if key[0] == "pivot"}
    return finish(graph, name, outputs)


def gradient(graph: Graph, value: Value) -> dict[tuple[str, int], Value]:
    """Differentiate a value of a graph by all inputs, by arrays and places; written behind it in the same graph."""
    if not isinstance(value, Node):
        return {}
    by_value: dict[int, Value] = {value.index: 1.0}
    _sweep(graph, value.index, by_value)
    leaves = ((*graph.instructions[index], slope) for index, slope in by_value.items())
    return {leaf: slope for op, _, leaf, slope in leaves if op == "input"}


def _sweep(graph: Graph, last: int, by_value: dict[int, Value]) -> None:
    """Hand derivatives of the weighted sum on, from the last value to the first: what a value has, to its arguments."""
    for index in range(last, -1, -1):
        here = by_value.get(index, 0.0)
        if isinstance(here, Node) or here != 0.0:
            for arg, slope in local_slopes(graph, index).items():
                by_value[arg] = by_value.get(arg, 0.0) + here * slope
