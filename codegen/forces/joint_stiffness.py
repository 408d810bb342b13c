"""Stiffness matrices of joints, and damping proportional to them: rows and their derivatives.

The coordinates s of a joint, with the velocities v, are resisted by r = K (s + tau v) + p: with the potential
1/2 s^T K s + p^T s whatever the angles are, so that the rows are exact in the coordinates and the slopes constants.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import ClassVar

from eomgen.robot.elements.joint_damping import lag_of
from eomgen.robot.elements.matrices import PAIRS, ROUND_OFF, entry_name
from eomgen.robot.parameter_names import STIFFNESSES

from ..tree.composite import Rows
from ..tree.spatial import Scalar, add_row, is_zero
from .element import ForceRows, ImplicitShare, Slopes
from .scalar_functions import Functions

SMALLEST_PIVOT = 1e-30  # what a pivot that is 0 is divided by, which single precision can hold, too
ROUND_OFFS = {"float64": ROUND_OFF, "float32": 5e-6}  # of a matrix scaled by its diagonal that is summed and factored


@dataclass(frozen=True)
class CoordinateMatrix:
    """A symmetric matrix between coordinates, by pairs of their indices on and above the diagonal; no entry is 0."""

    entries: Rows

    @classmethod
    def of(cls, numbers: Mapping[str, Scalar], index: Mapping[str, int]) -> CoordinateMatrix:
        """Make it of an element's numbers, "x.beta", and the indices of coordinates by their names."""
        named = {pair: numbers.get(entry_name(*pair), 0.0) for pair in PAIRS if index.keys() >= {*pair}}
        return cls({(index[one], index[other]): x for (one, other), x in named.items() if not is_zero(x)})

    def times(self, x: Sequence[Scalar]) -> dict[int, Scalar]:
        """Return the product with a vector over all coordinates, by the indices that have one."""
        rows: dict[int, Scalar] = {}
        for (i, j), entry in self.entries.items():
            for row, column in [(i, j)] if i == j else [(i, j), (j, i)]:
                rows[row] = rows.get(row, 0.0) + entry * x[column]
        return rows

    def directions(
        self, f: Functions, round_off: float = ROUND_OFF, kept: Mapping[int, Scalar] | None = None
    ) -> list[tuple[dict[int, Scalar], Scalar]]:
        """Return directions l with slopes d, so that the matrix is the sum of d l l^T: L D L^T with the pivots D.

        Slopes are never negative: a pivot that is none but for round-off has a column that is none, too, and is left
        out.

        Args:
            f: functions of scalars.
            round_off: share of the diagonal below which a pivot is none.
            kept: of a matrix of complex numbers, 1 or 0 by index, as of ``pivots_kept``: which pivots are some.
        """
        indices, left = sorted({i for pair in self.entries for i in pair}), dict(self.entries)
        directions = []
        for place, k in enumerate(indices):
            if (k, k) not in self.entries:
                continue
            pivot, behind = left[k, k], [i for i in indices[place + 1 :] if (k, i) in left]
            if kept is None:
                some = f.step(pivot - round_off * self.entries[k, k])
                inverse = some / f.max(pivot, SMALLEST_PIVOT)
            else:
                some = kept[k]
                inverse = some / (pivot + (1.0 - some))
            column = {i: left[k, i] * inverse for i in behind}
            directions.append(({k: 1.0, **column}, some * pivot))
            for i, j in combinations_with_replacement(behind, 2):
                left[i, j] = left.get((i, j), 0.0) - column[i] * left[k, j]
        return directions

    def pivots_kept(self, f: Functions, round_off: float) -> dict[int, Scalar]:
        """Return by index whether a pivot is more than round-off, 1 or 0."""
        return {min(row): f.step(slope) for row, slope in self.directions(f, round_off)}

    def scaled(self, factor: Scalar) -> Rows:
        """Return the entries times a factor."""
        return {pair: factor * entry for pair, entry in self.entries.items()}

    def add_to(self, rows: Rows, factor: Scalar = 1.0) -> None:
        """Add the matrix times a factor to a sparse one, both halves."""
        for (i, j), entry in self.scaled(factor).items():
            for key in {(i, j), (j, i)}:
                rows[key] = rows.get(key, 0.0) + entry


def combined(factors: Mapping[int, Scalar], rows: Sequence[Mapping[int, Scalar]]) -> dict[int, Scalar]:
    """Return the sum of sparse rows times factors, by the rows' places."""
    total: dict[int, Scalar] = {}
    for place, factor in factors.items():
        add_row(total, factor, rows[place])
    return total


def symmetric_product(entries: Rows, x: Sequence[Scalar]) -> list[Scalar]:
    """Return the product of a symmetric matrix, on and above the diagonal, with a vector of as many numbers."""
    product: list[Scalar] = [0.0] * len(x)
    for (i, j), entry in entries.items():
        for row, column in [(i, j)] if i == j else [(i, j), (j, i)]:
            product[row] = product[row] + entry * x[column]
    return product


@dataclass(frozen=True)
class StiffnessMatrix:
    """K, p by the indices of coordinates, and tau; 0 without such a damping."""

    matrix: CoordinateMatrix
    preload: Mapping[int, Scalar]
    lag: Scalar

    @classmethod
    def of(
        cls, numbers: Mapping[str, Scalar], damping: Mapping[str, Scalar], index: Mapping[str, int]
    ) -> StiffnessMatrix:
        """Make it of an element's numbers, those of the damping beside it, and the coordinates' indices by names."""
        preload = {i: numbers.get(f"preload.{name}", 0.0) for name, i in index.items()}
        forces = {i: force for i, force in preload.items() if not is_zero(force)}
        return cls(CoordinateMatrix.of(numbers, index), forces, lag_of(damping))

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> dict[int, Scalar]:
        """Return r_i."""
        ahead = q if is_zero(self.lag) else [s + self.lag * rate for s, rate in zip(q, v, strict=True)]
        rows = self.matrix.times(ahead)
        return {i: rows.get(i, 0.0) + self.preload.get(i, 0.0) for i in sorted({*rows, *self.preload})}

    def slopes(self, c: Scalar, square: Scalar) -> Rows:
        """Return c D + square K on and above the diagonal, with D = tau K; never negative."""
        return self.matrix.scaled(c * self.lag + square)

    def energy(self, q: Sequence[Scalar]) -> Scalar:
        """Return what is stored at q."""
        energy: Scalar = 0.0
        for i, force in self.matrix.times(q).items():
            energy = energy + 0.5 * q[i] * force
        for i, force in self.preload.items():
            energy = energy + force * q[i]
        return energy


class JointStiffnesses(ForceRows):
    """Stiffness matrices of all joints."""

    FAMILY: ClassVar[str] = STIFFNESSES

    @cached_property
    def springs(self) -> list[StiffnessMatrix]:
        """The matrices, each joint with a comment in front of its values."""
        springs, damping = list[StiffnessMatrix](), {x.joint: x.numbers for x in self.at.bound.joint_damping}
        for joint in self.at.bound.joint_stiffness:
            self.at.note(f"{joint.joint}: its stiffness matrix")
            springs.append(StiffnessMatrix.of(joint.numbers, damping.get(joint.joint, {}), joint.index))
        return springs

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give K (s + tau v) + p."""
        for spring in self.springs:
            yield from spring.rows(q, v).items()

    def energies(self) -> Iterator[Scalar]:
        """Give the energies of the deviations."""
        yield from (spring.energy(self.at.q) for spring in self.springs)

    def add_slopes(self, slopes: Slopes) -> None:
        """Add K and tau K."""
        for spring in self.springs:
            spring.matrix.add_to(slopes.by_q)
            if not is_zero(spring.lag):
                spring.matrix.add_to(slopes.by_v, spring.lag)

    def add_blocks(self, share: ImplicitShare) -> None:
        """Add c tau K + c^2 K."""
        for spring in self.springs:
            share.in_joint(spring.slopes)

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give the diagonals."""
        for spring in self.springs:
            yield from ((i, entry) for (i, j), entry in spring.matrix.entries.items() if i == j)
