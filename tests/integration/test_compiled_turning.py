"""Integrations of joints that turn freely, in C and Python, and floating bases against Pinocchio's free flyer."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.description.load import robot_from_urdf
from eomgen.errors import EomgenWarning
from eomgen.integration import Until, integrate
from eomgen.integration.cubics import Cubics, hermite
from eomgen.integration.plan import why_not_in_c
from eomgen.kernel.complete import Kernel
from eomgen.kernel.stepping.adaptive import keep_steps
from eomgen.kernel.stepping.input_signals import Gains, LinkWrench, Signal
from eomgen.kernel.stepping.methods import ADAPTIVE as NUMBERS
from eomgen.kernel.stepping.methods import IN_C
from eomgen.kernel.stepping.motions import SingleMotion
from eomgen.kernel.stepping.options import ErrorControl
from eomgen.kernel.stepping.packed_inputs import PackedInputs
from eomgen.kernel.stepping.reading_inputs import input_signals
from eomgen.motion.point_to_point import Harmonic
from eomgen.motion.splines import Standstill
from eomgen.robot import build_model
from eomgen.robot.value import ANGULAR, Coordinate, Joint, Link, Placement, Robot
from eomgen.simulation.controls import JointPD, actuators
from tests.description.test_floating import HEAVY
from tests.oracles.flyers import Flyer
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs
from tests.support.small_robots import Q0, V0, free_body, tumbler
from tests.support.soak import soaked
from tests.support.turning_loops import INTEGRATED, held_at, held_pendulum

pytestmark = [pytest.mark.usefixtures("unoptimised")]
Array = NDArray[np.float64]
NEEDED = (
    *("forward_dynamics", "mass_matrix", "inverse_dynamics", "residual_jacobian", "energy", "kinematics"),
    *("external_force", "adaptive_rollout", "radau_rollout"),
)
DRIVE = np.array([0.1, 0.2, -0.1, 0.05, -0.02, 0.03])
PULL = np.array([[0.1, 0.2, -0.1, 0.05, -0.02, 0.03]])
LIMIT = {"auto": 1e-8, "tsit5": 1e-8, "radau": 1e-8, "rosenbrock": 1e-4}  # the last one is of third order


@cache
def floating_arm(shaken: bool = False) -> Robot:
    """A free body, or one on a slide that shakes, with an arm on a ball joint whose frame is turned."""
    body, tip = (
        Link(name, 1.0, (0.05, -0.02, 0.1), (0.04, 0.05, 0.06, 0.004, -0.003, 0.002)) for name in ("body", "tip")
    )
    place = Placement.from_rpy((0.2, 0.1, -0.1), (0.4, -0.3, 1.0))
    ball = Joint("ball", "body", "tip", "fixed", place, coordinates=dict.fromkeys(ANGULAR, Coordinate()))
    root = replace(free_body().joints[0], name="root")
    if shaken:
        root = Joint("root", "base", "body", "prismatic", coordinates={"z": Coordinate(prescribed=True)})
    return Robot("shaken_ball" if shaken else "floating_arm", (0.0, 0.0, -9.81), (body, tip), (root, ball))


def agree(kernel: Kernel, q: Array, v: Array, duration: float, method: str, **loads: Any) -> Any:
    """The motion by a method of C, which is DOP853's; rtol of both is tight.

    Links are compared, not angles: those that pass a pole next to it may go on as either triple of their rotation.
    """
    assert not why_not_in_c(kernel, *(loads.get(name) for name in ("drive", "wrench", "prescribed")))
    rtol = 1e-6 if method == "rosenbrock" else 1e-10
    found = integrate(kernel, q, v, duration, method=method, rtol=rtol, output_step=0.02, **loads)
    exact = integrate(kernel, q, v, duration, method="scipy:DOP853", rtol=1e-12, output_step=0.02, **loads)
    assert found.method in IN_C
    for link in kernel.links:
        mine, other = (np.asarray(kernel.frame_pose(x.q, link)) for x in (found, exact))
        assert np.abs(mine - other).max() <= LIMIT[method]
        mine, other = (
            np.einsum("tij,tj->ti", np.asarray(kernel.frame_jacobian(x.q, link)), x.v) for x in (found, exact)
        )
        assert np.abs(mine - other).max() <= 10.0 * LIMIT[method] * np.abs(other).max()
    assert np.abs(found.u - exact.u).max() <= 10.0 * LIMIT[method] * max(1.0, np.abs(exact.u).max())
    return found


@pytest.mark.parametrize("method", ["auto", *IN_C])
@pytest.mark.parametrize("loads", soaked([{}, {"drive": DRIVE, "wrench": PULL}], [{"drive": DRIVE, "wrench": PULL}]))
def test_a_free_body_over_the_poles(method: str, loads: dict[str, Any], built: Build) -> None:
    kernel = built(tumbler(), *NEEDED)
    found = agree(kernel, Q0, V0, 2.0, method, **loads)
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.45
    if not loads:  # about x of the base its momentum is what belongs to alpha, and what belongs to the origin
        p = np.einsum("tij,tj->ti", kernel.mass_matrix(found.q), found.v)
        about_x = p[:, 3] + np.cross(found.q[:, :3], p[:, :3])[:, 0]
        for kept in (*p[:, :3].T, about_x, found.energy.sum(axis=1)):
            assert np.abs(kept - kept[0]).max() <= 10.0 * LIMIT[method] * np.abs(p).max()


@pytest.mark.soak
def test_auto_takes_all_methods_in_turn_over_the_poles(built: Build) -> None:
    """A body that tumbles, and carries a mass on a stiff spring whose damper holds the explicit method back."""
    body = tumbler()
    mass = Link("mass", 0.1, (0.0, 0.0, 0.0), (0.001, 0.001, 0.001, 0.0, 0.0, 0.0))
    slide = Joint("slide", "body", "mass", "prismatic", coordinates={"z": Coordinate(1e4, 1e3)})
    loaded = replace(body, name="laden_tumbler", links=(*body.links, mass), joints=(*body.joints, slide))
    found = agree(built(loaded, *NEEDED), np.append(Q0, 1e-3), np.append(V0, 0.0), 1.0, "auto")
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.45
    assert found.method == "radau"
    assert found.info["radau_s"] < 1.0


@pytest.mark.parametrize("method", IN_C)
def test_a_pendulum_on_a_ball_swings_over_the_pole_itself(method: str, built: Build) -> None:
    """About y alone, under a moment about it: beta passes 90 degrees, where no other angle has a meaning."""
    link = Link("bob", 1.0, (0.3, 0.0, 0.0), (0.01, 0.02, 0.02, 0.0, 0.0, 0.0))
    ball = Joint("ball", "base", "bob", "fixed", coordinates=dict.fromkeys(ANGULAR, Coordinate()))
    kernel = built(Robot("ball_pendulum", (0.0, 0.0, -9.81), (link,), (ball,)), *NEEDED)
    moment = np.array([[0.0, 0.0, 0.0, 0.0, 0.5, 0.0]])
    motion = integrate(
        kernel, [0.0, 0.1, 0.0], [0.0, 9.0, 0.0], 2.0, wrench=moment, method=method, rtol=1e-9, output_step=0.01
    )
    assert np.abs(np.cos(motion.q[:, 1])).min() < 0.05
    assert np.abs(motion.q[:, [0, 2]]).max() <= 1e-9
    assert motion.q[-1, 1] > 10.0
    work = 0.5 * (motion.q[:, 1] - 0.1)
    gained = motion.energy.sum(axis=1) - motion.energy[0].sum()
    assert np.abs(gained - work).max() <= (1e-5 if method == "rosenbrock" else 1e-7)


class Pull:
    """A force beside a link's centre of mass, in its axes or the base's, as data and as a function."""

    def __init__(self, kernel: Kernel, link: str, turns: bool) -> None:
        self._kernel, self._link, self._turns = kernel, link, turns
        self._place, self._arm = kernel.links.index(link), np.array([0.1, 0.0, -0.2])
        self._row = np.array([0.5, -0.3, 0.2, 0.01, 0.02, -0.03])

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        R = np.asarray(self._kernel.frame_pose(q, self._link))[:3, :3]
        force, moment = ((R if self._turns else np.eye(3)) @ x for x in np.split(self._row, 2))
        found = np.zeros((len(self._kernel.links), 6))
        found[self._place] = np.concatenate([force, moment + np.cross(R @ self._arm, force)])
        return found

    def load_data(self) -> list[LinkWrench]:
        return [LinkWrench(self._place, Signal.constant(self._row), self._arm, turns=self._turns)]


@pytest.mark.parametrize("method", soaked(["auto", "radau", "rosenbrock"], ["radau"]))
@pytest.mark.parametrize("turns", [pytest.param(True, marks=pytest.mark.soak), False])
def test_a_floating_arm_under_pd_control_and_a_force(method: str, turns: bool, built: Build) -> None:
    """Two joints that turn at times of their own; what acts is asked in described states, and acts on all links."""
    robot = floating_arm()
    kernel = built(robot, *NEEDED)
    assert len(build_model(robot).turning) == 2
    rng = np.random.default_rng(3)
    q, v = 0.5 * rng.normal(size=kernel.n), 3.0 * rng.normal(size=kernel.n)
    drive = JointPD(
        Standstill(np.zeros(2)), actuators(kernel, ["root.x", "root.z"]), np.array([80.0, 50.0]), np.array([5.0, 3.0])
    )
    assert isinstance(drive.load_data().gains, Gains)  # type: ignore[union-attr]
    found = agree(kernel, q, v, 1.0, method, drive=drive, wrench=Pull(kernel, "tip", turns))
    near = np.abs(np.cos(found.q[:, [4, 7]])) < 0.5
    assert near.any(axis=0).all()
    assert (near[:, 0] != near[:, 1]).any()


@pytest.mark.soak
@pytest.mark.parametrize("method", ["tsit5", "radau"])
def test_a_ball_on_a_base_that_shakes(method: str, built: Build) -> None:
    """What is prescribed is put in place in described states; the force that it takes is asked there, too."""
    kernel = built(floating_arm(shaken=True), *NEEDED)
    shake = Harmonic([0.1], [3.0])
    q, v = np.array([0.0, 0.3, 0.2, 0.1]), np.array([0.0, 4.0, 3.0, 1.0])
    found = agree(kernel, q, v, 1.0, method, prescribed=shake)
    assert np.abs(np.cos(found.q[:, 2])).min() < 0.4
    assert np.abs(found.u[:, 0]).max() > 1.0


@pytest.mark.parametrize("method", soaked(IN_C, ["rosenbrock"]))
def test_a_closed_pendulum_under_loads(method: str, built: Build) -> None:
    """A free body of which a cut joint holds a point: closed in coordinates that are turned."""
    kernel = built(held_pendulum(), *INTEGRATED, "radau_rollout")
    u = np.array([3.0, -2.0, 4.0, 0.3, -0.2, 0.1])
    q, v = held_at(np.array([0.3, 0.2, 0.1]), np.array([1.0, 1.5, 0.5]))
    pull = np.array([[0.0, 1.0, 0.0, 0.2, 0.1, -0.3]])
    found, exact = (
        integrate(kernel, q, v, 1.0, drive=u, wrench=pull, method=name, rtol=1e-9, output_step=0.02)
        for name in (method, "scipy:DOP853")
    )
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.45
    assert np.abs(found.q - exact.q).max() <= (1e-6 if method == "rosenbrock" else 1e-8)
    assert found.info["gap"] <= 1e-11
    assert found.info["margin"] > 0.1


@pytest.mark.parametrize("name", ["free.alpha", "free.beta", "free.gamma", "free.x"])
def test_ends_beside_the_pole(name: str, built: Build) -> None:
    """A motion ends where a described angle reaches a value, while other angles are integrated."""
    kernel = built(tumbler(), *NEEDED)
    whole = integrate(kernel, Q0, V0, 2.0, method="scipy:DOP853", rtol=1e-11, output_step=0.01)
    i, near = kernel.coordinates.index(name), int(np.abs(np.cos(whole.q[:, 4])).argmin()) - 3
    value = float(whole.q[near, i])
    assert (np.sign(whole.q[:near, i] - value) == np.sign(whole.q[0, i] - value)).all()
    until = Until.coordinate(kernel, name, value)
    seen: list[Array] = []
    found = integrate(
        kernel, Q0, V0, 2.0, until=until, rtol=1e-9, output_step=0.05, record=lambda t, states: seen.extend(states)
    )
    assert np.abs(np.cos(whole.q[near, 4])) < 0.5
    assert found.info["ended_at"] == pytest.approx(whole.t[near], abs=1e-7)
    assert found.q[-1, i] == pytest.approx(value, abs=1e-12)
    assert np.array_equal(np.array(seen), np.hstack([found.q, found.v])[1:])
    assert np.abs(found.q[-1] - whole.q[near]).max() <= 1e-6


def test_cubics_do_not_cross_the_pole(built: Build) -> None:
    """Between two states on both sides of a pole described angles turn by half a turn; what lies between is near."""
    kernel = built(tumbler(), *NEEDED)
    q = np.array([0.0, 0.0, 0.0, 0.2, np.pi / 2 - 0.1, 0.1])
    v = np.array([0.1, 0.0, 0.0, 30.0, 3.0, 0.0])
    motion = integrate(kernel, q, v, 0.04, method="scipy:DOP853", rtol=1e-12, output_step=0.02)
    begin, exact, end = np.hstack([motion.q, motion.v])
    assert end[3] - begin[3] > 2.0
    found, plain = (
        Cubics(kernel.raw.turning, kernel.n).at(0.02, 0.0, begin, 0.04, end),
        hermite(0.02, 0.0, begin, 0.04, end, kernel.n),
    )
    R, mine, other = (np.asarray(kernel.frame_pose(x[:6].copy(), "body"))[:3, :3] for x in (exact, found, plain))
    assert np.abs(mine - R).max() <= 1e-3
    assert np.abs(other - R).max() >= 10.0 * np.abs(mine - R).max()


def batch(kernel: Kernel, states: tuple[Array, Array], times: Array, control: ErrorControl, most: int) -> Array:
    """Samples of states under PULL, (2, N, T, n), by calls of so many steps at most, which go on from the last one."""
    q, v = (x.copy() for x in states)
    function, view = kernel.raw.function(control.kernel), kernel.raw.view
    library = function.where(batch=True)
    packed = PackedInputs(library, kernel.calls, input_signals(kernel.calls, None, PULL, None))
    stored, progress = np.empty((2, len(q), times.size, kernel.n)), library.new_array("progress", len(q))
    turned, still = np.zeros((len(q), kernel.raw.turning_room)), np.zeros(kernel.n)
    drive = library.drive(u=view(still), turned=view(turned.reshape(-1)))
    left = keep_steps(progress, kernel.calls, control.methods)
    allowed = library.new("tolerance", rtol=control.rtol, atol=view(control.atol), most=most)
    how = (kernel.raw.ffi.from_buffer("double[]", times), times.size - 1, NUMBERS[control.method])
    null, pointer = kernel.raw.ffi.NULL, kernel.parameters.setup.pointer(library)
    while any(progress[i].reason == 0 for i in range(len(q))):
        arrays = map(view, (q, v, *stored))
        function.batch(len(q), null, pointer, 0, drive, packed.pointer, 0, allowed, 0, *how, *arrays, progress)
    assert all(progress[i].reason == 1 for i in range(len(q)))
    assert left is None or np.isfinite(left).all()
    return stored


@pytest.mark.parametrize("method", IN_C)
def test_calls_go_on_to_the_bit_and_lanes_turn_apart(method: str, built: Build) -> None:
    """Under loads: batches of one call and of many, and each state alone, its steps kept or not, have the same bits."""
    kernel = built(tumbler(), *NEEDED)
    data, n = input_signals(kernel.calls, None, PULL, None), kernel.n
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(5, n)), 3.0 * rng.normal(size=(5, n))
    q[0], v[0], q[1, 4], v[1] = Q0, V0, np.pi / 2, 0.0
    times, control = np.linspace(0.0, 1.0, 6), ErrorControl(method, 1e-7, np.full(2 * n, 1e-8))
    stored = batch(kernel, (q, v), times, control, 10**6)
    assert np.array_equal(batch(kernel, (q, v), times, control, 3), stored)
    for state in range(5):
        for kept in (0, 7):
            alone = SingleMotion(kernel.calls, data, times, q[state], v[state], control, kept)
            steps = []
            while not alone.progress.reason:
                steps.append(alone.go())
            assert alone.progress.reason == 1
            assert np.array_equal(stored[:, state], alone.samples)
            if kept:
                ends = np.vstack([np.hstack(part[1:]) for part in steps])
                assert np.array_equal(ends[-1], np.hstack(list(alone.state)))
                assert np.abs(np.diff(ends[:, 4])).max() < 2.0  # as described, next to each other


BASE = "floating_base"
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # Q of theory's "Near +-pi/2"
ROBOTS = ["small", pytest.param("talos_reduced", marks=pytest.mark.soak)]  # 8 coordinates and 38


def text_of(name: str) -> str:
    """A URDF whose root has a mass: two hinges, or a humanoid."""
    if name == "small":
        return HEAVY
    (path,) = (path for path in example_urdfs() if path.stem == name)
    return path.read_text(encoding="utf-8")


def kernel_of(name: str, built: Build) -> Kernel:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        robot = robot_from_urdf(text_of(name), floating_base=True, inertia="warn")
    kernel = built(robot, *NEEDED[:5], "rollout")
    assert list(kernel.raw.turning) == [BASE]
    assert kernel.coordinates[:6] == tuple(f"{BASE}.{x}" for x in ("x", "y", "z", "alpha", "beta", "gamma"))
    return kernel


def random_states(n: int, seed: int) -> tuple[Array, Array, Array]:
    """q and v of 12 states, and the drives of the joints."""
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(-1.0, 1.0, (2, 12, n))
    return q, v, rng.uniform(-5.0, 5.0, (12, n - 6))


def worst(flyer: Flyer, kernel: Kernel, q: Array, v: Array, drives: Array) -> float:
    """Largest difference of accelerations, of the largest of a state."""
    a = kernel.forward_dynamics(q, v, np.concatenate([np.zeros((len(q), 6)), drives], axis=1))
    found = np.array([flyer.slopes(*state) for state in zip(q, v, a, strict=True)])
    expected = np.array(
        [
            flyer.accelerations(flyer.configuration(x), flyer.rates(x, y), u)
            for x, y, u in zip(q, v, drives, strict=True)
        ]
    )
    return float((np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerations(name: str, built: Build) -> None:
    """In described angles, and in those that integrations take beside the poles, at which the described ones are."""
    kernel, text = kernel_of(name, built), text_of(name)
    q, v, drives = random_states(kernel.n, 6)
    assert worst(Flyer(text), kernel, q, v, drives) < 1e-10
    q[:6, 3:5] = 0.0  # sin(beta) is cos(alpha) cos(beta) of the other angles
    q[6:, 3:5] = [np.pi, 0.0] + 1e-7 * q[6:, 3:5]
    flyer = Flyer(text, TURN)
    poles = [flyer.described(x)[0, 2] for x in q]
    np.testing.assert_allclose(poles, np.repeat([1.0, -1.0], 6), atol=1e-12)
    turned = kernel.replaced()
    turned.parameters.turn({BASE})
    assert worst(flyer, turned, q, v, drives) < 1e-10


@pytest.mark.parametrize("name", ROBOTS)
def test_a_fall_over_the_pole(name: str, built: Build) -> None:
    """The base tumbles while joints swing: rollouts and integrations end where the free flyer does."""
    kernel, flyer = kernel_of(name, built), Flyer(text_of(name))
    rng = np.random.default_rng(8)
    q, v = np.zeros((2, kernel.n))
    q[3:6], v[3:6] = [0.2, 1.2, -0.3], [0.1, 5.0, 0.2]
    q[6:], v[6:] = rng.uniform(-0.3, 0.3, (2, kernel.n - 6))
    dt, steps = 2e-4, 1000
    rolled = kernel.rollout(q, v, np.zeros(kernel.n), dt, steps)
    found = integrate(kernel, q, v, dt * steps, method="scipy:DOP853", rtol=1e-10, output_step=dt)
    assert q[4] < 0.5 * np.pi
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.1
    x, w = flyer.motion(flyer.configuration(q), flyer.rates(q, v), np.zeros(kernel.n - 6), dt, steps)
    for ends in (rolled, (found.q, found.v)):
        q, v = ends[0][-1], ends[1][-1]
        assert flyer.apart(flyer.configuration(q), x) < 1e-8
        assert np.abs(flyer.rates(q, v) - w).max() < 1e-7 * np.abs(w).max()
    quaternion = found.quaternion(BASE)
    assert np.abs(np.diff(quaternion, axis=0)).max() < dt * np.abs(w).max()
    turned = quaternion[-1, [1, 2, 3, 0]]
    assert min(np.abs(turned - sign * x[3:7]).max() for sign in (1.0, -1.0)) < 1e-8
