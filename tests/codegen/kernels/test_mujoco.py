"""Chains and trees of 6-DOF joints against MuJoCo: M, bias, inverse dynamics, energy, and a motion of 1 s."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.integration.solve import integrate
from eomgen.robot.value import COORDINATES, Coordinate, Link, Robot
from tests.conftest import Build
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.random_robots import random_robot, random_state

Motion = tuple[eomgen.Kernel, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def elastic_robot(seed: int, joints: int = 3, tree: bool = False) -> Robot:
    """Joints of all six coordinates, each with a spring, a damper and a third with armature; compact links.

    Springs of 50 to 500 N/m or N m/rad, at some kg and kg m^2: about 1 to 10 Hz.
    """
    rng = np.random.default_rng(seed)
    types = ("revolute", "prismatic")
    robot = random_robot(rng, (joints, joints), types=types, tree=tree, forces=False, name=f"mujoco{seed}")
    links = tuple(_compact(rng, link) for link in robot.links)
    moving = []
    for joint in robot.joints:
        table = {name: _properties(rng) for name in COORDINATES} if joint.coordinates else {}
        moving.append(replace(joint, coordinates=table))
    return replace(robot, links=links, joints=tuple(moving))


def _properties(rng: np.random.Generator) -> Coordinate:
    stiffness, damping = rng.uniform(50.0, 500.0), rng.uniform(0.5, 5.0)
    armature = rng.uniform(0.01, 0.3) if rng.random() < 0.3 else None
    return Coordinate(float(stiffness), float(damping), None if armature is None else float(armature))


def _compact(rng: np.random.Generator, link: Link) -> Link:
    """A body of at least a decimetre in all directions: MuJoCo takes no thin rod, and nothing swings fast."""
    a, b, c = (float(value) for value in rng.uniform(0.02, 0.1, 3))  # principal second moments
    com = tuple(float(0.5 * value) for value in link.com)
    return Link(link.name, float(rng.uniform(1.0, 6.0)), com, (b + c, a + c, a + b, 0.003, -0.002, 0.001))


@pytest.mark.parametrize(("seed", "tree"), [(1, False), (2, False), (3, True), (4, True)])
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


def test_motion_of_one_second_equals_mujocos_step_by_step(motion: Motion) -> None:
    """The same method with the same step: what differs is round-off."""
    kernel, q, v, u, states = motion
    ours = integrate(kernel, q, v, 1.0, drive=lambda *_: u, method="rk4", step=1e-4, output_step=0.01)
    assert ours.info["steps"] == 10_000
    assert np.abs(np.hstack([ours.q, ours.v]) - states).max() <= 1e-12


@pytest.mark.parametrize(("method", "rtol", "bound"), [("DOP853", 1e-11, 2e-9), ("Radau", 1e-8, 5e-8)])
def test_motion_of_one_second_equals_mujocos(motion: Motion, method: str, rtol: float, bound: float) -> None:
    kernel, q, v, u, states = motion
    ours = integrate(kernel, q, v, 1.0, drive=lambda *_: u, method=method, rtol=rtol, output_step=0.01)
    assert np.abs(np.hstack([ours.q, ours.v]) - states).max() <= bound
