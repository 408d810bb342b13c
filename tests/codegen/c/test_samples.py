"""The test program that comes with a package on request: it compiles strictly, passes, and sees a wrong number."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from eomgen.errors import InputError
from eomgen.pipeline.generating import MOST_SAMPLES, generate
from eomgen.pipeline.options import Options
from tests.support.c_project import WARNINGS, need, run
from tests.support.commands import command
from tests.support.refusals import refused

SERVO = str(Path(__file__).parents[3] / "examples" / "servo_axis.toml")
FLAGS = ("-std=c99", *WARNINGS, "-O0", "-ffp-contract=off")


def program(package: Path) -> Path:
    """Compile a package's C with its test program."""
    need("gcc")
    sources = [package / f"{package.name}{ending}.c" for ending in ("", "_samples")]
    made = package / "samples"
    run("gcc", *FLAGS, *sources, "-lm", "-o", made)
    return made


@pytest.mark.quick
def test_it_passes_and_sees_a_changed_constant(tmp_path: Path) -> None:
    command("generate", "one_link", "-o", tmp_path, "--samples", 3, "--scalar", "--levels", "v1")
    package = tmp_path / "one_link"
    said = run(program(package))
    assert "3 states" in said
    assert " 0 deviations" in said
    code = package / "one_link.c"
    text = code.read_text(encoding="ascii")
    assert "0.3333333333333333" in text
    code.write_text(text.replace("0.3333333333333333", "0.3333333333333"), encoding="ascii")
    wrong = subprocess.run([program(package)], capture_output=True, text=True, check=False)
    assert wrong.returncode == 1
    assert "mass_matrix in state 0, row 1, column 1: 0.3333333333333" in wrong.stdout


@pytest.mark.quick
def test_derivatives_of_accelerations_have_tolerances_in_every_state(tmp_path: Path) -> None:
    """More states than the package's own test has: each takes a tolerance of its own."""
    options = Options(("forward_dynamics_jacobian",), scalar=True)
    said = run(program(generate("four_bar", tmp_path, options, samples=5)))
    assert "5 states" in said
    assert " 0 deviations" in said


@pytest.mark.soak(most=4)
@pytest.mark.parametrize(
    ("robot", "options"),
    [
        ("four_bar", Options(("all",))),
        (SERVO, Options(("all",), libm=True)),
        ("ur5", Options(("all",), "float32", scalar=True)),
        ("puma560_elastic", Options()),
    ],
    ids=["loops", "internal states", "float32", "large"],
)
def test_it_passes_with_all_kernels(robot: str, options: Options, tmp_path: Path) -> None:
    """Kernels of frames and of loops, tensors, rollouts, and functions that several parts compute."""
    assert " 0 deviations" in run(program(generate(robot, tmp_path, options, samples=4)))


def test_it_is_the_same_every_time(tmp_path: Path) -> None:
    options = Options(("mass_matrix", "kinematics"), levels=("v1",), flags=("-O0",))
    texts = [
        (generate("one_link", tmp_path / str(i), options, samples=2) / "one_link_samples.c").read_bytes()
        for i in range(2)
    ]
    assert texts[0] == texts[1]


@pytest.mark.parametrize("samples", [-1, True, 1.5, MOST_SAMPLES + 1])
def test_numbers_of_states_are_bounded(samples: int, tmp_path: Path) -> None:
    refused(InputError, "^samples: .*; allowed: a whole number", generate, "one_link", tmp_path, samples=samples)
