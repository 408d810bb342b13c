"""Feed-forward of robots whose deviations have no drive: by stable inversion, alone and behind elastic gears."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.cli.entry import main
from eomgen.control import FeedForward, feedforward, stable_inversion
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.integration import integrate
from eomgen.robot.value import Robot
from tests.control.test_inversion import RODS, ride
from tests.support.geared_arms import two_link_arm

pytestmark = pytest.mark.usefixtures("unoptimised")

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


def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, scenario = tmp_path / "rods.toml", tmp_path / "s.toml"
    robot.write_text(RODS)
    scenario.write_text(SCENARIO)
    words = ["feedforward", str(robot), "--scenario", str(scenario), "--outputs", "tip.y", "--tolerance", "1e-7"]
    assert main([*words, "-o", str(tmp_path / "f.npz")]) == 0
    assert "what follows the motion: tip.y" in capsys.readouterr().out
    result = eomgen.load_result(tmp_path / "f.npz")
    assert (result.outputs, result.inverted) == (("tip.y",), ("elbow.gamma",))
    assert np.diff(result.t) == pytest.approx(2e-3)
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outputs"] == ["tip.y"]


def test_what_does_not_go_together_is_refused() -> None:
    robot = robot_from_toml(RODS)
    with pytest.raises(InputError, match=r"kp: -1; allowed: a number from 0 on, or one for each of 1 drives"):
        feedforward(robot, ride()).drive(5, kp=-1)
    with pytest.raises(InputError, match=r"tolerance: 0\.1; allowed: with deviations that nothing drives"):
        feedforward(two_link_arm(), ride(), tolerance=0.1)
    with pytest.raises(InputError, match=r"outputs: 2 for 1 drives"):
        feedforward(robot, ride(), outputs=["tip.x", "tip.y"])
