"""Scenarios with drives by feed-forward: open loop, with feedback, and who refuses them."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import DescriptionError, InputError
from eomgen.identification import compensate
from eomgen.robot.value import Robot
from eomgen.runtime.stepping.input_signals import Gains, Signal
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation import run_scenario
from eomgen.simulation.sampled_drive import SampledDrive
from eomgen.sweep.driver import run
from eomgen.sweep.plan import plan_from_toml
from tests.control.test_inverse_feedforward import GEARED, RODS, SCENARIO
from tests.support.pendulums import MOTOR, described

pytestmark = pytest.mark.usefixtures("unoptimised")

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
    drive = SampledDrive(
        forces, np.array([2, 0]), places, np.array([1.0, 50.0]), Gains(np.array([3.0, 400.0]), np.array([0.5, 20.0]))
    )
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
    low = SWING.replace("smooth = 4", "smooth = 2")
    with pytest.raises(DescriptionError, match=r"control: motion: its jerk jumps at t = 0 s.*smooth = 4"):
        run_scenario(pendulum(), scenario_from_toml(low + CONTROL))
    with pytest.raises(InputError, match=r"control: tolerance: 0\.1; allowed: with deviations that nothing drives"):
        run_scenario(pendulum(), scenario_from_toml(SWING + CONTROL.replace(" }", ", tolerance = 0.1 }")))
    with pytest.raises(InputError, match=r"control: feed-forward knows of deviations itself"):
        compensate(pendulum(), scenario_from_toml(SWING + CONTROL))
    still = SWING.replace('motion = { type = "point_to_point", start', "initial = { q = { joint1 = 0.1 } }\n#")
    with pytest.raises(InputError, match=r"motion: there is none; allowed: a motion for feed-forward"):
        run_scenario(pendulum(), scenario_from_toml(still + CONTROL))
