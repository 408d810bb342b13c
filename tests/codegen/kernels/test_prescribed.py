"""Coordinates whose motion is given: against Pinocchio's matrices, closed forms, and the balance of power."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.bench.beside import bench
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, DescriptionError, InputError
from eomgen.integration.solve import integrate
from eomgen.motion.point_to_point import Harmonic
from eomgen.pipeline.costs import robot_info
from eomgen.robot.value import COORDINATES
from eomgen.simulation.run import simulate
from eomgen.state.equilibrium import static_equilibrium
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import Array, State, random_robot, random_state, seeds, some_prescribed
from tests.support.swinging import NEEDED

pytestmark = pytest.mark.usefixtures("unoptimised")

TYPES = ("revolute", "prismatic", "fixed", "free")
JACOBIANS = ("residual_jacobian", "forward_dynamics_jacobian")
NAMES = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "energy", "rollout")


def masks(kernel: eomgen.Kernel) -> tuple[Array, Array]:
    given = np.array([name in kernel.prescribed for name in kernel.coordinates])
    return ~given, given


def by_pinocchio(oracle: PinocchioOracle, free: Array, s: State, u: Array) -> Array:
    """Accelerations from the whole M and inverse dynamics: M_ff a_f = u_f - h_f - M_fg a_g."""
    M = oracle.mass_matrix(s.q)
    a = np.where(free, 0.0, u)
    rest = u - oracle.inverse_dynamics(s.q, s.v, a)
    a[free] = np.linalg.solve(M[np.ix_(free, free)], rest[free])
    return a


@pytest.mark.parametrize("seed", seeds(1100, 1, 24))
def test_forward_dynamics_of_random_robots(seed: int, built: Build) -> None:
    """Derivatives of free rows by those of the residual; prescribed rows depend on nothing but their own u."""
    robot = some_prescribed(random_robot(seed, joints=(2, 4), tree=seed % 2 == 0, types=TYPES), seed)
    kernel, oracle, s = built(robot, *NAMES, *JACOBIANS), PinocchioOracle(robot), random_state(robot, seed)
    free, given = masks(kernel)
    found = kernel.forward_dynamics(s.q, s.v, s.u)
    assert np.array_equal(found[given], s.u[given])
    expected = by_pinocchio(oracle, free, s, s.u)
    condition = np.linalg.cond(oracle.mass_matrix(s.q)[np.ix_(free, free)])
    allowed = max(1e-11, 100 * np.finfo(float).eps * condition)
    assert np.abs(found - expected).max() < allowed * np.abs(expected).max()
    many = kernel.forward_dynamics(np.tile(s.q, (9, 1)), s.v, s.u)
    assert np.abs(many - found).max() <= 10 * allowed * np.abs(found).max()
    by_q, by_v, M = kernel.residual_jacobian(s.q, s.v, found)
    inner = np.linalg.inv(M[np.ix_(free, free)])
    expected = [np.zeros_like(M) for _ in range(3)]
    for block, slopes in zip(expected, (by_q, by_v), strict=False):
        block[free] = -inner @ slopes[free]
    expected[2][np.ix_(free, free)] = inner
    expected[2][np.ix_(free, given)] = -inner @ M[np.ix_(free, given)]
    expected[2][np.ix_(given, given)] = np.eye(int(given.sum()))
    blocks = kernel.forward_dynamics_jacobian(s.q, s.v, s.u)
    for block, wanted in zip(blocks, expected, strict=True):
        assert np.abs(block - wanted).max() < allowed * np.abs(wanted).max()
    batch = kernel.forward_dynamics_jacobian(np.tile(s.q, (5, 1)), s.v, s.u)
    for block, wanted in zip(batch, blocks, strict=True):
        assert np.abs(block[4] - wanted).max() <= 10 * allowed * np.abs(wanted).max()


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(1140, 1, 4))
def test_rollouts_follow_accelerations(seed: int, built: Build) -> None:
    """Constant accelerations of what is prescribed make parabolas; the rest follows the formulas of the steps."""
    robot = some_prescribed(random_robot(seed, joints=(2, 3), types=("revolute", "prismatic")), seed)
    kernel, s = built(robot, *NAMES), random_state(robot, seed)
    free, given = masks(kernel)
    steps, dt = 20, 1e-3
    q, v = kernel.rollout(s.q, s.v, s.u, dt, steps)
    t = dt * np.arange(steps + 1)[:, None]
    assert np.allclose(q[:, given], s.q[given] + t * s.v[given] + 0.5 * t * t * s.u[given], rtol=1e-12, atol=1e-14)
    assert np.allclose(v[:, given], s.v[given] + t * s.u[given], rtol=1e-12, atol=1e-14)
    K, B = (
        np.array([getattr(c, key) or 0.0 for joint in robot.joints for c in joint.coordinates.values()])
        for key in ("stiffness", "damping")
    )
    one_q, one_v = kernel.rollout(s.q, s.v, s.u, dt, 1, method="implicit")
    a = np.where(given, s.u, 0.0)
    extra = np.diag(np.where(free, dt * B + dt * dt * K, 0.0))
    rest = s.u - kernel.inverse_dynamics(s.q, s.v, a) - dt * K * s.v
    M = (kernel.mass_matrix(s.q) + extra)[np.ix_(free, free)]
    a[free] = np.linalg.solve(M, rest[free])
    assert np.abs(one_v[1] - (s.v + dt * a)).max() < 1e-11
    assert np.abs(one_q[1] - (s.q + dt * one_v[1])).max() < 1e-11


PENDULUM = f"""
name = "pendulum"
{link_table("rod", 0.7, (0.0, -0.4, 0.0), (0.01, 0.001, 0.01))}
{link_table("pivot", 0.2, (0.0, 0.0, 0.0), (0.001, 0.001, 0.001))}
{joint_table("shaker", "base", "pivot", "prismatic")}
z = {{ role = "prescribed" }}
{joint_table("hinge", "pivot", "rod", "revolute")}
placement = {{ rpy = [1.5707963267948966, 0.0, 0.0] }}
gamma = {{ damping = 0.05 }}
"""


@pytest.mark.parametrize("method", ["scipy:DOP853", "scipy:Radau"])
def test_a_pendulum_on_a_shaken_pivot(method: str, built: Build) -> None:
    """(I + m l^2) phi'' = -b phi' - m l (g + z'') sin(phi): parametric excitation, at twice the eigenfrequency."""
    m, length, inertia, b, g = 0.7, 0.4, 0.01, 0.05, 9.81
    kernel = built(robot_from_toml(PENDULUM))
    shake = Harmonic([0.05], 1.5)
    found = integrate(
        kernel, [0.0, 0.2], [0.0, 0.0], 3.0, prescribed=shake, method=method, rtol=1e-9, atol=1e-10, output_step=0.01
    )

    def rate(t: float, y: Array) -> list[float]:
        pull = g + shake(t)[2][0]
        return [y[1], (-b * y[1] - m * length * pull * np.sin(y[0])) / (inertia + m * length**2)]

    exact = solve_ivp(rate, (0.0, 3.0), [0.2, 0.0], "DOP853", t_eval=found.t, rtol=1e-12, atol=1e-13).y
    assert np.abs(found.of("hinge.gamma") - exact[0]).max() < 1e-6
    assert np.allclose(found.of("shaker.z"), [shake(t)[0][0] for t in found.t], rtol=0, atol=1e-15)


@pytest.mark.soak
def test_a_steady_acceleration_is_gravity(built: Build) -> None:
    """A platform that gains speed evenly: its arm feels another gravity, and moves as one that stands there."""
    robot = eomgen.load_robot("shaken_arm")
    kernel = built(robot, *NEEDED)
    push = np.array([3.0, -2.0, 1.5])
    still = built(replace(robot, name="still", gravity=tuple(np.array(robot.gravity) - push)), *NEEDED)
    q0 = np.array([*np.zeros(6), 0.3, 0.0, 0.0, -0.4, 0.7])

    def moved(arm: eomgen.Kernel, given: Array) -> Any:
        motion = lambda t: (0.5 * given * t * t, given * t, given)  # noqa: E731
        return integrate(arm, q0, np.zeros(11), 0.5, prescribed=motion, rtol=1e-9, output_step=0.05)

    moving, standing = moved(kernel, np.array([*push, *np.zeros(3)])), moved(still, np.zeros(6))
    assert np.abs(moving.q[:, 6:] - standing.q[:, 6:]).max() < 1e-6
    assert np.allclose(moving.u[:, :6], standing.u[:, :6], rtol=1e-6, atol=1e-4)


@pytest.mark.soak
def test_power_balance_of_a_shaken_arm(built: Build) -> None:
    """What the platform's drives put in is kinetic and potential energy, or goes into the dampers."""
    robot = eomgen.load_robot("shaken_arm")
    kernel = built(robot, *NEEDED)
    shake = Harmonic(
        [0.02, 0.01, 0.03, 0.05, 0.04, 0.1], [2.0, 3.0, 1.5, 1.0, 2.0, 3.0], [0.0, 1.0, 0.5, 0.2, 0.1, 0.0]
    )
    found = integrate(kernel, np.zeros(11), np.zeros(11), 1.0, prescribed=shake, rtol=1e-9, output_step=2e-4)
    damping = np.array([c.damping or 0.0 for joint in robot.joints for c in joint.coordinates.values()])
    power = (found.u * found.v - damping * found.v**2).sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(found.t))])
    total = found.energy.sum(axis=1)
    assert np.abs(total - total[0] - work).max() < 1e-5 * np.abs(total - total[0]).max()


@pytest.mark.soak
def test_bench_and_info_know_what_is_prescribed() -> None:
    """Articulated bodies do not solve for a force: forward dynamics has no counterpart there."""
    robot = eomgen.load_robot("shaken_arm")
    result = bench(robot, repeat=1, kernels=("inverse_dynamics", "mass_matrix", "forward_dynamics"))
    beside = {row.kernel.name: row.counterpart is not None for row in result.rows}
    assert beside == {"inverse_dynamics": True, "mass_matrix": True, "forward_dynamics": False}
    said = [line for line in robot_info(robot).lines() if line.endswith("prescribed")]
    assert [line.split()[0] for line in said] == [f"mount.{name}" for name in COORDINATES]


def test_equilibrium_holds_what_is_prescribed(built: Build) -> None:
    kernel = built(eomgen.load_robot("shaken_arm"), *NEEDED)
    guess = np.zeros(11)
    guess[:6] = 0.1
    q, u = static_equilibrium(kernel, guess, fixed=("waist.gamma", "shoulder.gamma", "elbow.gamma"))
    assert np.array_equal(q[:6], guess[:6])
    assert np.abs(u[:3]).max() > 100.0  # the weight


def described(joint: str) -> str:
    link = '[[links]]\nname = "a"\nmass = 1.0\ninertia = { xx = 0.1, yy = 0.1, zz = 0.1 }\n'
    return f'name = "r"\n{link}[[joints]]\nname = "j"\nparent = "base"\nchild = "a"\n{joint}\n'


def test_roles_of_a_description() -> None:
    robot = robot_from_toml(described('type = "revolute"\nx = { stiffness = 10.0 }\ngamma = { role = "locked" }'))
    assert list(robot.joints[0].coordinates) == ["x"]  # an elastic mount
    robot = robot_from_toml(described('type = "revolute"\nprescribed = ["y"]\nx = { role = "prescribed" }'))
    assert {k: c.prescribed for k, c in robot.joints[0].coordinates.items()} == {"x": True, "y": True, "gamma": False}
    assert robot.rigid().joints[0].coordinates.keys() == {"x", "y", "gamma"}


@pytest.mark.parametrize(
    ("joint", "match"),
    [
        ('type = "revolute"\nprescribed = ["delta"]', r"prescribed.*'delta'.*allowed: x, y, z, alpha, beta, gamma"),
        ('type = "revolute"\nx = { role = "locked", stiffness = 2.0 }', r"x\.role.*locked.*stiffness would do nothing"),
        ('type = "revolute"\nx = { role = "stuck" }', "'stuck'.*free, locked, prescribed"),
        ('type = "revolute"\nprescribed = ["x"]\nx = { role = "free" }', "x is prescribed here and free in its table"),
        ('type = "revolute"\ngamma = { role = "locked" }', "nothing moves"),
    ],
)
def test_descriptions_that_are_refused(joint: str, match: str) -> None:
    with pytest.raises(DescriptionError, match=match):
        robot_from_toml(described(joint))


def test_integrations_that_are_refused(built: Build) -> None:
    kernel, one = built(robot_from_toml(PENDULUM)), built(eomgen.load_robot("one_link"), *NEEDED)

    def refused(kind: type[Exception], match: str, prescribed: Any, of: eomgen.Kernel = kernel) -> None:
        with pytest.raises(kind, match=match):
            integrate(of, np.zeros(2), np.zeros(2), 0.1, prescribed=prescribed)

    refused(InputError, r"the motion of shaker\.z is missing", None)
    refused(ArrayError, "three arrays of 1 finite numbers", lambda t: (np.zeros(2), np.zeros(2), np.zeros(2)))
    refused(ArrayError, "three arrays of 1 finite numbers", lambda t: ([np.nan], [0.0], [0.0]))
    refused(InputError, "has no prescribed coordinate", Harmonic([1.0], 1.0), one)
    with pytest.raises(ArrayError, match="frequency"):
        Harmonic([1.0, 2.0], [1.0, 2.0, 3.0])
    with pytest.raises(
        InputError, match=r"the motion of mount\.x, .* is missing; allowed: one \[\[prescribed\]\] entry for each"
    ):
        simulate(eomgen.load_robot("shaken_arm"))
    with pytest.raises(InputError, match=r"kp is 1\.0 at shaker\.z"):
        kernel.rollout(np.zeros(2), np.zeros(2), np.zeros(2), 1e-3, 3, kp=[1.0, 1.0], target=np.zeros(2))
