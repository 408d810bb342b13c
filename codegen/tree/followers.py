"""Coordinates of the tree that follow others by rigid couplings: q = S q_lead + offset, v = S v_lead, a = S a_lead.

The tree keeps them all.  What depends on them is mapped at the ends: forces and rows of matrices by S^T, columns by S.
Those of nodes of links that bend have squares of modes, 1/2 e B e more, too: S is their slope where q is, and the
accelerations have v B v more.
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
        self.bends: dict[int, Mapping[tuple[int, int], Scalar]] = {}
        self._rows: dict[int, Mapping[int, Scalar]] = {}  # of each follower's coupling
        rigid = {next(iter(coupling.jacobian_row)): coupling for coupling in bound.couplings if coupling.law is None}
        for index in map(whole.coordinates.index, described.followers):
            share: Shares = {}
            self._rows[index] = rigid[index].jacobian_row
            offset = rigid[index].offset
            for other, arm in rigid[index].jacobian_row.items():
                if other == index:
                    continue
                ratio = -1.0 * arm
                for leader, behind in self.shares.get(other, {other: 1.0}).items():
                    share[leader] = share.get(leader, 0.0) + ratio * behind
                offset = offset + ratio * self.offsets.get(other, 0.0)
            self.shares[index] = {leader: value for leader, value in share.items() if not is_zero(value)}
            self.offsets[index] = offset
            if rigid[index].bends:
                self.bends[index] = rigid[index].bends

    def __bool__(self) -> bool:
        return bool(self.shares)

    def place(self, q: list[Scalar]) -> list[Scalar]:
        """Write positions of followers into those of all coordinates, (n,), and take S where they are."""
        for index, share in self.shares.items():
            half = _products({pair: 0.5 * bend for pair, bend in self.bends.get(index, {}).items()}, q)
            leaders = dict.fromkeys((*share, *half))
            position = self.offsets[index]
            for leader in leaders:
                position = position + (share.get(leader, 0.0) + half.get(leader, 0.0)) * q[leader]
            q[index] = position
            if half:
                self.shares[index] = {i: (share.get(i, 0.0) + half.get(i, 0.0)) + half.get(i, 0.0) for i in leaders}
        return q

    def follow(self, x: list[Scalar]) -> list[Scalar]:
        """Write what followers do into changes of all coordinates, (n,): S x, as of velocities."""
        for index, share in self.shares.items():
            value: Scalar = 0.0
            for leader, ratio in share.items():
                value = value + ratio * x[leader]
            x[index] = value
        return x

    def accelerate(self, a: list[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
        """Write accelerations of followers into those of all coordinates, (n,), which move with velocities v."""
        self.follow(a)
        for index, bends in self.bends.items():
            for (i, j), bend in bends.items():
                a[index] = a[index] + (bend if i == j else 2.0 * bend) * (v[i] * v[j])
        return a

    def gather(self, forces: Sequence[Scalar]) -> list[Scalar]:
        """Add forces of followers to their leaders', S^T f, (n,); zeros are left at the followers."""
        gathered = list(forces)
        for index, share in self.shares.items():
            for leader, ratio in share.items():
                gathered[leader] = gathered[leader] + ratio * forces[index]
            gathered[index] = 0.0
        return gathered

    def holding(self, needed: Sequence[Scalar]) -> dict[int, Scalar]:
        """Return the couplings' forces by their followers' indices, out of what all coordinates need, (n,).

        They are multipliers of what vanishes, a follower less what its coupling makes of others; so a coupling bears
        what those take that follow its follower.
        """
        coupling_forces: dict[int, Scalar] = {}
        for index in reversed(self.shares):
            force = needed[index]
            for other, taken in coupling_forces.items():
                if index in self._rows[other]:
                    force = force - self._rows[other][index] * taken
            coupling_forces[index] = force
        return coupling_forces

    def row(self, full_row: Mapping[int, Scalar]) -> dict[int, Scalar]:
        """Map a row of J, by all coordinates, to those that follow no others: J S, by index."""
        row: dict[int, Scalar] = {index: arm for index, arm in full_row.items() if index not in self.shares}
        for index, share in self.shares.items():
            for leader, ratio in share.items() if index in full_row else ():
                row[leader] = row.get(leader, 0.0) + ratio * full_row[index]
        return row

    def matrix(self, rows: Rows) -> Rows:
        """Return S^T A S of a matrix with all its entries that do not vanish."""
        by_row: dict[int, Shares] = {}
        for (i, j), value in rows.items():
            by_row.setdefault(i, {})[j] = value
        mapped: dict[int, Shares] = {}
        for i, columns in by_row.items():
            row = self.row(columns)
            for leader, ratio in self.shares.get(i, {i: 1.0}).items():
                into = mapped.setdefault(leader, {})
                for j, value in row.items():
                    into[j] = into.get(j, 0.0) + ratio * value
        return {(i, j): value for i, row in mapped.items() for j, value in row.items()}

    def symmetric(self, upper: Rows) -> Rows:
        """Return S^T M S of a symmetric matrix; entries (i, j) with i <= j of both."""
        both = {**upper, **{(j, i): value for (i, j), value in upper.items()}}
        return {(i, j): value for (i, j), value in self.matrix(both).items() if i <= j}

    def leaders(self, indices: Iterable[int]) -> list[int]:
        """Return the coordinates that move these, themselves where they follow no others; each once."""
        return list(dict.fromkeys(j for i in indices for j in self.shares.get(i, (i,))))


def _products(bends: Mapping[tuple[int, int], Scalar], x: Sequence[Scalar]) -> Shares:
    """Return B x of a symmetric matrix whose entries (i, j), i <= j, are given, by index."""
    product: Shares = {}
    for (i, j), entry in bends.items():
        product[i] = product.get(i, 0.0) + entry * x[j]
        if i != j:
            product[j] = product.get(j, 0.0) + entry * x[i]
    return product
