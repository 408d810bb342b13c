"""How many random cases the soak tries of a test that has many: a share, spread over all of them, or every one."""

from __future__ import annotations

import os
from collections.abc import Container, Iterable, Sequence
from itertools import product
from typing import Any, TypeVar

import pytest

Case = TypeVar("Case")

VARIABLE = "EOMGEN_SOAK"  # "all" tries every case; see the Makefile
WHOLE = os.environ.get(VARIABLE) == "all"
SHARE = 3


def share(cases: Sequence[Case], most: int = SHARE) -> list[Case]:
    """Return at most so many of the cases, the first one and others at even distances; all where the soak has time."""
    if WHOLE or len(cases) <= most:
        return list(cases)
    return [cases[i * len(cases) // most] for i in range(most)]


def soaked(cases: Iterable[Case], but: Container[Case]) -> list[Any]:
    """Return the cases of a parametrised test, of which all but those named are left to ``make soak``."""
    return [
        case if case in but else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.soak)
        for case in cases
    ]


def across(first: Iterable[Any], second: Iterable[Any]) -> list[Any]:
    """Return all pairs, of which those are quick in which every member is once, as on a diagonal."""
    one, other = list(first), list(second)
    quick = {(one[i % len(one)], other[i % len(other)]) for i in range(max(len(one), len(other)))}
    return soaked(product(one, other), quick)
