"""Which cases the soak runs: of each test a few, spread over all of them, or every one."""

from __future__ import annotations

import os
from collections.abc import Container, Iterable, Sequence
from itertools import product
from typing import Any, TypeVar

import pytest

Case = TypeVar("Case")

VARIABLE = "EOMGEN_SOAK"  # "all" runs every case; see the Makefile
WHOLE = os.environ.get(VARIABLE) == "all"
MOST = 2  # cases of a test that has the marker soak, unless the marker says ``most``


def left_out(items: Sequence[pytest.Item]) -> set[pytest.Item]:
    """Return the soak's cases that a run omits: all but the first and the last of a test and others between them.

    ``pytest.mark.soak(most=30)`` allows more cases of a test.  ``EOMGEN_SOAK=all`` omits none.
    """
    cases: dict[str, list[pytest.Item]] = {}
    for item in [] if WHOLE else items:
        if item.get_closest_marker("soak"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    omitted = set[pytest.Item]()
    for test in cases.values():
        most = min(len(test), max(mark.kwargs.get("most", MOST) for mark in test[0].iter_markers("soak")))
        omitted |= {*test} - {test[i * (len(test) - 1) // max(most - 1, 1)] for i in range(most)}
    return omitted


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
