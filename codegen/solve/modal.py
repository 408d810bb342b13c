"""Modes of a body that bends, eliminated from its articulated inertia when all that hangs on its nodes is known.

With a the acceleration of the body's origin and d its angular acceleration, the modes' rows are

    M e'' + F (a, d) = r,

M the modal masses and sum Z^T I Z over the nodes, F the own moments of the modes and sum I Z seen from the body's
origin: Z holds what unit accelerations of the modes do to a node, I what hangs on it as an articulated inertia.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..tree.frozen_joints import JointGeometry
from ..tree.modal import Bent, modal_rows
from ..tree.recursion import NO_WRENCH, Wrench, acceleration, through_joint_back
from ..tree.spatial import ZERO, Scalar, Vec, dot
from .articulated import Articulated, inverse_or_zero, less, symmetric
from .coupled import directions_of
from .rows import Response


@dataclass(frozen=True)
class _Step:
    """An eliminated mode: e'' = free - gain . (a, d) - sum of ``lower`` times those of the modes in front of it."""

    index: int
    lower: tuple[Scalar, ...]
    free: Scalar
    gain: Wrench
    inverse: Scalar


class Modes:
    """The rows of one body's modes, in the making; ``pivots`` (value, scale) by index once they are eliminated."""

    def __init__(
        self,
        bent: Bent,
        rate: Vec,
        v: Sequence[Scalar],
        drives: Sequence[Scalar],
        armature: Sequence[Scalar],
        slopes: Mapping[tuple[int, int], Scalar],
    ) -> None:
        """Write the rows of the body alone.

        Args:
            rate: its angular velocity, in its axes.
            v: velocities, (n,).
            drives, armature: (n,); slopes: what couples modes beside the diagonal, by their indices (i, j), i < j.
        """
        self.indices = bent.indices
        still = acceleration(rate, ZERO, ZERO)
        taken = modal_rows(bent, rate, still.U, ZERO, v, [0.0] * len(v))
        self.left = [drives[k] - taken[k] for k in self.indices]
        self.columns = [Wrench(G.row, G.about()) for G in bent.G]
        self.matrix: dict[tuple[int, int], Scalar] = {}
        first = self.indices.start
        for i, j, mass in bent.masses():
            added = armature[i] if i == j else slopes.get((i, j), 0.0)
            self.matrix[i - first, j - first] = mass + added
        self.sizes = [self.matrix[k, k] for k in range(len(self.indices))]
        self.pivots: dict[int, tuple[Scalar, Scalar]] = {}
        self.steps: list[_Step] = []
        self.moves: dict[int, list[Wrench]] = {}

    def add_node(
        self, body: int, inertia: Articulated, joint: JointGeometry, shares: Mapping[int, Mapping[int, Scalar]]
    ) -> None:
        """Add what hangs on the node that is a body: its inertia in front of the node's rotations.

        Args:
            shares: of modes in the node's coordinates.
        """
        directions = directions_of(joint, [*shares])
        still = Articulated(inertia.L, inertia.C, inertia.A, NO_WRENCH)
        moves, columns = [NO_WRENCH] * len(self.indices), list[Wrench]()
        for k, index in enumerate(self.indices):
            for direction in directions:
                moves[k] = moves[k].plus(shares[direction.index].get(index, 0.0), direction.axis)
            columns.append(still.answer(moves[k].force, moves[k].moment))
        self.moves[body] = moves
        front = JointGeometry(joint.turn, joint.offset, (), ())
        for k, moved in enumerate(moves):
            for j in range(k + 1):
                self.matrix[j, k] = self.matrix[j, k] + _product(moves[j], columns[k])
            self.left[k] = self.left[k] - _product(moved, inertia.p)
            self.columns[k] = self.columns[k] + through_joint_back(columns[k], front, [])

    def eliminate(self, inertia: Articulated) -> Articulated:
        """Take the modes, the last first, out of the body's inertia with all that hangs on it."""
        L, C, A, p = inertia.L, inertia.C, inertia.A, inertia.p
        for k in range(len(self.indices) - 1, -1, -1):
            pivot, column = self.matrix[k, k], self.columns[k]
            self.pivots[self.indices[k]] = (pivot, self.sizes[k])
            inverse = inverse_or_zero(pivot)
            lower = tuple(self.matrix[j, k] * inverse for j in range(k))
            gain, free = column.scaled(inverse), self.left[k] * inverse
            for j in range(k):
                for i in range(j + 1):
                    self.matrix[i, j] = self.matrix[i, j] - lower[j] * self.matrix[i, k]
                self.columns[j] = self.columns[j].plus(-1.0 * lower[j], column)
                self.left[j] = self.left[j] - lower[j] * self.left[k]
            self.steps.append(_Step(self.indices[k], lower, free, gain, inverse))
            L = symmetric(less(L, gain.force, column.force))
            C = less(C, gain.force, column.moment)
            A = symmetric(less(A, gain.moment, column.moment))
            p = p.plus(free, column)
        return Articulated(L, C, A, p)

    def respond(self, push: Sequence[Scalar], nodes: Mapping[int, Wrench], load: Wrench, response: Response) -> Wrench:
        """Eliminate drives of the modes at rest: what they leave at the pivots, and the wrench at the body's origin.

        Args:
            push: drives of all coordinates, (n,).
            nodes: wrenches in front of the rotations of nodes, by their bodies.
            load: at the body's origin, of all that hangs on it.
        """
        left = [push[k] for k in self.indices]
        for body, wrench in nodes.items():
            left = [value - _product(moved, wrench) for value, moved in zip(left, self.moves[body], strict=True)]
        for step in self.steps:
            rest = left.pop()
            response.put(step.index, rest, rest * step.inverse)
            left = [value - factor * rest for value, factor in zip(left, step.lower, strict=True)]
            load = load.plus(rest, step.gain)
        return load

    def released(self, a: Vec, d: Vec, free: Mapping[int, Scalar] | None = None) -> dict[int, Scalar]:
        """Return the modes' accelerations, by index, of that of the body.

        Args:
            free: those where the body has none, 0 where that is left out; None: by the drives of the elimination.
        """
        found: dict[int, Scalar] = {}
        for step in reversed(self.steps):
            own = step.free if free is None else free.get(step.index, 0.0)
            value = own - (dot(step.gain.force, a) + dot(step.gain.moment, d))
            for index, factor in zip(self.indices, step.lower, strict=False):
                value = value - factor * found[index]
            found[step.index] = value
        return found


def _product(one: Wrench, other: Wrench) -> Scalar:
    return dot(one.force, other.force) + dot(one.moment, other.moment)
