"""Chains and trees of 6-DOF joints against MuJoCo: M, bias, inverse dynamics, energy, and a motion of 1 s."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.integration.solve import integrate
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.builds import Build
from tests.support.elastic_robots import elastic_robot
from tests.support.random_robots import random_state

Motion = tuple[eomgen.Kernel, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@pytest.mark.parametrize(
    ("seed", "tree"),
    [(1, False), (3, True), *(pytest.param(*case, marks=pytest.mark.soak) for case in ((2, False), (4, True)))],
)
def test_dynamics_equal_mujocos(seed: int, tree: bool, built: Build) -> None:
    robot = elastic_robot(seed, joints=4 if tree else 3, tree=tree)
    kernel = built(robot, "mass_matrix", "bias_force", "inverse_dynamics", "energy")
    oracle = MujocoRobot(robot)
    for i in range(10):
        state = random_state(robot, 100 * seed + i)
        pairs = [
            (kernel.mass_matrix(state.q), oracle.mass_matrix(state.q)),
            (kernel.bias_force(state.q, state.v), oracle.bias_force(state.q, state.v)),
            (kernel.inverse_dynamics(state.q, state.v, state.a), oracle.inverse_dynamics(state.q, state.v, state.a)),
            (kernel.energy(state.q, state.v), oracle.energy(state.q, state.v)),
        ]
        for ours, theirs in pairs:
            assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(theirs).max()


@pytest.fixture(scope="module")
def motion(built: Build) -> Motion:
    """A chain of three 6-DOF joints, let go with a velocity under constant drives: kernel, q, v, u, MuJoCo's motion."""
    robot = elastic_robot(11)
    rng = np.random.default_rng(11)
    q, v, u = rng.uniform(-0.1, 0.1, 18), rng.uniform(-0.3, 0.3, 18), rng.uniform(-3.0, 3.0, 18)
    states = MujocoRobot(robot, step=1e-4).trajectory(q, v, u, steps=10_000, every=100)
    assert np.abs(states[:, 18:]).max() > 1.0, "nothing moves"
    return built(robot, "forward_dynamics", "inverse_dynamics", "mass_matrix", "energy"), q, v, u, states


@pytest.mark.soak
def test_motion_of_one_second_equals_mujocos_step_by_step(motion: Motion) -> None:
    """The same method with the same step: what differs is round-off."""
    kernel, q, v, u, states = motion
    ours = integrate(kernel, q, v, 1.0, drive=lambda *_: u, method="rk4", step=1e-4, output_step=0.01)
    assert ours.info["steps"] == 10_000
    assert np.abs(np.hstack([ours.q, ours.v]) - states).max() <= 1e-12


@pytest.mark.parametrize(("method", "rtol", "bound"), [("scipy:DOP853", 1e-11, 2e-9), ("scipy:Radau", 1e-8, 5e-8)])
def test_motion_of_one_second_equals_mujocos(motion: Motion, method: str, rtol: float, bound: float) -> None:
    kernel, q, v, u, states = motion
    ours = integrate(kernel, q, v, 1.0, drive=lambda *_: u, method=method, rtol=rtol, output_step=0.01)
    assert np.abs(np.hstack([ours.q, ours.v]) - states).max() <= bound
