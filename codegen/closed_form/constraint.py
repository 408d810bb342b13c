"""Constraint of a closed mechanism, in SymPy: the components of g(q) = 0 and their Jacobian.

The components are those of ``tree.constraints``, on symbols; the multipliers' forces are J^T lambda.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from eomgen.robot.model import Model

from ..tree.bound import Bound
from ..tree.constraints import Closure

Expr = Any  # sympy.Expr


@dataclass(frozen=True)
class ConstraintExpressions:
    """Components of a constraint g(q) = 0.

    names: of the components, as in ``Model.constraints``.  values: of g, m or sines of angles.  jacobian: rows of J,
    derivatives by the coordinates, by index.
    """

    names: tuple[str, ...]
    values: tuple[Expr, ...]
    jacobian: tuple[Mapping[int, Expr], ...]


def constraint_of(model: Model, bound: Bound, q: Sequence[Expr], loops: Sequence[Closure]) -> ConstraintExpressions:
    """Build g and J of a model's loops and rigid couplings; numbers and coordinates are expressions."""
    values = [value for loop in loops for value in loop.values()]
    rows: list[Mapping[int, Expr]] = [row for loop in loops for row in loop.jacobian()]
    for coupling in bound.couplings:
        if coupling.law is None:
            values.append(coupling.residual(q))
            rows.append(coupling.jacobian_row)
    return ConstraintExpressions(model.constraints, tuple(values), tuple(rows))
