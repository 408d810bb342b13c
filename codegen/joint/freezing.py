"""The one place where SymPy ends: one joint's expressions and proofs as plain values.

They are the same for every robot, so they are kept in ``kept`` and a build does without SymPy.  ``make tables`` writes
that module; a test derives and proves all of it again, and compares.
"""

from __future__ import annotations

from itertools import groupby

import sympy

from eomgen.errors import InternalError
from eomgen.robot.value import COORDINATES

from .facts import LEMMA_7, SHARPER, Facts, FrozenStep
from .lemmas import proofs, prove_coaxial, prove_second_derivative_zeros, prove_translations_orthogonal, step

_HEAD = '''"""What one joint is, as plain values.

Written by ``make tables`` from what ``lemmas`` derives and proves; do not edit.  A test derives all of it again.
"""

from __future__ import annotations

from types import MappingProxyType

from .facts import LEMMA_7, SHARPER, Facts, FrozenStep, ZeroPair

ZERO, ONE, SINE, MINUS, COSINE = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)


def _pairs(first: str, others: str, same_joint: bool, reason: str) -> tuple[ZeroPair, ...]:
    return tuple(ZeroPair(first, second, same_joint, reason) for second in others.split())


KEPT = Facts('''
_ENTRIES = {
    (0.0, 0.0, 0.0): "ZERO",
    (1.0, 0.0, 0.0): "ONE",
    (0.0, 1.0, 0.0): "SINE",
    (0.0, -1.0, 0.0): "MINUS",
    (0.0, 0.0, 1.0): "COSINE",
}
_REASONS = {LEMMA_7: "LEMMA_7", SHARPER: "SHARPER"}


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
    """Facts about one joint, derived from eq. (3), after every proof.

    Raises:
        InternalError: a proof fails.
    """
    for _ in proofs():
        pass
    steps = {name: frozen_step(name) for name in COORDINATES}
    return Facts(steps, prove_second_derivative_zeros(), prove_translations_orthogonal(), prove_coaxial())


def text_of(facts: Facts) -> str:
    """Facts as the text of the module ``kept``."""
    lines = [_HEAD, "    steps=MappingProxyType(", "        {"]
    for name, found in facts.steps.items():
        rows = ", ".join(f"({', '.join(_ENTRIES[entry] for entry in row)})" for row in found.rotation)
        lines.append(f'            "{name}": FrozenStep({found.is_rotation}, {found.axis}, ({rows})),')
    lines += ["        }", "    ),", "    zero_pairs=("]
    for (first, same, reason), group in groupby(facts.zero_pairs, lambda x: (x.first, x.same_joint, x.reason)):
        others = " ".join(pair.second for pair in group)
        lines.append(f'        *_pairs("{first}", "{others}", {same}, {_REASONS[reason]}),')
    for key, pairs in (("orthogonal", facts.orthogonal), ("coaxial", facts.coaxial)):
        lines += ["    ),", f"    {key}=(", *(f'        ("{first}", "{second}"),' for first, second in pairs)]
    return "\n".join([*lines, "    ),", ")", ""])
