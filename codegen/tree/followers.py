"""Coordinates of the tree that follow others by rigid couplings: q = S q_lead + offset, v = S v_lead, a = S a_lead.

The tree keeps them all.  What depends on them is mapped at the ends: forces and rows of matrices by S^T, columns by S.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from eomgen.robot.model import Model

from .bound import Bound
from .composite import Rows
from .spatial import Scalar, is_zero

Shares = dict[int, Scalar]  # of a follower by its leaders' indices


class Followers:
    """S and the offset of the tree's coordinates, by their indices; ``shares`` holds the rows of S of followers."""

    def __init__(self, whole: Model, described: Model, bound: Bound) -> None:
        """Follow couplings of couplings down to coordinates that follow no others.

        Args:
            whole: the model in which followers are coordinates.
            described: the one in which they are not.
            bound: the numbers of ``whole``.
        """
        self.shares: dict[int, Shares] = {}
        self.offsets: dict[int, Scalar] = {}
        self._arms: dict[int, Mapping[int, Scalar]] = {}  # of each follower's own coupling
        rigid = {next(iter(coupling.arms)): coupling for coupling in bound.couplings if coupling.law is None}
        for index in map(whole.coordinates.index, described.followers):
            share: Shares = {}
            self._arms[index] = rigid[index].arms
            offset = rigid[index].offset
            for other, arm in rigid[index].arms.items():
                if other == index:
                    continue
                ratio = -1.0 * arm
                for leader, behind in self.shares.get(other, {other: 1.0}).items():
                    share[leader] = share.get(leader, 0.0) + ratio * behind
                offset = offset + ratio * self.offsets.get(other, 0.0)
            self.shares[index] = {leader: value for leader, value in share.items() if not is_zero(value)}
            self.offsets[index] = offset

    def __bool__(self) -> bool:
        return bool(self.shares)

    def follow(self, x: list[Scalar], *, positions: bool = False) -> list[Scalar]:
        """Write what followers do into values of all coordinates, (n,): S x, of positions with the offsets."""
        for index, share in self.shares.items():
            value: Scalar = self.offsets[index] if positions else 0.0
            for leader, ratio in share.items():
                value = value + ratio * x[leader]
            x[index] = value
        return x

    def gather(self, forces: Sequence[Scalar]) -> list[Scalar]:
        """Forces of followers added to their leaders', S^T f, (n,); zeros are left at the followers."""
        found = list(forces)
        for index, share in self.shares.items():
            for leader, ratio in share.items():
                found[leader] = found[leader] + ratio * forces[index]
            found[index] = 0.0
        return found

    def holding(self, needed: Sequence[Scalar]) -> dict[int, Scalar]:
        """Forces of the couplings by their followers' indices, out of what all coordinates need, (n,).

        They are multipliers of what vanishes, a follower less what its coupling makes of others; so a coupling bears
        what those take that follow its follower.
        """
        found: dict[int, Scalar] = {}
        for index in reversed(self.shares):
            force = needed[index]
            for other, taken in found.items():
                if index in self._arms[other]:
                    force = force - self._arms[other][index] * taken
            found[index] = force
        return found

    def row(self, arms: Mapping[int, Scalar]) -> dict[int, Scalar]:
        """Derivatives by coordinates that follow no others, J S, of those by all, by index."""
        found: dict[int, Scalar] = {index: arm for index, arm in arms.items() if index not in self.shares}
        for index, share in self.shares.items():
            for leader, ratio in share.items() if index in arms else ():
                found[leader] = found.get(leader, 0.0) + ratio * arms[index]
        return found

    def matrix(self, rows: Rows) -> Rows:
        """S^T A S of a matrix with all its entries that do not vanish."""
        by_row: dict[int, Shares] = {}
        for (i, j), value in rows.items():
            by_row.setdefault(i, {})[j] = value
        found: dict[int, Shares] = {}
        for i, arms in by_row.items():
            row = self.row(arms)
            for leader, ratio in self.shares.get(i, {i: 1.0}).items():
                into = found.setdefault(leader, {})
                for j, value in row.items():
                    into[j] = into.get(j, 0.0) + ratio * value
        return {(i, j): value for i, row in found.items() for j, value in row.items()}

    def symmetric(self, upper: Rows) -> Rows:
        """S^T M S of a symmetric matrix; entries (i, j) with i <= j of both."""
        both = {**upper, **{(j, i): value for (i, j), value in upper.items()}}
        return {(i, j): value for (i, j), value in self.matrix(both).items() if i <= j}

    def leaders(self, indices: Iterable[int]) -> list[int]:
        """Coordinates that move these, themselves where they follow no others; each once."""
        return list(dict.fromkeys(j for i in indices for j in self.shares.get(i, (i,))))
