"""The example of a controller on a Cortex-M7: the host's numbers on an emulated one, and the figures of its page."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "examples" / "controller"
MODULES = ("build", "calls", "emulate", "image", "parts", "task")
PAGE = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
LIBM_FRAMES = 256  # bytes that sinf and cosf may need for angles of joints, and the floor below painting


@pytest.fixture(scope="module")
def example() -> ModuleType:
    """build.py, imported as when it is run: its neighbours are found, and forgotten again."""
    sys.path.insert(0, str(EXAMPLE))
    try:
        import build

        return build
    finally:
        sys.path.remove(str(EXAMPLE))
        for name in MODULES:
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def task(example: ModuleType) -> object:
    return example.simulated()


@pytest.fixture
def built(example: ModuleType, task: object, request: pytest.FixtureRequest, tmp_path: Path) -> object:
    compiler, sine = request.param
    if not example.is_here(compiler):
        pytest.skip("apt install gcc-arm-none-eabi libnewlib-arm-none-eabi; pip install eomgen[compiler]")
    return example.built(compiler, sine, task, tmp_path)


@pytest.mark.soak
def test_the_loop_is_closed(task) -> None:  # type: ignore[no-untyped-def]
    """The arm is moved, and comes to its course from beside it in spite of a model with too little damping."""
    assert np.abs(task.u).max() > 50.0
    assert np.ptp(task.q, axis=0).min() > 0.5
    assert task.error[0] > 0.019
    assert task.error[-1] < 1e-3
    assert 1e-6 < np.abs(task.u - task.exact).max() < 1e-2


BUILDS = [("zig", "own"), ("gcc", "own"), ("gcc", "library"), pytest.param(("zig", "library"), marks=pytest.mark.soak)]


@pytest.mark.soak
@pytest.mark.parametrize("built", BUILDS, indirect=True)
def test_on_a_cortex_m7(example: ModuleType, task, built) -> None:  # type: ignore[no-untyped-def]
    """The host's drives, to the bit with the generated sine; sizes, stack and instructions hang together."""
    runs = [example.RUNNERS[name](built.path) for name in example.RUNNERS if example.is_here(name)]
    if not runs:
        pytest.skip("apt install qemu-system-arm; pip install unicorn")
    for run in runs:
        assert run.drives.shape == task.u.shape
        assert np.array_equal(run.drives, task.u) if built.sine == "own" else example.deviation(run, task) < 8.0
        assert example.chain(built.frames) <= run.stack <= example.chain(built.frames) + LIBM_FRAMES
        if run.instructions:
            assert len(run.instructions) == len(task.u)
            assert 0 <= run.deepest - run.stack <= 64
            robot, law, _ = (n / len(task.u) for n in example.shares(run))
            assert 400 < robot < 1200  # 362 operations and six pairs of sine and cosine
            assert 50 < law < 300
            assert sum(example.shares(run)) == sum(run.instructions)
            if built.sine == "own":
                assert max(run.instructions) - min(run.instructions) <= 8
    counted, clocked = ([run for run in runs if seen(run)] for seen in (lambda r: r.instructions, lambda r: r.ticks))
    for exact, clock in zip(counted, clocked, strict=False):
        by_clock = clock.ticks * example.TICK / len(task.u)
        assert 1.0 < by_clock / np.mean(exact.instructions) < 1.1  # the call, and what the clock itself takes
    objects = {name: example.Image(built.path.with_name(f"{name}.o")) for name in ("puma560", "controller")}
    for image in objects.values():
        called = {symbol.name for symbol in image.symbols()}
        allowed = {"sinf", "cosf", "memcpy", "memset"} | {f"__aeabi_mem{x}" for x in ("cpy", "cpy4", "clr", "clr4")}
        allowed |= {f"__aeabi_unwind_cpp_pr{x}" for x in (0, 1)}  # of tables that are not linked
        foreign = {name for name in called if name.startswith(("__", "mem", "sin", "cos", "malloc"))} - allowed
        assert not foreign, "arithmetic in software, in double, or more of the library than is said"
        assert image.sizes().data == image.sizes().bss == 0
    check_page(example, task, built, runs)


def check_page(example: ModuleType, task, built, runs) -> None:  # type: ignore[no-untyped-def]
    """The figures of the page, where they are of this compiler and of all emulators."""
    if f"{built.compiler}: {built.version}" not in PAGE or len(runs) < len(example.RUNNERS):
        return
    head, _, *rows = [line.strip("| ").split(" | ") for line in figures().splitlines() if line.startswith("|")]
    at = head.index(f"{built.compiler}, {example.SAID[built.sine]}")
    found = example.cells(built, runs, task)
    for (name, *columns), cell in zip(rows, found, strict=True):
        then, now = (np.array([float(x) for x in text.split(" / ")]) for text in (columns[at], cell))
        assert np.allclose(then, now, rtol=0.02, atol=1e-4), f"{name}: run examples/controller/build.py --write"


def figures() -> str:
    found = re.search("<!-- begin of figures -->\n(.*?)<!-- end of figures -->", PAGE, re.DOTALL)
    return found[1]


@pytest.mark.soak
def test_parts_of_a_loop_take_what_the_page_says() -> None:
    """Feed-forward without iterations takes the same number for each sample."""
    sys.path.insert(0, str(EXAMPLE))
    try:
        import parts
    finally:
        sys.path.remove(str(EXAMPLE))
    if not parts.is_here():
        pytest.skip("pip install eomgen[compiler] unicorn")
    _, _, *rows = PAGE.partition(parts.BEGIN)[2].partition(parts.END)[0].splitlines()
    assert len(rows) == len(parts.PARTS)
    for row, part in zip(rows, parts.PARTS, strict=True):
        name, then, size = row.strip("| ").split(" | ")
        counts, found = parts.counted(part)
        assert (name, int(size)) == (part, found)
        now = (min(counts), np.mean(counts), max(counts))
        assert np.allclose([float(x) for x in then.split(" / ")], now, rtol=0.02), (
            "run examples/controller/parts.py --write"
        )
        assert "feed-forward" not in part or "cubic" in part or max(counts) == min(counts)


@pytest.mark.soak
def test_sizes_are_those_of_binutils(example: ModuleType, task: object, tmp_path: Path) -> None:
    if not example.is_here("gcc"):
        pytest.skip("apt install gcc-arm-none-eabi libnewlib-arm-none-eabi")
    size = shutil.which("arm-none-eabi-size")
    assert size is not None
    made = example.built("gcc", "own", task, tmp_path)
    found = subprocess.run([size, "-A", str(made.path)], capture_output=True, text=True, check=True).stdout
    sections = {line.split()[0]: int(line.split()[1]) for line in found.splitlines() if line.startswith(".")}
    assert (made.whole.text, made.whole.bss) == (sections[".text"], sections[".bss"])
    assert sections[".stack"] == 4096
    assert sections[".states"] == 2 * task.q.nbytes  # type: ignore[attr-defined]
