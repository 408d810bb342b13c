"""Feed-forward of elastic gears in C beside that in Python: springs, dampers, rotors, refusals and the command."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.control import FeedForward, feedforward, write_feedforward
from eomgen.control.feedforward_source import feedforward_files
from eomgen.control.gears import finer
from eomgen.errors import InputError
from eomgen.motion import PointToPoint
from eomgen.robot.value import Coordinate, Friction, Robot
from tests.support.feedforward_code import CompiledFeedForward
from tests.support.geared_arms import geared_ur5, two_link_arm
from tests.support.pendulums import MOTOR, described, description

pytestmark = pytest.mark.usefixtures("unoptimised")

LUGRE = "model = 'lugre', coulomb = 1.0, bristle_stiffness = 1e4, bristle_damping = 1.0"


def geared(gear: str, name: str = "geared") -> Robot:
    return replace(described(f"motor = {{ inertia = 1e-4, ratio = 50.0, {gear} }}"), name=name)


def drives_of(result: FeedForward) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Positions, velocities and forces of drives, (3, T, m)."""
    place = [result.coordinates.index(name) for name in result.driven]
    return np.stack([result.q, result.v, result.u])[..., place]


def off_python(
    robot: Robot, code: CompiledFeedForward, program: Any, t: Any, is_filter: bool = False, **given: Any
) -> Any:
    """What C is off, by each drive's largest number, (3, m); filters take steps between samples."""
    exact = drives_of(feedforward(robot, program, t=t, **given))
    found = code.run(program.series(finer(t) if is_filter else t, 4))[:, :: 2 if is_filter else 1]
    return np.abs(found - exact).max(axis=1) / np.abs(exact).max(axis=1)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_cubic_spring_is_inverted(compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    robot, program = geared("stiffness = 800.0, cubic = 4e6"), PointToPoint(np.zeros(1), np.ones(1), 0.5, smooth=4)
    for dtype, bound in (("float64", 1e-13), ("float32", 1e-6)):
        code = CompiledFeedForward(robot, tmp_path / dtype, (compiler,), dtype=dtype)
        assert off_python(robot, code, program, np.linspace(0.0, 0.5, 101)).max() < bound


@pytest.mark.parametrize(
    "gear",
    [
        "stiffness = 800.0, damping = 30.0",
        pytest.param("stiffness = 800.0, damping = 30.0, cubic = 4e6", marks=pytest.mark.soak),
    ],
)
def test_a_damper_makes_a_filter(gear: str, tmp_path: Path) -> None:
    """Behind the motion's end its jerk jumps: Python takes cubic polynomials, too."""
    robot, program = geared(gear, "damped"), PointToPoint(np.zeros(1), np.ones(1), 0.3, smooth=3)
    t = np.linspace(0.0, 0.4, 101)
    for dtype, bound in (("float64", 1e-13), ("float32", 1e-6)):
        code = CompiledFeedForward(robot, tmp_path / dtype, dt=float(t[1] / 2), dtype=dtype)
        assert code.rows == 4
        assert off_python(robot, code, program, t, is_filter=True).max() < bound


@pytest.mark.soak
@pytest.mark.parametrize(
    "gear",
    [
        "stiffness = 800.0, preload = 3.0",
        "stiffness = 800.0, stiffness_negative = 300.0, cubic = 1e5",
        "exponential = { force = 2.0, scale = 1e-3 }, stiffness = 50.0",
        "curve = [[-0.2, -40.0], [-0.01, -6.0], [0.0, -1.0], [0.02, 5.0], [0.3, 60.0]]",
        "curve = [[-0.2, -40.0], [-0.01, -6.0], [0.0, -1.0], [0.02, 5.0], [0.3, 60.0]], damping = 0.4",
        "stiffness = 800.0, friction = { coulomb = 0.02, viscous = 0.01, smoothing = 0.5 }",
        "stiffness = 800.0, stops = { stiffness = 0.4, lower = 2.0, upper = 40.0 }",
    ],
)
def test_laws_of_gears_and_rotors(gear: str, tmp_path: Path) -> None:
    robot, program = geared(gear, "lawful"), PointToPoint(np.zeros(1), -np.ones(1), 0.3, smooth=3)
    is_filter, t = "damping" in gear, np.linspace(0.0, 0.4, 201)
    code = CompiledFeedForward(robot, tmp_path, dt=float(t[1] / 2))
    assert off_python(robot, code, program, t, is_filter).max() < (1e-10 if "curve" in gear else 1e-12)


def mixed_arm() -> Robot:
    """Gears with and without dampers, cubic and linear, friction of links and of a rotor, and a direct drive."""
    robot = geared_ur5()
    joints = []
    for i, joint in enumerate(robot.joints):
        motor, stiffness = joint.motor, 5e3
        assert motor is not None
        law = Coordinate(stiffness, damping=6.0 if i % 2 else None, cubic=1e8 if i > 2 else None)
        friction = Friction(coulomb=0.02, viscous=1e-3, smoothing=0.3) if i == 1 else None
        motor = None if i == 5 else replace(motor, transmission=law, friction=friction)
        own = {"gamma": Coordinate(friction=Friction(coulomb=2.0, viscous=0.3))} if i in (0, 5) else joint.coordinates
        joints.append(replace(joint, motor=motor, coordinates=own))
    return replace(robot, name="mixed_ur5", joints=tuple(joints))


@pytest.mark.soak
@pytest.mark.parametrize("law", [Coordinate, lambda k: Coordinate(k, cubic=1e5 * k)])
def test_six_elastic_gears_are_followed(law: Any, tmp_path: Path) -> None:
    robot, program = geared_ur5(law), PointToPoint(np.zeros(6), np.linspace(0.8, -0.4, 6), 0.8, smooth=4)
    code = CompiledFeedForward(robot, tmp_path)
    assert off_python(robot, code, program, np.linspace(0.0, 0.8, 201)).max() < 1e-13


@pytest.mark.soak
@pytest.mark.parametrize(("dtype", "bound"), [("float64", 1e-12), ("float32", 1e-4)])
def test_all_kinds_of_gears_in_one_arm(dtype: str, bound: float, tmp_path: Path) -> None:
    """Filters take differences of forces between samples, in which single precision has some digits fewer."""
    robot, program = mixed_arm(), PointToPoint(np.zeros(6), np.linspace(0.8, -0.4, 6), 0.8, smooth=4)
    t = np.linspace(0.0, 0.8, 401)
    code = CompiledFeedForward(robot, tmp_path, dt=float(t[1] / 2), dtype=dtype, friction_smoothing=0.1)
    assert (code.rows, code.drives) == (5, 6)
    assert off_python(robot, code, program, t, is_filter=True, friction_smoothing=0.1).max() < bound


@pytest.mark.soak
def test_a_force_that_a_spring_does_not_have_is_told(tmp_path: Path) -> None:
    """An exponential spring pulls with less than its force at negative deflections, a curve falls."""
    for i, gear in enumerate(
        ("exponential = { force = 2.0, scale = 1e-3 }", "curve = [[-0.1, -1.0], [0.0, 0.0], [0.1, -1.0]]")
    ):
        code = CompiledFeedForward(geared(gear, f"slack{i}"), tmp_path / str(i))
        weight = 2.0 * 9.81 * 0.25
        holds, _ = code.step([[0.0], [0.0], [-(weight - 1e-3) / 0.175], [0.0], [0.0]])
        fails, _ = code.step([[0.0], [0.0], [-(weight + 3.0) / 0.175], [0.0], [0.0]])
        assert (holds, fails) == (0 if i == 0 else 1, 1)
        assert code.step(np.full((5, 1), np.nan))[0] == 1


@pytest.mark.soak
def test_whatever_came_setup_begins_anew(tmp_path: Path) -> None:
    """Steps end for all numbers, and say 0 or the gear; ordinary numbers have ordinary answers behind setup."""
    code = CompiledFeedForward(geared("stiffness = 800.0, damping = 3.0, cubic = 4e6", "anything"), tmp_path)
    ordinary, rng = np.array([[0.3], [0.1], [2.0], [-4.0]]), np.random.default_rng(8)
    first = code.step(ordinary)[1]
    strange = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324, -0.0, 1e9])
    for _ in range(300):
        status, _ = code.step(np.where(rng.random((4, 1)) < 0.5, rng.choice(strange, (4, 1)), rng.normal(size=(4, 1))))
        assert status in (0, 1)
    assert code.step(np.full((4, 1), np.nan))[0] == 1
    code.setup()
    status, again = code.step(ordinary)
    assert status == 0
    np.testing.assert_array_equal(again, first)


@pytest.mark.soak
def test_parameters_of_links_are_the_callers(tmp_path: Path) -> None:
    code = CompiledFeedForward(two_link_arm(), tmp_path)
    _, before = code.step(np.zeros((5, 2)))
    assert code.struct.parameters[1] == -9.81
    code.struct.parameters[1] = 0.0
    code.ffi.cdef("void two_link_arm_links_setup(const double *p, double *h);")
    code._library.two_link_arm_links_setup(code.struct.parameters, code.struct.hoisted)
    _, after = code.step(np.zeros((5, 2)))
    assert before[2].all()
    assert not after[2].any()


def test_what_has_no_feedforward_in_c_is_refused_by_name() -> None:
    rough = described(MOTOR, more="gamma = { friction = { coulomb = 1.0 } }")
    elastic = geared("stiffness = 800.0")
    for robot, given, message in (
        ("one_link", {}, r"one_link: no joint has a motor behind an elastic gear; allowed: joints with one"),
        (geared("stiffness = 800.0, clearance = 1e-3"), {}, r"joints\.joint1\.motor\.clearance: 0\.001: within its"),
        (described(MOTOR, more="x = { stiffness = 1e4 }"), {}, r"nothing drives 'joint1\.x', which are no flat"),
        (described(MOTOR, more=f"gamma = {{ friction = {{ {LUGRE} }} }}"), {}, r"laws have the states"),
        (rough, {}, r"friction_smoothing: None, and Coulomb friction of 'joint1\.gamma' makes motors jump"),
        (rough, {"friction_smoothing": 0.0}, r"friction_smoothing: 0\.0; allowed: a velocity above 0"),
        (elastic, {"dt": 0.0}, r"dt: 0\.0; allowed: a time above 0"),
        (elastic, {"dtype": "float16"}, r"dtype: 'float16' is unknown; allowed: float64, float32"),
    ):
        with pytest.raises(InputError, match=message):
            feedforward_files(robot, **given)  # type: ignore[arg-type]


@pytest.mark.soak
def test_loops_are_refused() -> None:
    robot = eomgen.load_robot("four_bar")
    motor = geared("stiffness = 800.0").joints[0].motor
    robot = replace(robot, name="geared_bar", joints=(replace(robot.joints[0], motor=motor), *robot.joints[1:]))
    with pytest.raises(
        InputError, match=r"geared_bar: its loops and couplings have no feed-forward in C; allowed: trees"
    ):
        feedforward_files(robot)


def test_the_command_and_the_function_write_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "pendulum.toml"
    file.write_text(description(MOTOR), encoding="utf-8")
    words = ["feedforward", str(file), "--c", str(tmp_path / "c"), "--dtype", "float32", "--step", "2e-3"]
    assert main(words) == 0
    assert f"wrote {tmp_path / 'c' / 'pendulum_feedforward.c'}" in capsys.readouterr().out
    for path in write_feedforward(described(MOTOR), tmp_path / "again", dt=2e-3, dtype="float32"):
        assert path.read_bytes() == (tmp_path / "c" / path.relative_to(tmp_path / "again")).read_bytes()
    for more, message in (
        (("--c", "c", "-o", "f.csv"), "--output: given with --c, which writes no samples"),
        (("--scenario", "s.toml", "--step", "1e-3"), "--step: given with --scenario, whose samples say it"),
        (("--scenario", "s.toml", "--dtype", "float32"), "--dtype: given with --scenario"),
    ):
        assert main(["feedforward", str(file), *more]) == 1
        assert message in capsys.readouterr().err
