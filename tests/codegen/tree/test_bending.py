"""Links that bend, beside sums over their mass points and the laws of mechanics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen import Kernel, Robot
from eomgen.integration import integrate
from tests.support.bending_links import Points, bending_chain
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
STEP = 1e-20  # of complex differences


Case = tuple[Robot, dict[str, Points], Kernel]


def made(*, drawn_in: bool, second: bool = False) -> Case:
    robot, points = bending_chain(np.random.default_rng(3), drawn_in=drawn_in, second=second)
    return robot, points, eomgen.build(robot)


@pytest.fixture(scope="module", params=[True, False], ids=["drawn in", "linear"])
def case(request: pytest.FixtureRequest) -> Case:
    return made(drawn_in=request.param)


@pytest.fixture(scope="module")
def stiffening() -> Case:
    return made(drawn_in=True, second=True)


def random_state(kernel: Kernel, seed: int = 0) -> tuple[Array, Array, Array]:
    q, v, a = 0.5 * np.random.default_rng(seed).normal(size=(3, kernel.n))
    return q, v, a


def turn(axis: int, angle: Any) -> Any:
    R, j, k = np.eye(3, dtype=complex), (axis + 1) % 3, (axis + 2) % 3
    R[j, j] = R[k, k] = np.cos(angle)
    R[k, j] = np.sin(angle)
    R[j, k] = -R[k, j]
    return R


def particles(robot: Robot, points: dict[str, Points], q: dict[str, Any]) -> tuple[Array, Any]:
    """Return masses and places of all particles, by nothing but products of poses; rigid links as eight of them."""
    poses: dict[str, tuple[Any, Any]] = {robot.base: (np.eye(3, dtype=complex), np.zeros(3, dtype=complex))}
    follow = {coupling.of: coupling.value(lambda name: q[name]) for coupling in robot.couplings}
    masses, places = list[Array](), list[Any]()
    for joint in robot.joints:
        R, p = poses[joint.parent]
        s = [follow.get(f"{joint.name}.{kind}", q.get(f"{joint.name}.{kind}", 0.0)) for kind in KINDS]
        p = p + R @ np.array(joint.placement.xyz)
        R = R @ np.array(joint.placement.rotation)
        p = p + R @ np.array(s[:3])
        for axis in range(3):
            R = R @ turn(axis, s[3 + axis])
        poses[joint.child] = R, p
        link = robot.link(joint.child)
        if link.modes is not None:
            e = np.array([q[f"{link.name}.{name}"] for name in link.modes.names])
            masses.append(points[link.name].mass)
            places.append(p + points[link.name].at(e) @ R.T)
        elif link.mass:
            mass, here = like(link)
            masses.append(mass)
            places.append(p + here @ R.T)
    return np.concatenate(masses), np.concatenate(places)


KINDS = ("x", "y", "z", "alpha", "beta", "gamma")


def like(link: eomgen.Link) -> tuple[Array, Array]:
    """Return eight particles with a link's mass, centre of mass and inertia."""
    xx, yy, zz, xy, xz, yz = link.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    sizes, axes = np.linalg.eigh(second / link.mass)
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    return np.full(8, link.mass / 8.0), np.array(link.com) + (signs * np.sqrt(sizes)) @ axes.T


def slopes(robot: Robot, points: dict[str, Points], names: tuple[str, ...], q: Array) -> tuple[Array, Array, Array]:
    """Return masses, places (N, 3), and their derivatives by the coordinates (n, N, 3)."""
    columns = []
    for i in range(len(names)):
        moved = q.astype(complex)
        moved[i] += 1j * STEP
        mass, place = particles(robot, points, dict(zip(names, moved, strict=True)))
        columns.append(place.imag / STEP)
    return mass, place.real, np.array(columns)


def test_the_mass_matrix_is_that_of_the_particles(case: Case) -> None:
    robot, points, kernel = case
    q, v, _ = random_state(kernel)
    mass, place, J = slopes(robot, points, kernel.coordinates, q)
    M = np.einsum("n,inx,jnx->ij", mass, J, J)
    assert np.abs(kernel.mass_matrix(q) - M).max() < 1e-13 * np.abs(M).max()
    kinetic, potential = kernel.energy(q, v)
    springs = np.array([robot.coordinates[name].stiffness or 0.0 for name in kernel.coordinates])
    weight = -np.einsum("n,nx,x->", mass, place, robot.gravity)
    assert kinetic == pytest.approx(0.5 * v @ M @ v, rel=1e-13)
    assert potential == pytest.approx(weight + 0.5 * (springs * q) @ q, rel=1e-12)


def test_forces_are_those_of_newton_on_the_particles(case: Case) -> None:
    robot, points, kernel = case
    q, v, a = random_state(kernel, 1)
    mass, _, J = slopes(robot, points, kernel.coordinates, q)
    h = 1e-4  # the particles' accelerations, by central differences of their velocities, of fourth order

    def velocity(t: float) -> Array:
        J = slopes(robot, points, kernel.coordinates, q + t * v + 0.5 * t * t * a)[2]
        return np.asarray(np.einsum("inx,i->nx", J, v + t * a))

    acceleration = (8.0 * (velocity(h) - velocity(-h)) - (velocity(2.0 * h) - velocity(-2.0 * h))) / (12.0 * h)
    laws = [robot.coordinates[name] for name in kernel.coordinates]
    held = np.array([(x.stiffness or 0.0) * qi + (x.damping or 0.0) * vi for x, qi, vi in zip(laws, q, v, strict=True)])
    force = np.einsum("n,inx,nx->i", mass, J, acceleration - np.array(robot.gravity)) + held
    assert np.abs(kernel.inverse_dynamics(q, v, a) - force).max() < 1e-9 * np.abs(force).max()
    assert np.abs(kernel.forward_dynamics(q, v, force) - a).max() < 1e-7


@pytest.mark.soak
@pytest.mark.parametrize("which", ["drawn in", "stiffening"])
def test_derivatives_are_those_of_differences(which: str) -> None:
    _, _, kernel = made(drawn_in=True, second=which == "stiffening")
    q, v, a = random_state(kernel, 2)
    u, h, unit = kernel.inverse_dynamics(q, v, a), 1e-5, np.eye(kernel.n)

    def central(f: Any, *x: Array) -> list[Array]:
        blocks = []
        for k in range(len(x)):
            pairs = [[[*x[:k], x[k] + s * h * e, *x[k + 1 :]] for s in (1, -1)] for e in unit]
            blocks.append(np.array([(f(*plus) - f(*minus)) / (2.0 * h) for plus, minus in pairs]).T)
        return blocks

    for found, expected in zip(
        kernel.residual_jacobian(q, v, a), central(kernel.inverse_dynamics, q, v, a), strict=True
    ):
        assert np.abs(found - expected).max() < 1e-7 * max(1.0, np.abs(expected).max())
    for found, expected in zip(
        kernel.forward_dynamics_jacobian(q, v, u), central(kernel.forward_dynamics, q, v, u), strict=True
    ):
        assert np.abs(found - expected).max() < 1e-5 * max(1.0, np.abs(expected).max())
    C, symbols = kernel.coriolis_matrix(q, v), kernel.christoffel(q)
    rate = (kernel.mass_matrix(q + h * v) - kernel.mass_matrix(q - h * v)) / (2.0 * h)
    assert np.abs(rate - C - C.T).max() < 1e-8
    assert np.abs(C @ v - kernel.bias_force(q, v)).max() < 1e-13
    assert np.abs(symbols @ v - C).max() < 1e-13


def test_forces_are_those_of_lagrange(stiffening: Case) -> None:
    """The rows belong to the energies: what stiffens by rotation has no particles to compare with."""
    robot, _, kernel = stiffening
    q, v, a = random_state(kernel, 5)
    h, unit, still = 1e-4, np.eye(kernel.n), np.zeros(kernel.n)

    def central(f: Any) -> Any:
        return (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)

    M = kernel.mass_matrix(q)
    assert kernel.energy(q, v)[0] == pytest.approx(0.5 * v @ M @ v, rel=1e-13)
    turning = central(lambda s: kernel.mass_matrix(q + s * v) @ v)
    kinetic = np.array([central(lambda s, e=e: 0.5 * v @ kernel.mass_matrix(q + s * e) @ v) for e in unit])
    potential = np.array([central(lambda s, e=e: kernel.energy(q + s * e, still)[1]) for e in unit])
    damped = np.array([robot.coordinates[name].damping or 0.0 for name in kernel.coordinates]) * v
    force = M @ a + turning - kinetic + potential + damped
    assert np.abs(kernel.inverse_dynamics(q, v, a) - force).max() < 1e-9 * np.abs(force).max()
    assert np.abs(kernel.forward_dynamics(q, v, force) - a).max() < 1e-7


@pytest.mark.parametrize("method", soaked(["rk4", "tsit5", "rosenbrock", "radau"], ["rosenbrock"]))
def test_methods_agree_with_one_of_scipy(stiffening: Case, method: Any) -> None:
    """Springs and dampers of modes are among what implicit methods solve for."""
    _, _, kernel = stiffening
    q, v, _ = random_state(kernel, 7)
    steps: dict[str, Any] = {"step": 2e-4} if method == "rk4" else {"rtol": 1e-9}
    motion = integrate(kernel, 0.3 * q, 0.3 * v, 0.4, method=method, **steps)
    reference = integrate(kernel, 0.3 * q, 0.3 * v, 0.4, method="scipy:DOP853", rtol=1e-11, atol=1e-13)
    assert np.abs(motion.q[-1] - reference.q[-1]).max() < 1e-7
