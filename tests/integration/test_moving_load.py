"""Loads that move along beams: a published problem by other shape functions, energy, methods, batches and gradients.

A mass that crosses a beam: L. Fryba, "Vibration of Solids and Structures under Moving Loads", 1999, ch. 18; here of a
cantilever, by its clamped-free eigenfunctions, with what the mass feels of their slopes and curvatures on the way.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import eomgen
from eomgen import Kernel
from eomgen.description.load import robot_from_toml

Array = NDArray[np.float64]
pytestmark = pytest.mark.soak

LENGTH, E, SECTION, DENSITY, LOAD, SPEED = 2.0, 7e10, 0.04, 2700.0, 1.5, 3.0  # m, N/m^2, m (square), kg/m^3, kg, m/s
WEAK = 0.01  # m/s^2, a gravity under which the slopes hardly change the speed
CRANE = f"""
name = "crossed"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "bridge"
[links.beam]
length = {LENGTH}
E = {E}
G = 2.6e13
density = {DENSITY}
A = {SECTION**2}
Iy = {SECTION**4 / 12}
Iz = {SECTION**4 / 12}
J = {SECTION**4 / 6}
shear = [1.0, 1.0]
modes = {{ y = 5 }}
[[links]]
name = "trolley"
mass = {LOAD}
[[joints]]
name = "rail"
parent = "base"
child = "bridge"
type = "prismatic"
# how it is carried
[[joints]]
name = "cross"
parent = "bridge"
along = "beam"
child = "trolley"
type = "prismatic"
"""
PENDULUM = """
[[links]]
name = "load"
mass = 3.0
com = [0.0, -0.8, 0.0]
inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }
[[joints]]
name = "sway"
parent = "trolley"
child = "load"
type = "revolute"
"""


def clamped_free(count: int) -> tuple[Array, Any]:
    """Return roots of cos b cosh b = -1, and functions of x / length: eigenfunctions, their slopes and curvatures."""
    ends = [((k + 0.1) * np.pi, (k + 0.9) * np.pi) for k in range(count)]
    b = np.array([brentq(lambda x: np.cos(x) + 1.0 / np.cosh(x), *pair) for pair in ends])
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))

    def at(x: float) -> tuple[Array, Array, Array]:
        y = b * x
        value = np.cosh(y) - np.cos(y) - ratio * (np.sinh(y) - np.sin(y))
        slope = b * (np.sinh(y) + np.sin(y) - ratio * (np.cosh(y) - np.cos(y)))
        bend = b**2 * (np.cosh(y) + np.cos(y) - ratio * (np.sinh(y) + np.sin(y)))
        return value, slope, bend

    return b, at


def crossing(times: Array, count: int = 8) -> Array:
    """Return the deflection of the tip, m, as a mass comes in from the root at a constant speed; (T,)."""
    mu, EI, g = DENSITY * SECTION**2, E * SECTION**4 / 12.0, WEAK
    b, at = clamped_free(count)
    x, weights = np.polynomial.legendre.leggauss(60)
    shapes = np.array([at((1.0 + s) / 2.0)[0] for s in x])
    own = -mu * g * LENGTH * weights / 2.0 @ shapes

    def rates(t: float, y: Array) -> Array:
        value, slope, bend = at(SPEED * t / LENGTH)
        slope, bend = slope / LENGTH, bend / LENGTH**2
        e, e_dot = y[:count], y[count:]
        M = mu * LENGTH * np.eye(count) + LOAD * np.outer(value, value)
        taken = LOAD * value * (g + 2.0 * SPEED * slope @ e_dot + SPEED**2 * bend @ e)
        return np.concatenate([e_dot, np.linalg.solve(M, own - taken - EI * b**4 / LENGTH**3 * e)])

    at_rest = own / (EI * b**4 / LENGTH**3)
    found = solve_ivp(rates, (0.0, times[-1]), np.r_[at_rest, 0.0 * b], "LSODA", times, rtol=1e-9, atol=1e-14)
    deflection: Array = at(1.0)[0] @ found.y[:count]
    return deflection


def test_a_mass_that_crosses_a_cantilever() -> None:
    """It rolls freely, with its speed at the root; deflections by eight eigenfunctions, within 1e-3."""
    held = CRANE.replace("# how it is carried", 'prescribed = ["z"]').replace("-9.81", str(-WEAK))
    kernel = eomgen.build(robot_from_toml(held), flags=("-O1",))
    names = list(kernel.coordinates)
    modes = [names.index(f"bridge.mode{k}") for k in range(1, 6)]
    q, v = np.zeros((2, kernel.n))
    K = np.array([kernel.parameters[f"links.bridge.modes.{k}.stiffness"] for k in range(1, 6)])
    q[modes], v[names.index("cross.z")] = -kernel.inverse_dynamics(q, 0 * q, 0 * q)[modes] / K, SPEED
    times = np.linspace(0.0, 0.6, 61)
    found = kernel.rollout(q, v, duration=0.6, samples=60, rtol=1e-7, atol=1e-12, method="rosenbrock")
    tip = np.array([kernel.followers(x)["bridge_tip.y"][0] for x in found[0]])
    expected = crossing(times)
    assert np.ptp(expected) > 2e-6
    assert np.abs(tip - expected).max() < 1e-3 * np.ptp(expected)
    assert found[0][-1, names.index("cross.z")] == pytest.approx(SPEED * 0.6, rel=1e-3)


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    return eomgen.build(robot_from_toml(CRANE.replace("y = 5", "y = 2, z = 1") + PENDULUM), flags=("-O1",))


def start(kernel: Kernel) -> tuple[Array, Array]:
    q, v = np.zeros((2, kernel.n))
    place = kernel.coordinates.index
    q[place("cross.z")], q[place("sway.gamma")], q[place("bridge.mode1")] = 0.7, 0.5, 0.02
    v[place("cross.z")], v[place("bridge.mode3")] = 0.4, 0.3
    return q, v


def test_energy_is_kept(kernel: Kernel) -> None:
    """While a trolley runs to and fro under a pendulum, on a beam that bends in two planes."""
    q, v = start(kernel)
    motion = kernel.rollout(q, v, duration=1.0, samples=100, rtol=1e-12, method="tsit5")
    energies = kernel.energy(motion[0], motion[1])
    total = energies.sum(axis=1)
    assert np.ptp(motion[0][:, kernel.coordinates.index("cross.z")]) > 0.1
    assert np.abs(total - total[0]).max() < 1e-9 * energies[:, 0].max()


def test_methods_batches_and_precisions_agree(kernel: Kernel) -> None:
    q, v = start(kernel)
    options: dict[str, Any] = {"duration": 0.1, "samples": 5}
    reference = kernel.rollout(q, v, method="tsit5", rtol=1e-11, **options)[0]
    cases: tuple[tuple[Literal["rosenbrock", "radau"], float, float], ...]
    cases = (("rosenbrock", 1e-8, 1e-6), ("radau", 1e-9, 1e-7))
    for method, rtol, off in cases:
        assert np.abs(kernel.rollout(q, v, method=method, rtol=rtol, **options)[0] - reference).max() < off, method
    rng = np.random.default_rng(0)
    many_q, many_v = (x + 0.01 * rng.normal(size=(9, kernel.n)) for x in (q, v))
    a = kernel.forward_dynamics(many_q, many_v, 0 * many_q)
    for i in range(len(a)):
        assert np.array_equal(a[i], kernel.forward_dynamics(many_q[i], many_v[i], 0 * q))
    needed = kernel.inverse_dynamics(many_q, many_v, a)
    assert np.abs(needed).max() < 1e-9 * np.abs(a).max()


def test_derivatives_are_those_of_differences(kernel: Kernel) -> None:
    """Of accelerations, and of a motion by its start."""
    q, v = start(kernel)
    u, h = np.zeros(kernel.n), 1e-6
    by_q, by_v, by_u = kernel.forward_dynamics_jacobian(q, v, u)
    for found, which in ((by_q, 0), (by_v, 1), (by_u, 2)):
        for i, e in enumerate(np.eye(kernel.n)):
            ahead, behind = (
                kernel.forward_dynamics(*(x + s * h * e * (k == which) for k, x in enumerate((q, v, u))))
                for s in (1, -1)
            )
            assert np.abs((ahead - behind) / (2 * h) - found[:, i]).max() < 1e-6 * max(1.0, np.abs(found).max())


def test_followers_are_where_their_frames_are(kernel: Kernel) -> None:
    q, v = start(kernel)
    h = 1e-6
    there, ahead, behind = (kernel.followers(q + s * h * v, v) for s in (0, 1, -1))
    for name, (_, rate) in there.items():
        assert (ahead[name][0] - behind[name][0]) / (2 * h) == pytest.approx(float(rate), abs=1e-7), name
    pose = kernel.frame_pose(q, "trolley")[:3, 3]
    shift = [there.get(f"bridge_cross.{axis}", (0.0, 0.0))[0] for axis in "xyz"]
    assert pose == pytest.approx(np.array([0.7, 0.0, 0.0]) + shift, abs=1e-13)
