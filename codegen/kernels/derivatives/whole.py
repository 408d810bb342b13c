"""Programs of all that the C of a kernel computes, from those that its template calls: to be differentiated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from eomgen.robot.model import Model

from ...program.forward_mode import gradients
from ...program.ir import Graph, Node, Program, Value, evaluate, finish
from ..bodies import POSE_SIZE, jacobian_columns
from ..derivation import vector

Derive = Callable[[str], Program]


class _Whole:
    """A graph that joins programs; ``derive`` returns them."""

    def __init__(self, model: Model, derive: Derive) -> None:
        self.model, self.derive, self.graph = model, derive, Graph()
        self.n, self.rates, self.m = len(model.coordinates), model.size, len(model.constraints)

    def array(self, name: str, size: int) -> list[Node]:
        """Read an input."""
        return [self.graph.input(name, i) for i in range(size)]

    def run(self, name: str, **arrays: Sequence[Value]) -> list[Value]:
        """Return results of a program on inputs of the graph, or on values of it."""
        program, inputs = self.derive(name), dict[str, Any]()
        for array in sorted(program.inputs()):  # the order of sets is another in every process
            places = [i.leaf[1] for i in program.instructions if i.op == "input" and i.leaf[0] == array]
            inputs[array] = arrays[array] if array in arrays else self.array(array, 1 + max(places))
        calls = {op: partial(self.graph.call, op) for op, operation in program.operations.items() if operation.function}
        outputs = evaluate(program, inputs, self.graph.sincos, calls)
        return [outputs["out", i] for i in range(sum(key[0] == "out" for key in outputs))]

    def drives(self, *, loaded: bool) -> list[Value]:
        """Return results of constrained_drives, beside forces u or without any."""
        none = {"u": [0.0] * self.n, "forces": [0.0] * len(self.model.drives)}
        return self.run("constrained_drives", **({} if loaded else none))

    def reactions(self, *, loaded: bool) -> list[Value]:
        """Return forces and moments in joints, of the tree and of the cuts."""
        multipliers = self.drives(loaded=loaded)[self.n : self.n + self.m]
        pairs = zip(self.run("tree_reactions"), self.run("closing_reactions", multipliers=multipliers), strict=True)
        return [one + other for one, other in pairs]

    def loop_reactions(self, *, loaded: bool) -> list[Value]:
        """Return forces and moments in cut joints."""
        multipliers = self.drives(loaded=loaded)[self.n : self.n + self.m]
        return self.run("loop_wrenches", multipliers=multipliers)

    def poses(self) -> list[Value]:
        """Return rows [R ¦ X] of all frames."""
        return self.run("kinematics")[: POSE_SIZE * len(self.model.frames)]

    def jacobians(self) -> list[Value]:
        """Return Jacobians of all frames, from origins and axes as the C has it."""
        k, rows = self.run("kinematics"), list[Value]()
        for frame in range(len(self.model.frames)):
            columns = jacobian_columns(self.model, k, frame)
            rows += [columns[s][row] if s in columns else 0.0 for row in range(6) for s in range(self.n)]
        return rows

    def slopes(self, accelerations: Sequence[Value]) -> list[Value]:
        """Differentiate rates by q, by v and z, and by u and forces at the drives' first states: matrices, by rows."""
        none = [self.graph.constant(0.0)] * (self.rates - self.n)
        q, v, u = (self.array(name, self.n) for name in "qvu")
        z, forces = self.array("z", self.rates - self.n), list(none)
        for place, states in enumerate(self.model.drives.values()):
            forces[states[0] - self.n] = self.graph.input("forces", place)
        columns = [[*q, *none], [*v, *z], [*u, *forces]]
        rows = gradients(self.graph, accelerations, [x for block in columns for x in block])
        starts = range(0, 3 * self.rates, self.rates)
        return [x for start in starts for row in rows for x in row[start : start + self.rates]]


CLOSED: Mapping[str, Callable[[_Whole], list[Value]]] = {  # where there are constraints
    "inverse_dynamics": lambda w: w.drives(loaded=False)[: w.n],
    "inverse_dynamics_under_load": lambda w: w.drives(loaded=True)[: w.n],
    "forward_dynamics": lambda w: w.run("constrained_dynamics")[: w.rates],
    "forward_dynamics_jacobian": lambda w: w.slopes(w.run("constrained_dynamics")[: w.rates]),
    "constraint_forces": lambda w: w.run("constrained_dynamics")[w.rates : w.rates + w.m],
    "reactions": lambda w: w.reactions(loaded=False),
    "reactions_under_load": lambda w: w.reactions(loaded=True),
    "loop_reactions": lambda w: w.loop_reactions(loaded=False),
    "loop_reactions_under_load": lambda w: w.loop_reactions(loaded=True),
}
BY_COLUMNS: Mapping[str, Callable[[_Whole], list[Value]]] = {  # where no writer of them suits the robot
    "forward_dynamics_jacobian": lambda w: w.slopes(w.run("forward_dynamics")),
    "tree_forward_dynamics_jacobian": lambda w: w.slopes(w.run("tree_forward_dynamics")),
}
OF_FRAMES: Mapping[str, Callable[[_Whole], list[Value]]] = {
    "frame_pose": lambda w: w.poses(),
    "frame_jacobian": lambda w: w.jacobians(),
}


def is_joined(model: Model, function: str) -> bool:
    """Return whether the C of a function calls programs, which one program joins."""
    return function in OF_FRAMES or (bool(model.constraints) and function in CLOSED)


def whole_program(model: Model, function: str, derive: Derive) -> Program:
    """Return the program of what a function's C computes; of one that takes a frame's number, for all frames.

    Args:
        function: a kernel, or one of OF_FRAMES.
    """
    ways = {**OF_FRAMES, **(CLOSED if model.constraints else {})}
    return _joined(model, function, derive, ways[function]) if function in ways else derive(function)


def by_columns(model: Model, function: str, derive: Derive) -> Program:
    """Return the program of one of BY_COLUMNS, a column for each number of q, v and u."""
    return _joined(model, function, derive, BY_COLUMNS[function])


def _joined(model: Model, function: str, derive: Derive, write: Callable[[_Whole], list[Value]]) -> Program:
    whole = _Whole(model, derive)
    return finish(whole.graph, function, vector(write(whole)))
