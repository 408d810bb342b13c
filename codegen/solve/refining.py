"""Solutions of rows whose accuracy is measured: refined by what they leave of the constraint, or refused.

The system of the rows, A = J M^-1 J^T, has the square of J's condition number, and beside a singular pose the solution
by its factors loses twice the digits that J alone would cost.  So what is left of the constraint is formed anew from
the accelerations, right - J a, and solved for once more (iterative refinement: J. H. Wilkinson, "Rounding Errors in
Algebraic Processes", 1963): what stays wrong is round-off times J's condition number.  Passes follow behind a gate,
which is shut where the first solution is as good.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from ..tree.spatial import Scalar
from ..tree.traced import Traced
from .responses import Tree, total
from .rows import PRECISIONS, Precision, Row, RowSystem, Sparse


@dataclass(frozen=True)
class Accuracy:
    """Limits at which a solution is refined, how often, and at which it is refused.

    passes, refinements: by what is left of the constraint, and within each pass by the factors.
    tolerance: greatest last change of the accelerations, in parts of these, and greatest effect of round-off.
    round_off: of the rows' terms, in parts of these.
    of_jacobian: that of the entries of J, by which the rows' forces are uncertain, in parts of these.
    """

    passes: int
    refinements: int
    tolerance: float
    round_off: float
    of_jacobian: float


@dataclass(frozen=True)
class IndependentRows(Accuracy):
    """Accuracy of rows that are independent but at singular poses.

    precision: of their factors.  doubtful, hidden: ``RowSystem.hidden`` from which on they are refined, and refused.
    """

    precision: Precision
    doubtful: float
    hidden: float


@dataclass(frozen=True)
class DependentRows(Accuracy):
    """Accuracy of rows some of which always follow from others.

    left: what is left of the right sides, in parts of these, from which on they are refined.
    small: pivots in parts of their group's diagonal; with more such ones than rows that follow they are refined, too.
    by_residual: change of the accelerations by the square of the closure residuals, in parts of these, that is allowed.
    """

    left: float
    small: float
    by_residual: float


INDEPENDENT: Mapping[str, IndependentRows] = {
    "float64": IndependentRows(3, 1, 3e-10, 1e-15, 7e-17, Precision(1e-14, 1e-14, 1), 1e-11, 0.02),
    "float32": IndependentRows(3, 2, 1e-3, 4e-7, 4e-8, Precision(5e-7, 5e-7, 2), 1e-4, 0.3),
}
DEPENDENT: Mapping[str, DependentRows] = {
    "float64": DependentRows(3, 3, 3e-10, 1e-15, 7e-17, 1e-13, 1e-4, 1e12),
    "float32": DependentRows(3, 3, 1e-3, 4e-7, 4e-8, 3e-6, 2e-2, 1e7),
}
FURTHER = 0.5  # of a row that follows from others beside those that always do


@dataclass(frozen=True)
class Solution:
    """Accelerations, (n,), and multipliers of all rows."""

    accelerations: list[Scalar]
    multipliers: list[Scalar]


@dataclass(frozen=True)
class Refined:
    """A first solution, and the one behind the gate.

    gate: greater than 0 where the first one is not good enough.  regular: greater than 0 where the other one is.
    rigid: indices of the rows that are solved for.
    """

    first: Solution
    last: Solution
    gate: Scalar
    regular: Scalar
    rigid: Sequence[int]


def refined(
    tree: Tree,
    rows: Sequence[Row],
    pushing: Sequence[Row],
    residuals: Sequence[Scalar],
    rates: Sequence[Scalar],
    rank: int | None,
    dtype: str,
    call: Callable[..., Scalar],
) -> Refined:
    """Solve for the accelerations of a tree with rigid rows.

    Args:
        pushing: the rows, without entries of prescribed coordinates.
        residuals: g of the rows' constraints, m or numbers.
        rank: of the rows, but at singular poses; None where that is not known.
        call: (name, *arguments) -> value of an operation that is no arithmetic.
    """
    responses = [tree.respond(row) for row in pushing]
    kept = [r for r, row in enumerate(pushing) if row.jacobian_row]
    follow = len(kept) - (rank or 0)
    is_independent = rank is not None and follow == 0
    how = INDEPENDENT[dtype] if is_independent else DEPENDENT[dtype]
    system = RowSystem(pushing, responses, precision_of(kept, rank, dtype), tree.pivots())
    missing = {r: rows[r].right - tree.along(rows[r], responses[r]) for r in kept}
    solved = system.solved(missing, system.precision.refinements)
    first = last = Solution(tree.accelerations(total(responses, solved.multipliers)), solved.multipliers)
    if not kept:
        return Refined(first, first, 0.0, 1.0, ())
    if is_independent:
        gate, singular = _gate_of_independent(system, INDEPENDENT[dtype], call)
    else:
        gate, singular = _gate_of_dependent(system, DEPENDENT[dtype], (solved.rest, missing), follow, call)
        if rank is None:
            singular = 0.0
    changes: list[Scalar] = []
    for _ in range(how.passes):
        rest = {r: rows[r].right - rows[r].along(last.accelerations) for r in kept}
        more = system.solved(rest, how.refinements)
        changes = tree.changes(total(responses, more.multipliers))
        last = Solution(_sums(last.accelerations, changes), _sums(last.multipliers, more.multipliers))
    free = (x - y for x, y in zip(first.accelerations, tree.changes(total(responses, first.multipliers)), strict=True))
    size = _squares(last.accelerations)
    allowed: Scalar = how.tolerance**2
    if not is_independent:
        error = DEPENDENT[dtype].by_residual * _squares(residuals)
        allowed = allowed + error * error
    unknown = system.solved(_round_off(rows, kept, last.accelerations, rates, how.round_off, call), 0)
    uncertain = _squares(tree.changes(total(responses, unknown.multipliers)))
    pushed = _round_off_of_forces(pushing, kept, last.multipliers, how.of_jacobian, call)
    moved = tree.changes(total([tree.respond(Row(pushed))], [1.0]))
    held = system.solved({r: -1.0 * rows[r].along(moved) for r in kept}, how.refinements)
    uncertain = uncertain + _squares(_sums(moved, tree.changes(total(responses, held.multipliers))))
    wrong = call("step", singular) + call("step", _squares(changes) - allowed * (size + _squares(free)))
    wrong = wrong + call("step", uncertain - how.tolerance**2 * size)
    return Refined(first, last, gate, 1.0 - 2.0 * wrong, kept)


def precision_of(kept: Sequence[int], rank: int | None, dtype: str) -> Precision:
    """Say how precisely rows are factored, of a rank that is known or not."""
    return INDEPENDENT[dtype].precision if rank == len(kept) else PRECISIONS[dtype]


def _gate_of_independent(system: RowSystem, how: IndependentRows, call: Callable[..., Scalar]) -> tuple[Scalar, Scalar]:
    """Write two numbers greater than 0 where independent rows are to be refined, and where they are singular."""
    hidden = call("max", system.hidden(), -1.0 * system.hidden())
    return hidden - how.doubtful, hidden - how.hidden


def _gate_of_dependent(
    system: RowSystem, how: DependentRows, rests: tuple[Sparse, Sparse], follow: int, call: Callable[..., Scalar]
) -> tuple[Scalar, Scalar]:
    """Write them for rows of which ``follow`` always follow from others, by what is left and what was asked for."""
    left, missing = rests
    gate = _squares(left.values()) - how.left**2 * _squares(missing.values())
    gate = call("max", gate, system.small_pivots(how.small, call) - (follow + FURTHER))
    return gate, system.dependent() - (follow + FURTHER)


def _round_off(
    rows: Sequence[Row],
    kept: Sequence[int],
    a: Sequence[Scalar],
    v: Sequence[Scalar],
    share: float,
    call: Callable[..., Scalar],
) -> dict[int, Scalar]:
    """Bound what round-off makes of the right sides: a share of the terms of each group, which sums of them have lost.

    Signs and sizes differ from row to row, so that they do not cancel along any one direction.
    """
    terms: dict[object, Scalar] = {}
    for r in kept:
        squares = rows[r].right * rows[r].right
        for i, arm in rows[r].jacobian_row.items():
            squares = squares + (arm * arm) * (a[i] * a[i] + (v[i] * v[i]) * (v[i] * v[i]))
        terms[rows[r].group] = terms.get(rows[r].group, 0.0) + squares
    roots = {group: call("sqrt", x) for group, x in terms.items()}
    return {r: _share(share, k, "constraint row") * roots[rows[r].group] for k, r in enumerate(kept)}


def _round_off_of_forces(
    rows: Sequence[Row], kept: Sequence[int], multipliers: Sequence[Scalar], share: float, call: Callable[..., Scalar]
) -> Sparse:
    """Bound what round-off of J's entries makes of the rows' forces on the coordinates.

    A small entry is a difference of large ones, and as uncertain as all of its group.  Beside a singular pose there are
    large multipliers that hardly push, and J says but roughly in which directions the mechanism yields to forces.
    """
    squares: dict[tuple[object, int], Scalar] = {}
    loads: dict[object, Scalar] = {}
    for r in kept:
        group = rows[r].group
        loads[group] = loads.get(group, 0.0) + multipliers[r] * multipliers[r]
        for i, arm in rows[r].jacobian_row.items():
            squares[group, i] = squares.get((group, i), 0.0) + arm * arm
    forces: Sparse = {}
    for (group, i), size in squares.items():
        forces[i] = forces.get(i, 0.0) + size * loads[group]
    return {i: _share(share, k, "coordinate") * call("sqrt", forces[i]) for k, i in enumerate(sorted(forces))}


def _share(share: float, place: int, of: str) -> float:
    """Return about a share or the negative of it, another number at every place."""
    size = share * (0.9 + 0.2 * ((0.618 * place) % 1.0))
    sign = -1.0 if place % 2 else 1.0
    traced: float = sign * Traced(size, f"round-off of {of} {place + 1} of loops, as a share of its terms")
    return traced


def _squares(values: Iterable[Scalar]) -> Scalar:
    """Sum squares."""
    total: Scalar = 0.0
    for x in values:
        total = total + x * x
    return total


def _sums(one: Sequence[Scalar], other: Sequence[Scalar]) -> list[Scalar]:
    """Add two vectors."""
    return [x + y for x, y in zip(one, other, strict=True)]
