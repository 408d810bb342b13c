"""Joint -> JointFacts: SymPy's expressions and proofs as plain values, which the recursion on programs reads."""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement

import sympy

from eomgen.errors import InternalError
from eomgen.robot.geometry import Entries, JointFacts, JointStep

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
    source = step(coordinate)
    sin, cos = sympy.sin(source.symbol), sympy.cos(source.symbol)
    rows = []
    for i in range(3):
        row = []
        for j in range(3):
            entry = sympy.expand(source.rotation[i, j])
            one, by_sin, by_cos = entry.subs({sin: 0, cos: 0}), entry.coeff(sin), entry.coeff(cos)
            if sympy.expand(entry - one - by_sin * sin - by_cos * cos) != 0:
                raise InternalError(f"the rotation of {coordinate} has an entry of another form: {entry}")
            row.append((float(one), float(by_sin), float(by_cos)))
        rows.append(tuple(row))
    return JointStep(source.is_rotation, source.axis, tuple(rows))


def _entries(matrix: Matrix) -> Entries:
    return tuple(tuple(map(str, row)) for row in matrix.tolist())
