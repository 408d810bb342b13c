"""A small matrix of bits: compilers, levels of optimisation and machines that are here, function by function."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from benchmarks import bits
from benchmarks.bits import Cell, compared, differences, largest, table
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.kernels.signatures import with_beside
from eomgen.codegen.package.compile import find_compiler
from eomgen.codegen.package.levels import level_flags
from eomgen.codegen.program.ir import evaluate_lanes
from eomgen.robot.model import build_model
from eomgen.runtime.levels import supported
from tests.oracles.sines import polynomials
from tests.support.every_function import (
    SPECIAL,
    EveryFunction,
    differing,
    every_function,
    said,
    states_of_all_sizes,
)
from tests.support.processors import needs_levels
from tests.support.random_robots import random_robot


@pytest.mark.soak
@pytest.mark.parametrize("case", [("one_link", "float64"), ("one_link", "float32"), ("four_bar", "float64")])
def test_all_builds_have_the_same_bits(case: tuple[str, str]) -> None:
    """But for fused products, which the comparison has to see."""
    found = {build: cell for build, _, cell in bits.rows([case], bits.builds()[0])}
    fused = {name for name in found if name.endswith("fused")}
    assert all(found[name].different for name in fused), "fused products are not seen"
    assert {name: cell.different for name, cell in found.items() if cell.different and name not in fused} == {}
    assert len(found) >= 4
    assert all(cell.functions >= 6 for cell in found.values())


@pytest.mark.soak
@pytest.mark.parametrize("language", ["c++", "c", "opencl"])
def test_text_for_accelerators(language: str, tmp_path: Path) -> None:
    assert bits.on_threads("one_link", "float64", language, tmp_path) == Cell(len(bits.ON_THREADS), {})


@pytest.mark.soak(most=12)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("seed", [700, 701, 702, 703, 704, 705])
def test_compiled_code_has_the_bits_of_its_programs(seed: int, dtype: str) -> None:
    """Every program, alone and in a batch, is that evaluated in NumPy; of infinities, NaN and denormal numbers, too."""
    model = build_model(robot := random_robot(seed, joints=(1, 3), tree=seed % 2 == 0))
    equations = derive_equations(model, with_beside((), model), dtype)
    kernel = eomgen.build(robot, kernels="all", dtype=dtype, flags=("-O1",))
    raw, library = kernel.raw, kernel.raw.libraries.library("")
    p = np.array([*model.parameters.values(), *[0.0] * len(model.turning)], dtype)
    setup = evaluate_lanes(equations.setup, {"p": p[:, np.newaxis]}, dtype, sincos=polynomials)
    h = setup.get("h", np.zeros((1, 1), dtype))[:, 0]
    assert np.array_equal(library.compute(p), h)
    compared = 0
    for name, function in raw.functions.items():
        program = equations.programs.get(name)
        if program is None or {x.op for x in program.instructions} & {"exp", "log", "atan2"}:
            continue  # of the C library
        states = [states_of_all_sizes(x, int(np.prod(raw.shapes[x])), dtype) for x in function.reads]
        given = {x: array.T for x, array in zip(function.reads, states, strict=True)}
        with np.errstate(all="ignore"):
            out = evaluate_lanes(program, {**given, "h": h}, dtype, sincos=polynomials)["out"].T
        view, size = raw.view, int(np.prod(raw.shapes[function.writes]))
        alone, rows = np.zeros((len(out), size), dtype), list[int]()
        for k, row in enumerate(alone):
            if function.code(view(h), *(view(x[k]) for x in states), view(row)) == 0:
                rows.append(k)
        chosen = [np.ascontiguousarray(array[rows]) for array in states]
        pairs = [x for array in chosen for x in (view(array), array.shape[1])]
        together = np.zeros((len(rows), size), dtype)
        assert function.batch(len(rows), view(h), *pairs, view(together)) == -1
        assert not differing(together, alone[rows]).any(), name
        ordinary = [k for k in rows if k not in SPECIAL]
        assert not differing(alone[ordinary, : out.shape[1]], out[ordinary]).any(), name
        compared += len(ordinary)
    assert compared > 50


def test_a_changed_bit_is_seen(tmp_path: Path) -> None:
    """In the function that it is of, with its size; a lost status and a sign of a zero, too."""
    program = EveryFunction(tmp_path / "a.c", b"", "float64", (("one", 2), ("other", 1), ("one", 4), ("other", 2)))
    expected = np.array([0.0, 1.0, 2.0, 0.0, 3.0, 0.0, 1.0, 2.0, 4.0, np.nan, 0.0, 5.0, 0.0])
    assert compared(program, expected.copy(), expected) == Cell(2, {})
    found = expected.copy()
    found[8] = np.nextafter(4.0, 5.0)
    assert compared(program, found, expected) == Cell(2, {"one": (found[8] - 4.0) / 4.0})
    found = expected.copy()
    found[12] = -0.0
    assert compared(program, found, expected) == Cell(2, {"other": 0.0})
    assert compared(program, expected[:5].copy(), expected) == Cell(2, {}), "without batches"
    assert largest(np.array([np.inf, 1.0]), np.array([2.0, 1.0])) == np.inf
    page = table({("gcc -O0", "a"): Cell(2, {"one": 1e-16}), ("gcc -O1", "a"): Cell(2, {})})
    assert page.splitlines()[2:] == ["| gcc -O0 | 1 of 2, others within 1e-16 |", "| gcc -O1 | 2 of 2 |"]
    assert differences({("gcc -O0", "a"): Cell(2, {"one": 1e-16})}).endswith("- gcc -O0, a: `one` 1e-16")


def test_what_is_not_here_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bits.shutil, "which", lambda name: "/usr/bin/gcc" if name == "gcc" else None)
    found, absent = bits.builds()
    assert {"clang", "64-bit ARM under qemu, zig -O2", "WebAssembly in node, zig -O2"} <= set(absent)
    assert {"gcc -O0", "gcc -O3"} <= {build.name for build in found}


ZIG = [sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-musl", "-static"]
Known = tuple[EveryFunction, NDArray[np.floating]]


def emulator(machine: str, needs_avx: bool = False) -> str:
    """Path of qemu's user mode for a machine; the test is skipped without one, or with one that knows no AVX2."""
    path = shutil.which(f"qemu-{machine}") or shutil.which(f"qemu-{machine}-static")
    if path is None:
        pytest.skip("apt install qemu-user")
    version = re.search(
        r"version (\d+)\.(\d+)", subprocess.run([path, "--version"], capture_output=True, text=True).stdout
    )
    if needs_avx and (version is None or tuple(map(int, version.groups())) < (7, 2)):
        pytest.skip("this qemu has no AVX2")
    return path


def check_same(found: NDArray[np.floating], expected: NDArray[np.floating]) -> None:
    """Numbers and signs of zeros are the same to the bit."""
    assert found.shape == expected.shape
    other = differing(found, expected)
    assert not other.any(), (np.flatnonzero(other)[:5], found[other][:5], expected[other][:5])


ROBOTS = {"one_link": lambda: eomgen.load_robot("one_link"), "random": lambda: random_robot(702, joints=(2, 3))}


@pytest.fixture(scope="module", params=["one_link", pytest.param("random", marks=pytest.mark.soak)])
def known(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Known:
    """The program, and what it writes here at the base level."""
    program = every_function(ROBOTS[request.param](), tmp_path_factory.mktemp("emulated"))
    expected = said(program, find_compiler().command, ("-O1",), ())
    assert np.isfinite(expected).mean() > 0.5
    assert np.abs(expected[np.isfinite(expected)]).max() > 0.1
    return program, expected


@needs_levels
@pytest.mark.soak
@pytest.mark.parametrize("level", ["v4", "v1", "v3"])
def test_levels_that_run_here(known: Known, level: str) -> None:
    if level not in supported():
        pytest.skip(f"this processor does not run {level}")
    program, expected = known
    check_same(
        said(program, find_compiler().command, ("-O2", *level_flags(level, find_compiler(), fused=False)), ()),
        expected,
    )


@pytest.mark.soak
@needs_levels
@pytest.mark.parametrize(("level", "processor"), [("v3", "max"), pytest.param("v1", "qemu64", marks=pytest.mark.soak)])
def test_levels_that_are_emulated(known: Known, level: str, processor: str) -> None:
    """The base on a processor without AVX, which an instruction beyond the base would stop."""
    machine = emulator("x86_64", needs_avx=level == "v3")
    program, expected = known
    flags = ("-O2", *level_flags(level, find_compiler(), fused=False))
    check_same(said(program, find_compiler().command, flags, (machine, "-cpu", processor)), expected)


@pytest.mark.soak
@needs_levels
def test_a_level_does_not_run_on_a_processor_below_it(known: Known) -> None:
    """So the emulator looks at what it is given."""
    machine = emulator("x86_64")
    program, _ = known
    with pytest.raises(AssertionError, match=r"^\(-?\d+, b'qemu: uncaught target signal 4 "):
        said(
            program,
            find_compiler().command,
            ("-O2", *level_flags("v3", find_compiler(), fused=False)),
            (machine, "-cpu", "qemu64"),
        )


@pytest.mark.soak  # zig compiles its own libraries the first time
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="pip install eomgen[compiler]")
@pytest.mark.parametrize("vector", [(), ("-DEOM_VECTOR_BYTES=32",)], ids=["neon", "wider"])
def test_another_machine(known: Known, vector: tuple[str, ...]) -> None:
    """Vectors of NEON, on a processor that has had fused multiply-adds from the first on."""
    program, expected = known
    check_same(said(program, ZIG, ("-O2", *vector), (emulator("aarch64"),)), expected)
