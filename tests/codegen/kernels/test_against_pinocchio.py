"""Compiled kernels against Pinocchio: rigid robots from URDF, joints with several coordinates, frames, reactions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import ArrayError, EomgenWarning, SingularError
from eomgen.motion import inverse_kinematics
from eomgen.motion.ends import principal_limits
from eomgen.robot.value import COORDINATES, PRINCIPAL, Coordinate, Robot
from tests.oracles.pinocchio_models import PinocchioOracle, UrdfOracle
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs, load_without_mimics
from tests.support.optional import needs
from tests.support.random_robots import Array, random_robot, random_states, seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

pinocchio = needs("pinocchio")


TOLERANCE = 1e-11  # relative, max-norm
STATES = 100
DYNAMICS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
EVERY = (
    *DYNAMICS,
    "bias_force",
    "generalized_force",
    "residual",
    "coriolis_matrix",
    "energy",
    "reactions",
    "external_reactions",
    "external_force",
    "kinematics",
    "gravity",
    "nonlinear_effects",
    "center_of_mass",
    "centroidal_momentum",
    "frame_velocities",
    "frame_accelerations",
)
RIGID = (
    "ur5_robot",
    "panda",
    "talos_reduced",
    "kinova",
    "xarm7",
    "tiago_pro",
    "solo12",
    "allegro_right_hand",
    "icub_reduced",
    "so101",
)
QUICK = ("ur5_robot", "panda", "kinova", "xarm7")
EXAMPLES = {path.stem: path for path in example_urdfs()}


def errors(found: Array, expected: Array) -> Array:
    """Relative error of every state, max-norm; (states,)."""
    count = len(found)
    size = np.abs(expected).reshape(count, -1).max(axis=1)
    difference = np.abs(found - expected).reshape(count, -1).max(axis=1)
    return np.asarray(difference / np.maximum(size, 1e-300))


def each(function: Callable[..., Array], *arrays: Array) -> Array:
    """The oracle's function on every state."""
    return np.array([function(*state) for state in zip(*arrays, strict=True)])


def is_singular(M: Array) -> bool:
    """Whether some state's mass matrix is singular to working precision: a thin rod may turn about itself, say."""
    return bool(np.linalg.cond(M).max() > 1e15)


def check_dynamics(kernel: eomgen.Kernel, oracle: PinocchioOracle | UrdfOracle, states: tuple[Array, ...]) -> None:
    q, v, a, u = states
    M = each(oracle.mass_matrix, q)
    assert errors(kernel.mass_matrix(q), M).max() <= TOLERANCE
    assert errors(kernel.inverse_dynamics(q, v, a), each(oracle.inverse_dynamics, q, v, a)).max() <= TOLERANCE
    if is_singular(M):  # no accelerations, but an error
        refused(SingularError, "cannot be inverted", kernel.forward_dynamics, q, v, u)
        return
    limit = 100 * np.linalg.cond(M) * np.finfo(float).eps
    assert (errors(kernel.forward_dynamics(q, v, u), each(oracle.forward_dynamics, q, v, u)) <= limit).all()


@pytest.mark.parametrize("name", soaked(RIGID, QUICK))
def test_rigid_robots_from_urdf(name: str, built: Build) -> None:
    """Against Pinocchio's own reading of the file."""
    robot, oracle = load_without_mimics(EXAMPLES[name]), UrdfOracle(EXAMPLES[name])
    kernel = built(robot, *DYNAMICS, "reactions")
    assert [coordinate.rsplit(".", 1)[0] for coordinate in kernel.coordinates] == oracle.joints
    states = random_states(robot, 1, STATES)
    check_dynamics(kernel, oracle, states)
    q, v, a, _ = (array[:20] for array in states)
    turns = np.array([robot.joint(name).axis_turn for name in kernel.joints])
    wrenches = each(oracle.reactions, q, v, a).reshape(len(q), kernel.n, 2, 3)
    expected = np.einsum("kji,nkwj->nkwi", turns, wrenches).reshape(len(q), kernel.n, 6)  # z becomes the axis
    assert errors(kernel.reactions(q, v, a), expected).max() <= TOLERANCE


def all_coordinates(robot: Robot) -> Robot:
    """The robot with springs, dampers and all six coordinates in every joint that moves."""
    rng = np.random.default_rng(5)
    moving = [joint for joint in robot.joints if joint.coordinates]
    added = {
        joint.name: {
            name: Coordinate(float(rng.uniform(1e2, 1e4)), float(rng.uniform(0.1, 10.0)))
            for name in COORDINATES
            if name != PRINCIPAL[joint.type]
        }
        for joint in moving
    }
    return robot.with_coordinates(added)


@pytest.mark.parametrize("seed", [*seeds(200, 1, 12), *seeds(1000, 0, 300)])
def test_random_trees(seed: int, built: Build) -> None:
    """Random subsets of coordinates, branches, welded links, turned axes, rotors, springs."""
    robot = random_robot(seed, joints=(2, 5), tree=True, types=("revolute", "prismatic", "fixed", "free"))
    kernel, oracle = built(robot, *EVERY), PinocchioOracle(robot)
    states = random_states(robot, seed, 10)
    check_dynamics(kernel, oracle, states)
    q, v, a, u = states
    wanted = each(oracle.inverse_dynamics, q, v, a)
    scale = np.abs(wanted).max() + np.abs(each(oracle.generalized_force, q, v)).max()
    assert np.abs(kernel.residual(q, v, a, u) - (wanted - u)).max() <= TOLERANCE * scale
    for name, own, arrays in (
        ("bias_force", "bias_force", (q, v)),
        ("generalized_force", "generalized_force", (q, v)),
        ("gravity", "weights", (q,)),
        ("nonlinear_effects", "nonlinear_effects", (q, v)),
    ):
        expected = each(getattr(oracle, own), *arrays)
        assert np.abs(getattr(kernel, name)(*arrays) - expected).max() <= TOLERANCE * scale, name
    momentum = each(oracle.centroidal_momentum, q, v)
    assert np.abs(kernel.centroidal_momentum(q, v) - momentum).max() <= TOLERANCE * np.abs(momentum).max()
    C = each(oracle.coriolis_matrix, q, v)
    size = np.abs(kernel.mass_matrix(q)).max() * np.abs(v).max()  # C itself may be nothing but round-off
    assert np.abs(kernel.coriolis_matrix(q, v) - C).max() <= TOLERANCE * size
    for name, arrays in (("center_of_mass", (q,)), ("energy", (q, v)), ("reactions", (q, v, a))):
        assert errors(getattr(kernel, name)(*arrays), each(getattr(oracle, name), *arrays)).max() <= TOLERANCE, name
    wrench = np.random.default_rng(seed).normal(size=(len(q), len(kernel.links), 6))
    loaded = each(oracle.reactions_with, q, v, a, wrench)
    assert errors(kernel.reactions(q, v, a, wrench=wrench), loaded).max() <= TOLERANCE
    assert errors(kernel.reactions(q[0], v[0], a[0], wrench=wrench[0])[None], loaded[:1]).max() <= TOLERANCE
    for frame in kernel.frames:
        assert errors(kernel.frame_pose(q, frame), np.array([oracle.frame_pose(s, frame) for s in q])).max() <= 1e-13
        expected = np.array([oracle.frame_jacobian(s, frame) for s in q])
        assert np.abs(kernel.frame_jacobian(q, frame) - expected).max() <= 1e-13
        for reference in ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"):
            for name, arrays in (("frame_velocity", (q, v)), ("frame_acceleration", (q, v, a))):
                moved = [getattr(oracle, name)(*s, frame, reference) for s in zip(*arrays, strict=True)]
                found = getattr(kernel, name)(*arrays, frame, reference)
                assert np.abs(found - moved).max() <= TOLERANCE * (1.0 + np.abs(moved).max())
    check_wrench(kernel, oracle, states, seed)


def check_wrench(kernel: eomgen.Kernel, oracle: PinocchioOracle, states: tuple[Array, ...], seed: int) -> None:
    """The keyword ``wrench``: J^T w with its sign, in every kernel that takes it."""
    q, v, a, u = states
    wrench: NDArray[np.float64] = np.random.default_rng(seed).uniform(-5, 5, (len(q), len(kernel.links), 6))
    assert list(kernel.links) == oracle.links
    external = each(oracle.external_force, q, wrench)
    assert errors(kernel.functions.external_force(q, wrench), external).max() <= TOLERANCE
    for name, sign, arguments in (
        ("generalized_force", 1, (q, v)),
        ("residual", -1, (q, v, a, u)),
        ("inverse_dynamics", -1, (q, v, a)),
    ):
        call = getattr(kernel, name)
        assert errors(call(*arguments, wrench=wrench), call(*arguments) + sign * external).max() <= TOLERANCE
    if is_singular(kernel.mass_matrix(q)):
        return
    found = kernel.forward_dynamics(q, v, u, wrench=wrench)
    assert np.allclose(found, kernel.forward_dynamics(q, v, u + external), rtol=1e-10, atol=1e-10)


@pytest.mark.soak
def test_two_arms_on_an_elastic_torso(built: Build) -> None:
    """A tree of joints with up to six coordinates: Pinocchio's numbers, and nothing between the arms."""
    robot = eomgen.load_robot("two_arms")
    kernel, oracle = built(robot, *DYNAMICS, "reactions", "energy"), PinocchioOracle(robot)
    q, v, a, _ = states = random_states(robot, 7, 10)
    check_dynamics(kernel, oracle, states)
    assert errors(kernel.reactions(q, v, a), each(oracle.reactions, q, v, a)).max() <= TOLERANCE
    assert errors(kernel.energy(q, v), each(oracle.energy, q, v)).max() <= TOLERANCE
    arms = [[i for i, name in enumerate(kernel.coordinates) if name.startswith(side)] for side in ("left", "right")]
    assert (kernel.mass_matrix(q)[:, np.array(arms[0])[:, None], arms[1]] == 0.0).all()
    assert len(arms[0]) == len(arms[1]) == 10


def six_each(seed: int) -> Robot:
    """Random bodies, placements, springs and rotors; free joints among revolute and prismatic ones."""
    robot = random_robot(seed, joints=(2, 3), types=("free",) if seed == 0 else ("revolute", "prismatic", "free"))
    table = dict.fromkeys(COORDINATES, Coordinate(50.0, 1.0, 0.1))
    return robot.with_coordinates({joint.name: table for joint in robot.joints if joint.coordinates})


MANY: dict[str, Callable[[], Robot]] = {
    "elastic puma": lambda: eomgen.load_robot("puma560_elastic"),
    "ur5, six coordinates each": lambda: all_coordinates(load_without_mimics(EXAMPLES["ur5_robot"])),
    **{f"chain {seed}": partial(six_each, seed) for seed in range(3)},
}


@pytest.mark.parametrize("name", soaked(MANY, ["elastic puma"]))
def test_joints_of_many_coordinates(name: str, built: Build) -> None:
    """Every joint hands on no inertia."""
    robot = MANY[name]()
    check_dynamics(built(robot, *DYNAMICS), PinocchioOracle(robot), random_states(robot, 3, STATES))


MIMIC_KERNELS = ("mass_matrix", "inverse_dynamics", "forward_dynamics", "kinematics")
MIMICS = (
    "panda",
    *(pytest.param(name, marks=pytest.mark.soak) for name in ("baxter", "tiago_pro", "pr2")),
)


def by_name(model: Any) -> tuple[list[str], Callable[[Array], Array]]:
    """Names of the joints that have positions of their own, and what makes Pinocchio's q of these joints' angles."""
    joints = [i for i in range(1, model.njoints) if model.joints[i].shortname() != "JointModelMimic"]

    def placed(angles: Array) -> Array:
        q = pinocchio.neutral(model)
        for i, x in zip(joints, angles, strict=True):
            joint = model.joints[i]
            q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        return q

    return [model.names[i] for i in joints], placed


@pytest.mark.soak
@pytest.mark.parametrize("name", ["talos_full_v2", "romeo"])
@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_mimics_are_projections_of_free_joints(name: str, built: Build) -> None:
    """Pinocchio 4.1 makes no mimic models of these; what it has of their free joints is projected here."""
    path = EXAMPLES[name]
    robot, model = eomgen.load_robot(path, inertia="warn"), pinocchio.buildModelFromUrdf(str(path))
    kernel, data = built(robot, *MIMIC_KERNELS), model.createData()
    names, placed = by_name(model)
    known = [f"{joint}.{PRINCIPAL[robot.joint(joint).type]}" for joint in names]
    assert kernel.follower_names

    def angles(q: Array, v: Array) -> tuple[Array, Array]:
        followers = kernel.followers(q, v)
        moving = {**dict(zip(kernel.coordinates, zip(q, v, strict=True), strict=True)), **followers}
        found = np.array([moving[name][:2] for name in known])
        return found[:, 0], found[:, 1]

    still = np.zeros(kernel.n)
    G = np.array([angles(still, unit)[1] for unit in np.eye(kernel.n)]).T
    assert G.shape == (model.nv, kernel.n)
    rng = np.random.default_rng(4)
    for q, v, a in rng.uniform(-1.0, 1.0, (5, 3, kernel.n)):
        p = placed(angles(q, v)[0])
        M = np.triu(pinocchio.crba(model, data, p))
        M = G.T @ (M + np.triu(M, 1).T) @ G
        assert np.abs(kernel.mass_matrix(q) - M).max() <= 1e-12 * np.abs(M).max()
        drives = G.T @ pinocchio.rnea(model, data, p, G @ v, G @ a)
        assert np.abs(kernel.inverse_dynamics(q, v, a) - drives).max() <= 1e-11 * max(1.0, np.abs(drives).max())


@pytest.mark.parametrize("name", MIMICS)
@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_mimics_are_pinocchios(name: str, built: Build) -> None:
    path = EXAMPLES[name]
    robot, model = eomgen.load_robot(path, inertia="warn"), pinocchio.buildModelFromUrdf(str(path), mimic=True)
    kernel, data = built(robot, *MIMIC_KERNELS), model.createData()
    assert kernel.follower_names
    names, placed = by_name(model)
    order = [names.index(coordinate.rsplit(".", 1)[0]) for coordinate in kernel.coordinates]
    assert sorted(order) == list(range(model.nv))
    back = np.argsort(order)
    rng = np.random.default_rng(4)
    for q, v, a in rng.uniform(-1.0, 1.0, (5, 3, kernel.n)):
        p, rates, accelerations = placed(q[back]), v[back], a[back]
        M = np.triu(pinocchio.crba(model, data, p))
        M = (M + np.triu(M, 1).T)[np.ix_(order, order)]
        size = np.abs(M).max()
        assert np.abs(kernel.mass_matrix(q) - M).max() <= 1e-12 * size
        drives = pinocchio.rnea(model, data, p, rates, accelerations)[order]
        assert np.abs(kernel.inverse_dynamics(q, v, a) - drives).max() <= 1e-11 * max(1.0, np.abs(drives).max())
        pinocchio.framesForwardKinematics(model, data, p)
        for frame in model.frames:
            if frame.type == pinocchio.FrameType.BODY and frame.name in kernel.frames:
                pose = data.oMf[model.getFrameId(frame.name, pinocchio.FrameType.BODY)].homogeneous
                assert np.abs(kernel.frame_pose(q, frame.name) - pose).max() <= 1e-12 * max(1.0, np.abs(pose).max())
        if np.linalg.cond(M) < 1e12:
            assert np.abs(kernel.forward_dynamics(q, v, kernel.inverse_dynamics(q, v, a)) - a).max() <= 1e-8
            expected = np.linalg.solve(M, drives - pinocchio.rnea(model, data, p, rates, 0.0 * a)[order])
            assert np.abs(expected - a).max() <= 1e-8


@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_arrays_of_the_old_length_are_refused_by_name(built: Build) -> None:
    """Followers of a Panda's hand are coordinates with urdf_mimic=False alone."""
    path: Path = EXAMPLES["panda"]
    kernel = built(eomgen.load_robot(path, inertia="warn"), "mass_matrix")
    with pytest.raises(ArrayError, match=r"got shape \(9,\) \(panda_finger_joint2\.z follows others and is none"):
        kernel.mass_matrix(np.zeros(9))
    refused(ArrayError, r"got shape \(10,\)$", kernel.mass_matrix, np.zeros(10))
    free = built(eomgen.load_robot(path, inertia="warn", urdf_mimic=False), "mass_matrix")
    assert free.mass_matrix(np.zeros(9)).shape == (9, 9)
    assert free.follower_names == ()


@pytest.mark.filterwarnings(f"ignore::{EomgenWarning.__module__}.EomgenWarning")
def test_the_hand_of_a_panda_reaches_where_it_was(built: Build) -> None:
    """Fingers that follow each other do not hinder inverse kinematics, nor the drives of any state."""
    robot = eomgen.load_robot(EXAMPLES["panda"], inertia="warn")
    kernel = built(robot, "kinematics", "inverse_dynamics")
    ends = np.array([principal_limits(robot, name) for name in kernel.coordinates])
    rng = np.random.default_rng(0)
    for q in rng.uniform(ends[:, 0], ends[:, 1], (25, kernel.n)):
        pose = kernel.frame_pose(q, "panda_hand")
        found = inverse_kinematics(kernel, pose, robot=robot, frame="panda_hand")
        assert np.abs(kernel.frame_pose(found, "panda_hand") - pose).max() <= 1e-6
        assert np.isfinite(kernel.inverse_dynamics(q, q, q)).all()
