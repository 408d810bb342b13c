"""Levels and machines that are not at hand, emulated by qemu: the same bits as here, of every function.

One small program in C calls all functions of a kernel on the samples that fresh binaries answer and writes what they
say; it is compiled for each processor.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.package.compile import FLAGS, find_compiler
from eomgen.codegen.package.levels import level_flags
from eomgen.codegen.samples.answers import samples
from eomgen.codegen.samples.stored import MEASURED, STATES, read_samples
from eomgen.pipeline.stages import Options, make_source
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.levels import supported
from tests.support.c_sources import write_source
from tests.support.processors import needs_levels
from tests.support.random_robots import random_robot

ZIG = [sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-musl", "-static"]
MAIN = """
#include <stdio.h>
#include "{name}.h"
#define STATES {states}
#define TOGETHER {together}
{inputs}
static double p[{parameters}], h[{hoisted}], out[TOGETHER * {largest}];
static int take(double *x, size_t count) {{ return fread(x, sizeof *x, count, stdin) == count; }}
static void tell(long long status, size_t count)
{{
    const double said = (double)status;
    (void)fwrite(&said, sizeof said, 1, stdout);
    (void)fwrite(out, sizeof *out, count, stdout);
    for (size_t i = 0; i < count; ++i) out[i] = 0.0;
}}
int main(void)
{{
    if (!take(p, {parameters}){takes}) return 1;
    {name}_setup(p, h);
    for (int i = 0; i < STATES; ++i) {{
{single}
    }}
{batch}
    return 0;
}}
"""


def program(robot: Robot, folder: Path) -> tuple[Path, bytes]:
    """The C of a robot's kernels with a main program beside it, and what that reads."""
    source = make_source(robot, Options())
    meta = json.loads(source.meta)
    given = read_samples(samples(derive_equations(build_model(robot), ()), "float64"))
    shapes = {name: int(np.prod(shape)) for name, shape in meta["shapes"].items()}
    functions = {
        name: entry for name, entry in meta["functions"].items() if entry["kind"] not in ("rollout", "adaptive")
    }
    read = sorted({array for entry in functions.values() for array in entry["reads"]})
    single, batch = [], []
    for name, entry in functions.items():
        size = shapes[entry["writes"]]
        frame = ", 0" if entry["kind"] == "frames" else ""
        one = "".join(f", {array}[i]" for array in entry["reads"])
        many = "".join(f", {array}[0], {shapes[array]}" for array in entry["reads"])
        single.append(f"        tell({robot.name}_{name}(h{one}{frame}, out), {size});")
        batch.append(f"    tell({robot.name}_{name}_batch(TOGETHER, h{many}{frame}, out), TOGETHER * {size});")
    values = np.array([*meta["parameters"].values()])
    text = MAIN.format(
        name=robot.name,
        states=len(STATES),
        together=MEASURED,
        inputs="\n".join(f"static double {name}[STATES][{shapes[name]}];" for name in read),
        parameters=max(1, values.size),
        hoisted=max(1, meta["hoisted"]),
        largest=max(shapes.values()),
        takes="".join(f" || !take({name}[0], STATES * {shapes[name]})" for name in read),
        single="\n".join(single),
        batch="\n".join(batch),
    )
    write_source(source, folder)
    (folder / "main.c").write_text(text, encoding="ascii")
    arrays = [values if values.size else np.zeros(1), *(given[name] for name in read)]
    return folder / f"{robot.name}.c", b"".join(np.ascontiguousarray(array, np.float64).tobytes() for array in arrays)


def said(code: Path, given: bytes, compiler: Sequence[str], flags: Sequence[str], machine: Sequence[str]) -> np.ndarray:
    """Numbers that the program writes, compiled and run so."""
    out = code.with_name("program")
    files = [str(code), str(code.with_name("main.c"))]
    subprocess.run([*compiler, *FLAGS, *flags, *files, "-o", str(out), "-lm"], check=True, cwd=code.parent)
    found = subprocess.run([*machine, str(out)], input=given, capture_output=True, check=False, timeout=600)
    assert found.returncode == 0, (found.returncode, found.stderr[-1000:])
    return np.frombuffer(found.stdout)


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


def check_same(found: np.ndarray, expected: np.ndarray) -> None:
    """Numbers and signs of zeros are the same to the bit; what is no number has no sign."""
    assert found.shape == expected.shape
    same = (found == expected) & (np.signbit(found) == np.signbit(expected)) | np.isnan(found) & np.isnan(expected)
    assert same.all(), (np.flatnonzero(~same)[:5], found[~same][:5], expected[~same][:5])


ROBOTS = {"one_link": lambda: eomgen.load_robot("one_link"), "random": lambda: random_robot(702, joints=(2, 3))}


@pytest.fixture(scope="module", params=["one_link", pytest.param("random", marks=pytest.mark.soak)])
def known(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes, np.ndarray]:
    """The program, what it reads, and what it writes here at the base level."""
    robot = ROBOTS[request.param]()
    code, given = program(robot, tmp_path_factory.mktemp("emulated"))
    expected = said(code, given, find_compiler().command, ("-O1",), ())
    assert np.isfinite(expected).mean() > 0.5
    assert np.abs(expected[np.isfinite(expected)]).max() > 0.1
    return code, given, expected


@needs_levels
@pytest.mark.soak
@pytest.mark.parametrize("level", ["v4", "v1", "v3"])
def test_levels_that_run_here(known: tuple[Path, bytes, np.ndarray], level: str) -> None:
    if level not in supported():
        pytest.skip(f"this processor does not run {level}")
    code, given, expected = known
    check_same(
        said(code, given, find_compiler().command, ("-O2", *level_flags(level, find_compiler(), fused=False)), ()),
        expected,
    )


@pytest.mark.soak
@needs_levels
@pytest.mark.parametrize(("level", "processor"), [("v3", "max"), pytest.param("v1", "qemu64", marks=pytest.mark.soak)])
def test_levels_that_are_emulated(known: tuple[Path, bytes, np.ndarray], level: str, processor: str) -> None:
    """The base on a processor without AVX, which an instruction beyond the base would stop."""
    machine = emulator("x86_64", needs_avx=level == "v3")
    code, given, expected = known
    flags = ("-O2", *level_flags(level, find_compiler(), fused=False))
    check_same(said(code, given, find_compiler().command, flags, (machine, "-cpu", processor)), expected)


@needs_levels
def test_a_level_does_not_run_on_a_processor_below_it(known: tuple[Path, bytes, np.ndarray]) -> None:
    """So the emulator looks at what it is given."""
    machine = emulator("x86_64")
    code, given, _ = known
    with pytest.raises(AssertionError, match=r"^\(-?\d+, b'qemu: uncaught target signal 4 "):
        said(
            code,
            given,
            find_compiler().command,
            ("-O2", *level_flags("v3", find_compiler(), fused=False)),
            (machine, "-cpu", "qemu64"),
        )


@pytest.mark.soak  # zig compiles its own libraries the first time
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="pip install eomgen[compiler]")
@pytest.mark.parametrize("vector", [(), ("-DEOMGEN_VECTOR=32",)], ids=["neon", "wider"])
def test_another_machine(known: tuple[Path, bytes, np.ndarray], vector: tuple[str, ...]) -> None:
    """Vectors of NEON, on a processor that has had fused multiply-adds from the first on."""
    code, given, expected = known
    check_same(said(code, given, ZIG, ("-O2", *vector), (emulator("aarch64"),)), expected)
