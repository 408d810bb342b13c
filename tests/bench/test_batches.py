"""Batches beside single calls: tables, values alive, and the C that calls kernels one by one."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from benchmarks import batches
from benchmarks.batches import Measurement, Rows, alive
from eomgen.bench.clock import Stopwatch
from eomgen.codegen.program.ir import Graph, finish
from tests.support.soak import soaked

pytestmark = pytest.mark.quick


def test_a_table() -> None:
    rows = Rows(("SSE2", "AVX2"), (("tiny", "mass_matrix", (1.234, None)),))
    assert rows.lines() == [
        "| robot | kernel | SSE2 | AVX2 |",
        "|---|---|---:|---:|",
        "| tiny | mass matrix | 1.23 |  |",
    ]


def test_values_alive_as_a_hand_counts_them() -> None:
    graph = Graph()
    x, y = graph.input("q", 0), graph.input("q", 1)
    first, second = x * y, x + y  # alive: the first, then both, then the third
    third = first * second
    program = finish(graph, "made_up", {("out", 0): third * x, ("out", 1): third + y})
    mean, most = alive(program)
    assert most == 2
    assert mean == (0 + 1 + 2 + 1 + 1 + 0) / 6


@pytest.mark.parametrize("kernel", soaked(("inverse_dynamics", "mass_matrix"), ("mass_matrix",)))
@pytest.mark.parametrize("cold", [False, True])
def test_one_call_is_compared_with_many(kernel: str, cold: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both are what the stopwatch gets, behind what empties caches; times are made up."""
    monkeypatch.setattr(batches, "COPIES", 1)
    seen = []

    def time(self: Stopwatch, timed, reads, arrays, rounds):  # type: ignore[no-untyped-def]
        seen.append(([x.code for x in timed], reads, len(arrays[0])))
        return np.tile([7.0, 2.0, 9.0, 6.0] if cold else [2.0, 6.0], (rounds, 1))

    monkeypatch.setattr(Stopwatch, "time", time)
    measured = Measurement(3).ratio(eomgen.load_robot("one_link"), kernel, ("-O0",), 5, cold=cold)
    assert measured == 3.0
    ((codes, reads, count),) = seen
    assert (reads, count) == (3 if kernel == "inverse_dynamics" else 1, 5)
    assert len(set(codes)) == (3 if cold else 2)
    assert not cold or codes[0] == codes[2]
