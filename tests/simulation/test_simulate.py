"""Simulated motions, from home and elsewhere; their files, tables and plots; what is refused; the page of scenarios."""

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
from eomgen.integration.solve import integrate
from eomgen.motion.ends import default_motion
from eomgen.motion.splines import Standstill
from eomgen.motion.timetable import TimeTable
from eomgen.pictures.simulation import plot_result
from eomgen.robot.record import robot_hash
from eomgen.robot.value import COORDINATES, Coordinate
from eomgen.scenario import keys as scenario_keys
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.controls import Actuators, JointPD, NoControl, TableTorque
from eomgen.simulation.result import SimulationResult, load_result
from eomgen.simulation.run import run_scenario, simulate
from tests.support.builds import Build
from tests.support.refusals import refused
from tests.support.same_values import compare_values
from tests.support.swinging import NEEDED, elastic_arm, oscillator

pytestmark = pytest.mark.usefixtures("unoptimised")

# Simulated motions


@pytest.fixture(scope="module")
def elastic() -> eomgen.SimulationResult:
    """The elastic PUMA on a short motion."""
    seen: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")  # as in the tests
        result = simulate(eomgen.load_robot("puma560_elastic"), duration=0.8, progress=lambda f, text: seen.append(f))
    assert seen[-1] == 1.0
    assert seen == sorted(seen)
    assert len(seen) > 20
    return result


def test_the_elastic_puma(elastic: eomgen.SimulationResult) -> None:
    motion = elastic.trajectory
    assert motion.q.shape == (1001, 36)
    assert motion.method in ("tsit5", "rosenbrock")
    assert "stiffness switching" in elastic.notes[0]
    assert elastic.program_coordinates == tuple(f"joint{i}.gamma" for i in range(1, 7))
    assert elastic.deviations.shape == (1001, 30)
    assert 20e-6 < np.linalg.norm(elastic.tool_deviation, axis=1).max() < 500e-6
    driven = np.array([name.endswith("gamma") for name in motion.coordinates])
    assert not motion.u[:, ~driven].any()
    assert np.abs(elastic.tracking_error).max() < 1e-4
    # in balance at the start: nothing rings
    kernel = eomgen.build("puma560_elastic")
    assert not motion.v[0].any()
    assert np.abs(kernel.forward_dynamics(motion.q[0], motion.v[0], motion.u[0])).max() < 1e-9


@pytest.mark.soak
def test_the_default_tolerance_is_tight_enough(elastic: eomgen.SimulationResult) -> None:
    tight = simulate(eomgen.load_robot("puma560_elastic"), duration=0.8, rtol=1e-8)
    error = np.linalg.norm(tight.pose[:, :3, 3] - elastic.pose[:, :3, 3], axis=1).max()
    assert error < 1e-3 * np.linalg.norm(tight.tool_deviation, axis=1).max()
    assert np.abs(tight.deviations - elastic.deviations).max() < 1e-3 * np.abs(tight.deviations).max()


def test_result_file(elastic: eomgen.SimulationResult, tmp_path: Path) -> None:
    path = elastic.save(tmp_path / "new" / "trajectory.npz")
    assert [entry.name for entry in path.parent.iterdir()] == ["trajectory.npz"]
    again = load_result(path)
    assert again.summary() == elastic.summary()
    assert again.summary_lines() == elastic.summary_lines()
    for name in ("t", "q", "v", "u", "energy"):
        assert (getattr(again.trajectory, name) == getattr(elastic.trajectory, name)).all()
    assert (again.pose == elastic.pose).all()
    json.dumps(again.summary(), allow_nan=False)
    with np.load(path) as data:  # readable without eomgen
        assert data["coordinates"][0] == "joint1.x"
        assert data["units"][:4].tolist() == ["m", "m", "m", "rad"]
        assert json.loads(str(data["meta"]))["versions"]["eomgen"] == eomgen.__version__
    path.write_bytes(path.read_bytes()[:5000])
    for bad in (path, tmp_path / "none.npz", Path(__file__)):
        refused(InputError, bad.name, load_result, bad)
    refused(InputError, "cannot be written", elastic.save, Path(__file__) / "trajectory.npz")


@pytest.mark.soak
def test_plots(elastic: eomgen.SimulationResult, tmp_path: Path) -> None:
    written = plot_result(elastic, tmp_path / "plots")
    assert [path.name for path in written] == ["tool.png", "deviations.png", "tracking.png", "energy.png"]
    for path in written:
        assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
        assert path.stat().st_size > 20_000


@pytest.mark.soak
def test_a_rigid_robot_has_no_deviations(tmp_path: Path) -> None:
    result = simulate(eomgen.load_robot("puma560"), duration=0.5, goal={"joint1": 0.2, "joint3.gamma": 1.0})
    assert result.trajectory.method == "tsit5"
    assert result.deviations.shape == (1001, 0)
    assert np.linalg.norm(result.tool_deviation, axis=1).max() < 1e-6
    end = dict(zip(result.program_coordinates, result.program_q[-1], strict=True))
    assert (end["joint1.gamma"], end["joint3.gamma"]) == (0.2, 1.0)
    assert result.summary()["linear_max"] is None
    assert [path.name for path in plot_result(result, tmp_path)] == ["tool.png", "tracking.png", "energy.png"]


def test_free_joints_are_held_and_loose_coordinates_named() -> None:
    robot = elastic_arm()
    first = replace(robot.joints[0], type="free", coordinates={name: Coordinate() for name in COORDINATES})
    last = replace(robot.joints[1], coordinates={"x": Coordinate(), "z": Coordinate(1e4, 10.0), "gamma": Coordinate()})
    result = simulate(replace(robot, name="floating", joints=(first, last)), duration=0.2, goal=[0.1])
    assert np.abs(result.program_q[:, :6]).max() == 0.0
    assert any(note.startswith("free joint joint1") for note in result.notes)
    assert any(note.endswith("joint2.x") for note in result.notes)
    assert result.tool == "link2"


def test_default_motions_stay_inside_the_limits() -> None:
    for name in eomgen.builtin_robots():
        robot = eomgen.load_robot(name)
        if robot.loops:
            continue  # whose drives move some of these alone
        given = ((joint, key, x) for joint in robot.rigid().joints for key, x in joint.coordinates.items())
        names = [f"{joint.name}.{key}" for joint, key, x in given if not x.prescribed]
        motion = default_motion(robot, 1.0, names)
        for joint_name, begin, end in zip(names, motion.start, motion.goal, strict=True):
            low, high = robot.joint(joint_name.partition(".")[0]).limits or (-np.inf, np.inf)
            assert low < begin < high
            assert low < end < high
            assert begin != end


@pytest.mark.parametrize(
    ("limits", "start"),
    [((-1.0, 1.0), 0.0), ((1.0, 3.0), 1.2), ((-3.0, -1.0), -1.2), ((0.5, np.inf), None), ((-np.inf, -0.5), None)],
)
def test_default_motion_with_limits(limits: tuple[float, float], start: float | None) -> None:
    robot = eomgen.load_robot("one_link")
    robot = replace(robot, joints=(replace(robot.joints[0], limits=limits),))
    motion = default_motion(robot, 1.0, ["joint1.gamma"])
    assert limits[0] <= min(motion.start[0], motion.goal[0])
    assert max(motion.start[0], motion.goal[0]) <= limits[1]
    assert start is None or motion.start[0] == pytest.approx(start)
    assert motion.start[0] != motion.goal[0]


@pytest.mark.parametrize(
    ("options", "kind", "text"),
    [
        ({"goal": [1.0, 2.0]}, InputError, r"goal: expected 1 numbers \(joint1.gamma\), got 2"),
        ({"goal": 1.0}, InputError, "goal: expected 1 numbers"),
        ({"goal": {"joint2": 1.0}}, UnknownNameError, "goal: 'joint2' is no principal coordinate"),
        ({"goal": {"joint1.x": 1.0}}, UnknownNameError, "known: joint1.gamma"),
        ({"start": {"joint1": "far"}}, InputError, "start: joint1 = 'far' is not a number"),
        ({"start": [np.nan]}, InputError, "start: joint1.gamma = nan is not finite"),
        ({"goal": [2.0]}, InputError, "goal: joint1.gamma = 2 rad; its limits are -1 to 1 rad"),
        ({"duration": -1.0}, InputError, "duration: -"),
        ({"bandwidth": 0.0}, InputError, "bandwidth: 0.0 rad/s"),
        ({"method": "euler"}, InputError, "method: 'euler'"),
        ({"tool": "hand"}, UnknownNameError, "tool: 'hand' is unknown; known: tcp"),
    ],
)
def test_simulations_that_are_refused(options: dict[str, object], kind: type[Exception], text: str) -> None:
    robot = eomgen.load_robot("one_link")
    robot = replace(robot, joints=(replace(robot.joints[0], limits=(-1.0, 1.0)),))
    refused(kind, text, simulate, robot, **options)


def test_nothing_to_drive_is_said() -> None:
    robot = eomgen.load_robot("one_link")
    fixed = replace(robot.joints[0], type="fixed", coordinates={"x": Coordinate(1e4)})
    for other, message in (
        (replace(robot, name="no_drive", joints=(fixed,)), "no joint has a principal coordinate"),
        (replace(robot, driven=()), r"one_link: nothing drives 'joint1\.gamma', which .*; allowed: a robot whose"),
    ):
        refused(InputError, message, simulate, other, duration=0.05)
    swing = scenario_from_toml('duration = 0.01\n[initial]\nq = { "joint1.gamma" = 0.1 }\n')
    assert not run_scenario(replace(robot, driven=()), swing).trajectory.u.any()


# Optional libraries


def test_import_needs_neither_scipy_nor_matplotlib() -> None:
    code = "import sys, eomgen.simulation.run, eomgen.pictures.simulation\n"
    code += "print([m for m in ('scipy', 'matplotlib') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_missing_libraries_are_named(
    built: Build, elastic: eomgen.SimulationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("scipy", "matplotlib"):
        monkeypatch.setitem(sys.modules, name, None)
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(InputError, match=r'needs SciPy, which is not .*: pip install scipy, or .* "eomgen\[sim\]"'):
        integrate(kernel, [0.1], [0.0], 0.1)
    refused(InputError, r"need Matplotlib, which is not .*: pip install matplotlib, or", plot_result, elastic, tmp_path)
    assert integrate(kernel, [0.1], [0.0], 0.1, method="rk4").t[-1] == 0.1


@pytest.mark.parametrize("ratio", [1.0, np.array([100.0, -50.0])], ids=["at joints", "at motors"])
def test_slopes_of_drives_are_their_derivatives(ratio: float | np.ndarray) -> None:
    """By complex steps; implicit methods take them in the place of differences."""
    place = Actuators(np.array([0, 3]), ratio)
    drive = JointPD(Standstill(np.array([0.1, -0.2])), place, np.array([80.0, 50.0]), np.array([5.0, 3.0]))
    table = TableTorque(TimeTable(("force",), np.array([0.0, 1.0]), np.array([[1.0], [2.0]])), np.array([2]))
    q, v, h = np.array([0.1, 0.2, 0.3, 0.4]), np.array([1.0, 2.0, 3.0, 4.0]), 1e-20
    for law in (drive, table, NoControl()):
        assert law.slopes is not None
        by_q, by_v = law.slopes(0.5, q, v)
        for i, unit in enumerate(np.eye(4)):
            assert np.allclose(by_q[:, i], law(0.5, q + 1j * h * unit, v + 0j).imag / h, rtol=1e-14, atol=0.0)
            assert np.allclose(by_v[:, i], law(0.5, q + 0j, v + 1j * h * unit).imag / h, rtol=1e-14, atol=0.0)


def test_a_drive_that_asks_a_rigid_robot_leaves_its_slopes_to_differences() -> None:
    kernel = eomgen.build("one_link", kernels=("inverse_dynamics",))
    place = Actuators(np.array([0, 1]))
    drive = JointPD(Standstill(np.zeros(2)), place, np.ones(2), np.ones(2), kernel, place)
    assert drive.slopes is None


# Homes


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


# Results


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
        is_record = name in ("trajectory", "balance")
        pairs = [(getattr(ours, key), getattr(theirs, key)) for key in vars(ours)] if is_record else [(ours, theirs)]
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
    ours, theirs = (eomgen.load_result(x.save(tmp_path / f"{k}.npz")) for k, x in enumerate((result, other)))
    compare_values(ours, theirs)


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
        refused(InputError, r"r\.csv: a \.csv has columns of a motion, .*; allowed: .*read_motion", load, path)


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
    refused(UnknownNameError, r"'joint1.z'; did you mean 'joint1.x'", result.series, "joint1.z")


def test_the_residue_is_what_the_other_series_leave(result: SimulationResult) -> None:
    total = result.series("energy.kinetic").values + result.series("energy.potential").values
    works = sum(result.series(f"work.{term}").values for term in ("drives", "prescribed", "wrenches", "payloads"))
    left = total - total[0] - works + result.series("work.dissipated").values
    assert np.array_equal(left, result.series("energy.residue").values)
    assert np.abs(left).max() < 1e-5 * np.abs(works).max()
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
        assert result.balance.relative_residue < 1e-3, block
    for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_the_page_names_all_keys() -> None:
    text = PAGE.read_text(encoding="utf-8")
    kinds = {**scenario_keys.MOTIONS, **scenario_keys.CONTROLS, **scenario_keys.PRESCRIBED}
    keys = {*scenario_keys.SCENARIO.keys, *kinds, *(key for keys in kinds.values() for key in keys)}
    forms = (scenario_keys.INITIAL, scenario_keys.INTEGRATOR, scenario_keys.WRENCH, scenario_keys.PAYLOAD)
    keys |= {key for form in forms for key in form.keys}
    for key in keys:
        assert re.search(rf"(?<!\w){key}(?!\w)", text), key
