"""Stable inversion: small systems in closed form, refusals, files, simulations; feed-forward of robots by it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import eomgen
from eomgen.control import FeedForward, StableInversion, feedforward, stable_inversion
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, UnknownNameError
from eomgen.integration import integrate
from eomgen.motion import PointToPoint, default_motion
from eomgen.robot.value import Robot
from eomgen.scenario.load import load_scenario
from tests.support.commands import command, facts
from tests.support.geared_arms import two_link_arm
from tests.support.joint_table import joint_table
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]

FIRST, SECOND, STIFFNESS, DAMPING = 3.0, 2.0, 800.0, 6.0  # two masses on a line, a spring and a damper between them
CARTS = """
name = "carts"
gravity = [0.0, 0.0, 0.0]
[[links]]
name = "first"
mass = 3.0
[[links]]
name = "second"
mass = 2.0
[[joints]]
name = "rail"
parent = "base"
child = "first"
type = "prismatic"
[[joints]]
name = "spring"
parent = "first"
child = "second"
type = "fixed"
z = { SPRING }
[[frames]]
name = "tip"
link = "second"
"""
LONG, SHORT, TURNING, ROTARY_DAMPING = 0.5, 0.3, 40.0, 0.2  # two rods, a spring and a damper between them
RODS = f"""
name = "rods"
gravity = [0.0, 0.0, 0.0]
[[links]]
name = "first"
mass = 2.0
com = [0.25, 0.0, 0.0]
inertia = {{ xx = 0.001, yy = 0.05, zz = 0.05 }}
[[links]]
name = "second"
mass = 1.0
com = [0.15, 0.0, 0.0]
inertia = {{ xx = 0.001, yy = 0.0075, zz = 0.0075 }}
{joint_table("hub", "base", "first", "revolute")}
{joint_table("elbow", "first", "second", "fixed")}
placement = {{ xyz = [0.5, 0.0, 0.0] }}
gamma = {{ stiffness = 40.0, damping = 0.2 }}
[[frames]]
name = "tip"
link = "second"
placement = {{ xyz = [0.3, 0.0, 0.0] }}
"""
SMALL = 1e-4  # rad, of a motion in which the rods are linear


def carts(spring: str = "stiffness = 800.0, damping = 6.0") -> Robot:
    """Return two masses, the second on a spring."""
    return robot_from_toml(CARTS.replace("SPRING", spring))


def ride(size: float = 0.2, smooth: int = 4) -> PointToPoint:
    """Return a motion of the first mass, or of the first rod."""
    return PointToPoint(np.zeros(1), np.array([size]), 0.6, smooth=smooth)


def column(result: StableInversion, name: str) -> Array:
    """Return a coordinate at all samples."""
    return result.q[:, result.coordinates.index(name)]


def test_where_the_drive_is_the_output_the_second_mass_swings_behind_it() -> None:
    """Zeros are those of m s^2 + d s + k, all stable: e follows forwards in time, and drives begin with the motion."""
    program = ride()
    result = stable_inversion(carts(), program, step=1e-3)
    assert result.outputs == result.drives == ("rail.z",)
    expected = np.roots([SECOND, DAMPING, STIFFNESS])
    assert np.allclose(np.sort_complex(result.zeros), np.sort_complex(expected), rtol=1e-9)
    assert result.rates[1] == np.inf

    def rate(t: float, x: Array) -> Array:
        return np.array([x[1], -(DAMPING * x[1] + STIFFNESS * x[0]) / SECOND - program.at(t)[2][0]])

    inside = result.t >= 0.0
    forwards = solve_ivp(rate, (0.0, result.t[-1]), (0.0, 0.0), "DOP853", result.t[inside], rtol=1e-10, atol=1e-14)
    deviation = column(result, "spring.z")
    assert np.abs(deviation[inside] - forwards.y[0]).max() < 1e-7 * np.abs(deviation).max()
    assert np.abs(deviation[~inside]).max() < 1e-7 * np.abs(deviation).max()
    assert np.abs(column(result, "rail.z") - program.at(result.t)[0][:, 0]).max() < 1e-9


def test_a_drive_behind_a_spring_finds_what_the_mass_behind_it_asks_for() -> None:
    """The far mass as output has one zero, -k/d: m y'' = -(k e + d e'), and m e'' is in the drive's force."""
    program = ride(smooth=6)
    result = stable_inversion(carts(), program, outputs=("tip.z",), step=1e-3)
    assert result.zeros.size == 1
    assert result.zeros[0] == pytest.approx(-STIFFNESS / DAMPING, rel=1e-9)

    def rate(t: float, e: Array) -> Array:
        return (-SECOND * program.at(t)[2] - STIFFNESS * e) / DAMPING

    inside = result.t >= 0.0
    e = solve_ivp(rate, (0.0, result.t[-1]), (0.0,), "DOP853", result.t[inside], rtol=1e-11, atol=1e-15).y[0]
    assert np.abs(column(result, "spring.z")[inside] - e).max() < 1e-6 * np.abs(e).max()
    assert np.abs(column(result, "rail.z")[inside] + e - program.at(result.t[inside])[0][:, 0]).max() < 1e-6 * 0.2


def test_a_spring_alone_between_drive_and_output_is_inverted_algebraically() -> None:
    """Without a damper there is no zero: e = -m y'' / k, and the force m y'' + m_1 (y'' - e'')."""
    program = ride(smooth=6)
    result = stable_inversion(carts("stiffness = 800.0"), program, outputs=("tip.z",), step=1e-3)
    assert not result.zeros.size
    y = program.series(result.t, 4)[..., 0]
    e, bent = -SECOND * y[2] / STIFFNESS, -SECOND * y[4] / STIFFNESS
    assert np.abs(column(result, "spring.z") - e).max() < 1e-6 * np.abs(e).max()
    force = (FIRST + SECOND) * y[2] - FIRST * bent
    assert np.abs(result.u[:, 0] - force).max() < 1e-3 * np.abs(force).max()


def test_the_tip_behind_a_rod_that_turns_has_an_unstable_zero_and_the_drive_begins_before_it() -> None:
    """a e'' + d e' + k e = -M_21 y'' / (l_1 + l_2) has a < 0: one part is found forwards, the other backwards."""
    length, M_21, M_22 = LONG + SHORT, SHORT * (LONG / 2.0 + SHORT / 3.0), SHORT**2 / 3.0
    a = M_22 - M_21 * SHORT / length
    assert a < 0.0
    stable, unstable = sorted(np.roots([a, ROTARY_DAMPING, TURNING]).real)
    program = ride(SMALL)
    result = stable_inversion(robot_from_toml(RODS), program, outputs=("tip.y",), step=1e-3)
    assert np.allclose(np.sort(result.zeros.real), [stable, unstable], rtol=1e-7)
    assert np.abs(result.zeros.imag).max() == 0.0
    assert result.rates == pytest.approx((stable, unstable), rel=1e-7)

    def pushed(t: float) -> float:
        return float(-M_21 * program.at(t)[2][0] / a)

    ends = (result.t[0] - 0.2, result.t[-1] + 0.2)

    def part(rate: float, ends: tuple[float, float], times: Array) -> Array:
        tight = {"rtol": 1e-10, "atol": 1e-16, "max_step": 0.01}
        found = solve_ivp(lambda t, z: rate * z + pushed(t), ends, (0.0,), "DOP853", times, **tight)
        return np.asarray(found.y[0])

    forwards, backwards = part(stable, ends, result.t), part(unstable, ends[::-1], result.t[::-1])[::-1]
    e = (backwards - forwards) / (unstable - stable)
    found = column(result, "elbow.gamma")
    assert np.abs(found - e).max() < 1e-3 * np.abs(e).max()
    inside = (result.t > 0.0) & (result.t < 0.6)
    assert np.abs(found - e)[inside].max() < 2e-5 * np.abs(e).max()
    assert np.abs(e[result.t < 0.0]).max() > 1e-3 * np.abs(e).max()  # it bends before the tip moves


def test_steps_are_halved_until_coordinates_change_by_less_than_the_tolerance() -> None:
    """What is left against a fine solution is less than the tolerance, and so is the change that is said."""
    robot, program = robot_from_toml(RODS), ride(1.2)
    fine = stable_inversion(robot, program, outputs=("tip.y",), step=6e-4)
    assert fine.change == 0.0
    sizes = []
    for tolerance in (1e-8, 2e-9, 2e-10):
        result = stable_inversion(robot, program, outputs=("tip.y",), tolerance=tolerance, before=0.3, after=0.3)
        exact = make_interp_spline(fine.t, fine.q, k=5)
        inside = (result.t > -0.1) & (result.t < 0.7)
        assert np.abs(result.q - exact(result.t))[inside].max() < tolerance
        assert 0.0 < result.change < tolerance
        assert f"changed coordinates by {result.change:.2g} m or rad" in str(result)
        sizes.append(result.t.size)
    assert sizes[0] < sizes[1] < sizes[2]
    jumping = stable_inversion(robot, ride(1.2, 2), outputs=("tip.y",), tolerance=1e-12)
    assert any("still changed coordinates by more than 1e-12 m or rad" in note for note in jumping.notes)


HERTZ = np.sqrt(STIFFNESS / SECOND) / (2.0 * np.pi)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"robot": "stiffness = 800.0"}, InputError, rf"spring\.z: swings at {HERTZ:.4g} Hz .* nothing damps it"),
        (
            {"robot": RODS, "outputs": ("tip.x",)},
            InputError,
            r"outputs: drives of rods do not move 'tip.x' independently at 0 s",
        ),
        ({"outputs": ("tip.z", "rail.z")}, InputError, "outputs: 2 for 1 drives of carts; allowed: as many as drives"),
        ({"outputs": ("tip.w",)}, UnknownNameError, r"outputs: 'tip.w' is unknown"),
        ({"frame": "tip"}, InputError, "frame: carts has 1 drives"),
        ({"step": 1e-3, "tolerance": 1e-6}, InputError, "tolerance: given together with step"),
        ({"tolerance": 0.0}, InputError, "tolerance: 0.0 m or rad; allowed: a number above 0"),
        ({"step": 0.0}, InputError, "step: 0.0 s; allowed: a time above 0"),
        ({"step": 0.1}, InputError, "step: 0.1 s makes .* steps; allowed: 24 to 20000"),
        ({"before": -1.0}, InputError, r"before: -1.0 s; allowed: a time from 0"),
        ({"duration": float("nan")}, InputError, "duration: nan s"),
        (
            {"motion": SimpleNamespace(at=ride().at)},
            InputError,
            "duration: SimpleNamespace does not say when it ends",
        ),
        ({"motion": PointToPoint(np.zeros(2), np.ones(2), 1.0)}, InputError, "motion: moves 2 coordinates"),
        ({"robot": "four_bar"}, InputError, "four_bar: has loops or couplings"),
    ],
)
def test_what_is_refused(given: dict[str, Any], error: type[Exception], message: str) -> None:
    options = {"robot": "stiffness = 800.0, damping = 6.0", "motion": ride(), **given}
    text = options.pop("robot")
    robot = text if text == "four_bar" else robot_from_toml(text) if text == RODS else carts(text)
    refused(error, message, stable_inversion, robot, options.pop("motion"), **options)


def test_results_come_back_from_files(tmp_path: Path) -> None:
    result = stable_inversion(carts(), ride(), step=5e-3)
    loaded = eomgen.load_result(result.save(tmp_path / "inverse.npz"))
    assert isinstance(loaded, StableInversion)
    assert loaded.lines() == result.lines()
    plain = json.loads(json.dumps(result.as_dict()))
    assert loaded.as_dict() == plain
    assert (plain["robot"], plain["outputs"], plain["drives"]) == (result.robot, ["rail.z"], ["rail.z"])
    assert (plain["samples"], plain["first"], plain["last"]) == (result.t.size, result.t[0], result.t[-1])
    assert plain["largest_force"] == {"rail.z": np.abs(result.u).max()}
    assert [complex(*z) for z in plain["zeros"]] == result.zeros.tolist()
    q, v, t = result.q[3], result.v[3], float(result.t[3] - result.t[0])
    assert np.allclose(result.drive(20.0)(t, q, v)[0], result.u[3, 0], rtol=1e-9)
    refused(InputError, r"bandwidth: -1\.0 rad/s", result.drive, -1.0)


def driven(kernel: eomgen.Kernel, result: StableInversion, bandwidth: float) -> Any:
    """The motion from rest by the drives of an inversion, at its samples."""
    times = result.t - result.t[0]
    options = {"drive": result.drive(bandwidth), "times": times, "method": "radau", "rtol": 1e-8}
    return integrate(kernel, result.q[0], np.zeros(kernel.n), float(times[-1]), **options)


ELASTIC = ("tcp.x", "tcp.y", "tcp.z", "joint4.gamma", "joint5.gamma", "joint6.gamma")  # its wrist begins singular


@pytest.mark.soak
@pytest.mark.parametrize("smooth", [2, 4])
def test_the_tool_of_the_elastic_puma_stays_within_a_micrometre(smooth: int) -> None:
    """Its demo's path in the simulation of all 36 coordinates, from rest, with feedback of its drives and without."""
    kernel = eomgen.build("puma560_elastic")
    usual = default_motion(eomgen.load_robot("puma560_elastic"), 1.6, [f"joint{i}.gamma" for i in range(1, 7)])
    program = PointToPoint(usual.start, usual.goal, usual.duration, smooth=smooth)
    result = stable_inversion("puma560_elastic", program, outputs=ELASTIC)
    rigid = np.zeros((result.t.size, kernel.n))
    rigid[:, [kernel.coordinates.index(name) for name in result.drives]] = program.at(result.t)[0]
    wanted = kernel.frame_pose(rigid, "tcp")[:, :3, 3]

    def off(bandwidth: float) -> float:
        motion = driven(kernel, result, bandwidth)
        tool = kernel.frame_pose(motion.q, "tcp")[:, :3, 3]
        return float(np.linalg.norm(tool - wanted, axis=1).max())

    followed, alone = off(30.0), off(0.0)
    assert followed < 1e-7
    assert alone < (1e-6 if smooth == 4 else 1e-4)  # what jumps is between the samples, and nothing holds the arm
    bent = kernel.frame_pose(result.q, "tcp")[:, :3, 3]
    assert np.abs(bent - wanted).max() < 1e-7
    assert np.abs(result.q - rigid).max() > 1e-5  # what the drives make up for


@pytest.mark.soak
def test_the_pose_of_a_tool_behind_deviations_has_unstable_zeros_and_stays_within_a_micrometre() -> None:
    """All six components along a circle: the torques reach the tool through springs alone."""
    kernel = eomgen.build("puma560_elastic")
    scenario = replace(load_scenario("puma560_circle"), wrenches=(), payloads=())
    result = stable_inversion("puma560_elastic", scenario, duration=1.2)
    assert result.outputs == ("tcp.x", "tcp.y", "tcp.z", "tcp.rx", "tcp.ry", "tcp.rz")
    motion = driven(kernel, result, 30.0)
    found, wanted = (kernel.frame_pose(q, "tcp") for q in (motion.q, result.q))
    assert np.abs(found - wanted).max() < 1e-6
    assert np.abs(found[:, 0, 3] - 0.4).max() < 1e-6  # the circle's plane
    assert np.linalg.norm(found[:, 1:3, 3] - [0.15, 0.4], axis=1) == pytest.approx(0.1, abs=1e-6)


# Feed-forward


MOTOR = 'name = "hub"\nmotor = { inertia = 1e-4, ratio = 50.0, stiffness = 900.0, damping = 1.0 }'
GEARED = RODS.replace('name = "hub"', MOTOR).replace('"rods"', '"geared_rods"')
SCENARIO = """
duration = 0.8
output_step = 2e-3
[motion]
type = "point_to_point"
start = { hub = 0.0 }
goal = { hub = 1.2 }
begin = 0.15
duration = 0.5
smooth = 4
"""


def off(robot: Robot, result: FeedForward, kp: float = 0.0, kd: float = 0.0) -> float:
    """The greatest error of the tip's height in a simulation from rest, m."""
    kernel = eomgen.build(robot)
    span = float(result.t[-1] - result.t[0])
    motion = integrate(kernel, result.q[0], 0.0 * result.q[0], span, drive=result.drive(5, kp, kd), rtol=1e-9)
    rigid = np.zeros_like(motion.q)
    rigid[:, kernel.coordinates.index("hub.gamma")] = ride(1.2).at(motion.t + result.t[0])[0][:, 0]
    poses: NDArray[np.float64] = kernel.frame_pose(motion.q, "tip") - kernel.frame_pose(rigid, "tip")
    return float(np.abs(poses[:, 1, 3]).max())


@pytest.mark.parametrize("text", [RODS, pytest.param(GEARED, marks=pytest.mark.soak)])
def test_the_tip_follows_without_feedback_and_drives_begin_before_it(text: str) -> None:
    robot = robot_from_toml(text)
    result = feedforward(robot, ride(1.2), outputs=["tip.y"])
    assert result.outputs == ("tip.y",)
    assert result.t[0] < 0.0 < 0.6 < result.t[-1]
    assert off(robot, result) < 2e-6
    assert off(robot, result, 1e-3, 1e-4) < 2e-6
    said = "\n".join(result.lines())
    assert "by stable inversion: all coordinates; no drive have" in said
    assert "what follows the motion: tip.y" in said
    driven = result.coordinates.index(result.driven[0])
    assert not np.delete(result.u, driven, axis=1).any()
    left = eomgen.build(robot).inverse_dynamics(result.q, result.v, result.a)
    np.testing.assert_allclose(left[:, driven], result.u[:, driven], rtol=1e-12, atol=1e-12)
    undriven = [i for i, name in enumerate(result.coordinates) if name in result.inverted]
    np.testing.assert_allclose(np.abs(left[:, undriven]).max(axis=0), result.residual[undriven], atol=1e-12)
    assert (result.residual < 1e-4 * np.abs(result.u).max()).all()


def test_it_is_the_stable_inversion_at_these_times() -> None:
    robot = robot_from_toml(RODS)
    inverse = stable_inversion(robot, ride(1.2), outputs=["tip.y"])
    result = feedforward(robot, ride(1.2), outputs=["tip.y"], t=inverse.t)
    assert inverse.residual < 1e-8
    np.testing.assert_allclose(result.q, inverse.q, atol=1e-12)
    np.testing.assert_allclose(result.of("hub.gamma")[3], inverse.u[:, 0], atol=1e-9)
    assert result.inverted == ("elbow.gamma",)
    longer = feedforward(robot, ride(1.2), outputs=["tip.y"], t=np.linspace(-1.0, 2.0, 301))
    assert np.abs(longer.q[0]).max() < 1e-9
    assert longer.q[-1] == pytest.approx([1.2, 0.0], abs=1e-9)


def test_where_no_zero_grows_samples_begin_with_the_motion() -> None:
    robot = robot_from_toml(RODS)
    result = feedforward(robot, ride(1.2))
    assert result.outputs == ("hub.gamma",)
    assert result.t[0] == 0.0
    np.testing.assert_allclose(result.of("hub.gamma")[0], ride(1.2).at(result.t)[0][:, 0], atol=1e-9)


@pytest.mark.soak
def test_friction_behind_a_gear_is_smoothed_and_what_it_leaves_is_stated() -> None:
    robot = robot_from_toml(GEARED.replace(MOTOR, MOTOR + "\ngamma = { friction = { coulomb = 0.3 } }"))
    result = feedforward(robot, ride(1.2), outputs=["tip.y"])
    assert any("Coulomb friction of hub.gamma reverses over" in note for note in result.notes)
    assert 0.01 < result.residual[result.coordinates.index("hub.gamma")] < 0.3


def test_the_command_writes_it(tmp_path: Path) -> None:
    robot, scenario = tmp_path / "rods.toml", tmp_path / "s.toml"
    robot.write_text(RODS)
    scenario.write_text(SCENARIO)
    words = ("feedforward", robot, "--scenario", scenario, "--outputs", "tip.y", "--tolerance", 1e-7)
    assert "what follows the motion: tip.y" in command(*words, "-o", tmp_path / "f.npz")
    result = eomgen.load_result(tmp_path / "f.npz")
    assert (result.outputs, result.inverted) == (("tip.y",), ("elbow.gamma",))
    assert np.diff(result.t) == pytest.approx(2e-3)
    assert facts(*words)["outputs"] == ["tip.y"]


def test_what_does_not_go_together_is_refused() -> None:
    robot = robot_from_toml(RODS)
    with pytest.raises(InputError, match=r"kp: -1; allowed: a number from 0 on, or one for each of 1 drives"):
        feedforward(robot, ride()).drive(5, kp=-1)
    with pytest.raises(InputError, match=r"tolerance: 0\.1; allowed: with deviations that nothing drives"):
        feedforward(two_link_arm(), ride(), tolerance=0.1)
    refused(InputError, r"outputs: 2 for 1 drives", feedforward, robot, ride(), outputs=["tip.x", "tip.y"])
