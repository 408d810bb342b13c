"""What closes a mechanism, in SymPy: the components of g(q) = 0, their Jacobian, and the forces of elastic cuts.

The components are those of ``tree.constraints``, on symbols; the multipliers' forces are J^T lambda.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from eomgen.robot.model import Model

from ..forces.cuts import Deviating, deviating
from ..forces.scalar_functions import Functions
from ..tree.bound import Bound
from ..tree.constraints import closures
from ..tree.frozen_joints import geometry
from ..tree.recursion import no_note

Expr = Any  # sympy.Expr


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
