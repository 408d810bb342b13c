"""What closes a mechanism, in SymPy: the components of g(q) = 0, their Jacobian, and the forces of elastic cuts.

The components are those of ``tree.constraints``, on symbols; the multipliers' forces are J^T lambda.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from eomgen.robot.model import Model

from ..forces.cuts import Deviating, deviating
from ..forces.scalar_functions import Functions
from ..tree.bound import Bound
from ..tree.constraints import closures
from ..tree.frozen_joints import geometry
from ..tree.recursion import no_note

Expr = Any  # sympy.Expr
Array = NDArray[np.float64]

REDUNDANT = 1e-6  # of the largest singular value: below it rows follow from others
CLOSED = 1e-9  # m, or sine of an angle
ROUNDS = 30


@dataclass(frozen=True)
class Closing:
    """Components of a constraint g(q) = 0 and the elastic coordinates of cuts and couplings.

    names: of the components, as in ``Model.constraints``.  values: of g, m or sines of angles.  arms: derivatives of
    each by the coordinates, by index.  elastic: what resists with a force instead.
    """

    names: tuple[str, ...]
    values: tuple[Expr, ...]
    arms: tuple[Mapping[int, Expr], ...]
    elastic: tuple[Deviating, ...]


@dataclass(frozen=True)
class Rank:
    """Degrees of freedom that a constraint leaves at a closed state, and names of rows that follow from the others."""

    freedoms: int
    redundant: tuple[str, ...]


def closing_of(model: Model, bound: Bound, q: Sequence[Expr], functions: Functions) -> Closing:
    """Follow the loops and couplings of a model whose numbers and coordinates are expressions."""

    def turn(angle: Expr) -> tuple[Expr, Expr]:
        return sp.sin(angle), sp.cos(angle)

    loops = list(closures(model, bound, geometry(model, bound, q, turn), turn, no_note))
    values = [value for loop in loops for value in loop.values()]
    arms: list[Mapping[int, Expr]] = [row for loop in loops for row in loop.jacobian()]
    for coupling in bound.couplings:
        if coupling.law is None:
            values.append(coupling.gap(q))
            arms.append(coupling.arms)
    return Closing(model.constraints, tuple(values), tuple(arms), tuple(deviating(bound, loops, q, functions)))


def rank_at_home(model: Model, q: Sequence[Expr], values: Sequence[Expr], J: Any) -> Rank | None:
    """Rank of a constraint in numbers at the description's home, closed from there; None if it does not close.

    Args:
        model: of the mechanism.
        q: symbols of its coordinates, n.
        values: of g, numbers and those symbols.
        J: its Jacobian, (constraints, n), likewise.
    """
    gaps, slopes = (sp.lambdify(list(q), value, modules="numpy") for value in (list(values), sp.Matrix(J)))
    moving = [i for i in range(model.size) if i not in model.prescribed]
    place = np.array(model.home)
    for _ in range(ROUNDS):
        g, rows = np.array(gaps(*place), dtype=np.float64), np.array(slopes(*place), dtype=np.float64)[:, moving]
        if np.abs(g).max() <= CLOSED:
            return _rank(model.constraints, rows)
        place[moving] -= np.linalg.lstsq(rows, g, rcond=REDUNDANT)[0]
    return None


def _rank(names: Sequence[str], rows: Array) -> Rank:
    """Gram-Schmidt with pivoting: the rows that are left when the rank is reached follow from the others."""
    sizes = np.linalg.svd(rows, compute_uv=False)
    rank = int(np.count_nonzero(sizes > REDUNDANT * sizes.max(initial=0.0)))
    rest, left = rows.copy(), list(range(len(rows)))
    for _ in range(rank):
        best = max(left, key=lambda i: float(np.linalg.norm(rest[i])))
        left.remove(best)
        unit = rest[best] / np.linalg.norm(rest[best])
        rest -= np.outer(rest @ unit, unit)
    return Rank(rows.shape[1] - rank, tuple(names[i] for i in left if np.any(rows[i])))
