"""Stiffness matrices from poses under loads: those of static equilibria of kernels, and what is written of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.analysis import deflection
from eomgen.analysis.options import KERNELS
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import CalibrationResult, calibrate, load_calibration, poses_from_columns
from eomgen.identification.geometry.blocks import blocks_of, unfinished
from eomgen.identification.geometry.compliances import Chosen, compliances_of
from eomgen.identification.geometry.error_model import COMPLIANCE, ErrorModel, ErrorParameter, Rows
from eomgen.identification.geometry.rotations import vector_of
from eomgen.identification.geometry.stations import chain_of, matrix_of
from eomgen.identification.tolerances.contributions import Exact, contributions_of, model_of
from eomgen.robot import Coordinate, JointStiffness, Robot
from eomgen.robot.elements.matrices import PAIRS
from eomgen.robot.elements.matrices import matrix_of as matrix_of_entries
from eomgen.robot.value import COORDINATES
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
TEXT = """name = "arm"
gravity = [0.0, 0.0, -9.81]
[[links]]
name = "upper"
mass = 6.0
com = [0.25, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.1, zz = 0.1 }
[[links]]
name = "fore"
mass = 3.0
com = [0.2, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.06, zz = 0.06 }
[[joints]]
name = "joint1"
parent = "base"
child = "upper"
type = "revolute"
[[joints]]
name = "joint2"
parent = "upper"
child = "fore"
type = "revolute"
placement = { xyz = [0.5, 0.0, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }
x = { stiffness = 2e7, damping = 10.0 }
y = { stiffness = 3e7 }
z = {}
alpha = { stiffness = 8e4 }
beta = { damping = 1.0, stiffness = 9e4 }
[[frames]]
name = "tcp"
link = "fore"
placement = { xyz = [0.4, 0.0, 0.1] }
"""
NAMES = COORDINATES[:5]
LOADS = tuple(f"tcp.{part}" for part in ("fx", "fy", "fz", "mx", "my", "mz"))
PLACES = tuple(f"tcp.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
FIXED = ("joints.joint1.offset", "joints.joint2.offset")
WHOLE = ("joints.joint2.stiffness",)
TABLES = np.array([2e7, 3e7, 0.0, 8e4, 9e4])
SIZES = np.array([2e7, 3e7, 1.5e7, 8e4, 9e4]) ** 0.5


def definite(seed: int) -> Array:
    """The whole stiffness of joint2's deviations."""
    rows = np.random.default_rng(seed).normal(size=(12, 5))
    coupled = rows.T @ rows
    coupled /= np.sqrt(np.outer(np.diag(coupled), np.diag(coupled)))
    return np.asarray(coupled * np.outer(SIZES, SIZES))


K = definite(1)


def described(tmp_path: Path, line: str = "") -> Robot:
    path = tmp_path / "arm.toml"
    path.write_text(TEXT.replace('name = "joint2"\n', f'name = "joint2"\n{line}\n'), encoding="ascii")
    return eomgen.load_robot(path)


def true(robot: Robot, matrix: Array = K) -> Robot:
    joint = robot.joint("joint2")
    bare = {name: Coordinate() for name in joint.coordinates}
    joint = replace(joint, coordinates=bare, stiffness=JointStiffness.of(matrix.tolist(), NAMES))
    return replace(robot, joints=(robot.joints[0], joint))


def loaded(robot: Robot, built: Build, rows: int = 40) -> dict[str, Array]:
    """Columns of poses of the tool under loads, by static equilibria of the robot's kernel."""
    rng, kernel = np.random.default_rng(0), built(robot, *KERNELS)
    q, loads = rng.uniform(-2.0, 2.0, (rows, 2)), rng.uniform(-1.0, 1.0, (rows, 6)) * np.repeat([150.0, 40.0], 3)
    poses = [
        deflection(robot, {"joint1": a, "joint2": b}, frame="tcp", loads={"tcp": load}, kernel=kernel).pose
        for (a, b), load in zip(q.tolist(), loads, strict=True)
    ]
    columns = {"joint1.gamma": q[:, 0], "joint2.gamma": q[:, 1]}
    columns |= {f"tcp.{axis}": np.array([pose[k, 3] for pose in poses]) for k, axis in enumerate("xyz")}
    turns = np.array([vector_of(pose[:3, :3]) for pose in poses])
    columns |= {f"tcp.r{axis}": turns[:, k] for k, axis in enumerate("xyz")}
    return columns | {name: loads[:, k] for k, name in enumerate(LOADS)}


def calibrated(robot: Robot, columns: dict[str, Array], **options: object) -> CalibrationResult:
    poses = poses_from_columns(columns, ["joint1.gamma", "joint2.gamma"], ["tcp"])
    return calibrate(robot, poses, folds=0, **options)


def off_by(found: CalibrationResult, expected: Array = K) -> Array:
    """Errors of the entries, scaled by the diagonal."""
    off = []
    for one, other in PAIRS:
        if one in NAMES and other in NAMES:
            i, j = NAMES.index(one), NAMES.index(other)
            off.append((found[f"joints.joint2.stiffness.{one}.{other}"] - expected[i, j]) / (SIZES[i] * SIZES[j]))
    return np.array(off)


@pytest.mark.soak
def test_a_random_matrix_is_recovered(built: Build, tmp_path: Path) -> None:
    """All fifteen entries, to 1e-6 with known offsets, begun with the diagonal of the tables, z without any."""
    robot = described(tmp_path)
    columns = loaded(true(robot), built)
    exact = calibrated(robot, columns, stiffness=WHOLE, fixed=FIXED)
    assert np.abs(off_by(exact)).max() < 1e-6
    found = calibrated(robot, columns, stiffness=WHOLE)
    assert np.abs(off_by(found)).max() < 3e-4
    before = dict(zip(found.names, found.described, strict=True))
    assert np.isnan(before["joints.joint2.stiffness.x.x"])  # z is rigid there
    units = dict(zip(found.names, found.units, strict=True))
    assert units["joints.joint2.stiffness.x.y"] == "N/m"
    assert units["joints.joint2.stiffness.x.beta"] == "N/rad"
    assert units["joints.joint2.stiffness.alpha.beta"] == "N m/rad"
    again = found.calibrated.joint("joint2")
    assert again.stiffness is not None
    assert set(again.stiffness.coordinates) == set(NAMES)
    assert all(coordinate.stiffness is None for coordinate in again.coordinates.values())
    assert again.coordinates["x"].damping == 10.0
    path = found.save(tmp_path / "c.npz")
    assert load_calibration(path).calibrated == found.calibrated
    written = found.to_toml(tmp_path / "deeper" / "calibrated.toml")
    text = written.read_text(encoding="utf-8")
    assert "beta = { damping = 1.0 }" in text
    assert "# over x, y, z, alpha, beta, gamma; +- x.x " in text
    read = eomgen.load_robot(written)
    assert read.joint("joint2").stiffness == again.stiffness
    rigid = described(tmp_path, f"stiffness = {{ matrix = {np.pad(1.05 * K, (0, 1)).tolist()} }}")
    bare = replace(rigid.joints[1], coordinates=true(rigid).joints[1].coordinates)
    bare = replace(rigid, joints=(rigid.joints[0], bare))
    twice = calibrated(bare, columns, fixed=FIXED)  # without being asked, where the description has a matrix
    assert np.abs(off_by(twice)).max() < 1e-6
    named = dict(zip(twice.names, twice.described, strict=True))
    assert named["joints.joint2.stiffness.x.beta"] == pytest.approx(1.05 * K[0, 4])


def test_all_entries_of_a_group_are_its_compliances(built: Build, tmp_path: Path) -> None:
    robot = described(tmp_path)
    parted = np.zeros((5, 5))
    for group in ([0, 4], [1], [2], [3]):
        parted[np.ix_(group, group)] = K[np.ix_(group, group)]
    columns = loaded(true(robot, parted), built)
    pairs = ("x.x", "x.beta", "beta.beta")
    found = calibrated(robot, columns, stiffness=[*(f"joints.joint2.stiffness.{pair}" for pair in pairs), "joint2.z"])
    entries = [name for name in found.names if ".stiffness" in name]
    assert entries == [
        *("joints.joint2.y.stiffness", "joints.joint2.z.stiffness", "joints.joint2.alpha.stiffness"),
        *(f"joints.joint2.stiffness.{pair}" for pair in pairs),
    ]
    assert found["joints.joint2.stiffness.x.beta"] == pytest.approx(K[0, 4], rel=1e-5)
    assert found["joints.joint2.stiffness.x.x"] == pytest.approx(K[0, 0], rel=1e-5)
    assert found["joints.joint2.z.stiffness"] == pytest.approx(K[2, 2], rel=1e-5)
    joint = found.calibrated.joint("joint2")
    assert joint.coordinates["x"].stiffness is None
    assert joint.coordinates["y"].stiffness == pytest.approx(K[1, 1], rel=1e-5)
    assert joint.stiffness is not None
    assert joint.stiffness.coordinates == ("x", "beta")


def test_chosen_entries_stand_beside_what_is_described(built: Build, tmp_path: Path) -> None:
    """Two entries to 1e-6; of their joint all else stays, tables of coordinates that they couple, too."""
    wrong = K.copy()
    wrong[[0, 4], [4, 0]] *= 0.9
    wrong[1, 1] *= 1.2
    robot = described(tmp_path, f"stiffness = {{ matrix = {np.pad(wrong, (0, 1)).tolist()} }}")
    columns = loaded(true(robot, K + np.diag(TABLES)), built)
    chosen = [f"joints.joint2.stiffness.{pair}" for pair in ("beta.x", "y.y")]
    found = calibrated(robot, columns, stiffness=chosen, fixed=FIXED)
    names = ["joints.joint2.stiffness.x.beta", "joints.joint2.stiffness.y.y"]
    assert [name for name in found.names if "stiffness" in name] == names
    assert found[names[0]] == pytest.approx(K[0, 4], rel=1e-6)
    assert found[names[1]] == pytest.approx(K[1, 1] + TABLES[1], rel=1e-6)
    before = dict(zip(found.names, found.described, strict=True))
    assert before[names[0]] == pytest.approx(wrong[0, 4])
    assert before[names[1]] == pytest.approx(wrong[1, 1] + TABLES[1])
    joint = found.calibrated.joint("joint2")
    assert joint.stiffness is not None
    assert joint.coordinates["x"].stiffness is None
    assert joint.coordinates["alpha"].stiffness == 8e4
    whole = np.array(matrix_of_entries(joint.stiffness.entries, NAMES)) + np.diag([0.0, 0.0, 0.0, 8e4, 0.0])
    np.testing.assert_allclose(whole, K + np.diag(TABLES), rtol=1e-6, atol=1e-6 * K[3, 3])
    assert load_calibration(found.save(tmp_path / "c.npz")).calibrated == found.calibrated
    assert eomgen.load_robot(found.to_toml(tmp_path / "b.toml")).joint("joint2").stiffness == joint.stiffness
    kept = calibrated(robot, columns, fixed=[*FIXED, "joints.joint2.stiffness"])
    assert not any("stiffness" in name for name in kept.names)


def test_a_chosen_entry_between_coordinates_with_tables(built: Build, tmp_path: Path) -> None:
    """Their tables count, and go into the matrix that is written; others of the joint are found."""
    robot = described(tmp_path)
    coupled = np.diag([*TABLES[:2], K[2, 2], *TABLES[3:]])
    coupled[[0, 4], [4, 0]] = 0.4 * np.sqrt(TABLES[0] * TABLES[4])
    coupled[1, 1] *= 0.7
    columns = loaded(true(robot, coupled), built)
    found = calibrated(robot, columns, stiffness=["joints.joint2.stiffness.x.beta", "joint2.z"], fixed=FIXED)
    assert [name for name in found.names if "stiffness" in name] == [
        *("joints.joint2.y.stiffness", "joints.joint2.z.stiffness", "joints.joint2.alpha.stiffness"),
        "joints.joint2.stiffness.x.beta",
    ]
    assert found["joints.joint2.stiffness.x.beta"] == pytest.approx(coupled[0, 4], rel=1e-6)
    assert found["joints.joint2.y.stiffness"] == pytest.approx(coupled[1, 1], rel=1e-6)
    joint = found.calibrated.joint("joint2")
    assert joint.stiffness is not None
    assert dict(joint.stiffness.entries) == {
        "x.x": TABLES[0],
        "x.beta": found["joints.joint2.stiffness.x.beta"],
        "beta.beta": TABLES[4],
    }
    said = r"some entries of joint2\.stiffness are sought, and nothing holds 'joint2\.z' in the description"
    with pytest.raises(InputError, match=said):
        calibrated(robot, columns, stiffness=["joints.joint2.stiffness.x.z"])


SOME = tuple(f"joints.joint2.stiffness.{pair}" for pair in ("x.y", "x.beta", "z.z", "alpha.beta"))


@pytest.mark.parametrize("fixed", [FIXED, ()], ids=["known offsets", "unknown offsets"])
@pytest.mark.parametrize("names", [WHOLE, SOME], ids=["whole", "entries"])
@pytest.mark.parametrize("runs", [2, pytest.param(15, marks=pytest.mark.soak)])
def test_intervals_cover_with_noise(
    runs: int, names: tuple[str, ...], fixed: tuple[str, ...], built: Build, tmp_path: Path
) -> None:
    """Offsets move the origin that the matrix is about, and with it what its couplings are."""
    robot, inside = described(tmp_path), []
    if names == SOME:
        rows, columns = [0, 0, 2, 3], [1, 4, 2, 4]
        wrong = K.copy()
        wrong[rows, columns] *= 0.9
        wrong[columns, rows] = wrong[rows, columns]
        robot = described(tmp_path, f"stiffness = {{ matrix = {np.pad(wrong, (0, 1)).tolist()} }}")
        bare = replace(robot.joints[1], coordinates=true(robot).joints[1].coordinates)
        robot = replace(robot, joints=(robot.joints[0], bare))
    exact = loaded(true(robot), built)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        off = {name: rng.normal(scale=4e-7 if "r" in name else 2e-7, size=exact[name].size) for name in PLACES}
        columns = exact | {name: exact[name] + noise for name, noise in off.items()}
        found = calibrated(robot, columns, stiffness=names, fixed=fixed)
        deviations = dict(zip(found.names, found.deviations, strict=True))
        for one, other in PAIRS:
            name = f"joints.joint2.stiffness.{one}.{other}"
            if name in deviations:
                value = K[NAMES.index(one), NAMES.index(other)]
                inside.append(abs(found[name] - value) <= found.quantile * deviations[name])
    assert len(inside) == (15 if names == WHOLE else 4) * runs
    assert np.mean(inside) >= (0.9 if len(inside) > 8 else 0.75)


def test_what_loads_do_not_show_is_named(built: Build, tmp_path: Path) -> None:
    """Without loads and gravity nothing deflects."""
    robot = replace(described(tmp_path), gravity=(0.0, 0.0, 0.0))
    columns = loaded(true(robot), built)
    columns |= {name: 0.0 * columns[name] for name in LOADS}
    found = calibrated(robot, columns, stiffness=WHOLE)
    for name in ("joints.joint2.stiffness.x.beta", "joints.joint2.stiffness.y.y"):
        assert "no load" in found.merged[name]


def test_sensitivities_are_derivatives_and_deflections_linear_algebra(tmp_path: Path) -> None:
    robot = described(tmp_path, f"stiffness = {{ matrix = {np.pad(K, (0, 1)).tolist()} }}")
    chain = chain_of(robot, {"tcp": ("fore", matrix_of(robot.frames[0].placement))})
    parameters = tuple(compliances_of(chain, robot))
    (block,) = blocks_of(parameters)
    assert [COORDINATES[c] for c in block.coordinates] == list(NAMES)
    assert not unfinished(parameters)
    assert unfinished(parameters[:3] + parameters[4:]).startswith("joints.joint2.stiffness.")
    assert unfinished((replace(parameters[0], factor="entry"), *parameters[1:])) == parameters[0].name
    whole = K + np.diag(TABLES)
    model = ErrorModel(robot, chain, parameters, {0: np.eye(4)})
    np.testing.assert_allclose(block.stiffness(model.nominal), whole, rtol=1e-9)
    readings = np.zeros((3, len(chain.stations), 6))
    readings[:, 1:3, 5] = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 2))
    wrench = np.random.default_rng(3).normal(size=(3, 6)) * 50.0
    tool = chain.tools["tcp"]
    rows = Rows(readings, np.zeros(3, dtype=np.int64), {tool: wrench}, np.zeros((3, len(chain.stations))), None)
    state = model.at(model.nominal, rows)
    S = state.sensitivities(tool)
    forces = model.forces(state.located, rows)[:, 2, :5]
    bent = np.zeros((3, len(chain.stations), 6)) + readings
    bent[:, 2, :5] = np.linalg.solve(whole, forces[..., np.newaxis])[..., 0]
    rigid = replace(model, parameters=())
    moved = rigid.at(np.zeros(0), replace(rows, readings=bent))
    np.testing.assert_allclose(state.located.p[tool], moved.located.p[tool], atol=1e-9)
    for i, parameter in enumerate(parameters):
        step = np.zeros(len(parameters))
        step[i] = 1e-3 * parameter.size
        ahead, behind = (model.at(model.nominal + sign * step, rows).located for sign in (1.0, -1.0))
        slope = (ahead.p[tool] - behind.p[tool]) / (2.0 * step[i])
        np.testing.assert_allclose(S[:, :3, i], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max() + 1e-12)
    slopes = block.slopes(whole)
    C = np.linalg.inv(whole)
    for column, (_, a, b) in enumerate(block.pairs):
        change = np.zeros((5, 5))
        change[a, b] = change[b, a] = 1e-6 * np.sqrt(C[a, a] * C[b, b])
        found = (np.linalg.inv(C + change) - np.linalg.inv(C - change)) / (2.0 * change[a, b])
        for row, (_, i, j) in enumerate(block.pairs):
            assert slopes[row, column] == pytest.approx(found[i, j], rel=1e-5, abs=1e-5 * np.abs(found).max())


def test_sensitivities_to_entries_are_derivatives(tmp_path: Path) -> None:
    """Of K itself, where one of its entries stays, through what moves the loads, too."""
    robot = described(tmp_path, f"stiffness = {{ matrix = {np.pad(0.02 * K, (0, 1)).tolist()} }}")
    chain = chain_of(robot, {"tcp": ("fore", matrix_of(robot.frames[0].placement))})
    parameters = tuple(compliances_of(chain, robot, Chosen(couplings={("joints", "joint2"): [("x", "beta")]})))
    assert {parameter.factor for parameter in parameters} == {"entry"}
    model = ErrorModel(robot, chain, parameters, {0: np.eye(4)})
    (block,) = model.blocks
    np.testing.assert_allclose(block.stiffness(model.nominal), 0.02 * K + np.diag(TABLES), rtol=1e-12)
    readings = np.zeros((3, len(chain.stations), 6))
    readings[:, 1:3, 5] = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 2))
    wrench, tool = np.random.default_rng(3).normal(size=(3, 6)) * 50.0, chain.tools["tcp"]
    rows = Rows(readings, np.zeros(3, dtype=np.int64), {tool: wrench}, np.zeros((3, len(chain.stations))), None)
    S = model.at(model.nominal, rows).sensitivities(tool)
    for i, parameter in enumerate(parameters):
        step = np.zeros(len(parameters))
        step[i] = 1e-3 * parameter.size
        ahead, behind = (model.at(model.nominal + sign * step, rows).located for sign in (1.0, -1.0))
        slope = (ahead.p[tool] - behind.p[tool]) / (2.0 * step[i])
        np.testing.assert_allclose(S[:, :3, i], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max() + 1e-18)


def test_tolerances_of_entries(tmp_path: Path) -> None:
    """A table may name entries: deflections are those of the matrix that they make together."""
    robot = described(tmp_path, f"stiffness = {{ matrix = {np.pad(K, (0, 1)).tolist()} }}")
    chain = chain_of(robot, {"tcp": ("fore", matrix_of(robot.frames[0].placement))})
    model, whole = model_of(robot, chain, None), K + np.diag(TABLES)
    known = contributions_of(model)
    chosen = [known["joints.joint2.stiffness.x.beta"], known["joints.joint2.stiffness.y.y"]]
    assert chosen[0].described == pytest.approx(K[0, 4])
    assert chosen[1].described == pytest.approx(whole[1, 1])
    rows = Rows(np.zeros((1, len(chain.stations), 6)), np.zeros(1, dtype=np.int64), {}, np.zeros((1, 9)), None)
    exact = Exact(model, rows, chain.tools["tcp"], tuple(chosen))
    y = np.array([[0.02 * K[0, 4], 0.0], [5e4, 0.0]])
    x = exact.values(y)
    changed = whole.copy()
    changed[0, 4] = changed[4, 0] = 1.02 * K[0, 4]
    changed[1, 1] += 5e4
    (block,) = blocks_of(model.parameters)
    np.testing.assert_allclose(x[:, 0][block.index], np.linalg.inv(changed), rtol=1e-8, atol=1e-15)
    np.testing.assert_allclose(x[:, 1], model.nominal, rtol=1e-12)
    assert [one.is_stiffness for one in chosen] == [False, True]
    with pytest.raises(InputError, match=r"deviations of its entries make joints\.joint2\.stiffness indefinite"):
        exact.values(np.array([[0.0], [-whole[1, 1]]]))


def test_an_indefinite_matrix_is_said_and_not_written(built: Build, tmp_path: Path) -> None:
    robot = described(tmp_path)
    columns = loaded(true(robot), built)
    columns["tcp.x"] = columns["tcp.x"] - 1e-5 * columns["tcp.fx"]  # the tool goes against its load
    columns["tcp.y"] = columns["tcp.y"] - 1e-5 * columns["tcp.fy"]
    columns["tcp.z"] = columns["tcp.z"] - 1e-5 * columns["tcp.fz"]
    found = calibrated(robot, columns, stiffness=WHOLE)
    assert any("joint2.stiffness between x, y, z, alpha, beta is not positive semidefinite" in x for x in found.notes)
    assert found.calibrated.joint("joint2").stiffness is None
    assert "# joints.joint2.stiffness.x.beta = " in found.to_toml(tmp_path / "b.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("stiffness", "error", "said"),
    [
        ("joints.joint3.stiffness", UnknownNameError, "'joints.joint3.stiffness' names no entry; did you mean"),
        ("joints.joint2.stiffness.x.q", UnknownNameError, "names no entry"),
        ("joints.joint2.damping.x.y", InputError, r"joint2\.damping\.x\.y is a damping; allowed: entries of stiffness"),
        ("joint2.q", UnknownNameError, "there is no coordinate 'joint2.q'"),
    ],
)
def test_wrong_names_are_refused(stiffness: str, error: type[InputError], said: str, tmp_path: Path) -> None:
    columns = dict(
        zip(("joint1.gamma", "joint2.gamma", *PLACES[:3]), np.random.default_rng(1).normal(size=(5, 30)), strict=True)
    )
    with pytest.raises(error, match=said):
        calibrated(described(tmp_path), columns, stiffness=[stiffness])


def test_a_matrix_without_an_inverse_is_refused_by_name(tmp_path: Path) -> None:
    matrix = np.zeros((6, 6))
    matrix[np.ix_([0, 4], [0, 4])] = [[1.0, -10.0], [-10.0, 100.0]]
    robot = described(tmp_path, f"stiffness = {{ matrix = {matrix.tolist()} }}")
    joint = robot.joint("joint2")
    joint = replace(joint, coordinates={name: Coordinate() for name in joint.coordinates})
    robot = replace(robot, joints=(robot.joints[0], joint))
    columns = dict(
        zip(("joint1.gamma", "joint2.gamma", *PLACES[:3]), np.random.default_rng(1).normal(size=(5, 30)), strict=True)
    )
    with pytest.raises(InputError, match=r"joint2\.stiffness: nothing holds a motion along 'x', 'beta' together"):
        calibrated(robot, columns)


@pytest.mark.soak
def test_files_of_matrices_are_found_from_where_the_result_is_written(built: Build, tmp_path: Path) -> None:
    robot = described(tmp_path)
    np.savez(tmp_path / "K.npz", np.diag([1e6, 0.0, 0.0, 0.0, 5e3, 0.0]))
    text = TEXT.replace('name = "joint1"\n', 'name = "joint1"\nx = {}\nbeta = {}\nstiffness = { matrix = "K.npz" }\n')
    (tmp_path / "b.toml").write_text(text, encoding="ascii")
    other = eomgen.load_robot(tmp_path / "b.toml")
    found = calibrated(other, loaded(true(robot), built), fixed=["joints.joint1.stiffness"])
    for place in ("deeper", "new/and deeper"):  # folders that are made for it
        written = found.to_toml(tmp_path / place / "c.toml")
        assert eomgen.load_robot(written).joint("joint1").stiffness == other.joint("joint1").stiffness


def test_parameters_of_files_are_checked(tmp_path: Path) -> None:
    parameter = ErrorParameter("a", COMPLIANCE, 1, 0, "force", 0.0, 1.0, other=4)
    assert (parameter.unit, parameter.is_diagonal) == ("N/rad", False)
    assert replace(parameter, other=0).is_diagonal
