"""Limits of a robot in all that plans or simulates motions: what exceeds them is said once, by name and figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.analysis.structures import compare
from eomgen.description.load import robot_from_toml
from eomgen.identification.choosing.solve import poses
from eomgen.identification.compensating.solve import compensate
from eomgen.identification.exciting.solve import excite
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml

pytestmark = pytest.mark.usefixtures("unoptimised")

TEXT = """
name = "arm"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "link1"
mass = 2.0
com = [0.3, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.1, zz = 0.1 }
[[joints]]
name = "joint1"
parent = "base"
child = "link1"
type = "revolute"
alpha = { stiffness = 2e4, damping = 20.0 }
gamma = { LIMITS }
[[frames]]
name = "tcp"
link = "link1"
placement = { xyz = [0.6, 0.0, 0.1] }
"""
TOLD = "exceeds limits of the robot: "


def arm(limits: str = "lower = -1.0, upper = 1.0, velocity = 1.2, effort = 10.0") -> Robot:
    return robot_from_toml(TEXT.replace("LIMITS", f"limits = {{ {limits} }}" if limits else ""))


def told(notes: tuple[str, ...] | list[str]) -> str:
    """The line about limits, of which there is one at most."""
    found = [note for note in notes if TOLD in note]
    assert len(found) <= 1, notes
    return found[0] if found else ""


def test_a_simulation_says_what_its_motion_exceeds() -> None:
    """0.9 rad in 0.4 s take 15/8 of their mean speed at the peak of a polynomial of degree five."""
    quick = eomgen.simulate(arm(), duration=0.5, start=[-0.45], goal=[0.45])
    note = told(quick.notes)
    v = np.abs(quick.trajectory.v[:, quick.trajectory.coordinates.index("joint1.gamma")]).max()
    assert v == pytest.approx(15.0 / 8.0 * 0.9 / 0.4, rel=1e-2)
    assert f"joint1.gamma speed {v:.4g} rad/s at 0.2 s (limit 1.2)" in note
    assert "joint1.gamma effort" in note
    assert "position" not in note
    assert note in quick.summary()["notes"]
    assert any(TOLD in line for line in quick.summary_lines())
    assert not told(eomgen.simulate(arm(), duration=3.0, start=[-0.45], goal=[0.45]).notes)
    assert not told(eomgen.simulate(arm(""), duration=0.5, start=[-0.45], goal=[0.45]).notes)


@pytest.mark.soak
def test_robots_side_by_side_exceed_their_own_limits() -> None:
    slow = replace(arm("velocity = 0.1"), name="slow")
    found = compare([arm(), slow], duration=3.0, goal=[0.45])
    assert [note.partition(" ")[0] for note in found.notes] == ["slow"]
    assert found.lines()[-1] == found.notes[0]
    assert found.as_dict()["notes"] == list(found.notes)


def test_a_corrected_program_says_it() -> None:
    scenario = scenario_from_toml(
        "duration = 0.5\noutput_step = 0.01\n[motion]\ntype = 'point_to_point'\nstart = [-0.45]\ngoal = [0.45]\n"
    )
    assert "the motion of the compensated path exceeds" in told(compensate(arm(), scenario, mode="static").notes)


@pytest.mark.soak
def test_motions_that_excite_keep_to_limits_of_the_description() -> None:
    options = {"duration": 4.0, "harmonics": 3, "step": 0.01, "starts": 1}
    robot = arm()
    found = excite(robot, **options)
    assert not told(found.notes)
    assert 0.5 * 1.2 < np.abs(found.v).max() <= 1.2
    assert np.abs(found.u).max() <= 10.0
    assert not any("rates of" in note for note in found.notes)
    quick = excite(robot, rates=3.0, **options)
    assert "joint1.gamma speed" in told(quick.notes)
    assert any("1 rad/s is assumed" in note for note in excite(arm("lower = -1.0, upper = 1.0"), **options).notes)


def test_poses_out_of_limits_are_said() -> None:
    options = {"count": 12, "candidates": 60, "measure": "position"}
    assert not told(poses(arm(), **options).notes)
    assert "joint1.gamma position" in told(poses(arm(), ranges={"joint1": (-2.0, 2.0)}, **options).notes)
