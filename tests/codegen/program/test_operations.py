"""The table of operations: what is on one row agrees, and C has each of its functions."""

from __future__ import annotations

import math
import re

import pytest
import sympy as sp

from eomgen.codegen.c.library import library_files
from eomgen.codegen.closed_form.trace import SYMBOLS
from eomgen.codegen.program.ir import Graph, finish
from eomgen.codegen.program.operations import CALLS, OPERATIONS

COSTS = {"add", "mul", "div", "sincos"}


def test_every_operation_costs_something_but_leaves() -> None:
    """Sine and cosine are counted by their angle."""
    free = {name for name, operation in OPERATIONS.items() if not operation.cost}
    assert free == {"const", "input", "sin", "cos"}
    assert {operation.cost for operation in OPERATIONS.values()} - {""} <= COSTS


@pytest.mark.parametrize("name", CALLS)
def test_functions_are_in_c_and_in_sympy(name: str) -> None:
    operation = CALLS[name]
    text = library_files()["clib/operations.h"]
    assert re.search(rf"^EOM_INLINE EOM_SCALAR {operation.function}\(", text, re.M)
    assert re.findall(rf"^EOM_INLINE lanes {operation.function}_lanes\(", text, re.M), "of vectors"
    x = sp.symbols("x y z", real=True)[: operation.arity]
    expression = getattr(SYMBOLS, name)(*x)
    for numbers in ((0.7, 0.2, 0.4), (0.2, 0.7, 0.4), (1.5, 1.5, 0.4)):
        at = dict(zip(x, numbers, strict=False))
        assert float(expression.subs(at)) == pytest.approx(operation.compute(*numbers[: operation.arity]), rel=1e-15)


@pytest.mark.parametrize("name", CALLS)
def test_functions_of_numbers_are_numbers(name: str) -> None:
    graph = Graph()
    x = (0.5, 2.0, 3.0)[: CALLS[name].arity]
    found = graph.call(name, *x)
    assert found == CALLS[name].compute(*x)
    assert graph.call(name, *(graph.constant(number) for number in x)) == found


def test_what_is_not_defined_is_left_to_c() -> None:
    graph = Graph()
    made = finish(
        graph, "root", {("out", 0): graph.call("sqrt", -1.0), ("out", 1): graph.div(1.0, graph.constant(0.0))}
    )
    assert [instruction.op for instruction in made.instructions if instruction.args] == ["sqrt", "div"]
    assert OPERATIONS["sqrt"].compute(-1.0) is None
    assert OPERATIONS["div"].compute(1.0, 0.0) is None
    assert OPERATIONS["max"].compute(math.inf, 0.0) == math.inf
    assert OPERATIONS["exp"].compute(1000.0) is None


def test_an_unknown_function_is_refused() -> None:
    known = "abs, max, step, choose, sqrt, atan2, exp, log"
    with pytest.raises(AttributeError, match=f"'cbrt' is no operation; known: {known}"):
        SYMBOLS.cbrt(1.0)
