"""Deflections by textbook springs, Pinocchio's statics and loaded states; maps; stiffness matrices of joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import io
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.analysis import joint_stiffness_matrix
from eomgen.analysis.compliance import compliance_map
from eomgen.analysis.options import KERNELS
from eomgen.analysis.statics import deflection, motion_between
from eomgen.description.load import robot_from_toml
from eomgen.description.matrix_files import read_matrix
from eomgen.errors import EomgenWarning, InputError, UnknownNameError
from eomgen.robot import JointStiffness
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Frame, Joint, Link, Motor, Placement, Robot
from tests.oracles.pinocchio_models import PinocchioOracle, numerical_tangents
from tests.support.builds import Build
from tests.support.commands import command, errors_of, facts
from tests.support.elastic_robots import random_elastic
from tests.support.oscillators import LOOP
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

SPRINGS = (2e5, 3e5, 5e5, 4e3, 7e3, 9e3)


def spring_mount(gravity: tuple[float, float, float] = (0.0, 0.0, 0.0), length: float = 0.5) -> Robot:
    """A body on six springs, a frame at a distance along x."""
    names = eomgen.robot.COORDINATES
    springs = {name: Coordinate(stiffness=k) for name, k in zip(names, SPRINGS, strict=True)}
    joint = Joint("mount", "base", "body", "fixed", coordinates=springs)
    link = Link("body", 2.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    return Robot("mount", gravity, (link,), (joint,), (Frame("tcp", "body", Placement((length, 0.0, 0.0))),))


def test_six_springs() -> None:
    """Unloaded: C = T diag(1/k) T^T with the shift T of the frame; gravity's deflection m g / k."""
    found = deflection(spring_mount())
    T = np.eye(6)
    T[1, 5], T[2, 4] = 0.5, -0.5  # u + theta x (l, 0, 0)
    expected = T @ np.diag(1.0 / np.array(SPRINGS)) @ T.T
    assert np.abs(found.compliance - expected).max() < 1e-15
    assert found.rank == 6
    assert found.stiffness == pytest.approx(np.linalg.inv(expected), rel=1e-9, abs=1e-4)
    heavy = deflection(spring_mount((0.0, 0.0, -9.81)))
    assert heavy.deflection == pytest.approx([0, 0, -2.0 * 9.81 / SPRINGS[2], 0, 0, 0], abs=1e-15)
    assert np.array_equal(heavy.by_loads, np.zeros(6))


def test_geometric_stiffness_of_a_column() -> None:
    """A rigid column on a torsion spring under a dead load P: k - P l instead of k, and it buckles beyond."""
    robot = spring_mount(length=0.5)
    joint = replace(robot.joints[0], coordinates={"gamma": Coordinate(stiffness=100.0)})
    robot = replace(robot, joints=(joint,))
    for force in (-150.0, 0.0, 80.0):
        found = deflection(robot, loads={"tcp": [force, 0, 0, 0, 0, 0]})
        assert found.compliance[5, 5] == pytest.approx(1.0 / (100.0 + 0.5 * force), rel=1e-12)
        assert found.rank == 1
        assert found.stiffness is None
        assert "of rank 1 of 6" in "\n".join(found.lines())
    with pytest.warns(EomgenWarning, match=r"not stable: it buckles along mount\.gamma"):
        deflection(robot, loads={"tcp": [-210.0, 0, 0, 0, 0, 0]})
    # with a moment to begin with it goes where k theta = P l sin(theta) + m
    bent = deflection(robot, loads={"tcp": [-210.0, 0, 0, 0, 0, 1.0]})
    angle = bent.deflection[5]
    assert 100.0 * angle == pytest.approx(210.0 * 0.5 * np.sin(angle) + 1.0, rel=1e-10)
    assert angle > 0.3
    assert not bent.notes


@pytest.mark.parametrize("seed", soaked(range(6), (0, 3)))
@pytest.mark.parametrize("drives", ["locked", "pd"])
def test_random_robots_against_pinocchio(seed: int, drives: str, built: Build) -> None:
    """Balance by Pinocchio's forces, pose by its kinematics, compliance by its Jacobian and differenced stiffness."""
    robot = random_elastic(seed)
    oracle, kernel = PinocchioOracle(robot), built(robot, *KERNELS)
    rng, driven = np.random.default_rng(seed + 100), list(build_model(robot).driven)
    wrench = rng.uniform(-30.0, 30.0, 6)
    pose = np.zeros(kernel.n)
    pose[driven] = rng.uniform(-1.0, 1.0, len(driven))
    gains = {"kp": 2e4} if drives == "pd" else {}
    found = deflection(robot, pose, drives=drives, loads={"tcp": wrench}, kernel=kernel, **gains)
    K, _, _ = numerical_tangents(oracle, found.q, wrench, "tcp")
    zero, J = np.zeros(kernel.n), oracle.frame_jacobian(found.q, "tcp")
    left = oracle.inverse_dynamics(found.q, zero, zero) - J.T @ wrench
    assert found.u == pytest.approx(np.where(np.isin(np.arange(kernel.n), driven), left, 0.0), abs=1e-8)
    if drives == "pd":
        assert left[driven] == pytest.approx(2e4 * (pose - found.q)[driven], abs=1e-7)
        K[driven, driven] += 2e4
    else:
        assert np.array_equal(found.q[driven], pose[driven])
    free = [i for i in range(kernel.n) if drives == "pd" or i not in driven]
    expected = J[:, free] @ np.linalg.solve(K[np.ix_(free, free)], J[:, free].T)
    assert found.compliance == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max(initial=1e-12))
    before, after = oracle.frame_pose(pose, "tcp"), oracle.frame_pose(found.q, "tcp")
    turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
    assert found.deflection == pytest.approx([*(after - before)[:3, 3], *turn], abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_compliance_is_the_difference_of_loaded_states(seed: int, built: Build) -> None:
    """A little more load moves the frame by the compliance times it: geometric terms and all."""
    robot = random_elastic(seed)
    kernel, wrench = built(robot, *KERNELS), np.array([30.0, -20.0, 40.0, 1.0, -2.0, 3.0])
    found = deflection(robot, loads={"tcp": wrench}, kernel=kernel)
    for k, change in enumerate(1e-2 * np.eye(6)):
        poses = [deflection(robot, loads={"tcp": wrench + s * change}, kernel=kernel).pose for s in (1, -1)]
        moved = motion_between(poses[1], poses[0]) / 2e-2
        assert moved == pytest.approx(found.compliance[:, k], rel=1e-5, abs=1e-9)
    none = deflection(robot, kernel=kernel)
    assert found.by_loads == pytest.approx(found.deflection - none.deflection, abs=1e-14)


@pytest.mark.soak
def test_loops_turn_springs_into_stiffness(built: Build) -> None:
    """A slider-crank has one freedom: C = J J^T / V'' at its state of rest, V the energy over the crank angle."""
    robot = robot_from_toml(LOOP)
    found = deflection(robot, {"turn.gamma": 2.5, "pin.gamma": -3.2, "guide.x": 0.25}, fixed=[], frame="rod")
    kernel = built(robot, "energy", "kinematics")

    def place(angle: float) -> np.ndarray:
        other = np.arcsin(-0.2 * np.sin(angle) / 0.4)
        return np.array([angle, other - angle, 0.2 * np.cos(angle) + 0.4 * np.cos(other)])

    angle, h = float(found.q[0]), 1e-4
    V = [float(kernel.energy(place(angle + d * h), np.zeros(3))[1]) for d in (-1, 0, 1)]
    assert abs(V[2] - V[0]) / (2 * h) < 1e-5
    J = kernel.frame_jacobian(found.q, "rod") @ (place(angle + h) - place(angle - h)) / (2 * h)
    expected = np.outer(J, J) / ((V[0] - 2 * V[1] + V[2]) / h**2)
    assert found.compliance == pytest.approx(expected, rel=1e-4, abs=1e-6 * np.abs(expected).max())
    assert found.rank == 1


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, 3.1, np.pi - 1e-6, np.pi])
def test_rotation_vectors(angle: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        axis = rng.standard_normal(3)
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        first, second = np.eye(4), np.eye(4)
        first[:3, :3] = Rotation.random(random_state=4).as_matrix()
        second[:3, :3] = turn.as_matrix() @ first[:3, :3]
        again = Rotation.from_rotvec(motion_between(first, second)[3:])
        assert (again * turn.inv()).magnitude() < 1e-7
        assert np.linalg.norm(motion_between(first, second)[3:]) == pytest.approx(angle, abs=1e-7)


def test_map_of_a_planar_arm(built: Build) -> None:
    """Two links of 0.5 m with torsion springs beside both drives: 0 to 1 m can be reached, C is J diag(1/k) J^T."""
    links, joints = [], []
    for i in (1, 2):
        for kind, name in (("revolute", f"r{i}"), ("fixed", f"l{i}")):
            links.append(Link(name, 0.5, (0.0, 0.0, 0.0), (0.01, 0.01, 0.01, 0.0, 0.0, 0.0)))
            parent = "base" if not joints else links[-2].name
            placement = Placement((0.5, 0.0, 0.0)) if (i, kind) == (2, "revolute") else Placement()
            spring = Coordinate() if kind == "revolute" else Coordinate(stiffness=800.0 * i)
            joints.append(Joint(f"j_{name}", parent, name, kind, placement, coordinates={"gamma": spring}))
    frames = (Frame("tcp", "l2", Placement((0.5, 0.0, 0.0))),)
    robot = Robot("planar", (0.0, 0.0, 0.0), tuple(links), tuple(joints), frames)
    found = compliance_map(robot, [-0.3, 0.2, 0.0], [1.5, 0.0, 0.0], [0.0, 0.88, 0.0], (6, 4), pose=[0.3, 0.9])
    distance = np.linalg.norm(found.points, axis=2)
    assert found.points[-1, -1] == pytest.approx([1.2, 1.08, 0.0])
    assert np.array_equal(np.isfinite(found.softest), distance < 1.0)
    for i, j in np.argwhere(distance < 1.0):
        x, y = found.points[i, j, :2]
        first, both = found.q[i, j, 0], found.q[i, j, 0] + found.q[i, j, 2]
        place = 0.5 * np.array([np.cos(first) + np.cos(both), np.sin(first) + np.sin(both)])
        assert place == pytest.approx([x, y], abs=1e-9)
        second = place - 0.5 * np.array([np.cos(first), np.sin(first)])
        J = np.array([[-y, -second[1]], [x, second[0]]])
        expected = J @ np.diag([1 / 800.0, 1 / 1600.0]) @ J.T
        assert found.compliance[i, j, :2, :2] == pytest.approx(expected, abs=1e-12)
        assert found.softest[i, j] == pytest.approx(np.linalg.eigvalsh(expected)[-1], rel=1e-6)


def test_map_of_a_robot_whose_motors_are_behind_gears() -> None:
    """Motors are held where the joints, which are looked for, have them; C is J diag(1/k) J^T of the transmissions."""
    arm, stiffness = eomgen.load_robot("geared_arm"), (1.5e4, 2.5e4, 8e3)
    motors = (Motor(1e-4, 100.0, Coordinate(stiffness=k)) for k in stiffness)
    joints = (replace(joint, motor=motor) for joint, motor in zip(arm.joints, motors, strict=True))
    robot = replace(arm, joints=tuple(joints), gravity=(0.0, 0.0, 0.0))
    found = compliance_map(robot, [0.3, 0.05, 0.1], [0.15, 0.0, 0.0], [0.0, 0.1, 0.2], (2, 2))
    kernel = eomgen.build(robot, kernels=("kinematics",))
    driven = [kernel.coordinates.index(name) for name in kernel.motors.values()]
    for i, j in np.ndindex(2, 2):
        q = found.q[i, j]
        assert kernel.frame_pose(q, found.frame)[:3, 3] == pytest.approx(found.points[i, j], abs=1e-8)
        J = kernel.frame_jacobian(q, found.frame)[:, driven]
        expected = J @ np.diag(1.0 / np.array(stiffness)) @ J.T
        assert found.compliance[i, j] == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_input_that_is_refused() -> None:
    robot = eomgen.load_robot("one_link")
    joint = replace(robot.joints[0], type="fixed", coordinates={"x": Coordinate()})
    loose = Robot("loose", (0.0, 0.0, 0.0), robot.links, (joint,))
    driven = replace(loose, driven=("joint1.x",))
    plane = (robot, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    for call, words in (
        (lambda: deflection(robot, drives="free"), "allowed: locked, pd"),
        (lambda: deflection(loose, fixed=[]), r"nothing holds joint1\.x: its compliance is infinite; list it in fixed"),
        (
            lambda: deflection(driven, fixed=[]),
            "infinite; fixed names all that stays, driven coordinates too; list it in",
        ),
        (lambda: compliance_map(*plane, [2.0, 0.0, 0.0], (3, 3)), "span no plane"),
        (lambda: compliance_map(*plane, [0.0, 1.0, 0.0], (1, 3)), "whole numbers from 2"),
        (lambda: compliance_map(*plane, [0.0, np.nan, 0.0], (3, 3)), "three finite numbers"),
    ):
        refused(InputError, words, call)


def test_rigid_robots_do_not_bend() -> None:
    found = deflection(eomgen.load_robot("ur5"), loads={"tcp": [0.0, 0.0, -50.0, 0.0, 0.0, 0.0]})
    assert found.rank == 0
    assert np.array_equal(found.deflection, np.zeros(6))


def test_command(tmp_path: Path) -> None:
    plain = facts("deflection", "one_link", "--load", "tcp", 20, 0, 0, 0, 0, 0)
    assert plain["deflection"]["x"] == pytest.approx(20.0 / 1e4)
    assert plain["rank"] == 1
    plane = ("--map", 0.3, -0.4, 0, 0.3, 0, 0, 0, 0.6, 0, "--points", 3, 2)
    for name in ("map.npz", "map.svg"):
        assert "um/N" in command("deflection", "worn_arm", *plane, "-o", tmp_path / name)
    with np.load(tmp_path / "map.npz") as saved:
        assert saved["compliance"].shape == (3, 2, 6, 6)
    assert "um/N" in (tmp_path / "map.svg").read_text()
    assert "with --map" in errors_of("deflection", "one_link", "-o", "a.svg")


# Stiffness matrices of joints


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
        found = joint_stiffness_matrix(robot, "mount", loads={"flange": force}, fixed=["axis.gamma"])
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
    stiffness = eomgen.load_robot(tmp_path / "a.toml").joint("j").stiffness
    assert stiffness == JointStiffness.of(found.matrix.tolist(), names)
    if found.rigid:
        for ending in (".csv", ".mtx"):
            assert "rigid, without a row: y, alpha, gamma" in (tmp_path / f"K{ending}").read_text(encoding="ascii")


def test_the_command_writes_it(tmp_path: Path) -> None:
    found = facts("deflection", "shaken_arm", "--matrix", "shoulder", "-o", tmp_path / "K.csv")
    assert found["matrix"] == [[4000.0, 0.0], [0.0, 4000.0]]
    assert found["held"] == ["gamma"]
    assert read_matrix(tmp_path / "K.csv").names == ("alpha", "beta")
    assert "shaken_arm: stiffness of shoulder at alpha" in command("deflection", "shaken_arm", "--matrix", "shoulder")


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
def test_wrong_options_are_refused_by_name(options: list[str], said: str) -> None:
    assert said in errors_of("deflection", "shaken_arm", *options)


@pytest.mark.soak
def test_of_closed_mechanisms_it_is_the_joints_own() -> None:
    """A joint in a loop has its springs alone; one that others hold has none, and that is said."""
    four_bar, K = eomgen.load_robot("four_bar"), definite(6, 2)
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
    node = r"upper_tip is a node of link upper, which bends; allowed: a joint"
    for call, kind, said in (
        (lambda: joint_stiffness_matrix(rigid, "axis"), UnknownNameError, "axis is rigid; allowed: mount"),
        (lambda: joint_stiffness_matrix("flexible_arm", "upper_tip"), UnknownNameError, node),
        (lambda: joint_stiffness_matrix(robot, "mount", drives="free"), InputError, "'free' drives hold nothing"),
        (lambda: joint_stiffness_matrix(robot, "mount").save("K.pdf"), InputError, r"path: .*K\.pdf"),
    ):
        refused(kind, said, call)
