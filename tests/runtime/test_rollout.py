"""Rollouts in C: against the same formulas in NumPy, SciPy's integrator, and what an integrator must keep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.errors import ArrayError, InputError, IntegrationError, SingularError, UnknownNameError
from eomgen.robot.value import PRINCIPAL, Coordinate, Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, random_state, seeds

TYPES = ("revolute", "prismatic", "fixed", "free")
NAMES = ("rollout", "forward_dynamics", "mass_matrix", "inverse_dynamics", "energy")
Drive = Callable[[int, Array, Array, float], Array]  # step, q, v, how far ahead


def distance(found: Array, expected: Array) -> float:
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


def given(robot: Robot, key: str) -> Array:
    return np.array([getattr(c, key) or 0.0 for joint in robot.joints for c in joint.coordinates.values()])


def principal(robot: Robot) -> Array:
    """1 at principal coordinates, 0 at deviations."""
    return np.array([float(name == PRINCIPAL.get(joint.type)) for joint in robot.joints for name in joint.coordinates])


def rk4(kernel: eomgen.Kernel, q: Array, v: Array, drive: Drive, dt: float, steps: int) -> tuple[Array, Array]:
    """The textbook's method."""

    def rate(k: int, q: Array, v: Array) -> tuple[Array, Array]:
        return v, kernel.forward_dynamics(q, v, drive(k, q, v, 0.0))

    qs, vs = [q], [v]
    for k in range(steps):
        d1 = rate(k, q, v)
        d2 = rate(k, q + dt / 2 * d1[0], v + dt / 2 * d1[1])
        d3 = rate(k, q + dt / 2 * d2[0], v + dt / 2 * d2[1])
        d4 = rate(k, q + dt * d3[0], v + dt * d3[1])
        q, v = (x + dt / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip((q, v), d1, d2, d3, d4, strict=True))
        qs.append(q)
        vs.append(v)
    return np.array(qs), np.array(vs)


def implicit(
    robot: Robot, kernel: eomgen.Kernel, q: Array, v: Array, drive: Drive, added: Array, dt: float, steps: int
) -> tuple[Array, Array]:
    """Springs and dampers at the end of a step, with the whole matrix."""
    K, B, none = given(robot, "stiffness"), given(robot, "damping"), np.zeros(len(q))
    qs, vs = [q], [v]
    for k in range(steps):
        matrix = kernel.mass_matrix(q) + np.diag(dt * B + dt * dt * K + added)
        right = drive(k, q, v, dt) - kernel.inverse_dynamics(q, v, none) - dt * K * v
        v = v + dt * np.linalg.solve(matrix, right)
        q = q + dt * v
        qs.append(q)
        vs.append(v)
    return np.array(qs), np.array(vs)


@pytest.mark.parametrize("seed", [*seeds(1000, 1, 5), *seeds(1006, 0, 3)])  # 1005 ends in a rod without inertia
@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_steps_are_those_of_the_formulas(seed: int, method: str, built: Build) -> None:
    robot = random_robot(seed, joints=(1, 4), tree=seed % 2 == 0, types=TYPES)
    kernel, s = built(robot, *NAMES), random_state(robot, seed)
    steps, dt, none = 12, 2e-3, np.zeros(kernel.n)
    u = np.random.default_rng(seed).uniform(-3.0, 3.0, (steps, kernel.n))
    found = kernel.rollout(s.q, s.v, u, dt, steps, method=method)
    if method == "rk4":
        expected = rk4(kernel, s.q, s.v, lambda k, q, v, h: u[k], dt, steps)
    else:
        expected = implicit(robot, kernel, s.q, s.v, lambda k, q, v, h: u[k], none, dt, steps)
    for x, y in zip(found, expected, strict=True):
        assert x.shape == (steps + 1, kernel.n)
        assert distance(x, y) < 1e-10


@pytest.mark.parametrize("seed", seeds(1010, 1, 4))
@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_a_controller_of_joints(seed: int, method: str, built: Build) -> None:
    robot = random_robot(seed, joints=(2, 4), types=("revolute", "prismatic"))
    kernel, s = built(robot, *NAMES), random_state(robot, seed)
    steps, dt, kp, kd = 12, 2e-3, 150.0, 9.0
    at = principal(robot)
    target = s.q + 0.1 * np.random.default_rng(seed).standard_normal((steps, kernel.n))

    def drive(k: int, q: Array, v: Array, ahead: float) -> Array:
        return np.asarray(s.u + at * (kp * (target[k] - q - ahead * v) - kd * v))

    found = kernel.rollout(s.q, s.v, s.u, dt, steps, method=method, kp=kp, kd=kd, target=target)
    if method == "rk4":
        expected = rk4(kernel, s.q, s.v, drive, dt, steps)
    else:
        expected = implicit(robot, kernel, s.q, s.v, drive, at * (dt * kd + dt * dt * kp), dt, steps)
    for x, y in zip(found, expected, strict=True):
        assert distance(x, y) < 1e-10


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("implicit", 1)])
def test_order_of_the_error(method: str, order: int, built: Build) -> None:
    """Half the step, an error 2^order smaller; the reference is SciPy's."""
    robot = random_robot(1023, joints=(3, 3), types=("revolute", "prismatic"), rigid=True)
    kernel, s = built(robot, *NAMES), random_state(robot, 5)
    n, end = kernel.n, 0.25

    def rate(_: float, y: Array) -> Array:
        return np.concatenate([y[n:], kernel.forward_dynamics(y[:n].copy(), y[n:].copy(), s.u)])

    exact = solve_ivp(rate, (0.0, end), np.concatenate([s.q, s.v]), "DOP853", rtol=1e-13, atol=1e-13).y[:n, -1]
    steps = 32 if order == 4 else 2048
    errors = [
        np.abs(kernel.rollout(s.q, s.v, s.u, end / count, count, method=method)[0][-1] - exact).max()
        for count in (steps, 2 * steps)
    ]
    assert 1e-12 < errors[0] < 1e-2
    assert 0.7 * 2**order < errors[0] / errors[1] < 1.4 * 2**order


@pytest.mark.soak
def test_implicit_steps_are_stable_where_springs_are_stiff(built: Build) -> None:
    """The elastic arm at a hundred times the step that rk4 can take: it comes to rest."""
    kernel = built(eomgen.load_robot("puma560_elastic"))
    q = 1e-4 * np.random.default_rng(1).standard_normal(kernel.n)
    none = np.zeros(kernel.n)
    with pytest.raises(IntegrationError, match=r"step \d.*; take a shorter dt, or method='implicit'"):
        kernel.rollout(q, none, none, 1e-2, 3000)
    at, rates = kernel.rollout(q, none, none, 1e-2, 3000, method="implicit")
    deviations = [i for i, name in enumerate(kernel.coordinates) if not name.endswith(".gamma")]
    assert np.abs(at[:, deviations]).max() < 0.1
    assert np.abs(rates[-1]).max() < np.abs(rates[:100]).max()


def test_energy_of_a_robot_that_nothing_damps(built: Build) -> None:
    robot = random_robot(1031, joints=(3, 3), types=("revolute", "prismatic"), rigid=True, forces=False)
    kernel, s = built(robot, *NAMES), random_state(robot, 2)
    q, v = kernel.rollout(s.q, s.v, np.zeros(kernel.n), 1e-4, 2000, every=100)
    total = kernel.energy(q, v).sum(axis=1)
    assert np.abs(total - total[0]).max() < 1e-9 * np.abs(kernel.energy(q, v)).max()


@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_batches(method: str, built: Build) -> None:
    """Every row is what it is alone, whatever stands beside it, and however many threads there are."""
    robot = random_robot(1040, joints=(3, 3), types=("revolute", "prismatic"))
    kernel, states = built(robot, *NAMES), [random_state(robot, i) for i in range(37)]
    q, v, u = (np.array([getattr(s, x) for s in states]) for x in "qvu")
    how: dict[str, Any] = {"method": method, "every": 4, "kp": 20.0, "kd": 1.0, "target": 0.9 * q}
    steps, dt = 10, 1e-3
    found = kernel.rollout(q, v, u, dt, steps, **how)
    assert [x.shape for x in found] == [(37, 3, kernel.n)] * 2
    for i in (0, 7, 36):
        alone = kernel.rollout(q[i], v[i], u[i], dt, steps, **{**how, "target": how["target"][i]})
        moved = kernel.rollout(q[i:], v[i:], u[i:], dt, steps, **{**how, "target": how["target"][i:]})
        for many, one, some in zip(found, alone, moved, strict=True):
            assert distance(many[i], one) < 1e-11
            assert np.array_equal(many[i], some[0])
    kernel.threads = 2
    try:
        for one, two in zip(found, kernel.rollout(q, v, u, dt, steps, **how), strict=True):
            assert np.array_equal(one, two)
    finally:
        kernel.threads = 1


def test_shapes_of_drives_and_targets(built: Build) -> None:
    """Constant, per state, per step, per state and step; one state for many drives."""
    robot = random_robot(1041, joints=(2, 2), types=("revolute",))
    kernel, s = built(robot, *NAMES), random_state(robot, 3)
    n, steps, dt, rng = kernel.n, 6, 1e-3, np.random.default_rng(0)
    u = rng.uniform(-3.0, 3.0, (5, steps, n))
    alone = [kernel.rollout(s.q, s.v, row, dt, steps) for row in u]
    many = kernel.rollout(s.q, s.v, u, dt, steps)
    starts = kernel.rollout(np.tile(s.q, (5, 1)), s.v, u, dt, steps)
    shared = kernel.rollout(np.tile(s.q, (5, 1)), s.v, u[:1], dt, steps)
    for i in range(5):
        for k in range(2):
            assert distance(many[k][i], alone[i][k]) < 1e-11
            assert np.array_equal(many[k][i], starts[k][i])
            assert distance(shared[k][i], alone[0][k]) < 1e-11
    held = kernel.rollout(np.tile(s.q, (5, 1)), s.v, u[:, 0], dt, steps)
    for i in range(5):
        expected = kernel.rollout(s.q, s.v, u[i, 0], dt, steps)
        assert all(distance(x[i], y) < 1e-11 for x, y in zip(held, expected, strict=True))
    targets = s.q + 0.1 * rng.standard_normal((5, steps, n))
    followed = kernel.rollout(s.q, s.v, s.u, dt, steps, kp=10.0, target=targets)
    for i in range(5):
        expected = kernel.rollout(s.q, s.v, s.u, dt, steps, kp=10.0, target=targets[i])
        assert all(distance(x[i], y) < 1e-11 for x, y in zip(followed, expected, strict=True))


def test_every_so_many_steps(built: Build) -> None:
    robot = random_robot(1042, joints=(2, 2))
    kernel, s = built(robot, *NAMES), random_state(robot, 3)
    whole = kernel.rollout(s.q, s.v, s.u, 1e-4, 11)
    some = kernel.rollout(s.q, s.v, s.u, 1e-4, 11, every=3)
    for x, y in zip(whole, some, strict=True):
        assert np.array_equal(x[::3], y)
    assert kernel.rollout(s.q, s.v, s.u, 1e-4, 11, every=50)[0].shape == (1, kernel.n)


@pytest.mark.soak
def test_in_single_precision(built: Build) -> None:
    robot = random_robot(1043, joints=(2, 2), types=("revolute",))
    single, double = built(robot, "rollout", dtype="float32"), built(robot, "rollout")
    s = random_state(robot, 3)
    q, v, u = (x.astype(np.float32) for x in (s.q, s.v, s.u))
    found = single.rollout(q, v, u, 1e-3, 20, method="implicit", kp=5.0, target=q)
    expected = double.rollout(s.q, s.v, s.u, 1e-3, 20, method="implicit", kp=5.0, target=s.q)
    assert found[0].dtype == np.float32
    assert distance(found[0], expected[0]) < 1e-4


def test_refusals(built: Build) -> None:
    robot = random_robot(1044, joints=(2, 2), types=("revolute",), max_coordinates=3, armature=False)
    kernel, s = built(robot, *NAMES), random_state(robot, 3)
    n = kernel.n
    deviation = int(np.flatnonzero(principal(robot) == 0)[0])

    def refused(kind: type[Exception], match: str, **changed: Any) -> None:
        how: dict[str, Any] = {"q0": s.q, "v0": s.v, "u": s.u, "dt": 1e-3, "steps": 5, **changed}
        with pytest.raises(kind, match=match):
            kernel.rollout(**how)

    refused(InputError, "method 'euler' is unknown; allowed: rk4, implicit, rosenbrock, tsit5", method="euler")
    refused(InputError, "steps = 0", steps=0)
    refused(InputError, "steps = true", steps=True)
    refused(InputError, "every = 1.5", every=1.5)
    refused(InputError, "dt = -1.0", dt=-1.0)
    refused(InputError, "dt = nan", dt=float("nan"))
    refused(ArrayError, "q0: expected", q0=s.q[1:])
    refused(ArrayError, rf"u: expected .*\(5, {n}\), a row for every step", u=np.zeros((4, n)))
    refused(ArrayError, rf"u: expected .*\(3, {n}\), a row for every state", q0=np.zeros((3, n)), u=np.zeros((4, n)))
    refused(ArrayError, "3 states in q0, 4 states in u", q0=np.zeros((3, n)), u=np.zeros((4, 5, n)))
    refused(ArrayError, "nan", v0=np.full(n, np.nan))
    refused(InputError, "a controller needs a target", kp=1.0)
    refused(InputError, "a controller needs a target", target=s.q)
    refused(InputError, "none below 0", kp=-1.0, target=s.q)
    gains = np.zeros(n)
    gains[deviation] = 2.0
    refused(InputError, f"kd is 2.0 at {kernel.coordinates[deviation]}; only principal", kd=gains, target=s.q)
    with pytest.raises(UnknownNameError, match="built without the kernel rollout"):
        built(robot, "energy").rollout(s.q, s.v, s.u, 1e-3, 5)


def test_a_singular_state_is_named(built: Build) -> None:
    """Of a joint that does not turn freely: something acts on its angles."""
    robot = random_robot(1045, joints=(1, 1), types=("free",), armature=False, forces=False)
    joint = robot.joint("joint1")
    loaded = replace(joint, coordinates={**joint.coordinates, "gamma": Coordinate(preload=0.0)})
    robot = replace(robot, name="loaded", joints=tuple(loaded if x is joint else x for x in robot.joints))
    kernel, s = built(robot, *NAMES), random_state(robot, 1)
    beta = kernel.coordinates.index("joint1.beta")
    q = np.tile(s.q, (6, 1))
    q[4, beta] = np.pi / 2
    with pytest.raises(SingularError, match=r"rollout: .*joint1\.alpha and joint1\.gamma in step 0;"):
        kernel.rollout(q[4], s.v, s.u, 1e-3, 5)
    with pytest.raises(SingularError, match=r"rollout: .*joint1\.alpha and joint1\.gamma in step 0 of state 4;"):
        kernel.rollout(q, s.v, s.u, 1e-3, 5)
    v = np.zeros(6)
    v[beta] = 10.0
    q[0] = 0.0
    q[0, beta] = np.pi / 2 - 0.02
    with pytest.raises(SingularError, match=r"rollout: .*joint1\.beta in step 2;"):
        kernel.rollout(q[0], v, np.tile(np.zeros(6), (5, 1)), 1e-3, 5, method="implicit")


def test_steps_that_are_too_long_are_to_blame(built: Build) -> None:
    """A step that runs into a singular state, though it begins in another one."""
    kernel = built(eomgen.load_robot("puma560_elastic"))
    q = 1e-4 * np.random.default_rng(1).standard_normal((3, kernel.n))
    none = np.zeros(kernel.n)
    with pytest.raises(IntegrationError, match=r"step \d+ of state \d.*; take a shorter dt, or method='implicit'"):
        kernel.rollout(q, none, np.zeros((1, 3000, kernel.n)), 1e-2, 3000)
