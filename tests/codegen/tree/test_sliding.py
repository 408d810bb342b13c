"""Joints that slide along links that bend, beside Lagrange's equations of clouds of particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen.robot.model import build_model
from tests.codegen.tree.test_bending_trees import accelerations, answer, close, slopes
from tests.support.random_robots import seeds
from tests.support.sliding_robots import sliding_robot, sliding_state


@pytest.mark.parametrize("seed", seeds(100, 3, 30))
def test_random_robots_are_those_of_lagrange(seed: int) -> None:
    """Every third with a coordinate that slides as another one makes it."""
    robot, oracle = sliding_robot(seed, follows=seed % 3 == 1)
    s = sliding_state(robot, seed)
    M, residual = oracle.mass_matrix(s.q), oracle.residual(s.q, s.v, s.a, s.u)
    close(answer(robot, "mass_matrix", q=s.q), M)
    close(answer(robot, "residual", q=s.q, v=s.v, a=s.a, u=s.u), residual)
    close(answer(robot, "bias_force", q=s.q, v=s.v), oracle.bias_force(s.q, s.v))
    close(answer(robot, "energy", q=s.q, v=s.v), np.array(oracle.energy(s.q, s.v)))
    found = accelerations(robot, q=s.q, v=s.v, u=residual + s.u)
    assert found
    for a in found.values():
        close(a, s.a, 1e-13 * float(np.linalg.cond(M)))
    center, linear, angular = oracle.momentum(s.q, s.v)
    close(answer(robot, "center_of_mass", q=s.q), center)
    close(answer(robot, "centroidal_momentum", q=s.q, v=s.v), np.concatenate([linear, angular]))


@pytest.mark.parametrize("seed", seeds(200, 2, 12))
def test_frames_move_with_the_beam(seed: int) -> None:
    robot, oracle = sliding_robot(seed)
    s = sliding_state(robot, seed)
    frames = [x for x in oracle.robot.frames if x.name in ("tool", "on")]
    assert [x.name for x in frames] == list(build_model(robot).frames)[: len(frames)]
    poses = np.array([oracle.pose(frame, s.q)[:3] for frame in frames])
    close(answer(robot, "kinematics", q=s.q)[: poses.size], poses)
    rates = np.array([oracle.jacobian(frame, s.q) @ s.v for frame in frames])
    close(answer(robot, "frame_velocities", q=s.q, v=s.v)[: rates.size], rates)
    moved = np.array([oracle.acceleration(frame, (s.q, s.v, s.a)) for frame in frames])
    close(answer(robot, "frame_accelerations", q=s.q, v=s.v, a=s.a)[: moved.size], moved)


@pytest.mark.parametrize("seed", seeds(300, 0, 12))
def test_derivatives_are_those_of_complex_steps(seed: int) -> None:
    robot, oracle = sliding_robot(seed)
    s = sliding_state(robot, seed)
    arrays = {"q": s.q, "v": s.v, "a": s.a, "u": s.u}
    n = len(s.q)
    jacobian = answer(robot, "residual_jacobian", q=s.q, v=s.v, a=s.a).reshape(3, n, n)
    for found, label in zip(jacobian, "qva", strict=True):
        close(found.ravel(), slopes(robot, "residual", label, **arrays), 1e-11)
    symbols = oracle.christoffel(s.q)
    close(answer(robot, "christoffel", q=s.q), symbols, 1e-11)
    close(answer(robot, "coriolis_matrix", q=s.q, v=s.v), symbols @ s.v, 1e-11)


@pytest.mark.parametrize("seed", seeds(400, 1, 6))
def test_what_modes_leave_out_is_not_there(seed: int) -> None:
    """A rigid robot has a joint that slides along a straight link."""
    robot, oracle = sliding_robot(seed)
    rigid = robot.rigid()
    names = build_model(rigid).coordinates
    assert names == ("shoulder.gamma", "cross.z", "sway.gamma")
    s = sliding_state(robot, seed)
    places = [build_model(robot).coordinates.index(name) for name in names]
    q = np.zeros_like(s.q)
    q[places] = s.q[places]
    expected = oracle.mass_matrix(q)[np.ix_(places, places)]
    close(answer(replace(rigid, name="stiff"), "mass_matrix", q=q[places]), expected)
