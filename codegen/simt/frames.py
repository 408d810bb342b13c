"""Jacobians of all frames as one program, each operation as ``clib/kinematics.h`` has it: none folds into another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eomgen.robot.model import Model

from ..kernels.bodies import jacobian_columns
from ..kernels.derivation import vector
from ..program.ir import Graph, Node, Program, Value, copied, finish

ZERO = 0.0


@dataclass(frozen=True)
class _Kept:
    """A value whose arithmetic is written as it stands; only zeros vanish, which changes no bits but a zero's sign."""

    graph: Graph
    value: Value

    def __add__(self, other: Any) -> _Kept:
        return self._both("add", other)

    def __radd__(self, other: Any) -> _Kept:
        return self._both("add", other)

    def __sub__(self, other: Any) -> _Kept:
        return self._both("sub", other)

    def __mul__(self, other: Any) -> _Kept:
        return self._both("mul", other)

    def _both(self, op: str, other: Any) -> _Kept:
        x, y = self.value, other.value if isinstance(other, _Kept) else other
        if op == "mul" and ZERO in (x, y):
            return _Kept(self.graph, ZERO)
        if op != "mul" and y == ZERO:
            return self
        if op == "add" and x == ZERO:
            return _Kept(self.graph, y)
        if op == "sub" and x == ZERO:
            return _Kept(self.graph, self.graph.neg(y))
        one, second = (z if isinstance(z, Node) else self.graph.constant(z) for z in (x, y))
        return _Kept(self.graph, self.graph.insert(op, (one.index, second.index)))


def frame_jacobians(model: Model, kinematics: Program) -> Program:
    """Write the Jacobians of all frames, (frames, 6, n), from the program of frames."""
    graph = Graph()
    nodes = copied(graph, kinematics)
    values: list[_Kept] = []
    for place in range(len(kinematics.outputs)):
        node = nodes[kinematics.outputs["out", place]]
        number = graph.number(node)
        values.append(_Kept(graph, node if number is None else number))
    entries: list[Value] = []
    for frame in range(len(model.frames)):
        columns = jacobian_columns(model, values, frame)
        for row in range(6):
            for s in range(len(model.coordinates)):
                entry = columns[s][row] if s in columns else ZERO
                entries.append(entry.value if isinstance(entry, _Kept) else entry)
    return finish(graph, "frame_jacobians", vector(entries))
