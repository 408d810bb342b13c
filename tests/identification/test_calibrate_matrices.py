"""Stiffness matrices of joints and loop joints from poses under loads, which are static equilibria of kernels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis import deflection
from eomgen.analysis.options import KERNELS
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import CalibrationResult, calibrate, load_calibration
from eomgen.identification.geometry.blocks import blocks_of, unfinished
from eomgen.identification.geometry.compliances import Chosen, compliances_of
from eomgen.identification.geometry.error_model import COMPLIANCE, ErrorModel, ErrorParameter, Rows
from eomgen.identification.geometry.rotations import coordinates_of, vectors_of
from eomgen.identification.geometry.stations import chain_of, matrix_of
from eomgen.identification.tolerances.contributions import Exact, contributions_of, model_of
from eomgen.motion.turns import rotation_of
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.robot import Coordinate, JointStiffness, Robot
from eomgen.robot.elements.matrices import PAIRS
from eomgen.robot.elements.matrices import matrix_of as matrix_of_entries
from eomgen.robot.value import COORDINATES
from tests.loops.test_elastic_cuts import linkages
from tests.support.builds import Build
from tests.support.joint_table import frame_table, joint_table, link_table, loop_table
from tests.support.measurements import assert_slopes, calibrated, placed, poses_of
from tests.support.random_robots import Array
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

HEAD = f"""name = "arm"
gravity = [0.0, 0.0, -9.81]
driven = ["joint1.gamma", "joint2.gamma"]
{link_table("upper", 6.0, (0.25, 0.0, 0.0), (0.01, 0.1, 0.1))}
{link_table("fore", 3.0, (0.2, 0.0, 0.0), (0.01, 0.06, 0.06))}
{joint_table("joint1", "base", "upper", "revolute")}
{joint_table("joint2", "upper", "fore", "revolute")}
placement = {{ xyz = [0.5, 0.0, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }}
"""
TEXT = f"""{HEAD}
x = {{ stiffness = 2e7, damping = 10.0 }}
y = {{ stiffness = 3e7 }}
z = {{}}
alpha = {{ stiffness = 8e4 }}
beta = {{ damping = 1.0, stiffness = 9e4 }}
{frame_table("tcp", "fore", (0.4, 0.0, 0.1))}
"""
NAMES = COORDINATES[:5]
LOADS = tuple(f"tcp.{part}" for part in ("fx", "fy", "fz", "mx", "my", "mz"))
PLACES = tuple(f"tcp.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
RANDOM = dict(
    zip(("joint1.gamma", "joint2.gamma", *PLACES[:3]), np.random.default_rng(1).normal(size=(5, 30)), strict=True)
)
FIXED = ("joints.joint1.offset", "joints.joint2.offset")
WHOLE = ("joints.joint2.stiffness",)
TABLES = np.array([2e7, 3e7, 0.0, 8e4, 9e4])
SIZES = np.array([2e7, 3e7, 1.5e7, 8e4, 9e4]) ** 0.5


def definite(sizes: Array, rows: int) -> Array:
    """A random stiffness with couplings, of these square roots of its diagonal."""
    normal = np.random.default_rng(1).normal(size=(rows, len(sizes)))
    coupled = normal.T @ normal
    coupled /= np.sqrt(np.outer(np.diag(coupled), np.diag(coupled)))
    return np.asarray(coupled * np.outer(sizes, sizes))


K = definite(SIZES, 12)


def described(tmp_path: Path, matrix: Array | None = None, text: str = TEXT) -> Robot:
    """The robot of the text, whose joint2 has this stiffness, by whose last rows nothing is held."""
    path = tmp_path / "arm.toml"
    if matrix is not None:
        whole = np.pad(matrix, (0, 6 - len(matrix))).tolist()
        text = text.replace('name = "joint2"\n', f'name = "joint2"\nstiffness = {{ matrix = {whole} }}\n')
    path.write_text(text, encoding="ascii")
    return eomgen.load_robot(path)


def true(robot: Robot, matrix: Array = K) -> Robot:
    joint = robot.joint("joint2")
    bare = {name: Coordinate() for name in joint.coordinates}
    joint = replace(joint, coordinates=bare, stiffness=JointStiffness.of(matrix.tolist(), NAMES))
    return replace(robot, joints=(robot.joints[0], joint))


def loaded(robot: Robot, built: Build) -> dict[str, Array]:
    """Columns of poses of the tool under loads, by static equilibria of the robot's kernel."""
    rng, kernel = np.random.default_rng(0), built(robot, *KERNELS, *(["frame_pose"] if robot.loops else []))
    rows, far = (20, 0.7) if robot.loops else (40, 2.0)
    q, loads = rng.uniform(-far, far, (rows, 2)), rng.uniform(-1.0, 1.0, (rows, 6)) * np.repeat([150.0, 40.0], 3)
    poses = []
    for (a, b), load in zip(q.tolist(), loads, strict=True):
        start = {"joint1": a, "joint2": b}
        if robot.loops:  # the tool begins where the rigid flange holds it
            flange = np.asarray(kernel.frame_pose(np.array([a, b, *(6 * [0.0])]), "fore"))
            place = np.linalg.inv(matrix_of(robot.joint("carrier").placement))
            six = coordinates_of(place @ flange @ matrix_of(robot.loops[0].placements[0])).tolist()
            start |= {f"carrier.{name}": value for name, value in zip(COORDINATES, six, strict=True)}
        poses.append(deflection(robot, start, frame="tcp", loads={"tcp": load}, kernel=kernel).pose)
    columns = {"joint1.gamma": q[:, 0], "joint2.gamma": q[:, 1], **dict(zip(LOADS, loads.T, strict=True))}
    return columns | placed(np.array(poses)[:, :3, 3], np.array(poses)[:, :3, :3])


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
    rigid = described(tmp_path, 1.05 * K)
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
    assert found["joints.joint2.y.stiffness"] == pytest.approx(K[1, 1], rel=1e-5)
    assert joint.coordinates["y"].stiffness == pytest.approx(K[1, 1], rel=1e-3)  # fitted without that of z
    assert joint.stiffness.coordinates == ("x", "beta")


def test_chosen_entries_stand_beside_what_is_described(built: Build, tmp_path: Path) -> None:
    """Two entries to 1e-6; of their joint all else stays, tables of coordinates that they couple, too."""
    wrong = K.copy()
    wrong[[0, 4], [4, 0]] *= 0.9
    wrong[1, 1] *= 1.2
    robot = described(tmp_path, wrong)
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
    entries = {"x.x": TABLES[0], "x.beta": found["joints.joint2.stiffness.x.beta"], "beta.beta": TABLES[4]}
    assert dict(joint.stiffness.entries) == pytest.approx(entries, rel=1e-6)
    assert any(note.startswith(".toml cannot have 'joints.joint2.z.stiffness'") for note in found.notes)
    said = r"some entries of joint2\.stiffness are sought, and nothing holds 'joint2\.z' in the description"
    refused(InputError, said, calibrated, robot, columns, stiffness=["joints.joint2.stiffness.x.z"])


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
        robot = described(tmp_path, wrong)
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
    robot = described(tmp_path, K)
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
    assert_slopes(S[:, :3], lambda x: model.at(x, rows).located.p[tool], model.nominal, 1e-3 * model.sizes, 1e-6, 1e-12)
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
    robot = described(tmp_path, 0.02 * K)
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
    S = model.at(model.nominal, rows).sensitivities(tool)[:, :3]
    assert_slopes(S, lambda x: model.at(x, rows).located.p[tool], model.nominal, 1e-3 * model.sizes, 1e-5, 1e-18)


def test_tolerances_of_entries(tmp_path: Path) -> None:
    """A table may name entries: deflections are those of the matrix that they make together."""
    robot = described(tmp_path, K)
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
    refused(error, said, calibrated, described(tmp_path), RANDOM, stiffness=[stiffness])


def test_a_matrix_without_an_inverse_is_refused_by_name(tmp_path: Path) -> None:
    matrix = np.zeros((6, 6))
    matrix[np.ix_([0, 4], [0, 4])] = [[1.0, -10.0], [-10.0, 100.0]]
    robot = described(tmp_path, matrix)
    joint = robot.joint("joint2")
    joint = replace(joint, coordinates={name: Coordinate() for name in joint.coordinates})
    robot = replace(robot, joints=(robot.joints[0], joint))
    with pytest.raises(InputError, match=r"joint2\.stiffness: nothing holds a motion along 'x', 'beta' together"):
        calibrated(robot, RANDOM)


@pytest.mark.soak
def test_files_of_matrices_are_found_from_where_the_result_is_written(built: Build, tmp_path: Path) -> None:
    robot = described(tmp_path)
    np.savez(tmp_path / "K.npz", np.diag([1e6, 0.0, 0.0, 0.0, 5e3, 0.0]))
    text = TEXT.replace('name = "joint1"\n', 'name = "joint1"\nx = {}\nbeta = {}\nstiffness = { matrix = "K.npz" }\n')
    (tmp_path / "b.toml").write_text(text, encoding="ascii")
    other = eomgen.load_robot(tmp_path / "b.toml")
    found = calibrated(other, loaded(true(robot), built), fixed=["joints.joint1.stiffness"])
    for place in ("deeper", "new/and deeper"):  # folders that are made for it
        written = found.to_toml(tmp_path / place / "c.toml", force=True)  # of a spring that the loads' robot has not
        assert eomgen.load_robot(written).joint("joint1").stiffness == other.joint("joint1").stiffness


def test_parameters_of_files_are_checked() -> None:
    parameter = ErrorParameter("a", COMPLIANCE, 1, 0, "force", 0.0, 1.0, other=4)
    assert (parameter.unit, parameter.is_diagonal) == ("N/rad", False)
    assert replace(parameter, other=0).is_diagonal


# Loop joints


LOOP_TEXT = f"""{HEAD}
{link_table("tool", 4.0, (0.05, 0.02, 0.01), (0.01, 0.02, 0.02))}
{joint_table("carrier", "base", "tool", "fixed")}
placement = {{ xyz = [0.9, -0.1, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }}
x = {{}}
y = {{}}
z = {{}}
alpha = {{}}
beta = {{}}
gamma = {{}}
{loop_table("flange", "fore", "tool", "fixed")}
placements = [{{ xyz = [0.4, 0.0, 0.1] }}, {{}}]
x = {{ stiffness = 2e7, damping = 10.0 }}
y = {{ stiffness = 3e7 }}
z = {{ stiffness = 1e7 }}
alpha = {{ stiffness = 8e4 }}
beta = {{ damping = 1.0, stiffness = 9e4 }}
gamma = {{ stiffness = 7e4 }}
{frame_table("tcp", "tool", (0.1, 0.05, 0.02))}
"""
LOOP_TABLES = np.array([2e7, 3e7, 1e7, 8e4, 9e4, 7e4])
LOOP_SIZES = (np.array([1.1, 0.8, 1.3, 0.9, 1.2, 0.7]) * LOOP_TABLES) ** 0.5
LOOP_FIXED = ("joints", "loops.flange.offset", "loops.flange.second")
LOOP_WHOLE = ("loops.flange.stiffness",)
LOOP_K = definite(LOOP_SIZES, 14)
LOOP_NAMES = {pair: f"loops.flange.stiffness.{pair[0]}.{pair[1]}" for pair in PAIRS}


def with_matrix(robot: Robot, matrix: Array, names: tuple[str, ...] = COORDINATES) -> Robot:
    """The robot with this stiffness of its loop joint's coordinates, and none in tables."""
    (loop,) = robot.loops
    bare = {name: Coordinate() for name in loop.coordinates}
    return replace(robot, loops=(replace(loop, coordinates=bare, stiffness=JointStiffness.of(matrix.tolist(), names)),))


def loop_off_by(found: CalibrationResult, expected: Array) -> float:
    """Largest error of the entries that were found, scaled by the diagonal."""
    size = np.sqrt(np.diag(expected))
    off = [
        (found[name] - expected[i, j]) / (size[i] * size[j])
        for (one, other), name in LOOP_NAMES.items()
        for i, j in [(COORDINATES.index(one), COORDINATES.index(other))]
        if name in found.names
    ]
    return float(np.abs(off).max())


@pytest.mark.soak
def test_a_random_matrix_of_a_loop_joint_is_recovered(built: Build, tmp_path: Path) -> None:
    """All 21 entries to 1e-6 with known offsets, begun with the tables; and again where it is described."""
    robot = described(tmp_path, text=LOOP_TEXT)
    columns = loaded(with_matrix(robot, LOOP_K), built)
    found = calibrated(robot, columns, stiffness=LOOP_WHOLE, fixed=LOOP_FIXED)
    assert set(LOOP_NAMES.values()) <= set(found.names)
    assert loop_off_by(found, LOOP_K) < 1e-6
    units = dict(zip(found.names, found.units, strict=True))
    assert units[LOOP_NAMES["x", "beta"]] == "N/rad"
    (loop,) = found.calibrated.loops
    assert all(coordinate.stiffness is None for coordinate in loop.coordinates.values())
    assert loop.coordinates["beta"].damping == 1.0
    again = load_calibration(found.save(tmp_path / "c.npz"))
    assert again.calibrated == found.calibrated
    q = np.array([[0.3, -0.4]])
    np.testing.assert_array_equal(again.predict(q, "tcp")[0], found.predict(q, "tcp")[0])
    written = eomgen.load_robot(found.to_toml(tmp_path / "calibrated.toml"))
    assert written.loops[0].stiffness == loop.stiffness
    assert written.loops[0].coordinates["x"] == Coordinate(damping=10.0)
    twice = calibrated(with_matrix(robot, 1.05 * LOOP_K), columns, fixed=LOOP_FIXED)  # without being asked
    assert loop_off_by(twice, LOOP_K) < 1e-6
    assert dict(zip(twice.names, twice.described, strict=True))[LOOP_NAMES["x", "beta"]] == pytest.approx(
        1.05 * LOOP_K[0, 4]
    )


def test_tables_of_a_loop_joint_are_found(built: Build, tmp_path: Path) -> None:
    """Single coordinates are fitted in any case, as those of joints."""
    robot, six = described(tmp_path, text=LOOP_TEXT), np.diag(LOOP_SIZES**2)
    found = calibrated(robot, loaded(with_matrix(robot, six), built), fixed=LOOP_FIXED)
    for c, name in enumerate(COORDINATES):
        assert found[f"loops.flange.{name}.stiffness"] == pytest.approx(six[c, c], rel=1e-6)
        assert found.calibrated.loops[0].coordinates[name].stiffness == found[f"loops.flange.{name}.stiffness"]
    written = found.to_toml(tmp_path / "calibrated.toml")
    assert eomgen.load_robot(written).loops[0].coordinates == found.calibrated.loops[0].coordinates


def test_chosen_entries_of_a_loop_joint_stand_beside_what_is_described(built: Build, tmp_path: Path) -> None:
    wrong = LOOP_K.copy()
    wrong[[0, 4], [4, 0]] *= 0.9
    wrong[1, 1] *= 1.2
    robot = described(tmp_path, text=LOOP_TEXT)
    columns = loaded(with_matrix(robot, LOOP_K), built)
    chosen = ["loops.flange.stiffness.beta.x", "loops.flange.stiffness.y.y"]
    found = calibrated(with_matrix(robot, wrong), columns, stiffness=chosen, fixed=LOOP_FIXED)
    assert [name for name in found.names if "stiffness" in name] == [LOOP_NAMES["x", "beta"], LOOP_NAMES["y", "y"]]
    assert loop_off_by(found, LOOP_K) < 1e-6
    assert load_calibration(found.save(tmp_path / "c.npz")).calibrated == found.calibrated


@pytest.mark.soak
def test_intervals_of_a_loop_joint_cover_with_noise(built: Build, tmp_path: Path) -> None:
    """Where the device stands and where the tool is measured is found, too."""
    robot, inside = described(tmp_path, text=LOOP_TEXT), []
    exact = loaded(with_matrix(robot, LOOP_K), built)
    for seed in range(10, 15):
        rng = np.random.default_rng(seed)
        off = {name: rng.normal(scale=4e-7 if "r" in name else 2e-7, size=exact[name].size) for name in PLACES}
        columns = exact | {name: exact[name] + off[name] for name in PLACES[:3]}
        turns, small = (np.stack([x[name] for name in PLACES[3:]], axis=1) for x in (exact, off))
        columns |= dict(zip(PLACES[3:], vectors_of(rotation_of(small) @ rotation_of(turns)).T, strict=True))
        found = calibrated(robot, columns, stiffness=LOOP_WHOLE, fixed=LOOP_FIXED)
        deviations = dict(zip(found.names, found.deviations, strict=True))
        for (one, other), name in LOOP_NAMES.items():
            value = LOOP_K[COORDINATES.index(one), COORDINATES.index(other)]
            inside.append(abs(found[name] - value) <= found.quantile * deviations[name])
    assert len(inside) == 21 * 5
    assert np.mean(inside) >= 0.9


def test_a_linkage_whose_pin_gives_way(built: Build) -> None:
    """x and y of a pin that closes four bars: what its other coordinates hold is said by name."""
    matrix, names = np.array([[3e5, 8e4], [8e4, 5e5]]), ("x", "y")
    home = {"motor.gamma": 1.0, "pin.gamma": -0.5, "pivot.gamma": 1.44}
    there = replace(linkages("x = {}\ny = {}\ngamma = {}\n")[0], home=home)
    true, begun, rng = (
        with_matrix(there, matrix, names),
        with_matrix(there, 0.7 * matrix, names),
        np.random.default_rng(4),
    )
    kernel = built(true, *KERNELS, *mechanism_kernels(true), "cut_forces", "cut_jacobian")
    angles, loads = np.linspace(0.6, 1.4, 30), rng.uniform(-50.0, 50.0, (30, 2))
    load = np.pad(loads, ((0, 0), (0, 4)))
    stiff = replace(there, loops=(replace(there.loops[0], coordinates={}),))
    rigid = built(stiff, *mechanism_kernels(stiff))
    poses, q = [], np.array([1.0, -0.5, 1.44])
    for angle, wrench in zip(angles.tolist(), load, strict=True):
        q = rigid.assemble(np.array([angle, *q[1:]]), ["motor.gamma"])
        start = dict(zip(kernel.coordinates, q.tolist(), strict=True))
        poses.append(deflection(true, start, frame="coupler", loads={"coupler": wrench}, kernel=kernel).pose)
    columns = {"motor.gamma": angles, "coupler.fx": loads[:, 0], "coupler.fy": loads[:, 1]}
    columns |= placed(np.array(poses)[:, :3, 3], np.array(poses)[:, :3, :3], "coupler")
    given = poses_of(begun, columns, "coupler")
    found = calibrate(begun, given, folds=0, fixed=("joints", "loops.cut.offset", "loops.cut.second"))
    for (i, j), pair in (((0, 0), "x.x"), ((0, 1), "x.y"), ((1, 1), "y.y")):
        assert found[f"loops.cut.stiffness.{pair}"] == pytest.approx(matrix[i, j], rel=1e-5)
    with pytest.raises(InputError, match=r"stiffness: cut\.z is held by the loops, too; allowed: drives of linkage"):
        calibrate(begun, given, folds=0, stiffness=["cut.z"])
