"""Joints that turn freely through the singularities of their angles: rollouts, integrations, oracles in quaternions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from eomgen.errors import InputError, IntegrationStopped, UnknownNameError
from eomgen.integration import integrate
from eomgen.robot import build_model
from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.elements.journal import Radial
from eomgen.robot.value import Coordinate, Joint, Link, Placement, Robot
from tests.support.builds import Build
from tests.support.optional import needs
from tests.support.refusals import refused
from tests.support.small_robots import Q0, V0, free_body, held_body, tumbler
from tests.support.soak import soaked

Array = NDArray[np.float64]

ANGLES = ("alpha", "beta", "gamma")
INTEGRATED = ("forward_dynamics", "mass_matrix", "inverse_dynamics", "residual_jacobian", "energy", "rollout")


def turned(q: Array) -> Rotation:
    """The rotation of angles (..., 3)."""
    return Rotation.from_euler("XYZ", q)


def apart(q: Array, other: Array) -> float:
    """Largest angle between two rotations, rad."""
    return float(np.max((turned(q) * turned(other).inv()).magnitude()))


def spin(angles: Array, rates: Array) -> Array:
    """Angular velocity in the body's axes: the columns are where the axes of the three angles are."""
    b, g = angles[..., 1], angles[..., 2]
    rows = (
        np.cos(b) * np.cos(g) * rates[..., 0] + np.sin(g) * rates[..., 1],
        -np.cos(b) * np.sin(g) * rates[..., 0] + np.cos(g) * rates[..., 1],
        np.sin(b) * rates[..., 0] + rates[..., 2],
    )
    return np.stack(rows, axis=-1)


def inertia(link: Link) -> Array:
    xx, yy, zz, xy, xz, yz = link.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def by_quaternions(link: Link, q: Array, v: Array, duration: float) -> tuple[Rotation, Array]:
    """Rotation and origin of a free body at the end, integrated in quaternions about its centre of mass."""
    tensor, com, w = inertia(link), np.array(link.com), spin(q[3:], v[3:])
    centre, rate = q[:3] + turned(q[3:]).apply(com), v[:3] + turned(q[3:]).apply(np.cross(w, com))

    def slopes(_: float, y: Array) -> Array:
        x, w = y[:4], y[4:]
        product = np.array([*(x[3] * w + np.cross(x[:3], w)), -x[:3] @ w])
        return np.concatenate([0.5 * product, np.linalg.solve(tensor, -np.cross(w, tensor @ w))])

    begin = np.concatenate([turned(q[3:]).as_quat(), w])
    end = solve_ivp(slopes, (0.0, duration), begin, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    rotation = Rotation.from_quat(end[:4])
    return rotation, centre + duration * rate - rotation.apply(com)


@pytest.mark.soak
@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_a_tumbling_body_over_many_steps(method: str, built: Build) -> None:
    """Energy, momentum, angular momentum and pose; a body without forces, so that methods differ by their order."""
    robot = tumbler()
    (link,) = robot.links
    kernel = built(robot, *INTEGRATED)
    dt, steps = (2e-4, 100_000) if method == "rk4" else (1e-5, 100_000)
    q, v = kernel.rollout(Q0, V0, np.zeros(6), dt, steps, method=method, every=100)
    w, R = spin(q[:, 3:], v[:, 3:]), turned(q[:, 3:])
    angular = R.apply(w @ inertia(link).T)
    momentum = v[:, :3] + R.apply(np.cross(w, link.com))
    energy = kernel.energy(q, v).sum(axis=1)
    limit = 1e-9 if method == "rk4" else 1e-3  # of first order
    assert method == "implicit" or np.abs(np.cos(q[:, 4])).min() < 0.3  # it does come near
    assert np.abs(energy / energy[0] - 1.0).max() < limit
    assert np.linalg.norm(angular - angular[0], axis=1).max() < limit * np.linalg.norm(angular[0])
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() < limit
    rotation, origin = by_quaternions(link, Q0, V0, dt * steps)
    limit = 1e-8 if method == "rk4" else 1e-3
    assert (R[-1] * rotation.inv()).magnitude() < limit
    assert np.abs(q[-1, :3] - origin).max() < limit


def test_a_pitch_over_the_pole_goes_on_as_an_angle(built: Build) -> None:
    """A rotation about one axis stays one, right through the pole, and begins there as well."""
    link = Link("body", 1.0, (0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
    kernel = built(replace(tumbler(), name="pitching", links=(link,)), *INTEGRATED)
    q0, v0 = np.array([0.0, 0.0, 0.0, 0.0, 0.3, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    q, v = kernel.rollout(q0, v0, np.zeros(6), 1e-3, 10_000)
    times = np.arange(len(q)) * 1e-3
    assert np.abs(q[:, 4] - (0.3 + 2.0 * times)).max() < 1e-9
    assert np.abs(q[:, [3, 5]]).max() < 1e-9
    assert np.abs(spin(q[:, 3:], v[:, 3:]) - [0.0, 2.0, 0.0]).max() < 1e-9
    q0[4] = np.pi / 2
    found = integrate(kernel, q0, v0, 2.0, output_step=0.1)
    assert np.abs(found.q[:, 4] - (np.pi / 2 + 2.0 * found.t)).max() < 1e-9


@pytest.mark.parametrize(
    "method",
    soaked(["rk4", "scipy:DOP853", "scipy:Radau", "scipy:LSODA", "CVODE", "IDA"], ["rk4", "scipy:Radau", "IDA"]),
)
def test_integrations_pass_the_poles(method: str, built: Build) -> None:
    if method in ("CVODE", "IDA"):
        needs("sksundae", extra="test")
    kernel = built(tumbler(), *INTEGRATED)
    q, v = kernel.rollout(Q0, V0, np.zeros(6), 1e-4, 30_000, every=500)
    found = integrate(kernel, Q0, V0, 3.0, method=method, rtol=1e-9, output_step=0.05)
    assert apart(found.q[:, 3:], q[:, 3:]) < 1e-5
    assert np.abs(found.q[:, :3] - q[:, :3]).max() < 1e-5
    assert np.abs(spin(found.q[:, 3:], found.v[:, 3:]) - spin(q[:, 3:], v[:, 3:])).max() < 1e-4
    assert np.abs(np.cos(q[:, 4])).min() < 0.4


def test_quaternions_beside_the_angles(built: Build) -> None:
    kernel = built(tumbler(), *INTEGRATED)
    found = integrate(kernel, Q0, V0, 6.0, output_step=0.02)
    w, x, y, z = (quaternion := found.quaternion("free")).T
    assert np.abs(np.diff(quaternion, axis=0)).max() < 0.1
    assert np.abs(np.linalg.norm(quaternion, axis=1) - 1.0).max() < 1e-14
    assert (
        Rotation.from_quat(np.stack([x, y, z, w], axis=-1)) * turned(found.q[:, 3:]).inv()
    ).magnitude().max() < 1e-14
    refused(InputError, r"'body\.alpha' is unknown; known: free\.x", found.quaternion, "body")


def test_forces_keep_their_meaning(built: Build) -> None:
    """Work of drives on described coordinates is what the energy gains; rollouts and integrations agree."""
    kernel = built(tumbler(), *INTEGRATED)
    u = np.array([0.1, 0.2, -0.1, 0.05, -0.02, 0.03])
    found = integrate(kernel, Q0, V0, 1.5, drive=lambda t, q, v: u, rtol=1e-11, output_step=1e-3, method="scipy:DOP853")
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.45
    gained = found.energy.sum(axis=1) - found.energy[0].sum()
    power = found.v @ u
    work = np.concatenate([[0.0], np.cumsum(0.5e-3 * (power[1:] + power[:-1]))])
    assert np.abs(gained - work).max() < 1e-5 * max(np.abs(gained).max(), 0.1)
    q, _ = kernel.rollout(Q0, V0, u, 1e-3, 1500)
    assert apart(found.q[:, 3:], q[:, 3:]) < 1e-6
    assert np.abs(found.q[:, :3] - q[:, :3]).max() < 1e-6


def test_a_force_on_an_angle_at_the_pole_is_refused(built: Build) -> None:
    kernel = built(tumbler(), *INTEGRATED)
    q0 = Q0.copy()
    q0[4] = np.pi / 2
    with pytest.raises(IntegrationStopped, match=r"u on free\.alpha has no finite moment where beta is at \+-pi/2"):
        kernel.rollout(q0, np.zeros(6), np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), 1e-3, 10)


def test_states_of_a_batch_turn_apart(built: Build) -> None:
    """Bit by bit what each does alone, over several pieces of work, in threads, at the pole itself and far from it."""
    kernel = built(tumbler(), *INTEGRATED)
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(37, 6)), 2.0 * rng.normal(size=(37, 6))
    q[5, 4], v[6] = np.pi / 2, 0.0
    u = 0.01 * rng.normal(size=(37, 6))
    u[5] = 0.0
    for method in ("rk4", "implicit"):
        found = kernel.rollout(q, v, u, 1e-3, 2000, method=method, every=50)
        shared = kernel.replaced(threads=2).rollout(q, v, u, 1e-3, 2000, method=method, every=50)
        for together, other in zip(found, shared, strict=True):
            assert np.array_equal(together, other)
        for i in (0, 4, 5, 6, 36):
            alone = kernel.rollout(q[i], v[i], u[i], 1e-3, 2000, method=method, every=50)
            assert all(np.array_equal(x, y[i]) for x, y in zip(alone, found, strict=True))


@pytest.mark.parametrize("method", soaked(["tsit5", "rosenbrock", "radau"], ["rosenbrock"]))
def test_steps_that_the_error_chooses(method: str, built: Build) -> None:
    """Over the poles, between samples, in a batch, over several calls of C; tolerances are of described coordinates."""
    kernel = built(tumbler(), *INTEGRATED, "adaptive_rollout", "radau_rollout")
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(19, 6)), 2.0 * rng.normal(size=(19, 6))
    q[0], v[0], q[5, 4] = Q0, V0, np.pi / 2
    how: dict[str, Any] = {"method": method, "duration": 3.0, "samples": 60, "rtol": 1e-6}
    found = kernel.rollout(q, v, np.zeros(6), **how)
    shared = kernel.replaced(threads=2).rollout(q, v, np.zeros(6), **how)
    assert all(np.array_equal(x, y) for x, y in zip(found, shared, strict=True))
    for i in (0, 4, 5, 18):
        alone = kernel.rollout(q[i], v[i], np.zeros(6), **how)
        assert all(np.array_equal(x, y[i]) for x, y in zip(alone, found, strict=True))
    exact, _ = kernel.rollout(q, v, np.zeros(6), 1e-4, 30_000, every=500)
    limit = 1e-2 if method == "rosenbrock" else 1e-3
    assert apart(found[0][..., 3:].reshape(-1, 3), exact[..., 3:].reshape(-1, 3)) < limit
    assert np.abs(found[0][..., :3] - exact[..., :3]).max() < limit
    assert np.abs(np.diff(found[0][0, :, 3:], axis=0)).max() < 2.0  # angles follow each other
    assert (np.abs(np.cos(exact[..., 4])).min(axis=1) < 0.2).sum() > 5
    atol = np.array([1e-7, 1e-5, 1e3, 1e-7, 1e-7, 1e-7] * 2)  # of z any
    fine, coarse = kernel.rollout(Q0, V0, np.zeros(6), **how), kernel.rollout(Q0, V0, np.zeros(6), atol=atol, **how)
    assert np.abs(fine[0] - coarse[0])[:, :2].max() < limit


def test_single_precision(built: Build) -> None:
    kernel, exact = built(tumbler(), *INTEGRATED, dtype="float32"), built(tumbler(), *INTEGRATED)
    single = (x.astype(np.float32) for x in (Q0, V0, np.zeros(6)))
    found, _ = kernel.rollout(*single, 1e-3, 3000, every=3000)
    expected, _ = exact.rollout(Q0, V0, np.zeros(6), 1e-3, 3000, every=3000)
    assert apart(found[-1:, 3:].astype(np.float64), expected[-1:, 3:]) < 2e-3


def damped_by_quaternions(robot: Robot, q: Array, v: Array, times: Array) -> tuple[Rotation, Array]:
    """Rotations and origins of a free body whose joint is damped, integrated in quaternions."""
    (link,), (joint,) = robot.links, robot.joints
    tensor, com, w, R = inertia(link), np.array(link.com), spin(q[3:], v[3:]), turned(q[3:])
    linear, angular = joint.damping.linear, joint.damping.angular
    assert linear is not None
    assert angular is not None

    def slopes(_: float, y: Array) -> Array:
        x, w, rate = y[:4], y[4:7], y[10:]
        here = Rotation.from_quat(x)
        push = -linear * (rate - here.apply(np.cross(w, com)))  # at the origin
        moment = -angular * w - np.cross(com, here.inv().apply(push))
        product = np.array([*(x[3] * w + np.cross(x[:3], w)), -x[:3] @ w])
        turning = np.linalg.solve(tensor, moment - np.cross(w, tensor @ w))
        return np.concatenate([0.5 * product, turning, rate, push / link.mass])

    begin = np.concatenate([R.as_quat(), w, q[:3] + R.apply(com), v[:3] + R.apply(np.cross(w, com))])
    found = solve_ivp(slopes, (0.0, times[-1]), begin, "DOP853", times, rtol=1e-12, atol=1e-13).y.T
    rotations = Rotation.from_quat(found[:, :4])
    return rotations, found[:, 7:10] - rotations.apply(com)


def test_a_damped_body_turns_freely(built: Build) -> None:
    """Damping of the joint's motion knows no angles: every method passes the pole, with an own integration's poses."""
    body = tumbler()
    joint = replace(body.joints[0], damping=JointDamping(0.3, 0.02))
    robot = replace(body, name="damped_tumbler", joints=(joint,))
    assert build_model(robot).turning == (0,)
    kernel = built(robot, *INTEGRATED, "adaptive_rollout", "radau_rollout")
    times = np.linspace(0.0, 2.0, 21)
    R, x = damped_by_quaternions(robot, Q0, V0, times)

    def compare(q: Array, limit: float) -> None:
        assert float(np.max((turned(q[:, 3:]) * R.inv()).magnitude())) < limit
        assert np.abs(q[:, :3] - x).max() < limit

    drives = np.zeros(6)
    compare(kernel.rollout(Q0, V0, drives, 1e-3, 2000, every=100)[0], 1e-8)
    errors = []
    for dt, limit in ((1e-3, 2e-2), (5e-4, 1e-2)):
        q = kernel.rollout(Q0, V0, drives, dt, round(2.0 / dt), method="implicit", every=round(0.1 / dt))[0]
        compare(q, limit)
        errors.append(float((turned(q[-1, 3:]) * R[-1].inv()).magnitude()))
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.2)  # of first order
    for method, limit in (("rosenbrock", 1e-5), ("tsit5", 1e-6), ("radau", 1e-6)):
        compare(kernel.rollout(Q0, V0, drives, method=method, duration=2.0, samples=20, rtol=1e-8, atol=1e-9)[0], limit)
    several = kernel.rollout(np.array([Q0, 0.5 * Q0]), np.array([V0, V0]), np.zeros((2, 6)), 1e-3, 2000, every=100)[0]
    compare(several[0], 1e-8)
    found = integrate(kernel, Q0, V0, 2.0, rtol=1e-9, output_step=0.1)
    compare(found.q, 1e-7)
    lost = found.energy.sum(axis=1)
    assert np.all(np.diff(lost) < 0.0)


def pair_and_ball() -> Robot:
    """Two free bodies, one on the other, and a ball joint in the middle of a branch, its frame turned and shifted."""
    rng = np.random.default_rng(3)

    def link(name: str) -> Link:
        return Link(name, 1.0, tuple(rng.uniform(-0.1, 0.1, 3)), (0.04, 0.05, 0.06, 0.004, -0.003, 0.002))  # type: ignore[arg-type]

    def placed() -> Placement:
        x, y, z, r, p, w = rng.uniform(-0.3, 0.3, 6).tolist()
        return Placement.from_rpy((x, y, z), (r, p, w))

    free = free_body().joints[0]
    ball = Joint("ball", "first", "arm", "fixed", placed(), coordinates=dict.fromkeys(ANGLES, Coordinate()))
    hinge = Joint("hinge", "arm", "tip", "revolute", placed(), coordinates={"gamma": Coordinate()})
    joints = (
        replace(free, name="root", child="first", placement=placed()),
        ball,
        hinge,
        replace(free, name="second", parent="tip", child="other", placement=placed()),
    )
    return Robot("pair_and_ball", (0.0, 0.0, -9.81), tuple(map(link, ("first", "arm", "tip", "other"))), joints)


@pytest.mark.soak
def test_joints_within_a_tree(built: Build) -> None:
    """Energy and momentum of coupled bodies: gravity alone acts, so that it tells of the momentum's rate."""
    robot = pair_and_ball()
    assert [build_model(robot).bodies[k].joint for k in build_model(robot).turning] == ["root", "ball", "second"]
    kernel = built(robot, *INTEGRATED, "kinematics")
    rng = np.random.default_rng(4)
    q0, v0 = 0.5 * rng.normal(size=kernel.n), 2.0 * rng.normal(size=kernel.n)
    q, v = kernel.rollout(q0, v0, np.zeros(kernel.n), 1e-4, 20_000, every=200)
    betas = [kernel.coordinates.index(f"{name}.beta") for name in ("root", "ball", "second")]
    assert (np.abs(np.cos(q[:, betas])).min(axis=0) < 0.5).all()  # each comes near a pole
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.abs(energy - energy[0]).max() < 1e-8 * np.abs(kernel.energy(q, v)).max()
    momentum = np.zeros((len(q), 3))
    angular = np.zeros((len(q), 3))
    weight = np.zeros((len(q), 3))
    for link in robot.links:
        pose, jacobian = kernel.frame_pose(q, link.name), kernel.frame_jacobian(q, link.name)
        R, moved = pose[:, :3, :3], np.einsum("tij,tj->ti", jacobian, v)
        arm, w = R @ np.array(link.com), moved[:, 3:]
        rate, centre = moved[:, :3] + np.cross(w, arm), pose[:, :3, 3] + arm
        momentum += link.mass * rate
        spins = np.einsum("tij,jk,tlk,tl->ti", R, inertia(link), R, w)
        angular += spins + link.mass * np.cross(centre, rate)
        weight += np.cross(centre, link.mass * np.array(robot.gravity))
    times = 0.02 * np.arange(len(q))
    mass = sum(link.mass for link in robot.links)
    assert np.abs(momentum - momentum[0] - mass * np.outer(times, robot.gravity)).max() < 1e-8
    turning = np.concatenate([np.zeros((1, 3)), np.cumsum(0.01 * (weight[1:] + weight[:-1]), axis=0)])
    assert np.abs(angular - angular[0] - turning).max() < 1e-2  # of the trapezoidal rule, whose error is 1e-4
    found = integrate(kernel, q0, v0, 2.0, rtol=1e-10, output_step=0.5)
    for i in betas:
        assert apart(found.q[:, i - 1 : i + 2], q[::25, i - 1 : i + 2]) < 1e-6


def test_what_stays_as_it_is_described() -> None:
    """Whatever acts on a coordinate of a joint, moves it, or is one of its parameters."""

    def turning(joint: Joint, **changes: object) -> bool:
        robot = replace(free_body(), joints=(joint,), **changes)
        return bool(build_model(robot).turning)

    (free,) = free_body().joints
    assert turning(free)
    assert turning(replace(free, damping=JointDamping(1.0, 2.0)))
    assert not turning(replace(free, radial=Radial(1e-3, 1e6)))
    assert not build_model(held_body()).turning
    for given in (
        Coordinate(stiffness=1.0),
        Coordinate(damping=0.0),
        Coordinate(armature=0.1),
        Coordinate(prescribed=True),
    ):
        for name in ("x", "beta"):
            assert not turning(replace(free, coordinates={**free.coordinates, name: given}))
    assert not turning(replace(free, offset=(None, None, None, None, 0.1, None)))
    assert turning(replace(free, offset=(0.1, None, None, None, None, None)))
    assert not turning(free, tunable=("joints.free.beta.stiffness",))
    six = {name: Coordinate() for name in free.coordinates}
    assert not turning(replace(free, type="revolute", coordinates=six))  # deviations of a joint that has a drive
    planar = {name: Coordinate() for name in ("x", "alpha", "beta", "gamma")}
    assert not turning(replace(free, type="fixed", coordinates=planar))
    assert turning(replace(free, type="fixed", coordinates={name: Coordinate() for name in ANGLES}))


@pytest.mark.soak
def test_the_code_of_other_robots_knows_nothing_of_it(built: Build) -> None:
    kernel = built(held_body(), *INTEGRATED)
    for text in (kernel.raw.libraries.source(f"{kernel.name}{end}") for end in (".c", "_batch.c", ".h")):
        assert "turned_setup" not in text
        assert "is_turned" not in text
    assert kernel.raw.turning == {}
    assert "free_body_turned_setup" in built(free_body(), *INTEGRATED).raw.source("h")
    refused(UnknownNameError, "'free' has no 3-DOF rotation", kernel.parameters.turn, {"free"})


def test_kernels_with_turned_joints_are_those_of_turned_placements(built: Build) -> None:
    """The same numbers as of a description whose placement is turned."""
    robot = free_body()
    (joint,) = robot.joints
    Q = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    moved = replace(robot, name="moved", joints=(replace(joint, placement=Placement(rotation=Q)),))
    kernel, other = built(robot, *INTEGRATED, "external_force"), built(moved, *INTEGRATED, "external_force")
    kernel = kernel.replaced()
    kernel.parameters.turn({"free"})
    rng = np.random.default_rng(2)
    q, v, u = rng.normal(size=(3, 5, 6))
    wrench = rng.normal(size=(5, 1, 6))
    near = {"rtol": 1e-12, "atol": 1e-12}
    assert np.allclose(kernel.forward_dynamics(q, v, u), other.forward_dynamics(q, v, u), **near)
    assert np.allclose(kernel.inverse_dynamics(q, v, u), other.inverse_dynamics(q, v, u), **near)
    assert np.allclose(kernel.mass_matrix(q), other.mass_matrix(q), **near)
    assert np.allclose(kernel.functions.external_force(q, wrench), other.functions.external_force(q, wrench), **near)
    assert np.allclose(kernel.residual_jacobian(q, v, u), other.residual_jacobian(q, v, u), **near)
