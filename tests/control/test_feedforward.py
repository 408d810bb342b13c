"""Feed-forward of elastic gears: motions without feedback, laws against SciPy, refusals, files and the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import eomgen
from eomgen.cli.entry import main
from eomgen.control import FeedForward, feedforward
from eomgen.errors import ArrayError, InputError
from eomgen.integration import integrate
from eomgen.motion import Harmonic, PointToPoint, Spline, read_motion
from eomgen.robot.value import PRINCIPAL, Coordinate, Friction, Motor, Robot
from eomgen.scenario.load import scenario_from_toml
from tests.support.geared_arms import geared_ur5, two_link_arm
from tests.support.pendulums import MOTOR, described
from tests.support.random_motors import geared_robot

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = np.ndarray[Any, np.dtype[np.float64]]
START, GOAL = np.array([0.0, -1.2, 1.4, -0.5, 1.1, 0.2]), np.array([0.6, -0.8, 1.0, 0.1, 0.7, 0.5])
SCENARIO = 'duration = 0.4\noutput_step = 2e-3\n[motion]\ntype = "point_to_point"\nduration = 0.3\nsmooth = 4\n'


def swing(smooth: int = 4) -> PointToPoint:
    return PointToPoint(np.zeros(2), np.array([1.2, -0.8]), 1.0, smooth=smooth)


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


def damped(stiffness: float) -> Coordinate:
    return Coordinate(stiffness, 1e-3 * stiffness)


def cubic(stiffness: float) -> Coordinate:
    return Coordinate(stiffness, cubic=1e5 * stiffness)


def damped_cubic(stiffness: float) -> Coordinate:
    return Coordinate(stiffness, 1e-3 * stiffness, cubic=1e5 * stiffness)


@pytest.mark.soak
@pytest.mark.parametrize("law", [Coordinate, damped, cubic, damped_cubic])
def test_a_six_axis_arm_follows_without_feedback(law: Any) -> None:
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
    joints = [
        replace(
            joint,
            coordinates={PRINCIPAL[joint.type]: Coordinate()} if joint.type in PRINCIPAL else {},
            motor=None if joint.motor is None else with_rising_curve(joint.motor),
        )
        for joint in robot.joints
    ]
    robot = replace(robot, joints=tuple(joints), name=f"flat{seed}{kind}", springs=(), tunable=())
    size = len(eomgen.build(robot.rigid()).coordinates)
    program = PointToPoint(np.zeros(size), np.linspace(0.05, -0.04, size), 2.0, smooth=5)
    is_consistent(robot, feedforward(robot, program), 1e-9)


@pytest.mark.parametrize("cubic_part", [0.0, 4e6])
def test_a_damped_spring_winds_as_scipy_says(cubic_part: float) -> None:
    """The deflection against SciPy's integration of d e' + phi(e) = tau, of a pendulum's closed form."""
    robot = described(
        f"motor = {{ inertia = 1e-4, ratio = 50.0, stiffness = 800.0, cubic = {cubic_part}, damping = 30.0 }}"
    )
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
    end = 0.2  # a mechanism under gravity does not stay on its way for ever
    found = integrate(
        kernel, result.q[0], result.v[0], end, drive=result.drive(), method="tsit5", rtol=1e-11, atol=1e-12
    )
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
    assert [(x, y) for x, y in zip(stiff.jump_times, stiff.jump_orders, strict=True)] == []


def test_prescribed_coordinates_move() -> None:
    robot = described(MOTOR, more="x = { role = 'prescribed' }")
    program, shake = PointToPoint(np.zeros(1), np.ones(1), 0.5, smooth=4), Harmonic([0.01], [3.0])
    result = feedforward(robot, program, prescribed=shake)
    np.testing.assert_allclose(result.of("joint1.x")[0], shake.series(result.t, 0)[0, :, 0])
    left = eomgen.build(robot).inverse_dynamics(result.q, result.v, result.a)
    assert np.abs(left[:, result.coordinates.index("joint1.gamma")]).max() < 1e-10
    with pytest.raises(InputError, match=r"prescribed: the motion of 'joint1\.x' is missing"):
        feedforward(robot, program)


def test_jumps_are_named() -> None:
    robot = two_link_arm()
    septic = feedforward(robot, swing(3), t=np.linspace(-0.1, 1.1, 601))
    assert list(zip(septic.jump_times.tolist(), septic.jump_orders.tolist(), strict=True)) == [(0.0, 4.0), (1.0, 4.0)]
    assert "drives jump at t = 1 s, where the motion's derivative of order 4 does" in "\n".join(septic.lines())
    with pytest.raises(InputError, match=r"motion: its jerk jumps at t = 0 s, .* smooth = 4 in \[motion\]"):
        feedforward(robot, swing(2))
    damped_arm = two_link_arm(damping=(4.0, 2.0))
    assert feedforward(damped_arm, swing(2), t=np.linspace(-0.1, 1.1, 601)).jump_orders.tolist() == [3.0, 3.0]


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        (lambda: eomgen.load_robot("geared_arm"), r"joints\.elbow\.motor\.clearance: 0\.0005: within its backlash"),
        (lambda: described(MOTOR.replace("2e4", "0.0")), r"joint1\.motor\.stiffness: 0: .* is no flat output"),
        (lambda: described(MOTOR, more="x = { stiffness = 1e4 }"), r"joint1\.x: swings at .* nothing damps it"),
        (
            lambda: described(MOTOR.replace(" }", ", clearance = 1e-3 }"), more="x = { stiffness = 1e4 }"),
            r"'joint1\.motor' has a clearance",
        ),
        (
            lambda: described(MOTOR.replace(" }", ", drive = { lag = 0.01 } }"), more="x = { stiffness = 1e4 }"),
            r"nothing drives 'joint1\.x', which are no flat outputs of the drives, and no stable inversion finds them",
        ),
        (
            lambda: described(
                "motor = { inertia = 1e-4, ratio = 100, curve = [[-0.1, -1.0], [0.0, 0.0], [0.1, -1.0]] }"
            ),
            r"joint1\.motor: its spring holds no force of",
        ),
        (
            lambda: described(MOTOR.replace(" }", ", maxwell = [{ stiffness = 10.0, damping = 1.0 }] }")),
            r"joint1\.motor\.maxwell.*: its force depends on what was before",
        ),
        (
            lambda: described(
                MOTOR,
                more="gamma = { friction = { model = 'lugre', coulomb = 1.0, bristle_stiffness = 1e4,"
                " bristle_damping = 1.0 } }",
            ),
            r"laws have the states 'joint1\.gamma\.friction\.z",
        ),
        (
            lambda: described(MOTOR.replace(" }", ", drive = { lag = 0.01 } }")),
            r"laws have the states 'joint1\.motor\.drive\.force",
        ),
        (
            lambda: replace(described(MOTOR), driven=()),
            r"nothing drives 'joint1\.gamma'; allowed: robots whose 'driven'",
        ),
    ],
)
def test_what_has_no_feedforward_is_refused_by_name(robot: Any, message: str) -> None:
    made = robot()
    size = len(eomgen.build(made.rigid()).coordinates)
    with pytest.raises(InputError, match=message):
        feedforward(made, PointToPoint(np.zeros(size), np.ones(size), 1.0, smooth=4))


def test_arguments_are_refused_by_name() -> None:
    robot = described(MOTOR)
    program = PointToPoint(np.zeros(1), np.ones(1), 1.0, smooth=4)
    with pytest.raises(
        ArrayError, match=r"motion: its coordinates have shape \(2,\); allowed: \(1,\), 'joint1\.gamma'"
    ):
        feedforward(robot, swing())
    with pytest.raises(ArrayError, match=r"t: .*; allowed: two or more finite times"):
        feedforward(robot, program, t=[0.0, 0.0])
    with pytest.raises(InputError, match=r"friction_smoothing: -1; allowed: a velocity above 0"):
        feedforward(robot, program, friction_smoothing=-1)
    with pytest.raises(InputError, match=r"motion: there is none; allowed: a motion for feed-forward"):
        feedforward(robot, {"duration": 1.0})
    result = feedforward(robot, program, t=[0.0, 1.0])
    with pytest.raises(InputError, match=r"degree: 3 for 2 samples"):
        result.drive(3)
    with pytest.raises(InputError, match=r"coordinate: 'joint2' is unknown"):
        result.of("joint2")


def test_files_and_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, scenario = tmp_path / "arm.toml", tmp_path / "s.toml"
    robot.write_text(
        'name = "arm"\n[[links]]\nname = "rod"\nmass = 2.0\ncom = [0.2, 0.0, 0.0]\n'
        "inertia = { xx = 0.0, zz = 0.1, yy = 0.1 }\n"
        f'[[joints]]\nname = "joint1"\nparent = "base"\nchild = "rod"\ntype = "revolute"\n{MOTOR}\n'
    )
    scenario.write_text(SCENARIO)
    words = ["feedforward", str(robot), "--scenario", str(scenario)]
    assert main([*words, "-o", str(tmp_path / "f.csv")]) == 0
    assert "arm: feed-forward, 201 samples from 0 to 0.4 s" in capsys.readouterr().out
    assert main([*words, "-o", str(tmp_path / "f.npz")]) == 0
    capsys.readouterr()
    assert main([*words, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    result = feedforward(robot, scenario_from_toml(SCENARIO))
    again = eomgen.load_result(tmp_path / "f.npz")
    for name in ("t", "q", "v", "a", "u", "residual"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    assert plain["columns"]["joint1.motor.drive"] == result.of("joint1.motor")[3].tolist()
    motion = read_motion(tmp_path / "f.csv", result.coordinates)
    np.testing.assert_array_equal(motion.q, result.q)
    np.testing.assert_array_equal(motion.u, result.u)
    rows = result.as_rows()
    assert {x.name: x.unit for x in rows.columns}["joint1.motor.acceleration"] == "rad/s^2"
    assert eomgen.motion.feedforward(robot, scenario, t=[0.0, 0.1]).driven == ("joint1.motor",)
    assert main(["feedforward", "geared_arm", "--scenario", str(scenario)]) == 1
    assert "backlash" in capsys.readouterr().err
