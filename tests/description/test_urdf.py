"""URDFs: the reader against Pinocchio's on all of example-robot-data, each of which ends in a working kernel."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import eomgen
from eomgen.description.load import load_robot, robot_from_urdf
from eomgen.errors import DescriptionError, EomgenWarning, SingularError
from eomgen.identification.calibration.as_urdf import urdf_of
from eomgen.robot.bounds import Limits
from eomgen.robot.geometry import IDENTITY, axis_turn
from eomgen.robot.value import Coordinate, Friction, Robot
from tests.oracles.pinocchio_models import PinocchioOracle, UrdfOracle
from tests.support.builds import Build
from tests.support.description_samples import URDF, example_urdfs, link_poses
from tests.support.optional import OptionalModule

pytestmark = pytest.mark.usefixtures("unoptimised")
pin = OptionalModule("pinocchio")
EXAMPLES = example_urdfs()
PASSIVE = {"quadrotor_base.urdf", "iris_simple.urdf", "ur3.urdf"}  # no moving joint (ur3: an empty robot)
MOVING = [path for path in EXAMPLES if path.name not in PASSIVE]


def name_of(path: Path) -> str:
    return f"{path.parts[-3]}/{path.name}"


def quietly(path: Path, inertia: str) -> Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return load_robot(path, inertia=inertia)


def pinocchio_state(model: object, robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A random state of the robot, and Pinocchio's configuration vector of it."""
    joints = [joint for joint in robot.joints if joint.coordinates]
    q = rng.uniform(-2, 2, len(joints))
    configuration = pin.neutral(model)
    for joint, value, at in zip(joints, q, list(model.joints)[1:], strict=True):  # type: ignore[attr-defined]
        assert at.nv == 1, joint
        configuration[at.idx_q : at.idx_q + at.nq] = [value] if at.nq == 1 else [np.cos(value), np.sin(value)]
    return q, configuration


def test_the_examples_are_there() -> None:
    assert len(EXAMPLES) >= 69


@pytest.mark.parametrize("path", MOVING, ids=name_of)
def test_order_poses_and_inertia_equal_pinocchios(path: Path) -> None:
    robot, model = quietly(path, "warn"), pin.buildModelFromUrdf(str(path))
    moving = [joint.name for joint in robot.joints if joint.type != "fixed"]
    assert moving == [re.sub("[^A-Za-z0-9_]", "_", name) for name in list(model.names)[1:]]
    data = model.createData()
    q, configuration = pinocchio_state(model, robot, np.random.default_rng(0))
    pin.framesForwardKinematics(model, data, configuration)
    poses = link_poses(robot, q)
    bodies = [index for index, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY]
    assert len(bodies) == len(robot.links) + 1
    for index in bodies:
        name = re.sub("[^A-Za-z0-9_]", "_", model.frames[index].name)
        assert np.allclose(poses[name], data.oMf[index].homogeneous, atol=1e-12), name
    pin.ccrba(model, data, configuration, np.zeros(model.nv))
    mass, com, inertia = composite(robot, poses)
    scale = np.abs(inertia).max()
    assert np.isclose(mass, data.Ig.mass, rtol=1e-12)
    assert np.allclose(com, data.com[0], atol=1e-12)
    assert np.allclose(inertia, data.Ig.inertia, atol=1e-11 * scale)


def composite(robot: Robot, poses: dict[str, np.ndarray]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it of all that moves, base axes."""
    fixed = {robot.base}
    for joint in robot.joints:
        if joint.parent in fixed and not joint.coordinates:
            fixed.add(joint.child)
    links = [link for link in robot.links if link.name not in fixed]
    points = {link.name: (poses[link.name] @ [*link.com, 1.0])[:3] for link in links}
    mass = sum(link.mass for link in links)
    com = sum(link.mass * points[link.name] for link in links) / mass
    total = np.zeros((3, 3))
    for link in links:
        xx, yy, zz, xy, xz, yz = link.inertia
        rotation, arm = poses[link.name][:3, :3], points[link.name] - com
        total += rotation @ [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] @ rotation.T
        total += link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, com, total


def diagnosis(path: Path, inertia: str | None) -> DescriptionError | None:
    """The error with which a file is refused."""
    try:
        load_robot(path, inertia=inertia)
    except DescriptionError as error:
        return error
    return None


@pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")
def test_every_example_loads_but_three_in_which_nothing_moves() -> None:
    assert {path.name for path in EXAMPLES if diagnosis(path, None) is not None} == PASSIVE


def test_every_example_loads_or_is_refused_with_a_place() -> None:
    """11 files have an inertia that no body can have, 4 of them an indefinite one; 3 have nothing that moves."""
    refused = {path: error for path in EXAMPLES if (error := diagnosis(path, "error")) is not None}
    for path, error in refused.items():
        assert str(path) in str(error)
        assert "allowed" in str(error)
    assert {path.name for path in refused if path not in MOVING} == PASSIVE
    moving = {path: error for path, error in refused.items() if path in MOVING}
    for error in moving.values():
        assert re.fullmatch(r"links\.[A-Za-z0-9_]+\.inertia", error.where)
        assert "eigenvalue -" in error.message
        assert '"project"' in error.message
    assert len(moving) == 11
    indefinite = [path for path in moving if any(is_indefinite(link) for link in quietly(path, "warn").links)]
    assert len(indefinite) == 4


def is_indefinite(link: object) -> bool:
    values = moments(link)
    return bool(values[0] < -1e-15 * abs(values).max())


def moments(link: object) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = link.inertia  # type: ignore[attr-defined]
    return np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("policy", ["warn", "project"])
def test_inertia_policies_load_every_moving_example(policy: str) -> None:
    for path in MOVING:
        robot = quietly(path, policy)
        assert all(note.isascii() and note.isprintable() for note in robot.notes)
        if policy == "project":
            for link in robot.links:
                low, middle, high = moments(link)
                assert low + middle - high >= -2e-9 * max(abs(high), link.mass * np.dot(link.com, link.com))


@pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")  # of the other link
@pytest.mark.parametrize("policy", ["warn", "project"])
def test_a_changed_or_strange_inertia_is_never_silent(policy: str) -> None:
    path = next(path for path in EXAMPLES if path.name == "pr2.urdf")
    with pytest.warns(EomgenWarning, match="sensor_mount_link"):
        robot = load_robot(path, inertia=policy)
    assert any("sensor_mount_link" in note and "(0.001, 0.001, 0.01," in note for note in robot.notes)


@pytest.mark.parametrize(
    "axis",
    [
        (0, 0, 1),
        (0, 0, -1),
        (1, 0, 0),
        (-1, 0, 0),
        (0, 1, 0),
        (0, -2, 0),
        (1, 1, 0),
        (0, 3, 4),
        (-1, 0, 2),
        (1, 2, 3),
        (1e-9, 0, 5),
        (-1, -1, -1),
    ],
)
def test_axis_turn_is_a_rotation_onto_the_axis(axis: tuple[float, float, float]) -> None:
    turn = np.array(axis_turn(axis))
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.isclose(np.linalg.det(turn), 1.0)
    assert np.allclose(turn[:, 2], np.array(axis) / np.linalg.norm(axis), atol=1e-16)
    exact = int(np.isin(turn, (-1.0, 0.0, 1.0)).sum())
    zeros = sum(component == 0 for component in axis)
    assert exact >= {0: 1, 1: 5, 2: 9}[zeros]


def test_joint_value_has_the_sign_of_the_urdf() -> None:
    robot = robot_from_urdf(URDF)
    pose = link_poses(robot, np.array([0.3, 0.0]))["upper"]
    turned = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])  # about +y
    yaw = np.array([[np.cos(0.1), -np.sin(0.1), 0], [np.sin(0.1), np.cos(0.1), 0], [0, 0, 1]])
    assert np.allclose(pose[:3, :3], yaw @ turned, atol=1e-15)
    assert np.allclose(pose[:3, 3], [0, 0, 0.5])
    assert robot.joints[0].limits == (-1.0, 2.0)
    assert robot.joints[1].limits is None
    assert robot.joints[0].placement.rpy == (0.0, 0.0, 0.1)
    assert robot.joints[1].placement.rpy is None


def test_inertia_is_turned_to_link_axes() -> None:
    link = robot_from_urdf(URDF).links[0]
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    expected = turn @ [[0.1, 0.01, 0], [0.01, 0.2, 0], [0, 0, 0.15]] @ turn.T
    xx, yy, zz, xy, xz, yz = link.inertia
    assert np.allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], expected, atol=1e-16)
    assert link.com == (0.1, 0.0, 0.2)


def test_damping_is_read_on_request_only() -> None:
    """Pinocchio's inverse dynamics leaves it out; so does the default here, with a note."""
    model = pin.buildModelFromXML(URDF)
    still = pin.rnea(model, model.createData(), np.zeros(3), np.array([1.0, 0.0]), np.zeros(2))
    model.damping[:] = 0.0
    assert np.array_equal(still, pin.rnea(model, model.createData(), np.zeros(3), np.array([1.0, 0.0]), np.zeros(2)))
    plain, damped = robot_from_urdf(URDF), robot_from_urdf(URDF, urdf_damping=True)
    assert plain.joints[0].coordinates["gamma"].damping is None
    assert any("urdf_damping" in note and "'shoulder'" in note for note in plain.notes)
    assert damped.joints[0].coordinates["gamma"].damping == 0.7
    assert damped.notes == ()


def test_friction_is_read_on_request_only() -> None:
    text = URDF.replace('<dynamics damping="0.7"/>', '<dynamics damping="0.7" friction="0.3"/>')
    plain, rough = robot_from_urdf(text, urdf_damping=True), robot_from_urdf(text, urdf_friction=True)
    limits = Limits(velocity=1.0, effort=10.0)
    assert plain.joints[0].coordinates == {"gamma": Coordinate(damping=0.7, limits=limits)}
    assert rough.joints[0].coordinates == {"gamma": Coordinate(friction=Friction(0.3), limits=limits)}
    assert [note for note in plain.notes if "friction" in note and "urdf_friction=True" in note]
    (note,) = [note for note in rough.notes if "friction" in note]
    assert "'shoulder'" in note
    assert "4e-08 rad/s or m/s" in note
    assert rough.joints[0].coordinates["gamma"].law()["friction.smoothing"] == 4e-8
    with pytest.raises(DescriptionError, match=r"<dynamics>: friction is -0\.3; allowed: at least 0"):
        robot_from_urdf(text.replace('"0.3"', '"-0.3"'), urdf_friction=True)


def test_mimic_and_friction_are_noted() -> None:
    text = URDF.replace('<dynamics damping="0.7"/>', '<dynamics friction="0.1"/><mimic joint="elbow"/>')
    notes = robot_from_urdf(text).notes
    assert "mimic joints are coupled rigidly to those they follow: 'shoulder'" in notes
    plain = robot_from_urdf(text, urdf_mimic=False)
    assert plain.couplings == ()
    assert "mimic joints are read as independent (urdf_mimic=True couples them): 'shoulder'" in plain.notes
    assert any("friction" in note and "'shoulder'" in note for note in notes)


def test_floating_joint_is_free_and_massless_link_is_a_link() -> None:
    text = URDF.replace('type="continuous"', 'type="floating"')
    text = re.sub('<link name="lower">.*?</link>', '<link name="lower"/>', text, flags=re.DOTALL)
    robot = robot_from_urdf(text)
    assert list(robot.joints[1].coordinates) == ["x", "y", "z", "alpha", "beta", "gamma"]
    assert robot.joints[1].axis_turn == IDENTITY
    assert robot.links[1].mass == 0.0


@pytest.mark.quick
@pytest.mark.parametrize("axis", ["0 0 1", "1 0 0", "0.6 0 -0.8"])
def test_planar_joints_move_across_and_about_their_axis(axis: str) -> None:
    """And come back from a URDF that is written; what follows them does not."""
    text = re.sub('"continuous"(.*?)<axis [^>]*>', rf'"planar"\1<axis xyz="{axis}"/>', URDF, flags=re.DOTALL)
    robot = robot_from_urdf(text.replace("</joint>", '<mimic joint="elbow"/></joint>', 1))
    elbow = next(joint for joint in robot.joints if joint.name == "elbow")
    assert (list(elbow.coordinates), elbow.axis_turn) == (["x", "y", "gamma"], axis_turn([*map(float, axis.split())]))
    normal = link_poses(robot, np.zeros(4))["lower"][:3, :3] @ [float(x) for x in axis.split()]
    moved, still = (link_poses(robot, np.array([0.0, *q]))["lower"] for q in ((0.3, -0.2, 0.7), (0.0, 0.0, 0.0)))
    assert normal @ (moved - still)[:3, 3] == pytest.approx(0.0, abs=1e-15)
    assert moved[:3, :3] @ still[:3, :3].T @ normal == pytest.approx(normal)
    assert np.linalg.norm((moved - still)[:3, 3]) == pytest.approx(np.hypot(0.3, 0.2))
    assert any("planar joints move along x and y" in note for note in robot.notes)
    assert any("the joint 'elbow' has no coordinate to follow" in note for note in robot.notes)
    again = robot_from_urdf(ElementTree.tostring(urdf_of(robot), encoding="unicode"))
    assert [list(x.coordinates) for x in again.joints] == [list(x.coordinates) for x in robot.joints]
    assert link_poses(again, np.full(4, 0.2))["lower"] == pytest.approx(link_poses(robot, np.full(4, 0.2))["lower"])


def test_foreign_names_become_unique_identifiers() -> None:
    text = URDF.replace('name="arm"', 'name="My Arm */"').replace('"upper"', '"a b"').replace('"lower"', '"a/b"')
    text = text.replace('"ground"', '"a_b"').replace('"shoulder"', '"1 ; system()"')
    robot = robot_from_urdf(text)
    assert robot.name == "my_arm___"
    assert robot.base == "a_b"
    assert sorted(link.name for link in robot.links) == ["a_b_2", "a_b_3"]
    assert "_1___system__" in [joint.name for joint in robot.joints]
    assert len(robot.notes) == 4


def test_a_name_that_is_no_latin_text() -> None:
    text = URDF.replace('name="arm"', 'name="\N{CJK UNIFIED IDEOGRAPH-4E2D}"').replace('"upper"', '"\N{BLACK STAR}"')
    robot = robot_from_urdf(text)
    assert re.fullmatch("[a-z][a-z0-9_]*", robot.name)
    assert all(note.isascii() for note in robot.notes)


NOTHING_MOVES = {"quadrotor_base.urdf", "iris_simple.urdf", "ur3.urdf"}
WITH_COORDINATES = [path for path in EXAMPLES if path.name not in NOTHING_MOVES]
WITHOUT_INERTIA = {  # a tip that nothing resists: links of these files have neither mass nor inertia
    "romeo.urdf": r"[LR]\w+\.gamma",
    "romeo_laas_small.urdf": r"[lr]_gripper_joint\.gamma",
}
EVERY_KERNEL = (pytest.param("anymal-kinova.urdf", marks=pytest.mark.soak), "bolt.urdf", "TwoDofs.urdf")
TOLERANCE = 1e-12


def load(path: Path, inertia: str | None = None) -> Robot:
    """The open tree, as Pinocchio reads it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return eomgen.load_robot(path, inertia=inertia, urdf_mimic=False)


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = TOLERANCE) -> bool:
    return bool(np.abs(found - expected).max() <= tolerance * np.abs(expected).max())


def test_the_files_without_coordinates_are_known() -> None:
    assert len(EXAMPLES) >= 69
    assert {path.name for path in EXAMPLES if path not in WITH_COORDINATES} == NOTHING_MOVES


def strictest_diagnosis(path: Path) -> DescriptionError | None:
    """The error with which a file is refused by the strictest policy."""
    try:
        eomgen.load_robot(path, inertia="error")
    except DescriptionError as error:
        return error
    return None


def quick(paths: list[Path]) -> list[Any]:
    """The paths; large robots, and more than one of a family, are for ``make soak``."""
    families, found = set(), list[Any]()
    for path in paths:
        joints = len(re.findall(r'<joint [^>]*type="[rcp]', path.read_text(encoding="utf-8")))
        kept = joints <= 7 and path.parts[-3] not in families
        families |= {path.parts[-3]} if kept else set()
        found.append(path if kept else pytest.param(path, marks=pytest.mark.soak))
    return found


@pytest.mark.parametrize("path", WITH_COORDINATES, ids=name_of)
def test_what_is_strange_in_an_example_is_said(path: Path) -> None:
    robot, error = load(path), strictest_diagnosis(path)
    assert any("no body can have" in note for note in robot.notes) == (error is not None)
    if error is not None:
        assert re.fullmatch(r"links\.[A-Za-z0-9_]+\.inertia", error.where)
        assert str(error).startswith(f"{path}:{error.line}:{error.column}: {error.where}: ")
        assert path.read_text(encoding="utf-8").splitlines()[error.line - 1].strip().startswith("<link")


@pytest.mark.parametrize("path", quick(WITH_COORDINATES), ids=name_of)
def test_example_ends_in_a_kernel(path: Path, built: Build) -> None:
    """With inertias as they are, which is the default, it equals Pinocchio."""
    robot = load(path)
    kernel = built(robot, "inverse_dynamics", "mass_matrix", "forward_dynamics")
    oracle, rng = UrdfOracle(path), np.random.default_rng(7)
    for _ in range(2):
        q, v, a, u = rng.uniform(-2, 2, (4, kernel.n))
        M = oracle.mass_matrix(q)
        assert close(kernel.mass_matrix(q), M)
        assert close(kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a))
        if path.name in WITHOUT_INERTIA:
            with pytest.raises(SingularError, match=WITHOUT_INERTIA[path.name]):
                kernel.forward_dynamics(q, v, u)
        else:
            limit = 100 * np.linalg.cond(M) * np.finfo(float).eps
            assert close(kernel.forward_dynamics(q, v, u), oracle.forward_dynamics(q, v, u), limit)


@pytest.mark.parametrize(
    "path", quick([path for path in WITH_COORDINATES if strictest_diagnosis(path) is not None]), ids=name_of
)
def test_projected_robots_work(path: Path, built: Build) -> None:
    """Where a link is no body: the nearest possible body gives a kernel too, of the robot as it then is."""
    robot = load(path, "project")
    assert any("projected to" in note for note in robot.notes)
    kernel, oracle = built(robot, "inverse_dynamics", "mass_matrix"), PinocchioOracle(robot)
    q, v, a = np.random.default_rng(8).uniform(-2, 2, (3, kernel.n))
    assert close(kernel.mass_matrix(q), oracle.mass_matrix(q))
    assert close(kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a))
    assert np.linalg.eigvalsh(kernel.mass_matrix(q))[0] >= -1e-12 * np.abs(kernel.mass_matrix(q)).max()


@pytest.mark.soak
@pytest.mark.parametrize("name", EVERY_KERNEL)
def test_every_kernel_of_some_examples(name: str, built: Build) -> None:
    path = next(path for path in WITH_COORDINATES if path.name == name)
    robot = load(path, "warn")
    kernel, oracle = built(robot), PinocchioOracle(robot)
    q, v, a = np.random.default_rng(9).uniform(-2, 2, (3, kernel.n))
    force = oracle.inverse_dynamics(q, v, a)
    size = np.abs(force).max() + np.abs(oracle.generalized_force(q, v)).max()
    assert np.abs(kernel.bias_force(q, v) - oracle.bias_force(q, v)).max() <= TOLERANCE * size
    assert np.abs(kernel.generalized_force(q, v) - oracle.generalized_force(q, v)).max() <= TOLERANCE * size
    assert np.abs(kernel.residual(q, v, a, force)).max() <= TOLERANCE * size
    assert np.abs(np.einsum("svw,v,w", kernel.christoffel(q), v, v) - oracle.bias_force(q, v)).max() <= TOLERANCE * size
    assert np.abs(kernel.coriolis_matrix(q, v) @ v - oracle.bias_force(q, v)).max() <= TOLERANCE * size
    assert close(kernel.energy(q, v), oracle.energy(q, v))
    assert close(kernel.reactions(q, v, a), oracle.reactions(q, v, a))
    for frame in kernel.frames:
        assert np.abs(kernel.frame_pose(q, frame) - oracle.frame_pose(q, frame)).max() <= 1e-13
        assert np.abs(kernel.frame_jacobian(q, frame) - oracle.frame_jacobian(q, frame)).max() <= 1e-13


def test_foreign_names_reach_the_kernel_as_identifiers(built: Build) -> None:
    """Names such as "base_link-arm" are mapped, and found again in the kernel."""
    changed = [
        path for path in WITH_COORDINATES if any("turned into identifiers" in note for note in load(path, "warn").notes)
    ]
    assert changed
    for path in changed[:1]:
        kernel = built(load(path, "warn"), "inverse_dynamics", "mass_matrix", "forward_dynamics")
        for name in (*kernel.joints, *kernel.links, *kernel.frames):
            assert re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name)
