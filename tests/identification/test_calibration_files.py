"""Files of calibrations: traps, misreadings that are named, options, the command, TOML and URDF, saved results."""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.identification import calibrate, load_calibration
from eomgen.identification.calibration import as_urdf
from eomgen.identification.calibration.as_toml import FittedParameters, write_toml
from eomgen.identification.calibration.misreadings import readings_of
from eomgen.identification.calibration.solve import problem_of
from eomgen.identification.geometry import solve as geometry
from eomgen.identification.geometry.error_model import DRIVE, ErrorParameter
from eomgen.identification.geometry.rotations import from_rpy, pose_of
from eomgen.identification.geometry.stations import chain_of, located, matrix_of
from eomgen.kernel.inverse_kinematics.rotations import rpy_of, vector_of
from eomgen.motion.turns import rotation_of
from eomgen.pictures.page import report_of
from eomgen.robot.value import COORDINATES, Robot
from tests.support.commands import command, facts
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.measured_poses import TCP, Trial, arm, chain, puma, trial, turned, write_csv
from tests.support.measurements import calibrated, placed, poses_of, task_of
from tests.support.refusals import refused
from tests.support.same_values import compare_values
from tests.support.soak import soaked

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]

TRAPS = {
    "millimetres for metres": lambda c: {name: 1e3 * c[name] for name in TCP[:3]},
    "degrees for radians": lambda c: {f"joint{i}.gamma": np.rad2deg(c[f"joint{i}.gamma"]) for i in range(1, 7)},
    "motor angles for joint angles": lambda c: {"joint2.gamma": 107.8 * c["joint2.gamma"]},
    "joint2.gamma copies column joint1.gamma": lambda c: {"joint2.gamma": c["joint1.gamma"]},
    "tcp.y copies column tcp.x": lambda c: {"tcp.y": c["tcp.x"]},
    "poses are all alike": lambda c: {f"joint{i}.gamma": 1.0 + 1e-6 * c[f"joint{i}.gamma"] for i in range(1, 7)},
    "fewer poses than unknowns": lambda c: {name: values[:4] for name, values in c.items()},
    "column 'weight': 0; allowed: a positive number": lambda c: {"weight": np.zeros(100)},
    "there is no frame 'tpc'; did you mean 'tcp'": lambda c: {"tpc.x": c["tcp.x"]},
    "column 'series': 0.5; allowed: a whole number": lambda c: {"series": np.full(100, 0.5)},
    "column 'tcp.sigma.x': -1; allowed: a positive number": lambda c: {"tcp.sigma.x": np.full(100, -1.0)},
    "column 'joint7.gamma' is unknown": lambda c: {"joint7.gamma": c["tcp.x"]},
}
SLOW = {"joint2.gamma copies column joint1.gamma", "tcp.y copies column tcp.x", "motor angles for joint angles"}


@pytest.mark.parametrize("said", soaked(TRAPS, set(TRAPS) - SLOW))
def test_traps_are_told_by_name(said: str) -> None:
    refused(InputError, said, calibrated, puma().robot, puma().columns | TRAPS[said](puma().columns))


def test_options_are_checked(tmp_path: Path) -> None:
    poses = trial(arm(), 3, 30).poses()
    cases: list[tuple[dict[str, Any], type[Exception], str]] = [
        ({"loss": "l1"}, InputError, "loss: 'l1'; allowed: huber"),
        ({"variant": "best"}, InputError, "variant: 'best'; allowed: placement"),
        ({"folds": 1}, InputError, "folds: 1; allowed"),
        ({"noise": (0.0, 1e-4)}, ArrayError, "noise: "),
        ({"sizes": (1.0,)}, ArrayError, "sizes: "),
        ({"confidence": 1.0}, InputError, "confidence: 1.0"),
        ({"frames": {"ball": "link9"}}, UnknownNameError, "there is no link 'link9'"),
        ({"frames": {"tcp": "link1"}}, InputError, "frames: 'tcp'"),
        ({"stiffness": ["joint9.x"]}, UnknownNameError, "there is no coordinate 'joint9.x'"),
        ({"covariance": {"tcp": np.zeros((6, 6))}}, ArrayError, "not symmetric and positive definite"),
    ]
    for options, error, said in cases:
        refused(error, said, calibrate, arm(), poses, **{"folds": 0, **options})
    refused(InputError, r"ends in \.csv or \.npz", calibrate, arm(), tmp_path / "poses.txt")


# Files


def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Text, JSON, TOML, URDF and a result that loads again."""
    monkeypatch.chdir(tmp_path)
    columns = {name: values.copy() for name, values in puma().columns.items()}
    for name in TCP:
        columns[name][7] = np.nan
    write_csv(Path("poses.csv"), columns)
    words = ("calibrate", "puma560", "poses.csv", "--folds", 0)
    said = facts(*words, "--toml", "better.toml", "--urdf", "better.urdf", "-o", "found.npz")
    assert said["files"] == ["better.toml", "better.urdf", "found.npz"]
    assert said["rank"] == 30
    found = load_calibration("found.npz")
    assert found.as_dict() == {key: value for key, value in said.items() if key != "files"}
    q = puma().poses().q[:9]
    predicted = found.predict(q, "tcp")[0]
    for name in ("better.toml", "better.urdf"):
        robot = eomgen.load_robot(name)
        stations = chain_of(robot, {"tcp": frame_of(robot)})
        values = np.zeros((9, len(stations.stations), 6))
        for i, station in enumerate(stations.stations):
            if station.joint is not None and station.offset is not None:
                values[:, i] = station.offset
                values[:, i, 5] += q[:, int(station.name[-1]) - 1]
        at = located(stations, values, np.tile(np.eye(4), (9, 1, 1)))
        np.testing.assert_allclose(at.p[stations.tools["tcp"]], predicted[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(at.R[stations.tools["tcp"]], predicted[:, :3, :3], atol=1e-12)
    text = Path("better.toml").read_text()
    assert "# +- " in text
    assert "with the sign of the coordinate" in text
    assert "joints.joint2.offset.gamma" in command(*words, "-o", "figure.svg")
    assert "<svg" in Path("figure.svg").read_text()
    assert "attach: 'tcp'; allowed: F=LINK" in command(*words, "--attach", "tcp", code=1)


def frame_of(robot: Robot) -> tuple[str, Array]:
    """Link and pose of the tool: a frame of TOML, a link of a URDF."""
    for frame in robot.frames:
        return frame.link, matrix_of(frame.placement)
    return "tcp", np.eye(4)


def test_an_urdf_gets_its_origins(tmp_path: Path) -> None:
    """Of joints with any axis, prismatic ones among them: a file that is read, changed and read again."""
    source = tmp_path / "arm.urdf"
    source.write_text(
        '<robot name="arm"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0.1 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        '<joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0.1"/>'
        '<axis xyz="1 0 1"/><limit lower="-0.3" upper="0.3" effort="1" velocity="1"/></joint>'
        '<joint name="j3" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0 0.2 0" rpy="0 1 0"/>'
        '<axis xyz="1 0 0"/></joint></robot>'
    )
    robot = eomgen.load_robot(source)
    made = trial(robot, 1, 50, frames={"c": ("c", np.eye(4))})
    found = calibrate(robot, made.poses(), folds=0)
    q = made.poses().q
    wanted = found.predict(q, "c")[0]
    for path in (found.to_urdf(tmp_path / "out" / "new.urdf"), found.to_toml(tmp_path / "out" / "new.toml")):
        kernel = eomgen.build(eomgen.load_robot(path), kernels=("kinematics",))
        np.testing.assert_allclose(kernel.frame_pose(q, "c_calibrated"), wanted, atol=1e-12)


BALL = (
    '<robot name="arm"><link name="base"/><link name="a-1"/><link name="b"/><link name="old"/>'
    '<joint name="j1" type="revolute"><parent link="base"/><child link="a-1"/><origin xyz="0 0 0.3" rpy="0.1 0 0"/>'
    '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
    '<joint name="j2" type="continuous"><parent link="a-1"/><child link="b"/><origin xyz="0.3 0 0.1" rpy="1 0 0"/>'
    '<axis xyz="1 0 0"/></joint>'
    '<joint name="ball_joint" type="fixed"><parent link="b"/><child link="old"/></joint></robot>'
)


def test_a_description_without_all_terms_has_offsets_that_go_without_them(tmp_path: Path) -> None:
    """Neither format has the eccentricity of a drive; its residual is in the table, and that of the file."""
    robot = eomgen.load_robot("ur5")
    more = [ErrorParameter("joints.joint2.eccentricity.sin", DRIVE, 2, 5, "sin", 0.0, 1e-2)]
    poses = trial(robot, 1, 40, more=more, noise=(5e-5, 1e-4)).poses("rx", "ry", "rz")
    found, plain = (calibrate(robot, poses, folds=0, drives=drives) for drives in (True, False))
    assert found.residuals["full"]["fitted"]["position"] < 1e-4
    saved = load_calibration(found.save(tmp_path / "found.npz"))
    for form, path in (("toml", saved.to_toml(tmp_path / "x.toml")), ("urdf", saved.to_urdf(tmp_path / "x.urdf"))):
        said = saved.written[form]["fitted"]["position"]
        assert said == pytest.approx(plain.residuals["full"]["fitted"]["position"], rel=1e-6)
        again = calibrate(eomgen.load_robot(path), poses, folds=2, variant="placement")
        assert again.residuals["placement"]["fitted"]["position"] == pytest.approx(said, rel=1e-4)
    assert "# joints.joint2.eccentricity.sin = " in Path(tmp_path / "x.toml").read_text()
    text = "\n".join(saved.lines())
    assert "in the .toml" in text
    assert ".urdf cannot have 'joints.joint2.eccentricity.cos', 'joints.joint2.eccentricity.sin'" in text


def test_single_components_are_not_measured_alone() -> None:
    """Contact with a plane: blank cells mean that nothing was measured, and the message says what may be."""
    made = trial(chain(3, "RRR"), 1, 30)
    plane = {"tcp.x": np.full(30, np.nan), "tcp.y": np.full(30, np.nan)}
    with pytest.raises(InputError, match=r"is empty \(not measured\) where tcp\.z is measured") as caught:
        poses_of(made.robot, made.columns | plane)
    assert "F.distance" in str(caught.value)
    assert "nan" not in str(caught.value)


def test_joints_that_move_a_load_alone_need_no_column_without_stiffness() -> None:
    """Wrenches on the tool, and the first link measured: what the other joints do moves nothing."""
    made = trial(chain(3, "RRR"), 1, 30, frames={"link1": ("link1", np.eye(4))})
    columns = {name: x for name, x in made.columns.items() if name not in ("joint2.gamma", "joint3.gamma")}
    loads = {f"tcp.f{axis}": np.full(30, 5.0) for axis in "xyz"}
    poses = poses_of(made.robot, columns | loads, "link1", "tcp")
    found = calibrate(made.robot, poses, folds=0)
    assert found.residuals["full"]["fitted"]["position"] < 1e-4
    said = "link1 is a link: its estimated place is written as link1_calibrated"
    assert any(note.startswith(said) for note in found.notes)
    with pytest.raises(InputError, match=r"the column joint2\.gamma is missing"):
        calibrate(made.robot, poses, folds=0, stiffness=["joint1.alpha"])


def test_one_place_in_each_series_shows_no_length() -> None:
    """A smaller robot has smaller residuals; a length that stays, or another place, says how large it is."""
    robot = chain(3, "RRR")
    columns = {name: x for name, x in trial(robot, 1, 40).columns.items() if name.startswith("joint")}
    rng = np.random.default_rng(0)
    columns |= {name: 0.3 + 1e-5 * rng.normal(size=40) for name in TCP[:3]}
    columns["series"] = np.repeat([0.0, 1.0], 20)
    refused(InputError, "no length was measured: tcp stays at one place in each series", calibrated, robot, columns)
    two = columns["tcp.x"] + 0.05 * (np.arange(40) % 20 == 0)
    for task, poses in ((task_of(robot, fixed=("joints.joint2.offset",)), columns), (task_of(robot), {"tcp.x": two})):
        problem_of(task, poses_of(robot, columns | poses), careful=True)


def test_lengths_of_another_robot_are_not_written(tmp_path: Path) -> None:
    robot = chain(3, "RRR")
    x, y, z = robot.joints[1].placement.xyz
    moved = replace(robot.joints[1].placement, xyz=(x + 1.0, y, z))
    longer = replace(robot, joints=(robot.joints[0], replace(robot.joints[1], placement=moved), robot.joints[2]))
    found = calibrated(robot, trial(longer, 1, 40).columns, noise=(5e-5, 1e-4))
    assert any(note.startswith("the fit is of another robot: ") for note in found.notes)
    refused(InputError, "is not written", found.to_toml, tmp_path / "x.toml")


@pytest.mark.parametrize("link", ["b", "a_1"])
def test_an_attached_frame_gets_a_name_and_a_link_that_the_urdf_has(tmp_path: Path, link: str) -> None:
    """The file has a joint of the frame's usual name, and a link whose name is no identifier."""
    source = tmp_path / "arm.urdf"
    source.write_text(BALL)
    robot = eomgen.load_robot(source)
    made = trial(robot, 1, 30, frames={"ball": (link, pose_of(np.eye(3), [0.0, 0.1, 0.2]))})
    found = calibrate(robot, made.poses(), frames={"ball": link}, folds=0)
    read = eomgen.load_robot(found.to_urdf(tmp_path / "new.urdf"))
    assert {joint.name for joint in read.joints} == {"j1", "j2", "ball_joint", "ball_joint_2"}
    assert read.joint("ball_joint_2").parent == link


def test_a_urdf_that_cannot_be_read_back_leaves_the_older_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two joints of one name."""
    place, source = tmp_path / "made" / "new.urdf", tmp_path / "arm.urdf"
    source.write_text(BALL)
    made = trial(eomgen.load_robot(source), 1, 30, frames={"ball": ("b", pose_of(np.eye(3), [0.0, 0.1, 0.2]))})
    found = calibrate(made.robot, made.poses(), frames={"ball": "b"}, folds=0)
    monkeypatch.setattr(as_urdf, "_add_frames", lambda root, fitted, robot: root.append(deepcopy(root.find("joint"))))
    refusal = rf"new\.urdf: is not written, since it cannot be read back: {place}.*j1"
    refused(InputError, refusal, found.to_urdf, place)
    assert not place.parent.exists()
    place.parent.mkdir()
    place.write_text("older")
    refused(InputError, refusal, found.to_urdf, place)
    assert [(path, path.read_text()) for path in place.parent.iterdir()] == [(place, "older")]


def test_a_urdf_that_reads_as_another_robot_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(as_urdf, "_set_origin", lambda element, joint: None)
    with pytest.raises(InputError, match="of the URDF would stand"):
        calibrated(puma().robot, puma().columns).to_urdf(tmp_path / "new.urdf")
    assert not any(tmp_path.iterdir())


RAIL = f"""name = "rail"
{link_table("slide", 1.0)}
{joint_table("rail", "base", "slide", "prismatic")}
dh = {{ a = 0.2, alpha_deg = 90.0 }}
{frame_table("tcp", "slide")}
placement = {{ xyz = [0.0, 0.0, 0.1], rpy_deg = [0.0, 45.0, 0.0] }}
"""


@pytest.mark.parametrize("unit", ["_deg", ""])
def test_angles_are_written_in_the_unit_of_the_file(tmp_path: Path, unit: str) -> None:
    """Degrees stay degrees and radians radians, and both say the same robot to the last digits."""
    source = tmp_path / "rail.toml"
    text = RAIL if unit else RAIL.replace("alpha_deg = 90.0", "alpha = 1.5707963267948966").replace("rpy_deg", "rpy")
    source.write_text(text, encoding="utf-8")
    robot = eomgen.load_robot(source)
    values = {"joints.rail.axis.alpha": 0.02, "joints.rail.axis.beta": -0.01}
    values |= {f"frames.tcp.{kind}": 0.1 * i for i, kind in enumerate(COORDINATES)}
    stations = chain_of(robot, {"tcp": frame_of(robot)})
    found = FittedParameters(
        robot, stations, {"tcp": "slide"}, values, dict.fromkeys(values, 1e-4), dict.fromkeys(values, "rad")
    )
    path = write_toml(found, tmp_path / "new.toml")
    lines = [line.split("#")[0] for line in path.read_text().splitlines() if line.startswith("placement")]
    assert len(lines) == 2
    assert all(f"rpy{unit} = " in line for line in lines)
    again = eomgen.load_robot(path)
    for new, old in ((again.joints[0], found.calibrated.joints[0]), (again.frames[0], found.calibrated.frames[0])):
        np.testing.assert_allclose(matrix_of(new.placement), matrix_of(old.placement), atol=1e-14)
    assert not np.allclose(matrix_of(again.joints[0].placement), matrix_of(robot.joints[0].placement), atol=1e-3)


def test_a_file_to_begin_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    command("new", "puma560", "--poses")
    text = Path("puma560_poses.csv").read_text()
    header = next(line for line in text.splitlines() if not line.startswith("#"))
    assert header.split(",") == [*(f"joint{i}.gamma" for i in range(1, 7)), *TCP]
    assert "has no values; allowed: a header" in command("calibrate", "puma560", "puma560_poses.csv", code=1)
    assert "there is no robot 'nothing'" in command("new", "nothing", "--poses", code=1)


def test_results_of_before_load_and_damaged_ones_do_not(tmp_path: Path) -> None:
    """Files with the gain of the full fit alone, and without norms."""
    found = calibrate(arm(), trial(arm(), 3, 40).poses(), folds=4)
    path = found.save(tmp_path / "found.npz")
    arrays = dict(np.load(path))
    assert load_calibration(path).as_dict() == found.as_dict()
    meta = json.loads(str(arrays["meta"]))
    meta["gain"] = meta.pop("gains")["full"]["position"]
    meta["residuals"] = {
        name: {part: parts[part] for part in ("fitted", "held_out")} for name, parts in meta["residuals"].items()
    }
    np.savez(path, **{**arrays, "meta": np.array(json.dumps(meta))})
    read = load_calibration(path)
    assert read.gain == found.gain
    assert read.lines()
    for key, value in (("meta", np.array("{}")), ("x", np.zeros(3)), ("covariance", np.full((3, 3), np.nan))):
        np.savez(path, **{**arrays, key: value})
        refused(InputError, "", load_calibration, path)


def test_readings_of_orientations() -> None:
    """Roll, pitch and yaw, quaternions, and rotation vectors say the same."""
    made = trial(arm(), 3, 40)
    R = turned(made.columns)
    angles = np.array([rpy_of(x) for x in R])
    np.testing.assert_allclose(from_rpy(angles), R, atol=1e-12)
    vectors = np.array([vector_of(x) for x in R])
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    quaternion = np.hstack([np.cos(half), np.sin(half) * vectors / (2.0 * half)])
    plain = {name: values for name, values in made.columns.items() if name not in TCP[3:]}
    wanted = calibrate(arm(), made.poses(), folds=0)
    for rotation, columns in (
        ("rpy", dict(zip(TCP[3:], angles.T, strict=True))),
        ("quaternion", dict(zip(("tcp.qw", "tcp.qx", "tcp.qy", "tcp.qz"), quaternion.T, strict=True))),
    ):
        found = calibrate(arm(), poses_of(arm(), plain | columns, rotation=rotation), folds=0)
        np.testing.assert_allclose(found.values, wanted.values, atol=1e-8)


# Files that are read wrongly


Columns = dict[str, Array]


def blind(seed: int = 12, count: int = 40) -> Trial:
    """A random arm that is off by what is expected, and its poses."""
    return trial(chain(seed, "RRRR"), seed, count)


def angles(columns: Columns) -> Array:
    return np.array([rpy_of(x) for x in turned(columns)])


def inverse(columns: Columns) -> Columns:
    back = turned(columns).transpose(0, 2, 1)
    return placed(-np.einsum("nij,nj->ni", back, np.stack([columns[name] for name in TCP[:3]], axis=1)), back)


def left_handed(columns: Columns) -> Columns:
    M = np.diag([1.0, -1.0, 1.0])
    return placed(np.stack([columns[name] for name in TCP[:3]], axis=1) @ M, M @ turned(columns) @ M)


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
    "read as rotvector, from the frame to the device": lambda c: {name: -c[name] for name in TCP[3:]},
    "read as rotvector in degrees": lambda c: {name: np.rad2deg(c[name]) for name in TCP[3:]},
    "read as joint2.gamma and joint3.gamma swapped": lambda c: {
        f"joint{i}.gamma": c[f"joint{5 - i}.gamma"] for i in (2, 3)
    },
    "read as joint3.gamma of the opposite sense": lambda c: {"joint3.gamma": -c["joint3.gamma"]},
    "read as joint3.gamma counted": lambda c: {"joint3.gamma": c["joint3.gamma"] + c["joint2.gamma"]},
    "read as coordinates one row early": lambda c: {name: np.roll(c[name], 1) for name in TCP},
    "read as coordinates one row late": lambda c: {name: np.roll(c[name], -1) for name in TCP},
    "read as centimetres for metres": lambda c: {name: 1e2 * c[name] for name in TCP[:3]},
    "and rpy": lambda c: {"tcp.z": -c["tcp.z"], **dict(zip(TCP[3:], angles(c).T, strict=True))},
}


@pytest.mark.parametrize("said", soaked(WRONG, [next(iter(WRONG))]))
def test_the_reading_that_explains_is_named(said: str) -> None:
    made = blind()
    caught = refused(InputError, "", calibrated, made.robot, made.columns | WRONG[said](made.columns))
    assert said in str(caught)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(30, 42))
@pytest.mark.parametrize("said", list(WRONG))
def test_many_blind_arms(said: str, seed: int) -> None:
    """The cause is named, or one that these poses do not tell from it; never another alone."""
    made = blind(seed)
    caught = refused(InputError, "read as", calibrated, made.robot, made.columns | WRONG[said](made.columns))
    assert said.removeprefix("read as ").rstrip(":") in str(caught)


def test_positions_do_not_tell_mirrors_apart() -> None:
    """A base that stands anywhere makes one mirror of the other: all of them are named."""
    made = blind()
    columns = {name: values for name, values in made.columns.items() if not name.startswith("tcp.r")}
    columns["tcp.x"] = -columns["tcp.x"]
    caught = refused(InputError, "these poses do not distinguish it from", calibrated, made.robot, columns)
    assert "x mirrored" in str(caught)
    assert "millimetres" not in str(caught)


@pytest.mark.parametrize(("seed", "size"), soaked([(1, 0.0), (2, 1.0), (3, 6.0)], [(2, 1.0)]))
def test_right_files_are_read_as_they_are(seed: int, size: float) -> None:
    """However large the offsets are that a robot has, and with rows that are off."""
    made = trial(chain(seed, "RRRR"), seed, 40, size=size)
    found = calibrated(
        made.robot, made.columns | {"tcp.x": made.columns["tcp.x"] + 0.5 * (np.arange(40) == 7)}, folds=4
    )
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
    plain, read = made.poses(), readings["rotvector"].change(made.poses())
    np.testing.assert_allclose(read.frames["tcp"].orientation, rotation_of(plain.frames["tcp"].written))
    compare_values(replace(plain, frames={}), replace(read, frames={}), "all but frames")
    np.testing.assert_array_equal(read.frames["tcp"].position, plain.frames["tcp"].position)


def test_what_explains_nothing_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Positions that belong to other rows: nothing explains them."""
    monkeypatch.chdir(tmp_path)
    made = trial(eomgen.load_robot("puma560"), 1, 60)
    columns = {name: values for name, values in made.columns.items() if not name.startswith("tcp.r")}
    order = np.random.default_rng(0).permutation(60)
    write_csv(Path("poses.csv"), columns | {name: columns[name][order] for name in TCP[:3]})
    words = ("calibrate", "puma560", "poses.csv", "--folds", 0, "--toml", "better.toml", "--urdf", "better.urdf")
    said = " ".join(command(*words, "-o", "found.npz", code=1).split())
    assert "is not written as a description; allowed: poses that it explains" in said
    assert not Path("better.toml").exists()
    assert not Path("better.urdf").exists()
    found = load_calibration("found.npz")
    assert not found.is_explained
    assert "what was measured is not explained" in "\n".join(found.lines())
    refused(InputError, "force=True", found.to_toml, "better.toml")
    command(*words, "--force")
    assert eomgen.load_robot("better.toml").name == eomgen.load_robot("puma560").name


def test_what_has_not_converged_is_not_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = trial(chain(2, "RRR"), 3, 16, noise=(1e-3, 1e-3))
    poses = made.poses("rx", "ry", "rz")
    cases = (("_STEPS", 0, (1e-3, 1e-3), "steps of the fit do not reach"), ("_ROUNDS", 1, None, "do not settle"))
    for name, most, noise, said in cases:
        assert calibrate(made.robot, poses, folds=0, noise=noise).status == "converged"
        with monkeypatch.context() as patch:
            patch.setattr(geometry, name, most)
            found = calibrate(made.robot, poses, folds=0, noise=noise)
        assert said in found.status
        assert found.status in found.lines()[0]
        for write in (found.to_toml, found.to_urdf):
            with pytest.raises(InputError, match=r"has not converged, and is not written .*; allowed: .*--force"):
                write(tmp_path / "found.toml")
    assert load_calibration(found.save(tmp_path / "found.npz")).status == found.status


@pytest.mark.soak
def test_a_wrong_reading_can_be_forced() -> None:
    made = blind()
    found = calibrated(made.robot, made.columns | {"tcp.y": -made.columns["tcp.y"]}, force=True)
    assert any("read as y mirrored" in note for note in report_of(found).warnings), "amber on the page"
    assert not found.is_explained
