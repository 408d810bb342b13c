"""Drives of closed mechanisms: minimum-norm actuation of a motion, together with the forces in the loops.

    u + J^T lambda = needed,    u = 0 where there is no drive,    sum of u^2 the least.

Where there are no more drives than degrees of freedom, the rows without a drive give lambda; where there are more, they
are a condition.  Both are one problem of least squares, in which what is left at coordinates without a drive weighs
1 / ``weight`` times as much as the drives.  Its normal equations have the pattern of J J^T and are factored once; the
method of multipliers (M. Hestenes, "Multiplier and Gradient Methods", J. Optimization Theory and Applications 4, 1969)
makes the condition exact in a fixed number of steps.  What is left is formed in the coordinates, not in the normal
equations, so that their condition number slows convergence down but does not limit the accuracy.

Lengths and angles are compared by what loops make of them: entries of J are divided by the size of their kind of rows,
and the coordinates without a drive are weighed by kinds, so that a mechanism in millimetres converges as one in metres.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from ..tree.spatial import Scalar
from .rows import Precision, Response, Row, RowSystem, Sparse


@dataclass(frozen=True)
class Weighing:
    """Weight of the drives in the least squares, and what the normal equations need: see ``Precision``."""

    weight: float
    factors: Precision


# Of mechanisms that have no more drives than freedoms for certain, and of all others; refinements are steps of the
# method of multipliers.  Without a choice between drives they may weigh next to nothing, so that a drive of little
# leverage, near a dead centre, is solved for as well.  With a choice their weight has to stand out from round-off and
# ``added``.
WEIGHINGS: Mapping[str, tuple[Weighing, Weighing]] = {
    "float64": (Weighing(1e-12, Precision(1e-14, 1e-14, 3)), Weighing(3e-8, Precision(1e-14, 1e-14, 4))),
    "float32": (Weighing(1e-6, Precision(3e-7, 3e-7, 4)), Weighing(1e-4, Precision(1e-6, 1e-6, 5))),
}


def least_drives(
    rows: Sequence[Row],
    needed: Sequence[Scalar],
    driven: Collection[int],
    turns: Callable[[int], bool],
    weighings: tuple[Weighing, Weighing],
) -> tuple[list[Scalar], list[Scalar], list[Scalar]]:
    """Compute the minimum-norm drives, multipliers of the rows, and what no drive can take.

    Args:
        rows: of the constraint; whether one of a loop is one of angles is the last entry of its ``group``.
        needed: M a + h, (n,).
        driven: coordinates with a drive.
        turns: says of a coordinate whether it is an angle.
        weighings: for the precision that C computes with.

    Returns:
        u, (n,), 0 where there is no drive; lambda, (rows,); and what is left, (n,), 0 where there is one.
    """
    certain, general = weighings
    weighing = certain if _has_no_choice(rows, driven) else general
    weights = _weights(rows, driven, turns, weighing.weight)
    responses = [
        Response(dict(row.jacobian_row), {i: weights[i] * arm for i, arm in row.jacobian_row.items()}) for row in rows
    ]
    system = RowSystem(rows, responses, weighing.factors)
    multipliers: list[Scalar] = [0.0] * len(rows)
    held: Sparse = dict.fromkeys(weights, 0.0)  # multipliers of the condition, where there is no drive
    rest = {i: needed[i] for i in weights}
    for _ in range(weighing.factors.refinements + 1):
        push = {i: (weights[i] * x if i in driven else weights[i] * x + held[i]) for i, x in rest.items()}
        more = system.once({r: rows[r].along(push) for r in system.kept})
        for r, step in more.items():
            multipliers[r] = multipliers[r] + step
        rest = _less(needed, rows, multipliers, weights)
        for i in held:
            if i not in driven:
                held[i] = held[i] + weights[i] * rest[i]
    whole = [rest.get(i, x) for i, x in enumerate(needed)]
    drives: list[Scalar] = [x if i in driven else 0.0 for i, x in enumerate(whole)]
    left: list[Scalar] = [0.0 if i in driven else x for i, x in enumerate(whole)]
    return drives, multipliers, left


def _has_no_choice(rows: Sequence[Row], driven: Collection[int]) -> bool:
    """Whether no connected component has more drives than coordinates less rows, and so than freedoms."""
    parts: list[tuple[set[int], int]] = []  # coordinates that rows couple, and the number of these rows
    for row in rows:
        coupled, count = set(row.jacobian_row), 1 if row.jacobian_row else 0
        apart = [component for component in parts if not component[0] & coupled]
        for members, number in (component for component in parts if component[0] & coupled):
            coupled, count = coupled | members, count + number
        parts = [*apart, (coupled, count)]
    return all(len(members.intersection(driven)) <= len(members) - count for members, count in parts)


def _less(needed: Sequence[Scalar], rows: Sequence[Row], multipliers: Sequence[Scalar], moved: Iterable[int]) -> Sparse:
    """Return needed - J^T lambda at the coordinates that the loops move."""
    rest = {i: needed[i] for i in moved}
    for row, multiplier in zip(rows, multipliers, strict=True):
        for i, arm in row.jacobian_row.items():
            rest[i] = rest[i] - arm * multiplier
    return rest


def _weights(rows: Sequence[Row], driven: Collection[int], turns: Callable[[int], bool], weight: float) -> Sparse:
    """Weigh every coordinate that the loops move: ``weight`` of a drive, about 1 of the others by their kinds."""
    squares = [{i: arm * arm for i, arm in row.jacobian_row.items()} for row in rows]
    sizes: dict[object, Scalar] = {}
    for row, square in zip(rows, squares, strict=True):
        for x in square.values():
            sizes[_kind(row)] = sizes.get(_kind(row), 0.0) + x
    inverses = {kind: 1.0 / size for kind, size in sizes.items()}
    shares: Sparse = {}
    for row, square in zip(rows, squares, strict=True):
        for i, x in square.items():
            shares[i] = shares.get(i, 0.0) + inverses[_kind(row)] * x
    groups: dict[object, list[int]] = {}
    for i in sorted(shares):
        groups.setdefault("driven" if i in driven else turns(i), []).append(i)
    means = {group: _mean([shares[i] for i in members]) for group, members in groups.items()}
    weights: Sparse = dict.fromkeys(groups.get("driven", ()), weight)
    for group, members in groups.items():
        if group != "driven":
            weights |= dict.fromkeys(members, means.get("driven", 1.0) / means[group])
    return dict(sorted(weights.items()))


def _kind(row: Row) -> object:
    """Say of a loop's rows whether they are angles; every coupling is a separate kind."""
    return row.group[-1] if isinstance(row.group, tuple) and isinstance(row.group[-1], bool) else row.group


def _mean(values: Sequence[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for value in values:
        total = total + value
    return total * (1.0 / len(values))
