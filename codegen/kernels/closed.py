"""Mechanisms with closed loops: accelerations and multipliers, and the projection onto the constraint.

M a + h = u + J^T lambda,    J a + J_dot v = 0,    g(q) = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from eomgen.robot.model import FIXED_BODY

from ..solve.elimination import NO_COUPLINGS, Elimination
from ..solve.factorised import Factors
from ..solve.reduced import ReducedTree
from ..solve.refining import precision_of, refined
from ..solve.responses import EliminatedTree, Tree, total
from ..solve.rotors import Rotors
from ..solve.rows import Row, RowSystem, Sparse
from ..solve.states import ScalarSlopes, States
from ..solve.unsymmetric import UnsymmetricSystem, scaled
from ..tree.bound import Bound
from ..tree.composite import mass_matrix
from ..tree.followers import coordinate_parents
from ..tree.recursion import inertial_rows
from ..tree.spatial import Scalar
from .constraint_rows import closure_residuals, general_rank
from .derivation import Derivation, Outputs, vector

Pivots = list[tuple[Scalar, Scalar]]
NO_SLOPES = ScalarSlopes()


def eliminated(
    d: Derivation,
    armature: Sequence[Scalar],
    drives: list[Scalar],
    v: list[Any],
    slopes: ScalarSlopes = NO_SLOPES,
    *,
    bound: Bound | None = None,
    coupled: bool = False,
    beside: Mapping[tuple[int, int], Scalar] = NO_COUPLINGS,
) -> tuple[EliminatedTree | ReducedTree, Pivots]:
    """Eliminate the tree, states and motors first: its accelerations, and pivots with what they are compared to.

    Where joints follow joints it is no tree, and the leading coordinates' matrix is factored.

    Args:
        slopes: of the transmissions and of laws with internal states in an implicit step.
        bound: the model's numbers, where they are not the derivation's.
        beside: slopes that couple coordinates of one joint or modes of one link beside the diagonal, see
            ``Elimination``.
    """
    bound = bound or d.bound
    if not led_by_modes(d):
        return reduced(d, replace(bound, armature=tuple(armature)), drives, v, slopes, beside)
    if d.followers:
        coasting = d.followers.accelerate([0.0] * d.model.size, v)
        drives = d.followers.gather(drives)
        for index in d.followers.shares:
            drives[index] = coasting[index]
    states = States(d.model, bound.armature, drives, slopes.states)
    rotors = Rotors(d.model, bound, armature, states.drives, slopes.transmissions)
    left = replace(bound, armature=tuple(rotors.armature))
    solved = Elimination(replace(d.tree, bound=left), v, rotors.drives, coupled=coupled, slopes=beside)
    rotors.release(solved.accelerations, solved.pivots)
    states.release(solved.accelerations, solved.pivots)
    return EliminatedTree(states, rotors, solved, solved.accelerations), solved.pivots


def led_by_modes(d: Derivation) -> bool:
    """Whether whatever follows others is a node of the link on which it stands: no tree of joints is shared."""
    parents = {
        i: d.model.bodies[body.parent].modes
        for body in d.model.bodies
        for i in body.indices
        if body.parent != FIXED_BODY
    }
    return all(share and set(share).issubset(parents.get(i, ())) for i, share in d.followers.shares.items())


def reduced(
    d: Derivation,
    bound: Bound,
    drives: list[Scalar],
    v: list[Any],
    slopes: ScalarSlopes = NO_SLOPES,
    beside: Mapping[tuple[int, int], Scalar] = NO_COUPLINGS,
) -> tuple[ReducedTree, Pivots]:
    """Solve by S^T M S of the coordinates that follow no others, as a tree with shared coordinates is none."""
    states = States(d.model, bound.armature, drives, slopes.states)
    rotors = Rotors(d.model, bound, bound.armature, states.drives, slopes.transmissions)
    active, prescribed = frozenset(d.active), d.model.prescribed
    left = replace(bound, armature=tuple(rotors.armature))
    coasting = d.followers.accelerate([0.0] * d.model.size, v)
    bias, _ = inertial_rows(replace(d.tree, bound=left), v, coasting, left.gravity)
    whole = mass_matrix(replace(d.tree, bound=left))
    for pair, slope in beside.items():
        whole[pair] = whole.get(pair, 0.0) + slope
    whole = d.followers.symmetric(whole)
    alone = {i for i in range(d.model.size) if i in prescribed or i in rotors.rows or i not in active}
    alone.update(states.rows)
    matrix = {pair: entry for pair, entry in whole.items() if alone.isdisjoint(pair)}
    free: list[Scalar] = [0.0 if i in prescribed else x for i, x in enumerate(rotors.drives)]
    right = d.followers.gather([drive - force for drive, force in zip(free, bias, strict=True)])
    for i in range(d.model.size):
        if i in alone:
            matrix[i, i], right[i] = 1.0, rotors.drives[i] if i in prescribed else 0.0
        else:
            for j in prescribed:
                right[i] = right[i] - whole.get((min(i, j), max(i, j)), 0.0) * rotors.drives[j]
    parents, places = [-1] * d.model.size, coordinate_parents(d.described)
    for place, i in enumerate(d.active):
        parents[i] = d.active[places[place]] if places[place] >= 0 else -1
    factors = Factors(d.model, matrix, parents)
    tree = ReducedTree(states, rotors, d.followers, factors, right)
    pivots = [(pivot, matrix[i, i]) for i, pivot in enumerate(factors.pivots)]
    apart = {*rotors.rows, *states.rows}
    return tree, [tree.pivot_pairs[i] if i in apart else pivot for i, pivot in enumerate(pivots)]


def with_rows(
    d: Derivation, tree: Tree, rows: Sequence[Row], rank: int | None = None
) -> tuple[list[Scalar], list[Scalar], RowSystem]:
    """Solve with rows: accelerations, (n,), the multipliers of all rows, and their system.

    ``rank`` is that of the rigid rows, but at singular poses, where it is known.
    """
    rows = [_changed(row, d.followers.row) for row in rows] if d.followers else rows
    pushing = _pushing(d, rows)
    responses = [tree.respond(row) for row in pushing]
    rigid = [r for r, row in enumerate(pushing) if row.jacobian_row and not row.is_elastic]
    system = RowSystem(pushing, responses, precision_of(rigid, rank, d.dtype), tree.pivots())
    multipliers = system.multipliers(lambda r: rows[r].right - tree.along(rows[r], responses[r]))
    return tree.accelerations(total(responses, multipliers)), multipliers, system


def with_felt_rows(d: Derivation, tree: Tree, rows: Sequence[Row]) -> list[Scalar]:
    """Return accelerations, (n,), with elastic rows some of which feel other directions than they act along."""
    rows = [_changed(row, d.followers.row) for row in rows] if d.followers else rows
    pushing, felt = _pushing(d, rows), [row if row.felt is None else Row(row.felt) for row in rows]
    responses = [tree.respond(row) for row in pushing]
    answers = [
        response if row.felt is None else tree.respond(other)
        for row, response, other in zip(rows, responses, _pushing(d, felt), strict=True)
    ]
    system = UnsymmetricSystem(pushing, responses, answers)
    multipliers = system.multipliers(lambda r: -1.0 * scaled(rows[r], tree.along(felt[r], answers[r])))
    return tree.accelerations(total(responses, multipliers))


def _changed(row: Row, change: Callable[[Sparse], Sparse]) -> Row:
    """Return a row with its derivatives changed."""
    return replace(row, jacobian_row=change(row.jacobian_row), felt=None if row.felt is None else change(row.felt))


def _pushing(d: Derivation, rows: Sequence[Row]) -> list[Row]:
    """Drop entries of prescribed coordinates from rows: they move the loops, but nothing moves them."""
    prescribed = set(d.model.prescribed)
    if not prescribed:
        return list(rows)
    return [_changed(row, lambda x: {i: arm for i, arm in x.items() if i not in prescribed}) for row in rows]


def constrained(d: Derivation, tree: Tree, pivots: Pivots) -> Outputs:
    """Return accelerations, multipliers, closure residuals and their rates, one after the other.

    Where rows that are independent elsewhere are not, or the accelerations stay inaccurate, the pivot of a coordinate
    that rows move counts as vanished.
    """
    residuals = closure_residuals(d, d.v)
    rows, rank = [residual.row(-residual.bias) for residual in residuals], general_rank(d.described)
    solved = refined(
        tree, rows, _pushing(d, rows), [residual.value for residual in residuals], d.v, rank, d.dtype, d.graph.call
    )
    first, last = ([x.accelerations[i] for i in d.rates] + x.multipliers for x in (solved.first, solved.last))
    values = [d.graph.choose(solved.gate, *pair) for pair in zip(last, first, strict=True)]
    values += [residual.value for residual in residuals] + [residual.rate(d.v) for residual in residuals]
    outputs = {**vector(values), **pivot_outputs(d, pivots)}
    if not solved.rigid:
        return outputs
    moved = min(i for r in solved.rigid for i in rows[r].jacobian_row if i in d.active and i not in d.model.prescribed)
    place = 2 * d.active.index(moved)
    pivot = outputs["pivot", place]
    outputs["pivot", place] = d.graph.choose(solved.gate, pivot * solved.regular, pivot)
    outputs |= {("first", i): value for i, value in enumerate(first)}
    return {**outputs, ("first_pivot", place): pivot, ("gate", 0): solved.gate}


def projection(d: Derivation, tree: Tree, pivots: Pivots) -> Outputs:
    """Project q and v onto the constraint, in the metric of the kinetic energy: changes of both, then g before them."""
    residuals = closure_residuals(d, d.still)
    closing = with_rows(d, tree, [residual.row(-residual.value) for residual in residuals])[0]
    slowing = with_rows(d, tree, [residual.row(-residual.rate(d.v)) for residual in residuals])[0]
    values = [closing[i] for i in d.active] + [slowing[i] for i in d.rates] + [residual.value for residual in residuals]
    return {**vector(values), **pivot_outputs(d, pivots)}


def pivot_outputs(d: Derivation, pivots: Pivots) -> Outputs:
    """Return for every coordinate a pivot with the size that it is compared to; those of states do not vanish."""
    outputs: Outputs = {}
    for place, index in enumerate(d.active):
        outputs["pivot", 2 * place], outputs["pivot", 2 * place + 1] = pivots[index]
    return outputs
