"""Facts about one joint as plain values, so that builds do without SymPy: what ``lemmas`` derives and proves.

A test derives and proves all of it again, and compares.
"""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement, product
from types import MappingProxyType

from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR

from .facts import Facts, FrozenStep, ZeroPair, lemma_of

ZERO, ONE, SINE, MINUS, COSINE = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)
_STILL = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))

KEPT = Facts(
    steps=MappingProxyType(
        {
            "x": FrozenStep(False, 0, _STILL),
            "y": FrozenStep(False, 1, _STILL),
            "z": FrozenStep(False, 2, _STILL),
            "alpha": FrozenStep(True, 0, ((ONE, ZERO, ZERO), (ZERO, COSINE, MINUS), (ZERO, SINE, COSINE))),
            "beta": FrozenStep(True, 1, ((COSINE, ZERO, SINE), (ZERO, ONE, ZERO), (MINUS, ZERO, COSINE))),
            "gamma": FrozenStep(True, 2, ((COSINE, MINUS, ZERO), (SINE, COSINE, ZERO), (ZERO, ZERO, ONE))),
        }
    ),
    zero_pairs=tuple(
        ZeroPair(first, second, same, lemma_of(first, second))
        for same, pairs in (
            (True, combinations_with_replacement(COORDINATES, 2)),
            (False, product(COORDINATES, repeat=2)),
        )
        for first, second in pairs
        if first in LINEAR
    ),
    orthogonal=tuple(combinations(LINEAR, 2)),
    coaxial=tuple(zip(LINEAR, ANGULAR, strict=True)),
)
