"""Accelerations from drives: M factorised, joints eliminated, and the step of a linearly implicit integration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from ..forces.cuts import Deviating
from ..forces.rows import effects, stretches
from ..forces.springs import Along
from ..solve.factorised import Factors, solve
from ..solve.reduced import ReducedTree
from ..solve.responses import EliminatedTree, FactorisedTree
from ..solve.rows import Row, elastic_row
from ..tree.composite import Rows
from ..tree.spatial import Scalar
from .closed import Pivots, constrained, eliminated, pivot_outputs, settling, with_rows
from .constraint_rows import gaps, general_rank
from .derivation import Derivation, Outputs

FACTORISED = "M = L^T D L factorised"
ELIMINATED = "joints eliminated in O(n)"
REDUCED = "the leading coordinates' M = L^T D L factorised"
STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is tried beside the elimination


def _solved(d: Derivation, acceleration: Sequence[Scalar], pivots: Pivots) -> Outputs:
    """Accelerations, and for every coordinate a pivot with the size that it is compared to."""
    return {**d.motion(acceleration), **pivot_outputs(d, pivots)}


def _factorised(d: Derivation) -> Outputs:
    """M = L^T D L, solved for u minus everything but M a."""
    right = [drive - row for row, drive in zip(d.dynamics(d.v, d.still), d.u, strict=True)]
    matrix = d.matrix()
    acceleration, pivots = solve(d.model, matrix, right)
    return _solved(d, acceleration, [(pivot, matrix[i, i]) for i, pivot in enumerate(pivots)])


def drives_left(d: Derivation, springs: list[Scalar]) -> list[Scalar]:
    """Drives less springs and dampers; of a prescribed coordinate its acceleration, which stands in u."""
    given = d.model.prescribed
    return [u if i in given else u - spring for i, (u, spring) in enumerate(zip(d.u, springs, strict=True))]


def _eliminated(d: Derivation) -> Outputs:
    """Joint by joint from the tips, without a mass matrix."""
    tree, pivots = eliminated_tree(d, drives_left(d, d.forces(d.v)))
    return _solved(d, tree.free, pivots)


def eliminated_tree(
    d: Derivation, drives: list[Scalar], *, coupled: bool = False
) -> tuple[EliminatedTree | ReducedTree, Pivots]:
    """The tree with its joints eliminated, in forward dynamics; with followers that of its leaders."""
    return eliminated(d, d.bound.armature, drives, d.v, coupled=coupled)


def _constrained_by_elimination(d: Derivation) -> Outputs:
    return constrained(d, *eliminated_tree(d, drives_left(d, d.forces(d.v)), coupled=True))


def _constrained_by_factors(d: Derivation) -> Outputs:
    right = [drive - row for row, drive in zip(d.dynamics(d.v, d.still), d.u, strict=True)]
    return constrained(d, *_by_factors(d, right))


def _settling_by_elimination(d: Derivation) -> Outputs:
    rest = replace(d.bound, gravity=(0.0, 0.0, 0.0))
    return settling(d, *eliminated(d, d.bound.armature, d.still, d.still, bound=rest, coupled=True))


def _settling_by_factors(d: Derivation) -> Outputs:
    return settling(d, *_by_factors(d, d.still))


def _by_factors(d: Derivation, right: Sequence[Scalar]) -> tuple[FactorisedTree, Pivots]:
    """The tree by M = L^T D L, with the pivots and what they are compared to."""
    matrix = d.matrix()
    factors = Factors(d.model, matrix)
    return FactorisedTree(factors, right), [(pivot, matrix[i, i]) for i, pivot in enumerate(factors.pivots)]


def implicit_step(d: Derivation) -> Outputs:
    """Springs and dampers at the end of the step: they add to the diagonal of M, so the elimination stays O(n).

    Those of transmissions couple a motor to its joint alone (``Rotors``).  A law that is not linear is taken along its
    tangent at the coordinate that the rate leads to; a tangent that falls is left out, so that the matrix stays
    positive definite.  Friction is taken along its secant: see ``Effect.ahead``.
    ``added`` is what a joint's controller adds to the diagonal; it acts on coordinates that are driven.
    Springs between points act where their rates lead to, in the directions that they have; their tangents are no
    diagonal, but rows like those of closed loops.  Loops are closed at the end of the step, at the level of rates:
    J v = -g / dt.  Slopes of a journal and of a joint's damping couple the coordinates of the joint, and are eliminated
    with them; the directions of such a damping are those of the step's beginning.
    """
    dt, square = d.graph.input("dt", 0), d.graph.input("dt", 1)
    ahead = [q + dt * v for q, v in zip(d.q, d.v, strict=True)]
    springs = d.resisting(ahead, d.v)
    pulls = [line.along(dt) for line in d.lines(d.v)]
    for pull in pulls:
        for i, arm in pull.arms.items():
            springs[i] = springs[i] + pull.tension * arm
    touching = [touch.ahead(dt) for touch in d.touches(d.v)]
    for touch in touching:
        for i, force in touch.rows().items():
            springs[i] = springs[i] + force
    for damper in d.dampers:
        for i, force in damper.rows(d.v).items():
            springs[i] = springs[i] + force
    armature = list(d.bound.armature)
    for i, (stiffness, damping) in enumerate(zip(d.bound.stiffness, d.bound.damping, strict=True)):
        armature[i] = armature[i] + (dt * damping + square * stiffness)
    for i, law in effects(d.bound, ahead, d.v, d.functions).items():
        armature[i] = armature[i] + law.ahead(dt, square, d.functions)
    beside: Rows = {}
    blocks = ((touch.slopes(dt, square) for touch in touching), (damper.slopes(dt) for damper in d.dampers))
    for block in chain.from_iterable(blocks):
        for (i, j), slope in block.items():
            if i == j:
                armature[i] = armature[i] + slope
            elif i < j:
                beside[i, j] = beside.get((i, j), 0.0) + slope
    driven = frozenset(d.model.driven)
    for place, i in enumerate(d.own):
        if i in driven:
            armature[i] = armature[i] + d.graph.input("added", place)
    slopes = {}
    for i, stretch in stretches(d.bound, ahead, d.v, d.functions).items():
        nonlinear = stretch.nonlinear.ahead(dt, square, d.functions)
        slopes[i] = dt * stretch.linear.by_v + square * stretch.linear.by_s + nonlinear
    rows = [*_closing_rows(d, dt), *(_elastic_row(d, pull, dt, square) for pull in pulls)]
    for own in d.deviating:
        if own.has_force:
            rows.append(_cut_row(d, own, dt, square, springs))
    for cut in d.cut_touches(d.v):
        there = cut.ahead(dt)
        for i, force in there.rows().items():
            springs[i] = springs[i] + force
        rows += [elastic_row(arms, slope) for arms, slope in there.directions(dt, square)]
    tree, pivots = eliminated(d, armature, drives_left(d, springs), d.v, slopes, coupled=bool(rows), beside=beside)
    rank = general_rank(d.described) if d.described.constraints else None
    return _solved(d, with_rows(d, tree, rows, rank)[0] if rows else tree.free, pivots)


def _closing_rows(d: Derivation, dt: Scalar) -> list[Row]:
    """Rows that close the loops by the end of a step; they take energy out where the loops' directions turn."""
    found = gaps(d, d.still) if d.described.constraints else []
    rate = 1.0 / dt if found else 0.0
    return [gap.row(-1.0 * (rate * (gap.rate(d.v) + rate * gap.value))) for gap in found]


def _cut_row(d: Derivation, own: Deviating, dt: Scalar, square: Scalar, springs: list[Scalar]) -> Row:
    """The row of a cut joint's coordinate with a force, which ``springs`` get: where its rate leads to after dt."""
    found = own.resists(d.v, d.functions, dt)
    for i, arm in own.arms.items():
        springs[i] = springs[i] + found.force * arm
    return elastic_row(own.arms, found.ahead(dt, square, d.functions))


def _elastic_row(d: Derivation, pull: Along, dt: Scalar, square: Scalar) -> Row:
    """The row of a spring between two points, whose slope is left out where it falls."""
    slope = d.functions.max(dt * pull.by_rate + square * pull.by_e, 0.0)
    return elastic_row(pull.arms, slope)


@dataclass(frozen=True)
class Way:
    """One of several ways to write a kernel.

    most: coordinates up to which it is tried beside the others, because its program would be long; None for any number.
    prescribes: whether it can do with coordinates whose motion is given.
    suits: whether it is tried for this robot at all; most are for robots without followers.
    on_demand: whether values are put where outputs need them, because there are many of them.
    """

    write: Callable[[Derivation], Outputs]
    most: int | None = None
    prescribes: bool = True
    suits: Callable[[Derivation], bool] = lambda d: not d.followers
    on_demand: bool = False


def _follows(d: Derivation) -> bool:
    """Whether coordinates follow others."""
    return bool(d.followers)


CONSTRAINED: Mapping[str, Way] = {
    FACTORISED: Way(_constrained_by_factors, STRAIGHT_SOLVE, prescribes=False),
    ELIMINATED: Way(_constrained_by_elimination),
    REDUCED: Way(_constrained_by_elimination, suits=_follows),
}
SETTLING: Mapping[str, Way] = {
    FACTORISED: Way(_settling_by_factors, STRAIGHT_SOLVE, prescribes=False),
    ELIMINATED: Way(_settling_by_elimination),
    REDUCED: Way(_settling_by_elimination, suits=_follows),
}
SOLVERS: Mapping[str, Way] = {
    FACTORISED: Way(_factorised, STRAIGHT_SOLVE, prescribes=False),  # M would have to be divided by what is known
    ELIMINATED: Way(_eliminated),
    REDUCED: Way(_eliminated, suits=_follows),
}
