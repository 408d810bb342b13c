"""Results in files: everything comes back, by names, and the page of scenarios runs as it stands."""

from __future__ import annotations

import copy
import json
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError, UnknownNameError
from eomgen.robot.record import robot_hash
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from tests.support.same_values import compare_values

pytestmark = pytest.mark.usefixtures("unoptimised")

PAGE = Path(__file__).parents[2] / "docs" / "scenario.md"
SCENARIO = """
duration = 0.2
output_step = 0.01
[motion]
type = "point_to_point"
goal = [0.3]
[[wrenches]]
link = "link1"
force = [1.0, 2.0, 3.0]
t0 = 0.05
t1 = 0.1
[[payloads]]
link = "link1"
mass = 0.1
point = [1.0, 0.0, 0.0]
t0 = 0.15
"""


@pytest.fixture(scope="module")
def result() -> SimulationResult:
    return run_scenario(eomgen.load_robot("one_link"), scenario_from_toml(SCENARIO))


def test_everything_comes_back(result: SimulationResult, tmp_path: Path) -> None:
    again = eomgen.load_result(result.save(tmp_path / "r.npz"))
    for name in vars(result):
        ours, theirs = getattr(result, name), getattr(again, name)
        if name in ("trajectory", "balance"):
            pairs = [(getattr(ours, key), getattr(theirs, key)) for key in vars(ours)]
        else:
            pairs = [(ours, theirs)]
        for one, other in pairs:
            if isinstance(one, np.ndarray):
                assert one.dtype == other.dtype
                assert one.tobytes() == np.ascontiguousarray(other).tobytes(), name
            else:
                assert one == other, name
    assert again.scenario["wrenches"][0]["table"]["values"] == [[1.0, 2.0, 3.0, 0.0, 0.0, 0.0]]
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"]


WAYS = {"pickle": lambda x: pickle.loads(pickle.dumps(x)), "deepcopy": copy.deepcopy, "copy": copy.copy}


@pytest.mark.parametrize("way", WAYS)
def test_results_are_copied_and_pickled(result: SimulationResult, way: str, tmp_path: Path) -> None:
    other = WAYS[way](result)
    compare_values(result, other)
    assert other.summary() == result.summary()
    assert (other.trajectory.q is result.trajectory.q) == (way == "copy")
    with pytest.raises(TypeError):
        other.versions["eomgen"] = "0"
    compare_values(
        eomgen.load_result(result.save(tmp_path / "a.npz")), eomgen.load_result(other.save(tmp_path / "b.npz"))
    )


def test_a_csv_has_the_motion_that_commands_read(result: SimulationResult, tmp_path: Path) -> None:
    path, motion = result.save(tmp_path / "new" / "r.csv"), result.trajectory
    lines = path.read_text().splitlines()
    assert lines[0] == f"# Motion of one_link, simulated ({motion.method}): s, m and rad, N and N m."
    assert lines[1] == "t,joint1.x,joint1.gamma,joint1.x.rate,joint1.gamma.rate,joint1.gamma.drive"
    again = eomgen.motion.read_motion(path, motion.coordinates)
    for name in ("t", "q", "v", "u"):
        assert getattr(again, name).tobytes() == np.ascontiguousarray(getattr(motion, name)).tobytes(), name
    assert again.driven == result.motion.driven == ("joint1.gamma",)
    for load in (eomgen.load_result, eomgen.simulation.load_result):
        with pytest.raises(InputError, match=r"r\.csv: a \.csv has columns of a motion, .*; allowed: .*read_motion"):
            load(path)


def test_series_have_names_and_units(result: SimulationResult) -> None:
    motion = result.trajectory
    expected = {
        "joint1.x": ("m", motion.q[:, 0]),
        "joint1.x.rate": ("m/s", motion.v[:, 0]),
        "joint1.x.drive": ("N", motion.u[:, 0]),
        "joint1.gamma": ("rad", motion.q[:, 1]),
        "joint1.gamma.rate": ("rad/s", motion.v[:, 1]),
        "joint1.gamma.drive": ("N m", motion.u[:, 1]),
        "joint1.gamma.program": ("rad", result.program_q[:, 0]),
        "tcp.position": ("m", result.pose[:, :3, 3]),
        "energy.kinetic": ("J", motion.energy[:, 0]),
    }
    for name, (unit, values) in expected.items():
        found = result.series(name)
        assert (found.name, found.unit) == (name, unit)
        assert np.array_equal(found.values, values)
    force = result.series("link1.force")
    assert force.unit == "N"
    acts = (force.t >= 0.05) & (force.t < 0.1)
    assert np.array_equal(force.values[acts], np.tile([1.0, 2.0, 3.0], (5, 1)))
    assert not force.values[~acts].any()
    assert set(expected) < set(result.names)
    with pytest.raises(UnknownNameError, match=r"'joint1.z'; did you mean 'joint1.x'"):
        result.series("joint1.z")


def test_the_residue_is_what_the_other_series_leave(result: SimulationResult) -> None:
    total = result.series("energy.kinetic").values + result.series("energy.potential").values
    works = sum(result.series(f"work.{term}").values for term in ("drives", "prescribed", "wrenches", "payloads"))
    left = total - total[0] - works + result.series("work.dissipated").values
    assert np.array_equal(left, result.series("energy.residue").values)
    assert np.abs(left).max() < 1e-5 * np.abs(works).max()
    assert result.balance is not None
    for text in ("drives", "wrenches", "payloads"):
        assert text in result.balance.line()


def test_results_of_earlier_versions_are_read(result: SimulationResult, tmp_path: Path) -> None:
    """Files without scenario, wrenches and works, as they were before."""
    path = result.save(tmp_path / "new.npz")
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files if name not in ("meta", "wrench", "work")}
        meta = json.loads(str(data["meta"]))
    kept = ("format", "robot", "tool", "method", "notes", "info", "versions")
    np.savez(tmp_path / "old.npz", meta=json.dumps({key: meta[key] for key in kept}), **arrays)
    old = eomgen.load_result(tmp_path / "old.npz")
    assert np.array_equal(old.trajectory.q, result.trajectory.q)
    assert old.balance is None
    assert old.summary()["energy"] is None
    assert "energy.residue" not in old.names


def test_scenarios_travel_between_processes() -> None:
    text = SCENARIO + "[initial]\nq = { joint1 = 0.1 }\n"
    scenario = scenario_from_toml(text)
    assert pickle.loads(pickle.dumps(scenario)).as_dict() == scenario.as_dict()


def test_the_hash_is_of_the_robots_content() -> None:
    robot = eomgen.load_robot("one_link")
    assert robot_hash(replace(robot, source="elsewhere", notes=("a note",))) == robot_hash(robot)
    assert robot_hash(replace(robot, gravity=(0.0, -9.8, 0.0))) != robot_hash(robot)
    assert re.fullmatch("[0-9a-f]{64}", robot_hash(robot))


@pytest.mark.soak
def test_the_page_runs(tmp_path: Path) -> None:
    """Every block of docs/scenario.md: TOML with the robot it is for, Python as it stands."""
    text = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    assert len(blocks) >= 7
    for block in blocks:
        robot = "shaken_arm" if "mount." in block else "one_link"
        result = run_scenario(eomgen.load_robot(robot), scenario_from_toml(block, source=block.splitlines()[2]))
        assert np.isfinite(result.trajectory.q).all()
        assert result.balance is not None
        assert result.balance.relative_residue < 1e-3, block
    for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_the_page_names_all_keys() -> None:
    from eomgen.scenario import keys as scenario_keys

    text = PAGE.read_text(encoding="utf-8")
    kinds = {**scenario_keys.MOTIONS, **scenario_keys.CONTROLS, **scenario_keys.PRESCRIBED}
    keys = {*scenario_keys.SCENARIO.keys, *kinds, *(key for keys in kinds.values() for key in keys)}
    forms = (scenario_keys.INITIAL, scenario_keys.INTEGRATOR, scenario_keys.WRENCH, scenario_keys.PAYLOAD)
    keys |= {key for form in forms for key in form.keys}
    for key in keys:
        assert re.search(rf"(?<!\w){key}(?!\w)", text), key
