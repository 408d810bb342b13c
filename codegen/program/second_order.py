"""Second derivatives of finished programs: forward differentiation, in all directions at once, of a reverse sweep.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, section 5.1.
"""

from __future__ import annotations

from collections.abc import Mapping

from .forward_mode import gradients
from .ir import Graph, Program, Value, copied, finish


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
