"""Rows of closed mechanisms: a symmetric system that is factored sparsely, without pivoting, and refined.

With J the rows, M the tree's mass matrix and a_free what it does with its loops open,

    (J M^-1 J^T) lambda = right - J a_free,    a = a_free + M^-1 J^T lambda.

Rows may be redundant: the matrix A is factored with a little of its diagonal added, D, and the solution is refined a
fixed number of times, x += y with y = (A + D)^-1 D y (the proximal iteration of J. Carpentier, R. Budhiraja,
N. Mansard, "Proximal and Sparse Resolution of Constrained Dynamic Equations", RSS 2021).  Consistent ones converge to
accelerations that are unique; their multipliers have the least norm weighted by D.

An elastic row has a slope s = h^2 k + h c in a linearly implicit step, and A has J M^-1 J^T + 1 / s on its diagonal.
Its pivot is a + 1 / s with what the rows before it leave of J M^-1 J^T, a, and is divided by as s / (1 + s a): an open
gap, s = 0, is nothing special, and neither is the derivative there, which a row scaled by the root of s would not have.

Where many elastic rows end at one body, its accelerations stay in the system as further unknowns (the system is
quasi-definite: R. J. Vanderbei, "Symmetric Quasidefinite Matrices", SIAM J. Optimization 5 (1995)), so that what is
between two such bodies is eliminated from both ends and never couples to the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ..tree.spatial import Scalar, along, is_zero
from ..tree.traced import Traced

Sparse = dict[int, Scalar]


@dataclass(frozen=True)
class Precision:
    """Shares of the diagonal that are added, and how often the solution is refined.

    added: of the rows of a group.  floor: of all rows, for groups that vanish but for round-off.
    """

    added: float
    floor: float
    refinements: int


@dataclass(frozen=True)
class Solved:
    """Multipliers of all rows, and what they leave of the right sides of rigid rows, by their indices.

    With the last change ``more``, rest = D more: (A + D) more = D before, where D before was left.
    """

    multipliers: list[Scalar]
    rest: Sparse


PRECISIONS: Mapping[str, Precision] = {
    "float64": Precision(1e-11, 1e-14, 1),
    "float32": Precision(2e-6, 1e-6, 3),
}
# Of derivatives, whose right sides contradict each other in redundant rows where a direction leaves the closed states.
DERIVING: Mapping[str, Precision] = {"float64": Precision(1e-7, 1e-14, 2), "float32": Precision(1e-3, 1e-6, 4)}
DERIVING_INDEPENDENT: Mapping[str, Precision] = {  # of derivatives where no row follows from others
    "float64": Precision(1e-14, 1e-14, 2),
    "float32": Precision(5e-7, 5e-7, 4),
}


@dataclass(frozen=True)
class Row:
    """A row of the system.

    jacobian_row: its derivatives by the coordinates, without those that vanish.
    right: wanted J a of a rigid row; 0 of an elastic one.
    slope: of an elastic row, from 0 on; None of a rigid one.
    felt: of an elastic row whose force other directions feel than it acts along, the derivatives of that force by the
        accelerations, its slope included (``unsymmetric``); None where they are the slope times ``jacobian_row``.
    group: rows of one kind that are compared to each other where they may be redundant.
    is_weak: whether its group may vanish but for round-off, and is compared to all rigid rows, too.
    """

    jacobian_row: Sparse
    right: Scalar = 0.0
    slope: Scalar | None = None
    felt: Sparse | None = None
    group: object = None
    is_weak: bool = False

    @property
    def is_elastic(self) -> bool:
        """Whether it has a slope."""
        return self.slope is not None

    def along(self, x: Sequence[Scalar] | Mapping[int, Scalar]) -> Scalar:
        """Return J x."""
        return along(self.jacobian_row, x)


def elastic_row(jacobian_row: Mapping[int, Scalar], slope: Scalar) -> Row:
    """Return the row of an element with this slope; an empty one where that vanishes whatever the state is."""
    kept = {} if is_zero(slope) else {index: arm for index, arm in jacobian_row.items() if not is_zero(arm)}
    return Row(kept, slope=slope)


@dataclass(frozen=True)
class Response:
    """Drives at rest and without weight, eliminated from the tips: what is ``left`` at each pivot, and that divided.

    The product of two responses is an entry of J M^-1 J^T.
    """

    left: Sparse = field(default_factory=dict)
    free: Sparse = field(default_factory=dict)

    def put(self, index: int, left: Scalar, free: Scalar) -> None:
        """Write a coordinate's numbers, but for zeros."""
        if not (is_zero(left) and is_zero(free)):
            self.left[index], self.free[index] = left, free

    def product(self, other: Response, without: Container[int] = ()) -> Scalar:
        """Return J_r M^-1 J_s^T, without what some pivots contribute."""
        total: Scalar = 0.0
        for index, left in self.left.items():
            if index in other.free and index not in without:
                total = total + left * other.free[index]
        return total


Entries = dict[tuple[int, int], Scalar]  # of a symmetric matrix, (i, j) with i <= j


class RowSystem:
    """The matrix of rows, factored.

    Empty rows stay out: their multipliers are zero.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        responses: Sequence[Response],
        precision: Precision,
        pivots: Sequence[Entries] = (),
    ) -> None:
        """Write and factor the matrix.

        Args:
            pivots: per body what stands at the pivots of its joint, by pairs of coordinates.
        """
        self.rows, self.precision = rows, precision
        self.kept = [r for r, row in enumerate(rows) if row.jacobian_row]
        self.rigid = [r for r in self.kept if not rows[r].is_elastic]
        keys = {r: frozenset(responses[r].left) for r in self.kept}
        hubs = [] if self.rigid else _hubs(keys, pivots, len(rows))
        within = {key for hub in hubs for key, _ in hub}
        matrix: Entries = {}
        for place, r in enumerate(self.kept):
            for s in self.kept[place:]:
                entry = responses[r].product(responses[s], within)
                if r == s or not is_zero(entry):
                    matrix[r, s] = entry
            for key in sorted(within & keys[r]):
                matrix[r, len(rows) + key] = responses[r].left[key]
        for hub in hubs:
            for (i, j), entry in hub.items():
                matrix[len(rows) + i, len(rows) + j] = -1.0 * entry
        self.matrix = matrix
        self.unknowns = [*self.kept, *sorted(len(rows) + key for key in within)]
        self.order = elimination_order(self.unknowns, matrix)
        self._factor()

    def _raised(self) -> Sparse:
        """Return the diagonal, rigid rows' with its share added; 1 / s of elastic ones comes in at their pivots."""
        sums: dict[object, Scalar] = {}
        for r in self.rigid:
            sums[self.rows[r].group] = sums.get(self.rows[r].group, 0.0) + self.matrix[r, r]
        shares = {group: self.precision.added * total for group, total in sums.items()}
        weak = {self.rows[r].group for r in self.rigid if self.rows[r].is_weak}
        if weak:
            floor = self.precision.floor * sum(sums.values(), 0.0)
            shares |= {group: shares[group] + floor for group in weak}
        self.added = {r: shares[self.rows[r].group] for r in self.rigid}
        return {r: self.matrix[r, r] + self.added.get(r, 0.0) for r in self.unknowns}

    def _factor(self) -> None:
        """Factor P^T A P = L D L^T, entry by entry, in the order that leaves few."""
        place = {r: i for i, r in enumerate(self.order)}
        A: Entries = {}
        for (r, s), entry in self.matrix.items():
            i, j = sorted((place[r], place[s]))
            A[j, i] = entry
        for r, entry in self._raised().items():
            A[place[r], place[r]] = entry
        self.columns: list[Sparse] = []
        self.inverses: list[Scalar] = []
        self.pivots: list[Scalar] = []
        behind: list[set[int]] = [set() for _ in self.order]
        for j, i in A:
            if j > i:
                behind[i].add(j)
        for i in range(len(self.order)):
            inverse = self._divided(self.order[i], A[i, i])
            column = {j: A[j, i] * inverse for j in sorted(behind[i])}
            for j in column:
                for k in column:
                    if k <= j:
                        A[j, k] = A.get((j, k), 0.0) - column[k] * A[j, i]
                        if k < j:
                            behind[k].add(j)
            self.columns.append(column)
            self.inverses.append(inverse)
            self.pivots.append(A[i, i])

    def _divided(self, unknown: int, entry: Scalar) -> Scalar:
        """Return one divided by the pivot of an unknown, of which this is left on the diagonal."""
        slope = self.rows[unknown].slope if unknown < len(self.rows) else None
        if slope is not None:
            return slope / (1.0 + slope * entry)
        return 0.0 if is_zero(entry) else 1.0 / entry

    def hidden(self) -> Scalar:
        """Sum of what is added to the diagonal over what is left at the pivots, of all rigid rows.

        Far below 1 where they are independent, unless one of them hides behind another.
        """
        total: Scalar = 0.0
        for r, inverse in zip(self.order, self.inverses, strict=True):
            if r in self.added:
                total = total + self.added[r] * inverse
        return total

    def small_pivots(self, share: float, call: Callable[..., Scalar]) -> Scalar:
        """Count pivots of rigid rows below a share of the sum of their group's entries on the diagonal."""
        total: Scalar = 0.0
        for r, pivot in zip(self.order, self.pivots, strict=True):
            if r in self.added:
                least = Traced(share / self.precision.added, "least pivot of a constraint row, as a share of its group")
                total = total + call("step", least * self.added[r] - pivot)
        return total

    def dependent(self) -> Scalar:
        """Return the trace of D (A + D)^-1: how many rows follow from others, those that nearly do by their shares."""
        total: Scalar = 0.0
        for first, row in enumerate(self.order):
            if row not in self.added:
                continue
            y: Sparse = {first: 1.0}
            entry: Scalar = 0.0
            for i in range(first, len(self.order)):
                if i in y:
                    entry = entry + y[i] * y[i] * self.inverses[i]
                    for j, factor in self.columns[i].items():
                        y[j] = y.get(j, 0.0) - factor * y[i]
            total = total + self.added[row] * entry
        return total

    def once(self, right: Sparse) -> Sparse:
        """Solve by the factors alone, without refinement."""
        x = [right.get(r, 0.0) for r in self.order]
        for i, column in enumerate(self.columns):
            for j, factor in column.items():
                x[j] = x[j] - factor * x[i]
        x = [value * inverse for value, inverse in zip(x, self.inverses, strict=True)]
        for i in range(len(x) - 1, -1, -1):
            for j, factor in self.columns[i].items():
                x[i] = x[i] - factor * x[j]
        return dict(zip(self.order, x, strict=True))

    def multipliers(self, missing: Callable[[int], Scalar]) -> list[Scalar]:
        """Solve for lambda of all rows, elastic ones' beside the force in drives; ``missing(r)``: right - J a_free."""
        return self.solved({r: missing(r) for r in self.kept}, self.precision.refinements).multipliers

    def solved(self, right: Sparse, refinements: int) -> Solved:
        """Solve for the multipliers of all rows, refined so often with the factors; return what they leave, too."""
        x = more = self.once(right)
        for _ in range(refinements if self.rigid else 0):  # elastic rows are factored as they are
            more = self.once({r: self.added[r] * more[r] for r in self.rigid})
            x = {r: x[r] + more[r] for r in self.unknowns}
        rest = {r: self.added[r] * more[r] for r in self.rigid}
        return Solved([x.get(r, 0.0) for r in range(len(self.rows))], rest)


def _hubs(keys: Mapping[int, frozenset[int]], pivots: Sequence[Entries], first: int) -> list[Entries]:
    """Choose bodies whose accelerations stay unknowns, because that saves operations: what stands at their pivots.

    Args:
        keys: per row the coordinates at whose pivots its drives leave something.
        pivots: per body, by pairs of coordinates.
        first: the number of the first unknown behind the rows.
    """

    def cost(hubs: Sequence[Entries]) -> int:
        within = {key for hub in hubs for key, _ in hub}
        near: dict[int, set[int]] = {
            r: {first + key for key in coordinates & within} for r, coordinates in keys.items()
        }
        products = 0
        for r, coordinates in keys.items():
            for s, other in keys.items():
                if r < s and (shared := len((coordinates & other) - within)):
                    near[r].add(s)
                    near[s].add(r)
                    products += shared
        for hub in hubs:
            for i, j in hub:
                near.setdefault(first + i, set()).add(first + j)
                near.setdefault(first + j, set()).add(first + i)
        for r, others in list(near.items()):
            others.discard(r)
            for s in others:
                near[s].add(r)
        return products + sum(degree * (degree + 3) // 2 for _, degree in _least_degrees(near))

    candidates = []
    for hub in pivots:
        hub_keys = {key for key, _ in hub}
        if sum(not hub_keys.isdisjoint(coordinates) for coordinates in keys.values()) > 2 * len(hub_keys):
            candidates.append(hub)
    return candidates if candidates and cost(candidates) < cost(()) else []


def elimination_order(rows: Sequence[int], entries: Mapping[tuple[int, int], Scalar]) -> list[int]:
    """Order the rows by least degree: each is eliminated when it couples fewest of those that are left."""
    near: dict[int, set[int]] = {r: set() for r in rows}
    for r, s in entries:
        if r != s:
            near[r].add(s)
            near[s].add(r)
    return [r for r, _ in _least_degrees(near)]


def _least_degrees(near: dict[int, set[int]]) -> Iterator[tuple[int, int]]:
    """Order unknowns by least degree, each with the number of those that it couples; ``near`` is used up."""
    while near:
        best = min(near, key=lambda r: (len(near[r]), r))
        others = near.pop(best)
        for r in others:
            near[r] |= others
            near[r] -= {r, best}
        yield best, len(others)
