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
from eomgen.integration.solve import integrate
from eomgen.kernel.stepping.input_signals import (
    WORKS,
    DriveData,
    Gains,
    InputSignals,
    LinkWrench,
    ModelDrive,
    Signal,
    Track,
    Waves,
)
from eomgen.kernel.stepping.methods import ADAPTIVE as METHODS
from eomgen.kernel.stepping.reading_inputs import place_prescribed
from eomgen.motion.point_to_point import Harmonic, PointToPoint
from eomgen.motion.splines import signal_of
from eomgen.robot.value import PRINCIPAL, Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, loaded_free_joint, random_robot, random_state, seeds, some_prescribed
from tests.support.refusals import refused
from tests.support.sliders import mass_on_rail
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

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

    def denied(kind: type[Exception], match: str, **changed: Any) -> None:
        how: dict[str, Any] = {"q0": s.q, "v0": s.v, "u": s.u, "dt": 1e-3, "steps": 5, **changed}
        refused(kind, match, kernel.rollout, **how)

    denied(InputError, "method 'euler' is unknown; allowed: rk4, implicit, rosenbrock, tsit5", method="euler")
    denied(InputError, "steps = 0", steps=0)
    denied(InputError, "steps = true", steps=True)
    denied(InputError, "every = 1.5", every=1.5)
    denied(InputError, "dt = -1.0", dt=-1.0)
    denied(InputError, "dt = nan", dt=float("nan"))
    denied(ArrayError, "q0: expected", q0=s.q[1:])
    denied(ArrayError, rf"u: expected .*\(5, {n}\), a row for every step", u=np.zeros((4, n)))
    denied(ArrayError, rf"u: expected .*\(3, {n}\), a row for every state", q0=np.zeros((3, n)), u=np.zeros((4, n)))
    denied(ArrayError, "3 states in q0, 4 states in u", q0=np.zeros((3, n)), u=np.zeros((4, 5, n)))
    denied(ArrayError, "nan", v0=np.full(n, np.nan))
    denied(InputError, "a controller needs a target", kp=1.0)
    denied(InputError, "a controller needs a target", target=s.q)
    denied(InputError, "none below 0", kp=-1.0, target=s.q)
    gains = np.zeros(n)
    gains[deviation] = 2.0
    denied(InputError, f"kd is 2.0 at {kernel.coordinates[deviation]}; only principal", kd=gains, target=s.q)
    with pytest.raises(UnknownNameError, match="built without the kernel rollout"):
        built(robot, "energy").rollout(s.q, s.v, s.u, 1e-3, 5)


def test_a_singular_state_is_named(built: Build) -> None:
    """Of a joint that does not turn freely: something acts on its angles."""
    robot = loaded_free_joint()
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


ADAPTIVE_NAMES = (
    "adaptive_rollout",
    "radau_rollout",
    "rollout",
    "forward_dynamics",
    "mass_matrix",
    "inverse_dynamics",
    "energy",
    "kinematics",
)
LOADED = (*ADAPTIVE_NAMES, "generalized_force", "external_force")
FORCE = np.array([3.0, -10.0, 20.0])  # N, of powers of t


def push(factor: float = 1.0) -> InputSignals:
    """A force on the slider that is a polynomial of time."""
    signal = Signal(np.array([0.0, 2.0]), factor * FORCE.reshape(1, 3, 1))
    return InputSignals(DriveData(torque=Track(signal, np.array([0]))))


def aim(kp: float, kd: float, goal: float = 0.3) -> InputSignals:
    """A law that leads the slider to a place."""
    gains = Gains(np.array([kp]), np.array([kd]))
    return InputSignals(DriveData(program=Track(Signal.constant([goal]), np.array([0])), gains=gains))


@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_is_a_polynomial(method: str, built: Build) -> None:
    """For many states at once, beside a drive that stays, and its work."""
    kernel = built(mass_on_rail(mass=2.0), *LOADED)
    q0, v0 = np.array([[0.0], [1.0], [-2.0]]), np.array([[0.0], [0.5], [3.0]])
    found = kernel.rollout(q0, v0, [1.0], loads=push(), method=method, duration=1.5, samples=6, rtol=1e-9, works=True)
    t = np.linspace(0.0, 1.5, 7)
    force = np.polynomial.Polynomial(FORCE + [1.0, 0.0, 0.0])
    speed = force.integ() / 2.0
    assert found[1][..., 0] == pytest.approx(v0 + speed(t), abs=5e-8)
    assert found[0][..., 0] == pytest.approx(q0 + v0 * t + speed.integ()(t), abs=5e-8)
    gained = 0.5 * 2.0 * (found[1] ** 2 - v0[:, np.newaxis] ** 2)[..., 0]
    assert found.works[..., WORKS.index("drives")] == pytest.approx(gained, rel=1e-7, abs=1e-7)
    assert (found.works[..., 1:] == 0.0).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_every_state_may_have_loads_of_its_own(dtype: str, method: str) -> None:
    """Forces and laws side by side, in vectors and in threads: the bits, works and steps of a state alone."""
    kernel = eomgen.build(mass_on_rail(mass=2.0, damping=0.4), kernels=LOADED, dtype=dtype, flags=("-O1", "-Werror"))
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-1.0, 1.0, (2, 37, 1)).astype(dtype)
    loads = [push(float(x)) if i % 3 else aim(50.0 * float(x), 4.0) for i, x in enumerate(rng.uniform(0.5, 2.0, 37))]
    how: dict[str, Any] = {"method": method, "duration": 0.5, "samples": 4, "rtol": 1e-4, "works": True}
    whole = kernel.rollout(q, v, loads=loads, **how)
    assert np.ptp(whole.steps) > 0
    for i in (0, 1, 20, 36):
        alone = kernel.rollout(q[i], v[i], loads=loads[i], **how)
        assert alone.steps == whole.steps[i]
        assert np.array_equal(alone.works, whole.works[i])
        assert all(np.array_equal(x[i], y) for x, y in zip(whole, alone, strict=True))
    one = kernel.rollout(q[0], v[0], loads=loads, **how)  # of one state under many loads
    assert np.array_equal(one[0][0], whole[0][0])
    plain = kernel.rollout(q, v, loads=loads, **{**how, "works": False})
    assert all(np.array_equal(x, y) for x, y in zip(whole, plain, strict=True))
    kernel.threads = 2
    again = kernel.rollout(q, v, loads=loads, **how)
    assert np.array_equal(again.works, whole.works)
    assert all(np.array_equal(x, y) for x, y in zip(whole, again, strict=True))


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_what_integrate_takes_rollouts_take(method: str, built: Build) -> None:
    """Objects and data by the names of ``integrate``: a law, wrenches, and prescribed motions that states begin on."""
    robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel = built(robot, *LOADED)
    rng, given = np.random.default_rng(5), [kernel.coordinates.index(name) for name in kernel.prescribed]
    shake = Harmonic(np.full(len(given), 0.1), 3.0, 0.4)
    free = np.setdiff1d(np.arange(kernel.n), given)[:1]
    program = signal_of(PointToPoint(np.zeros(1), np.array([0.2]), 0.08, 0.01))
    assert program is not None
    gains = Gains(np.array([200.0]), np.array([5.0]))

    class Law:
        def load_data(self) -> DriveData:
            return DriveData(program=Track(program, free), gains=gains)

        def __call__(self, t: float, q: Array, v: Array) -> Array:
            raise AssertionError

    loads = {"drive": Law(), "wrench": rng.uniform(-3.0, 3.0, (len(kernel.links), 6)), "prescribed": shake}
    q, v = 0.1 * rng.normal(size=(2, 5, kernel.n))
    how: dict[str, Any] = {"method": method, "rtol": 1e-7}
    found = kernel.rollout(q, v, loads=loads, duration=0.1, samples=4, works=True, **how)
    assert found[0][:, 0, given] == pytest.approx(np.tile(shake(0.0)[0], (5, 1)), abs=1e-15)
    for i in (0, 3):
        alone = kernel.rollout(q[i], v[i], loads=loads, duration=0.1, samples=4, works=True, **how)
        assert all(np.array_equal(x[i], y) for x, y in zip((*found, found.works), (*alone, alone.works), strict=True))
        motion = integrate(kernel, q[i], v[i], 0.1, output_step=0.025, works=True, **how, **loads)  # type: ignore[arg-type]
        assert found[0][i] == pytest.approx(motion.q, abs=1e-5)
        assert found.works[i] == pytest.approx(motion.works, abs=1e-5 * np.abs(motion.works).max())  # type: ignore[arg-type]


def test_states_begin_where_tracks_do(built: Build) -> None:
    """A spline, or a path over a profile, in the place of a wave; each state by its own."""
    robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel = built(robot, *LOADED)
    count = len(kernel.prescribed)
    line = Signal(np.array([-1.0, 1.0]), np.array([[[2.0], [3.0], [4.0]]]))  # of t + 1
    path = Signal(
        np.array([0.0, 1.0]), np.array([[[1.0], [2.0]]]), Signal(np.array([-1.0, 1.0]), np.full((1, 2, 1), 0.25))
    )
    waves = Waves(np.tile([0.5, 2.0, 0.3, 0.1], (count, 1)))
    every = [
        InputSignals(),
        *(InputSignals(prescribed=replace(waves, tracks=[Track(x, np.array([0]))])) for x in (line, path)),
    ]
    q, v = np.zeros((3, kernel.n)), np.zeros((3, kernel.n))
    place_prescribed(kernel.calls, every, q, v)
    first, *rest = (kernel.coordinates.index(name) for name in kernel.prescribed)
    assert (q[0] == 0.0).all()
    assert q[1:, first] == pytest.approx([9.0, 2.0])
    assert v[1:, first] == pytest.approx([11.0, 0.5])
    assert q[1:, rest] == pytest.approx(0.1 + 0.5 * np.sin(0.3))
    assert v[1:, rest] == pytest.approx(np.cos(0.3))


BAD: dict[str, tuple[Any, str]] = {
    "kind": ("program", r"loads = \"?'program'\"?; allowed: InputSignals, a mapping from drive, wrench, prescribed"),
    "key": ({"drives": 1}, "'drives' is unknown; allowed: drive, wrench, prescribed"),
    "none": ([], "allowed: loads of one state at least"),
    "callable": ({"drive": print}, r"loads: drive: got .*; allowed: DriveData, or an object whose load_data\(\)"),
    "wrench": ({"wrench": np.zeros((2, 6))}, r"loads: wrench: got (.|\n)*allowed: .*finite numbers of shape \(1, 6\)"),
    "prescribed": ({"prescribed": Harmonic([0.1], 1.0)}, "loads: prescribed: .* no coordinate is prescribed"),
    "place": (
        InputSignals(DriveData(torque=Track(Signal.constant([1.0]), np.array([1])))),
        r"drive\.torque\.place: got .*; allowed: 1 whole numbers among 0",
    ),
    "columns": (
        InputSignals(DriveData(torque=Track(Signal.constant([1.0, 2.0]), np.array([0, 0])))),
        r"drive\.torque\.place: .* each place once",
    ),
    "knots": (
        InputSignals(DriveData(torque=Track(Signal(np.array([1.0, 0.0]), np.ones((1, 1, 1))), np.array([0])))),
        r"drive\.torque\.signal\.knots: got .*; allowed: numbers that increase",
    ),
    "pieces": (
        InputSignals(DriveData(torque=Track(Signal(np.arange(3.0), np.ones((1, 1, 1))), np.array([0])))),
        r"signal\.knots: got .*; allowed: finite numbers of shape \(2,\)",
    ),
    "not finite": (
        InputSignals(DriveData(torque=Track(Signal.constant([np.nan]), np.array([0])))),
        r"signal\.coefficients: .* not finite; allowed: finite numbers of shape \(any, any, any\)",
    ),
    "gains": (
        InputSignals(DriveData(gains=Gains(np.ones(1), np.ones(1)))),
        r"drive\.program: got null; allowed: a Track|drive\.program: got None; allowed: a Track",
    ),
    "kp": (
        replace(aim(1.0, 1.0), drive=replace(aim(1.0, 1.0).drive, gains=Gains(np.ones(2), np.ones(1)))),
        r"drive\.gains\.kp: got .* of shape \(1,\)",
    ),
    "ratio": (
        replace(aim(1.0, 1.0), drive=replace(aim(1.0, 1.0).drive, ratio=np.zeros(1))),
        r"drive\.ratio: got .*; allowed: finite numbers, none 0, of shape \(1,\)",
    ),
    "link": (InputSignals(wrenches=[LinkWrench(1, Signal.constant(np.ones(6)))]), r"wrench\[0\]\.link: .* among 0"),
    "six": (InputSignals(wrenches=[LinkWrench(0, Signal.constant(np.ones(3)))]), r"shape \(any, any, 6\)"),
    "arm": (InputSignals(wrenches=[LinkWrench(0, Signal.constant(np.ones(6)), np.ones(2))]), r"arm: .* shape \(3,\)"),
}


@pytest.mark.parametrize("name", BAD)
def test_loads_that_do_not_fit_are_refused(name: str, built: Build) -> None:
    """C follows them without looking."""
    kernel, (loads, says) = built(mass_on_rail(mass=2.0), *LOADED), BAD[name]
    refused(InputError, says, kernel.rollout, [0.0], [0.0], loads=loads, method="tsit5", duration=0.1)


def test_other_refusals(built: Build) -> None:
    kernel = built(mass_on_rail(mass=2.0), *LOADED)
    how: dict[str, Any] = {"method": "tsit5", "duration": 0.1}
    with pytest.raises(
        InputError, match=r"loads is given; allowed: dt, steps and every with method='rk4', not .* loads"
    ):
        kernel.rollout([0.0], [0.0], dt=0.1, steps=1, loads=push())
    with pytest.raises(InputError, match="works is given; allowed: dt, steps and every with method='implicit'"):
        kernel.rollout([0.0], [0.0], dt=0.1, steps=1, method="implicit", works=True)
    with pytest.raises(ArrayError, match="2 states in loads, but 3 in other arrays"):
        kernel.rollout(np.zeros((3, 1)), [0.0], loads=[push(), push()], **how)
    model = ModelDrive(kernel.calls, np.array([0]), np.ones(1), np.array([1]), np.array([-1]), 30.0)
    with pytest.raises(InputError, match=r"drive\.model\.column: .* allowed: 1 whole numbers among -1, 0"):
        kernel.rollout([0.0], [0.0], loads=InputSignals(replace(aim(1.0, 1.0).drive, model=model)), **how)
    turning = built(random_robot(1045, joints=(1, 1), types=("free",), armature=False, forces=False), *LOADED)
    zero = np.zeros(turning.n)
    with pytest.raises(InputError, match="works: joint1 has 3-DOF rotation; allowed: other joints"):
        turning.rollout(zero, zero, works=True, **how)


def test_without_drives_a_rollout_needs_none(built: Build) -> None:
    kernel = built(mass_on_rail(mass=2.0), *LOADED)
    q, v = kernel.rollout([0.0], [2.0], dt=0.1, steps=3)
    assert q[:, 0] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert (v == 2.0).all()
