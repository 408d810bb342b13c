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
class Closing:
    """Components of a constraint g(q) = 0.

    names: of the components, as in ``Model.constraints``.  values: of g, m or sines of angles.  arms: derivatives of
    each by the coordinates, by index.
    """

    names: tuple[str, ...]
    values: tuple[Expr, ...]
    arms: tuple[Mapping[int, Expr], ...]


def closing_of(model: Model, bound: Bound, q: Sequence[Expr], loops: Sequence[Closure]) -> Closing:
    """Follow the loops and couplings of a model whose numbers and coordinates are expressions."""
    values = [value for loop in loops for value in loop.values()]
    arms: list[Mapping[int, Expr]] = [row for loop in loops for row in loop.jacobian()]
    for coupling in bound.couplings:
        if coupling.law is None:
            values.append(coupling.gap(q))
            arms.append(coupling.arms)
    return Closing(model.constraints, tuple(values), tuple(arms))
