"""Apply the inverse mass matrix to rows of J, through the inertias of an elimination or the factors of M.

Each set of drives passes from the tips to the base; products of what it leaves at the pivots are the entries of
J M^-1 J^T, and one pass back to the tips gives the accelerations of any sum of such sets.  Bodies that neither a drive
nor a body behind them moves are not visited.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from eomgen.robot.model import FIXED_BODY

from ..tree.frozen_joints import JointGeometry
from ..tree.recursion import NO_WRENCH, Wrench, through_joint_back
from ..tree.spatial import ZERO, Scalar, Vec, add, add_row, along, is_zero, matvec, scale, transpose, vec3
from .coupled import Coupled
from .elimination import Elimination
from .factorised import Factors
from .rotors import Rotors
from .rows import Entries, Response, Row, Sparse
from .states import States


class Tree(ABC):
    """A tree whose accelerations under its drives, ``free``, are known, and that answers further ones."""

    free: Sequence[Scalar]

    @abstractmethod
    def respond(self, row: Row) -> Response:
        """Eliminate drives along a row: what they leave at the pivots."""

    @abstractmethod
    def changes(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        """Return accelerations, (n,), of a sum of responses alone: ``more`` is what these leave, divided."""

    def pivots(self) -> list[Entries]:
        """Return entries at the pivots of every body's joint, by pairs of coordinates; none where that is not known."""
        return []

    def along(self, row: Row, response: Response) -> Scalar:
        """Return J a_free."""
        return row.along(self.free)

    def accelerations(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        """Return accelerations, (n,), with a sum of responses added."""
        return [a + added for a, added in zip(self.free, self.changes(more), strict=True)]


class FactorisedTree(Tree):
    """A tree by its mass matrix, M = L^T D L."""

    def __init__(self, factors: Factors, right: Sequence[Scalar]) -> None:
        """Take what of the drives is left at the pivots; ``right``: u less everything but M a."""
        self.factors, self.left = factors, factors.back(list(right))

    def respond(self, row: Row) -> Response:
        return self.factors.respond([row.jacobian_row.get(i, 0.0) for i in range(len(self.left))], Response())

    def along(self, row: Row, response: Response) -> Scalar:
        return along(response.free, self.left)

    def accelerations(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        inverse = self.factors.inverse
        return self.factors.forward([x * inverse[i] + more.get(i, 0.0) for i, x in enumerate(self.left)])

    def changes(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        return self.factors.forward([more.get(i, 0.0) for i in range(len(self.left))])


class EliminatedTree(Tree):
    """A tree whose joints are eliminated one after the other, its motors before them, and internal states first."""

    def __init__(self, states: States, rotors: Rotors, tree: Elimination, free: Sequence[Scalar]) -> None:
        """Keep the elimination; ``free``: its accelerations, those of motors and internal states included."""
        self.states, self.rotors, self.tree, self.free, self.model = states, rotors, tree, free, tree.model

    def respond(self, row: Row) -> Response:
        response, tree, model = Response(), self.tree, self.model
        push: list[Scalar] = [0.0] * model.size
        for index, arm in row.jacobian_row.items():
            push[index] = arm
        self.rotors.respond(push, response)
        moved = {
            k for k, body in enumerate(model.bodies) if any(not is_zero(push[i]) for i in (*body.indices, *body.modes))
        }
        reached = {k for body in moved for k in model.ancestors(body)}
        loads = dict.fromkeys(reached, NO_WRENCH)
        nodes: dict[int, dict[int, Wrench]] = {k: {} for k in reached}
        for k in sorted(reached, reverse=True):
            if k in tree.modes:
                loads[k] = tree.modes[k].respond(push, nodes[k], loads[k], response)
            at_joint = self._through(k, push, loads[k], response)
            parent, joint = model.bodies[k].parent, tree.joints[k]
            if parent != FIXED_BODY:
                if tree.bound.bodies[k].shares:
                    nodes[parent][k] = at_joint
                loads[parent] = loads[parent] + through_joint_back(
                    at_joint, JointGeometry(joint.turn, joint.offset, (), ()), []
                )
        return response

    def _through(self, k: int, push: Sequence[Scalar], load: Wrench, response: Response) -> Wrench:
        """Return the wrench in front of a joint, in its axes, of drives and of the load behind it."""
        tree, joint = self.tree, self.tree.joints[k]
        if tree.free[k]:
            left, specific, torque, rate, passed = tree.bodies.respond(k, push, load)
            for (index, _), remainder, free in zip(joint.translations, left, specific, strict=True):
                response.put(index, remainder, free)
            for turn, remainder, free in zip(joint.rotations, torque, rate, strict=True):
                response.put(turn.index, remainder, free)
            return passed
        for turn in reversed(joint.rotations):
            load = self._past(k, turn.index, push, load, response).turned(turn.matrix)
        if k in tree.coupled:
            load = self._past_coupled(tree.coupled[k], push, load, response)
        if k in tree.blocks:
            return self._past_block(k, push, load, response)
        for index, _ in reversed(joint.translations):
            load = self._past(k, index, push, load, response)
        return load

    def _past(self, k: int, index: int, push: Sequence[Scalar], load: Wrench, response: Response) -> Wrench:
        """Return the load in front of one coordinate; a prescribed one passes it on."""
        step = next((step for step in self.tree.steps[k] if step.index == index), None)
        if step is None:
            return load
        axis, is_force = step.row % 3, step.row < 3
        left = push[index] - (load.force if is_force else load.moment)[axis]
        response.put(index, left, left * step.inverse)
        passed = load.plus(left, step.gain)
        force, moment = list(passed.force), list(passed.moment)
        held = push[index] - self.tree.bound.armature[index] * (left * step.inverse)
        (force if is_force else moment)[axis] = held
        return Wrench(vec3(force), vec3(moment))

    def _past_coupled(self, joint: Coupled, push: Sequence[Scalar], load: Wrench, response: Response) -> Wrench:
        """Return the load in front of coordinates that slopes couple."""
        left = [push[x.index] - x.of(load) for x in joint.directions]
        for x, remainder, free, column in zip(joint.directions, left, joint.solve(left), joint.columns, strict=True):
            response.put(x.index, remainder, free)
            load = load + column.scaled(free)
        return load

    def _past_block(self, k: int, push: Sequence[Scalar], load: Wrench, response: Response) -> Wrench:
        """Pass three translations at once."""
        block, first = self.tree.blocks[k], self.tree.joints[k].translations[0][0]
        drives: Vec = (push[first], push[first + 1], push[first + 2])
        left = add(drives, scale(-1.0, load.force))
        free = matvec(block.inverse, left)
        for i in range(3):
            response.put(first + i, left[i], free[i])
        armature = self.tree.bound.armature
        held = vec3(drives[i] - armature[first + i] * free[i] for i in range(3))
        return Wrench(held, add(load.moment, matvec(transpose(block.coupling), free)))

    def pivots(self) -> list[Entries]:
        entries: list[Entries] = []
        for k, joint in enumerate(self.tree.joints):
            if self.tree.free[k]:
                entries.append(self.tree.bodies.inertia_of(k))
                continue
            here: Entries = {(step.index, step.index): self.tree.pivots[step.index][0] for step in self.tree.steps[k]}
            if k in self.tree.coupled:
                here |= self.tree.coupled[k].matrix
            if k in self.tree.blocks:
                first = joint.translations[0][0]
                whole = self.tree.blocks[k].whole
                here |= {(first + i, first + j): whole[i][j] for i in range(3) for j in range(i, 3)}
            if k in self.tree.modes:
                here |= {(index, index): pivot for index, (pivot, _) in self.tree.modes[k].pivots.items()}
            entries.append(here)
        return entries

    def changes(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        tree, accelerations = self.tree, [0.0] * self.model.size
        bodies: list[tuple[Vec, Vec]] = []
        for k, body in enumerate(self.model.bodies):
            front = tree.front(k, *((ZERO, ZERO) if body.parent == FIXED_BODY else bodies[body.parent]))
            if tree.free[k]:
                first = body.first
                specific, rate = (vec3(more.get(i, 0.0) for i in range(at, at + 3)) for at in (first, first + 3))
                bodies.append((tree.bodies.released(k, specific, rate, front, accelerations), rate))
            else:
                followers = {i: accelerations[i] for i in body.indices if i in tree.shares}
                bodies.append(tree.release(k, front, more, followers, accelerations))
            if k in tree.modes:
                tree.release_modes(tree.modes[k].released(*bodies[k], more), accelerations, accelerations)
        self.rotors.released(more, accelerations)
        return self.states.released(accelerations)


def total(responses: Sequence[Response], multipliers: Sequence[Scalar]) -> Sparse:
    """Sum responses: what all leave at the pivots together, divided."""
    sums: Sparse = {}
    for response, multiplier in zip(responses, multipliers, strict=True):
        add_row(sums, multiplier, response.free)
    return sums
