"""A small matrix of bits: compilers, levels of optimisation and machines that are here, function by function."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import bits
from benchmarks.bits import Cell, compared, differences, largest, table
from tests.support import simt
from tests.support.every_function import EveryFunction


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
@pytest.mark.parametrize("language", ["c++", "c", bits.OPENCL])
def test_text_for_accelerators(language: str, tmp_path: Path) -> None:
    if language == bits.OPENCL and not simt.opencl_platforms():
        pytest.skip("no runtime of OpenCL, or no pyopencl")
    assert bits.on_threads("one_link", "float64", language, tmp_path) == Cell(len(bits.ON_THREADS), {})


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
