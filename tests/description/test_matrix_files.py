"""Matrices of joints, and matrices out of files: what is read, and all else refused by file, line and value."""

from __future__ import annotations

import json
import os
import pickle
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import io, sparse

import eomgen
from eomgen.authoring.check import check_file
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.description.matrix_files import ENDINGS, read_matrix
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.pictures import report_of
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot import JointDamping, JointStiffness, Robot, record_of, robot_hash, robot_of
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import least_of, number_of
from eomgen.robot.value import COORDINATES
from eomgen.scenario.load import scenario_from_toml
from tests.support.joint_table import joint_table, link_table
from tests.support.refusals import refused
from tests.support.small_robots import free_body
from tests.support.text_files import text_file

pytestmark = pytest.mark.quick
TEXT = f"""name = "test"
{link_table("plate", 2, inertia=(0.1, 0.1, 0.1))}
{joint_table("mount", "base", "plate", "fixed")}
x = {{}}
z = {{}}
beta = {{}}
stiffness = {{ matrix = "K" }}
"""


def symmetric(seed: int, size: int) -> NDArray[np.float64]:
    rows = np.random.default_rng(seed).normal(size=(size + 1, size))
    return np.asarray(1e5 * (rows.T @ rows))


def written(path: Path, K: NDArray[np.float64]) -> Path:
    """A matrix in a file of any ending, as SciPy and NumPy write it."""
    if path.suffix == ".mtx":
        io.mmwrite(path, K, precision=17)
    elif path.suffix == ".npz":
        np.savez(path, K)
    else:
        np.savetxt(path, K, delimiter=",", fmt="%.17g")
    return path


@pytest.mark.parametrize("kept", ["array", "coordinate", "integer", "sparse"])
@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("size", [1, 2, 6])
def test_matrix_market_is_read_as_scipy_reads_it(size: int, symmetry: str, kept: str, tmp_path: Path) -> None:
    K = symmetric(size, size).round() if kept == "integer" else symmetric(size, size)
    whole = K.astype(np.int64) if kept == "integer" else K
    matrix = {"coordinate": sparse.coo_matrix(K), "sparse": sparse.coo_matrix(np.diag(np.diag(K)))}.get(kept, whole)
    io.mmwrite(tmp_path / "k.mtx", matrix, comment="of a bearing\nin N and m", symmetry=symmetry, precision=17)
    expected = io.mmread(tmp_path / "k.mtx")
    expected = expected.toarray() if sparse.issparse(expected) else expected
    np.testing.assert_array_equal(read_matrix(tmp_path / "k.mtx").rows, expected)


def test_arrays_and_rows_are_read(tmp_path: Path) -> None:
    K, single = symmetric(1, 6), symmetric(2, 3).astype(np.float32)
    np.savez(tmp_path / "a.npz", single)
    np.savez_compressed(tmp_path / "b.npz", K=np.asfortranarray(K), M=np.eye(2), coordinates=np.array(COORDINATES))
    (tmp_path / "c.csv").write_text("# N/m\n\nx, beta\n 1e3,-2.\n-2.,+.5E1\n", encoding="ascii")
    np.testing.assert_array_equal(read_matrix(tmp_path / "a.npz").rows, single)
    assert read_matrix(tmp_path / "a.npz").names == ()
    np.testing.assert_array_equal(read_matrix(tmp_path / "b.npz").rows, K)
    assert read_matrix(tmp_path / "b.npz").names == COORDINATES
    assert read_matrix(tmp_path / "c.csv").rows == [[1e3, -2.0], [-2.0, 5.0]]
    assert read_matrix(tmp_path / "c.csv").names == ("x", "beta")
    np.testing.assert_array_equal(read_matrix(written(tmp_path / "d.csv", K)).rows, K)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_robot_keeps_the_numbers_and_not_the_path(ending: str, tmp_path: Path) -> None:
    K = symmetric(3, 3)
    path = written(tmp_path / f"K{ending}", K)
    text = TEXT.replace('"K"', f'"{path.name}"')
    (tmp_path / "a.toml").write_text(text + 'damping = { matrix = "K.mtx" }\n', encoding="ascii")
    written(tmp_path / "K.mtx", K)
    robot = load_robot(tmp_path / "a.toml")
    rows = str(np.asarray(K).tolist())
    inline = robot_from_toml(TEXT.replace('"K"', rows) + f"damping = {{ matrix = {rows} }}\n")
    stiffness, damping = robot.joint("mount").stiffness, robot.joint("mount").damping
    assert stiffness == JointStiffness.of(K.tolist(), ("x", "z", "beta")) == inline.joint("mount").stiffness
    assert damping == inline.joint("mount").damping
    assert robot_hash(robot) == robot_hash(inline)
    for file in tmp_path.iterdir():
        file.unlink()
    again: Robot = robot_of(record_of(robot))
    assert again.joint("mount").stiffness == stiffness
    assert path.name not in str(record_of(robot))
    assert robot.with_value("joints.mount.stiffness.x.beta", 0.0).joint("mount").stiffness != stiffness


def test_rows_of_what_is_rigid_are_left_out_of_a_file_too(tmp_path: Path) -> None:
    K = symmetric(4, 6)
    written(tmp_path / "K.npz", K)
    robot = load_robot(text_file(tmp_path / "a.toml", TEXT.replace('"K"', '"K.npz"')))
    assert "rows of coordinates that do not move are left out: y, alpha, gamma" in "".join(robot.notes)
    kept = [COORDINATES.index(name) for name in ("x", "z", "beta")]
    assert robot.joint("mount").stiffness == JointStiffness.of(K[np.ix_(kept, kept)].tolist(), ("x", "z", "beta"))


REAL, PLACES = "%%MatrixMarket matrix array real general\n", "%%MatrixMarket matrix coordinate real symmetric\n"
REFUSED = {
    ".mtx": {
        "": (1, "a header %%MatrixMarket"),
        "1 1\n2\n": (1, "a header"),
        REAL.replace("real", "complex"): (1, "real or integer"),
        REAL.replace("real", "pattern"): (1, "real or integer"),
        REAL.replace("general", "skew-symmetric"): (1, "general or symmetric"),
        REAL.replace("general", "hermitian"): (1, "general or symmetric"),
        REAL.replace("array", "vector"): (1, "array or coordinate"),
        REAL: (1, "rows and columns"),
        REAL + "2 2 4\n": (2, "rows and columns"),
        REAL + "2 3\n": (2, "a square matrix of 1 to 6 rows"),
        REAL + "12 12\n": (2, "1 to 6 rows"),
        REAL + "0 0\n": (2, "1 to 6 rows"),
        REAL + "-1 -1\n": (2, "rows and columns"),
        REAL + "1000000000000 1\n": (2, "rows and columns"),
        REAL + "2 2\n1\n2\n3\n": (5, "after 3 numbers; allowed: 4"),
        REAL + "1 1\n% a\n1\n2\n": (5, "a number a line, 1 of them"),
        REAL + "2 2\n1 2\n": (3, "a number a line"),
        REAL + "1 1\nnan\n": (3, "a finite number"),
        REAL + "1 1\n1_0\n": (3, "a finite number"),
        REAL + "1 1\n1e31\n": (3, "up to 1e+30"),
        REAL + "1 1\n1.0D+05\n": (3, "got '1.0D+05'"),
        PLACES + "2 2\n": (2, "rows, columns and entries"),
        PLACES + "2 2 2\n1 1 1\n": (3, "after 1 numbers; allowed: 2"),
        PLACES + "2 2 1\n1 1 1\n2 2 1\n": (4, "1 entries, as the file says"),
        PLACES + "2 2 2\n1 1 1\n3 1 1\n": (4, "each from 1 to 2"),
        PLACES + "2 2 2\n0 1 1\n": (3, "each from 1 to 2"),
        PLACES + "2 2 2\n1 1\n": (3, "a row and a column"),
        PLACES + "2 2 3\n1 1 1\n1 2 1\n2 1 1\n": (5, "only one half"),
        PLACES.replace("symmetric", "general") + "2 2 2\n1 2 1\n1 2 1\n": (4, "each entry once"),
    },
    ".csv": {
        "": (0, "after 0 rows; allowed: 1 to 6 rows"),
        "x,beta\n": (1, "after 0 rows; allowed: 2 rows of 2"),
        "1,2\n": (1, "after 1 rows; allowed: 2 rows of 2 numbers"),
        "1,2\n2,3\n4,5\n": (3, "2 rows"),
        "1,2\n2\n": (2, "2 numbers with commas"),
        "1;2\n2;3\n": (1, "a finite number"),
        "1,x\nx,1\n": (1, "got 'x'"),
        ",".join("1" * 7): (1, "1 to 6 rows"),
        "1,inf\ninf,1\n": (1, "got 'inf'"),
        '1,"2"\n': (1, "a finite number"),
    },
}
CASES = [(ending, text) for ending, texts in REFUSED.items() for text in texts]


@pytest.mark.parametrize(("ending", "text"), CASES)
def test_what_is_no_matrix_is_refused_with_its_line(ending: str, text: str, tmp_path: Path) -> None:
    line, allowed = REFUSED[ending][text]
    caught = refused(InputError, "", read_matrix, text_file(tmp_path / f"K{ending}", text))
    assert allowed in str(caught)
    assert f"K{ending}, line {line}: " in str(caught)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"a": np.eye(2), "b": np.eye(2)}, "has the arrays 'a', 'b'; allowed: one array, or one of the name K"),
        ({}, "has the arrays none"),
        ({"K": np.eye(12)}, r"has shape \(12, 12\)"),
        ({"K": np.ones((2, 3))}, r"has shape \(2, 3\)"),
        ({"K": np.ones(4)}, r"has shape \(4,\)"),
        ({"K": np.ones((0, 0))}, r"has shape \(0, 0\)"),
        ({"K": np.eye(2, dtype=bool)}, "has dtype bool; allowed: numbers"),
        ({"K": np.eye(2, dtype=complex)}, "has dtype"),
        ({"K": np.array([["a"]])}, "has dtype <U1; allowed: numbers"),
        ({"K": np.array([[1.0, np.nan], [np.nan, 1.0]])}, "got nan in row 1, column 2"),
        ({"K": np.array([[1e31]])}, r"got 1e\+31 in row 1, column 1"),
        ({"K": np.eye(2), "coordinates": np.array(["x", "q"])}, "got .'x', 'q'.; allowed: x, y"),
        ({"K": np.zeros((400, 400))}, "1280[0-9]* bytes; allowed: up to 1048576$"),
    ],
)
def test_what_is_no_array_of_a_matrix_is_refused(
    arrays: dict[str, NDArray[np.float64]], said: str, tmp_path: Path
) -> None:
    np.savez(tmp_path / "K.npz", **arrays)
    caught = refused(InputError, said, read_matrix, tmp_path / "K.npz")
    assert str(tmp_path / "K.npz") in str(caught)


def test_a_small_file_of_many_zeros_is_not_unpacked(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "K.npz", K=np.zeros((2000, 2000)))
    assert (tmp_path / "K.npz").stat().st_size < 1 << 20
    refused(InputError, r"its arrays have 32000128 bytes; allowed: up to 1048576$", read_matrix, tmp_path / "K.npz")


def test_a_refusal_says_where_the_file_is_named(tmp_path: Path) -> None:
    for name, content, said in (
        ("K.csv", "1,0,0\n0,1,0\n0,0\n", r"a.toml:14.*joints.mount.stiffness.matrix.*K.csv, line 3: got '0,0'"),
        ("K.csv", "1,0\n0,1\n", r"joints.mount.stiffness.matrix.*got 2 rows; allowed: 3, for x, z, beta, or six"),
        ("K.csv", "x,beta,z\n1,0,0\n0,1,0\n0,0,1\n", "its rows are of x, beta, z; allowed: x, z, beta"),
        ("K.csv", "1,5,0\n5,1,0\n0,0,1\n", r"joints.mount.stiffness.matrix.*x\.z: got 5"),
        ("K.txt", "1\n", r"got 'K.txt'; allowed: .*\.mtx or \.npz or \.csv"),
    ):
        (tmp_path / name).write_text(content, encoding="ascii")
        refused(DescriptionError, said, load_robot, text_file(tmp_path / "a.toml", TEXT.replace('"K"', f'"{name}"')))
        assert check_file(tmp_path / "a.toml").errors
    with pytest.raises(DescriptionError, match=r"got 'K.mtx'; allowed: the path of a file that ends in \.mtx"):
        robot_from_toml(TEXT.replace('"K"', '"K.mtx"'))
    refused(DescriptionError, "got 3; allowed: rows of", robot_from_toml, TEXT.replace('"K"', "3"))


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_no_file_is_not_waited_for(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"K{ending}"
    (tmp_path / "a.toml").write_text(TEXT.replace('"K"', f'"{path.name}"'), encoding="ascii")
    refused(InputError, r"no such file|No such file", load_robot, tmp_path / "a.toml")
    for kind, make in (
        ("FIFO", lambda: os.mkfifo(path)),
        ("folder", path.mkdir),
        ("device", lambda: path.symlink_to("/dev/zero")),
    ):
        make()
        caught = refused(InputError, f"it is a {kind}", load_robot, tmp_path / "a.toml")
        assert str(path) in str(caught)
        path.rmdir() if kind == "folder" else path.unlink()


def test_loops_and_bushings_take_files_too(tmp_path: Path) -> None:
    K = symmetric(5, 6)
    text = TEXT.replace('stiffness = { matrix = "K" }\n', "") + (
        '[[loops]]\nname = "closing"\nlinks = ["base", "plate"]\ntype = "fixed"\n'
        + "".join(f"{name} = {{}}\n" for name in COORDINATES)
        + 'stiffness = { matrix = "K" }\ndamping = { matrix = "K" }\n'
        '[[bushings]]\nname = "rubber"\nlinks = ["base", "plate"]\nstiffness = { matrix = "K" }\n'
        'damping = { matrix = "K" }\n'
    )
    inline = robot_from_toml(text.replace('"K"', str(K.tolist())))
    for ending in ENDINGS:
        written(tmp_path / f"K{ending}", K)
        (tmp_path / "a.toml").write_text(text.replace('"K"', f'"K{ending}"'), encoding="ascii")
        assert load_robot(tmp_path / "a.toml") == replace(inline, source=str(tmp_path / "a.toml"))
    with pytest.raises(DescriptionError, match=r"bushings\.rubber\.stiffness\.matrix.*got .K\.mtx.; allowed: the path"):
        robot_from_toml(text.replace('"K"', str(K.tolist()), 2).replace('"K"', '"K.mtx"'))


@pytest.mark.parametrize("ending", ENDINGS)
def test_any_byte_of_a_file_may_be_wrong(ending: str, tmp_path: Path) -> None:
    path = written(tmp_path / f"K{ending}", symmetric(6, 2))
    data = path.read_bytes()
    for at in range(len(data)):
        for change in (1, 0x10, 0x80):
            path.write_bytes(data[:at] + bytes([data[at] ^ change]) + data[at + 1 :])
            with suppress(InputError):  # anything else that is raised ends the test
                found = read_matrix(path).rows
                assert [len(row) for row in found] == [len(found)] * len(found)
                assert np.isfinite(found).all()
    for end in range(0, len(data) - 2, 3):
        path.write_bytes(data[:end])
        with suppress(InputError):
            read_matrix(path)


JOINTS = f"""
name = "mount"
{link_table("body", 1.0, inertia=(0.01, 0.02, 0.03))}
{joint_table("root", "base", "body", "revolute")}
x = {{}}
beta = {{ stiffness = 3.0 }}
stiffness = {{ matrix = [[900.0, 20.0, 0.0], [20.0, 5.0, 1.0], [0.0, 1.0, 4.0]], preload = [1.0, 0.0, -0.5] }}
damping = {{ loss_factor = 0.02, at_hz = 40.0 }}
"""
SIX = """{ matrix = [[900.0, 10.0, 0.0, 0.0, 20.0, 0.0], [10.0, 50.0, 0.0, 0.0, 0.0, 0.0], \
[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [20.0, 0.0, 0.0, 0.0, 5.0, 1.0], \
[0.0, 0.0, 0.0, 0.0, 1.0, 4.0]]"""
MATRIX = "[[900.0, 20.0, 0.0], [20.0, 5.0, 1.0], [0.0, 1.0, 4.0]]"
UNREAD = {
    "asymmetric": (
        "[[900.0, 20.0",
        "[[900.0, 21.0",
        ["stiffness.matrix", "x.beta", "21.0", "beta.x is 20.0", "symmetric"],
    ),
    "negative": ("1.0, 4.0]]", "1.0, -4.0]]", ["stiffness.matrix", "gamma.gamma", "-4.0", "at least 0"]),
    "units": (
        MATRIX,
        "[[900.0, 2e3, 0.0], [2e3, 5.0, 1.0], [0.0, 1.0, 4.0]]",
        ["x.beta", "2000.0", "67.082", "x.x and beta.beta", "units?"],
    ),
    "two angles": (
        MATRIX,
        "[[900.0, 20.0, 0.0], [20.0, 5.0, 7.0], [0.0, 7.0, 4.0]]",
        ["beta.gamma", "7.0", "up to 4.47214", "root of the product of beta.beta and gamma.gamma"],
    ),
    "indefinite": (
        MATRIX,
        "[[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]",
        ["stiffness.matrix", "x, beta, gamma together", "eigenvalue -0.8", "positive semidefinite"],
    ),
    "rows": (
        MATRIX,
        "[[1.0, 0.0], [0.0, 1.0]]",
        ["stiffness.matrix", "2 rows", "3, for x, beta, gamma, or six, for x, y"],
    ),
    "ragged": (MATRIX, "[[1.0, 0.0], [0.0]]", ["stiffness.matrix.1", "[0.0]", "2 numbers"]),
    "no rows": (MATRIX, "[]", ["stiffness.matrix", "one to six"]),
    "a number": (MATRIX, "7.0", ["stiffness.matrix", "7.0", "one to six"]),
    "nan": ("[[900.0", "[[nan", ["stiffness.matrix", "nan"]),
    "zero": (
        MATRIX + ", preload = [1.0, 0.0, -0.5]",
        "[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]",
        ["no number"],
    ),
    "no matrix": (f"matrix = {MATRIX}, ", "", ["joints.root.stiffness", "'matrix'", "missing", "six rows"]),
    "six numbers": (MATRIX, "[900.0, 20.0, 1.0, 1.0, 1.0, 1.0]", ["stiffness.matrix", "rows"]),
    "preload": ("[1.0, 0.0, -0.5]", "[1.0]", ["stiffness.preload", "[1.0]", "3 numbers"]),
    "place": ("preload = [1.0, 0.0, -0.5]", "at = { xyz = [0.1, 0.0, 0.0] }", ["stiffness.at", "3 rows", "six rows"]),
    "unknown": ("preload", "preloads", ["'preloads'", "mean 'preload'", "matrix, at"]),
    "no frequency": (", at_hz = 40.0", "", ["joints.root.damping", "at_hz", "missing"]),
    "no share": ("loss_factor = 0.02, ", "", ["joints.root.damping", "ratio or loss_factor", "missing"]),
    "two forms": (
        "loss_factor = 0.02",
        "ratio = 0.1, loss_factor = 0.02",
        ["joints.root.damping", "ratio and loss_factor"],
    ),
    "two other forms": (
        "loss_factor = 0.02, at_hz = 40.0",
        f"linear = 1.0, matrix = {MATRIX}",
        ["linear or angular and matrix"],
    ),
    "no stiffness": (
        f"stiffness = {{ matrix = {MATRIX}, preload = [1.0, 0.0, -0.5] }}",
        "",
        ["joints.root.damping", "stiffness"],
    ),
    "frequency": ("40.0", "0.0", ["joints.root.damping.at_hz", "0.0", "1e-12"]),
    "place of no matrix": (
        "loss_factor = 0.02, at_hz = 40.0",
        "linear = 1.0, at = {}",
        ["joints.root.damping.at", "no matrix"],
    ),
    "a table of numbers": ("matrix = [[", "x = [[", ["joints.root.stiffness", "'x'", "matrix"]),
}


@pytest.mark.parametrize("case", UNREAD)
def test_what_is_wrong_is_refused(case: str) -> None:
    old, new, said = UNREAD[case]
    assert old in JOINTS
    caught = refused(DescriptionError, "", robot_from_toml, JOINTS.replace(old, new), source="my.toml")
    assert all(word in str(caught) for word in ["my.toml", *said]), caught


def test_rows_of_what_does_not_move_are_left_out_and_named() -> None:
    robot = robot_from_toml(
        JOINTS.replace(f"{{ matrix = {MATRIX}", SIX).replace("1.0, 0.0, -0.5]", "1.0, 2.0, 0.0, 0.0, 0.0, -0.5]")
    )
    assert robot.notes == ("joints.root.stiffness: rows of coordinates that do not move are left out: y",)
    assert robot.joints == robot_from_toml(JOINTS).joints
    alone = SIX.replace("900.0, 10.0", "0.0, 0.0").replace("10.0, 50.0", "0.0, 50.0").replace("20.0", "0.0")
    with pytest.raises(DescriptionError, match="rows of y alone"):
        robot_from_toml(
            JOINTS.replace(
                f"{{ matrix = {MATRIX}", alone.replace("5.0, 1.0", "0.0, 0.0").replace("1.0, 4.0", "0.0, 0.0")
            ).replace(", preload = [1.0, 0.0, -0.5]", "")
        )


def test_they_are_read_kept_and_named() -> None:
    robot = robot_from_toml(JOINTS)
    (joint,) = robot.joints
    assert joint.stiffness == JointStiffness.of(
        [[900.0, 20.0, 0.0], [20.0, 5.0, 1.0], [0.0, 1.0, 4.0]], ("x", "beta", "gamma"), preload=(1.0, 0.0, -0.5)
    )
    assert joint.damping == JointDamping(loss_factor=0.02, at_hz=40.0)
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    without = replace(robot, joints=(replace(joint, stiffness=None, damping=None),))
    assert "stiffness" not in record_of(without)["joints"][0]
    assert robot_hash(robot) != robot_hash(without)
    left = robot.rigid().joints[0]
    assert left.stiffness == JointStiffness({"gamma.gamma": 4.0}, {"gamma": -0.5})
    assert left.damping == joint.damping
    free = replace(joint, stiffness=JointStiffness({"x.x": 1.0}))
    assert replace(robot, joints=(free,)).rigid().joints[0].damping is None
    for key, number in JointStiffness.NUMBERS.items():
        name = f"joints.root.stiffness.{key}"
        assert number_of(name) is number
        assert least_of(name) == (0.0 if len(set(key.split("."))) == 1 else None)
        assert parameter_unit(robot, name) in UNITS
    assert parameter_unit(robot, "joints.root.stiffness.x.beta") == "N/rad"
    assert parameter_unit(robot, "joints.root.damping.x.beta") == "N.s/rad"
    for element, message in (
        (JointStiffness({"y.y": 1.0}), "y does not move"),
        (JointStiffness({"beta.x": 1.0}), "no such entry"),
        (JointStiffness({"x.x": 1.0, "x.beta": 1.0}), "units"),
        (JointStiffness({"x.x": 1.0}, {"x": np.inf}), "preload"),
        (JointStiffness({}, {}), "no number"),
        (JointDamping(entries={"x.x": 1.0, "gamma.gamma": 1.0, "x.gamma": 2.0}), "x.gamma"),
        (JointDamping(entries={"q.x": 1.0}), "no such entry"),
        (JointDamping(entries={"z.z": 1.0}), "z does not move"),
    ):
        wrong = replace(robot, joints=(replace(joint, **{element.TABLE: element}),))
        refused(DescriptionError, message, build_model, wrong)
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    assert info.as_dict()["joint_stiffness"]["root"]["x.beta"] == 20.0
    assert "root.stiffness: preload.x 1, preload.gamma -0.5" in info.lines()
    assert "  no centre of stiffness: no stiffness of y, z, alpha" in info.lines()
    assert any(line.split() == ["beta", "20", "5", "1"] for line in info.lines())
    assert "root" in unknown_to_textbook(build_model(robot))
    assert "none between them" in unknown_to_textbook(build_model(robot))


def test_a_joint_with_a_matrix_keeps_its_angles() -> None:
    """Charts switch where nothing refers to an angle: a matrix does, isotropic damping does not."""
    free = free_body()

    def turning(**elements: object) -> tuple[int, ...]:
        return build_model(replace(free, joints=(replace(free.joints[0], **elements),))).turning

    assert turning(damping=JointDamping(1.0, 2.0)) == (0,)
    assert turning(stiffness=JointStiffness({"x.x": 1.0})) == ()
    assert turning(damping=JointDamping(entries={"x.x": 1.0})) == ()


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_a_simulation_balances_its_energy() -> None:
    scenario = scenario_from_toml(
        "duration = 0.5\n[integrator]\nrtol = 1e-8\n[initial.v]\n'root.beta' = 2.0\n'root.x' = 1.0\n"
    )
    robot = robot_from_toml(JOINTS.replace("0.02, at_hz", "0.5, at_hz"))
    result = eomgen.run_scenario(robot, scenario)
    assert result.balance.relative_residue < 1e-6
    assert result.balance.of("dissipated")[-1] > 0.01
    page = report_of(result, modes=False).html()
    assert "root.stiffness" in page
    assert "root.damping" in page
