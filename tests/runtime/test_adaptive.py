"""Rollouts with error control: order, tolerance, independence of states, closed loops, drives as data, honest ends."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, IntegrationStopped, SingularError
from eomgen.integration.solve import integrate
from eomgen.kernel.stepping.adaptive import KEPT_NUMBERS
from eomgen.kernel.stepping.alternation import ELIMINATION, EVALUATION, FRESH, Alternation, Spent, Turn, implicit_spans
from eomgen.kernel.stepping.input_signals import InputSignals
from eomgen.kernel.stepping.methods import ADAPTIVE as METHODS
from eomgen.kernel.stepping.motions import BatchMotion, SingleMotion
from eomgen.kernel.stepping.options import NARROW_TURNS, ErrorControl, rollout_of
from eomgen.robot.value import Coordinate, Friction
from tests.support.builds import Build
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, loaded_free_joint, random_robot, random_state, seeds, some_prescribed
from tests.support.random_springs import with_springs
from tests.support.refusals import refused
from tests.support.sliders import mass_on_rail, massless_tip, massless_wheel
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")
NAMES = (
    *("adaptive_rollout", "radau_rollout"),
    *("forward_dynamics", "mass_matrix", "inverse_dynamics", "energy", "residual_jacobian"),
)
ORDERS = {"rosenbrock": 4, "tsit5": 5}


def fixed_steps(kernel: eomgen.Kernel, s: Any, method: str, duration: float, steps: int) -> Array:
    """The last coordinates and rates after steps of one length: with tolerances that allow anything, and new drives."""
    u = np.tile(s.u, (steps, 1))
    q, v = kernel.rollout(s.q, s.v, u, method=method, duration=duration, samples=steps, rtol=0.5, atol=1e30)
    return np.concatenate([q[-1], v[-1]])


@pytest.mark.parametrize("method", ORDERS)
@pytest.mark.parametrize("kind", soaked(("springs", "motors"), ("springs",)))
def test_order(method: str, kind: str, built: Build) -> None:
    """The Rosenbrock method keeps it without the derivatives of gravity and of velocity's terms."""
    robot = random_robot(1460, joints=(2, 2), types=("revolute",)) if kind == "springs" else geared_robot(1461, (2, 2))
    kernel, duration = built(robot, *NAMES), 0.1
    s = motor_state(robot, 1) if kind == "motors" else random_state(robot, 1)
    exact = fixed_steps(kernel, s, "tsit5", duration, 2000)
    steps = (40, 80, 160) if method == "rosenbrock" else (10, 20, 40)
    errors = [np.abs(fixed_steps(kernel, s, method, duration, n) - exact).max() for n in steps]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - ORDERS[method]).max() <= 0.5, errors


def test_order_of_radau(built: Build) -> None:
    """Its iteration ends within tolerances, so its order, 9, shows in errors over numbers of steps."""
    kernel, duration, amplitude, frequency = built(mass_on_rail(stiffness=800.0), *NAMES), 5.0, 0.1, 20.0
    steps, errors = [], []
    for rtol in (1e-4, 1e-5, 1e-6, 1e-7):
        options: dict[str, Any] = {"rtol": rtol, "atol": amplitude * rtol}
        found = kernel.rollout([amplitude], [0.0], [0.0], method="radau", duration=duration, samples=1, **options)
        x = amplitude * np.exp(1j * frequency * duration)
        steps.append(found.steps)
        errors.append(np.hypot(found[0][-1, 0] - x.real, found[1][-1, 0] / frequency + x.imag))
    orders = -np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert np.abs(orders - 9.0).max() <= 1.0, (steps, errors)


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", seeds(1465, 1, 2))
def test_worn_joints_against_radau(method: str, seed: int, built: Build) -> None:
    """Clearances, curves, frictions and springs between points, at samples that steps do not know of beforehand."""
    from tests.codegen.forces.test_laws import worn  # with the oracle of Pinocchio

    robot = with_springs(worn(seed, (1, 2)), seed)
    kernel, s = built(robot, *NAMES), random_state(robot, seed)
    duration, samples = 0.02, 7
    q0, v0, u, z = s.q, s.v, s.u, s.z if kernel.internal_states else None
    reference = integrate(
        kernel,
        q0,
        v0,
        duration,
        drive=lambda t, q, v: u,
        method="scipy:Radau",
        rtol=1e-10,
        output_step=duration / samples,
        z0=z,
    )
    errors = []
    for rtol in (1e-4, 1e-7):
        q, v = kernel.rollout(q0, v0, u, z=z, method=method, duration=duration, samples=samples, rtol=rtol)
        errors.append(max(np.abs(q - reference.q).max(), np.abs(v - reference.v).max() * duration))
    assert errors[1] <= 1e-6 * max(1.0, np.abs(reference.q).max())
    assert errors[1] <= max(0.1 * errors[0], 1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_a_stiff_joint_costs_the_implicit_method_nothing(method: str, built: Build) -> None:
    """A damped spring of 1e9 N/m: steps as long as the motion allows, or as short as stability asks for."""
    kernel = built(mass_on_rail(stiffness=1e9, damping=1e5), *NAMES)
    found = kernel.rollout([1e-9], [0.0], [5.0], method=method, duration=0.5, samples=1, rtol=1e-4, atol=1e-8)
    assert found[0][-1] == pytest.approx(5e-9, abs=1e-8)
    assert (found.steps <= 100) == (method != "tsit5")


@pytest.mark.parametrize("method", METHODS)
def test_tolerances_know_frictions_as_they_are_set(method: str, built: Build) -> None:
    """A block slides to rest, by a friction that turns round faster than the description's."""
    kernel = built(replace(mass_on_rail(friction=Friction(coulomb=4.0, smoothing=1e-2)), name="sledge"), *NAMES)
    tuned = kernel.replaced(parameters={"joints.rail.z.friction.smoothing": 1e-4})
    wanted = integrate(
        tuned, [0.0], [0.1], 0.5, drive=lambda t, q, v: np.ones(1), method="scipy:Radau", rtol=1e-9, output_step=0.5
    )
    q, v = tuned.rollout([0.0], [0.1], [1.0], method=method, duration=0.5, samples=1, rtol=1e-3)
    assert q[-1] == pytest.approx(wanted.q[-1], rel=2e-2)
    assert v[-1] == pytest.approx(wanted.v[-1], rel=2e-2, abs=1e-5)


def test_lengths_at_the_edge_of_stability_do_not_hunt(built: Build) -> None:
    """A damper that is stiff: the error says nothing until a step is too long for it, and few are refused."""
    kernel = built(mass_on_rail(stiffness=1e6, damping=3e3), *NAMES)
    found = kernel.rollout([0.0], [0.0], [5.0], method="tsit5", duration=2.0, samples=1, rtol=1e-3)
    assert found.steps >= 100
    assert found.rejected <= 0.02 * found.steps


def test_a_step_without_any_error(built: Build) -> None:
    """At rest nothing is wrong, and a step is as long as it may be."""
    kernel = built(mass_on_rail(stiffness=1e6), *NAMES)
    for method in METHODS:
        found = kernel.rollout([0.0], [0.0], [0.0], method=method, duration=1.0, samples=1)
        assert np.abs(found[0]).max() == 0.0
        assert found.steps <= 20


@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
@pytest.mark.parametrize("method", METHODS)
def test_every_state_has_steps_of_its_own(method: str, dtype: str) -> None:
    """The same bits alone, in any company, and in threads."""
    robot = random_robot(1470, joints=(2, 2), types=("revolute", "prismatic"))
    kernel = eomgen.build(robot, kernels=(rollout_of(method),), dtype=dtype, flags=("-O1", "-Werror"))
    rng = np.random.default_rng(2)
    q, v, u = (rng.uniform(-1.0, 1.0, (37, kernel.n)).astype(dtype) for _ in "qvu")
    how: dict[str, Any] = {"method": method, "duration": 0.2, "samples": 3, "rtol": 1e-4}
    whole = kernel.rollout(q, v, u, **how)
    steps = np.asarray(whole.steps)
    assert np.ptp(steps) > 0
    for i in (0, 20, 36):
        alone = kernel.rollout(q[i], v[i], u[i], **how)
        assert alone.steps == steps[i]
        assert all(np.array_equal(x[i], y) for x, y in zip(whole, alone, strict=True))
    some = kernel.rollout(q[5:18], v[5:18], u[5:18], **how)
    assert all(np.array_equal(x[5:18], y) for x, y in zip(whole, some, strict=True))
    kernel.threads = 2
    assert all(np.array_equal(x, y) for x, y in zip(whole, kernel.rollout(q, v, u, **how), strict=True))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", soaked(("four_bar", "bennett"), ("four_bar",)))
def test_loops_stay_closed_and_keep_their_energy(name: str, method: str, built: Build) -> None:
    robot = eomgen.load_robot(name)
    kernel = built(robot, *NAMES, "constraint", "constraint_jacobian")
    home = np.array([robot.home[x] for x in kernel.coordinates])
    zero = np.zeros(kernel.n)
    q, v = kernel.rollout(home, zero, zero, method=method, duration=1.0, samples=20, rtol=1e-8)
    assert np.abs(kernel.functions.constraint(q)).max() <= 1e-10
    rates = np.einsum("tmn,tn->tm", kernel.functions.constraint_jacobian(q), v)
    assert np.abs(rates).max() <= 1e-9 * max(1.0, np.abs(v).max())
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.ptp(energy) <= 1e-6 * np.ptp(kernel.energy(q, v)[:, 0])


@pytest.mark.parametrize("method", METHODS)
def test_drives_of_every_sample_and_a_controller(method: str, built: Build) -> None:
    """As rollouts in parts, one from sample to sample, and as the formula says."""
    kernel = built(mass_on_rail(mass=2.0), *NAMES)
    u = np.array([[3.0], [-1.0], [2.0], [0.0]])
    q, v = kernel.rollout([0.0], [0.1], u, method=method, duration=0.4, samples=4, rtol=1e-9)
    speed, place = 0.1, 0.0
    for k, force in enumerate(u[:, 0]):
        place, speed = place + 0.1 * speed + 0.5 * 0.01 * force / 2.0, speed + 0.1 * force / 2.0
        assert (q[k + 1, 0], v[k + 1, 0]) == pytest.approx((place, speed), abs=1e-9)
    gains: dict[str, Any] = {"kp": 50.0, "kd": 4.0, "target": np.array([0.3])}
    q, v = kernel.rollout([0.0], [0.0], [0.0], method=method, duration=1.0, samples=10, rtol=1e-9, **gains)
    t, decay, w = np.linspace(0.0, 1.0, 11), 1.0, np.sqrt(24.0)
    expected = 0.3 * (1.0 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t)))
    assert np.abs(q[:, 0] - expected).max() <= 1e-7


@pytest.mark.soak
def test_prescribed_coordinates_have_their_accelerations(built: Build) -> None:
    robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel, s = built(robot, *NAMES), random_state(robot, 3)
    given = [i for i, name in enumerate(kernel.coordinates) if name in kernel.prescribed]
    for method in METHODS:
        q, v = kernel.rollout(s.q, s.v, s.u, method=method, duration=0.1, samples=1, rtol=1e-8)
        assert v[1][given] == pytest.approx(s.v[given] + 0.1 * s.u[given], abs=1e-9)
        assert q[1][given] == pytest.approx(s.q[given] + 0.1 * s.v[given] + 0.005 * s.u[given], abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_motion_that_cannot_go_on_ends_where_it_got_to(method: str, built: Build) -> None:
    """Rates that no number holds any more; of two states the one that stays small is there as a whole."""
    kernel = built(mass_on_rail(mass=2.0), *NAMES)
    u = np.array([[1.0], [1e300]])
    with pytest.raises(
        IntegrationStopped, match=r"rail\.z.* in steps of any length that leads on of state 1; it ends at t = "
    ) as stop:
        kernel.rollout(np.zeros((2, 1)), np.zeros((2, 1)), u, method=method, duration=1e9, samples=10)
    assert 1e4 / np.sqrt(33.0) <= stop.value.t <= 3e4  # radau multiplies increments by up to 33
    assert stop.value.coordinate == "rail.z"
    q, _ = stop.value.stored
    assert q[0, -1] == pytest.approx(0.25e18)
    assert np.isnan(q[1, 1:]).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_singular_state_is_named(method: str, built: Build) -> None:
    """Of a joint that does not turn freely: something acts on its angles."""
    robot = loaded_free_joint()
    kernel, s = built(robot, *NAMES), random_state(robot, 1)
    q = s.q.copy()
    q[kernel.coordinates.index("joint1.beta")] = np.pi / 2
    with pytest.raises(SingularError, match=r"joint1\.alpha and joint1\.gamma"):
        kernel.rollout(q, s.v, s.u, method=method, duration=0.01)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(("robot", "name"), [(massless_tip(), r"k\.gamma"), (massless_wheel(), r"spin\.gamma")])
def test_a_coordinate_without_inertia_is_named_by_all_methods(
    robot: eomgen.Robot, name: str, dtype: str, built: Build
) -> None:
    """Of one state and of many; the linearly implicit method alone moves it, as its spring and damper say."""
    kernel = built(robot, "rollout", *NAMES, dtype=dtype)
    q, v, u = np.array([[0.3, 0.5], [0.0, -5.0], [0.0, 0.0]], dtype)
    for method in ("rk4", *METHODS):
        how: dict[str, Any] = {"dt": 1e-3, "steps": 10} if method == "rk4" else {"duration": 0.3, "rtol": 1e-4}
        for states in (q, np.tile(q, (5, 1))):
            said = rf"rollout: the mass matrix cannot be inverted at {name}( in s.*)?; .* no inertia .*; give links"
            refused(SingularError, said, kernel.rollout, states, v, u, method=method, **how)
    found, rates = kernel.rollout(q, v, u, method="implicit", dt=1e-3, steps=300)
    if name.startswith("k"):
        assert found[-1, 1] == pytest.approx(0.5 * np.exp(-3.0), abs=5e-4)
    else:
        assert rates[-1, 1] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("method", METHODS)
def test_lanes_that_cannot_move_change_no_bit_of_others(method: str, dtype: str, built: Build) -> None:
    """Some without armature: each has the reason that it has alone, and others their own steps."""
    kernel = built(massless_tip(), *NAMES, dtype=dtype)
    bad = [0, 3, 4, 17]
    kernels = [
        kernel.replaced(parameters={"joints.k.gamma.armature": 0.0 if i in bad else 0.01 + 0.001 * i})
        for i in range(19)
    ]
    rng, times, loads = np.random.default_rng(6), np.linspace(0.0, 0.2, 5), InputSignals()
    q, v = rng.uniform(-0.5, 0.5, (2, 19, 2))
    atol = np.full((19, 4), 1e-5)
    many = BatchMotion([x.calls for x in kernels], [loads] * 19, times, q, v, ErrorControl(method, 1e-4, atol))
    while many.go():
        pass
    for i, each in enumerate(kernels):
        alone = SingleMotion(each.calls, loads, times, q[i], v[i], ErrorControl(method, 1e-4, atol[i]))
        while not alone.progress.reason:
            alone.go()
        assert many.progress[i].reason == alone.progress.reason == (2 + 2 * 2 + 1 if i in bad else 1)
        assert many.progress[i].steps == alone.progress.steps
        for x, y in zip(many.samples, alone.samples, strict=True):
            assert np.array_equal(x[i], y, equal_nan=True)


@pytest.mark.parametrize("method", METHODS)
def test_a_state_that_does_not_close_says_nothing_about_others(method: str, built: Build) -> None:
    """Of a linkage whose prescribed crank is beyond the coupler's reach; others have the bits that they have alone."""
    robot = eomgen.load_robot("four_bar")
    (loop,), crank = robot.loops, robot.joints[0]
    short = tuple(replace(x, xyz=(f * x.xyz[0], 0.0, 0.0)) for x, f in zip(loop.placements, (1.0, 0.5), strict=True))
    given = replace(crank, coordinates={"gamma": Coordinate(prescribed=True)})
    robot = replace(
        robot, home={}, driven=(), loops=(replace(loop, placements=short),), joints=(given, *robot.joints[1:])
    )
    kernel = built(robot, *NAMES, "constraint", "cut_poses")
    good, bad, still = kernel.assemble([0.5, 0.3, 0.3], ["joint1.gamma"]), np.array([3.1, 0.0, 1.5]), np.zeros(3)
    how: dict[str, Any] = {"method": method, "duration": 0.05, "samples": 2, "rtol": 1e-4}
    alone = kernel.rollout(good, still, still, **how)
    q = np.array([bad, good, good, bad, good])
    with pytest.raises(
        IntegrationStopped, match=r"loop joint4 does not stay closed .* of state 0; it ends at t = 0 s"
    ) as stop:
        kernel.rollout(q, np.zeros_like(q), still, **how)
    for found, expected in zip(stop.value.stored, alone, strict=True):
        assert all(np.array_equal(found[i], expected) for i in (1, 2, 4))


def test_a_duration_alone_takes_the_stable_method(built: Build) -> None:
    kernel = built(mass_on_rail(), *NAMES)
    for found, expected in zip(
        kernel.rollout([0.1], [0.0], [0.5], duration=0.1, samples=3),
        kernel.rollout([0.1], [0.0], [0.5], duration=0.1, samples=3, method="rosenbrock"),
        strict=True,
    ):
        assert np.array_equal(found, expected)
    with pytest.raises(InputError, match=r"dt is given; allowed: duration, samples, .* with method='rosenbrock'"):
        kernel.rollout([0.1], [0.0], [0.5], dt=1e-3, duration=0.1)


def test_refusals(built: Build) -> None:
    kernel = built(mass_on_rail(), *NAMES)

    def denied(kind: type[Exception], match: str, **changed: Any) -> None:
        how: dict[str, Any] = {"u": [0.0], "method": "tsit5", "duration": 0.1, "samples": 2, **changed}
        refused(kind, match, kernel.rollout, [0.0], [0.0], **how)

    denied(InputError, "duration = -1.0 is not a length of time", duration=-1.0)
    denied(InputError, "duration = null|duration = None", duration=None)
    denied(InputError, "samples = 0", samples=0)
    denied(InputError, r"rtol = 0.0 is not allowed; a number from 1e-13", rtol=0.0)
    denied(InputError, "atol = -1.0 is not allowed", atol=-1.0)
    denied(ArrayError, r"atol: expected a number or \(2,\)", atol=[1.0, 2.0, 3.0])
    denied(InputError, "dt is given; allowed: duration, samples, tolerances, loads and works with", dt=1e-3)
    denied(InputError, "every is given", every=2)
    denied(InputError, "duration is given; allowed: dt, steps and every with method='rk4'", method="rk4")
    denied(ArrayError, "nan", u=[np.nan])
    denied(ArrayError, "u: expected", u=np.zeros((5, 1)))
    denied(InputError, "a controller needs a target", kp=1.0)


@pytest.mark.parametrize("best", NARROW_TURNS)
def test_the_method_that_leads_furthest_goes_on(best: str) -> None:
    """Also where it becomes the best on the way; all others are tried, and take a tenth of all work at most."""
    model = Alternation(NARROW_TURNS)
    work = dict.fromkeys(NARROW_TURNS, 0.0)
    order = [model.method]
    for k in range(4000):
        worth = 3.0 if model.method == (best if k > 400 else "tsit5") else 1.0
        cost = {"tsit5": 6.0, "rosenbrock": 15.0, "radau": 40.0}[model.method] * model.steps
        if k > 500:
            work[model.method] += cost
        model.took(Turn(model.steps, worth * cost, 0, cost))
        if model.method != order[-1]:
            order.append(model.method)
    assert set(order) == set(NARROW_TURNS)
    assert order[:3] == list(NARROW_TURNS)
    assert work[best] > 0.9 * sum(work.values())


def test_steps_that_run_up_say_nothing_of_what_a_method_is_worth() -> None:
    model = Alternation(("tsit5", "radau"))
    model.took(Turn(model.steps, 1.0, 0, 1.0))
    assert model.method == "radau"
    model.took(Turn(model.steps, 0.0, 0, 100.0))
    assert model.method == "radau"
    model.took(Turn(model.steps, 2.0, 0, 1.0))
    assert model.method == "radau"
    assert model.steps == 64


def test_a_method_begins_with_its_own_length_and_without_a_past() -> None:
    model, row = Alternation(("tsit5", "radau")), np.arange(20.0)
    progress = SimpleNamespace(next=0.001)
    model.took(Turn(model.steps, 1.0, 0, 1.0))
    model.hand_over(progress, row)
    assert progress.next == 0.001
    assert tuple(row[:4]) == FRESH
    assert row[4:KEPT_NUMBERS].tolist() == [4.0, 5.0]
    assert not row[KEPT_NUMBERS:].any()
    row[-1], progress.next = 1.0, 0.1
    model.hand_over(progress, row)
    assert (row[-1], progress.next) == (1.0, 0.1)
    for _ in range(2):
        model.took(Turn(model.steps, 0.0, 0, 1.0))
    assert model.method == "tsit5"
    model.hand_over(progress, row)
    assert (row[-1], progress.next) == (1.0, 0.001)


def test_work_of_radau_is_counted() -> None:
    progress, row = SimpleNamespace(steps=3, rejected=1, t=2.0, sample=1), np.zeros(20)
    row[4:6] = 50.0, 2.0
    before = Spent(progress, 0.0, row)
    progress.steps, progress.t = 5, 2.5
    row[4:6] = 72.0, 3.0
    assert before.until_now("radau") == Turn(2, 0.5, 22, EVALUATION * 22 + ELIMINATION)
    assert before.until_now("tsit5") == Turn(2, 0.5, 12, 12.0)
    assert implicit_spans(NARROW_TURNS, {"tsit5": 1.0, "rosenbrock": 2.0, "radau": 4.0}) == {
        "implicit_s": 6.0,
        "radau_s": 4.0,
    }
