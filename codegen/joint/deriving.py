"""Joint -> JointFacts: SymPy's expressions and proofs as plain values, which the recursion on programs reads."""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement
from typing import Any

import sympy

from eomgen.errors import InternalError
from eomgen.robot.geometry import Entries, JointFacts, JointStep, Term

from .lemmas import (
    Matrix,
    joint_derivatives,
    joint_transform,
    prove_antisymmetry,
    prove_coaxial,
    prove_coaxial_swap,
    prove_second_derivative_zeros,
    prove_translation_columns,
    prove_translations_orthogonal,
    step,
)


@cache
def derive_joint(active: tuple[str, ...]) -> JointFacts:
    """Derive the transform of a joint by eq. (3) and its derivatives, and prove which terms of M and C vanish.

    Args:
        active: the joint's active coordinates, in canonical order.

    Raises:
        InternalError: a proof fails.
    """
    derivatives = joint_derivatives(active)
    prove_antisymmetry(active)
    coaxial = prove_coaxial(active)
    if coaxial:
        prove_coaxial_swap()
    return JointFacts(
        active,
        sympy.__version__,
        tuple(map(joint_step, active)),
        _entries(joint_transform(active)),
        tuple(_entries(derivatives.first[name]) for name in active),
        tuple(_entries(derivatives.second[pair]) for pair in combinations_with_replacement(active, 2)),
        prove_second_derivative_zeros(active),
        prove_translation_columns(active),
        prove_translations_orthogonal(active),
        coaxial,
    )


def joint_step(coordinate: str) -> JointStep:
    """Return the elementary transform of one coordinate ("x" ... "gamma") as numbers.

    Raises:
        InternalError: its rotation is more than a sum of numbers, sines and cosines.
    """
    source, kinds = step(coordinate), ((), (("sin", coordinate),), (("cos", coordinate),))
    rows = []
    for row in _entries(source.rotation):
        terms = [{factors: coefficient for coefficient, factors in entry} for entry in row]
        if any(found.keys() - {*kinds} for found in terms):
            raise InternalError(f"the rotation of {coordinate} has an entry of another form: {source.rotation}")
        one, by_sin, by_cos = kinds
        rows.append(tuple((float(x.get(one, 0)), float(x.get(by_sin, 0)), float(x.get(by_cos, 0))) for x in terms))
    return JointStep(source.is_rotation, source.axis, tuple(rows))


def _entries(matrix: Matrix) -> Entries:
    def sum_of_terms(entry: Any) -> tuple[Term, ...]:
        return tuple(map(_term, sympy.Add.make_args(entry))) if entry != 0 else ()

    return tuple(tuple(map(sum_of_terms, row)) for row in matrix.tolist())


def _term(product: Any) -> Term:
    """Return the coefficient and the factors of a product of numbers, coordinates, sines and cosines.

    Raises:
        InternalError: a factor is something else.
    """
    coefficient, factors = product.as_coeff_mul()
    named = [("", x.name) if x.is_Symbol else (x.func.__name__, str(x.args[0])) for x in factors]
    if not coefficient.is_Integer or any(function not in ("", "sin", "cos") for function, _ in named):
        raise InternalError(f"a joint's transform has an entry of another form: {product}")
    return int(coefficient), tuple(named)
