"""Coordinates of the tree that follow others by rigid couplings: q = S q_lead + offset, v = S v_lead, a = S a_lead.

The tree keeps them all.  What depends on them is mapped at the ends: forces and rows of matrices by S^T, columns by S.
Those of nodes of links that bend have squares of modes, 1/2 e B e more, too: S is their slope where q is, and the
accelerations have v B v more.  Of a place where a joint slides along a beam B itself depends on q.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from eomgen.names import joint_of
from eomgen.robot.model import Model, with_offset_angles
from eomgen.robot.value import SlidingShapes
from eomgen.robot.value.sliding import chebyshev, combined, derivative

from .bound import Bound
from .composite import Rows
from .spatial import Scalar, add_row, is_zero
from .traced import Traced

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
        self._sliding: dict[int, _Sliding] = {}
        self._rows: dict[int, Mapping[int, Scalar]] = {}  # of each follower's coupling
        rigid = {next(iter(coupling.jacobian_row)): coupling for coupling in bound.couplings if coupling.law is None}
        for name, coupling in described.followers.items():
            index = whole.coordinates.index(name)
            share: Shares = {}
            self._rows[index] = rigid[index].jacobian_row
            offset = rigid[index].offset
            for other, arm in rigid[index].jacobian_row.items():
                if other == index:
                    continue
                ratio = -1.0 * arm
                add_row(share, ratio, self.shares.get(other, {other: 1.0}))
                offset = offset + ratio * self.offsets.get(other, 0.0)
            self.shares[index] = {leader: value for leader, value in share.items() if not is_zero(value)}
            self.offsets[index] = offset
            if rigid[index].bends:
                self.bends[index] = rigid[index].bends
            if coupling.sliding is not None:
                self._sliding[index] = sliding = _Sliding(name, coupling.sliding, whole.coordinates.index)
                self.shares[index] = dict.fromkeys((*sliding.modes, *self._behind(sliding.by)), 1.0)

    def __bool__(self) -> bool:
        return bool(self.shares)

    def place(self, q: list[Scalar]) -> list[Scalar]:
        """Write positions of followers into those of all coordinates, (n,), and take S where they are."""
        for index, share in self.shares.items():
            if index in self._sliding:
                self._slide(index, q)
                continue
            half = _products({pair: 0.5 * bend for pair, bend in self.bends.get(index, {}).items()}, q)
            leaders = dict.fromkeys((*share, *half))
            position = self.offsets[index]
            for leader in leaders:
                position = position + (share.get(leader, 0.0) + half.get(leader, 0.0)) * q[leader]
            q[index] = position
            if half:
                self.shares[index] = {i: (share.get(i, 0.0) + half.get(i, 0.0)) + half.get(i, 0.0) for i in leaders}
        return q

    def _slide(self, index: int, q: list[Scalar]) -> None:
        """Write the position of a place on a beam, its slopes and its second derivatives where q is."""
        sliding = self._sliding[index]
        at = sliding.at(q)
        rate = at.slopes[sliding.by]
        q[index] = self.offsets[index] + at.value
        moved = {leader: ratio * rate for leader, ratio in self._behind(sliding.by).items()}
        self.shares[index] = {**{mode: at.slopes[mode] for mode in sliding.modes}, **moved}
        self.bends[index] = at.seconds

    def _behind(self, index: int) -> Shares:
        """Return the shares of a coordinate's leaders in it, itself where it follows none."""
        return self.shares.get(index, {index: 1.0})

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
            if index in full_row:
                add_row(row, full_row[index], share)
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
                add_row(mapped.setdefault(leader, {}), ratio, row)
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


@dataclass(frozen=True)
class _PlaceOnBeam:
    """A coordinate of the place on a beam's axis where q is.

    slopes: derivatives by coordinates, by their indices.  seconds: second ones by (i, j), i <= j.
    """

    value: Scalar
    slopes: dict[int, Scalar]
    seconds: dict[tuple[int, int], Scalar]


class _Sliding:
    """Functions by which modes move a place on a beam, x = p_k(s) e_k + 1/2 b_kj(s) e_k e_j, by indices of q.

    by: index of the coordinate s that slides.  Derivatives of b_kj by s are c s_k s_j with slopes s_k(s), so that those
    of the sum are c / 2 w^2 and c w w' with w = s_k e_k: as many operations as modes, not as pairs of them.
    """

    def __init__(self, name: str, shapes: SlidingShapes, index: Callable[[str], int]) -> None:
        length = Traced(shapes.length, f"links.{joint_of(shapes.modes[0])}.beam.length")
        self.by, self.degree, self.rate = index(shapes.by), shapes.degree, 2.0 / length
        self.modes = tuple(map(index, shapes.modes))
        self.first = {index(x): self._orders(f"shape of {x} in {name}", series) for x, series in shapes.first}
        self.slopes = [
            (c, {index(x): self._orders(f"slope of {x} in {name}", series) for x, series in group})
            for c, group in shapes.slopes
        ]
        self.second: dict[tuple[int, int], Sequence[float]] = {}
        for x, other, series in shapes.second:
            i, j = index(x), index(other)
            self.second[min(i, j), max(i, j)] = self._orders(f"shape of {x} and {other} in {name}", series)[0]

    def _orders(self, what: str, series: Sequence[float]) -> list[list[float]]:
        """Return the coefficients of a function and of its two derivatives by s, with names."""
        orders, factor = list[list[float]](), 1.0
        for order in ("", ", first derivative", ", second derivative"):
            named = (Traced(factor * x, f"{what}{order}, Chebyshev coefficient {i}") for i, x in enumerate(series))
            orders.append([x or 0.0 for x in named])
            series, factor = derivative(series), factor * self.rate
        return orders

    def at(self, q: Sequence[Scalar]) -> _PlaceOnBeam:
        """Return the coordinate where q is."""
        T = chebyshev(self.rate * q[self.by] - 1.0, self.degree)
        second = {pair: combined(series, T) for pair, series in self.second.items()}
        half: dict[int, Scalar] = dict.fromkeys(self.modes, 0.0)  # of b e
        for (i, j), entry in second.items():
            half[i] = half[i] + (0.5 * entry) * q[j]
            if i != j:
                half[j] = half[j] + (0.5 * entry) * q[i]
        value: Scalar = 0.0
        slopes: dict[int, Scalar] = {}
        first = {mode: combined(series[0], T) for mode, series in self.first.items()}
        for mode in self.modes:
            straight = first.get(mode, 0.0) + half[mode]
            value = value + straight * q[mode]
            slopes[mode] = straight + half[mode]
        rate, bend, by_modes = self._derivatives(T, q)
        mixed = {(min(mode, self.by), max(mode, self.by)): entry for mode, entry in by_modes.items()}
        return _PlaceOnBeam(value, {**slopes, self.by: rate}, {**second, **mixed, (self.by, self.by): bend})

    def _derivatives(self, T: Sequence[Scalar], q: Sequence[Scalar]) -> tuple[Scalar, Scalar, dict[int, Scalar]]:
        """Return the first and the second derivative of the value by s, and those of the first one by modes."""
        by_modes: dict[int, Scalar] = dict.fromkeys(self.modes, 0.0)
        rates, bends = self._moved(self.first, 1, T, q), self._moved(self.first, 2, T, q)
        by_modes |= rates[1]
        rate, bend = rates[0], bends[0]
        for c, group in self.slopes:
            (w, entries), (w_rate, _) = self._moved(group, 0, T, q), self._moved(group, 1, T, q)
            rate, bend = rate + (0.5 * c) * (w * w), bend + c * (w * w_rate)
            for mode, entry in entries.items():
                by_modes[mode] = by_modes[mode] + c * (entry * w)
        return rate, bend, by_modes

    def _moved(
        self, functions: Mapping[int, Sequence[Sequence[float]]], order: int, T: Sequence[Scalar], q: Sequence[Scalar]
    ) -> tuple[Scalar, dict[int, Scalar]]:
        """Return the derivative by s of some order of a sum of functions times modes, and those of the functions."""
        total: Scalar = 0.0
        entries: dict[int, Scalar] = {}
        for mode, series in functions.items():
            entries[mode] = combined(series[order], T)
            total = total + entries[mode] * q[mode]
        return total, entries


def coordinate_parents(model: Model) -> list[int]:
    """Return the index of the coordinate in front of each one on the way to the base, or -1; motors stand alone.

    Where coordinates lead others, the way goes through all with which these couple them.
    """
    return _elimination_parents(model) if model.followers else _tree_parents(model)


def _elimination_parents(model: Model) -> list[int]:
    """The elimination tree of M: rows of L have entries at ancestors alone (J. W. H. Liu, "The Role of Elimination
    Trees in Sparse Factorization", SIAM J. Matrix Analysis and Applications 11, 1990).
    """
    whole, _ = with_offset_angles(model)
    parents, places = _tree_parents(whole), {name: i for i, name in enumerate(model.velocities)}
    moved_by: list[set[int]] = [set() for _ in parents]  # by which coordinates, of all in front and of each one itself
    names = enumerate(whole.velocities)
    leaders = {i: {places[x] for x in model.leaders.get(name, (name,)) if x in places} for i, name in names}
    for i, parent in enumerate(parents):
        moved_by[i] = leaders[i] | (moved_by[parent] if parent >= 0 else set())
    front: list[set[int]] = [set() for _ in range(model.size)]
    for i in range(len(parents)):
        for k in moved_by[i]:
            front[k] |= {j for j in moved_by[i] if j < k}
    nearest = [-1] * model.size
    for k in range(model.size - 1, -1, -1):
        if front[k]:
            nearest[k] = max(front[k])
            front[nearest[k]] |= front[k] - {nearest[k]}
    return nearest


def _tree_parents(model: Model) -> list[int]:
    parents = [-1] * model.size
    last: dict[int, int] = {-1: -1}
    for k, body in enumerate(model.bodies):
        before = last[body.parent]
        for index in (*body.indices, *body.modes):
            parents[index] = before
            before = index
        last[k] = before
    return parents
