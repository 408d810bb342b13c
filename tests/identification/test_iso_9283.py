"""Figures of ISO 9283 against numbers by hand and expectations of normal scatter; simulations, files, tables, plots."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import InputError
from eomgen.identification import AccuracyResult, accuracy, load_accuracy
from eomgen.identification.geometry.rotations import vectors_of
from eomgen.identification.iso_9283.attained import Path as Way
from eomgen.identification.iso_9283.attained import Pose, Record
from eomgen.identification.iso_9283.corners import corners_of
from eomgen.identification.iso_9283.formulas import corner_overshoot, distance_to_path, scatter, stabilization
from eomgen.identification.iso_9283.solve import figures_of
from eomgen.kernel.inverse_kinematics.rotations import vector_of
from eomgen.motion.turns import rotation_of
from eomgen.pictures import plot_accuracy
from eomgen.scenario.load import scenario_from_values
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.driver import prepare
from eomgen.sweep.plan import plan_from_toml
from tests.support.commands import command, facts
from tests.support.pose_files import CROSS, GOOD, MM, OFFSET, at, line, measured, turned, write
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]
QUATERNION = [f"tool.{key}" for key in ("qw", "qx", "qy", "qz")]
AWAY = np.array([10.0, 4.0, 0.0, 4.0, -4.0 / 3.0, 0.0])  # of a stop, each second


# Poses


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_pose_by_hand(suffix: str, tmp_path: Path) -> None:
    angles = np.array([[0.0, 0.0, 0.01], [0.0, 0.0, 0.03], [0.0, 0.0, 0.02], [0.0, 0.0, 0.02]])
    command = np.tile([0.5, 0.1, 0.9], (4, 1))
    columns = {"pose": [7] * 4, **at(command + MM * (CROSS + OFFSET)), **turned(angles)}
    columns |= {**at(command, "tool.command"), **turned(np.zeros((4, 3)), "tool.command")}
    (pose,) = accuracy(write(tmp_path / f"m{suffix}", columns)).poses
    assert (pose.name, pose.cycles) == ("7", 4)
    np.testing.assert_allclose(pose.offset, MM * OFFSET, atol=1e-15)
    np.testing.assert_allclose([pose.accuracy, pose.mean], [3.0 * MM, 3.5 * MM])
    np.testing.assert_allclose(pose.repeatability, MM * (3.5 + 3.0 * np.sqrt(1.0 / 3.0)))
    np.testing.assert_allclose(pose.turned, [0.0, 0.0, 0.02], atol=1e-15)
    np.testing.assert_allclose(pose.turning, [0.0, 0.0, 3.0 * np.sqrt(2e-4 / 3.0)], atol=1e-15)


def test_orientations_are_those_about_the_axes_of_the_base(tmp_path: Path) -> None:
    """Whatever the command is, also half a turn; and whatever way orientations are written."""
    command, small = np.array([0.0, np.pi, 0.0]), np.array([[1e-3, 2e-3, 3e-3], [1e-3, 2e-3, 5e-3]])
    attained = rotation_of(small) @ rotation_of(command)
    vectors = np.array([vector_of(one) for one in attained])
    head = {"pose": [1, 1], **at(np.zeros((2, 3))), **at(np.zeros((2, 3)), "tool.command")}
    commands = np.tile(command, (2, 1))
    rotvector = {**head, **turned(vectors), **turned(commands, "tool.command")}

    size = np.linalg.norm(vectors, axis=1)[:, np.newaxis]
    parts = np.hstack([np.cos(size / 2.0), np.sin(size / 2.0) * vectors / size])
    quaternion = {**head, **dict(zip(QUATERNION, -parts.T, strict=True))}
    quaternion |= {f"tool.command.{key}": np.full(2, float(key == "qy")) for key in ("qw", "qx", "qy", "qz")}

    roll = np.arctan2(attained[:, 2, 1], attained[:, 2, 2])
    pitch = np.arctan2(-attained[:, 2, 0], np.hypot(attained[:, 0, 0], attained[:, 1, 0]))
    yaw = np.arctan2(attained[:, 1, 0], attained[:, 0, 0])
    rpy = {**head, **turned(np.stack([roll, pitch, yaw], axis=1)), **turned(commands, "tool.command")}

    for kind, columns in {"rotvector": rotvector, "quaternion": quaternion, "rpy": rpy}.items():
        (pose,) = accuracy(write(tmp_path / "m.npz", columns), rotation=kind).poses
        np.testing.assert_allclose(pose.turned, [1e-3, 2e-3, 4e-3], atol=1e-12, err_msg=kind)
        np.testing.assert_allclose(pose.turning, [0.0, 0.0, 3.0 * np.sqrt(2e-6)], atol=1e-12, err_msg=kind)


def test_many_rotations_have_the_vectors_of_each() -> None:
    rng = np.random.default_rng(3)
    angles = np.concatenate([[0.0, 1e-9, 1e-5, np.pi - 1e-9, np.pi], rng.uniform(0.0, np.pi, 40)])
    axes = rng.normal(size=(45, 3))
    rotations = rotation_of(angles[:, np.newaxis] * axes / np.linalg.norm(axes, axis=1)[:, np.newaxis])
    np.testing.assert_allclose(vectors_of(rotations), [vector_of(one) for one in rotations], atol=1e-14)


def test_normal_scatter_has_the_expected_figures() -> None:
    """Distances of isotropic normal scatter are Maxwell's; the barycentre takes one of n degrees of freedom."""
    sigma, n, tests = 0.02 * MM, 30, 4000
    found = [scatter(sample) for sample in sigma * np.random.default_rng(1).normal(size=(tests, n, 3))]
    share = np.sqrt((n - 1.0) / n)
    mean = np.mean([one.mean for one in found])
    variance = np.mean([one.deviation**2 for one in found])
    np.testing.assert_allclose(mean, share * 2.0 * sigma * np.sqrt(2.0 / np.pi), rtol=0.003)
    np.testing.assert_allclose(variance, share**2 * sigma**2 * (3.0 - 8.0 / np.pi), rtol=0.01)
    wanted = sigma * (2.0 * np.sqrt(2.0 / np.pi) + 3.0 * np.sqrt(3.0 - 8.0 / np.pi))
    assert np.mean([one.repeatability for one in found]) == pytest.approx(wanted, rel=0.03)


def test_distances_by_hand(tmp_path: Path) -> None:
    """Cycles belong together by their number: the second pose has them in another order, and one more."""
    one, other = np.zeros((3, 3)), np.array([[0.303, 0.4, 0.0], [0.3, 0.4, 0.0], [0.297, 0.4, 0.0], [9.0, 9.0, 9.0]])
    one[0, 0] = 0.003
    columns = {"pose": [2] * 3 + [4] * 4, "cycle": [1, 2, 3, 1, 2, 3, 4], **at(np.vstack([one, other]))}
    goals = np.array([[0.0] * 3] * 3 + [[0.3, 0.4, 0.0]] * 4)
    found = accuracy(write(tmp_path / "m.csv", columns | at(goals, "tool.command")))
    (distance,) = found.distances
    lengths = np.array([0.5, 0.5, np.hypot(0.297, 0.4)])
    assert (distance.poses, distance.cycles, distance.command) == (("2", "4"), 3, 0.5)
    np.testing.assert_allclose(distance.accuracy, lengths.mean() - 0.5)
    np.testing.assert_allclose(distance.repeatability, 3.0 * lengths.std(ddof=1))
    np.testing.assert_allclose(distance.by_axis, [-0.001, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(distance.by_axis_repeatability, [3.0 * MM * np.sqrt(3.0), 0.0, 0.0], atol=1e-15)
    assert distance.turned is None
    refused(InputError, r"no pose '3'.*known: '2', '4'", accuracy, tmp_path / "m.csv", distances=[("2", "3")])


def test_stops_by_hand() -> None:
    """Straight lines between samples: the band of 2 is crossed at 1.5, left, and come back to at 3.75."""
    t, position = np.arange(6.0), AWAY[:, np.newaxis] * [1.0, 0.0, 0.0]
    assert stabilization(t, position, np.zeros(3), 2.0) == pytest.approx((3.75 - 1.5, 4.0))
    assert stabilization(t, position, np.zeros(3), 5.0) == (0.0, 0.0)  # once inside, it stays
    assert stabilization(t, position, np.zeros(3), 20.0) == (0.0, 0.0)


def test_stops_of_measured_approaches(tmp_path: Path) -> None:
    """With t the last row of a cycle is what was attained; by default the band is the repeatability."""
    t = np.arange(6.0)
    cycles = np.vstack([AWAY[:, np.newaxis] * [1.0, 0.0, 0.0] + end for end in ([0.0, 0.0, 2.0], [0.0, 0.0, -2.0])])
    columns = {"pose": [1] * 12, "cycle": [1] * 6 + [2] * 6, "t": [*t, *t], **at(cycles)}
    file = write(tmp_path / "m.csv", columns | at(np.zeros((12, 3)), "tool.command"))
    found = accuracy(file)
    assert found.poses[0].repeatability == 2.0
    (stop,) = found.stops
    assert (stop.band, stop.cycles, stop.time, stop.overshoot) == (2.0, 2, pytest.approx(2.25), 4.0)
    assert accuracy(file, band=5.0).stops[0].time == 0.0


# Paths


def test_a_path_by_hand() -> None:
    """Two cycles 2 mm off each other, whose middle leaves the line by up to 3 mm."""
    command = Record(None, line(), None)
    bump = np.array([0, 0, 0, 1, 2, 3, 2, 1, 0, 0, 0.0])[:, np.newaxis] * MM * [0.0, 1.0, 0.0]
    cycles = tuple(Record(None, line() + bump + [0.0, 0.0, MM * side], None) for side in (1.0, -1.0))
    for match in ("plane", "sample"):
        (path,) = figures_of(measured(paths=[Way("1", command, cycles)]), match=match).paths
        assert (path.points, path.left_out, path.length) == (11, 0, 1.0)
        np.testing.assert_allclose([path.accuracy, path.accuracy_at], [3.0 * MM, 0.5])
        np.testing.assert_allclose(path.repeatability, MM)
        np.testing.assert_allclose(path.offsets, bump[:, 1], atol=1e-15)
        assert path.speed is None


def test_a_lag_along_the_path_is_none_across_it() -> None:
    """The standard's planes let a late tool be as accurate as one in time; samples do not."""
    t = np.linspace(0.0, 1.0, 201)
    command = Record(t, np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=1), rotation_of(np.outer(t, [0.0, 0.0, 1.0])))
    late = [t - 0.05, t - 0.07]
    cycles = tuple(
        Record(t, 1.001 * np.stack([np.cos(s), np.sin(s), 0.0 * s], axis=1), rotation_of(np.outer(s, [0.0, 0.0, 1.0])))
        for s in late
    )
    way = [Way("1", command, cycles)]
    (across,), (along,) = (figures_of(measured(paths=way), match=match).paths for match in ("plane", "sample"))
    assert across.accuracy == pytest.approx(MM, rel=0.01)
    assert across.repeatability < 2e-6
    assert across.left_out in (14, 15)  # the last ones, which the later cycle does not come to
    assert max(across.turned) < 1e-5
    assert along.accuracy == pytest.approx(0.06, rel=0.01)
    assert along.repeatability == pytest.approx(0.01, rel=0.01)
    assert along.turned == pytest.approx((0.0, 0.0, 0.06))
    assert along.left_out == 0


def test_normal_scatter_about_a_path_is_that_across_it() -> None:
    """Two of three directions count: distances are Rayleigh's, whatever the scatter along the path."""
    sigma, n = 0.02 * MM, 30
    noise = sigma * np.random.default_rng(6).normal(size=(n, 2001, 3)) * [5.0, 1.0, 1.0]
    cycles = tuple(Record(None, 10.0 * line(2001) + one, None) for one in noise)
    (path,) = figures_of(measured(paths=[Way("1", Record(None, 10.0 * line(2001), None), cycles)])).paths
    share = np.sqrt((n - 1.0) / n)
    wanted = share * sigma * (np.sqrt(np.pi / 2.0) + 3.0 * np.sqrt(2.0 - np.pi / 2.0))
    assert np.mean(path.scatters) == pytest.approx(wanted, rel=0.03)
    squares = np.mean(np.square(path.offsets))
    assert squares == pytest.approx(2.0 * sigma**2 / n, rel=0.1)


def test_velocities_by_hand() -> None:
    """Commanded 1 m/s in the middle; cycles are 2 % too fast and 2 % too slow, the second one swings by 0.1 m/s."""
    t = np.linspace(0.0, 3.0, 301)
    profile = np.clip(np.minimum(t, 3.0 - t) / 0.5, 0.0, 1.0)
    swing = 0.05 * np.sin(2.0 * np.pi * (t - 0.5))

    def record(speed: Array) -> Record:
        x = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
        return Record(t, x[:, np.newaxis] * [1.0, 0.0, 0.0], None)

    cycles = (record(1.02 * profile), record(0.98 * profile + swing * (profile == 1.0)))
    (path,) = figures_of(measured(paths=[Way("1", record(profile), cycles)])).paths
    assert path.speed.command == pytest.approx(1.0, abs=1e-3)
    assert path.speed.accuracy == pytest.approx(0.0, abs=1e-3)
    assert path.speed.repeatability == pytest.approx(3.0 * 0.04 / np.sqrt(2.0), rel=0.02)
    assert path.speed.fluctuation == pytest.approx(0.1, rel=0.02)


def test_measured_paths_and_their_commands_in_another_file(tmp_path: Path) -> None:
    """Cycles have other samples than the command and than each other; each file is a cycle."""
    rng = np.random.default_rng(2)
    commands = write(tmp_path / "commands.csv", {"path": [3] * 51, **at(line(51))})
    files = []
    for i, size in enumerate((80, 97, 120)):
        s = np.sort(np.concatenate([[-0.02, 1.02], rng.uniform(-0.02, 1.02, size - 2)]))
        points = np.stack([s, 0.0 * s + MM * (i - 1), 2.0 * MM * s], axis=1)
        files.append(write(tmp_path / f"cycle{i}.npz", {"path": [3] * size, **at(points)}))
    (path,) = accuracy(*files, command=commands).paths
    assert (path.name, path.cycles, path.points, path.left_out) == ("3", 3, 51, 0)
    np.testing.assert_allclose([path.accuracy, path.accuracy_at], [2.0 * MM, 1.0])
    np.testing.assert_allclose(path.repeatability, MM * (2.0 / 3.0 + 3.0 * np.sqrt(1.0 / 3.0)))
    refused(InputError, "cycle 1 has 80 samples and its command 51", accuracy, *files, command=commands, match="sample")


# What the standard asks for


def test_fewer_cycles_than_the_standard_asks_for_are_said(tmp_path: Path) -> None:
    def notes(cycles: int, poses: int) -> str:
        numbers = np.repeat(np.arange(poses), cycles)
        zeros = np.zeros((len(numbers), 3))
        off = 1e-6 * np.arange(len(numbers))[:, np.newaxis] + zeros
        columns = {"pose": numbers, **at(off), **at(zeros, "tool.command")}
        return " ".join(accuracy(write(tmp_path / "m.csv", columns)).notes)

    assert "asks for 30 cycles at 5 poses (here 29 at 5)" in notes(29, 5)
    assert "(here 30 at 4): the figures follow its formulas and are not those of it" in notes(30, 4)
    assert "asks for" not in notes(30, 5)


def test_cycles_of_further_files_are_further_cycles(tmp_path: Path) -> None:
    command = at(np.zeros((2, 3)), "tool.command")
    goals = np.array([[0.0] * 3, [1.0, 0.0, 0.0], [0.0] * 3])
    rows = (MM * CROSS[[i, i]] + goals[:2] for i in range(4))
    files = [write(tmp_path / f"{i}.csv", {"pose": [1, 2], **at(x), **command}) for i, x in enumerate(rows)]
    wanted = write(tmp_path / "commands.csv", {"pose": [1, 2, 9], **at(goals)})
    refused(InputError, "has commands, and so has", accuracy, *files, command=wanted)
    for file in files:
        lines = file.read_text(encoding="ascii").splitlines()
        file.write_text("\n".join(",".join(row.split(",")[:4]) for row in lines), encoding="ascii")
    found = accuracy(*files, command=wanted)
    assert [(pose.name, pose.cycles) for pose in found.poses] == [("1", 4), ("2", 4)]
    np.testing.assert_allclose([pose.mean for pose in found.poses], 3.5 * MM)
    assert found.distances[0].repeatability < 1e-15
    assert "pose 9 is commanded and was never measured" in found.notes
    assert any("no orientation was measured (tool.rx, tool.ry, tool.rz)" in note for note in found.notes)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({"pose": None}, {}, "no column pose or path; allowed: pose or path"),
        ({"path": [1, 1]}, {}, "both columns, pose and path"),
        ({"pose": [1, 2]}, {}, "pose 1: has one cycle, which says nothing of repeatability; allowed: 2 or more"),
        ({"pose": [1, 1.5]}, {}, "line 3: column pose: 1.5; allowed: whole numbers"),
        ({"cycle": [1, 1]}, {}, "line 3: pose 1, cycle 1: 2 rows; allowed: one, or a column t"),
        ({"t": [0, 1]}, {}, "has t and no column cycle"),
        ({"t": [1, 1], "cycle": [1, 1]}, {}, "line 3: pose 1, cycle 1: t is 1 after 1; allowed: increasing times"),
        ({"tool.z": None}, {}, "no columns F.x, F.y and F.z of any frame F"),
        (at(np.zeros((2, 3)), "other"), {}, "has those of 'tool', 'other'; allowed: of one frame"),
        ({}, {"frame": "tol"}, "the frame 'tol' has no columns x, y and z; did you mean 'tool'"),
        ({"tool.rx": [0, 0], "tool.rz": [0, 0]}, {}, "has 'tool.rx', 'tool.rz' and not 'tool.ry'; allowed: all of"),
        (turned(np.zeros((2, 3))), {"rotation": "quaternion"}, "has .*'tool.rx'.* and not 'tool.qw'"),
        (dict.fromkeys(QUATERNION, (1, 1)), {"rotation": "quaternion"}, "line 2: a quaternion of length 2; allowed: 1"),
        ({}, {"rotation": "euler"}, "rotation: 'euler'; allowed: rotvector, rpy, quaternion"),
        ({"tool.command.y": None}, {}, "says no commands; allowed: columns tool.command.x"),
        ({"tool.command.x": [0, 1]}, {}, "line 3: pose 1, cycle 2: is commanded something else than before"),
        ({"pose": None, "path": [1, 1], "cycle": [1, 2]}, {}, "path 1: its command has 1 different points; allowed: 3"),
        ({}, {"match": "time"}, "match: 'time'; allowed: plane, sample"),
        ({}, {"band": 0.0}, "band: 0.0; allowed: a length greater than 0"),
    ],
)
def test_what_is_wrong_in_a_file_is_said(
    change: dict[str, object], options: dict[str, object], message: str, tmp_path: Path
) -> None:
    columns = {name: values for name, values in {**GOOD, **change}.items() if values is not None}
    file = write(tmp_path / "m.csv", columns)
    assert accuracy(write(tmp_path / "good.csv", GOOD)).poses
    refused(InputError, message, accuracy, file, **options)


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    (tmp_path / "nan.npz").touch()
    np.savez(tmp_path / "nan.npz", pose=[1.0, np.nan])
    np.savez(tmp_path / "uneven.npz", **{"pose": [1.0], "tool.x": [1.0, 2.0]})
    (tmp_path / "folder").mkdir()
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "sweep.json").touch()
    good = write(tmp_path / "good.csv", GOOD)
    bare = write(tmp_path / "bare.csv", {name: GOOD[name] for name in ("pose", "tool.x", "tool.y", "tool.z")})
    commands = write(tmp_path / "commands.csv", {"pose": [2], **at(np.zeros((1, 3)))})
    cases = {
        "empty.csv": "has no values; allowed: a header .pose or path",
        "nothing.csv": "cannot be read: No such file",
        "nan.npz": "row 1: column 'pose': nan; allowed: a finite number",
        "uneven.npz": "array 'tool.x' has dtype float64 and shape",
        "poses.txt": "is no measured file; allowed: a path that ends in .csv or .npz",
        "folder": "has no trajectory.npz",
        "sweep": "is the folder of a sweep, whose table has no poses of the tool; allowed: robot, scenario and plan",
    }
    for files, options, message in (
        *(([tmp_path / name], {}, message) for name, message in cases.items()),
        ([good, tmp_path / "folder" / ".." / "good.csv"], {}, "stands twice"),
        ([], {}, "no results; allowed: results, or a robot, a scenario and a plan"),
        ([good], {"robot": "one_link"}, "results, and a robot"),
        ([bare], {"command": commands}, "has no command of pose 1"),
    ):
        refused(InputError, message, accuracy, *files, **options)


def test_mistaken_units_are_asked_about(tmp_path: Path) -> None:
    """Millimetres for metres, and another convention of angles."""
    far = {**GOOD, **at(np.array([[500.0, 0.0, 0.0]] * 2)), **turned(np.full((2, 3), 0.3))}
    notes = " ".join(accuracy(write(tmp_path / "m.csv", far | turned(np.zeros((2, 3)), "tool.command"))).notes)
    assert "poses '1': up to 500 m from their commands: are units and base the same?" in notes
    assert "poses '1': turned by more than 0.1 rad" in notes


# Several directions, and corners


SQUARE = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.1, 0.0], [0.0, 0.1, 0.0]])


def dense(points: Array, step: float = 0.005) -> Array:
    """A path with points between its corners."""
    parts = [
        a + np.linspace(0.0, 1.0, round(float(np.linalg.norm(b - a)) / step), endpoint=False)[:, np.newaxis] * (b - a)
        for a, b in pairwise(points)
    ]
    return np.vstack([*parts, points[-1:]])


def three_directions(folder: Path) -> AccuracyResult:
    """One command as poses 1 to 3, two cycles each, 1, 2 and 4 mm off along x, y and z; and another pose between."""
    offsets = MM * np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    command = np.array([[0.5, 0.1, 0.9]] * 3 + [[0.6, 0.1, 0.9]])
    rows = np.repeat(np.arange(4), 2)
    angles = np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, -0.02, 0.0], [0.0, 0.0, 0.0]])
    columns = {"pose": rows + 1, **at((command + offsets)[rows]), **turned(angles[rows])}
    columns |= {**at(command[rows], "tool.command"), **turned(np.zeros((8, 3)), "tool.command")}
    return accuracy(write(folder / "measured.csv", columns))


def test_variation_by_hand(tmp_path: Path) -> None:
    """The farthest barycentres are those of y and z, sqrt(2^2 + 4^2) mm; angles differ by 10, 20 and 30 mrad."""
    found = three_directions(tmp_path)
    (variation,) = found.variations
    assert variation.poses == ("1", "2", "3")
    assert variation.cycles == 2
    assert variation.position == pytest.approx(MM * np.sqrt(20.0))
    np.testing.assert_allclose(variation.turned or (), [0.01, 0.02, 0.03], atol=1e-12)
    assert [pair.poses for pair in found.distances] == [("3", "4")]
    assert found.summary()["vAP"] == variation.position
    (note,) = [note for note in found.notes if "vAP" in note]
    assert note.endswith("one pose reached from 3 directions, which their records do not show")
    assert "4.472" in "\n".join(found.lines())
    again = load_accuracy(found.save(tmp_path / "figures.json"))
    assert again == found


@pytest.mark.parametrize(("third", "said"), [([0.0, 0.0, 0.1], "3 directions"), ([0.1, 0.02, 0.0], "are 11 deg apart")])
def test_directions_of_recorded_approaches(third: list[float], said: str, tmp_path: Path) -> None:
    t, ways = np.linspace(0.0, 1.0, 11), np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], third])
    records = [(1.0 - t)[:, np.newaxis] * way for way in ways for _ in range(2)]
    columns = {"pose": np.repeat([1, 2, 3], 22), "cycle": np.tile(np.repeat([1, 2], 11), 3), "t": np.tile(t, 6)}
    columns |= {**at(np.vstack(records)), **at(np.zeros((66, 3)), "tool.command")}
    (note,) = [note for note in accuracy(write(tmp_path / "m.csv", columns)).notes if "vAP" in note]
    assert note.endswith(said)


def test_two_directions_are_fewer_than_those_of_the_standard(tmp_path: Path) -> None:
    columns = {"pose": [1, 1, 2, 2], **at(np.zeros((4, 3))), **at(np.zeros((4, 3)), "tool.command")}
    found = accuracy(write(tmp_path / "m.csv", columns))
    assert [variation.position for variation in found.variations] == [0.0]
    assert not found.distances
    assert any(note.endswith("the standard has 3") for note in found.notes)


def test_formulas_of_corners_by_hand() -> None:
    """A chamfer of 3 mm leaves 3 / sqrt(2) mm; what is past the corner and outside counts, and nothing else."""
    ex, ey = np.eye(3)[0], np.eye(3)[1]
    chamfer = np.array([[-10.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 10.0, 0.0]])
    assert distance_to_path(np.zeros(3), chamfer) == pytest.approx(3.0 / np.sqrt(2.0))
    assert corner_overshoot(chamfer, np.zeros(3), ex, ey) == 0.0
    beyond = np.array([[-10.0, 0.0, 0.0], [9.0, -1.0, 0.0], [1.0, 2.0, 2.0], [-5.0, 3.0, 0.0], [0.0, 10.0, 0.0]])
    assert corner_overshoot(beyond, np.zeros(3), ex, ey) == pytest.approx(np.sqrt(5.0))


@pytest.mark.parametrize("step", [0.1, 0.005])
def test_corners_of_a_path_by_hand(step: float) -> None:
    """Two cycles: a chamfer of 4 mm at the first corner, 2 mm beyond the second; each keeps its greatest."""
    command = SQUARE if step == 0.1 else dense(SQUARE, step)
    rounded = dense(np.array([[0.0, 0.0, 0.0], [0.196, 0.0, 0.0], [0.2, 0.004, 0.0], [0.2, 0.1, 0.0], [0.0, 0.1, 0.0]]))
    corner = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.102], [0.19, 0.102], [0.18, 0.1], [0.0, 0.1]]
    beyond = dense(np.pad(corner, ((0, 0), (0, 1))), 0.001)
    way = Way("1", Record(None, command, None), tuple(Record(None, x, None) for x in (rounded, beyond)))
    (path,) = figures_of(measured(paths=[way])).paths
    first, second = path.corners
    assert (first.along, second.along) == pytest.approx((0.2, 0.3))
    assert first.angle == second.angle == pytest.approx(np.pi / 2.0)
    assert first.rounding == pytest.approx(MM * 4.0 / np.sqrt(2.0))
    assert first.overshoot == pytest.approx(0.0, abs=1e-12)
    assert second.rounding == pytest.approx(0.0, abs=1e-12)
    assert second.overshoot == pytest.approx(2.0 * MM)


def test_corners_between_points_and_curves_that_have_none() -> None:
    """A corner that sampling cuts off is where both lines meet; a circle, a line and a way back have none."""
    points = dense(SQUARE[:3], 0.007)
    cut = np.delete(points, int(np.argmin(np.linalg.norm(points - SQUARE[1], axis=1))), axis=0)
    (corner,) = corners_of(cut)
    np.testing.assert_allclose(corner.point, SQUARE[1], atol=1e-12)
    angle = np.linspace(0.0, np.pi, 13)
    assert not corners_of(np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    assert not corners_of(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))
    assert not corners_of(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))


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
    motion, other = simulated.trajectory, simulated.program_pose.copy()
    other[150, 0, 3] += MM
    good = write(tmp_path / "good.csv", GOOD)
    changed = r"results\[1\]: "
    for result, options, message in (
        (
            replace(simulated, program_pose=other),
            {},
            changed + "commands another pose than .*: by 0.001 m and 0 rad at 0.15 s",
        ),
        (replace(simulated, trajectory=replace(motion, t=2.0 * motion.t)), {}, changed + "has 301 samples to 0.6 s"),
        (replace(simulated, tool="link1"), {}, changed + r"looks at 'link1', and results\[0\] at 'tcp'"),
        (replace(simulated, programmed=False), {}, changed + "nothing is programmed"),
        (replace(simulated, stopped={"reason": "singular"}), {}, changed + "the motion stopped too early"),
        (simulated, {"frame": "hand"}, "frame: 'hand' is not the one that results.0. looks at; allowed: 'tcp'"),
        (good, {}, "good.csv is measured, and results.0. simulated; allowed: all of one kind"),
        (simulated, {"command": good}, "command: simulations know their commands"),
    ):
        refused(InputError, message, accuracy, simulated, result, **options)


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


def result_of() -> AccuracyResult:
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
    found = result_of()
    assert found.stops
    path = found.save(tmp_path / "new" / "figures.json")
    assert load_accuracy(path) == found
    refused(InputError, r"figures.npz'; allowed: a path that ends in .json", found.save, tmp_path / "figures.npz")
    values = json.loads(path.read_text(encoding="ascii"))
    for change, message in (
        ({"standard": "ISO 1"}, "holds no figures of ISO 9283:1998"),
        ({"poses": [{"name": "1"}]}, r"poses\[0\]: the key 'cycles' is missing"),
        ({"load": 5}, "load: got 5; allowed: a value of type str"),
    ):
        path.write_text(json.dumps(values | change), encoding="ascii")
        refused(InputError, message, load_accuracy, path)


def test_a_result_as_a_table_and_in_words() -> None:
    found = result_of()
    rows = found.as_rows()
    of, value, unit = (column.values.tolist() for column in rows.columns)
    table = {(symbol, what): (x, u) for symbol, what, x, u in zip(rows.values.tolist(), of, value, unit, strict=True)}
    assert len(table) == len(value)
    assert table["AP_p", "pose 2"] == (found.poses[1].accuracy, "m")
    assert table["RT_c", "path 1"] == (found.paths[0].turning[2], "rad")
    assert table["AD_p", "poses 1 and 2"] == (found.distances[0].accuracy, "m")
    assert found.summary()["RP"] == max(pose.repeatability for pose in found.poses)
    text = "\n".join(found.lines())
    rest = f"{1e3 * found.poses[0].accuracy:.4g}"
    for word in ("5 kg", "0.25 m/s", "AP mm", "RT mm", "AD mm", "stabilization s", "AV %", rest):
        assert word in text
    assert text.isascii()


def test_the_command_prints_and_writes(tmp_path: Path) -> None:
    columns = {"pose": [1] * 4 + [2] * 4, **at(np.vstack([MM * CROSS, MM * CROSS + [1.0, 0.0, 0.0]]))}
    file = write(tmp_path / "m.csv", columns)
    commands = write(tmp_path / "c.csv", {"pose": [1, 2], **at(np.array([[0.0] * 3, [1.0, 0.0, 0.0]]))})
    words = ("accuracy", file, "--commands", commands, "--test-load", "none", "--distance", 1, 2)
    out = command(*words, "-o", tmp_path / "f.json")
    assert "tool: accuracy by the definitions of ISO 9283:1998, measured" in out
    assert "5.232" in out
    values = facts(*words)
    assert values["standard"] == "ISO 9283:1998"
    assert values["summary"]["RP"] == load_accuracy(tmp_path / "f.json").poses[1].repeatability
    assert "nothing.csv: cannot be read" in command("accuracy", tmp_path / "nothing.csv", code=1)
    command("accuracy", code=1)


def test_the_figure_shows_poses_and_paths(tmp_path: Path, simulated: SimulationResult) -> None:
    found = result_of()
    poses, paths = replace(found, paths=()), replace(found, poses=())
    for name, one, words in (
        ("all", found, ("pose 2", "path 1", "x less command", "length along the path")),
        ("poses", poses, ("pose 1", "z less command")),
        ("paths", paths, ("mean + 3 S",)),
        ("exact", accuracy(simulated), ("one_link", "simulated")),
    ):
        text = plot_accuracy(one, tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        assert all(word in text for word in words), name
    refused(InputError, r"allowed: a path that ends in", plot_accuracy, found, tmp_path / "figure.txt")
    file = write(tmp_path / "m.csv", GOOD)
    command("accuracy", file, "--plot", tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
