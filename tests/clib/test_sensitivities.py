"""Derivatives of motions in the C library: a pendulum written by hand, against differences and each other."""

from __future__ import annotations

import shutil
import subprocess
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.codegen.c.contexts import kept_of_a_step
from eomgen.robot.model import build_model
from tests.clib.test_library import HERE, LIBRARY, WARNINGS
from tests.support.soak import soaked

SOURCE = HERE / "pendulum_derivatives.c"
SANITIZED = ("-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
PRECISIONS = {"float64": (), "float32": ("-DEOM_SINGLE",)}
WAYS = {"linked": (str(LIBRARY / "integrate.c"),), "included": ("-DINCLUDED",)}
QUICK = {("linked", "float64")}  # each way and each precision once
NEAR = {"float64": 1e-13, "float32": 1e-5}  # adjoint and tangent, beside the larger of both
METHODS = {
    "explicit_gradient": "EOM_TSIT5",
    "implicit_gradient": "EOM_IMPLICIT_EULER",
    "rosenbrock_gradient": "EOM_ROSENBROCK",
}


def said(folder: Path, source: Path, *flags: str, compiler: str = "gcc") -> str:
    """What the program of a file prints, compiled without warnings."""
    program = folder / "program"
    command = [compiler, *WARNINGS, f"-I{LIBRARY}", str(source), *flags, "-o", str(program), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout


def derivatives(text: str) -> NDArray[np.float64]:
    """Columns of the pendulum's program, (methods, without and with inputs, 5)."""
    rows = [[float(x) for x in line.split()[2:]] for line in text.splitlines()]
    return np.array(rows).reshape(4, 2, 5)


@pytest.mark.parametrize(("way", "dtype"), soaked(product(WAYS, PRECISIONS), {("included", "float32")}))
def test_a_pendulum_written_by_hand(way: str, dtype: str, tmp_path: Path) -> None:
    """Adjoint and tangent agree, differences with both; nothing outside the rooms asked for is touched."""
    found = derivatives(said(tmp_path, SOURCE, *SANITIZED, *PRECISIONS[dtype], *WAYS[way]))
    whole, along, back, slope, same = np.moveaxis(found, -1, 0)
    assert same.all()  # with what is kept of steps, and without
    assert np.abs(along - back).max() <= NEAR[dtype] * np.abs(along).max()
    if dtype == "float64":
        assert np.abs(whole - slope).max() <= 1e-8
    assert np.abs(whole - back).min() > 1.0  # what the tangent leaves out matters, and so do inputs
    assert np.abs(whole[:, 0] - whole[:, 1]).min() > 1.0


@pytest.mark.soak
@pytest.mark.parametrize("dtype", PRECISIONS)
def test_bits_are_those_of_the_library_included(dtype: str, tmp_path: Path) -> None:
    one, other = (said(tmp_path, SOURCE, "-O2", *PRECISIONS[dtype], *flags) for flags in WAYS.values())
    assert one == other


@pytest.mark.parametrize("flags", [(*x, *y) for x in PRECISIONS.values() for y in WAYS.values()])
def test_clang_warns_of_nothing(flags: tuple[str, ...], tmp_path: Path) -> None:
    if shutil.which("clang") is None:
        pytest.skip("clang is not installed")
    said(tmp_path, SOURCE, "-O0", *flags, compiler="clang")


@pytest.mark.parametrize("name", ["one_link", "four_bar"])
def test_packages_keep_as_many_numbers_as_the_library(name: str, tmp_path: Path) -> None:
    """Callers of packages allocate what is kept of steps; classical and Tsitouras' steps share their room."""
    model = build_model(eomgen.load_robot(name))
    numbers = ", ".join(f"EOM_KEPT_NUMBERS({model.size}, {len(model.constraints)}, {x})" for x in METHODS.values())
    source = tmp_path / "kept.c"
    prints = f'    printf("%d %d %d", {numbers});\n    return 0;\n'
    source.write_text(f'#include "eom.h"\n#include <stdio.h>\nint main(void)\n{{\n{prints}}}\n')
    kept = kept_of_a_step(model)
    assert [int(x) for x in said(tmp_path, source).split()] == [kept[name] for name in METHODS]
