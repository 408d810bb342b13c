"""Stiffness matrices of joints at a state: closed forms, SciPy's curves, files as NumPy and SciPy read them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import io
from scipy.interpolate import PchipInterpolator

from eomgen.analysis import deflection, joint_stiffness_matrix
from eomgen.cli import entry as cli
from eomgen.description.load import load_robot
from eomgen.description.matrix_files import read_matrix
from eomgen.errors import InputError, UnknownNameError
from eomgen.robot import Coordinate, Frame, JointStiffness, Robot
from eomgen.robot.value import COORDINATES, Joint, Link

pytestmark = pytest.mark.usefixtures("unoptimised")

TABLES = {"x": 2e5, "y": 3e5, "beta": 7e3}
CURVE = ((-2e-3, -900.0), (-1e-3, -200.0), (0.0, 0.0), (1e-3, 150.0), (2e-3, 1000.0))


def definite(seed: int, size: int = 6) -> NDArray[np.float64]:
    rows = np.random.default_rng(seed).normal(size=(size + 2, size))
    return np.asarray(1e4 * (rows.T @ rows))


def mounted(K: NDArray[np.float64], coordinates: dict[str, Coordinate]) -> Robot:
    """A body on a matrix and on springs of single coordinates, and a further joint behind it."""
    names = tuple(name for name in COORDINATES if name in coordinates)
    mount = Joint("mount", "base", "body", "fixed", coordinates=coordinates)
    mount = replace(mount, stiffness=JointStiffness.of(K.tolist(), names))
    axis = Joint("axis", "body", "tip", "revolute", coordinates={"z": Coordinate(stiffness=1e6), "gamma": Coordinate()})
    links = tuple(Link(name, 2.0, (0.0,) * 3, (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)) for name in ("body", "tip"))
    return Robot("bench", (0.0, 0.0, 0.0), links, (mount, axis), (Frame("flange", "body"),))


def whole() -> tuple[Robot, NDArray[np.float64]]:
    K = definite(1)
    coordinates = {name: Coordinate(stiffness=TABLES.get(name)) for name in COORDINATES}
    return mounted(K, coordinates), K + np.diag([TABLES.get(name, 0.0) for name in COORDINATES])


def test_tables_and_matrices_add_up() -> None:
    robot, expected = whole()
    found = joint_stiffness_matrix(robot, "mount", loads={"flange": [30.0, -20.0, 10.0, 1.0, 2.0, 3.0]})
    sizes = np.sqrt(np.diag(expected))
    assert np.abs((found.matrix - expected) / np.outer(sizes, sizes)).max() < 1e-14
    assert np.array_equal(found.matrix, found.matrix.T)
    assert (found.coordinates, found.rigid, found.held) == (COORDINATES, (), ())
    force = np.array([30.0, -20.0, 10.0, 1.0, 2.0, 3.0])
    assert found.deviation == pytest.approx(np.linalg.solve(expected, force), rel=1e-2)  # angles turn the moment
    frame = deflection(robot, frame="flange").stiffness  # by the inverse of the compliance
    assert frame is not None
    assert np.abs((frame - expected) / np.outer(sizes, sizes)).max() < 1e-9
    assert "centre of stiffness" in str(found)


def test_slopes_are_those_at_the_state() -> None:
    """Curves by SciPy, a cubic spring and a stiffer side, at the deviations that a load brings about."""
    coordinates = {
        "x": Coordinate(curve=CURVE),
        "y": Coordinate().with_numbers({"stiffness": 1e5, "cubic": 1e11}),
        "z": Coordinate().with_numbers({"stiffness": 1e5, "stiffness_negative": 4e5}),
        "gamma": Coordinate().with_numbers({"exponential.force": 20.0, "exponential.scale": 1e-2}),
    }
    K = 0.1 * definite(2, 4)
    robot = mounted(K, coordinates)
    for seed in range(4):
        force = np.random.default_rng(seed).normal(size=6) * [300.0, 300.0, 300.0, 0.0, 0.0, 20.0]
        found = joint_stiffness_matrix(robot, "mount", loads={"flange": force}, held=["axis.gamma"])
        x, y, z, gamma = found.deviation
        slopes = [
            float(PchipInterpolator(*np.array(CURVE).T, extrapolate=True).derivative()(x)),
            1e5 + 3e11 * y**2,
            1e5 if z > 0.0 else 4e5,
            20.0 / 1e-2 * np.exp(gamma / 1e-2),
        ]
        assert abs(x) < CURVE[-1][0]
        assert found.rigid == ("alpha", "beta")
        np.testing.assert_allclose(found.matrix, K + np.diag(slopes), rtol=1e-9, atol=1e-6 * K.max())


def test_what_is_held_has_no_row_unless_gains_hold_it() -> None:
    robot, _ = whole()
    found = joint_stiffness_matrix(robot, "axis")
    assert (found.coordinates, found.held, found.rigid) == (("z",), ("gamma",), ("x", "y", "alpha", "beta"))
    assert found.matrix == pytest.approx(np.array([[1e6]]), rel=1e-12)
    assert "held in this state, without a row: gamma" in str(found)
    by_gains = joint_stiffness_matrix(robot, "axis", drives="pd", kp=250.0)
    assert by_gains.coordinates == ("z", "gamma")
    np.testing.assert_allclose(by_gains.matrix, np.diag([1e6, 250.0]), rtol=1e-12)


@pytest.mark.parametrize("names", [COORDINATES, ("x", "z", "beta")])
def test_files_are_read_by_others_and_by_descriptions(names: tuple[str, ...], tmp_path: Path) -> None:
    robot = mounted(definite(3, len(names)), {name: Coordinate(stiffness=TABLES.get(name)) for name in names})
    found = joint_stiffness_matrix(robot, "mount")
    for ending in (".csv", ".npz", ".mtx"):
        assert found.save(tmp_path / f"K{ending}") == tmp_path / f"K{ending}"
        again = read_matrix(tmp_path / f"K{ending}")
        assert np.array_equal(again.rows, found.matrix)
        assert again.names == (() if ending == ".mtx" else names)
    assert np.array_equal(io.mmread(tmp_path / "K.mtx"), found.matrix)
    assert np.array_equal(np.loadtxt(tmp_path / "K.csv", delimiter=",", skiprows=2 + bool(found.rigid)), found.matrix)
    with np.load(tmp_path / "K.npz", allow_pickle=False) as file:
        assert np.array_equal(file["K"], found.matrix)
        assert tuple(file["rigid"]) == tuple(name for name in COORDINATES if name not in names)
    text = 'name = "a"\n[[links]]\nname = "b"\nmass = 1\ninertia = { xx = 1, yy = 1, zz = 1 }\n[[joints]]\nname = "j"\n'
    text += 'parent = "base"\nchild = "b"\ntype = "fixed"\n' + "".join(f"{name} = {{}}\n" for name in names)
    (tmp_path / "a.toml").write_text(text + 'stiffness = { matrix = "K.csv" }\n', encoding="ascii")
    stiffness = load_robot(tmp_path / "a.toml").joint("j").stiffness
    assert stiffness == JointStiffness.of(found.matrix.tolist(), names)
    if found.rigid:
        for ending in (".csv", ".mtx"):
            assert "rigid, without a row: y, alpha, gamma" in (tmp_path / f"K{ending}").read_text(encoding="ascii")


def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "K.csv")
    assert cli.main(["deflection", "shaken_arm", "--matrix", "shoulder", "-o", path, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["matrix"] == [[4000.0, 0.0], [0.0, 4000.0]]
    assert found["held"] == ["gamma"]
    assert read_matrix(tmp_path / "K.csv").names == ("alpha", "beta")
    assert cli.main(["deflection", "shaken_arm", "--matrix", "shoulder"]) == 0
    assert "shaken_arm: stiffness of shoulder at alpha" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--matrix", "sholder"], "there is no joint 'sholder'; did you mean 'shoulder'?"),
        (["--matrix", "mount"], "nothing of mount moves in this state"),
        (["--matrix", "waist"], "nothing of waist moves in this state"),
        (["--matrix", "shoulder", "-o", "K.txt"], "allowed: a path that ends in .csv, .npz, .mtx"),
        (["--matrix", "shoulder", "--frame", "tcp"], "matrix and frame are both given"),
        (["--matrix", "shoulder", "--map", *"000100010"], "matrix and map are both given"),
        (["-o", "K.npz"], "allowed: with --map or --matrix"),
    ],
)
def test_wrong_options_are_refused_by_name(options: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["deflection", "shaken_arm", *options]) == 1
    assert said in capsys.readouterr().err


@pytest.mark.soak
def test_of_closed_mechanisms_it_is_the_joints_own() -> None:
    """A joint in a loop has its springs alone; one that others hold has none, and that is said."""
    four_bar, K = load_robot("four_bar"), definite(6, 2)
    joint = four_bar.joint("joint2")
    soft = {**joint.coordinates, "x": Coordinate(stiffness=1e5), "y": Coordinate()}
    joint = replace(joint, coordinates=soft, stiffness=JointStiffness.of(K.tolist(), ("x", "y")))
    found = joint_stiffness_matrix(replace(four_bar, joints=(four_bar.joints[0], joint, four_bar.joints[2])), "joint2")
    expected = np.pad(K + np.diag([1e5, 0.0]), (0, 1))
    np.testing.assert_allclose(found.matrix, expected, rtol=1e-10, atol=1e-9)
    bare = joint_stiffness_matrix(four_bar, "joint2")
    assert not bare.matrix.any()
    assert "no spring of joint2 acts here" in bare.notes[-1]


def test_wrong_arguments_are_refused_by_name() -> None:
    robot, _ = whole()
    rigid = replace(robot, joints=(robot.joints[0], replace(robot.joints[1], type="fixed", coordinates={})))
    with pytest.raises(UnknownNameError, match="axis is rigid; allowed: mount"):
        joint_stiffness_matrix(rigid, "axis")
    with pytest.raises(InputError, match="'free' drives hold nothing"):
        joint_stiffness_matrix(robot, "mount", drives="free")
    with pytest.raises(InputError, match=r"path: .*K\.pdf"):
        joint_stiffness_matrix(robot, "mount").save("K.pdf")


def test_a_node_of_a_link_that_bends_is_no_joint() -> None:
    """What stands there moves with the modes, whose stiffness is the link's."""
    with pytest.raises(UnknownNameError, match=r"upper_tip is a node of link upper, which bends; allowed: a joint"):
        joint_stiffness_matrix("flexible_arm", "upper_tip")
