"""Feed-forward of elastic gears: motions without feedback, laws against SciPy, the same in C, refusals, the command."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import eomgen
from eomgen.control import FeedForward, feedforward, write_feedforward
from eomgen.control.feedforward_source import feedforward_files
from eomgen.control.gears import finer
from eomgen.errors import ArrayError, InputError
from eomgen.integration import integrate
from eomgen.motion import Harmonic, PointToPoint, Spline, read_motion
from eomgen.robot.value import PRINCIPAL, Coordinate, Friction, Motor, Robot
from eomgen.scenario.load import scenario_from_toml
from tests.support.commands import command, errors_of, facts
from tests.support.feedforward_code import CompiledFeedForward
from tests.support.geared_arms import geared_ur5, two_link_arm
from tests.support.pendulums import MOTOR, described, description
from tests.support.random_motors import geared_robot
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = np.ndarray[Any, np.dtype[np.float64]]
START, GOAL = np.array([0.0, -1.2, 1.4, -0.5, 1.1, 0.2]), np.array([0.6, -0.8, 1.0, 0.1, 0.7, 0.5])
SCENARIO = 'duration = 0.4\noutput_step = 2e-3\n[motion]\ntype = "point_to_point"\nduration = 0.3\nsmooth = 4\n'


def swing(smooth: int = 4) -> PointToPoint:
    return PointToPoint(np.zeros(2), np.array([1.2, -0.8]), 1.0, smooth=smooth)


def geared(gear: str, name: str = "geared") -> Robot:
    return replace(described(f"motor = {{ inertia = 1e-4, ratio = 50.0, {gear} }}"), name=name)


def links_of(result: FeedForward) -> list[int]:
    return [i for i, name in enumerate(result.coordinates) if not name.endswith(".motor")]


def off_course(robot: Robot, result: FeedForward, program: PointToPoint, method: Any) -> float:
    """The links' largest error in a simulation without feedback, rad."""
    kernel = eomgen.build(robot)
    tight: dict[str, Any] = {"method": method, "rtol": 1e-12, "atol": 1e-13, "output_step": 5e-3}
    end = float(result.t[-1])
    found = integrate(kernel, result.q[0], result.v[0], end, drive=result.drive(), **tight)
    return float(np.abs(found.q[:, links_of(result)] - program.series(found.t, 0)[0]).max())


def is_consistent(robot: Robot, result: FeedForward, bound: float) -> None:
    """Nothing but drives is left over in the whole robot's inverse dynamics, and rates are those of positions."""
    left = eomgen.build(robot).inverse_dynamics(result.q, result.v, result.a)
    driven = [name in result.driven for name in result.coordinates]
    assert np.abs(left[:, np.invert(driven)]).max(initial=0.0) < bound * np.abs(left).max()
    np.testing.assert_allclose(left[:, driven], result.u[:, driven], rtol=1e-12, atol=1e-12)
    spline = make_interp_spline(result.t, result.q, k=7)
    inner = slice(10, -10)
    for order, rates in ((1, result.v), (2, result.a)):
        size = np.abs(rates).max(axis=0)
        assert (np.abs(spline(result.t, order) - rates)[inner] <= 10.0 ** (2 * order - 9) * size + 1e-7).all()


@pytest.mark.parametrize(
    ("damping", "stiffness", "method"),
    [
        pytest.param((0.0, 0.0), (2000.0, 1000.0), "tsit5", marks=pytest.mark.soak),
        ((4.0, 2.0), (2000.0, 1000.0), "tsit5"),
        pytest.param((40.0, 20.0), (2000.0, 1000.0), "tsit5", marks=pytest.mark.soak),
        pytest.param((20.0, 10.0), (2e4, 1e4), "radau", marks=pytest.mark.soak),
        pytest.param((20.0, 0.0), (2e4, 1e4), "radau", marks=pytest.mark.soak),
    ],
)
def test_an_arm_follows_without_feedback(damping: Any, stiffness: Any, method: str) -> None:
    robot = two_link_arm(stiffness, damping)
    result = feedforward(robot, swing(), t=np.linspace(0.0, 1.0, 4001))  # what dampers begin with dies out in some ms
    assert off_course(robot, result, swing(), method) < 1e-11
    assert result.driven == ("joint1.motor", "joint2.motor")
    assert not result.residual.any()
    assert result.jump_times.size == 0


@pytest.mark.soak
@pytest.mark.parametrize(("damping", "cubic"), [(None, None), (1e-3, None), (None, 1e5), (1e-3, 1e5)])
def test_a_six_axis_arm_follows_without_feedback(damping: float | None, cubic: float | None) -> None:
    """Springs whose dampers and cubic parts are so many times their stiffness."""

    def law(stiffness: float) -> Coordinate:
        return Coordinate(stiffness, damping and damping * stiffness, cubic=cubic and cubic * stiffness)

    robot, program = geared_ur5(law), PointToPoint(START, GOAL, 0.8, smooth=4)
    result = feedforward(robot, program)
    is_consistent(robot, result, 1e-10)
    assert off_course(robot, result, program, "radau") < 1e-9
    rigid = eomgen.build(robot.rigid()).inverse_dynamics(*program.at(result.t))
    wrong = replace(result, u=result.u.copy())
    wrong.u[:, [name.endswith(".motor") for name in result.coordinates]] = rigid / 100.0
    assert off_course(robot, wrong, program, "radau") > 1e-4  # rigid inverse dynamics alone


def with_rising_curve(motor: Motor) -> Motor:
    """The motor, a curve of whose transmission rises by 20 to 60 N m/rad."""
    law = motor.transmission
    if law.curve is None:
        return motor
    x = [point[0] for point in law.curve]
    return replace(motor, transmission=replace(law, curve=tuple((s, 20.0 * s + 40.0 * max(s, 0.0)) for s in x)))


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["plain", "cubic", "curve"])
@pytest.mark.parametrize("seed", range(3102, 3108))
def test_random_arms_have_nothing_left_over(kind: str, seed: int) -> None:
    robot = geared_robot(seed, (2, 3), kinds=(kind,))
    joints = []
    for joint in robot.joints:
        own = {PRINCIPAL[joint.type]: Coordinate()} if joint.type in PRINCIPAL else {}
        motor = None if joint.motor is None else with_rising_curve(joint.motor)
        joints.append(replace(joint, coordinates=own, motor=motor))
    robot = replace(robot, joints=tuple(joints), name=f"flat{seed}{kind}", springs=(), tunable=())
    size = len(eomgen.build(robot.rigid()).coordinates)
    program = PointToPoint(np.zeros(size), np.linspace(0.05, -0.04, size), 2.0, smooth=5)
    is_consistent(robot, feedforward(robot, program), 1e-9)


@pytest.mark.parametrize("cubic_part", [0.0, 4e6])
def test_a_damped_spring_winds_as_scipy_says(cubic_part: float) -> None:
    """The deflection against SciPy's integration of d e' + phi(e) = tau, of a pendulum's closed form."""
    robot = geared(f"stiffness = 800.0, cubic = {cubic_part}, damping = 30.0")
    program = PointToPoint(np.zeros(1), np.ones(1), 0.5, smooth=3)
    result = feedforward(robot, program, t=np.linspace(0.0, 0.5, 501))

    def rate(t: float, e: Array) -> Array:
        q, _, a = (x[0] for x in program.series(t, 2))
        tau = (0.05 + 2.0 * 0.25**2) * a + 2.0 * 9.81 * 0.25 * np.cos(q)
        return np.array((tau - 800.0 * e - cubic_part * e**3) / 30.0)

    e = result.of("joint1.motor")[0] / 50.0 - result.of("joint1.gamma")[0]
    exact = solve_ivp(rate, (0.0, 0.5), e[:1], "DOP853", t_eval=result.t[::50], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(e[::50], exact.y[0], atol=1e-12)


@pytest.mark.soak
def test_loops_follow_without_feedback() -> None:
    robot = eomgen.load_robot("four_bar")
    joints = (replace(robot.joints[0], motor=Motor(1e-4, 30.0, Coordinate(400.0, 0.2))), *robot.joints[1:])
    robot = replace(robot, name="geared_bar", joints=joints)
    program = PointToPoint(np.array([1.0]), np.array([1.6]), 0.5, smooth=4)
    result = feedforward(robot, program)
    assert result.driven == ("joint1.motor",)
    kernel = eomgen.build(robot)
    tight = {
        "method": "tsit5",
        "rtol": 1e-11,
        "atol": 1e-12,
    }  # a mechanism under gravity does not stay on its way for ever
    found = integrate(kernel, result.q[0], result.v[0], 0.2, drive=result.drive(), **tight)
    crank = kernel.coordinates.index("joint1.gamma")
    assert np.abs(found.q[:, crank] - program.at(found.t)[0][:, 0]).max() < 1e-8


@pytest.mark.soak
def test_coulomb_friction_of_links_leaves_what_is_stated() -> None:
    friction = Friction(coulomb=0.5, viscous=0.2)
    robot = described(MOTOR, more="gamma = { friction = { coulomb = 0.5, viscous = 0.2 } }")
    program = Spline([0.0, 0.5, 1.0], [[0.0], [0.4], [0.0]], at_rest=True, smooth=4)
    result = feedforward(robot, program)
    v = result.of("joint1.gamma")[1]
    width = 0.02 * np.abs(feedforward(robot, program, t=np.linspace(0.0, 1.0, 1001)).of("joint1.gamma")[1]).max()
    smooth = friction.coulomb * (np.sign(v) - v / np.sqrt(v**2 + width**2))
    assert result.residual[0] == pytest.approx(np.abs(smooth).max(), rel=1e-2)
    assert any("Coulomb friction of joint1.gamma reverses over" in note for note in result.notes)
    assert feedforward(robot, program, friction_smoothing=1.0).residual[0] > result.residual[0]
    viscous = described(MOTOR, more="gamma = { friction = { coulomb = 0.0, viscous = 0.2 } }")
    assert not feedforward(viscous, program).residual.any()


@pytest.mark.soak
def test_joints_without_motors_have_their_drives() -> None:
    robot = two_link_arm()
    robot = replace(robot, name="mixed_arm", joints=(robot.joints[0], replace(robot.joints[1], motor=None)))
    result = feedforward(robot, swing())
    assert result.driven == ("joint1.motor", "joint2.gamma")
    is_consistent(robot, result, 1e-10)
    rigid = replace(robot, name="rigid_arm", joints=tuple(replace(joint, motor=None) for joint in robot.joints))
    stiff = feedforward(rigid, swing(2))
    np.testing.assert_allclose(stiff.u, eomgen.build(rigid).inverse_dynamics(*swing(2).at(stiff.t)))
    assert not stiff.jump_times.size


def test_prescribed_coordinates_move() -> None:
    robot = described(MOTOR, more="x = { role = 'prescribed' }")
    program, shake = PointToPoint(np.zeros(1), np.ones(1), 0.5, smooth=4), Harmonic([0.01], [3.0])
    result = feedforward(robot, program, prescribed=shake)
    np.testing.assert_allclose(result.of("joint1.x")[0], shake.series(result.t, 0)[0, :, 0])
    left = eomgen.build(robot).inverse_dynamics(result.q, result.v, result.a)
    assert np.abs(left[:, result.coordinates.index("joint1.gamma")]).max() < 1e-10
    refused(InputError, r"prescribed: the motion of 'joint1\.x' is missing", feedforward, robot, program)


def test_jumps_are_named() -> None:
    robot = two_link_arm()
    septic = feedforward(robot, swing(3), t=np.linspace(-0.1, 1.1, 601))
    assert list(zip(septic.jump_times.tolist(), septic.jump_orders.tolist(), strict=True)) == [(0.0, 4.0), (1.0, 4.0)]
    assert "drives jump at t = 1 s, where the motion's derivative of order 4 does" in "\n".join(septic.lines())
    refused(InputError, r"motion: its jerk jumps at t = 0 s, .* smooth = 4 in \[motion\]", feedforward, robot, swing(2))
    damped_arm = two_link_arm(damping=(4.0, 2.0))
    assert feedforward(damped_arm, swing(2), t=np.linspace(-0.1, 1.1, 601)).jump_orders.tolist() == [3.0, 3.0]


LUGRE = "model = 'lugre', coulomb = 1.0, bristle_stiffness = 1e4, bristle_damping = 1.0"
SWINGING = "x = { stiffness = 1e4 }"


def motor_with(more: str) -> str:
    return MOTOR.replace(" }", f", {more} }}")


@pytest.mark.parametrize(
    ("motor", "more", "message"),
    [
        (MOTOR.replace("2e4", "0.0"), "", r"joint1\.motor\.stiffness: 0: .* is no flat output"),
        (MOTOR, SWINGING, r"joint1\.x: swings at .* nothing damps it"),
        (motor_with("clearance = 1e-3"), SWINGING, r"'joint1\.motor' has a clearance"),
        (
            motor_with("drive = { lag = 0.01 }"),
            SWINGING,
            r"nothing drives 'joint1\.x', which are no flat outputs of the drives, and no stable inversion finds them",
        ),
        (
            "motor = { inertia = 1e-4, ratio = 100, curve = [[-0.1, -1.0], [0.0, 0.0], [0.1, -1.0]] }",
            "",
            r"joint1\.motor: its spring holds no force of",
        ),
        (
            motor_with("maxwell = [{ stiffness = 10.0, damping = 1.0 }]"),
            "",
            r"joint1\.motor\.maxwell.*: its force depends on what was before",
        ),
        (MOTOR, f"gamma = {{ friction = {{ {LUGRE} }} }}", r"laws have the states 'joint1\.gamma\.friction\.z"),
        (motor_with("drive = { lag = 0.01 }"), "", r"laws have the states 'joint1\.motor\.drive\.force"),
    ],
)
def test_what_has_no_feedforward_is_refused_by_name(motor: str, more: str, message: str) -> None:
    robot = described(motor, more=more)
    refused(InputError, message, feedforward, robot, PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth=4))


TWO_SIDES = "stiffness = 800.0, stiffness_negative = 300.0"


JUMPING = {  # laws of gears through whose corners only torques jump, and how far the axis is off at 10,000 samples, rad
    f"{TWO_SIDES}, damping = 40.0": 4e-6,
    "curve = [[-0.3, -60.0], [-0.02, -5.0], [0.0, -1.0], [0.02, 5.0], [0.3, 60.0]]": 5e-4,
}


def test_a_gear_that_passes_a_jump_of_its_slope_is_refused_or_said() -> None:
    """Without a damper the motor's velocity would have to jump; with one its torque does."""
    program = PointToPoint(np.zeros(1), np.ones(1), 0.3, smooth=4)
    message = r"joint1\.motor\.stiffness_negative: 300, .* at t = .* jump by .* rad/s; allowed .*: one stiffness"
    refused(InputError, message, feedforward, geared(TWO_SIDES), program)
    one_sided = geared(f"{TWO_SIDES}, preload = 1e3")
    assert not any("torque jumps" in note for note in feedforward(one_sided, program).notes)
    for gear in JUMPING:
        notes = feedforward(geared(gear), program, t=np.linspace(0.0, 0.3, 1001)).notes
        assert any("motor: its torque jumps, by up to" in note for note in notes)


@pytest.mark.parametrize("gear", soaked(JUMPING, [*JUMPING][:1]))
def test_a_gear_whose_torque_jumps_is_followed_by_closer_samples(gear: str) -> None:
    robot, program = geared(gear), PointToPoint(np.zeros(1), np.ones(1), 0.3, smooth=4)
    results = [feedforward(robot, program, t=np.linspace(0.0, 0.3, count)) for count in (1001, 10001)]
    off = [off_course(robot, result, program, "tsit5") for result in results]
    assert off[1] < min(JUMPING[gear], 0.5 * off[0])


def test_arguments_are_refused_by_name() -> None:
    robot, program = described(MOTOR), PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth=4)
    worn, arm = eomgen.load_robot("geared_arm"), PointToPoint(np.zeros(3), np.ones(3), 1.0, smooth=4)
    loose, result = replace(robot, driven=()), feedforward(robot, program, t=[0.0, 1.0])
    shape = r"motion: its coordinates have shape \(2,\); allowed: \(1,\), 'joint1\.gamma'"
    for call, kind, message in (
        (lambda: feedforward(worn, arm), InputError, r"joints\.elbow\.motor\.clearance: 0\.0005: within its backlash"),
        (
            lambda: feedforward(loose, program),
            InputError,
            r"nothing drives 'joint1\.gamma'; allowed: robots whose 'driven'",
        ),
        (lambda: feedforward(robot, swing()), ArrayError, shape),
        (lambda: feedforward(robot, program, t=[0.0, 0.0]), ArrayError, r"t: .*; allowed: two or more finite times"),
        (
            lambda: feedforward(robot, program, friction_smoothing=-1),
            InputError,
            r"friction_smoothing: -1; allowed: a velocity above 0",
        ),
        (
            lambda: feedforward(robot, {"duration": 1.0}),
            InputError,
            r"motion: there is none; allowed: a motion for feed-forward",
        ),
        (lambda: result.drive(3), InputError, r"degree: 3 for 2 samples"),
        (lambda: result.of("joint2"), InputError, r"coordinate: 'joint2' is unknown"),
    ):
        refused(kind, message, call)


def test_files_and_the_command(tmp_path: Path) -> None:
    robot, scenario = tmp_path / "arm.toml", tmp_path / "s.toml"
    robot.write_text(description(MOTOR))
    scenario.write_text(SCENARIO)
    words = ("feedforward", robot, "--scenario", scenario)
    assert "pendulum: feed-forward, 201 samples from 0 to 0.4 s" in command(*words, "-o", tmp_path / "f.csv")
    command(*words, "-o", tmp_path / "f.npz")
    result = feedforward(robot, scenario_from_toml(SCENARIO))
    again = eomgen.load_result(tmp_path / "f.npz")
    for name in ("t", "q", "v", "a", "u", "residual"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    assert facts(*words)["columns"]["joint1.motor.drive"] == result.of("joint1.motor")[3].tolist()
    motion = read_motion(tmp_path / "f.csv", result.coordinates)
    np.testing.assert_array_equal(motion.q, result.q)
    np.testing.assert_array_equal(motion.u, result.u)
    rows = result.as_rows()
    assert {x.name: x.unit for x in rows.columns}["joint1.motor.acceleration"] == "rad/s^2"
    assert eomgen.motion.feedforward(robot, scenario, t=[0.0, 0.1]).driven == ("joint1.motor",)
    assert "backlash" in command("feedforward", "geared_arm", "--scenario", scenario, code=1)


# In C


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
        memory = bytes(code.ffi.buffer(code.struct))
        for bad in (np.nan, np.finfo(dtype).max):
            assert code.step(np.full((code.rows, code.n), bad))[0] in (-2, 1)  # or a cubic spring has no such force
        assert bytes(code.ffi.buffer(code.struct)) == memory


@pytest.mark.soak
@pytest.mark.parametrize(
    "gear",
    [
        "stiffness = 800.0, preload = 3.0",
        "stiffness = 800.0, stiffness_negative = 300.0, cubic = 1e5, damping = 0.4",
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
    elastic, bar = geared("stiffness = 800.0"), eomgen.load_robot("four_bar")
    crank = replace(bar.joints[0], motor=elastic.joints[0].motor)
    closed = replace(bar, name="geared_bar", joints=(crank, *bar.joints[1:]))
    for robot, given, message in (
        ("one_link", {}, r"one_link: no joint has a motor behind an elastic gear; allowed: joints with one"),
        (geared("stiffness = 800.0, clearance = 1e-3"), {}, r"joints\.joint1\.motor\.clearance: 0\.001: within its"),
        (described(MOTOR, more="x = { stiffness = 1e4 }"), {}, r"nothing drives 'joint1\.x', which are no flat"),
        (described(MOTOR, more=f"gamma = {{ friction = {{ {LUGRE} }} }}"), {}, r"laws have the states"),
        (
            geared(TWO_SIDES),
            {},
            r"joints\.joint1\.motor\.stiffness_negative: 300: where the force of its gear reverses",
        ),
        (rough, {}, r"friction_smoothing: None, and Coulomb friction of 'joint1\.gamma' makes motors jump"),
        (rough, {"friction_smoothing": 0.0}, r"friction_smoothing: 0\.0; allowed: a velocity above 0"),
        (closed, {}, r"geared_bar: its loops and couplings have no feed-forward in C; allowed: trees"),
        (elastic, {"dt": 0.0}, r"dt: 0\.0; allowed: a time above 0"),
        (elastic, {"dtype": "float16"}, r"dtype: 'float16' is unknown; allowed: float64, float32"),
    ):
        refused(InputError, message, feedforward_files, robot, **given)


def test_the_command_and_the_function_write_the_same(tmp_path: Path) -> None:
    file = tmp_path / "pendulum.toml"
    file.write_text(description(MOTOR), encoding="utf-8")
    said = command("feedforward", file, "--c", tmp_path / "c", "--dtype", "float32", "--step", "2e-3")
    assert f"wrote {tmp_path / 'c' / 'pendulum_feedforward.c'}" in said
    for path in write_feedforward(described(MOTOR), tmp_path / "again", dt=2e-3, dtype="float32"):
        assert path.read_bytes() == (tmp_path / "c" / path.relative_to(tmp_path / "again")).read_bytes()
    for more, message in (
        (("--c", "c", "-o", "f.csv"), "--output: given with --c, which writes no samples"),
        (("--scenario", "s.toml", "--step", "1e-3"), "--step: given with --scenario, whose samples say it"),
        (("--scenario", "s.toml", "--dtype", "float32"), "--dtype: given with --scenario"),
    ):
        assert message in errors_of("feedforward", file, *more)
