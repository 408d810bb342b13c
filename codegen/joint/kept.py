"""What one joint is, as plain values.

Written by ``make tables`` from what ``lemmas`` derives and proves; do not edit.  A test derives all of it again.
"""

from __future__ import annotations

from types import MappingProxyType

from .facts import LEMMA_7, SHARPER, Facts, FrozenStep, ZeroPair

ZERO, ONE, SINE, MINUS, COSINE = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)


def _pairs(first: str, others: str, same_joint: bool, reason: str) -> tuple[ZeroPair, ...]:
    return tuple(ZeroPair(first, second, same_joint, reason) for second in others.split())


KEPT = Facts(
    steps=MappingProxyType(
        {
            "x": FrozenStep(False, 0, ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))),
            "y": FrozenStep(False, 1, ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))),
            "z": FrozenStep(False, 2, ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))),
            "alpha": FrozenStep(True, 0, ((ONE, ZERO, ZERO), (ZERO, COSINE, MINUS), (ZERO, SINE, COSINE))),
            "beta": FrozenStep(True, 1, ((COSINE, ZERO, SINE), (ZERO, ONE, ZERO), (MINUS, ZERO, COSINE))),
            "gamma": FrozenStep(True, 2, ((COSINE, MINUS, ZERO), (SINE, COSINE, ZERO), (ZERO, ZERO, ONE))),
        }
    ),
    zero_pairs=(
        *_pairs("x", "x y z", True, LEMMA_7),
        *_pairs("x", "alpha beta gamma", True, SHARPER),
        *_pairs("y", "y z", True, LEMMA_7),
        *_pairs("y", "alpha beta gamma", True, SHARPER),
        *_pairs("z", "z", True, LEMMA_7),
        *_pairs("z", "alpha beta gamma", True, SHARPER),
        *_pairs("x", "x y z", False, LEMMA_7),
        *_pairs("x", "alpha beta gamma", False, SHARPER),
        *_pairs("y", "x y z", False, LEMMA_7),
        *_pairs("y", "alpha beta gamma", False, SHARPER),
        *_pairs("z", "x y z", False, LEMMA_7),
        *_pairs("z", "alpha beta gamma", False, SHARPER),
    ),
    orthogonal=(
        ("x", "y"),
        ("x", "z"),
        ("y", "z"),
    ),
    coaxial=(
        ("x", "alpha"),
        ("y", "beta"),
        ("z", "gamma"),
    ),
)
