"""Functions of a fresh binary are compared with their programs before it enters the cache; wrong ones are refused."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cffi
import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.expected import (
    COPIES,
    FRAMED,
    SAFETY,
    STATES,
    _tolerances,
    pack_expected,
    read_expected,
)
from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels import equations as deriving
from eomgen.codegen.kernels.derivatives.whole import is_joined
from eomgen.codegen.kernels.signatures import BATCHES, KERNELS, SINGLES
from eomgen.codegen.package.compile import FLAGS, fuses
from eomgen.codegen.program.ir import Graph, evaluate_lanes, finish
from eomgen.codegen.program.operations import OPERATIONS
from eomgen.description.load import robot_from_toml
from eomgen.errors import BuildError
from eomgen.pipeline.cache import clear
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.pipeline.self_test import first_difference
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Coordinate, Robot
from tests.support.c_project import elastic_tree, write_source
from tests.support.joint_table import joint_table, link_table
from tests.support.mutant import Mutant
from tests.support.quick_builds import QUICK, Q, as_new_process, one_link, script, without_headers
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import random_robot
from tests.support.refusals import refused
from tests.support.soak import soaked

Array = np.ndarray[Any, Any]
CC = shutil.which("cc") or shutil.which("gcc") or "cc"


def nothing_cached(cache: Path) -> bool:
    return not list((cache / "packages").iterdir()) and not list(cache.glob("making-*"))


def wrapper(folder: Path, text: str) -> str:
    """A compiler that is a script: ``text`` sets the arguments or changes what is compiled."""
    return script(folder / "cc-wrapper", f'{text}\nexec {CC} "$@"')


@pytest.mark.parametrize(
    "options",
    [
        QUICK,
        pytest.param(Options(("mass_matrix",), native=True, flags=("-O0",)), marks=pytest.mark.soak),
        pytest.param(Options(("forward_dynamics_jacobian",), flags=("-O0",)), marks=pytest.mark.soak),
    ],
)
def test_a_compiler_of_another_precision_is_refused(
    options: Options, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = wrapper(tmp_path, 'set -- "$@" -fsingle-precision-constant')
    monkeypatch.setenv("CC", command)
    with pytest.raises(BuildError) as error:
        one_link(options=options)
    message = str(error.value)
    assert message.startswith("the compiled kernels of one_link compute something else than their equations: ")
    assert f"\n  {command} -O2 " in message
    assert "one_link.c\nallowed: a compiler and flags that keep IEEE arithmetic" in message
    assert nothing_cached(empty_cache)
    monkeypatch.delenv("CC")
    assert one_link(options=options).n == 2


def test_a_library_that_turns_denormal_numbers_off_is_refused(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those do that some compilers link with -ffast-math; the thread that asked for the build keeps them."""
    code = "__attribute__((constructor)) static void off(void) { _mm_setcsr(_mm_getcsr() | 0x8040); }\n"
    (tmp_path / "off.c").write_text(f"#include <xmmintrin.h>\n{code}", encoding="ascii")
    made = subprocess.run([CC, "-c", "-fPIC", "off.c", "-o", "off.o"], cwd=tmp_path, check=False)
    if made.returncode != 0:
        pytest.skip("another processor")
    text = f'case "$*" in *-shared*) set -- "$@" {tmp_path / "off.o"};; esac'
    monkeypatch.setenv("CC", wrapper(tmp_path, text))
    refused(BuildError, "loading them turns denormal numbers off", one_link)
    assert nothing_cached(empty_cache)
    assert 5e-324 * float(np.ones(1)[0]) != 0.0, "denormal numbers of this thread"


CHANGES = {
    "a constant": "s/0\\.3333333333333333\\b/0.3333333333334/",
    "a constant of vectors": "s/0\\.3333333333333333\\b/0.3333333333334/",
    "a sign": "s/out\\[1\\] = -0\\.5\\*/out[1] = 0.5*/",
    "a parameter": "s/h\\[3\\] = p\\[3\\]/h[3] = p[2]/",
    "a polynomial": "s/2\\.75573137070/2.75673137070/",
}


@pytest.mark.parametrize("change", soaked(CHANGES, list(CHANGES)[:2]))
def test_a_compiler_that_changes_the_source_is_refused(
    change: str, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = Path(eomgen.__file__).parent / "clib"  # a copy beside the source is taken first
    files = "one_link_batch.c" if change == "a constant of vectors" else "one_link*.c clib/operations.h"
    text = f"""
for word in "$@"; do case "$word" in */one_link.c|*/one_link_batch.c)
if mkdir "${{word%/*}}/once" 2> /dev/null; then  # both files are compiled at once
cp -rL '{library}' "${{word%/*}}"
(cd "${{word%/*}}"; sed -i '{CHANGES[change]}' {files})
mkdir "${{word%/*}}/once/changed"; fi
until [ -d "${{word%/*}}/once/changed" ]; do sleep 0.01; done;; esac; done"""
    monkeypatch.setenv("CC", wrapper(tmp_path, text))
    refused(BuildError, "compute something else than their equations", one_link)
    assert nothing_cached(empty_cache)


def test_without_headers_and_with_a_source_from_the_cache(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected numbers lie beside the source, so nothing is derived again; generated packages have none of them."""
    one_link()
    as_new_process(monkeypatch)
    without_headers(monkeypatch)
    steps: list[str] = []
    assert one_link(steps).n == 2
    assert [step.split()[0] for step in steps] == ["compiling"]
    monkeypatch.setenv("CC", wrapper(tmp_path, 'set -- "$@" -fsingle-precision-constant'))
    refused(BuildError, "compute something else", one_link, steps)
    monkeypatch.delenv("CC")
    package = generate("one_link", tmp_path / "out", QUICK)
    assert not [path for path in package.rglob("*") if "expected" in path.name]


def test_a_binary_that_does_not_load_is_refused(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = 'while [ "$1" != -o ]; do shift; done; echo broken > "$2"; exit 0'
    monkeypatch.setenv("CC", wrapper(tmp_path, f'case "$*" in *-shared*) {broken};; esac'))
    refused(BuildError, "does not load", one_link)
    assert nothing_cached(empty_cache)


def test_a_binary_is_examined_though_one_of_its_key_is_loaded(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kernel that is loaded says nothing of what the same command compiles the next time."""
    switch = tmp_path / "bad"
    text = f'[ -e {switch} ] && set -- "$@" -fsingle-precision-constant'
    monkeypatch.setenv("CC", wrapper(tmp_path, text))
    kernel = one_link()
    clear()
    switch.touch()
    refused(BuildError, "compute something else", one_link)
    assert nothing_cached(empty_cache)
    switch.unlink()
    assert np.array_equal(one_link().mass_matrix(Q), kernel.mass_matrix(Q))


def test_flags_that_fuse() -> None:
    assert not fuses(("-O2", "-ffp-contract=off", "-O3"))
    assert fuses(("-ffp-contract=off", "-ffp-contract=fast"))
    assert fuses(("-ffp-contract=off", "-ffp-model=precise"))
    assert fuses(("-O2",))


def stretched_bars() -> Robot:
    """Return the four-bar linkage with a pivot that shakes: where its angles are small, great forces hold it."""
    robot = eomgen.load_robot("four_bar")
    pivot = replace(robot.joints[2], coordinates={"x": Coordinate(prescribed=True), **robot.joints[2].coordinates})
    return replace(robot, joints=(*robot.joints[:2], pivot))


def slides(first: float = 1.0, second: float = 1.0, size: float = 1.0) -> Robot:
    """Return a slide on a hinged arm: masses of the two links, kg, and a length, m."""
    text = 'name = "slides"\n'
    for i, (mass, kind, axis) in enumerate(((first, "revolute", "gamma"), (second, "prismatic", "z"))):
        text += f"""
{link_table(f"link{i}", mass, (0.1 * size, 0.2 * size, 0.3 * size), (mass * size**2,) * 3)}
{joint_table(f"joint{i}", f"link{i - 1}" if i else "base", f"link{i}", kind)}
{axis} = {{ stiffness = {1.7 * mass}, damping = {0.3 * mass} }}
placement = {{ xyz = [{0.1 * size}, {0.2 * size}, {0.3 * size}], rpy = [0.3, 0.4, {0.5 + i}] }}
"""
    return robot_from_toml(text)


ROBOTS = {
    "arm": lambda: eomgen.load_robot("one_link"),
    "closed": lambda: eomgen.load_robot("four_bar"),
    "driven": lambda: mechanism(7).robot,  # with a prescribed coordinate
    "shaken": lambda: eomgen.load_robot("shaken_arm"),
    "stretched": stretched_bars,
    "tree": elastic_tree,
    "rounded": lambda: random_robot(59, joints=(2, 5), tree=True, max_coordinates=4),  # the description's turns are
    "slides": slides,
    "nanometres": lambda: slides(1e-24, 3e-24, 1e-9),
    "light": lambda: slides(1.0, 1e-15),
    "heavy": lambda: slides(1e-15, 1.0),
}
CODE, LANES = "{name}.c", "clib/lanes.h"
DERIVATIVES = "clib/acceleration_derivatives.h"
JACOBIAN, FORWARD = "forward_dynamics_jacobian", "forward_dynamics"

# Robot, kernel, file, what it has, what it has instead.
MUTANTS = [
    ("tree", JACOBIAN, DERIVATIVES, "M[n * i + j] -= factor", "M[n * i + j] += factor"),
    ("tree", JACOBIAN, DERIVATIVES, "x[columns * i + j] -=", "x[columns * i + j] +="),
    ("tree", JACOBIAN, CODE, "residual_jacobian(h, q, v, a, out)", "residual_jacobian(h, q, v, u, out)"),
    ("tree", "christoffel", CODE, "(i == k) ?", "(i == 0) ?"),
    ("rounded", "christoffel", CODE, "1ULL) != 0U", "1ULL) == 0U"),
    ("shaken", JACOBIAN, DERIVATIVES, "? -by_u[n * i + j]", "? by_u[n * i + j]"),
    ("driven", JACOBIAN, DERIVATIVES, "M[(n + 1) * i] = one;", "M[(n + 1) * i] = zero;"),
    ("closed", JACOBIAN, DERIVATIVES, "-D[at + size + i]", "D[at + size + i]"),
    ("closed", JACOBIAN, DERIVATIVES, "by_q[entry] - D[at + i]", "by_q[entry] + D[at + i]"),
    ("closed", JACOBIAN, DERIVATIVES, "x[n * j] += Y[n * r + j]", "x[n * j] -= Y[n * r + j]"),
    ("closed", FORWARD, CODE, "memcpy(out, found,", "memcpy(out, &found[1],"),
    ("closed", "constraint_forces", CODE, "memcpy(out, &found[3]", "memcpy(out, &found[2]"),
    ("closed", "inverse_dynamics", CODE, "memcpy(out, found,", "memcpy(out, &found[1],"),
    ("closed", "inverse_dynamics_under_load", CODE, "a, u, found)", "a, v, found)"),
    ("closed", "reactions", CODE, "out[i] + more[i]", "out[i] - more[i]"),
    ("closed", "loop_reactions", CODE, "loop_wrenches(h, q, v, &found[3]", "loop_wrenches(h, q, v, found"),
    ("arm", "mass_matrix", LANES, "eom_transpose_in(&x[at], step, more", "eom_transpose_in(&x[at], 0U, more"),
    ("arm", "mass_matrix", CODE, "out[3] = EOM_C0", "out[3] = 0.3333333334"),
]  # fmt: skip


@cache
def known(robot: str, kernel: str, dtype: str = "float64") -> tuple[Source, dict[str, Array]]:
    """The source of a robot's kernel, which is composed of others where it can be, and what it has to return."""
    ways = deriving._candidates

    def candidates(model: Model, name: str, *arguments: Any, **options: Any) -> Any:
        is_loop = name == kernel and (KERNELS[name].kind == "composed" or KERNELS[name].columns_of)
        return [] if is_loop else ways(model, name, *arguments, **options)

    with pytest.MonkeyPatch.context() as patch:  # so that a small robot has loops where others have long programs
        patch.setattr(deriving, "_candidates", candidates)
        patch.setattr(deriving, "STRAIGHT_COLUMNS", 0)
        equations = deriving.derive_equations(build_model(ROBOTS[robot]()), (kernel,), dtype)
    return render(equations), read_expected(pack_expected(equations))


def found_in(
    case: tuple[str, str], folder: Path, change: tuple[str, str, str] | None = None, dtype: str = "float64", *more: str
) -> str | None:
    """What is found in a binary of a kernel, one of whose files is changed."""
    source, expected = known(*case, dtype)
    codes = write_source(source, folder)
    if change is not None:
        file, old, new = change
        path = folder / file.format(name=source.name)
        text = path.read_text(encoding="ascii")
        begin = text.index(f"int {source.name}_{case[1]}(") if file == CODE else 0
        path.write_text(Mutant.replacing(file, text, old, new, begin).applied(text), encoding="ascii")
    ffi = cffi.FFI()
    ffi.cdef(source.cdef)
    library = folder / "changed.so"
    command = [CC, *FLAGS, "-O0", "-w", *more, "-shared", "-fPIC", *map(str, codes), "-o", str(library)]
    subprocess.run([*command, "-lm"], check=True)
    module = SimpleNamespace(ffi=ffi, lib=ffi.dlopen(str(library)))
    return first_difference(module, json.loads(source.meta), expected, (SINGLES, BATCHES))


SOME = {(x[1], x[2]): x for x in reversed(MUTANTS)}.values()  # one of each kernel and file


@pytest.mark.parametrize(("robot", "kernel", "file", "old", "new"), soaked(MUTANTS, SOME), ids=lambda text: None)
def test_wrong_functions_are_refused(robot: str, kernel: str, file: str, old: str, new: str, tmp_path: Path) -> None:
    difference = found_in((robot, kernel), tmp_path, (file, old, new))
    assert difference is not None
    assert difference.startswith("mass_matrix_batch" if file == LANES else kernel)


SCALES = [(robot, FORWARD) for robot in ("slides", "nanometres", "light", "heavy", "stretched")]
RIGHT = sorted({*SCALES, ("stretched", JACOBIAN), *(change[:2] for change in MUTANTS)})
FUSED = ("-O2", "-march=native", "-ffp-contract=fast")
WAYS = {"default": ("float64",), "fused": ("float64", *FUSED), "float32": ("float32",)}
QUICKLY = [(*case, "default") for case in SCALES] + [("closed", FORWARD, "fused"), ("light", FORWARD, "float32")]


@pytest.mark.parametrize(("robot", "kernel", "way"), soaked([(*case, way) for case in RIGHT for way in WAYS], QUICKLY))
def test_right_functions_are_let_through(robot: str, kernel: str, way: str, tmp_path: Path) -> None:
    """Of robots of nanometres, and with links 1e15 times heavier than others; rounded in another way, too."""
    dtype, *flags = WAYS[way]
    assert found_in((robot, kernel), tmp_path, None, dtype, *flags) is None


@pytest.mark.parametrize("laws", ["stiffness = 1e7, damping = 5e5", "friction = { coulomb = 1.0 }"])
@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.soak)])
def test_steps_with_stiff_dampers_of_light_links(laws: str, dtype: str) -> None:
    """They are so short that no damper matters, and a wrong acceleration is seen in them."""
    text = f"""
name = "light"
{link_table("a", 0.01, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))}
{joint_table("j", "base", "a", "prismatic")}
z = {{ {laws} }}
"""
    robot, names = robot_from_toml(text), ("rollout", "adaptive_rollout", "radau_rollout")
    kernel = eomgen.build(robot, kernels=names, dtype=dtype, flags=("-O0",))
    expected = read_expected(pack_expected(deriving.derive_equations(build_model(robot), names, dtype)))
    meta, module = json.loads(kernel.raw.source("json")), kernel.raw.libraries.library("rollout")
    assert first_difference(module, meta, expected) is None
    for name in names:
        wrong = {**expected, name: expected[name] * (1.0 + (1e-9 if dtype == "float64" else 1e-2))}
        assert str(first_difference(module, meta, wrong)).startswith(f"{name} by method 0")


@pytest.mark.parametrize("name", soaked(["one_link", "four_bar"], ["one_link"]))
def test_all_functions_are_compared(name: str) -> None:
    """But those of loops' dependent coordinates and of their steps, which the tests of the library have."""
    kernel = eomgen.build(name, kernels="all", flags=("-O0",))
    expected = read_expected(pack_expected(deriving.derive_equations(build_model(eomgen.load_robot(name)))))
    meta, module = json.loads(kernel.raw.source("json")), kernel.raw.libraries.library("")
    assert first_difference(module, meta, expected) is None
    functions = {**kernel.raw.functions, **kernel.raw.rollouts}
    left_out = {"following", "rollout", "adaptive_rollout"} if kernel.constraints else set()
    assert {name for name in functions if name not in expected} == left_out
    for function in [*functions.keys() - left_out, "h"]:
        numbers = expected[function]
        at = np.unravel_index(np.argmax(np.abs(numbers)), numbers.shape)
        wrong = {**expected, function: numbers.copy()}
        wrong[function][at] *= 1.001
        said = str(first_difference(module, meta, wrong))
        assert said.startswith(f"{function} " if function != "h" else "setup returns"), said
    for state in range(0 if kernel.constraints else STATES):  # in random states loops are open
        wrong = {**expected, "forward_dynamics status": np.arange(STATES) == state}
        assert str(first_difference(module, meta, wrong)).startswith("forward_dynamics returns status 0")


def test_all_composed_kernels_have_expected_numbers() -> None:
    """A kernel that is a template of its own needs a function in ``codegen/c/expected.py``."""
    composed = {
        name
        for name, x in KERNELS.items()
        if x.kind in ("composed", "rollout", "adaptive") or x.columns_of or (x.closed and x.kind != "gradient")
    }
    mechanism = build_model(eomgen.load_robot("four_bar"))
    answered = {
        name
        for name, x in KERNELS.items()
        if x.kind in ("rollout", "adaptive") or x.columns_of or x.writes == "derivatives" or is_joined(mechanism, name)
    }
    assert composed - answered == {"following"}
    assert {x.writes for signature in KERNELS.values() for x in signature.functions.values()} == set(FRAMED)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, 1.0, 1.0, 1.0 + 1e-15, 1.0], 1.1e-15),
        ([np.inf, np.inf, -np.inf, np.nan, np.inf], np.inf),
        ([0.0, 0.0, 0.0, 0.0, np.nan], np.inf),
    ],
    ids=["finite", "not finite", "not finite in a copy"],
)
def test_tolerances(values: list[float], expected: float) -> None:
    state, *copies = values
    assert len(copies) == COPIES
    lanes = np.array([[state] * STATES + copies * STATES])
    with np.errstate(invalid="ignore"):
        found = _tolerances(lanes)
    assert found == pytest.approx(np.full((STATES, 1), SAFETY * expected), rel=0.1)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_lanes_are_evaluated_as_numbers_are(dtype: str) -> None:
    """Every operation, of each state by itself."""
    names = sorted(OPERATIONS.keys() - {"sin", "cos", "const", "input"})
    graph = Graph()
    x, y, z = (graph.input("q", i) for i in range(3))
    values = [graph.insert(op, tuple(node.index for node in (x, y, z)[: OPERATIONS[op].arity])) for op in names]
    values += [*graph.sincos(y), x + 0.1]
    program = finish(graph, "every", {("out", i): value for i, value in enumerate(values)})
    q = np.array([[0.3, 2.0], [-1.0, 0.7], [4.0, 5.0]], dtype)
    with np.errstate(all="ignore"):
        out = evaluate_lanes(program, {"q": q}, dtype)["out"]
    assert out.dtype == dtype
    eps = float(np.finfo(dtype).eps)
    for lane in range(2):
        row = [float(number) for number in q[:, lane]]
        wanted = [OPERATIONS[op].value(*row[: OPERATIONS[op].arity]) for op in names]  # type: ignore[misc]
        wanted += [np.sin(row[1]), np.cos(row[1]), row[0] + 0.1]
        np.testing.assert_allclose(out[:, lane], wanted, rtol=2.0 * eps)
