"""Simulations start where the description says."""

from __future__ import annotations

from dataclasses import replace

import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario, simulate

pytestmark = pytest.mark.usefixtures("unoptimised")


def test_default_motions_and_resting_robots_start_at_home() -> None:
    robot = replace(eomgen.load_robot("one_link"), home={"joint1.gamma": 0.3})
    moved = simulate(robot, duration=0.05)
    assert moved.trajectory.q[0, 1] == pytest.approx(0.3, abs=1e-12)
    held = scenario_from_toml('duration = 0.05\n[control]\ntype = "computed_torque"\n')
    assert run_scenario(robot, held).trajectory.q[-1, 1] == pytest.approx(0.3, abs=1e-6)


def test_what_a_scenario_says_comes_before_home() -> None:
    robot = replace(eomgen.load_robot("one_link"), home={"joint1.gamma": 0.3, "joint1.x": 1e-4})
    text = 'duration = 0.01\n[initial]\nequilibrium = false\nq = { "joint1.gamma" = 0.1 }\n'
    start = run_scenario(robot, scenario_from_toml(text)).trajectory.q[0]
    assert start == pytest.approx([1e-4, 0.1], abs=1e-15)


def test_controlled_motions_need_drives() -> None:
    robot = replace(eomgen.load_robot("one_link"), driven=())
    with pytest.raises(InputError, match=r"one_link: nothing drives 'joint1\.gamma', which .*; allowed: a robot whose"):
        simulate(robot, duration=0.05)
    swing = scenario_from_toml('duration = 0.01\n[initial]\nq = { "joint1.gamma" = 0.1 }\n')
    assert not run_scenario(robot, swing).trajectory.u.any()
