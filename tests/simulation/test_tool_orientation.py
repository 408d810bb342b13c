"""Scenarios whose tool has an orientation: programs, drives, results, figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation, Slerp

import eomgen
from eomgen import cli
from eomgen.description.load import robot_from_toml
from eomgen.errors import ReachError
from eomgen.pictures.simulation import plot_tool
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.simulation.result import SimulationResult, load_result
from eomgen.simulation.run import run_scenario
from tests.support.scaras import scara

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
    found: np.ndarray = np.arctan2(pose[:, 1, 0], pose[:, 0, 0])
    return found


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
    assert scenario.motion is not None
    for pose, k in ((result.program_pose[0], 0), (result.program_pose[-1], -1)):
        assert pose[:3, 3] == pytest.approx(scenario.motion.get("points")[k], abs=1e-9)
        wanted = Rotation.from_euler("xyz", scenario.motion.get("rpy")[k]).as_matrix()
        assert np.abs(pose[:3, :3] - wanted).max() < 1e-9
    assert result.tool_rotation.max() < 1e-5


def test_what_a_scara_cannot_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ReachError, match=r"tool\.toml: motion: scara: .*0\.5 % of its length, t = .* mm and .* deg"):
        run(BEGIN + LINE + "orientation = { to = [0.5, 0.0, 0.0] }\n")
    with pytest.raises(ReachError, match=r"tcp does not reach .* rpy \(0\.5, 0, 0\) rad: .* 28\.65 deg") as caught:
        run(BEGIN + LINE + "orientation = { from = [0.5, 0.0, 0.0] }\n")
    assert caught.value.angle == pytest.approx(0.5, abs=1e-6)
    (tmp_path / "scara.toml").write_text(scara())
    (tmp_path / "tilt.toml").write_text(BEGIN + LINE + "orientation = { from = [0.5, 0.0, 0.0] }\n")
    arguments = ["simulate", f"{tmp_path}/scara.toml", "--scenario", f"{tmp_path}/tilt.toml", "-o", f"{tmp_path}/out"]
    assert cli.main(arguments) == 1
    assert "28.65 deg" in capsys.readouterr().err


@pytest.mark.soak
def test_a_platform_follows_a_turning_line() -> None:
    text = "duration = 0.3\n[motion]\ntype = 'line'\nfrom = [0, 0, 1.1]\nto = [0.06, 0.03, 1.05]\n"
    result = run_scenario(
        eomgen.load_robot("gough"), scenario_from_toml(text + "orientation = { to = [0.0, 0.1, 0.05] }\n")
    )
    assert result.trajectory.info["gap"] <= 1e-11
    end = Rotation.from_euler("xyz", [0.0, 0.1, 0.05]).as_matrix()
    assert np.abs(result.pose[-1, :3, :3] - end).max() < 1e-6
    assert result.tool_rotation.max() < 1e-6
