"""Rows of closed mechanisms: a symmetric system that is factored sparsely, without pivoting, and refined.

With J the rows, M the tree's mass matrix and a_free what it does with its loops open,

    (J M^-1 J^T) lambda = right - J a_free,    a = a_free + M^-1 J^T lambda.

Rows may be redundant: the matrix is factored with a little of its diagonal added, and the solution is refined a fixed
number of times (the proximal iteration of J. Carpentier, R. Budhiraja, N. Mansard, "Proximal and Sparse Resolution of
Constrained Dynamic Equations", RSS 2021).  Consistent redundant rows converge to accelerations that are unique; their
multipliers have the least norm weighted by that diagonal.

An elastic row has a slope s = h^2 k + h c in a linearly implicit step.  Scaled by its root, it has 1 + s (J M^-1 J^T)
on the diagonal, and an open gap, s = 0, is nothing special.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..tree.spatial import Scalar, is_zero
from .articulated import inverse_or_zero

Sparse = dict[int, Scalar]


@dataclass(frozen=True)
class Precision:
    """Share of the diagonal that is added, and how often the solution is refined."""

    added: float
    refinements: int


PRECISIONS: Mapping[str, Precision] = {"float64": Precision(1e-10, 1), "float32": Precision(1e-4, 3)}


@dataclass(frozen=True)
class Row:
    """A row of the system.

    arms: its derivatives by the coordinates, without those that vanish.
    right: wanted J a of a rigid row; 0 of an elastic one.
    root: of the slope of an elastic row; None of a rigid one.
    group: rows of one kind that are compared to each other where they may be redundant.
    """

    arms: Sparse
    right: Scalar
    root: Scalar | None = None
    group: object = None

    def along(self, x: Sequence[Scalar]) -> Scalar:
        """J x."""
        total: Scalar = 0.0
        for index, arm in self.arms.items():
            total = total + arm * x[index]
        return total


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

    def product(self, other: Response) -> Scalar:
        """J_r M^-1 J_s^T."""
        total: Scalar = 0.0
        for index, left in self.left.items():
            if index in other.free:
                total = total + left * other.free[index]
        return total


class RowSystem:
    """The matrix of rows, factored.

    Rows without arms stay out: their multipliers are zero.
    """

    def __init__(self, rows: Sequence[Row], responses: Sequence[Response], precision: Precision) -> None:
        self.rows, self.precision = rows, precision
        self.kept = [r for r, row in enumerate(rows) if row.arms]
        self.matrix: dict[tuple[int, int], Scalar] = {}
        for place, r in enumerate(self.kept):
            for s in self.kept[place:]:
                entry = responses[r].product(responses[s])
                for root in (rows[r].root, rows[s].root):
                    entry = entry if root is None else root * entry
                if r == s and rows[r].root is not None:
                    entry = 1.0 + entry
                if r == s or not is_zero(entry):
                    self.matrix[r, s] = entry
        self.order = elimination_order(self.kept, self.matrix)
        self._factor()

    def _raised(self) -> Sparse:
        """The diagonal with its share added; of rigid rows alone, since elastic ones have 1 in it."""
        sums: dict[object, Scalar] = {}
        rigid = [r for r in self.kept if self.rows[r].root is None]
        for r in rigid:
            sums[self.rows[r].group] = sums.get(self.rows[r].group, 0.0) + self.matrix[r, r]
        added = {group: self.precision.added * total for group, total in sums.items()}
        return {r: self.matrix[r, r] + (added[self.rows[r].group] if r in rigid else 0.0) for r in self.kept}

    def _factor(self) -> None:
        """P^T A P = L D L^T, entry by entry, in the order that leaves few."""
        place = {r: i for i, r in enumerate(self.order)}
        A: dict[tuple[int, int], Scalar] = {}
        for (r, s), entry in self.matrix.items():
            i, j = sorted((place[r], place[s]))
            A[j, i] = entry
        for r, entry in self._raised().items():
            A[place[r], place[r]] = entry
        self.columns: list[Sparse] = []
        self.inverses: list[Scalar] = []
        self.pivots: dict[int, Scalar] = {}
        behind: list[set[int]] = [set() for _ in self.order]
        for j, i in A:
            if j > i:
                behind[i].add(j)
        for i, r in enumerate(self.order):
            self.pivots[r] = A[i, i]
            inverse = inverse_or_zero(A[i, i])
            column = {j: A[j, i] * inverse for j in sorted(behind[i])}
            for j in column:
                for k in column:
                    if k <= j:
                        A[j, k] = A.get((j, k), 0.0) - column[k] * A[j, i]
                        if k < j:
                            behind[k].add(j)
            self.columns.append(column)
            self.inverses.append(inverse)

    def _once(self, right: Sparse) -> Sparse:
        x = [right[r] for r in self.order]
        for i, column in enumerate(self.columns):
            for j, factor in column.items():
                x[j] = x[j] - factor * x[i]
        x = [value * inverse for value, inverse in zip(x, self.inverses, strict=True)]
        for i in range(len(x) - 1, -1, -1):
            for j, factor in self.columns[i].items():
                x[i] = x[i] - factor * x[j]
        return dict(zip(self.order, x, strict=True))

    def _times(self, x: Sparse) -> Sparse:
        total: Sparse = dict.fromkeys(self.kept, 0.0)
        for (r, s), entry in self.matrix.items():
            total[r] = total[r] + entry * x[s]
            if r != s:
                total[s] = total[s] + entry * x[r]
        return total

    def multipliers(self, missing: Callable[[int], Scalar]) -> list[Scalar]:
        """lambda of all rows, that of an elastic one beside the force that acts in the drives already.

        Args:
            missing: right - J a_free of row r.
        """
        right: Sparse = {}
        for r in self.kept:
            root = self.rows[r].root
            right[r] = missing(r) if root is None else root * missing(r)
        x = self._once(right)
        for _ in range(self.precision.refinements):
            rest = {r: right[r] - value for r, value in self._times(x).items()}
            more = self._once(rest)
            x = {r: x[r] + more[r] for r in self.kept}
        found: list[Scalar] = [0.0] * len(self.rows)
        for r in self.kept:
            root = self.rows[r].root
            found[r] = x[r] if root is None else root * x[r]
        return found


def elimination_order(rows: Sequence[int], entries: Mapping[tuple[int, int], Scalar]) -> list[int]:
    """The rows in the order of least degree: each is eliminated when it couples fewest of those that are left."""
    near: dict[int, set[int]] = {r: set() for r in rows}
    for r, s in entries:
        if r != s:
            near[r].add(s)
            near[s].add(r)
    order: list[int] = []
    while near:
        best = min(near, key=lambda r: (len(near[r]), r))
        others = near.pop(best)
        for r in others:
            near[r] |= others
            near[r] -= {r, best}
        order.append(best)
    return order
