"""Closure residuals of a derivation with their derivatives: the rows of closed mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eomgen.arrays import independent_columns, rank_of
from eomgen.kernel.turning import ON, seen, singular_joints
from eomgen.robot.model import Model

from ..program.ir import Node, evaluate, finish
from ..solve.rows import DERIVING, DERIVING_INDEPENDENT, Precision, Row
from ..tree.spatial import Scalar, along, is_zero
from .derivation import Derivation, vector
from .interface import turning_joints

REDUNDANT = 1e-6  # of the largest singular value: below it rows follow from others
ROUND_OFF = 1e-12  # m, or a number: entries of J below it at random poses are zero
_SAMPLES = 3
CLOSED = 1e-9  # m, or a sine: of a state that is closed
_ROUNDS, _AWAY = 60, 0.1  # to close one, and how far from home it is looked for, m or rad
_FALLS = 0.9  # times the closure error of the step before, which one that gets closer is below
PLANE = "the loop moves in a plane: nothing moves it along this direction"


@dataclass(frozen=True)
class ClosureResidual:
    """A component of the loops' constraint: g, its derivatives by the coordinates, J_dot v, and rows of its kind."""

    value: Scalar
    jacobian_row: dict[int, Scalar]
    bias: Scalar
    group: object
    is_weak: bool = False  # but for round-off it vanishes for the description's numbers

    def row(self, right: Scalar) -> Row:
        """Return the row that makes J a ``right``."""
        return Row(self.jacobian_row, right, group=self.group, is_weak=self.is_weak)

    def rate(self, v: Sequence[Scalar]) -> Scalar:
        """Return J v."""
        return along(self.jacobian_row, v)


def closure_residuals(d: Derivation, v: Sequence[Scalar]) -> list[ClosureResidual]:
    """Return g of all loops and rigid couplings with its derivatives, in the order of ``Model.constraints``.

    Entries of J that vanish are left out.  Those of prescribed coordinates stay: they move the loops, but no multiplier
    moves them.
    """
    residuals = []
    coasting = d.followers.accelerate([0.0] * d.model.size, v)
    for closure in d.closures:
        parts = zip(closure.parts, closure.values(), closure.jacobian(), closure.bias(v), strict=True)
        for component, value, row, bias in parts:
            jacobian_row = {index: arm for index, arm in d.followers.row(row).items() if not is_zero(arm)}
            bias = bias + (along(row, coasting) if d.followers.bends else 0.0)
            residuals.append(ClosureResidual(value, jacobian_row, bias, (closure.number, component.axis is None)))
    for number, coupling in enumerate(d.bound.couplings):
        if coupling.law is None and next(iter(coupling.jacobian_row)) not in d.followers.shares:
            residuals.append(
                ClosureResidual(
                    coupling.residual(d.q), d.followers.row(coupling.jacobian_row), 0.0, ("coupling", number)
                )
            )
    return _without_round_off(d, residuals)


def vanishing_rows(model: Model) -> tuple[tuple[str, str], ...]:
    """Name the components of the constraint that no coordinate changes, in any state, with the reason."""
    if not model.constraints:
        return ()
    d = Derivation(model)
    named = zip(model.constraints, closure_residuals(d, d.still), strict=True)
    return tuple((name, PLANE) for name, residual in named if residual.jacobian_row.keys().isdisjoint(d.active))


def _without_round_off(d: Derivation, residuals: Sequence[ClosureResidual]) -> list[ClosureResidual]:
    """Drop entries of J that are round-off wherever the mechanism is: of one in a tilted plane, say.

    Where an entry is round-off for the description's numbers alone, and not for others that may be tuned, its row keeps
    it, and is weighed against the rows of all loops.  Charts of 3-DOF rotations count as tuned.
    """
    if not any(isinstance(arm, Node) for residual in residuals for arm in residual.jacobian_row.values()):
        return list(residuals)
    jacobian, rng = _Jacobian(d, residuals), np.random.default_rng(0)
    numbers = np.array(list(d.model.parameters.values()))
    largest = []
    for tuned in (0.0, 0.1):
        sizes = np.zeros((len(residuals), d.model.size))
        for _ in range(_SAMPLES):
            p = numbers * (1.0 + tuned * rng.normal(size=numbers.size)) + tuned * rng.normal(size=numbers.size)
            turned = rng.uniform(size=d.turns) if tuned else np.zeros(d.turns)
            q, p = rng.uniform(-1.5, 1.5, d.model.size), np.concatenate([p, turned])
            sizes = np.maximum(sizes, np.abs(jacobian.at(q.tolist(), p.tolist())))
        largest.append(sizes > ROUND_OFF)
    kept = []
    for residual, now, ever in zip(residuals, *largest, strict=True):
        left = {index: arm for index, arm in residual.jacobian_row.items() if ever[index]}
        kept.append(replace(residual, jacobian_row=left, is_weak=bool(left) and not now.any()))
    return kept


def is_redundant(model: Model) -> bool:
    """Whether some rows of the constraint follow from others at home, as far as home is closed."""
    d = Derivation(model, turned=True)
    residuals = [residual for residual in closure_residuals(d, d.still) if residual.jacobian_row]
    if not residuals:
        return False
    moving = [i for i in d.active if i not in d.model.prescribed]
    J = _Jacobian(d, residuals).at(*_regular(model, np.array(model.home)))[:, moving]
    return rank_of(J, REDUNDANT) < len(residuals)


def general_rank(model: Model) -> int | None:
    """Return the constraint's rank in closed states near home, but for singular poses; None if no state closes.

    States in which nothing can move count where there are no others: they may lie beside those of a mechanism.
    """
    d = Derivation(model, turned=True)
    residuals = [residual for residual in closure_residuals(d, d.still) if residual.jacobian_row]
    if not residuals:
        return 0
    rng, home = np.random.default_rng(0), np.array(model.home)
    away = [np.zeros(home.size), *rng.normal(size=(_SAMPLES, home.size))]
    closed = (_closed_jacobian(d, residuals, *_regular(model, home + _AWAY * step)) for step in away)
    ranks = [(rank_of(J, REDUNDANT), J.shape[1]) for J in closed if J is not None]
    moving = [rank for rank, columns in ranks if rank < columns]
    return max(moving or [rank for rank, _ in ranks], default=None)


def deriving_precision(model: Model, rows: int, dtype: str) -> Precision:
    """Say how precisely so many rows that do not vanish are factored where accelerations are differentiated."""
    return (DERIVING_INDEPENDENT if general_rank(model) == rows else DERIVING)[dtype]


@dataclass(frozen=True)
class Rank:
    """Degrees of freedom that a constraint leaves at a closed state, and names of rows that follow from the others."""

    freedoms: int
    redundant: tuple[str, ...]


def rank_at_home(model: Model) -> Rank | None:
    """Return the constraint's rank at the description's home, closed from there; None if it does not close.

    Components that nothing changes are not among those that follow from others.
    """
    d = Derivation(model, turned=True)
    named = [
        (name, residual)
        for name, residual in zip(model.constraints, closure_residuals(d, d.still), strict=True)
        if residual.jacobian_row
    ]
    J = _closed_jacobian(d, [residual for _, residual in named], *_regular(model, np.array(model.home)))
    if J is None:
        return None
    rank = rank_of(J, REDUNDANT)
    independent = independent_columns(J.T, rank)
    return Rank(J.shape[1] - rank, tuple(name for r, (name, _) in enumerate(named) if r not in independent))


def _regular(model: Model, q: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    """Return a state, (n,), in angles that are not singular; numbers of parameters and of joints that are turned."""
    joints = {name: (at["angles"], at["origin"]) for name, at in turning_joints(model)["joints"].items()}
    turned = singular_joints(q, joints)
    places = [joints[name] for name in joints if name in turned]
    here = seen(np.concatenate([q, np.zeros_like(q)])[np.newaxis], places, ON, np.zeros_like(q))[0, : q.size]
    return here.tolist(), [*model.parameters.values(), *(float(name in turned) for name in joints)]


def _closed_jacobian(
    d: Derivation, residuals: Sequence[ClosureResidual], begin: Sequence[float], numbers: Sequence[float]
) -> NDArray[np.float64] | None:
    """Assemble a state by the Gauss-Newton method; return J there by what is not prescribed, (rows, moving).

    None where it finds none.  Steps go on as long as the closure error falls: where rows follow from others in closed
    states alone, these come apart by the root of the error, and would pass as independent.

    Args:
        numbers: of the parameters, and of charts of 3-DOF rotations.
    """
    jacobian, q = _Jacobian(d, residuals), np.array(begin)
    values = finish(d.graph, "gaps", vector([residual.value for residual in residuals]))
    moves = [i not in d.model.prescribed for i in d.active]
    places = [place for place, moved in enumerate(moves) if moved]
    moving = [d.active[place] for place in places]
    closest, last = None, np.inf
    for _ in range(_ROUNDS):
        g = np.array(list(evaluate(values, {"q": q.tolist(), "p": numbers}).values()))
        J, error = jacobian.at(q.tolist(), numbers)[:, moving], np.abs(g).max(initial=0.0)
        if error >= _FALLS * last and closest is not None:
            break
        closest, last = J if error <= CLOSED else None, error
        q[places] -= np.linalg.lstsq(J, g, rcond=REDUNDANT)[0]
    return closest


class _Jacobian:
    """J of closure residuals as numbers."""

    def __init__(self, d: Derivation, residuals: Sequence[ClosureResidual]) -> None:
        self._places = [(r, i) for r, residual in enumerate(residuals) for i in residual.jacobian_row]
        self._shape = (len(residuals), d.model.size)
        self._program = finish(
            d.graph, "arms", vector([arm for residual in residuals for arm in residual.jacobian_row.values()])
        )

    def at(self, q: Sequence[float], p: Sequence[float]) -> NDArray[np.float64]:
        """Evaluate J at coordinates and parameters, (residuals, n)."""
        J = np.zeros(self._shape)
        for place, value in zip(self._places, evaluate(self._program, {"q": q, "p": p}).values(), strict=True):
            J[place] = value
        return J
