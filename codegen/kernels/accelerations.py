"""Accelerations from drives: M factorised, joints eliminated, and the step of a linearly implicit integration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..forces.element import Blocks, Directions, ImplicitShare, SparseRow, StateSite, StateSlopes
from ..forces.joint_stiffness import ROUND_OFFS, CoordinateMatrix, combined
from ..forces.laws import Effect
from ..solve.factorised import Factors
from ..solve.reduced import ReducedTree
from ..solve.responses import EliminatedTree, FactorisedTree, Tree
from ..solve.rows import Row, elastic_row
from ..solve.states import ScalarSlopes, StateRow, share, state_rows
from ..tree.bound import Bound
from ..tree.composite import Rows
from ..tree.spatial import ZERO, Scalar
from .closed import (
    Pivots,
    constrained,
    eliminated,
    led_by_modes,
    pivot_outputs,
    projection,
    reduced,
    with_felt_rows,
    with_rows,
)
from .constraint_rows import closure_residuals, general_rank
from .derivation import Derivation, Outputs
from .derivatives.modal_slopes import bends

FACTORISED = "M = L^T D L factorised"
ELIMINATED = "joints eliminated in O(n)"
REDUCED = "the leading coordinates' M = L^T D L factorised"
STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is tried beside the elimination


def drives_left(d: Derivation, springs: list[Scalar]) -> list[Scalar]:
    """Return drives less springs and dampers; of a prescribed coordinate its acceleration, which stands in u."""
    prescribed = d.model.prescribed
    return [u if i in prescribed else u - spring for i, (u, spring) in enumerate(zip(d.u, springs, strict=True))]


def _moving_by_elimination(d: Derivation, *, coupled: bool = False) -> tuple[EliminatedTree | ReducedTree, Pivots]:
    """Eliminate joints from the tips, without a mass matrix; of a tree with followers those of its leaders."""
    return eliminated(d, d.bound.armature, drives_left(d, d.forces(d.v)), d.v, coupled=coupled)


def _moving_by_leaders(d: Derivation) -> tuple[ReducedTree, Pivots]:
    """Factor M of the coordinates that follow no others."""
    return reduced(d, d.bound, drives_left(d, d.forces(d.v)), d.v)


def _moving_by_factors(d: Derivation) -> tuple[FactorisedTree, Pivots]:
    """Solve M = L^T D L for u minus everything but M a."""
    return _by_factors(d, [drive - row for row, drive in zip(d.dynamics_with_drives(d.v, d.still), d.u, strict=True)])


def _resting_by_elimination(d: Derivation) -> tuple[EliminatedTree | ReducedTree, Pivots]:
    rest = replace(d.bound, gravity=ZERO)
    return eliminated(d, d.bound.armature, d.still, d.still, bound=rest, coupled=True)


def _by_factors(d: Derivation, right: Sequence[Scalar]) -> tuple[FactorisedTree, Pivots]:
    """Return the tree by M = L^T D L, with the pivots and what they are compared to."""
    matrix = d.matrix()
    factors = Factors(d.model, matrix)
    return FactorisedTree(factors, right), [(pivot, matrix[i, i]) for i, pivot in enumerate(factors.pivots)]


def solved_accelerations(d: Derivation, tree: Tree, pivots: Pivots, rows: Sequence[Row] = ()) -> Outputs:
    """Solve for accelerations, with forces of rows, and a pivot with its scale for every coordinate."""
    rank = general_rank(d.described) if rows and d.described.constraints else None
    if any(row.felt is not None for row in rows):
        accelerations = with_felt_rows(d, tree, rows)
    else:
        accelerations = with_rows(d, tree, rows, rank)[0] if rows else tree.accelerations({})
    return {**d.motion(accelerations), **pivot_outputs(d, pivots)}


class MatrixShare(ImplicitShare):
    """Shares that are collected: forces, (n,), armatures with slopes, slopes of others, rows."""

    def __init__(self, d: Derivation, *at: Any) -> None:
        super().__init__(*at)
        self.forces: list[Scalar] = [0.0] * d.model.size
        self.armature = list(d.bound.armature)
        self.beside: Rows = {}
        self.slopes: dict[int, Scalar] = {}
        self.states: dict[int, StateRow] = {}
        self.rows: list[Row] = []

    def solve(self, d: Derivation, bound: Bound, drives: list[Scalar], v: list[Any], *, by_leaders: bool) -> Outputs:
        """Solve for accelerations.

        Args:
            by_leaders: factor the leading coordinates' matrix, where joints are eliminated else.
        """
        slopes = ScalarSlopes(self.slopes, self.states)
        if by_leaders:
            whole = replace(bound, armature=tuple(self.armature))
            return solved_accelerations(d, *reduced(d, whole, drives, v, slopes, self.beside), self.rows)
        options: dict[str, Any] = {"bound": bound, "coupled": bool(self.rows), "beside": self.beside}
        return solved_accelerations(d, *eliminated(d, self.armature, drives, v, slopes, **options), self.rows)


class _Step(MatrixShare):
    """Shares in a linearly implicit step: forces at its end, and what slopes add to inertia, dt D + dt^2 K."""

    def __init__(self, d: Derivation) -> None:
        self.dt, self.square = (d.graph.input("dt", place) for place in (0, 1))
        super().__init__(d, [q + self.dt * v for q, v in zip(d.q, d.v, strict=True)], d.v, self.dt, d.drive_inputs)
        self.functions, self.round_off = d.functions, ROUND_OFFS[d.dtype]
        self.places = {index: place for place, index in enumerate(d.active)}
        if d.drive_inputs:
            inverse = 1.0 / self.dt
            self.gains = {i: (0.0, inverse * self.added(d, i)) for i in d.drive_inputs}

    def added(self, d: Derivation, i: int) -> Scalar:
        """Return what a controller adds to the inertia of a coordinate."""
        return d.graph.input("added", self.places[i])

    def push(self, i: int, force: Scalar) -> None:
        self.forces[i] = self.forces[i] + force

    def on_coordinate(self, i: int, stiffness: Scalar, damping: Scalar) -> None:
        self.armature[i] = self.armature[i] + (self.dt * damping + self.square * stiffness)

    def bend(self, i: int, law: Effect) -> None:
        self.armature[i] = self.armature[i] + self._ahead(law)

    def in_internal_states(self, site: StateSite, law: StateSlopes) -> None:
        whole, f = share(law, self.dt, self.square), self.functions
        slope = f.max(whole, 0.0)
        if site.motor is not None:
            self.slopes[site.motor] = self.slopes.get(site.motor, 0.0) + slope
        elif site.coordinate is not None:
            self.armature[site.coordinate] = self.armature[site.coordinate] + slope
        else:
            self.rows.append(elastic_row(site.row, slope))
        self.states |= state_rows(site.row, site.states, law, self.dt, f.step(whole))

    def in_joint(self, slopes: Blocks) -> None:
        for (i, j), slope in slopes(self.dt, self.square).items():
            if i == j:
                self.armature[i] = self.armature[i] + slope
            elif i < j:
                self.beside[i, j] = self.beside.get((i, j), 0.0) + slope

    def in_transmission(self, motor: int, linear: Effect, law: Effect) -> None:
        nonlinear = self._ahead(law)
        slope = self.dt * linear.by_v + self.square * linear.by_s + nonlinear
        self.slopes[motor] = self.slopes.get(motor, 0.0) + slope

    def along(self, row: SparseRow, law: Effect, *, turns: bool = False) -> None:
        for i, arm in row.items():
            self.push(i, law.force * arm)
        self.rows.append(elastic_row(row, self._ahead(law)))

    def along_all(self, rows: SparseRow, directions: Directions) -> None:
        for i, force in rows.items():
            self.push(i, force)
        self.rows += [elastic_row(row, slope) for row, slope in directions(self.dt, self.square)]

    def among(self, rows: SparseRow, members: Sequence[SparseRow], slopes: Blocks, *, turns: bool = False) -> None:
        directions = CoordinateMatrix(slopes(self.dt, self.square)).directions(self.functions, self.round_off)
        self.along_all(rows, lambda c, square: [(combined(x, members), slope) for x, slope in directions])

    def _ahead(self, law: Effect) -> Scalar:
        return law.ahead(self.dt, self.square, self.functions)


def implicit_step(d: Derivation, *, by_leaders: bool = False) -> Outputs:
    """Take springs and dampers at the end of the step: they add to M's diagonal, so the elimination stays O(n).

    Those of transmissions couple a motor to its joint alone (``Rotors``).  A law that is not linear is taken along its
    tangent at the coordinate that the rate leads to; a tangent that falls is left out, so that the matrix stays
    positive definite.  Friction is taken along its secant: see ``Effect.ahead``.
    ``added`` is what a joint's controller adds to the diagonal; it acts on coordinates that are driven.
    Point-to-point springs act where their rates lead to, in the directions that they have; their tangents are no
    diagonal, but rows like those of closed loops.  Loops are closed at the end of the step, at the level of rates:
    J v = -g / dt.  Slopes of a journal and of a joint's damping couple the coordinates of the joint, and are eliminated
    with them; the directions of such a damping are those of the step's beginning.  ``by_leaders``: as of ``solve``.
    """
    step = _written_step(d)
    return step.solve(d, d.bound, drives_left(d, step.forces), d.v, by_leaders=by_leaders)


def step_has_rows(d: Derivation) -> bool:
    """Whether a linearly implicit step solves for rows."""
    return bool(_written_step(d).rows)


def _written_step(d: Derivation) -> _Step:
    """Return what all elements add to a step; see ``_Step``."""
    step = _Step(d)
    for element in d.elements:
        element.advance(step)
    for element in d.elements:
        element.add_diagonal(step)
    for element in d.elements:
        element.add_blocks(step)
    driven = frozenset(d.model.driven)
    for i in d.active:
        if i in driven and i not in d.drive_inputs:  # others act on inputs
            step.armature[i] = step.armature[i] + step.added(d, i)
    step.rows += _closing_rows(d, step.dt)
    for element in d.elements:
        element.add_rows(step)
    return step


def _closing_rows(d: Derivation, dt: Scalar) -> list[Row]:
    """Return rows that close the loops by the end of a step; they take energy out where the directions turn."""
    residuals = closure_residuals(d, d.still) if d.described.constraints else []
    rate = 1.0 / dt if residuals else 0.0
    return [residual.row(-1.0 * (rate * (residual.rate(d.v) + rate * residual.value))) for residual in residuals]


@dataclass(frozen=True)
class Variant:
    """A variant of a kernel: one of several derivations of the same numbers.

    most: coordinates up to which it is tried beside the others, because its program would be long; None for any number.
    prescribes: whether it can do with prescribed coordinates.
    suits: whether it is tried for this robot at all; most are for robots without followers.
    on_demand: whether values are put where outputs need them, because there are many of them.
    """

    write: Callable[[Derivation], Outputs]
    most: int | None = None
    prescribes: bool = True
    suits: Callable[[Derivation], bool] = lambda d: not d.followers
    on_demand: bool = False


def _variants(
    by_factors: Callable[[Derivation], Outputs],
    by_elimination: Callable[[Derivation], Outputs],
    by_leaders: Callable[[Derivation], Outputs],
) -> Mapping[str, Variant]:
    """Return the variants; ``by_leaders``: another one where whatever follows others is a node."""
    return {
        FACTORISED: Variant(
            by_factors, STRAIGHT_SOLVE, prescribes=False
        ),  # M would have to be divided by what is known
        ELIMINATED: Variant(by_elimination, suits=led_by_modes),
        REDUCED: Variant(by_leaders, suits=_suits_leaders),
    }


def _suits_leaders(d: Derivation) -> bool:
    """Whether some coordinates follow others; of robots that bend, small ones and those with rows alone.

    In others elimination costs less.
    """
    small, rows = d.model.size <= STRAIGHT_SOLVE, bool(d.described.constraints)
    return (bool(d.followers) and (small or not led_by_modes(d))) or (bends(d) and rows)


CONSTRAINED = _variants(
    lambda d: constrained(d, *_moving_by_factors(d)),
    lambda d: constrained(d, *_moving_by_elimination(d, coupled=True)),
    lambda d: constrained(d, *_moving_by_leaders(d)),
)
PROJECTION = _variants(
    lambda d: projection(d, *_by_factors(d, d.still)),
    lambda d: projection(d, *_resting_by_elimination(d)),
    lambda d: projection(d, *reduced(d, replace(d.bound, gravity=ZERO), d.still, d.still)),
)
SOLVERS = _variants(
    lambda d: solved_accelerations(d, *_moving_by_factors(d)),
    lambda d: solved_accelerations(d, *_moving_by_elimination(d)),
    lambda d: solved_accelerations(d, *_moving_by_leaders(d)),
)
