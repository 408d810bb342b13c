"""Samples that are integrated side by side: the bits of each are those that it has alone, whatever goes beside it."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest

import eomgen
from eomgen.robot.value import Robot
from eomgen.simulation.run import plan_of
from eomgen.sweep import job as jobs
from eomgen.sweep.contents import SampleRow
from eomgen.sweep.driver import prepare, run
from eomgen.sweep.job import SampleRunner
from eomgen.sweep.plan import Plan, plan_from_toml
from tests.support.sliders import RELEASE, STIFF, slider
from tests.support.soak import soaked
from tests.sweep.test_sweep import CONTROLS, REACH, arm, same

pytestmark = pytest.mark.usefixtures("unoptimised")

HEAD = "seed = 5\nengine = { type = 'integrate' }\n"
ARM_PLAN = (
    HEAD
    + """
samples = 19
record = ["tool_deviation_max", "tool_rotation_max", "drive_max", "tracking_max", "coordinate_end", "reaction_max"]
[[vary]]
parameter = "joints.shoulder.alpha.stiffness"
normal = { mean = 1.0, deviation = 0.3, low = 0.2, high = 2.0 }
relative = true
[[vary]]
parameter = "links.fore.mass"
uniform = { low = 0.3, high = 2.0 }
"""
)
PUSHED = {"wrenches": CONTROLS["loads"]["wrenches"]}
CASES = {
    "computed torque": {**REACH, "duration": 0.1},
    "pd": {**REACH, "duration": 0.1, **CONTROLS["pd"]},
    "wrenches": {**REACH, "duration": 0.15, **PUSHED},
    "tsit5": {**REACH, "duration": 0.1, "integrator": {"method": "tsit5", "rtol": 1e-8}},
}
MASS = (
    f"{HEAD}samples = 9\nrecord = ['coordinate_end', 'coordinate_max']\n{STIFF}uniform = {{ low = 90, high = 900 }}\n"
)


def rows_of(robot: Robot, scenario: dict[str, Any], plan: Plan) -> tuple[SampleRunner, list[list[float]]]:
    job, design, _ = prepare(robot, scenario, plan)
    return SampleRunner(job), [list(design.values(i)) for i in range(len(design))]


def check_company(runner: SampleRunner, samples: list[list[float]], monkeypatch: pytest.MonkeyPatch) -> list[SampleRow]:
    """Rows of all samples, which are those of some of them, in other orders, and of each by itself in Python's loop."""
    indices = list(range(len(samples)))
    whole = runner.rows(indices, samples)
    for some in (indices[::-2], indices[3:5], indices[:1]):
        assert runner.rows(some, [samples[i] for i in some]) == [whole[i] for i in some]
    monkeypatch.setattr(jobs, "may_run_side_by_side", lambda *_: False)
    assert runner.rows(indices, samples) == whole
    return whole


@pytest.mark.parametrize("case", soaked(CASES, ("computed torque", "pd", "tsit5")))
def test_samples_are_what_they_are_alone(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    runner, samples = rows_of(arm(), CASES[case], plan_from_toml(ARM_PLAN))
    scenario, assembly = runner.nominal(())
    assert jobs.may_run_side_by_side(assembly, plan_of(assembly, scenario))
    found = check_company(runner, samples, monkeypatch)
    assert not any(row.error for row in found)
    assert len({row.record for row in found}) == len(found)


def test_masses_that_are_picked_up_and_samples_that_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters that change on the way; errors are those of the sample alone."""
    picked = {"link": "mass", "mass": 1.0, "point": [0.0, 0.0, 0.0], "t0": 0.13, "t1": 0.4}
    runner, samples = rows_of(slider(), {**RELEASE, "payloads": [picked]}, plan_from_toml(MASS))
    samples[4] = [1e300]
    found = check_company(runner, samples, monkeypatch)
    assert [bool(row.error) for row in found] == [i == 4 for i in range(9)]
    assert "rail.z" in found[4].error


@pytest.mark.soak
def test_loops_are_closed_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"{HEAD}samples = 11\nrecord = ['drive_max', 'coordinate_end']\n[[vary]]\nparameter = 'links.crank.mass'\n"
    plan = plan_from_toml(text + "normal = { mean = 1.0, deviation = 0.3, low = 0.2 }\nrelative = true\n")
    scenario = {"duration": 0.2, "motion": {"type": "point_to_point"}, "control": {"type": "pd", "kp": 50, "kd": 2}}
    runner, samples = rows_of(eomgen.load_robot("four_bar"), scenario, plan)
    assert not any(row.error for row in check_company(runner, samples, monkeypatch))


@pytest.mark.soak
def test_threads_and_processes_change_nothing(tmp_path: Path) -> None:
    plan, scenario = plan_from_toml(ARM_PLAN.replace("samples = 19", "samples = 37")), CASES["computed torque"]
    one = run(arm(), scenario, plan, tmp_path / "one", threads=1)
    assert not one.errors
    assert same(one, run(arm(), scenario, plan, tmp_path / "three", threads=3))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        assert same(one, run(arm(), scenario, plan, tmp_path / "processes", executor=pool))
