"""All kernels of texts for accelerators, beyond those by default, as C++ and under OpenCL, to the bit."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from eomgen.codegen.kernels.signatures import OWN_KERNELS
from eomgen.codegen.simt.kernels import DEFAULT, FRAMES
from eomgen.description import as_robot, builtin_robots
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support import simt
from tests.support.bending_mixtures import PARTS, mixture
from tests.support.bristles import servo_arm
from tests.support.figures import Figures
from tests.support.random_mechanisms import mechanism
from tests.support.simt_runs import HELD, Near, Subject, chosen_kernels, refusals

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

DTYPES = ("float64", "float32")
BUILTIN = sorted(builtin_robots())
CASES = tuple(itertools.product(("one_link", "four_bar", "worn_arm", "ur5"), DTYPES))
RANDOM = 30
WITHOUT_LOOPS = tuple(part for part in PARTS if part != "loops")  # whose loops no state is known to close
TREES = tuple(part for part in WITHOUT_LOOPS if part != "followers")  # which follow modes
REASONS = {  # why a text has no kernel: words of each reason, and what has to be true of the robot
    "takes a frame's number": lambda model: True,
    "has steps and loops": lambda model: True,
    "is no straight-line program": lambda model: True,
    "is for robots with": lambda model: True,
    "of a closed mechanism checks and assembles loops": lambda model: bool(model.constraints),
    "assembles loops after every step": lambda model: bool(model.constraints),
    "switches charts of 3-DOF rotations": lambda model: bool(model.turning),
    "solves in a loop": lambda model: model.size > 8 or any(body.modes for body in model.bodies),
    "numbers of a state": lambda model: model.size > 27,
}


def robot_of(number: int) -> tuple[Robot, Near | None]:
    """Return one of thirty robots: a tree with all laws, a closed mechanism and a state, a tree whose links bend."""
    if number % 3 == 0:
        return mixture(number, TREES[: 3 + number % 6], modes=(0,)).robot, None
    if number % 3 == 1:
        closed = mechanism(number)
        return closed.robot, Near(closed.q, closed.v)
    return mixture(number, WITHOUT_LOOPS[number % 4 :: 2]).robot, None


def check(subject: Subject, figures: Figures) -> None:
    """Compare all kernels in the languages that are here; most states are well."""
    languages = ("c++", "opencl") if simt.opencl_platforms() else ("c++",)
    answers = list(subject.answers(languages))
    assert [answer for answer in answers if not answer.is_right] == []
    assert sum(answer.failed for answer in answers) < 0.2 * simt.COUNT * len(answers)
    for language in languages:
        figures.count(f"kernels as {language}", sum(answer.language == language for answer in answers))


@pytest.mark.soak
@pytest.mark.parametrize(("name", "dtype"), CASES)
def test_all_kernels_of_built_in_robots_have_the_bits_of_the_c(
    tmp_path: Path, name: str, dtype: str, figures: Figures
) -> None:
    check(Subject(as_robot(name), dtype, tmp_path), figures)


def test_internal_states_and_forces_beside_drives_are_arrays_of_their_own(tmp_path: Path, figures: Figures) -> None:
    kernels = ("forward_dynamics", "forward_dynamics_jacobian", "frame_jacobians", *HELD)
    subject = Subject(servo_arm(), "float64", tmp_path, kernels)
    about = subject.made.meta["kernels"]["rk4_rollout"]
    assert [*about["reads"]] == ["q", "v", "z", "u", "forces"]
    assert about["writes"] == {"q_out": [4], "v_out": [4], "z_out": [6]}
    check(subject, figures)


@pytest.mark.parametrize("name", BUILTIN)
def test_every_kernel_is_there_or_refused_for_a_reason(name: str) -> None:
    model = build_model(as_robot(name))
    there, refused = chosen_kernels(model), refusals(model)
    own = {name for name in there if not name.endswith(("tangent", "adjoint"))}
    assert own ^ {*refused} == {*FRAMES, *HELD, *OWN_KERNELS}
    for kernel, text in refused.items():
        known = [words for words, holds in REASONS.items() if words in text and holds(model)]
        assert len(known) == 1, f"{kernel} {text}"
    if not model.constraints and not model.turning and not any(body.modes for body in model.bodies):
        assert {*DEFAULT} - {"forward_dynamics_jacobian"} <= {*there}
