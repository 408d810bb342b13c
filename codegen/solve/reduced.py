"""A tree some of whose coordinates follow others: S^T M S factorised, which is no tree's matrix any more.

Motors are eliminated before it, as those of other trees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..tree.followers import Followers
from ..tree.spatial import Scalar
from .factorised import Factors
from .responses import Tree
from .rotors import Rotors
from .rows import Response, Row
from .states import States


class ReducedTree(Tree):
    """A tree by the mass matrix of the coordinates that follow no others; rows are by all coordinates."""

    def __init__(
        self, states: States, rotors: Rotors, followers: Followers, factors: Factors, right: Sequence[Scalar]
    ) -> None:
        """Solve for the accelerations, and put those of motors and internal states in.

        Args:
            factors: of the matrix; of followers, motors and states their rows are those of the unit matrix.
            right: drives that are left, 0 of followers and motors; accelerations of prescribed coordinates.
        """
        self.states, self.rotors, self.followers, self.factors = states, rotors, followers, factors
        free = factors.solve(right)
        self.pivot_pairs: list[tuple[Scalar, Scalar]] = [(1.0, 1.0)] * len(free)
        rotors.release(free, self.pivot_pairs)
        self.free = followers.follow(free)
        states.release(self.free, self.pivot_pairs)

    def respond(self, row: Row) -> Response:
        response = Response()
        push: list[Scalar] = [0.0] * len(self.free)
        for index, arm in self.followers.row(row.jacobian_row).items():
            push[index] = arm
        self.rotors.respond(push, response)
        for motor in self.rotors.rows:
            push[motor] = 0.0
        return self.factors.respond(push, response)

    def changes(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        motors = self.rotors.rows
        accelerations = self.factors.forward([0.0 if i in motors else more.get(i, 0.0) for i in range(len(self.free))])
        self.rotors.released(more, accelerations)
        return self.states.released(self.followers.follow(accelerations))
