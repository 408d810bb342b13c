"""Orientations of tools, and free and ball joints over the poles of their angles: scenarios, files, streams, sweeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, ReachError
from eomgen.identification import forces
from eomgen.motion.files import motion_from_columns
from eomgen.pictures.page import report_of
from eomgen.pictures.simulation import plot_tool
from eomgen.robot.value import ANGULAR, Coordinate, Frame, Joint, Link, Placement, Robot
from eomgen.scenario.load import load_scenario, scenario_from_toml, scenario_from_values
from eomgen.simulation.result import SimulationResult, load_result
from eomgen.simulation.run import run_scenario, simulate
from eomgen.sweep import plan_from_toml
from eomgen.sweep import run as run_sweep
from tests.oracles.free_bodies import falling_body
from tests.support.commands import command
from tests.support.measurements import columns_of
from tests.support.optional import installed, needs
from tests.support.refusals import refused
from tests.support.scaras import scara
from tests.support.small_robots import free_body

pytestmark = pytest.mark.usefixtures("unoptimised")

BEGIN = "duration = 0.5\noutput_step = 5e-3\n[initial]\nq = { arm1 = 0.3, arm2 = 0.8, stroke = 0.1, wrist = -0.4 }\n"
LINE = "[motion]\ntype = 'line'\nduration = 0.4\nfrom = [0.5, 0.3, 0.45]\nto = [0.4, 0.4, 0.4]\n"
SPLINE = """
[motion]
type = "spline"
speed = 0.5
begin = 0.05
[[motion.points]]
xyz = [0.5, 0.3, 0.45]
rpy = [0.0, 0.0, 0.5]
[[motion.points]]
xyz = [0.45, 0.35, 0.45]
rpy = [0.0, 0.0, 0.9]
[[motion.points]]
xyz = [0.4, 0.4, 0.4]
rpy = [0.0, 0.0, 0.2]
"""


def run(text: str) -> SimulationResult:
    return run_scenario(robot_from_toml(scara()), scenario_from_toml(text, source="tool.toml"))


def yaw(pose: np.ndarray) -> np.ndarray:
    return np.arctan2(pose[:, 1, 0], pose[:, 0, 0])


@pytest.fixture(scope="module")
def turning() -> SimulationResult:
    return run(BEGIN + LINE + "orientation = { from = [0, 0, 0.5], to = [0, 0, -0.7] }\n")


def test_a_scara_turns_its_tool_along_a_line(turning: SimulationResult) -> None:
    r = np.clip(turning.trajectory.t / 0.4, 0.0, 1.0)
    s = 10 * r**3 - 15 * r**4 + 6 * r**5
    wanted = Slerp([0.0, 1.0], Rotation.from_euler("z", [[0.5], [-0.7]]))(s).as_matrix()
    assert np.abs(turning.program_pose[:, :3, :3] - wanted).max() < 1e-8
    assert np.abs(turning.pose[:, :3, :3] - wanted).max() < 1e-5
    assert np.abs(turning.tool_deviation).max() < 1e-5
    assert turning.tool_rotation.max() < 1e-5
    off = turning.series("tcp.rotation")
    assert off.unit == "rad"
    assert np.array_equal(off.values, turning.tool_rotation)
    angle = Rotation.from_matrix(np.swapaxes(turning.program_pose[:, :3, :3], 1, 2) @ turning.pose[:, :3, :3])
    assert np.abs(angle.magnitude() - off.values).max() < 1e-12
    assert turning.summary()["tool_rotation_end"] == off.values[-1]
    assert any("rad at the end" in line for line in turning.summary_lines())


def test_results_keep_it_and_figures_show_it(
    turning: SimulationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = load_result(turning.save(tmp_path / "trajectory.npz"))
    assert again.scenario["motion"]["values"]["orientation"] == {"from": [0.0, 0.0, 0.5], "to": [0.0, 0.0, -0.7]}
    assert np.array_equal(again.tool_rotation, turning.tool_rotation)
    assert "tcp.rotation" in again.names
    kept = list[Figure]()
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    plot_tool(turning, tmp_path / "tool.svg")
    panels = {panel.get_ylabel().split(",")[0]: panel for panel in kept[0].axes}
    shown = panels["rotation"].get_lines()[0].get_ydata()
    assert shown / shown.max() == pytest.approx(turning.tool_rotation / turning.tool_rotation.max())
    assert panels["rotation"].get_ylabel().endswith("rad")
    assert set(panels) >= {"deviation", "distance", "rotation"}


def test_an_orientation_is_kept_from_the_initial_pose() -> None:
    kept = run(BEGIN + LINE + "orientation = 'keep'\n[control]\ntype = 'pd'\nkp = 4000.0\nkd = 300.0\ngravity = true\n")
    assert np.ptp(yaw(kept.program_pose)) < 1e-8
    free = run(BEGIN + LINE)
    assert np.ptp(yaw(free.program_pose)) > 0.1


def test_a_spline_in_space() -> None:
    result = run(BEGIN + SPLINE)
    t = result.trajectory.t
    spans = np.array([np.hypot(0.05, 0.05), np.sqrt(0.05**2 * 3)]) / 0.5
    times = 0.05 + np.concatenate([[0.0], np.cumsum(spans)])
    wanted = np.array([[0.5, 0.3, 0.45, 0.5], [0.45, 0.35, 0.45, 0.9], [0.4, 0.4, 0.4, 0.2]])
    found = np.column_stack([result.program_pose[:, :3, 3], yaw(result.program_pose)])
    for at, point in zip(times, wanted, strict=True):
        near = np.array([np.interp(at, t, column) for column in found.T])
        assert near == pytest.approx(point, abs=2e-3)  # samples lie beside it
    assert result.tool_rotation.max() < 1e-5
    still = run(BEGIN + SPLINE.replace("speed = 0.5\nbegin = 0.05", "times = [0.0, 0.3, 0.5]"))
    assert still.program_pose[60, :3, 3] == pytest.approx(wanted[1, :3], abs=1e-9)
    assert yaw(still.program_pose)[60] == pytest.approx(0.9, abs=1e-9)


def test_the_example() -> None:
    scenario = load_scenario(Path(__file__).parents[2] / "examples" / "poses.toml")
    result = run_scenario("ur5", scenario)
    for pose, k in ((result.program_pose[0], 0), (result.program_pose[-1], -1)):
        assert pose[:3, 3] == pytest.approx(scenario.motion.get("points")[k], abs=1e-9)
        wanted = Rotation.from_euler("xyz", scenario.motion.get("rpy")[k]).as_matrix()
        assert np.abs(pose[:3, :3] - wanted).max() < 1e-9
    assert result.tool_rotation.max() < 1e-5


def test_what_a_scara_cannot_do(tmp_path: Path) -> None:
    with pytest.raises(ReachError, match=r"tool\.toml: motion: scara: .*0\.5 % of its length, t = .* mm and .* deg"):
        run(BEGIN + LINE + "orientation = { to = [0.5, 0.0, 0.0] }\n")
    with pytest.raises(ReachError, match=r"tcp does not reach .* rpy \(0\.5, 0, 0\) rad: .* 28\.65 deg") as caught:
        run(BEGIN + LINE + "orientation = { from = [0.5, 0.0, 0.0] }\n")
    assert caught.value.angle == pytest.approx(0.5, abs=1e-6)
    robot, tilt = tmp_path / "scara.toml", tmp_path / "tilt.toml"
    robot.write_text(scara())
    tilt.write_text(BEGIN + LINE + "orientation = { from = [0.5, 0.0, 0.0] }\n")
    assert "28.65 deg" in command("simulate", robot, "--scenario", tilt, "-o", tmp_path / "out", code=1)


@pytest.mark.soak
def test_a_platform_follows_a_turning_line() -> None:
    text = "duration = 0.3\n[motion]\ntype = 'line'\nfrom = [0, 0, 1.1]\nto = [0.06, 0.03, 1.05]\n"
    scenario = scenario_from_toml(text + "orientation = { to = [0.0, 0.1, 0.05] }\n")
    result = run_scenario(eomgen.load_robot("gough"), scenario)
    assert result.trajectory.info["gap"] <= 1e-11
    end = Rotation.from_euler("xyz", [0.0, 0.1, 0.05]).as_matrix()
    assert np.abs(result.pose[-1, :3, :3] - end).max() < 1e-6
    assert result.tool_rotation.max() < 1e-6


# Free and ball joints


Array = NDArray[np.float64]
QUATERNION = ("free.qw", "free.qx", "free.qy", "free.qz")
Q0, V0 = np.array([0.0, 0.0, 8.0, 0.1, 0.2, 0.1]), np.array([1.0, 0.0, 0.0, 0.0, 4.0, 0.0])
NAMES = [f"free.{name}" for name in ("x", "y", "z", *ANGULAR)]
FALL: dict[str, Any] = {
    "duration": 1.2,
    "output_step": 0.01,
    "initial": {key: dict(zip(NAMES, x.tolist(), strict=True)) for key, x in (("q", Q0), ("v", V0))},
    "integrator": {"rtol": 1e-9},
}
STREAM = "fall.zarr"


def rotations(quaternion: Array) -> Rotation:
    """Of (w, x, y, z)."""
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1))


def apart(one: Rotation, other: Rotation) -> float:
    return float(np.max((one * other.inv()).magnitude()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fall")


@pytest.fixture(scope="module")
def fall(folder: Path) -> SimulationResult:
    """A body that tumbles while it falls."""
    stream = folder / STREAM if installed("zarr") else None
    return run_scenario(free_body(), scenario_from_values(FALL), stream=stream)


def test_a_scenario_over_the_poles(fall: SimulationResult) -> None:
    motion = fall.trajectory
    turned, origins = falling_body(free_body(), Q0, V0, motion.t)
    assert np.abs(np.cos(motion.q[:, 4])).min() < 0.1
    assert np.abs(np.diff(motion.q[:, 3])).max() > 0.2  # what angles do beside a pole
    quaternion = np.stack([fall.series(name).values for name in QUATERNION], axis=-1)
    assert apart(rotations(quaternion), turned) < 1e-7
    assert np.abs(motion.q[:, :3] - origins).max() < 1e-7
    assert np.abs(np.diff(quaternion, axis=0)).max() < 0.04  # half of the spin times the output step
    assert quaternion[0, 0] > 0.0
    assert apart(Rotation.from_matrix(fall.pose[:, :3, :3]), turned) < 1e-7
    assert abs(fall.balance.relative_residue) < 1e-7


def test_quaternions_in_files_and_tables(fall: SimulationResult, folder: Path) -> None:
    quaternion = fall.trajectory.quaternion("free")
    path = fall.save(folder / "trajectory.npz")
    with np.load(path) as data:
        assert data["rotating"].tolist() == ["free"]
        assert np.array_equal(data["quaternions"][:, 0], quaternion)
        arrays = {name: data[name] for name in data.files}
    again = eomgen.load_result(path)
    assert again.trajectory.rotating == ("free",)
    for i, name in enumerate(QUATERNION):
        found = again.series(name)
        assert (found.unit, found.values.tolist()) == ("", quaternion[:, i].tolist())
        for table in (fall.as_rows(), fall.trajectory.as_rows()):
            (column,) = (column for column in table.columns if column.name == name)
            assert column.values.tolist() == quaternion[:, i].tolist()
    kept = {name: array for name, array in arrays.items() if name not in ("rotating", "quaternions")}
    np.savez(folder / "old.npz", **kept)  # as files were before
    assert np.array_equal(eomgen.load_result(folder / "old.npz").trajectory.quaternion("free"), quaternion)
    for name, array, message in (
        ("rotating", np.array(["body"]), "array rotating: got 'body'; allowed: 'free'"),
        ("quaternions", 2.0 * quaternion[:, None], r"array quaternions: got .* of magnitude up to 1$"),
        ("quaternions", quaternion, r"array quaternions: got the shape \(121, 4\)"),
    ):
        np.savez(folder / "bad.npz", **{**arrays, name: array})
        refused(InputError, message, eomgen.load_result, folder / "bad.npz")
    page = report_of(fall, modes=False)
    (row,) = next(table for table in page.tables if table.title.startswith("Rotations")).rows
    assert row == ("free", *(", ".join(f"{x:.6f}" for x in quaternion[i]) for i in (0, -1)))


def test_quaternions_of_a_stream(fall: SimulationResult, folder: Path) -> None:
    needs("zarr")
    found = eomgen.load_stream(folder / STREAM)
    for name in QUATERNION:
        ours = found.series(name)
        assert (ours.unit, ours.values.tolist()) == ("", fall.series(name).values.tolist())
    refused(InputError, r"'free\.q' is unknown; known: .* or without, free\.qw, .*free\.qz", found.series, "free.q")


@pytest.mark.parametrize("rates", [True, False])
def test_forces_of_a_motion_over_the_poles(rates: bool, fall: SimulationResult, folder: Path) -> None:
    """Nothing but its weight acts on the body, whether rates were measured or not."""
    motion = fall.trajectory
    columns = columns_of(NAMES, motion.t, motion.q, motion.v if rates else None)
    columns[NAMES[3]] = (columns[NAMES[3]] + np.pi) % (2.0 * np.pi) - np.pi  # as many tell it
    found = forces(free_body(), motion_from_columns(columns, tuple(NAMES)))
    inner = slice(6, -6)
    assert np.abs(found.drive[inner]).max() < (1e-4 if rates else 1e-3)
    assert np.abs(found.v - motion.v)[inner, :3].max() < 1e-4
    assert np.abs(np.cos(found.q) - np.cos(motion.q))[:, 3:].max() < 1e-4
    names = [column.name for column in found.as_rows().columns]
    assert names[-4:] == list(QUATERNION)
    assert "which have no poles" in found.notes[1]


def test_robots_without_such_joints_have_none(tmp_path: Path) -> None:
    result = simulate("one_link", duration=0.05)
    assert (result.trajectory.rotating, result.trajectory.quaternions) == ((), None)
    assert not [name for name in result.names if ".q" in name]
    with np.load(result.save(tmp_path / "r.npz")) as data:
        assert "quaternions" not in data.files
    vary = '[[vary]]\nparameter = "links.link1.mass"\ngrid = { values = [1.0] }\n'
    plan = plan_from_toml(f'record = ["quaternion_end"]\n{vary}')
    with pytest.raises(DescriptionError, match=r"quaternion_end: no joint has alpha, beta and gamma; allowed: with a"):
        run_sweep("one_link", {"duration": 0.1}, plan, tmp_path / "sweep")


def test_sweeps_over_the_poles(tmp_path: Path) -> None:
    """Moments of inertia that vary: each sample ends where the body of that inertia does."""
    values = (0.095, 0.1, 0.11)
    plan = plan_from_toml(
        'record = ["quaternion_end", "coordinate_end"]\n[engine]\ntype = "rollout"\n'
        f'[[vary]]\nparameter = "links.body.inertia.xx"\ngrid = {{ values = {list(values)} }}\n'
    )
    found = run_sweep(free_body(), FALL, plan, tmp_path / "sweep", threads=1)
    assert not found.errors
    ends = np.stack([found.of(f"quaternion_end.{name}") for name in QUATERNION], axis=-1)
    assert np.abs(np.diff(ends, axis=0)).max() < 0.2  # of one sign
    (link,) = free_body().links
    for value, end in zip(values, ends, strict=True):
        other = replace(free_body(), links=(replace(link, inertia=(value, *link.inertia[1:])),))
        turned, _ = falling_body(other, Q0, V0, np.array([0.0, FALL["duration"]]))
        assert apart(rotations(end), turned[-1]) < 1e-7


def swinging(turn: Array) -> Robot:
    """A driven arm from which a body hangs in a ball joint, whose axes are turned, (3, 3)."""
    com, tensor = np.array([0.3, 0.0, 0.0]), np.diag([0.01, 0.02, 0.025])
    inertia = turn.T @ tensor @ turn
    entries = tuple(inertia[i] for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    at = Placement((0.4, 0.0, 0.0), tuple(map(tuple, turn.tolist())))
    hinge = Joint("hinge", "base", "arm", "revolute", coordinates={"gamma": Coordinate()})
    ball = Joint("ball", "arm", "bob", "fixed", at, coordinates=dict.fromkeys(ANGULAR, Coordinate()))
    arm = Link("arm", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02, 0.0, 0.0, 0.0))
    bob = Link("bob", 0.5, tuple((turn.T @ com).tolist()), entries)
    tip = Frame("tcp", "bob", Placement(tuple((turn.T @ com).tolist())))
    return Robot("swinging", (0.0, 0.0, -9.81), (arm, bob), (hinge, ball), frames=(tip,))


@pytest.mark.soak
def test_a_programmed_motion_with_a_ball_over_the_pole() -> None:
    """Nothing holds the ball: the same motion as in axes whose angles stay far from their poles."""
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    plain, other = (simulate(swinging(x), goal=[0.1], duration=1.0, rtol=1e-9) for x in (np.eye(3), turn))
    betas = [np.abs(np.cos(found.trajectory.of("ball.beta"))).min() for found in (plain, other)]
    assert betas[0] < 0.1
    assert betas[1] > 0.5
    np.testing.assert_allclose(plain.pose[:, :3, 3], other.pose[:, :3, 3], atol=1e-6)
    np.testing.assert_allclose(plain.pose[:, :3, :3], other.pose[:, :3, :3] @ turn.T, atol=1e-5)
    np.testing.assert_allclose(plain.trajectory.u[:, 0], other.trajectory.u[:, 0], atol=1e-4)
    assert np.abs(np.diff(plain.trajectory.quaternion("ball"), axis=0)).max() < 0.1
    assert abs(plain.balance.relative_residue) < 1e-5
