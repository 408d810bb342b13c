"""Programs in two halves: what each depends on, and that both together are the whole."""

from __future__ import annotations

import numpy as np
import pytest

from eomgen.codegen.program.cutting import cut
from eomgen.codegen.program.ir import Graph, evaluate, finish


@pytest.mark.parametrize("seed", range(8))
def test_both_halves_are_the_whole(seed: int) -> None:
    """Of random programs, with outputs that are early, late, numbers, and inputs as they are."""
    rng, graph = np.random.default_rng(seed), Graph()
    arrays = {"p": rng.uniform(0.5, 2.0, 2), "q": rng.uniform(0.5, 2.0, 3), "late": rng.uniform(0.5, 2.0, 3)}
    nodes = [graph.input(name, i) for name, values in arrays.items() for i in range(len(values))]
    for _ in range(60):
        one, other = (nodes[i] for i in rng.integers(len(nodes), size=2))
        found = [graph.add, graph.sub, graph.mul, graph.div][rng.integers(4)](one, other)
        if not isinstance(found, float):
            nodes.append(found)
    chosen = [nodes[i] for i in rng.integers(len(nodes), size=6)]
    outputs = {("out", i): node for i, node in enumerate([*chosen, nodes[0], nodes[2], nodes[-1]])}
    whole = finish(graph, "whole", outputs)
    first, second = cut(whole, ("late",), ("p",), "kept")
    assert first.inputs() <= {"p", "q"}
    assert second.inputs() <= {"p", "late", "kept"}
    early = evaluate(first, arrays)
    kept = [early["out", i] for i in range(len(early))]
    together = evaluate(second, {"p": arrays["p"], "late": arrays["late"], "kept": kept})
    assert together == evaluate(whole, arrays)  # the same operations, and so the same bits
    operations = [sum(program.count().values()) for program in (first, second, whole)]
    assert max(operations[:2]) <= operations[2] <= sum(operations[:2])


def test_what_the_first_half_writes_may_not_wait() -> None:
    graph = Graph()
    late = graph.input("late", 0)
    program = finish(graph, "whole", {("out", 0): late, ("pivot", 0): late * 2.0})
    with pytest.raises(AssertionError):
        cut(program, ("late",), (), "kept")
