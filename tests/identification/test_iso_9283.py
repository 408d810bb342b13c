"""Figures of ISO 9283 against numbers by hand and against known expectations of normal scatter; files refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.errors import InputError
from eomgen.identification import accuracy
from eomgen.identification.geometry.rotations import vectors_of
from eomgen.identification.iso_9283.attained import Path as Way
from eomgen.identification.iso_9283.attained import Record
from eomgen.identification.iso_9283.formulas import scatter, stabilization
from eomgen.identification.iso_9283.solve import figures_of
from eomgen.motion.turns import rotation_of
from eomgen.runtime.inverse_kinematics.rotations import vector_of
from tests.support.pose_files import CROSS, GOOD, MM, OFFSET, at, line, measured, turned, write

Array = NDArray[np.float64]


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
    assert pose.turned is not None
    assert pose.turning is not None
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
    quaternion = dict(head)
    for i, key in enumerate(("qw", "qx", "qy", "qz")):
        quaternion |= {f"tool.{key}": -parts[:, i], f"tool.command.{key}": np.full(2, float(key == "qy"))}

    roll = np.arctan2(attained[:, 2, 1], attained[:, 2, 2])
    pitch = np.arctan2(-attained[:, 2, 0], np.hypot(attained[:, 0, 0], attained[:, 1, 0]))
    yaw = np.arctan2(attained[:, 1, 0], attained[:, 0, 0])
    rpy = {**head, **turned(np.stack([roll, pitch, yaw], axis=1)), **turned(commands, "tool.command")}

    for kind, columns in {"rotvector": rotvector, "quaternion": quaternion, "rpy": rpy}.items():
        (pose,) = accuracy(write(tmp_path / "m.npz", columns), rotation=kind).poses
        assert pose.turned is not None
        assert pose.turning is not None
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
    assert np.mean([one.repeatability for one in found]) == pytest.approx(
        sigma * (2.0 * np.sqrt(2.0 / np.pi) + 3.0 * np.sqrt(3.0 - 8.0 / np.pi)), rel=0.03
    )


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
    with pytest.raises(InputError, match=r"no pose '3'.*known: '2', '4'"):
        accuracy(tmp_path / "m.csv", distances=[("2", "3")])


def test_stops_by_hand() -> None:
    """Straight lines between samples: the band of 2 is crossed at 1.5, left, and come back to at 3.75."""
    t = np.arange(6.0)
    away = np.array([10.0, 4.0, 0.0, 4.0, -4.0 / 3.0, 0.0])
    position = away[:, np.newaxis] * [1.0, 0.0, 0.0]
    assert stabilization(t, position, np.zeros(3), 2.0) == pytest.approx((3.75 - 1.5, 4.0))
    assert stabilization(t, position, np.zeros(3), 5.0) == (0.0, 0.0)  # once inside, it stays
    assert stabilization(t, position, np.zeros(3), 20.0) == (0.0, 0.0)


def test_stops_of_measured_approaches(tmp_path: Path) -> None:
    """With t the last row of a cycle is what was attained; by default the band is the repeatability."""
    t = np.arange(6.0)
    away = np.array([10.0, 4.0, 0.0, 4.0, -4.0 / 3.0, 0.0])
    cycles = np.vstack([away[:, np.newaxis] * [1.0, 0.0, 0.0] + end for end in ([0.0, 0.0, 2.0], [0.0, 0.0, -2.0])])
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
    assert across.turned is not None
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
    assert path.speed is not None
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
    with pytest.raises(InputError, match="cycle 1 has 80 samples and its command 51"):
        accuracy(*files, command=commands, match="sample")


# What the standard asks for


def test_fewer_cycles_than_the_standard_asks_for_are_said(tmp_path: Path) -> None:
    def notes(cycles: int, poses: int) -> str:
        numbers = np.repeat(np.arange(poses), cycles)
        zeros = np.zeros((len(numbers), 3))
        columns = {
            "pose": numbers,
            **at(zeros + 1e-6 * np.arange(len(numbers))[:, np.newaxis]),
            **at(zeros, "tool.command"),
        }
        return " ".join(accuracy(write(tmp_path / "m.csv", columns)).notes)

    assert "asks for 30 cycles at 5 poses (here 29 at 5)" in notes(29, 5)
    assert "(here 30 at 4): the figures follow its formulas and are not those of it" in notes(30, 4)
    assert "asks for" not in notes(30, 5)


def test_cycles_of_further_files_are_further_cycles(tmp_path: Path) -> None:
    command = at(np.zeros((2, 3)), "tool.command")
    files = [
        write(
            tmp_path / f"{i}.csv", {"pose": [1, 2], **at(MM * CROSS[[i, i]] + [[0.0] * 3, [1.0, 0.0, 0.0]]), **command}
        )
        for i in range(4)
    ]
    wanted = write(
        tmp_path / "commands.csv", {"pose": [1, 2, 9], **at(np.array([[0.0] * 3, [1.0, 0.0, 0.0], [0.0] * 3]))}
    )
    with pytest.raises(InputError, match="has commands, and so has"):
        accuracy(*files, command=wanted)
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
        (
            {f"tool.{key}": [1, 1] for key in ("qw", "qx", "qy", "qz")},
            {"rotation": "quaternion"},
            "line 2: a quaternion of length 2; allowed: 1",
        ),
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
    with pytest.raises(InputError, match=message):
        accuracy(file, **options)  # type: ignore[arg-type]


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    (tmp_path / "nan.npz").touch()
    np.savez(tmp_path / "nan.npz", pose=[1.0, np.nan])
    np.savez(tmp_path / "uneven.npz", **{"pose": [1.0], "tool.x": [1.0, 2.0]})  # type: ignore[arg-type]
    (tmp_path / "folder").mkdir()
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "sweep.json").touch()
    for name, message in {
        "empty.csv": "has no values; allowed: a header .pose or path",
        "nothing.csv": "cannot be read: No such file",
        "nan.npz": "row 1: column 'pose': nan; allowed: a finite number",
        "uneven.npz": "array 'tool.x' has dtype float64 and shape",
        "poses.txt": "is no measured file; allowed: a path that ends in .csv or .npz",
        "folder": "has no trajectory.npz",
        "sweep": "is the folder of a sweep, whose table has no poses of the tool; allowed: robot, scenario and plan",
    }.items():
        with pytest.raises(InputError, match=message):
            accuracy(tmp_path / name)
    good = write(tmp_path / "good.csv", GOOD)
    with pytest.raises(InputError, match="stands twice"):
        accuracy(good, tmp_path / "folder" / ".." / "good.csv")
    with pytest.raises(InputError, match="no results; allowed: results, or a robot, a scenario and a plan"):
        accuracy()
    with pytest.raises(InputError, match="results, and a robot"):
        accuracy(good, robot="one_link")
    bare = write(tmp_path / "bare.csv", {name: GOOD[name] for name in ("pose", "tool.x", "tool.y", "tool.z")})
    commands = write(tmp_path / "commands.csv", {"pose": [2], **at(np.zeros((1, 3)))})
    with pytest.raises(InputError, match="has no command of pose 1"):
        accuracy(bare, command=commands)


def test_mistaken_units_are_asked_about(tmp_path: Path) -> None:
    """Millimetres for metres, and another convention of angles."""
    far = {**GOOD, **at(np.array([[500.0, 0.0, 0.0]] * 2)), **turned(np.full((2, 3), 0.3))}
    notes = " ".join(accuracy(write(tmp_path / "m.csv", far | turned(np.zeros((2, 3)), "tool.command"))).notes)
    assert "poses '1': up to 500 m from their commands: are units and base the same?" in notes
    assert "poses '1': turned by more than 0.1 rad" in notes
