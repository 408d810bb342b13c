"""Compiled kernels against Pinocchio: rigid robots from URDF, joints with several coordinates, frames, reactions."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.errors import EomgenWarning, SingularError
from eomgen.robot.value import COORDINATES, PRINCIPAL, Coordinate, Robot
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.soak import share, soaked

pytest.importorskip("pinocchio")
from tests.oracles.pinocchio_models import PinocchioOracle, UrdfOracle

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


def load(path: Path) -> Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return eomgen.load_robot(path, inertia="warn", urdf_mimic=False)


def random_states(robot: Robot, seed: int, count: int = STATES) -> tuple[Array, Array, Array, Array]:
    """q, v, a, u, each (count, n)."""
    rng = np.random.default_rng(seed)
    states = [random_state(robot, rng) for _ in range(count)]
    q, v, a, u = (np.array([getattr(state, name) for state in states]) for name in "qvau")
    return q, v, a, u


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
        with pytest.raises(SingularError, match="cannot be inverted"):
            kernel.forward_dynamics(q, v, u)
        return
    limit = 100 * np.linalg.cond(M) * np.finfo(float).eps
    assert (errors(kernel.forward_dynamics(q, v, u), each(oracle.forward_dynamics, q, v, u)) <= limit).all()


@pytest.mark.parametrize("name", soaked(RIGID, QUICK))
def test_rigid_robots_from_urdf(name: str, built: Build) -> None:
    """Against Pinocchio's own reading of the file."""
    robot, oracle = load(EXAMPLES[name]), UrdfOracle(EXAMPLES[name])
    kernel = built(robot, *DYNAMICS, "reactions")
    assert [coordinate.rsplit(".", 1)[0] for coordinate in kernel.coordinates] == oracle.joints
    states = random_states(robot, 1)
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


@pytest.mark.soak
def test_ur5_with_six_coordinates_in_every_joint(built: Build) -> None:
    """36 coordinates: every joint hands on no inertia."""
    robot = all_coordinates(load(EXAMPLES["ur5_robot"]))
    kernel, oracle = built(robot, *DYNAMICS), PinocchioOracle(robot)
    assert kernel.n == 36
    check_dynamics(kernel, oracle, random_states(robot, 2))


def test_elastic_puma(built: Build) -> None:
    robot = eomgen.load_robot("puma560_elastic")
    check_dynamics(built(robot), PinocchioOracle(robot), random_states(robot, 3))


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 3))
def test_chains_of_six_coordinates_per_joint(seed: int, built: Build) -> None:
    """Random bodies, placements, springs and rotors; free joints among revolute and prismatic ones."""
    robot = random_robot(seed, joints=(2, 3), types=("free",) if seed == 0 else ("revolute", "prismatic", "free"))
    robot = robot.with_coordinates(
        {
            joint.name: dict.fromkeys(COORDINATES, Coordinate(50.0, 1.0, 0.1))
            for joint in robot.joints
            if joint.coordinates
        }
    )
    check_dynamics(built(robot, *DYNAMICS), PinocchioOracle(robot), random_states(robot, seed))


@pytest.mark.parametrize("seed", seeds(200, 1, 12))
def test_random_trees(seed: int, built: Build) -> None:
    check_every_kernel(seed, built)


@pytest.mark.soak
@pytest.mark.parametrize("seed", share(range(1000, 1300)))
def test_many_random_trees(seed: int, built: Build) -> None:
    check_every_kernel(seed, built)


def check_every_kernel(seed: int, built: Build) -> None:
    """Random subsets of coordinates, branches, welded links, turned axes, rotors, springs."""
    robot = random_robot(seed, joints=(2, 5), tree=True, types=("revolute", "prismatic", "fixed", "free"))
    kernel, oracle = built(robot, *EVERY), PinocchioOracle(robot)
    states = random_states(robot, seed, 10)
    check_dynamics(kernel, oracle, states)
    q, v, a, u = states
    bias, force = each(oracle.bias_force, q, v), each(oracle.generalized_force, q, v)
    scale = np.abs(each(oracle.inverse_dynamics, q, v, a)).max() + np.abs(force).max()
    assert np.abs(kernel.bias_force(q, v) - bias).max() <= TOLERANCE * scale
    assert np.abs(kernel.generalized_force(q, v) - force).max() <= TOLERANCE * scale
    assert np.abs(kernel.gravity(q) - each(oracle.weights, q)).max() <= TOLERANCE * scale
    assert np.abs(kernel.nonlinear_effects(q, v) - each(oracle.nonlinear_effects, q, v)).max() <= TOLERANCE * scale
    assert errors(kernel.center_of_mass(q), each(oracle.center_of_mass, q)).max() <= TOLERANCE
    momentum = each(oracle.centroidal_momentum, q, v)
    assert np.abs(kernel.centroidal_momentum(q, v) - momentum).max() <= TOLERANCE * np.abs(momentum).max()
    residual = each(oracle.inverse_dynamics, q, v, a) - u
    assert np.abs(kernel.residual(q, v, a, u) - residual).max() <= TOLERANCE * scale
    C = each(oracle.coriolis_matrix, q, v)
    size = np.abs(kernel.mass_matrix(q)).max() * np.abs(v).max()  # C itself may be nothing but round-off
    assert np.abs(kernel.coriolis_matrix(q, v) - C).max() <= TOLERANCE * size
    assert errors(kernel.energy(q, v), each(oracle.energy, q, v)).max() <= TOLERANCE
    assert errors(kernel.reactions(q, v, a), each(oracle.reactions, q, v, a)).max() <= TOLERANCE
    wrench = np.random.default_rng(seed).normal(size=(len(q), len(kernel.links), 6))
    loaded = each(oracle.reactions_with, q, v, a, wrench)
    assert errors(kernel.reactions(q, v, a, wrench=wrench), loaded).max() <= TOLERANCE
    assert errors(kernel.reactions(q[0], v[0], a[0], wrench=wrench[0])[None], loaded[:1]).max() <= TOLERANCE
    for frame in kernel.frames:
        assert errors(kernel.frame_pose(q, frame), np.array([oracle.frame_pose(s, frame) for s in q])).max() <= 1e-13
        expected = np.array([oracle.frame_jacobian(s, frame) for s in q])
        assert np.abs(kernel.frame_jacobian(q, frame) - expected).max() <= 1e-13
        for reference in ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"):
            expected = np.array([oracle.frame_velocity(*s, frame, reference) for s in zip(q, v, strict=True)])
            found = kernel.frame_velocity(q, v, frame, reference)
            assert np.abs(found - expected).max() <= TOLERANCE * (1.0 + np.abs(expected).max())
            expected = np.array([oracle.frame_acceleration(*s, frame, reference) for s in zip(q, v, a, strict=True)])
            found = kernel.frame_acceleration(q, v, a, frame, reference)
            assert np.abs(found - expected).max() <= TOLERANCE * (1.0 + np.abs(expected).max())
    check_wrench(kernel, oracle, states, seed)


def check_wrench(kernel: eomgen.Kernel, oracle: PinocchioOracle, states: tuple[Array, ...], seed: int) -> None:
    """The keyword ``wrench``: J^T w with its sign, in every kernel that takes it."""
    q, v, a, u = states
    wrench: NDArray[np.float64] = np.random.default_rng(seed).uniform(-5, 5, (len(q), len(kernel.links), 6))
    assert list(kernel.links) == oracle.links
    external = each(oracle.external_force, q, wrench)
    assert errors(kernel.external_force(q, wrench), external).max() <= TOLERANCE
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
