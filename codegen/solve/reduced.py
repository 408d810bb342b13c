"""A tree some of whose coordinates follow others: S^T M S factorised, which is no tree's matrix any more.

Motors are eliminated before it, as those of other trees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..tree.followers import Followers
from ..tree.spatial import Scalar
from .factorised import Factors
from .rotors import Rotors
from .rows import Entries, Response, Row


class ReducedTree:
    """A tree by the mass matrix of the coordinates that follow no others; arms of rows are by all coordinates."""

    def __init__(self, rotors: Rotors, followers: Followers, factors: Factors, right: Sequence[Scalar]) -> None:
        """Solve for the accelerations, and put the motors' in.

        Args:
            factors: of the matrix; of followers and motors their rows are those of the unit matrix.
            right: drives that are left, 0 of followers and motors; accelerations of prescribed coordinates.
        """
        self.rotors, self.followers, self.factors = rotors, followers, factors
        left = factors.back(list(right))
        free = factors.forward([x * inverse for x, inverse in zip(left, factors.inverse, strict=True)])
        self.pivot_pairs: list[tuple[Scalar, Scalar]] = [(1.0, 1.0)] * len(free)
        rotors.release(free, self.pivot_pairs)
        self.free = followers.follow(free)

    def respond(self, row: Row) -> Response:
        """Eliminate drives along a row: what they leave at the pivots."""
        response = Response()
        push: list[Scalar] = [0.0] * len(self.free)
        for index, arm in self.followers.row(row.arms).items():
            push[index] = arm
        self.rotors.respond(push, response)
        for motor in self.rotors.rows:
            push[motor] = 0.0
        for index, left in enumerate(self.factors.back(push)):
            response.put(index, left, left * self.factors.inverse[index])
        return response

    def pivots(self) -> list[Entries]:
        """Do without, as other factorised trees do."""
        return []

    def along(self, row: Row, response: Response) -> Scalar:
        """J a_free."""
        return row.along(self.free)

    def accelerations(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        """Accelerations, (n,), with a sum of responses added."""
        return [own + added for own, added in zip(self.free, self.changes(more), strict=True)]

    def changes(self, more: Mapping[int, Scalar]) -> list[Scalar]:
        """Accelerations, (n,), of a sum of responses alone."""
        motors = self.rotors.rows
        found = self.factors.forward([0.0 if i in motors else more.get(i, 0.0) for i in range(len(self.free))])
        self.rotors.released(more, found)
        return self.followers.follow(found)
