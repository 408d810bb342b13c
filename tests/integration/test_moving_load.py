"""Flexible links in motion, and loads that move along them: a published problem by other shape functions, laws.

A mass that crosses a beam: L. Fryba, "Vibration of Solids and Structures under Moving Loads", 1999, ch. 18; here of a
cantilever, by its clamped-free eigenfunctions, with what the mass feels of their slopes and curvatures on the way.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import eomgen
from eomgen import Kernel
from eomgen.description.load import robot_from_toml
from eomgen.robot.value import Coordinate, Joint, Link, Robot
from eomgen.state.springs import stiffness_matrix
from tests.support.bending_links import nested
from tests.support.bending_robots import Bending, bent
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import Array, random_placement, random_rotation
from tests.support.rollout_cases import METHODS, Case, frozen

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
{link_table("trolley", LOAD)}
{joint_table("rail", "base", "bridge", "prismatic")}
# how it is carried
{joint_table("cross", "bridge", "trolley", "prismatic")}
along = "beam"
"""
PENDULUM = f"""
{link_table("load", 3.0, (0.0, -0.8, 0.0), (0.01, 0.01, 0.01))}
{joint_table("sway", "trolley", "load", "revolute")}
"""


COUPLED = ((300.0, 240.0), (240.0, 900.0))  # K of both links, J


def arm() -> Bending:
    """Two links that bend, one behind the other on revolute joints, with nodes; K couples modes, nothing dissipates."""
    rng = np.random.default_rng(11)
    links, joints, parent = [], [], "base"
    for name in ("upper", "fore"):
        J = random_rotation(rng) @ np.diag(rng.uniform(0.2, 0.4, 3))
        tensor = np.trace(J @ J.T) * np.eye(3) - J @ J.T
        inertia: Any = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        links.append(Link(name, 3.0, (0.3, 0.05, 0.1), nested(np.array(inertia))))
        placement = random_placement(rng)
        joints.append(Joint(f"to_{name}", parent, name, "revolute", placement, coordinates={"gamma": Coordinate()}))
        parent = name
    bending = bent(Robot("bending_arm", (1.0, -2.0, -9.0), tuple(links), tuple(joints)), 3, (2,), second=True)
    still = [
        replace(x, modes=replace(x.modes, D=((0.0, 0.0), (0.0, 0.0)), K=COUPLED))
        for x in bending.plain.links
        if x.modes is not None
    ]
    return replace(bending, plain=replace(bending.plain, links=tuple(still)))


@pytest.fixture(scope="module", params=["arm", pytest.param("crane", marks=pytest.mark.soak)])
def kernel(request: pytest.FixtureRequest) -> Kernel:
    """An arm of flexible links, or a trolley with a pendulum on a beam that bends in two planes."""
    crane = CRANE.replace("y = 5", "y = 2, z = 1") + PENDULUM
    return eomgen.build(arm().robot if request.param == "arm" else robot_from_toml(crane), flags=("-O1",))


def start(kernel: Kernel) -> tuple[Array, Array]:
    if kernel.name == "crossed":
        q, v = np.zeros((2, kernel.n))
        place = kernel.coordinates.index
        q[place("cross.z")], q[place("sway.gamma")], q[place("bridge.mode1")] = 0.7, 0.5, 0.02
        v[place("cross.z")], v[place("bridge.mode3")] = 0.4, 0.3
        return q, v
    modal = np.array(["mode" in name for name in kernel.coordinates])
    q, v = np.random.default_rng(2).uniform(-1.0, 1.0, (2, kernel.n))
    return np.where(modal, 0.02 * q, q), np.where(modal, 0.2 * v, v)


def test_energy_is_kept(kernel: Kernel) -> None:
    """To 1e-9 of the kinetic energy that there is on the way, while links turn, and a trolley runs to and fro."""
    (q, v), (duration, rtol) = start(kernel), (1.0, 1e-12) if kernel.name == "crossed" else (10.0, 1e-11)
    motion = kernel.rollout(q, v, duration=duration, samples=200, rtol=rtol, method="tsit5")
    energies = kernel.energy(motion[0], motion[1])
    kinetic, total = energies[:, 0], energies.sum(axis=1)
    first = "cross.z" if kernel.name == "crossed" else kernel.coordinates[0]
    assert np.ptp(motion[0][:, kernel.coordinates.index(first)]) > 0.1  # it moves
    assert np.abs(total - total[0]).max() < 1e-9 * kinetic.max()


def test_all_methods_find_the_same_motion(kernel: Kernel) -> None:
    (q, v), duration = start(kernel), 0.1 if kernel.name == "crossed" else 0.5
    options: dict[str, Any] = {"duration": duration, "samples": 10}
    reference = kernel.rollout(q, v, method="tsit5", rtol=1e-11, **options)[0]
    for method, rtol, off in (("rosenbrock", 1e-8, 1e-6), ("radau", 1e-10, 1e-7)):
        found = kernel.rollout(q, v, method=method, rtol=rtol, **options)[0]  # type: ignore[arg-type]
        assert np.abs(found - reference).max() < off, method
    if kernel.name == "crossed":
        return
    ends = {
        (method, steps): np.abs(
            kernel.rollout(q, v, method=method, dt=duration / steps, steps=steps)[0][-1] - reference[-1]
        ).max()
        for method, steps in (("rk4", 500), ("rk4", 1000), ("implicit", 4000), ("implicit", 8000))
    }
    assert ends["rk4", 1000] < 1e-6
    assert ends["rk4", 500] / ends["rk4", 1000] == pytest.approx(16.0, rel=0.2)
    assert ends["implicit", 4000] / ends["implicit", 8000] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("kernel", ["arm"], indirect=True)
def test_a_diagonal_beside_constants_goes_down_as_long_as_no_motion_gives_energy(kernel: Kernel) -> None:
    """300 and 900 beside 240: the matrix that is scaled to 1 has the eigenvalue 1 - 240 / sqrt(270,000) = 0.538."""
    name = "links.upper.modes.1.stiffness"
    with pytest.raises(eomgen.InputError, match=rf"{name}.*138\.5"):
        kernel.replaced(parameters={name: 138.0})
    assert stiffness_matrix(kernel.replaced(parameters={name: 139.0}))[1, 1] == 139.0


@pytest.mark.parametrize("kernel", ["arm"], indirect=True)
def test_stiffness_of_analyses_is_that_of_forces(kernel: Kernel) -> None:
    """Slopes of the springs' forces by differences, in a state in which no link weighs on them."""
    K, q = stiffness_matrix(kernel), np.zeros(kernel.n)
    h, found = 1e-3, []
    for e in np.eye(kernel.n):
        ahead, behind = (kernel.generalized_force(q + s * h * e, q) for s in (1, -1))
        weights = [kernel.gravity(q + s * h * e) for s in (1, -1)]
        found.append(-(ahead - behind + weights[0] - weights[1]) / (2.0 * h))
    modal = np.array(["mode" in name for name in kernel.coordinates])
    assert np.array_equal(K[np.ix_(modal, modal)], np.kron(np.eye(2), np.array(COUPLED)))
    assert np.abs(np.array(found) - K).max() < 1e-9 * K.max()


@pytest.mark.parametrize("kernel", ["arm"], indirect=True)
def test_frequencies_are_those_of_whole_matrices(kernel: Kernel) -> None:
    """Without weight, joints held: of M and K of the modes of both links."""
    weightless = kernel.replaced(parameters={f"gravity.{axis}": 0.0 for axis in "xyz"})
    found = eomgen.analysis.modes(arm().robot, kernel=weightless).frequencies
    modal = np.array(["mode" in name for name in kernel.coordinates])
    M = kernel.mass_matrix(np.zeros(kernel.n))[np.ix_(modal, modal)]
    squares = np.linalg.eigvals(np.linalg.solve(M, np.kron(np.eye(2), np.array(COUPLED))))
    assert found == pytest.approx(np.sqrt(np.sort(squares)) / (2.0 * np.pi), rel=1e-9)


def test_states_of_a_batch_are_those_alone(kernel: Kernel) -> None:
    """And accelerations are those that need no force."""
    q, v, u = (x + 0.01 * np.random.default_rng(5).normal(size=(9, kernel.n)) for x in (*start(kernel), 0.0))
    for name, arguments in (("forward_dynamics", (q, v, u)), ("mass_matrix", (q,)), ("energy", (q, v))):
        together = getattr(kernel, name)(*arguments)
        for i in range(len(q)):
            assert np.array_equal(together[i], getattr(kernel, name)(*(x[i] for x in arguments)))
    a = kernel.forward_dynamics(q, v, u)
    assert np.abs(kernel.inverse_dynamics(q, v, a) - u).max() < 1e-9 * np.abs(a).max()


def test_derivatives_of_accelerations(kernel: Kernel) -> None:
    """Products with Jacobians, forwards and backwards, are those of whole ones, and these those of differences."""
    rng, (q, v), h = np.random.default_rng(6), start(kernel), 1e-6
    state = (q, v, 0.3 * rng.normal(size=kernel.n))
    blocks, weights = kernel.forward_dynamics_jacobian(*state), rng.normal(size=kernel.n)
    rates = rng.normal(size=(3, kernel.n))
    along = sum(block @ rate for block, rate in zip(blocks, rates, strict=True))
    size = np.abs(along).max()
    assert np.abs(kernel.jvp("forward_dynamics", state, tuple(rates)) - along).max() < 1e-11 * size
    for found, block in zip(kernel.vjp("forward_dynamics", state, weights), blocks, strict=True):
        assert np.abs(found - weights @ block).max() < 1e-11 * max(1.0, np.abs(weights @ block).max())
    for k, found in enumerate(blocks):
        for i, e in enumerate(h * np.eye(kernel.n)):
            ends = [kernel.forward_dynamics(*(x + s * e * (j == k) for j, x in enumerate(state))) for s in (1, -1)]
            assert np.abs((ends[0] - ends[1]) / (2.0 * h) - found[:, i]).max() < 1e-6 * max(1.0, np.abs(found).max())


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_gradients_of_a_motion(kernel: Kernel, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    frozen(monkeypatch)
    case = Case(kernel, method, dict(zip("qvu", (*start(kernel), np.zeros(kernel.n)), strict=True)))
    case.parameters = tuple(name for name in kernel.parameters if name.endswith("stiffness"))[:2]
    case.check_differences(rel=1e-5)
    case.check_sensitivities(1e-9)


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


@pytest.mark.soak
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


@pytest.mark.soak
@pytest.mark.parametrize("kernel", ["crane"], indirect=True)
def test_followers_are_where_their_frames_are(kernel: Kernel) -> None:
    q, v = start(kernel)
    h = 1e-6
    there, ahead, behind = (kernel.followers(q + s * h * v, v) for s in (0, 1, -1))
    for name, (_, rate) in there.items():
        assert (ahead[name][0] - behind[name][0]) / (2 * h) == pytest.approx(float(rate), abs=1e-7), name
    pose = kernel.frame_pose(q, "trolley")[:3, 3]
    shift = [there.get(f"bridge_cross.{axis}", (0.0, 0.0))[0] for axis in "xyz"]
    assert pose == pytest.approx(np.array([0.7, 0.0, 0.0]) + shift, abs=1e-13)
