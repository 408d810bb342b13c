"""Files of poses that are read wrongly: the reading that explains them is named; what explains none is not written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.cli import entry as cli
from eomgen.errors import InputError
from eomgen.identification import MeasuredPoses, calibrate, load_calibration, poses_from_columns
from eomgen.identification.calibration.misreadings import readings_of
from eomgen.motion.turns import rotation_of
from eomgen.pictures.page import report_of
from eomgen.robot.model import build_model
from eomgen.runtime.inverse_kinematics.rotations import rpy_of, vector_of
from tests.support.measured_poses import TCP, Trial, chain, trial, turned, write_csv
from tests.support.soak import share, soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
Columns = dict[str, Array]


def blind(seed: int = 12, count: int = 40) -> Trial:
    """A random arm that is off by what is expected, and its poses."""
    return trial(chain(seed, "RRRR"), seed, count)


def vectors(rotations: Array) -> Columns:
    return dict(zip(TCP[3:], np.array([vector_of(x) for x in rotations]).T, strict=True))


def angles(columns: Columns) -> Array:
    return np.array([rpy_of(x) for x in turned(columns)])


def inverse(columns: Columns) -> Columns:
    back = turned(columns).transpose(0, 2, 1)
    p = -np.einsum("nij,nj->ni", back, np.stack([columns[name] for name in TCP[:3]], axis=1))
    return dict(zip(TCP[:3], p.T, strict=True)) | vectors(back)


def left_handed(columns: Columns) -> Columns:
    M = np.diag([1.0, -1.0, 1.0])
    return {"tcp.y": -columns["tcp.y"], **vectors(M @ turned(columns) @ M)}


def euler(columns: Columns) -> Columns:
    """Angles of a turn about z, y and z again, each with the frame."""
    found = []
    for R in turned(columns):
        beta = np.arccos(np.clip(R[2, 2], -1.0, 1.0))
        found.append([np.arctan2(R[1, 2], R[0, 2]), beta, np.arctan2(R[2, 1], -R[2, 0])])
    return dict(zip(TCP[3:], np.array(found).T, strict=True))


WRONG: dict[str, Callable[[Columns], Columns]] = {
    "read as y mirrored, of positions alone": lambda c: {"tcp.y": -c["tcp.y"]},
    "read as x and y swapped, of positions alone": lambda c: {"tcp.x": c["tcp.y"], "tcp.y": c["tcp.x"]},
    "read as y mirrored, of positions and orientations (left-handed axes)": left_handed,
    "read as poses of the device in the frame (inverse)": inverse,
    "read as rpy:": lambda c: dict(zip(TCP[3:], angles(c).T, strict=True)),
    "read as rpy, yaw first:": lambda c: dict(zip(TCP[3:], angles(c)[:, ::-1].T, strict=True)),
    "read as intrinsic z, y, z:": euler,
    "read as joint2.gamma and joint3.gamma swapped": lambda c: {
        "joint2.gamma": c["joint3.gamma"],
        "joint3.gamma": c["joint2.gamma"],
    },
    "read as joint3.gamma of the opposite sense": lambda c: {"joint3.gamma": -c["joint3.gamma"]},
    "read as joint3.gamma counted": lambda c: {"joint3.gamma": c["joint3.gamma"] + c["joint2.gamma"]},
    "read as coordinates one row early": lambda c: {name: np.roll(c[name], 1) for name in TCP},
    "read as coordinates one row late": lambda c: {name: np.roll(c[name], -1) for name in TCP},
    "read as centimetres for metres": lambda c: {name: 1e2 * c[name] for name in TCP[:3]},
    "and rpy": lambda c: {"tcp.z": -c["tcp.z"], **dict(zip(TCP[3:], angles(c).T, strict=True))},
}


def poses_of(made: Trial, columns: Columns) -> MeasuredPoses:
    return poses_from_columns(columns, build_model(made.robot).coordinates, ["tcp"])


@pytest.mark.parametrize(
    "said", [pytest.param(said, marks=pytest.mark.soak) if i else said for i, said in enumerate(WRONG)]
)
def test_the_reading_that_explains_is_named(said: str) -> None:
    made = blind()
    columns = made.columns | WRONG[said](made.columns)
    with pytest.raises(InputError) as caught:
        calibrate(made.robot, poses_of(made, columns), folds=0)
    assert said in str(caught.value)


@pytest.mark.soak
@pytest.mark.parametrize("seed", share(range(30, 42), 2))
@pytest.mark.parametrize("said", list(WRONG))
def test_many_blind_arms(said: str, seed: int) -> None:
    """The cause is named, or one that these poses do not tell from it; never another alone."""
    made = blind(seed)
    columns = made.columns | WRONG[said](made.columns)
    with pytest.raises(InputError, match="read as") as caught:
        calibrate(made.robot, poses_of(made, columns), folds=0)
    assert said.removeprefix("read as ").rstrip(":") in str(caught.value)


def test_positions_do_not_tell_mirrors_apart() -> None:
    """A base that stands anywhere makes one mirror of the other: all of them are named."""
    made = blind()
    columns = {name: values for name, values in made.columns.items() if not name.startswith("tcp.r")}
    columns["tcp.x"] = -columns["tcp.x"]
    with pytest.raises(InputError, match="these poses do not distinguish it from") as caught:
        calibrate(made.robot, poses_of(made, columns), folds=0)
    assert "x mirrored" in str(caught.value)
    assert "millimetres" not in str(caught.value)


@pytest.mark.parametrize(("seed", "size"), soaked([(1, 0.0), (2, 1.0), (3, 6.0)], [(2, 1.0)]))
def test_right_files_are_read_as_they_are(seed: int, size: float) -> None:
    """However large the offsets are that a robot has, and with rows that are off."""
    made = trial(chain(seed, "RRRR"), seed, 40, size=size)
    columns = {name: values.copy() for name, values in made.columns.items()}
    columns["tcp.x"][7] += 0.5
    found = calibrate(made.robot, poses_of(made, columns), folds=4)
    assert found.is_explained
    assert not any("read as" in note for note in found.notes)


def test_readings_are_inverse_to_what_was_done() -> None:
    """Readings of rows and joints keep what belongs together."""
    made = blind(count=6)
    readings = {reading.text: reading for reading in readings_of(made.poses())}
    assert len(readings) > 100
    late = readings["coordinates one row late"].change(made.poses())
    np.testing.assert_array_equal(late.q, made.poses().q[1:])
    np.testing.assert_array_equal(late.frames["tcp"].position, made.poses().frames["tcp"].position[:-1])
    back = readings["poses of the device in the frame (inverse)"]
    twice = back.change(back.change(made.poses()))
    np.testing.assert_allclose(twice.frames["tcp"].position, made.poses().frames["tcp"].position, atol=1e-12)
    R = rotation_of(made.poses().frames["tcp"].written)
    np.testing.assert_allclose(readings["rotvector"].change(made.poses()).frames["tcp"].orientation, R)


def unexplained() -> Trial:
    """Positions that belong to other rows: nothing explains them."""
    made = trial(eomgen.load_robot("puma560"), 1, 60)
    columns = {name: values for name, values in made.columns.items() if not name.startswith("tcp.r")}
    order = np.random.default_rng(0).permutation(60)
    columns |= {name: columns[name][order] for name in TCP[:3]}
    return Trial(made.robot, columns, made.model, made.rows, made.truth)


def test_what_explains_nothing_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    made = unexplained()
    write_csv(Path("poses.csv"), made.columns)
    words = ["calibrate", "puma560", "poses.csv", "--folds", "0", "--toml", "better.toml", "--urdf", "better.urdf"]
    assert cli.main([*words, "-o", "found.npz"]) == 1
    captured = capsys.readouterr()
    assert "what was measured is not explained" in captured.out
    assert "is not written as a description; allowed: poses that it explains" in " ".join(captured.err.split())
    assert not Path("better.toml").exists()
    assert not Path("better.urdf").exists()
    found = load_calibration("found.npz")
    assert not found.is_explained
    with pytest.raises(InputError, match="force=True"):
        found.to_toml("better.toml")
    assert cli.main([*words, "--force"]) == 0
    assert eomgen.load_robot("better.toml").name == eomgen.load_robot("puma560").name


@pytest.mark.soak
def test_a_wrong_reading_can_be_forced() -> None:
    made = blind()
    columns = made.columns | {"tcp.y": -made.columns["tcp.y"]}
    found = calibrate(made.robot, poses_of(made, columns), folds=0, force=True)
    assert any("read as y mirrored" in note for note in report_of(found).warnings), "amber on the page"
    assert not found.is_explained
