"""Numbers of expressions: those that a person reads as whole or half are exact."""

from __future__ import annotations

from typing import Any

import sympy as sp

Expr = Any  # sympy.Expr


def exact(number: Any) -> Expr:
    """Make floats that are small multiples of 1/2 exact in a number or expression: they prune, and read better."""
    expression = sp.sympify(number)
    small = {f: sp.Rational(float(f)) for f in expression.atoms(sp.Float) if float(2 * f) in range(-4, 5)}
    return expression.xreplace(small)
