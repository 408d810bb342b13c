"""Christoffel symbols of large robots as one program of straight statements: C at unit velocities, as their C takes it.

C(q, v) is linear in v, so column k of the tensor is C at the unit velocity k.  Here these velocities are put into the
program of C(q, v), and what has to be 0 or one of its own arguments by them is left out, but nothing is put together in
another order: numbers stay those of the C to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.robot.model import Model

from ..joint.zeros import zero_map
from ..program.ir import Graph, Node, Program, Value, finish


def christoffel_by_columns(name: str, model: Model, columns: Program) -> Program:
    """Write the tensor by a program of the Coriolis matrix, one copy of it at every unit velocity.

    What vanishes only by an identity is 0, as in C, and not its round-off.
    """
    graph, n = Graph(), len(model.coordinates)
    survives = zero_map(model).christoffel.mask.reshape(n * n, n)
    outputs: dict[tuple[str, int], Value] = {}
    for k in range(n):
        values = _at_velocity(graph, columns, [float(i == k) for i in range(n)])
        for ij in range(n * n):
            outputs["out", ij * n + k] = values[columns.outputs["out", ij]] if survives[ij, k] else 0.0
    return finish(graph, name, dict(sorted(outputs.items())))


def _at_velocity(graph: Graph, program: Program, velocity: Sequence[float]) -> list[Value]:
    """Write a program's values into a graph, of which those that are 0 or 1 by the velocity are numbers."""
    values: list[Value] = []
    for op, args, leaf in program.instructions:
        if op == "input" and leaf[0] == "v":
            values.append(velocity[leaf[1]])
        elif op in ("input", "const"):
            values.append(graph.insert(op, (), leaf))
        else:
            values.append(_exact(graph, op, [values[arg] for arg in args]))
    return values


def _exact(graph: Graph, op: str, args: Sequence[Value]) -> Value:
    """Write an operation; where arguments are 0, 1 or -1, leave out what changes no bit but the sign of a zero."""
    first, last = args[0], args[-1]
    if op == "neg" and not isinstance(first, Node):
        return -first
    if op == "mul":
        for one, other in ((first, last), (last, first)):
            if one in (0.0, 1.0):
                return other if one == 1.0 else 0.0
            if one == -1.0:
                return _exact(graph, "neg", [other])
    elif op == "add" and 0.0 in (first, last):
        return last if first == 0.0 else first
    elif op == "sub" and 0.0 in (first, last):
        return first if last == 0.0 else _exact(graph, "neg", [last])
    elif op == "div" and first == 0.0:
        return 0.0
    return _inserted(graph, op, args)


def _inserted(graph: Graph, op: str, args: Sequence[Value]) -> Node:
    """Write an operation as it is."""
    nodes = [x if isinstance(x, Node) else graph.constant(x) for x in args]
    return graph.insert(op, tuple(x.index for x in nodes))
