"""What one joint is, as plain values.

Written by ``make tables`` from what ``lemmas`` derives and proves; do not edit.  A test derives all of it again.
"""

from __future__ import annotations

from types import MappingProxyType

from .facts import LEMMA_7, SHARPER, Facts, FrozenStep, ZeroPair

KEPT = Facts(
    steps=MappingProxyType(
        {
            "x": FrozenStep(
                is_rotation=False,
                axis=0,
                rotation=(
                    ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                ),
            ),
            "y": FrozenStep(
                is_rotation=False,
                axis=1,
                rotation=(
                    ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                ),
            ),
            "z": FrozenStep(
                is_rotation=False,
                axis=2,
                rotation=(
                    ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                ),
            ),
            "alpha": FrozenStep(
                is_rotation=True,
                axis=0,
                rotation=(
                    ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
                    ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
                ),
            ),
            "beta": FrozenStep(
                is_rotation=True,
                axis=1,
                rotation=(
                    ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
                    ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, -1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
                ),
            ),
            "gamma": FrozenStep(
                is_rotation=True,
                axis=2,
                rotation=(
                    ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 0.0, 0.0)),
                    ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
                    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                ),
            ),
        }
    ),
    zero_pairs=(
        ZeroPair("x", "x", True, LEMMA_7),
        ZeroPair("x", "y", True, LEMMA_7),
        ZeroPair("x", "z", True, LEMMA_7),
        ZeroPair("x", "alpha", True, SHARPER),
        ZeroPair("x", "beta", True, SHARPER),
        ZeroPair("x", "gamma", True, SHARPER),
        ZeroPair("y", "y", True, LEMMA_7),
        ZeroPair("y", "z", True, LEMMA_7),
        ZeroPair("y", "alpha", True, SHARPER),
        ZeroPair("y", "beta", True, SHARPER),
        ZeroPair("y", "gamma", True, SHARPER),
        ZeroPair("z", "z", True, LEMMA_7),
        ZeroPair("z", "alpha", True, SHARPER),
        ZeroPair("z", "beta", True, SHARPER),
        ZeroPair("z", "gamma", True, SHARPER),
        ZeroPair("x", "x", False, LEMMA_7),
        ZeroPair("x", "y", False, LEMMA_7),
        ZeroPair("x", "z", False, LEMMA_7),
        ZeroPair("x", "alpha", False, SHARPER),
        ZeroPair("x", "beta", False, SHARPER),
        ZeroPair("x", "gamma", False, SHARPER),
        ZeroPair("y", "x", False, LEMMA_7),
        ZeroPair("y", "y", False, LEMMA_7),
        ZeroPair("y", "z", False, LEMMA_7),
        ZeroPair("y", "alpha", False, SHARPER),
        ZeroPair("y", "beta", False, SHARPER),
        ZeroPair("y", "gamma", False, SHARPER),
        ZeroPair("z", "x", False, LEMMA_7),
        ZeroPair("z", "y", False, LEMMA_7),
        ZeroPair("z", "z", False, LEMMA_7),
        ZeroPair("z", "alpha", False, SHARPER),
        ZeroPair("z", "beta", False, SHARPER),
        ZeroPair("z", "gamma", False, SHARPER),
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
