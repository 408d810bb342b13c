"""Constraints of closed loops in the C library: a crank and slider whose kinematics is known."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from .test_library import HERE, LIBRARY, WARNINGS

R, L = 0.3, 0.7  # m
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def crank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("crank") / "crank"
    command = ["gcc", *WARNINGS, "-O0", "-fsanitize=address,undefined", f"-I{LIBRARY}", str(HERE / "crank.c"), "-lm"]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


def said(program: Path, *words: object) -> str:
    return subprocess.run([str(program), *map(str, words)], capture_output=True, text=True, check=True).stdout


def expected(angle: float, v: float, a: float) -> Array:
    """Coordinates, velocities and accelerations of crank, rod and slider, (3, 3)."""
    rod = -np.arcsin(R * np.sin(angle) / L)
    slope = -R * np.cos(angle) / (L * np.cos(rod))
    by_angle = -R * np.sin(angle) - L * np.sin(rod) * slope
    bend = (R * np.sin(angle) + L * np.sin(rod) * slope**2) / (L * np.cos(rod))
    bend_slider = -R * np.cos(angle) - L * np.cos(rod) * slope**2 - L * np.sin(rod) * bend
    q = [angle, rod, R * np.cos(angle) + L * np.cos(rod)]
    rates = [v, slope * v, by_angle * v]
    return np.array([q, rates, [a, slope * a + bend * v**2, by_angle * a + bend_slider * v**2]])


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, -2.9])
def test_dependent_coordinates_follow(angle: float, crank: Path) -> None:
    """Rod and slider move as the crank's kinematics says, and the constraint is met."""
    wanted = expected(angle, 1.3, -0.4)
    rod, slider = wanted[0, 1] + 0.05, wanted[0, 2] - 0.04
    out = np.array(said(crank, "dependent", angle, 1.3, -0.4, rod, slider, 8).split(), dtype=np.float64)
    assert out[:9].reshape(3, 3) == pytest.approx(wanted, abs=1e-11)
    slopes = out[9:15].reshape(2, 3)
    assert slopes[:, 0] == pytest.approx(expected(angle, 1.0, 0.0)[1, 1:], abs=1e-11)
    assert not slopes[:, 1:].any()
    assert np.abs(out[15:]).max() <= 1e-11


def test_a_guess_that_is_too_far_is_left_with_its_violation(crank: Path) -> None:
    out = np.array(said(crank, "dependent", 0.7, 0.0, 0.0, 1.4, 3.0, 8).split(), dtype=np.float64)
    assert np.abs(out[15:]).max() > 1e-3


def test_no_steps_leave_the_guess(crank: Path) -> None:
    out = np.array(said(crank, "dependent", 0.7, 0.0, 0.0, -0.2, 0.9, 0).split(), dtype=np.float64)
    assert out[1:3].tolist() == [-0.2, 0.9]


@pytest.mark.parametrize(
    ("numbers", "status"),
    [
        ((0.0, 1e-10, 0.0, -1e-10, 0.0), 0),
        ((2e-9, 0.0, 0.0, 0.0, 0.0), 4),
        ((0.0, -2e-9, 0.0, 0.0, 100.0), 5),  # violations are not the smaller for speed
        ((0.0, 0.0, 2e-9, 0.0, 0.0), 6),
        ((0.0, 0.0, 2e-9, 0.0, -3.0), 0),  # rates are
        ((0.0, 0.0, 0.0, "nan", 0.0), 7),
    ],
)
def test_violations_and_their_rates(numbers: tuple[object, ...], status: int, crank: Path) -> None:
    assert int(said(crank, "constraints", *numbers)) == status


@pytest.mark.parametrize(
    ("numbers", "status"),
    [
        ((5.0, -5.0, 0.0, 0.0, 0.0, 0.0), 0),
        ((5.0, -5.0 + 1e-8, 0.0, 0.0, 0.0, 0.0), 9),
        ((5.0, -5.0 + 1e-8, 0.0, 0.0, 0.0, 20.0), 0),
        ((0.0, 0.0, 2e-9, 0.0, 0.0, 0.0), 12),
        ((0.0, 0.0, 2e-9, -3.0, 0.0, 0.0), 0),
        ((5.0, 0.0, 1.0, 0.0, 1.0, 0.0), 4),  # the violation comes first
    ],
)
def test_drives_that_do_not_make_the_motion(numbers: tuple[float, ...], status: int, crank: Path) -> None:
    assert int(said(crank, "drives", *numbers)) == status


def test_no_compiler_warns_of_single_precision(tmp_path: Path) -> None:
    """Both files compile by themselves in single precision, by both compilers."""
    files = ("precision.h", "state_one.h", "constraint_checks.h", "dependent_coordinates.h")
    text = "#include <math.h>\n" + "".join(f'#include "{name}"\n' for name in files) + "int main(void) { return 0; }\n"
    (tmp_path / "x.c").write_text(text)
    for compiler in ("gcc", "clang"):
        if shutil.which(compiler):
            command = [compiler, *WARNINGS, "-DEOM_SINGLE", f"-I{LIBRARY}", "-c", str(tmp_path / "x.c")]
            subprocess.run([*command, "-o", str(tmp_path / "x.o")], check=True)
