"""The one place where SymPy ends: one joint's expressions and proofs as plain values.

They are the same for every robot, so ``kept`` has them and a build does without SymPy; a test derives and proves all
of it again, and compares.
"""

from __future__ import annotations

import sympy

from eomgen.errors import InternalError
from eomgen.robot.value import COORDINATES

from .facts import Facts, FrozenStep
from .lemmas import proofs, prove_coaxial, prove_second_derivative_zeros, prove_translations_orthogonal, step


def frozen_step(coordinate: str) -> FrozenStep:
    """Step of one coordinate ("x" ... "gamma") without SymPy.

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
    return FrozenStep(source.is_rotation, source.axis, tuple(rows))


def derived_facts() -> Facts:
    """Derive the facts about one joint from eq. (3), after every proof.

    Raises:
        InternalError: a proof fails.
    """
    for _ in proofs():
        pass
    steps = {name: frozen_step(name) for name in COORDINATES}
    return Facts(steps, prove_second_derivative_zeros(), prove_translations_orthogonal(), prove_coaxial())
