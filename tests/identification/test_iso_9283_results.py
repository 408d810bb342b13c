"""Figures of ISO 9283 of what was simulated; results as files, tables, words and plots."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.cli import entry as cli
from eomgen.errors import InputError
from eomgen.identification import AccuracyResult, accuracy, load_accuracy
from eomgen.identification.iso_9283.attained import Path as Way
from eomgen.identification.iso_9283.attained import Pose, Record
from eomgen.identification.iso_9283.formulas import scatter
from eomgen.identification.iso_9283.solve import figures_of
from eomgen.motion.turns import rotation_of
from eomgen.pictures import plot_accuracy
from eomgen.scenario.load import scenario_from_values
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.driver import prepare
from eomgen.sweep.plan import plan_from_toml
from tests.support.pose_files import CROSS, GOOD, MM, OFFSET, at, line, measured, write

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]


# Simulations

SCENARIO = {
    "duration": 0.3,
    "output_step": 1e-3,
    "motion": {"type": "point_to_point", "start": [-1.2], "goal": [-0.9], "duration": 0.2},
    "control": {"type": "computed_torque", "bandwidth": 60.0},
}


@pytest.fixture(scope="module")
def simulated(unoptimised: None) -> SimulationResult:
    return eomgen.run_scenario("one_link", scenario_from_values(SCENARIO, source="scenario"))


def shifted(result: SimulationResult, by: Sequence[float]) -> SimulationResult:
    pose = result.pose.copy()
    pose[:, :3, 3] += by
    return replace(result, pose=pose)


def test_a_simulation_repeats_itself_and_says_so(simulated: SimulationResult, tmp_path: Path) -> None:
    saved = [simulated.save(tmp_path / name / "trajectory.npz") for name in ("a", "b")]
    for results in ([simulated], [simulated, simulated], [path.parent for path in saved], saved):
        found = accuracy(*results, band=1e-5)
        (pose,), (path,) = found.poses, found.paths
        assert found.exact
        assert (found.robot, found.frame, found.source) == ("one_link", "tcp", "simulated")
        assert any("repeats itself exactly: RP and RT are 0" in note for note in found.notes)
        assert (pose.repeatability, path.repeatability) == (0.0, 0.0)
        assert pose.cycles == len(results)
        np.testing.assert_allclose(pose.offset, simulated.tool_deviation[-1], atol=1e-15)
        assert 0.0 < path.accuracy <= np.linalg.norm(simulated.tool_deviation, axis=1).max()
        assert found.stops[0].band == 1e-5
        assert any("pose 1: the tool still moves at" in note for note in found.notes)  # nothing damps the spring
        assert found.load == "the robot as described, no payload"
    assert accuracy(simulated).stops == ()
    assert any("give a band" in note for note in accuracy(simulated).notes)


def test_cycles_of_simulations_scatter(simulated: SimulationResult) -> None:
    found = accuracy(*(shifted(simulated, MM * (row + OFFSET)) for row in CROSS))
    np.testing.assert_allclose(found.poses[0].repeatability, MM * (3.5 + 3.0 * np.sqrt(1.0 / 3.0)), rtol=1e-9)
    np.testing.assert_allclose(found.poses[0].offset, simulated.tool_deviation[-1] + MM * OFFSET, rtol=1e-9)
    assert not found.exact


def test_rests_of_a_program_are_its_poses(simulated: SimulationResult) -> None:
    """There and, after a rest, back: two poses, two paths, and the distance between."""
    t = np.concatenate([simulated.trajectory.t, simulated.trajectory.t[-1] + 1e-3 + simulated.trajectory.t])
    back = np.concatenate([simulated.program_pose, simulated.program_pose[::-1]])
    pose = back.copy()
    pose[200:, 0, 3] += MM
    result = replace(simulated, trajectory=replace(simulated.trajectory, t=t), program_pose=back, pose=pose)
    found = accuracy(result)
    assert [(item.name, item.cycles) for item in found.poses] == [("1", 1), ("2", 1)]
    np.testing.assert_allclose(found.poses[1].command, simulated.program_pose[0, :3, 3], atol=1e-6)
    np.testing.assert_allclose([item.accuracy for item in found.poses], MM)
    assert len(found.paths) == 2
    assert found.distances[0].poses == ("1", "2")


def test_results_that_are_no_cycles_of_one_program(simulated: SimulationResult, tmp_path: Path) -> None:
    motion = simulated.trajectory
    other = simulated.program_pose.copy()
    other[150, 0, 3] += MM
    cases = {
        r"results\[1\]: commands another pose than results\[0\]: by 0.001 m and 0 rad at 0.15 s": replace(
            simulated, program_pose=other
        ),
        r"results\[1\]: has 301 samples to 0.6 s": replace(simulated, trajectory=replace(motion, t=2.0 * motion.t)),
        r"results\[1\]: looks at 'link1', and results\[0\] at 'tcp'": replace(simulated, tool="link1"),
        r"results\[1\]: nothing is programmed": replace(simulated, programmed=False),
        r"results\[1\]: the motion stopped too early": replace(simulated, stopped={"reason": "singular"}),
    }
    for message, result in cases.items():
        with pytest.raises(InputError, match=message):
            accuracy(simulated, result)
    with pytest.raises(InputError, match=r"frame: 'hand' is not the one that results.0. looks at; allowed: 'tcp'"):
        accuracy(simulated, frame="hand")
    with pytest.raises(InputError, match=r"good.csv is measured, and results.0. simulated; allowed: all of one kind"):
        accuracy(simulated, write(tmp_path / "good.csv", GOOD))
    with pytest.raises(InputError, match="command: simulations know their commands"):
        accuracy(simulated, command=tmp_path / "good.csv")


PLAN = """
samples = 6
seed = 4
[[vary]]
parameter = "joints.joint1.x.stiffness"
uniform = { low = 8e3, high = 1.2e4 }
"""


@pytest.mark.soak
def test_samples_of_a_plan_are_cycles() -> None:
    """Each attains what the same robot with these numbers does by itself; the command is the nominal robot's."""
    found = accuracy(robot="one_link", scenario=SCENARIO, plan=plan_from_toml(PLAN))
    _, design, _ = prepare("one_link", SCENARIO, plan_from_toml(PLAN))
    robot, scenario = eomgen.load_robot("one_link"), scenario_from_values(SCENARIO, source="scenario")
    ends = []
    for i in range(6):
        (stiffness,) = design.values(i)
        (joint,) = robot.joints
        x = replace(joint.coordinates["x"], stiffness=stiffness)
        joint = replace(joint, coordinates={**joint.coordinates, "x": x})
        ends.append(eomgen.run_scenario(replace(robot, joints=(joint,)), scenario).pose[-1, :3, 3])
    wanted = scatter(np.array(ends))
    np.testing.assert_allclose(found.poses[0].barycentre, wanted.barycentre, atol=1e-9)
    np.testing.assert_allclose(found.poses[0].repeatability, wanted.repeatability, rtol=1e-3)
    assert wanted.repeatability > 1e-5
    assert found.source == "samples of a plan"
    assert not found.exact
    assert any("varies joints.joint1.x.stiffness" in note for note in found.notes)
    single = plan_from_toml(PLAN.replace("samples = 6", "samples = 1"))
    with pytest.raises(InputError, match="plan: has 1 samples; allowed: 2 to"):
        accuracy(robot="one_link", scenario=SCENARIO, plan=single)


# Results as files, tables and words


def result_of(folder: Path) -> AccuracyResult:
    """A result with all kinds of figures."""
    t = np.linspace(0.0, 1.0, 21)
    rng = np.random.default_rng(5)
    rotations = np.tile(np.eye(3), (21, 1, 1))
    command = Record(t, line(21), rotations)
    noise = rng.normal(size=(3, 21, 3))
    cycles = tuple(Record(t, line(21) + MM * one, rotation_of(MM * one)) for one in noise)
    poses = [Pose(name, command.position[i], np.eye(3), cycles, (1, 2, 3)) for name, i in (("1", 0), ("2", -1))]
    return figures_of(measured(poses, [Way("1", command, cycles)]), load="5 kg", rate="0.25 m/s")


def test_a_result_is_saved_and_loaded(tmp_path: Path) -> None:
    found = result_of(tmp_path)
    assert found.stops
    assert found.paths[0].speed is not None
    path = found.save(tmp_path / "new" / "figures.json")
    assert load_accuracy(path) == found
    with pytest.raises(InputError, match=r"figures.npz'; allowed: a path that ends in .json"):
        found.save(tmp_path / "figures.npz")
    values = json.loads(path.read_text(encoding="ascii"))
    for change, message in (
        ({"standard": "ISO 1"}, "holds no figures of ISO 9283:1998"),
        ({"poses": [{"name": "1"}]}, r"poses\[0\]: the key 'cycles' is missing"),
        ({"load": 5}, "load: got 5; allowed: a value of type str"),
    ):
        path.write_text(json.dumps(values | change), encoding="ascii")
        with pytest.raises(InputError, match=message):
            load_accuracy(path)


def test_a_result_as_a_table_and_in_words(tmp_path: Path) -> None:
    found = result_of(tmp_path)
    rows = found.as_rows()
    of, value, unit = (column.values.tolist() for column in rows.columns)
    table = {(symbol, what): (x, u) for symbol, what, x, u in zip(rows.values.tolist(), of, value, unit, strict=True)}
    assert len(table) == len(value)
    assert table["AP_p", "pose 2"] == (found.poses[1].accuracy, "m")
    assert found.paths[0].turning is not None
    assert table["RT_c", "path 1"] == (found.paths[0].turning[2], "rad")
    assert table["AD_p", "poses 1 and 2"] == (found.distances[0].accuracy, "m")
    assert found.summary()["RP"] == max(pose.repeatability for pose in found.poses)
    text = "\n".join(found.lines())
    for word in (
        "5 kg",
        "0.25 m/s",
        "AP mm",
        "RT mm",
        "AD mm",
        "stabilization s",
        "AV %",
        f"{1e3 * found.poses[0].accuracy:.4g}",
    ):
        assert word in text
    assert text.isascii()


def test_the_command_prints_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    columns = {"pose": [1] * 4 + [2] * 4, **at(np.vstack([MM * CROSS, MM * CROSS + [1.0, 0.0, 0.0]]))}
    file = write(tmp_path / "m.csv", columns)
    commands = write(tmp_path / "c.csv", {"pose": [1, 2], **at(np.array([[0.0] * 3, [1.0, 0.0, 0.0]]))})
    words = ["accuracy", str(file), "--commands", str(commands), "--test-load", "none", "--distance", "1", "2"]
    assert cli.main([*words, "-o", str(tmp_path / "f.json")]) == 0
    out = capsys.readouterr().out
    assert "tool: accuracy by the definitions of ISO 9283:1998, measured" in out
    assert "5.232" in out
    assert cli.main([*words, "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["standard"] == "ISO 9283:1998"
    assert values["summary"]["RP"] == load_accuracy(tmp_path / "f.json").poses[1].repeatability
    assert cli.main(["accuracy", str(tmp_path / "nothing.csv")]) == 1
    assert "nothing.csv: cannot be read" in capsys.readouterr().err
    assert cli.main(["accuracy"]) == 1


def test_the_figure_shows_poses_and_paths(tmp_path: Path, simulated: SimulationResult) -> None:
    pytest.importorskip("matplotlib")
    found = result_of(tmp_path)
    poses, paths = replace(found, paths=()), replace(found, poses=())
    for name, one, words in (
        ("all", found, ("pose 2", "path 1", "x less command", "length along the path")),
        ("poses", poses, ("pose 1", "z less command")),
        ("paths", paths, ("mean + 3 S",)),
        ("exact", accuracy(simulated), ("one_link", "simulated")),
    ):
        text = plot_accuracy(one, tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        assert all(word in text for word in words), name
    with pytest.raises(InputError, match=r"allowed: a path that ends in"):
        plot_accuracy(found, tmp_path / "figure.txt")
    file = write(tmp_path / "m.csv", GOOD)
    assert cli.main(["accuracy", str(file), "--plot", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
