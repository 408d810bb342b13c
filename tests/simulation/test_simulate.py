"""Simulated motions, their files and plots, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen import InputError, UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.motion.ends import default_motion
from eomgen.motion.splines import Standstill
from eomgen.motion.timetable import TimeTable
from eomgen.pictures.simulation import plot_result
from eomgen.robot.value import COORDINATES, Coordinate
from eomgen.simulation.controls import Actuators, JointPD, NoControl, TableTorque
from eomgen.simulation.result import load_result
from eomgen.simulation.run import simulate
from tests.support.builds import Build
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
        with pytest.raises(InputError, match=bad.name):
            load_result(bad)
    with pytest.raises(InputError, match="cannot be written"):
        elastic.save(Path(__file__) / "trajectory.npz")


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
    assert [path.name for path in plot_result(result, tmp_path)] == [
        "tool.png",
        "tracking.png",
        "energy.png",
    ]


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
        rigid = robot.rigid()
        names = [
            f"{joint.name}.{key}"
            for joint in rigid.joints
            for key, coordinate in joint.coordinates.items()
            if not coordinate.prescribed
        ]
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
    with pytest.raises(kind, match=text):
        simulate(robot, **options)  # type: ignore[arg-type]


def test_nothing_to_drive_is_said() -> None:
    robot = eomgen.load_robot("one_link")
    fixed = replace(robot.joints[0], type="fixed", coordinates={"x": Coordinate(1e4)})
    with pytest.raises(InputError, match="no joint has a principal coordinate"):
        simulate(replace(robot, name="no_drive", joints=(fixed,)))


# Optional libraries


def test_import_needs_neither_scipy_nor_matplotlib() -> None:
    code = """
import sys
import eomgen.simulation.run, eomgen.pictures.simulation
print([m for m in ('scipy', 'matplotlib') if m in sys.modules])"""
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
    with pytest.raises(InputError, match=r"need Matplotlib, which is not .*: pip install matplotlib, or"):
        plot_result(elastic, tmp_path)
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
