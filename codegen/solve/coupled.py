"""Coordinates of one joint that slopes of an implicit step couple, eliminated together.

With the columns S of their directions, in the axes in front of the joint's rotations, the articulated inertia I and the
slopes K, armatures among them, the accelerations are

    (S^T I S + K) x = drives - S^T (I (a, w_dot) + p),

and I - U D^-1 U^T, p + U x_free are left, U = I S, D = S^T U + K = L diag L^T.  Rows of I along unit axes are K times
the gains D^-1 U^T, where nothing cancels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..tree.frozen_joints import JointGeometry, unit
from ..tree.recursion import NO_WRENCH, Wrench
from ..tree.spatial import ZERO, Scalar, Vec, dot, matvec, scale
from .articulated import Articulated, inverse_or_zero, less, symmetric, with_row
from .rows import Entries


@dataclass(frozen=True)
class Direction:
    """A coordinate's index and its unit axis, of a force or a moment; ``row`` 0-5 where that is one of six."""

    index: int
    axis: Wrench
    row: int | None

    def of(self, wrench: Wrench) -> Scalar:
        """Return the component of a wrench along the coordinate."""
        return dot(self.axis.force, wrench.force) + dot(self.axis.moment, wrench.moment)


@dataclass(frozen=True)
class Coupled:
    """Accelerations of the coordinates: free - gains . (a, w_dot); with what answers further drives."""

    directions: Sequence[Direction]
    matrix: Entries
    columns: Sequence[Wrench]
    gains: Sequence[Wrench]
    free: Sequence[Scalar]
    factors: Sequence[Sequence[Scalar]]
    pivots: Sequence[Scalar]
    inverses: Sequence[Scalar]

    @property
    def indices(self) -> list[int]:
        """Indices of the coordinates."""
        return [x.index for x in self.directions]

    def moved(self, free: Mapping[int, Scalar], a: Vec, d: Vec) -> dict[int, Scalar]:
        """Return accelerations by index, of (a, d) in front of them and those where that vanishes, 0 of absent ones."""
        accelerations = {}
        for x, gain in zip(self.directions, self.gains, strict=True):
            accelerations[x.index] = free.get(x.index, 0.0) - (dot(gain.force, a) + dot(gain.moment, d))
        return accelerations

    def solve(self, left: Sequence[Scalar]) -> list[Scalar]:
        """Return D^-1 left."""
        return _back(self.factors, [x * y for x, y in zip(_forward(self.factors, left), self.inverses, strict=True)])


def directions_of(joint: JointGeometry, chosen: Sequence[int]) -> list[Direction]:
    """Return directions of a joint's coordinates of these indices, in the axes in front of its rotations."""
    directions = [Direction(i, Wrench(unit(axis), ZERO), axis) for i, axis in joint.translations if i in chosen]
    for place, turn in enumerate(joint.rotations):
        axis = unit(turn.axis)
        for before in reversed(joint.rotations[:place]):
            axis = matvec(before.matrix, axis)
        if turn.index in chosen:
            directions.append(Direction(turn.index, Wrench(ZERO, axis), 3 + turn.axis if place == 0 else None))
    return directions


def eliminate_coupled(
    inertia: Articulated,
    directions: Sequence[Direction],
    slopes: Mapping[tuple[int, int], Scalar],
    drives: Sequence[Scalar],
) -> tuple[Coupled, Articulated]:
    """Eliminate coordinates from an inertia at once; return what is left, and how their accelerations follow.

    Args:
        slopes: K, (i, j) with i <= j by the coordinates' indices.
        drives: in the order of the directions.
    """
    still = Articulated(inertia.L, inertia.C, inertia.A, NO_WRENCH)
    columns = [still.answer(x.axis.force, x.axis.moment) for x in directions]
    m = len(directions)
    order = [x.index for x in directions]
    K = [[slopes.get((min(i, j), max(i, j)), 0.0) for j in order] for i in order]
    D = [[directions[i].of(columns[j]) + K[i][j] for j in range(i + 1)] for i in range(m)]
    matrix = {(directions[j].index, directions[i].index): D[i][j] for i in range(m) for j in range(i + 1)}
    factors, pivots = _factored(D)
    inverses = [inverse_or_zero(pivot) for pivot in pivots]
    left = [drive - x.of(inertia.p) for x, drive in zip(directions, drives, strict=True)]
    settled = [x * y for x, y in zip(_forward(factors, left), inverses, strict=True)]
    free, L, C, A, p = _back(factors, settled), inertia.L, inertia.C, inertia.A, inertia.p
    passed: list[Wrench] = []
    for i, column in enumerate(columns):
        for j, before in enumerate(passed):
            column = column.plus(-1.0 * factors[i][j], before)
        passed.append(column)
        L = symmetric(less(L, scale(inverses[i], column.force), column.force))
        C = less(C, scale(inverses[i], column.force), column.moment)
        A = symmetric(less(A, scale(inverses[i], column.moment), column.moment))
        p = p.plus(settled[i], column)
    gains = [x.scaled(y) for x, y in zip(passed, inverses, strict=True)]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            gains[i] = gains[i].plus(-1.0 * factors[j][i], gains[j])
    rest = Articulated(L, C, A, p)
    for i, x in enumerate(directions):
        if x.row is not None:
            row, held = NO_WRENCH, drives[i]
            for j in range(m):
                row, held = row.plus(K[i][j], gains[j]), held - K[i][j] * free[j]
            rest = with_row(rest, x.row, row, held)
    return Coupled(directions, matrix, columns, gains, free, factors, pivots, inverses), rest


def _factored(D: Sequence[Sequence[Scalar]]) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Factor D = L diag L^T; return rows of L before its ones, and the diagonal."""
    factors: list[list[Scalar]] = []
    pivots: list[Scalar] = []
    for i, row in enumerate(D):
        factor: list[Scalar] = []
        raw: list[Scalar] = []
        for j in range(i):
            entry = row[j]
            for k in range(j):
                entry = entry - raw[k] * factors[j][k]
            raw.append(entry)
            factor.append(entry * inverse_or_zero(pivots[j]))
        pivot = row[i]
        for k in range(i):
            pivot = pivot - raw[k] * factor[k]
        factors.append(factor)
        pivots.append(pivot)
    return factors, pivots


def _forward(factors: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Return L^-1 right."""
    solution: list[Scalar] = []
    for row, value in zip(factors, right, strict=True):
        for factor, before in zip(row, solution, strict=True):
            value = value - factor * before
        solution.append(value)
    return solution


def _back(factors: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Return L^-T right."""
    solution = list(right)
    for i in range(len(solution) - 1, -1, -1):
        for j in range(i + 1, len(solution)):
            solution[i] = solution[i] - factors[j][i] * solution[j]
    return solution
