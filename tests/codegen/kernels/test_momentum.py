"""Gravity, center of mass and momentum by laws of mechanics: what they are of each other, what forces change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Robot
from tests.codegen.kernels.test_followers import sample
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, random_state, seeds

QUANTITIES = ("gravity", "nonlinear_effects", "bias_force", "center_of_mass", "centroidal_momentum")
DERIVATIVES = ("center_of_mass_tangent", "centroidal_momentum_tangent")
MOTIONS = ("frame_velocities", "frame_accelerations", "frame_velocities_tangent", "kinematics", "imu")
GENERALIZED = ("generalized_momentum", "mass_matrix", "coriolis_matrix")
LIMIT = {"float64": 1e-12, "float32": 2e-4}


def moving_mass(robot: Robot) -> float:
    """Sum of the masses of the links that move."""
    model = build_model(robot)
    return sum(robot.link(name).mass for name in model.links)


def check(kernel: eomgen.Kernel, robot: Robot, q: Array, v: Array) -> None:
    """The weight's power, linear momentum as mass times the center's velocity, the bias with and without gravity."""
    mass, limit = moving_mass(robot), LIMIT[str(kernel.dtype)]
    velocity = kernel.jvp("center_of_mass", (q,), (v,))
    gravity, momentum = kernel.gravity(q), kernel.centroidal_momentum(q, v)
    scale = 1.0 + np.abs(momentum).max()
    assert np.abs(momentum[:3] - mass * velocity).max() <= limit * scale
    power = -mass * np.dot(robot.gravity, velocity)
    assert abs(gravity @ v - power) <= limit * (1.0 + np.abs(gravity) @ np.abs(v))
    both, bias = kernel.nonlinear_effects(q, v), kernel.bias_force(q, v)
    assert np.abs(both - bias - gravity).max() <= limit * (1.0 + np.abs(both).max() + np.abs(bias).max())


def check_generalized(kernel: eomgen.Kernel, q: Array, v: Array) -> None:
    """The momentum by the mass matrix, and what its rate has of the kinetic energy."""
    momentum, work = kernel.generalized_momentum(q, v)
    for found, expected in ((momentum, kernel.mass_matrix(q) @ v), (work, kernel.coriolis_matrix(q, v).T @ v)):
        assert np.abs(found - expected).max() <= LIMIT[str(kernel.dtype)] * (1.0 + np.abs(expected).max())


def check_frames(kernel: eomgen.Kernel, robot: Robot, q: Array, v: Array, a: Array) -> None:
    """Velocities by Jacobians, accelerations as their rates; what IMUs read, by both."""
    limit = LIMIT[str(kernel.dtype)]
    velocities, accelerations = kernel.frame_velocities(q, v), kernel.frame_accelerations(q, v, a)
    expected = np.array([kernel.frame_jacobian(q, frame) @ v for frame in kernel.frames])
    assert np.abs(velocities - expected).max() <= limit * (1.0 + np.abs(expected).max())
    rates = kernel.jvp("frame_velocities", (q, v), (v, a))
    size = 1.0 + np.abs(rates).max() + np.abs(velocities).max() ** 2
    assert np.abs(accelerations - rates).max() <= limit * size
    R = np.array([kernel.frame_pose(q, frame)[:3, :3] for frame in kernel.frames])
    force = accelerations[:, :3] - np.array(robot.gravity)
    read = np.concatenate([np.einsum("kij,ki->kj", R, x) for x in (force, velocities[:, 3:])], axis=1)
    assert np.abs(kernel.imu(q, v, a) - read).max() <= limit * (size + np.abs(force).max())


@pytest.mark.parametrize("seed", seeds(0, 1, 40))
def test_followers_springs_offsets_motors_and_prescribed_coordinates(seed: int, built: Build) -> None:
    robot, _ = sample(seed)
    kernel, rng = built(robot, *QUANTITIES, *DERIVATIVES, *MOTIONS, *GENERALIZED), np.random.default_rng(seed)
    for _ in range(4):
        q, v, a = rng.uniform(-1.0, 1.0, (3, kernel.n))
        check(kernel, robot, q, v)
        check_frames(kernel, robot, q, v, a)
        check_generalized(kernel, q, v)


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_batches_have_the_bits_of_single_states(dtype: str, built: Build) -> None:
    robot = random_robot(4, joints=(3, 4), tree=True)
    kernel = built(robot, *QUANTITIES, *DERIVATIVES, *MOTIONS, *GENERALIZED, dtype=dtype)
    q, v, a = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 9, kernel.n)).astype(dtype)
    for name, count in (
        *dict.fromkeys(QUANTITIES, 2).items(),
        *((x, 2) for x in ("frame_velocities", "generalized_momentum")),
        ("frame_accelerations", 3),
        ("imu", 3),
    ):
        call, arrays = getattr(kernel, name), (q, v, a)[: 1 if name in ("gravity", "center_of_mass") else count]
        assert np.array_equal(call(*arrays), np.stack([call(*state) for state in zip(*arrays, strict=True)]))
    check(kernel, robot, q[0], v[0])
    check_frames(kernel, robot, q[0], v[0], a[0])
    check_generalized(kernel, q[0], v[0])


def test_references_of_frames(built: Build) -> None:
    """States of any shape; a point of the link at the base's origin; another reference is refused by name."""
    robot = random_robot(4, joints=(3, 4), tree=True)
    kernel = built(robot, *MOTIONS)
    q, v, a = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 2, 3, kernel.n))
    for reference in ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"):
        velocity = kernel.frame_velocity(q, v, "tcp", reference)
        acceleration = kernel.frame_acceleration(q, v, a, "tcp", reference)
        assert velocity.shape == acceleration.shape == (2, 3, 6)
        assert np.allclose(velocity[1, 2], kernel.frame_velocity(q[1, 2], v[1, 2], "tcp", reference), rtol=1e-14)
        h = 1e-6
        ahead, behind = (kernel.frame_velocity(q + s * h * v, v + s * h * a, "tcp", "WORLD") for s in (1, -1))
        bias = kernel.frame_bias_acceleration(q, v, "tcp", reference)
        assert np.array_equal(bias, kernel.frame_acceleration(q, v, 0.0 * a, "tcp", reference))
        if reference == "LOCAL_WORLD_ALIGNED":
            J, J_ahead, J_behind = (kernel.frame_jacobian(q + s * h * v, "tcp") for s in (0, 1, -1))
            assert np.allclose(bias, ((J_ahead - J_behind) / (2 * h) @ v[..., np.newaxis])[..., 0], atol=1e-7)
            assert np.allclose(acceleration, (J @ a[..., np.newaxis])[..., 0] + bias, atol=1e-12)
        if reference == "WORLD":
            assert np.allclose(acceleration, (ahead - behind) / (2 * h), atol=1e-7)
    with pytest.raises(InputError, match=r"reference: 'world'; allowed: LOCAL_WORLD_ALIGNED, LOCAL, WORLD"):
        kernel.frame_velocity(q, v, "tcp", "world")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="frame: 'tpc' is unknown"):
        kernel.frame_acceleration(q, v, a, "tpc")


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(20, 1, 10))
def test_a_flying_robot_keeps_its_momentum_but_for_its_weight(seed: int, built: Build) -> None:
    """Of its rate under forces within: the weight, and no moment about the center of mass."""
    robot = random_robot(seed, joints=(3, 4), rods=False)
    first = replace(robot.joints[0], type="free", coordinates=dict.fromkeys(COORDINATES, Coordinate()))
    robot = replace(robot, joints=(first, *robot.joints[1:]))
    kernel = built(robot, "forward_dynamics", *QUANTITIES, *DERIVATIVES)
    state = random_state(robot, seed)
    place = [kernel.coordinates.index(f"{first.name}.{kind}") for kind in COORDINATES]
    u = state.u.copy()
    u[place] = 0.0
    a = kernel.forward_dynamics(state.q, state.v, u)
    rate = kernel.jvp("centroidal_momentum", (state.q, state.v), (state.v, a))
    expected = np.concatenate([moving_mass(robot) * np.array(robot.gravity), np.zeros(3)])
    size = np.abs(a).max() * moving_mass(robot) + np.abs(expected).max()
    assert np.abs(rate - expected).max() <= 1e-10 * size


def test_masses_as_run_time_parameters(built: Build) -> None:
    """They move the center without a new kernel."""
    robot = eomgen.load_robot("one_link")
    tuned = replace(robot, tunable=("links.link1.mass", "links.link1.com.x"))
    kernel = built(tuned, "center_of_mass")
    q = np.array([0.1, 0.4])
    before = kernel.center_of_mass(q)
    kernel.parameters["links.link1.mass"] *= 3.0
    assert np.allclose(kernel.center_of_mass(q), before, rtol=1e-15)
    kernel.parameters["links.link1.com.x"] += 0.5
    link_x = np.array([np.cos(q[1]), np.sin(q[1]), 0.0])
    assert np.allclose(kernel.center_of_mass(q) - before, 0.5 * link_x, atol=1e-15)


def test_a_robot_without_mass_has_no_center(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    light = replace(robot, links=tuple(replace(link, mass=0.0, com=(0.0, 0.0, 0.0)) for link in robot.links))
    with pytest.raises(InputError, match=r"no link of one_link that moves has mass"):
        built(light, "center_of_mass")
