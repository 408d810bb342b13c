"""An operation that only a test's table has, hypot: its record takes it through all passes, renderers and bounds."""

from __future__ import annotations

import ctypes
import math
import subprocess
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray

from eomgen.codegen.arrays.statements import write_statements
from eomgen.codegen.c.functions import operations_header
from eomgen.codegen.c.library import library_files
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.c.source import environment
from eomgen.codegen.c.statements import write_function
from eomgen.codegen.program.complex_pairs import on_pairs
from eomgen.codegen.program.forward_mode import tangent
from eomgen.codegen.program.ir import Graph, Program, evaluate, evaluate_lanes, finish
from eomgen.codegen.program.operations import CALLED, OPERATIONS, Operation, Operations
from eomgen.codegen.program.passes import hoist_parameters, run_passes
from eomgen.codegen.program.reverse_mode import adjoint, hessian
from eomgen.codegen.program.series import squared
from eomgen.codegen.program.taylor import jet
from eomgen.codegen.simt.registers import PLACES, scheduled
from eomgen.codegen.simt.sources import _context
from eomgen.codegen.simt.statements import Writer
from eomgen.precision.adjoints import bound_outputs
from eomgen.precision.values import program_intervals
from tests.support.optional import needs

pytestmark = pytest.mark.quick

Array = NDArray[Any]
Q, V, A = np.array([0.7, -1.2, 0.4]), np.array([0.3, 0.5, -0.8]), np.array([-0.2, 0.9, 0.1])
FLAGS = ("-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-shared", "-fPIC")


def interval(iv: Any, x: Any, y: Any) -> Any:
    root, (half,) = iv.square_root(iv.add(iv.square(x), iv.square(y)))
    inverse = iv.add(half, half)
    return root, (iv.mul(x, inverse), iv.mul(y, inverse))


HYPOT = Operation(
    ("x", "y"),
    "div",
    math.hypot,
    np.hypot,
    rate=lambda g, x, y, dx: (x[0] * dx[0] + x[1] * dx[1]) / y,
    taylor=lambda g, x, z, k: (squared(x[0], k) + squared(x[1], k) - squared(z, k, 1)) * (0.5 / z[0]),
    form="xp.hypot({0}, {1})",
    function="hypotenuse",
    c="EOM_MATH(hypot)(x, y)",
    sympy=lambda sympy, x, y: sympy.sqrt(x**2 + y**2),
    error=CALLED,
    interval=interval,
    barrier=(
        "hypot of {0} and {1}: at its origin",
        lambda x, y: (x[0] <= 0.0) & (x[1] >= 0.0) & (y[0] <= 0.0) & (y[1] >= 0.0),
    ),
)
TABLE: Operations = {**OPERATIONS, "hypot": HYPOT}


def program() -> Program:
    """Return two outputs of three inputs, hypot in sums, products and in itself."""
    graph = Graph(TABLE)
    x, y, z = (graph.input("q", i) for i in range(3))
    length = graph.call("hypot", x * y, z + 2.0)
    far = graph.call("hypot", length, graph.call("max", x, y) - 3.0)
    return run_passes(finish(graph, "new", {("out", 0): length * z - far, ("out", 1): far / (length + 1.0)}))


def exact(q: Sequence[float]) -> Array:
    x, y, z = q
    length = math.hypot(x * y, z + 2.0)
    far = math.hypot(length, max(x, y) - 3.0)
    return np.array([length * z - far, far / (length + 1.0)])


def values(made: Program, **inputs: Any) -> Array:
    found = evaluate(made, inputs)
    return np.array([found["out", i] for i in range(len(found))])


def slopes() -> Array:
    """Return derivatives of the outputs by the inputs, (2, 3), by central differences."""
    h = 1e-6
    return np.stack([(exact(Q + h * e) - exact(Q - h * e)) / (2.0 * h) for e in np.eye(3)], axis=1)


def test_values_counts_and_folding() -> None:
    made = program()
    assert made.operations is TABLE
    assert [x.op for x in made.instructions].count("hypot") == 2
    assert made.count() == {"mul": 2, "add": 5, "div": 3, "sincos": 0}
    assert np.array_equal(values(made, q=Q), exact(Q))
    lanes = evaluate_lanes(made, {"q": np.stack([Q, V], axis=1)}, "float64")["out"]
    np.testing.assert_allclose(lanes, np.stack([exact(Q), exact(V)], axis=1), rtol=1e-15)
    assert Graph(TABLE).call("hypot", 3.0, 4.0) == 5.0
    with pytest.raises(KeyError):
        Graph().call("hypot", 3.0, 4.0)
    symbols = sp.symbols("x y z", real=True)
    calls = {name: partial(x.sympy, sp) for name, x in TABLE.items() if x.sympy}
    expressions = evaluate(made, {"q": symbols}, calls=calls)
    at = dict(zip(symbols, Q, strict=True))
    np.testing.assert_allclose([float(expressions["out", i].subs(at)) for i in range(2)], exact(Q), rtol=1e-14)


def test_derivatives() -> None:
    made, wanted = program(), slopes()
    np.testing.assert_allclose(values(tangent(made, {"q": "v"}, "t"), q=Q, v=V), wanted @ V, rtol=1e-8)
    seed = np.array([0.6, -1.3])
    first = adjoint(made, "seed", {"q": 3}, "gradient")
    np.testing.assert_allclose(values(first, q=Q, seed=seed), seed @ wanted, rtol=1e-8)
    h, second = 1e-5, values(hessian(first, {"q": 3}, "hessian"), q=Q, seed=seed).reshape(3, 3)
    for i, e in enumerate(np.eye(3)):
        ahead, behind = (values(first, q=Q + sign * h * e, seed=seed) for sign in (1.0, -1.0))
        np.testing.assert_allclose(second[i], (ahead - behind) / (2.0 * h), rtol=1e-7, atol=1e-8)


def test_time_derivatives() -> None:
    def along(t: float) -> Array:
        return exact(Q + V * t + 0.5 * A * t**2)

    found = values(jet(program(), {"q": ("q", "v", "a")}, 2, "jet"), q=Q, v=V, a=A).reshape(3, 2)
    h = 1e-4
    np.testing.assert_allclose(found[0], exact(Q), rtol=1e-15)
    np.testing.assert_allclose(found[1], (along(h) - along(-h)) / (2.0 * h), rtol=1e-7)
    np.testing.assert_allclose(found[2], (along(h) - 2.0 * along(0.0) + along(-h)) / h**2, rtol=1e-6)


def test_what_depends_on_parameters_and_complex_numbers() -> None:
    graph = Graph(TABLE)
    p, q = graph.input("p", 0), graph.input("q", 0)
    made = finish(graph, "new", {("out", 0): graph.call("hypot", p, 2.0) * q})
    setup, (rest,) = hoist_parameters([made], 1)
    assert [x.op for x in setup.instructions].count("hypot") == 1
    h = list(evaluate(setup, {"p": [1.5]}).values())
    assert values(rest, q=[0.3], h=h)[0] == 2.5 * 0.3
    assert on_pairs(made, {"q": 1}).operations is TABLE
    with pytest.raises(AssertionError, match="hypot of a complex number is not defined"):
        on_pairs(made, {"p": 1})


def test_text_of_arrays() -> None:
    written = write_statements(program(), "out", 2)
    names = ", ".join(f"q{i}" for i in written.inputs["q"])
    text = [
        f"def f(xp, {names}):",
        *(f"    {line}" for line in written.lines),
        f"    return {', '.join(written.results)}",
    ]
    space: dict[str, Callable[..., Any]] = {}
    exec("\n".join(text), space)
    np.testing.assert_allclose(space["f"](np, *Q), exact(Q), rtol=1e-15)
    numbers = needs("jax").numpy
    np.testing.assert_allclose(space["f"](numbers, *Q), exact(Q), rtol=1e-5)


def compiled(folder: Path, text: str, compiler: Sequence[str] = ("cc", "-std=gnu99")) -> ctypes.CDLL:
    """Compile a text beside the C library with the table's functions."""
    for place, content in {**library_files(), "clib/operations.h": operations_header(TABLE)}.items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_text(content, encoding="ascii")
    source, library = folder / "new.c", folder / f"{compiler[0]}.so"
    source.write_text(text, encoding="ascii")
    subprocess.run([*compiler, *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def run(function: Any, q: Array, size: int) -> Array:
    out = np.zeros(size, q.dtype)
    function(q.ctypes.data_as(ctypes.c_void_p), out.ctypes.data_as(ctypes.c_void_p))
    return out


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("vector", [0, 16, 32])
def test_c_of_numbers_and_of_vectors(dtype: str, vector: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    scalar, made = SCALARS[dtype], program()
    single, several = (write_function(made, x).chunks[0] for x in (scalar, scalar.lanes()))
    text = f"""
#define EOM_VECTOR_BYTES {vector}
{"#define EOM_SINGLE" if dtype == "float32" else ""}
#include "clib/lanes.h"
int width(void);
int width(void) {{ return EOM_LANES; }}
void single(const {scalar.name} *q, {scalar.name} *out);
void single(const {scalar.name} *q, {scalar.name} *out)
{{
{chr(10).join(single)}
}}
void several(const {scalar.name} *given, {scalar.name} *results);
void several(const {scalar.name} *given, {scalar.name} *results)
{{
lanes q[3], out[2];
(void)memcpy(q, given, sizeof q);
{chr(10).join(several)}
(void)memcpy(results, out, sizeof out);
}}
"""
    folder = tmp_path_factory.mktemp("new")  # a path that no library had before: the loader goes by paths
    library = compiled(folder, text, ("cc", "-std=gnu99", "-Wno-psabi"))
    q = np.stack([Q + 0.1 * lane for lane in range(library.width())], axis=1).astype(dtype)
    wanted = np.stack([run(library.single, np.ascontiguousarray(row), 2) for row in q.T], axis=1)
    assert np.array_equal(run(library.several, q, 2 * library.width()).reshape(2, -1), wanted)
    np.testing.assert_allclose(wanted[:, 0], exact(Q), rtol=1e-14 if dtype == "float64" else 1e-5)


@pytest.mark.parametrize(
    "compiler", [("cc", "-std=gnu99", "-Wno-unused-function"), ("c++", "-x", "c++", "-Wno-unused-function")]
)
def test_device_source(compiler: Sequence[str], tmp_path_factory: pytest.TempPathFactory) -> None:
    made = program()
    lines = list(Writer(made, scheduled(made, PLACES["float64"]), SCALARS["float64"]).lines())
    kernel: Mapping[str, Any] = {
        "name": "device",
        "text": "Two numbers.",
        "reads": {"q": 3},
        "writes": {"out": 2},
        "n": 3,
    }
    kernel = {**kernel, "scalars": [], "method": "", "controlled": [], "lines": lines, "is_first": True}
    said = {"name": "new", "dtype": "float64", "tile": 1, "flags": {"cuda": "", "c": ""}}
    context = _context(said, [kernel], TABLE)
    library = compiled(
        tmp_path_factory.mktemp("device"), environment().get_template("simt/kernels.h.jinja").render(context), compiler
    )
    out, status = np.zeros(2), np.zeros(1, np.int32)
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (np.zeros(1), Q, out, status)]
    library.device(ctypes.c_ulonglong(1), *pointers)
    assert np.array_equal(out, exact(Q))


def test_bounds_of_rounding() -> None:
    """Errors in single precision stay within their bounds, in many states of a box; at the origin there is none."""
    made, rng = program(), np.random.default_rng(0)
    boxes = [(np.array([x - 0.1]), np.array([x + 0.1])) for x in Q]
    found = program_intervals(made, "float32", {"q": boxes}, rounded={"q": [0.0] * 3})
    bounds = bound_outputs(found, [made.outputs["out", i] for i in range(2)])
    states = rng.uniform(Q - 0.1, Q + 0.1, (1000, 3)).T.astype(np.float32)
    computed = evaluate_lanes(made, {"q": states}, "float32")["out"]
    errors = np.abs(computed - np.stack([exact(q) for q in states.T.astype(float)], axis=1)).max(axis=1)
    assert (errors > 0.01 * bounds.plain).all()
    assert (errors <= bounds.plain).all()
    around = [(np.array([-1.0]), np.array([1.0]))] * 2 + [(np.array([-3.0]), np.array([3.0]))]
    reasons = program_intervals(made, "float64", {"q": around}).reasons.values()
    assert next(iter(reasons)).startswith("hypot of [-1, 1] and [-1, 5]: at its origin")


def test_library_has_the_functions_of_the_table() -> None:
    """``make operations`` writes the file."""
    assert library_files()["clib/operations.h"] == operations_header()
