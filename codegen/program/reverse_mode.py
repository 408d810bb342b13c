"""Gradients of finished programs: reverse differentiation of straight-line code, exact.

Behind the program stands its reverse sweep: every value x gets the derivative of the outputs' weighted sum by x, from
the values that use it.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, sections 3.2 and 4.6.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .ir import Graph, Instruction, Node, Program, Value, finish
from .operations import OPERATIONS


def adjoint(program: Program, seed: str, wanted: Mapping[str, int], name: str) -> Program:
    """The program of the gradient of sum_i seed_i out_i.

    Args:
        program: of which all outputs are weighted but pivots, which only say whether there are others.
        seed: name of the input array of weights, one for each output.
        wanted: names of the input arrays that the gradient is taken by, with their lengths; their derivatives are
            written one array behind the other.
        name: of the program that is made.
    """
    graph = Graph()
    values: list[Node] = []
    for index, instruction in enumerate(program.instructions):
        if index in program.notes:
            graph.note(program.notes[index])
        args = tuple(values[arg].index for arg in instruction.args)
        values.append(graph.insert(instruction.op, args, instruction.leaf))
    weights = {key: graph.input(seed, key[1]) for key in program.outputs if key[0] != "pivot"}
    found = _swept(graph, program, values, weights)
    places = {array: sum(list(wanted.values())[:k]) for k, array in enumerate(wanted)}
    outputs: dict[tuple[str, int], Value] = {("out", i): 0.0 for i in range(sum(wanted.values()))}
    for index, instruction in enumerate(program.instructions):
        array, place = instruction.leaf if instruction.op == "input" else ("", 0)
        if place < wanted.get(array, 0):
            outputs["out", places[array] + place] = found[index]
    outputs |= {key: values[index] for key, index in program.outputs.items() if key[0] == "pivot"}
    return finish(graph, name, outputs)


def _swept(
    graph: Graph, program: Program, values: Sequence[Node], weights: Mapping[tuple[str, int], Value]
) -> list[Value]:
    """Derivative of the weighted sum by every value of the program."""
    found: list[Value] = [0.0] * len(program.instructions)
    for key, weight in weights.items():
        index = program.outputs[key]
        found[index] = found[index] + weight
    graph.note("reverse sweep")
    for index in range(len(program.instructions) - 1, -1, -1):
        here, instruction = found[index], program.instructions[index]
        if not isinstance(here, Node) and here == 0.0:
            continue
        for arg, part in zip(instruction.args, _parts(graph, instruction, values, index, here), strict=True):
            found[arg] = found[arg] + part
    return found


def _parts(graph: Graph, instruction: Instruction, values: Sequence[Node], index: int, here: Value) -> list[Value]:
    """Hand on what a value has to each of its arguments, by the transpose of its rate, which is linear."""
    x, rate = [values[arg] for arg in instruction.args], OPERATIONS[instruction.op].rate
    if rate is None:
        return [0.0] * len(x)
    units = [[float(i == k) for i in range(len(x))] for k in range(len(x))]
    return [here * rate(graph, x, values[index], unit) for unit in units]
