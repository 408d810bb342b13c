"""Scenarios whose drives are clipped at their efforts, and with drives by feed-forward."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, IntegrationError
from eomgen.export.live.acting import acting_on
from eomgen.identification import compensate
from eomgen.kernel.stepping.input_signals import Gains, Signal
from eomgen.progress import no_progress
from eomgen.robot.bounds import Limits
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.scenario.value import Scenario
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from eomgen.simulation.sampled_drive import SampledDrive
from eomgen.sweep.driver import run
from eomgen.sweep.plan import plan_from_toml
from tests.control.test_inversion import GEARED, RODS, SCENARIO
from tests.support.joint_table import joint_table, link_table
from tests.support.pendulums import MOTOR, described
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

# Clipped drives


ARM = f"""
name = "arm"
gravity = [0.0, -9.81, 0.0]
{link_table("link1", 2.0, (0.3, 0.0, 0.0), (0.01, 0.1, 0.1))}
{link_table("link2", 1.0, (0.3, 0.0, 0.0), (0.01, 0.1, 0.1))}
{joint_table("joint1", "base", "link1", "revolute")}
y = {{ stiffness = 2e4, damping = 20.0 }}
gamma = {{ limits = {{ velocity = 1e3, effort = 12.0 }} }}
{joint_table("joint2", "link1", "link2", "revolute")}
placement = {{ xyz = [0.6, 0.0, 0.1] }}
gamma = {{ friction = {{ coulomb = 0.1 }} }}
motor = {{ inertia = 1e-4, ratio = -50.0, stiffness = 2e3, damping = 1.0, limits = {{ effort = 0.08 }} }}
"""
CONTROLS = {
    "computed": "type = 'computed_torque'",
    "pd": "type = 'pd'\nkp = 300\nkd = 20\ngravity = true",
    "torque": "type = 'torque'\ncoordinates = ['joint1', 'joint2']\nrows = [[0, 0, 0], [0.1, 30, -0.2], [0.4, -30, 0]]",
}


def scenario(control: str, method: str = "auto", saturate: str = "saturate = true") -> Scenario:
    has_motion = "type = 'torque'" not in control
    motion = "[motion]\ntype = 'point_to_point'\nstart = [0.0, 0.0]\ngoal = [-0.8, 0.4]\n" if has_motion else ""
    integrator = f"[integrator]\nmethod = '{method}'\nrtol = 1e-7\n"
    head = "duration = 0.5\noutput_step = 0.005\n[initial]\nequilibrium = false\n"
    return scenario_from_toml(f"{head}{motion}[control]\n{control}\n{saturate}\n{integrator}")


def drives(result: SimulationResult) -> np.ndarray:
    """The largest drives of joint1 and of joint2's motor."""
    names = result.trajectory.coordinates
    index = [names.index("joint1.gamma"), names.index("joint2.motor")]
    return np.asarray(np.abs(result.trajectory.u[:, index]).max(axis=0))


@pytest.mark.parametrize("control", soaked(CONTROLS, ("pd",)))
def test_drives_are_clipped_in_c_and_in_python(control: str) -> None:
    """By the same amounts, at the joint and at a motor behind a gear, and the energy balances."""
    robot = robot_from_toml(ARM)
    by_c = run_scenario(robot, scenario(CONTROLS[control]))
    by_python = run_scenario(robot, scenario(CONTROLS[control], "scipy:BDF"))
    free = run_scenario(robot, scenario(CONTROLS[control], saturate=""))
    assert drives(free)[0] > 12.5
    assert drives(by_c)[0] == drives(by_python)[0] == 12.0
    assert drives(by_c)[1] <= 0.08
    size = np.abs(by_c.trajectory.q - free.trajectory.q).max()
    assert size > 1e-2
    assert np.abs(by_c.trajectory.q - by_python.trajectory.q).max() < 1e-3 * size
    for result in (by_c, by_python):
        assert result.balance.relative_residue < 1e-4
        assert not any("exceeds limits" in note for note in result.notes)
        (note,) = [note for note in result.notes if "clipped" in note]
        assert "joint1.gamma at 12 N m, " in note
    (note,) = [note for note in free.notes if "exceeds limits" in note]
    assert "joint1.gamma effort" in note
    assert "(limit 12)" in note
    assert not any("clipped" in note for note in free.notes)


@pytest.mark.soak
def test_what_cannot_be_clipped_is_named() -> None:
    weak = robot_from_toml(ARM.replace(", effort = 12.0", "").replace(", limits = { effort = 0.08 }", ""))
    with pytest.raises(DescriptionError, match=r"control\.saturate: no drive has a limit of its effort; allowed: a"):
        run_scenario(weak, scenario(CONTROLS["pd"]))
    closed = replace(eomgen.load_robot("four_bar"), driven=("joint1.gamma", "joint2.gamma"))
    closed = replace(closed, joints=tuple(x.with_limits("gamma", Limits(effort=5.0)) for x in closed.joints))
    kernel = eomgen.build(closed)
    q = kernel.assemble([closed.home.get(name, 0.0) for name in kernel.coordinates])
    closed = replace(closed, home=dict(zip(kernel.coordinates, q.tolist(), strict=True)))
    text = "duration = 0.02\n[control]\ntype = 'computed_torque'\n"
    assert run_scenario(closed, scenario_from_toml(text)).trajectory.t[-1] == 0.02
    with pytest.raises(DescriptionError, match=r"control\.saturate: .* are more drives than the 1 freedoms of"):
        run_scenario(closed, scenario_from_toml(f"{text}saturate = true\n"))


def test_drives_too_weak_for_the_start_are_named() -> None:
    """Joint 1 bears (2 0.3 + 1 0.9) 9.81 N m at rest, stretched out; joint 2 can hold its link."""
    whole = scenario(CONTROLS["computed"])
    message = (
        r"no static equilibrium within the efforts of its drives: joint1\.gamma would have to do 14\.7\d? N m, its"
    )
    raised = refused(IntegrationError, message, run_scenario, robot_from_toml(ARM), replace(whole, initial=None))
    assert "joint2" not in str(raised)
    strong = robot_from_toml(ARM.replace("effort = 12.0", "effort = 15.0"))
    assert run_scenario(strong, replace(whole, initial=None)).trajectory.u[0, 1] == pytest.approx(14.715, rel=1e-3)


def test_a_page_does_not_clip() -> None:
    with pytest.raises(InputError, match=r"saturate: drives that are clipped are not in a page; allowed: without"):
        acting_on(robot_from_toml(ARM), scenario(CONTROLS["pd"]), "link2", no_progress, [])


# Feed-forward


SWING = """
duration = 0.4
output_step = 2e-3
motion = { type = "point_to_point", start = [0.0], goal = [0.5], duration = 0.3, smooth = 4 }
integrator = { method = "tsit5", rtol = 1e-11, atol = 1e-12 }
"""
CONTROL = 'control = { type = "feedforward" }\n'


def pendulum() -> Robot:
    return described(MOTOR)


@pytest.mark.parametrize("gains", ["", ", kp = 400.0, kd = 30.0"])
def test_a_link_behind_a_gear_follows_with_and_without_feedback(gains: str) -> None:
    result = run_scenario(pendulum(), scenario_from_toml(SWING + CONTROL.replace(" }", gains + " }")))
    motion = result.trajectory
    assert np.abs(motion.of("joint1.gamma") - result.program_q[:, 0]).max() < 1e-9
    assert any("feed-forward: by springs and dampers of elastic gears: joint1.motor" in note for note in result.notes)
    assert any("drives act at joint1.motor" in note for note in result.notes) == bool(gains)


def test_feedback_brings_back_what_begins_elsewhere() -> None:
    """From 20 mrad off, at rest: the PD law of the motor holds against the error, which dies out."""
    text = SWING.replace("duration = 0.4", "duration = 1.0", 1) + 'initial = { v = { "joint1" = 0.2 } }\n'
    ends = []
    for gains in ("", ", kp = 2000.0, kd = 60.0"):
        result = run_scenario(pendulum(), scenario_from_toml(text + CONTROL.replace(" }", gains + " }")))
        ends.append(np.abs(result.trajectory.of("joint1.gamma")[-1] - result.program_q[-1, 0]))
    assert ends[1] < 1e-2 * ends[0]


def test_drives_in_python_are_those_in_c() -> None:
    """Forces, feedback over the gears' ratios, slopes against differences, clipped ones, and the standstill."""
    t = np.linspace(0.0, 1.0, 11)
    forces = Signal.through(t, np.column_stack([np.sin(t), np.cos(t)]))
    places = Signal.through(t, np.column_stack([t, 2.0 * t]))
    gains = Gains(np.array([3.0, 400.0]), np.array([0.5, 20.0]))
    drive = SampledDrive(forces, np.array([2, 0]), places, np.array([1.0, 50.0]), gains)
    q, v = np.array([5.0, 9.0, 0.1]), np.array([60.0, 9.0, 0.3])
    u = drive(0.35, q, v)
    assert u[2] == pytest.approx((np.sin(0.3) + np.sin(0.4)) / 2.0 + 3.0 * (0.35 - 0.1) + 0.5 * (1.0 - 0.3))
    motor = 400.0 * (0.7 - 5.0 / 50.0) + 20.0 * (2.0 - 60.0 / 50.0)
    assert u[0] == pytest.approx((np.cos(0.3) + np.cos(0.4)) / 2.0 + motor / 50.0)
    assert u[1] == 0.0
    np.testing.assert_array_equal(drive(0.35, np.stack([q, q]), np.stack([v, v])), np.stack([u, u]))
    by_q, by_v = drive.slopes(0.35, q, v)
    for i, unit in enumerate(np.eye(3)):
        np.testing.assert_allclose(by_q[:, i], drive(0.35, q + unit, v) - u, atol=1e-12)
        np.testing.assert_allclose(by_v[:, i], drive(0.35, q, v + unit) - u, atol=1e-12)
    clipped = replace(drive, effort=np.array([1.0, np.inf, np.inf]))
    assert clipped(0.35, q, v)[0] == 1.0
    assert not clipped.slopes(0.35, q, v)[0][0].any()
    np.testing.assert_allclose(drive.standstill()(0.7, q, 0.0 * q), drive(0.0, q, np.array([100.0, 0.0, 1.0])))


@pytest.mark.soak
@pytest.mark.parametrize("text", [RODS, GEARED])
@pytest.mark.parametrize("gains", ["", "kp = 20.0\nkd = 2.0\n"])
def test_a_tool_behind_deviations_follows(text: str, gains: str, tmp_path: Path) -> None:
    robot, control = tmp_path / "rods.toml", '[control]\ntype = "feedforward"\noutputs = ["tip.y"]\n' + gains
    robot.write_text(text)
    result = run_scenario(robot, scenario_from_toml(SCENARIO + control + "[integrator]\nrtol = 1e-9\n"))
    assert np.abs(result.pose - result.program_pose)[:, 1, 3].max() < 2e-6
    assert any("feed-forward: what follows the motion: tip.y" in note for note in result.notes)


@pytest.mark.soak
def test_samples_of_a_sweep_have_the_feedforward_of_the_description(tmp_path: Path) -> None:
    plan = plan_from_toml(
        'record = ["tracking_max"]\n[[vary]]\nparameter = "joints.joint1.motor.stiffness"\n'
        "grid = { values = [1.6e4, 2e4] }\n"
    )
    robot = replace(pendulum(), tunable=("joints.joint1.motor.stiffness",))
    found = run(robot, tomllib.loads(SWING + CONTROL), plan, tmp_path / "sweep", threads=1)
    soft, exact = found.record[:, found.columns.index("tracking_max.joint1.gamma")]
    assert exact < 1e-8 < soft


def test_what_has_no_feedforward_is_refused_with_the_control() -> None:
    low, still = SWING.replace("smooth = 4", "smooth = 2"), 'motion = { type = "point_to_point", start'
    still = SWING.replace(still, "initial = { q = { joint1 = 0.1 } }\n#")
    loose = CONTROL.replace(" }", ", tolerance = 0.1 }")
    for ask, text, error, message in (
        (run_scenario, low + CONTROL, DescriptionError, r"control: motion: its jerk jumps at t = 0 s.*smooth = 4"),
        (run_scenario, SWING + loose, InputError, r"control: tolerance: 0\.1; allowed: with deviations that nothing"),
        (compensate, SWING + CONTROL, InputError, r"control: feed-forward knows of deviations itself"),
        (run_scenario, still + CONTROL, InputError, r"motion: there is none; allowed: a motion for feed-forward"),
    ):
        refused(error, message, ask, pendulum(), scenario_from_toml(text))
