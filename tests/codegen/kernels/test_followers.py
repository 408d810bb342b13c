"""Followers of rigid couplings are no coordinates: all kernels against the uncoupled tree, reduced in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import eomgen
from eomgen.robot.value import Robot
from tests.support.random_followers import Reduction, with_followers
from tests.support.random_robots import Array, random_robot, random_state, seeds, some_prescribed, with_offsets
from tests.support.random_springs import with_springs

Build = Callable[..., eomgen.Kernel]

KERNELS = (
    *("mass_matrix", "bias_force", "generalized_force", "external_force", "residual", "inverse_dynamics"),
    *("residual_jacobian", "coriolis_matrix", "christoffel", "kinematics", "energy", "reactions", "external_reactions"),
    *("regressor", "forward_dynamics", "forward_dynamics_jacobian", "coupling_forces", "external_coupling_forces"),
)
TIGHT = 1e-11


def sample(seed: int) -> tuple[Robot, Robot]:
    """A random robot with couplings, and without."""
    kinds = seed % 4
    robot = random_robot(seed, joints=(2, 4), max_coordinates=3, max_size=8, tree=bool(seed % 2), rods=False)
    if kinds == 1:
        robot = with_springs(robot, seed)
    if kinds == 2:
        robot = with_offsets(robot, seed)
    if kinds == 3:
        robot = some_prescribed(robot, seed)
    coupled = with_followers(robot, seed, tuned=bool(seed % 3))
    return coupled, robot


def near(found: Array, expected: Array, tolerance: float = TIGHT) -> None:
    size = max(1.0, float(np.abs(expected).max(initial=0.0)))
    assert found.shape == expected.shape
    assert np.abs(found - expected).max(initial=0.0) <= tolerance * size


@pytest.mark.parametrize("seed", seeds(0, 4, 60))
def test_kernels_are_those_of_the_tree_reduced(seed: int, built: Build) -> None:
    coupled, robot = sample(seed)
    map_ = Reduction.of(robot, coupled.couplings)
    kernel, tree = built(coupled, *KERNELS, *build_extras(coupled)), built(robot, *KERNELS[:-2], *build_extras(coupled))
    assert kernel.coordinates == map_.names
    assert kernel.constraints == ()
    rng = np.random.default_rng(seed)
    states = [random_state(robot, rng) for _ in range(7)]
    keep = [tree.coordinates.index(name) for name in kernel.coordinates]
    q, v, a, u = (np.array([getattr(state, name)[keep] for state in states]) for name in "qvau")
    Q, V, A = map_.positions(q), map_.motions(v), map_.motions(a)
    for name, (here, rate) in kernel.followers(q, v).items():
        near(here, Q[:, tree.coordinates.index(name)])
        near(rate, V[:, tree.coordinates.index(name)])
    near(kernel.mass_matrix(q), map_.matrix(tree.mass_matrix(Q)))
    near(kernel.bias_force(q, v), map_.forces(tree.bias_force(Q, V)))
    near(kernel.generalized_force(q, v), map_.forces(tree.generalized_force(Q, V)))
    near(kernel.inverse_dynamics(q, v, a), map_.forces(tree.inverse_dynamics(Q, V, A)))
    near(kernel.residual(q, v, a, u), map_.forces(tree.inverse_dynamics(Q, V, A)) - u)
    near(kernel.coriolis_matrix(q, v), map_.matrix(tree.coriolis_matrix(Q, V)))
    near(kernel.christoffel(q), np.einsum("Nabc,ai,bj,ck->Nijk", tree.christoffel(Q), map_.S, map_.S, map_.S))
    for found, expected in zip(kernel.residual_jacobian(q, v, a), tree.residual_jacobian(Q, V, A), strict=True):
        near(found, map_.matrix(expected))
    for found, expected in zip(kernel.energy(q, v).T, tree.energy(Q, V).T, strict=True):
        near(found, expected)
    near(kernel.reactions(q, v, a), tree.reactions(Q, V, A))
    for frame in (kernel.frames[0], kernel.frames[-1]):
        near(kernel.frame_pose(q, frame), tree.frame_pose(Q, frame))
        near(kernel.frame_jacobian(q, frame), tree.frame_jacobian(Q, frame) @ map_.S)
    wrench = rng.normal(size=(7, len(kernel.links), 6))
    near(kernel.external_force(q, wrench), map_.forces(tree.external_force(Q, wrench)))
    near(kernel.inverse_dynamics(q, v, a, wrench=wrench), map_.forces(tree.inverse_dynamics(Q, V, A, wrench=wrench)))
    if coupled.springs:
        near(kernel.spring_jacobian(q), tree.spring_jacobian(Q) @ map_.S)
        near(kernel.spring_stiffness(q), map_.matrix(tree.spring_stiffness(Q)))
    plain = kernel.inverse_dynamics(q, v, a) - kernel.inverse_dynamics(q, 0 * v, 0 * a)
    columns = kernel.regressor(q, v, a) - kernel.regressor(q, 0 * v, 0 * a)
    if not any(c.law() or c.damping for joint in robot.joints for c in joint.all_coordinates.values()):
        near(columns @ kernel.regressor_values, plain)
    accelerations(kernel, tree, map_, coupled, (q, v, u, wrench))


def build_extras(robot: Robot) -> tuple[str, ...]:
    return ("spring_jacobian", "spring_stiffness") if robot.springs else ()


def accelerations(
    kernel: eomgen.Kernel, tree: eomgen.Kernel, map_: Reduction, robot: Robot, states: tuple[Array, ...]
) -> None:
    """Accelerations and the couplings' forces by a dense solve of M A = f + J^T lambda, J A = 0 of all coordinates."""
    q, v, u, wrench = states
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    free = [i for i in range(kernel.n) if i not in given]
    Q, V = map_.positions(q), map_.motions(v)
    for outside in (None, wrench):
        a = kernel.forward_dynamics(q, v, u, wrench=outside)
        near(a[:, given], u[:, given], 0.0)
        bias = map_.forces(tree.inverse_dynamics(Q, V, 0 * V, wrench=outside))
        M = map_.matrix(tree.mass_matrix(Q))
        right = u - bias - np.einsum("Nij,Nj->Ni", M[:, :, given], u[:, given])
        if free:
            expected = np.linalg.solve(M[np.ix_(range(len(q)), free, free)], right[:, free, np.newaxis])[..., 0]
            near(a[:, free], expected, 1e-9)
        rows = np.zeros((len(robot.couplings), tree.n))
        for row, x in zip(rows, robot.couplings, strict=True):
            row[tree.coordinates.index(x.of)] = 1.0
            for name, ratio in x.to.items():
                row[tree.coordinates.index(name)] = -ratio
        needed = tree.inverse_dynamics(Q, V, map_.motions(a), wrench=outside)
        followers = [tree.coordinates.index(x.of) for x in robot.couplings]
        held = np.linalg.solve(rows[:, followers].T, needed[:, followers].T).T
        near(kernel.constraint_forces(q, v, u, wrench=outside), held, 1e-9)
    assert kernel.couplings == tuple(x.name for x in robot.couplings)
    by_q, by_v, by_u = kernel.forward_dynamics_jacobian(q, v, u)
    r_q, r_v, r_a = kernel.residual_jacobian(q, v, kernel.forward_dynamics(q, v, u))
    for found, slope in ((by_q, r_q), (by_v, r_v)):
        expected = np.zeros_like(found)
        inside = np.ix_(range(len(q)), free, free)
        expected[:, free] = -np.linalg.solve(r_a[inside], slope[:, free])
        near(found, expected, 1e-9)
    near(by_u[:, given][:, :, given], np.broadcast_to(np.eye(len(given)), (len(q), len(given), len(given))), 0.0)
