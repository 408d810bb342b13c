"""Sweeps of closed mechanisms: samples are what simulations of robots of these numbers are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import eomgen
from eomgen.scenario.load import scenario_from_values
from eomgen.simulation.run import run_scenario
from eomgen.sweep import plan_from_toml, run

pytestmark = pytest.mark.usefixtures("unoptimised")

PLAN = """
samples = 2
seed = 5
record = ["drive_max", "coordinate_end"]
[engine]
type = "rollout"
[[vary]]
parameter = "links.crank.mass"
normal = { mean = 1.0, deviation = 0.2 }
relative = true
"""
MOTION = {"duration": 0.05, "motion": {"type": "point_to_point"}}


@pytest.mark.soak
def test_samples_of_a_four_bar_are_simulations(tmp_path: Path) -> None:
    result = run("four_bar", MOTION, plan_from_toml(PLAN), tmp_path)
    robot = eomgen.load_robot("four_bar")
    crank = robot.link("crank")
    for i, (mass,) in enumerate(result.samples.tolist()):
        scaled = replace(robot, links=tuple(replace(x, mass=mass) if x is crank else x for x in robot.links))
        alone = run_scenario(scaled, scenario_from_values(MOTION, source="scenario", folder=Path()))
        ends = [result.of(f"coordinate_end.{name}")[i] for name in alone.trajectory.coordinates]
        assert ends == pytest.approx(alone.trajectory.q[-1].tolist(), rel=2e-2, abs=1e-9)
