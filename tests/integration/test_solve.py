"""Integrators against closed forms and laws: SciPy's, SUNDIALS', contacts, failures, and what is refused."""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import ArrayError, IntegrationError, SingularError
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, IntegrationStopped, UnknownNameError
from eomgen.integration.plan import IntegratorOptions, choose_method, why_stiff
from eomgen.integration.solve import integrate
from eomgen.integration.steps import fixed_step
from eomgen.integration.system import WORK, Advance, System
from eomgen.kernel.stepping.methods import IN_C, METHODS
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Coordinate, Friction, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.scenario.recorded import scenario_from_record
from eomgen.simulation.run import run_scenario
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import random_robot, random_state
from tests.support.refusals import refused
from tests.support.soak import soaked
from tests.support.swinging import DAMPING, MASS, NEEDED, STIFFNESS, elastic_arm, oscillator

pytestmark = pytest.mark.usefixtures("unoptimised")


def closed_form(t: np.ndarray, q0: float, v0: float) -> np.ndarray:
    decay = DAMPING / (2.0 * MASS)
    w = np.sqrt(STIFFNESS / MASS - decay**2)
    return np.exp(-decay * t) * (q0 * np.cos(w * t) + (v0 + decay * q0) / w * np.sin(w * t))


@pytest.mark.parametrize(
    ("method", "options", "bound"),
    [
        ("scipy:DOP853", {"rtol": 1e-10}, 1e-9),
        ("scipy:RK45", {"rtol": 1e-9}, 1e-8),
        ("scipy:Radau", {"rtol": 1e-8}, 1e-8),
        ("scipy:BDF", {"rtol": 1e-8}, 1e-6),
        ("scipy:LSODA", {"rtol": 1e-9}, 1e-7),
        ("rk4", {"step": 1e-4}, 1e-10),
        ("auto", {"rtol": 1e-8}, 1e-8),
    ],
)
def test_oscillator_equals_its_closed_form(method: str, options: dict[str, float], bound: float, built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 1.0, method=method, **options)
    assert motion.t.shape == (1001,)
    assert motion.q.shape == motion.v.shape == motion.u.shape == (1001, 1)
    assert np.abs(motion.of("slide.z") - closed_form(motion.t, 0.1, 0.5)).max() <= bound
    energy = 0.5 * MASS * motion.v[:, 0] ** 2, 0.5 * STIFFNESS * motion.q[:, 0] ** 2
    assert np.allclose(motion.energy, np.transpose(energy), rtol=1e-12, atol=1e-15)
    assert motion.method == ("scipy:Radau" if method == "auto" else method)
    assert min(motion.info["steps"], motion.info["evaluations"]) > 0


@pytest.mark.parametrize("method", soaked(["scipy:DOP853", "scipy:Radau", "rk4"], ["scipy:DOP853", "rk4"]))
def test_times_of_samples_are_free(method: str, built: Build) -> None:
    """The state given is that at the first time, drives see the times themselves; what is recorded is the samples."""
    kernel = built(oscillator(), *NEEDED)
    times = np.array([0.3, 0.31, 0.5, 0.77, 1.0])
    seen: list[tuple[np.ndarray, np.ndarray]] = []
    options = {"method": method, "rtol": 1e-9, "step": 1e-4, "drive": lambda t, _q, _v: [np.cos(3.0 * t)]}
    record = lambda t, y: seen.append((t.copy(), y.copy()))  # noqa: E731
    part = integrate(kernel, [0.1], [0.5], 1.0, times=times, record=record, **options)
    shifted = {**options, "drive": lambda t, _q, _v: [np.cos(3.0 * (t + 0.3))]}
    whole = integrate(kernel, [0.1], [0.5], 0.7, output_step=0.01, **shifted)
    assert np.array_equal(part.t, times)
    assert np.abs(part.q - whole.q[[0, 1, 20, 47, 70]]).max() < 1e-7
    assert np.array_equal(np.concatenate([t for t, _ in seen]), times[1:])
    assert np.array_equal(np.concatenate([y for _, y in seen]), np.hstack([part.q, part.v])[1:])


def test_default_fixed_step_resolves_the_spring(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.0], 0.5, method="rk4", output_step=0.1)
    assert motion.t.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert np.abs(motion.q[:, 0] - closed_form(motion.t, 0.1, 0.0)).max() < 1e-7


def test_rk4_is_of_order_four(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    ends = [
        integrate(kernel, [0.1], [0.5], 1.0, method="rk4", step=h, output_step=1.0).q[-1, 0] for h in (8e-3, 4e-3, 2e-3)
    ]
    errors = np.abs(np.array(ends) - closed_form(np.array(1.0), 0.1, 0.5))
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.abs(orders - 4.0).max() < 0.25


@pytest.mark.parametrize(
    ("method", "rtol"), [("scipy:DOP853", 1e-11), pytest.param("scipy:Radau", 1e-10, marks=pytest.mark.soak)]
)
def test_energy_is_conserved_without_damping(method: str, rtol: float, built: Build) -> None:
    robot = elastic_arm(damping=0.0)
    kernel = built(robot, *NEEDED)
    rng = np.random.default_rng(0)
    q0, v0 = rng.uniform(-0.1, 0.1, kernel.n), rng.uniform(-0.5, 0.5, kernel.n)
    motion = integrate(kernel, q0, v0, 1.0, method=method, rtol=rtol, output_step=0.01)
    total = motion.energy.sum(axis=1)
    assert np.abs(total - total[0]).max() <= 1e-9 * motion.energy[:, 0].max()
    assert motion.energy[:, 0].max() > 3.0 * motion.energy[:, 0].min()


def test_dampers_and_drives_account_for_the_energy(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.0], 1.0, drive=lambda t, _q, _v: [3.0 * np.sin(15.0 * t)], rtol=1e-9)
    power = motion.u[:, 0] * motion.v[:, 0] - DAMPING * motion.v[:, 0] ** 2
    work = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(motion.t))
    assert motion.energy[-1].sum() - motion.energy[0].sum() == pytest.approx(work, abs=1e-5)


@pytest.mark.soak
def test_implicit_equals_explicit(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    q0, v0 = np.full(kernel.n, 0.02), np.full(kernel.n, -0.1)
    motions = [
        integrate(kernel, q0, v0, 0.5, method=method, rtol=rtol, output_step=0.01)
        for method, rtol in (
            ("scipy:DOP853", 1e-11),
            ("scipy:Radau", 1e-9),
            ("scipy:BDF", 1e-9),
            ("scipy:LSODA", 1e-10),
        )
    ]
    for motion in motions[1:]:
        assert np.abs(motion.q - motions[0].q).max() < 1e-6
        assert motion.info["jacobians"] > 0 or motion.method == "scipy:LSODA"  # which takes none while nothing is stiff


def test_a_wrench_acts_as_its_generalized_force(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED, "external_force")
    wrench = np.random.default_rng(1).uniform(-5.0, 5.0, (len(kernel.links), 6))
    zero = np.zeros(kernel.n)
    options = {"method": "scipy:DOP853", "output_step": 0.05, "rtol": 1e-10}
    given = integrate(kernel, zero, zero, 0.3, wrench=wrench, **options)
    called = integrate(kernel, zero, zero, 0.3, wrench=lambda _t, _q, _v: wrench, **options)
    as_drive = integrate(
        kernel, zero, zero, 0.3, drive=lambda _t, q, _v: kernel.functions.external_force(q, wrench), **options
    )
    assert (given.q == called.q).all()
    assert np.abs(given.q - as_drive.q).max() < 1e-9
    implicit = integrate(kernel, zero, zero, 0.3, wrench=wrench, method="scipy:Radau", output_step=0.05, rtol=1e-8)
    assert np.abs(given.q - implicit.q).max() < 1e-6


@pytest.mark.parametrize("batched", [True, False])
def test_jacobian_is_the_derivative(batched: bool, built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    drive = Spring()
    drive.batched = batched
    system = System(kernel, drive, None)
    y = np.random.default_rng(2).uniform(-0.3, 0.3, 2 * kernel.n)
    central = np.empty((y.size, y.size))
    for i, e in enumerate(1e-5 * np.eye(y.size)):
        central[:, i] = (system.derivative(0.1, y + e) - system.derivative(0.1, y - e)) / 2e-5
    assert np.abs(system.jacobian(0.1, y) - central).max() <= 1e-5 * np.abs(central).max()


class Spring:
    """A drive that depends on time and state, of one state or a batch."""

    batched = True

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -3.0 * q + 0.5 * np.roll(q, 1, axis=-1) - 0.7 * v + t


def runaway(_t: float, q: np.ndarray, _v: np.ndarray) -> np.ndarray:
    """A drive that throws the mass to infinity in finite time."""
    return 1e3 * q**3


@pytest.mark.parametrize("method", ["rk4", "scipy:DOP853", "scipy:RK45", "scipy:Radau", "scipy:BDF", "scipy:LSODA"])
def test_divergence_names_coordinate_and_time(method: str, built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(IntegrationStopped, match=r"oscillator, t = 0\.\d+ s: .*slide\.z") as caught:
        integrate(kernel, [2.0], [0.0], 1.0, drive=runaway, method=method, step=1e-3)
    error = caught.value
    assert isinstance(error, IntegrationError)
    assert error.coordinate == "slide.z"
    assert 0.0 < error.t < 0.2
    assert np.isfinite(error.q).all()
    assert np.isfinite(error.v).all()
    assert error.q[0] > 2.0


@pytest.mark.parametrize(
    ("method", "what"),
    [
        pytest.param(method, what, marks=() if method in ("IDA", "scipy:RK45", "rosenbrock") else pytest.mark.soak)
        for method, what in zip(METHODS[1:-1], itertools.cycle(("rate", "force")), strict=False)
    ],
)
def test_work_that_leads_nowhere_ends(method: str, what: str, built: Build) -> None:
    """A pendulum that is turned so fast that steps are 1e-12 of the duration, or 1e-31 of it: said after some work."""
    kernel = built(eomgen.load_robot("one_link"), *NEEDED, "residual_jacobian", "adaptive_rollout", "radau_rollout")
    force, rate = (1e20, 0.0) if what == "force" else (0.0, 1e30)
    says = r"joint1\.\w+ moves fastest .*evaluations led on by" if method not in IN_C else r"joint1\.\w+.* leads on"
    with pytest.raises(IntegrationStopped, match=says) as caught:
        integrate(kernel, [0.0, 0.3], [0.0, rate], 1.0, drive=[0.0, force], method=method)
    error = caught.value
    assert error.coordinate in kernel.coordinates
    assert np.isfinite(error.q).all()
    assert 0.0 <= error.t < 1e-6
    assert error.trajectory.info["evaluations"] <= 6 * WORK


def test_steps_that_are_too_short_end(built: Build) -> None:
    """rk4 with the step of a spring of 1e30 N/m, about which nothing moves."""
    kernel = built(oscillator(), *NEEDED)
    kernel.parameters["joints.slide.z.stiffness"] = 1e30
    with pytest.raises(IntegrationStopped, match=r"step of .*nothing moves, slide\.z is the stiffest; .* led on by"):
        integrate(kernel, [0.0], [0.0], 1.0, method="rk4")


def test_work_that_leads_on_goes_on() -> None:
    """Ten decades of steps, back to short ones again and again, and trials far ahead that are given up."""
    advance, t = Advance(0.0, 1000.0), 0.0
    for _ in range(20):  # impacts: their steps are as short as a microsecond in a thousand seconds
        for step in np.geomspace(1e-6, 1e-1, 200).tolist():
            for ahead in (0.0, 0.3, 1.0, 100.0, 1.0):
                advance.look(t + ahead * step)
            t += step
    stuck = Advance(0.0, 1000.0)
    for i in range(2 * WORK - 1):
        stuck.look(1.0 + i * 1e-12 + (500.0 if i % 7 == 0 else 0.0))
    refused(IntegrationError, f"{WORK} evaluations led on by", stuck.look, 1.0)


@pytest.mark.soak
def test_stiff_motions_are_no_standstill(built: Build) -> None:
    """An undamped spring that an explicit method follows through many evaluations."""
    kernel = built(oscillator(damping=0.0), *NEEDED)
    kernel.parameters["joints.slide.z.stiffness"] = 1e6
    motion = integrate(kernel, [1e-3], [0.0], 2.0, method="scipy:DOP853", rtol=1e-10, output_step=0.1)
    assert motion.info["evaluations"] > 3 * WORK
    assert np.abs(motion.energy.sum(axis=1) / 0.5 - 1.0).max() < 1e-5


def test_a_state_that_cannot_move_is_refused(built: Build) -> None:
    """A point mass on a revolute axis: nothing that the joint could turn."""
    robot = oscillator()
    point = replace(robot.links[0], inertia=(0.0,) * 6)
    joint = replace(robot.joints[0], type="revolute", coordinates={"gamma": Coordinate()})
    kernel = built(replace(robot, name="point_robot", links=(point,), joints=(joint,)), *NEEDED)
    refused(SingularError, r"slide\.gamma", integrate, kernel, [0.0], [0.0], 1.0)


def test_a_drive_that_fails_later(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(IntegrationStopped, match=r"drive: slide\.z is nan at t = 0\.5"):
        integrate(kernel, [0.1], [0.0], 1.0, drive=lambda t, _q, _v: [np.nan if t > 0.5 else 0.0])
    with pytest.raises(ArrayError, match="drive: expected forces of shape"):
        integrate(kernel, [0.1], [0.0], 1.0, drive=lambda _t, _q, _v: [1.0, 2.0])
    refused(ZeroDivisionError, "", integrate, kernel, [0.1], [0.0], 1.0, drive=lambda _t, _q, _v: [1 / 0])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"method": "euler"}, "method: 'euler' is unknown; allowed: auto, rosenbrock, tsit5, radau, scipy:Radau"),
        ({"duration": 0.0}, "duration: 0.0 s"),
        ({"duration": np.nan}, "duration: nan s"),
        ({"output_step": -1.0}, "output_step: -1.0 s"),
        ({"output_step": 1e-12}, r"output_step: 1e-12 s; allowed: at most 1e\+08 samples"),
        ({"method": "rk4", "step": 0.0}, "step: 0.0 s"),
        ({"rtol": 0.0}, "rtol: 0.0; allowed"),
        ({"rtol": 2.0}, "rtol: 2.0; allowed"),
        ({"atol": -1.0}, "atol: "),
        ({"atol": [1.0, 1.0, 1.0]}, "atol: expected a number or shape"),
        ({"times": [0.0, 0.5, 0.4, 1.0]}, "times: allowed: two or more finite times, increasing"),
        ({"times": [1.0]}, "times: allowed: two or more"),
        ({"times": [0.0, 0.5]}, "times: end at 0.5 s; allowed: at the duration, 1 s"),
        ({"times": [0.0, 1.0], "output_step": 0.1}, "times and output_step are both set"),
        ({"q0": [0.0, 0.0]}, r"q0: expected float64 of shape \(1,\)"),
        ({"v0": [np.nan]}, "v0: slide.z is nan"),
        ({"v0": "fast"}, "v0: 'fast'; allowed: 1 finite numbers"),
    ],
)
def test_arguments_that_are_refused(changes: dict[str, object], text: str, built: Build) -> None:
    arguments: dict[str, object] = {"q0": [0.0], "v0": [0.0], "duration": 1.0, **changes}
    with pytest.raises(InputError, match=text):
        integrate(built(oscillator(), *NEEDED), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"method": "euler"}, "method: 'euler' is unknown; allowed: auto, "),
        ({"rtol": 2.0}, "rtol: 2.0; allowed: from 1e-13"),
        ({"method": "rk4", "rtol": float("nan")}, "rtol: nan; allowed: from 1e-13"),
        ({"step": 0.0}, "step: 0.0 s; a step is a time above 0"),
    ],
)
def test_options_are_checked_where_they_are_made(given: dict[str, Any], text: str) -> None:
    """By functions before a kernel is built, and by records with the place that they came from."""
    for function in (IntegratorOptions, lambda **given: eomgen.simulate("one_link", **given)):
        caught = refused(InputError, "", function, **given)
        assert str(caught).startswith(text)
    refused(InputError, r"^FILE: integrator[:.]", scenario_from_record, {"duration": 1.0, "integrator": given}, "FILE")


def test_single_precision_is_refused(built: Build) -> None:
    with pytest.raises(InputError, match="needs a float64 kernel"):
        integrate(built(oscillator(), *NEEDED, dtype="float32"), [0.0], [0.0], 1.0)


def rubbing(mass: float = 0.5, smoothing: float = 1e-4) -> Robot:
    """A mass on a rail with dry friction and no spring: 5 N turn round over a smoothing of 0.1 mm/s."""
    robot = oscillator(damping=None)
    table = {"z": Coordinate(friction=Friction(5.0, smoothing=smoothing))}
    return replace(robot, name="rubbing", links=(replace(robot.links[0], mass=mass),),
        joints=(replace(robot.joints[0], coordinates=table),))  # fmt: skip


def test_stiff_friction_takes_an_implicit_method(built: Build) -> None:
    """A time constant of 10 us in a second, at rest under less than the friction: few steps instead of thousands."""
    kernel = built(rubbing(), *NEEDED, "residual_jacobian")
    options = {"drive": lambda _t, _q, _v: [3.0], "output_step": 0.1}
    found, explicit = (
        integrate(kernel, [0.0], [0.0], duration, method=method, **options)
        for method, duration in (("auto", 1.0), ("scipy:DOP853", 0.1))
    )
    assert found.method == "scipy:Radau"
    assert found.info["steps"] < 50 < 500 < 10 * explicit.info["steps"]
    assert found.v[-1, 0] == pytest.approx(1e-4 * 3.0 / 4.0, rel=1e-3)  # it creeps, as the law says
    assert np.abs(found.q[1] - explicit.q[-1]).max() < 1e-8


def test_what_is_stiff_depends_on_slopes_mass_and_duration(built: Build) -> None:
    kernel = built(rubbing(), *NEEDED)
    assert why_stiff(kernel, np.zeros(1), 1.0) == "dampers or friction take effect within 1e-05 s"
    assert choose_method(kernel, "auto", np.zeros(1), 1e-3) == "scipy:DOP853"  # 100 time constants
    kernel.parameters["joints.slide.z.friction.smoothing"] = 1.0
    assert choose_method(kernel) == "scipy:DOP853"
    heavy = built(rubbing(mass=500.0), *NEEDED)
    assert choose_method(heavy) == "scipy:DOP853"
    damped = built(with_table(Coordinate(damping=1e4)), *NEEDED)
    assert choose_method(damped) == "scipy:Radau"  # 5000 1/s
    assert (
        choose_method(built(with_table(Coordinate(damping=1e4)), "forward_dynamics", "mass_matrix")) == "scipy:DOP853"
    )
    damped.parameters["joints.slide.z.damping"] = 1e3
    assert choose_method(damped) == "scipy:DOP853"
    assert choose_method(built(with_table(Coordinate(cubic=1e9)), *NEEDED)) == "scipy:Radau"  # at 0 it has no stiffness


def test_default_fixed_step_follows_friction_and_dampers(built: Build) -> None:
    kernel = built(rubbing(), *NEEDED)
    times = np.array([0.0, 1.0])
    assert fixed_step(kernel, np.zeros(1), None, times) == pytest.approx(0.5e-5)
    motion = integrate(kernel, [0.0], [0.1], 0.02, method="rk4", output_step=0.01)
    assert abs(motion.v[-1, 0]) < 1e-8


def with_table(table: Coordinate) -> Robot:
    robot = oscillator()
    return replace(robot, name="single", joints=(replace(robot.joints[0], coordinates={"z": table}),))


KERNELS = (
    "forward_dynamics",
    "inverse_dynamics",
    "residual_jacobian",
    "mass_matrix",
    "energy",
    "external_force",
)


def stiff_rod(stiffness: float, damping: float) -> Robot:
    """one_link with another spring."""
    robot = eomgen.load_robot("one_link")
    joint = robot.joints[0]
    spring = replace(joint.coordinates["x"], stiffness=stiffness, damping=damping)
    return replace(robot, joints=(replace(joint, coordinates={**joint.coordinates, "x": spring}),))


def in_a_gap(gap: float, stiffness: float) -> Robot:
    """A mass of 2 kg that slides in a clearance."""
    return robot_from_toml(
        f"""
name = "slider"
gravity = [0.0, 0.0, 0.0]
{link_table("mass", 2.0)}
{joint_table("rail", "base", "mass", "prismatic")}
z = {{ stiffness = {stiffness}, clearance = {gap}, smoothing = 1e-9 }}
"""
    )


@pytest.mark.soak
def test_a_stiff_joint_costs_few_residual_calls(built: Build) -> None:
    """1e8 N/m, damped: at most 2000 residual calls for 2 s at rtol 1e-8, and an error below 1e-6 rad."""
    kernel = built(stiff_rod(1e8, 2e4), *KERNELS)
    q0, zero = [0.0, 0.3], np.zeros(2)
    reference = integrate(kernel, q0, zero, 2.0, method="scipy:Radau", rtol=1e-12)
    found = integrate(kernel, q0, zero, 2.0, method="IDA", rtol=1e-8)
    assert found.info["evaluations"] <= 2000
    assert np.abs(found.of("joint1.gamma") - reference.of("joint1.gamma")).max() <= 1e-6
    short = [
        integrate(kernel, q0, zero, 0.05, method="IDA", rtol=1e-8, atol=atol, output_step=0.05).info["evaluations"]
        for atol in (None, 1e-15)  # of each coordinate's size, or the finest of them for all
    ]
    assert short[1] > 3 * short[0]


@pytest.mark.parametrize(
    "method",
    soaked(["scipy:Radau", "scipy:BDF", "scipy:LSODA", "CVODE", "IDA", "scipy:DOP853"], ["scipy:LSODA", "IDA"]),
)
def test_all_methods_find_the_same_motion(method: str, built: Build) -> None:
    rng = np.random.default_rng(12)
    robot = random_robot(rng, joints=(2, 3), types=("revolute", "prismatic"))
    kernel, s = built(robot, *KERNELS), random_state(robot, rng)

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return s.u * np.sin(5.0 * t) - 3.0 * v

    wrench = rng.normal(size=(len(kernel.links), 6))
    options = {"drive": drive, "wrench": wrench, "output_step": 0.02}
    reference = integrate(kernel, s.q, s.v, 0.2, method="scipy:DOP853", rtol=1e-11, **options)  # type: ignore[arg-type]
    found = integrate(kernel, s.q, s.v, 0.2, method=method, rtol=1e-8, **options)  # type: ignore[arg-type]
    scale = np.ptp(reference.q, axis=0) + 1e-9
    assert np.abs((found.q - reference.q) / scale).max() <= 1e-4
    assert found.method == method


@pytest.mark.parametrize("seed", soaked(range(4), (1,)))
@pytest.mark.parametrize("exact", ["residual_jacobian", "forward_dynamics_jacobian", None])
def test_jacobians_equal_differences(seed: int, exact: str | None, built: Build) -> None:
    """Of y' and of F, with drives, wrenches and prescribed coordinates, from the kernel's derivatives and without."""
    rng = np.random.default_rng(800 + seed)
    robot = random_robot(rng, joints=(2, 3))
    if seed % 2:
        joint = robot.joints[0]
        name = next(iter(joint.coordinates))
        given = {**joint.coordinates, name: replace(joint.coordinates[name], prescribed=True)}
        robot = replace(robot, joints=(replace(joint, coordinates=given), *robot.joints[1:]))
    names = tuple(name for name in KERNELS if name != "residual_jacobian")
    names += () if exact is None else (exact,)
    kernel, s = built(robot, *names), random_state(robot, rng)
    n, gain = kernel.n, rng.normal(size=(kernel.n, 2 * kernel.n))

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return gain @ np.concatenate([q, v])

    given_motion = Harmonic([0.1], [1.0]) if kernel.prescribed else None
    system = System(kernel, drive, rng.normal(size=(len(kernel.links), 6)), given_motion)
    y, slopes, c = np.concatenate([s.q, s.v]), np.concatenate([s.v, s.a]), 3.7
    found, whole = system.jacobian(0.1, y), system.residual_jacobian(0.1, y, slopes, c)
    for i in range(2 * n):
        h = 1e-5
        step = np.zeros(2 * n)
        step[i] = h
        column = (system.derivative(0.1, y + step) - system.derivative(0.1, y - step)) / (2 * h)
        assert np.abs(found[:, i] - column).max() <= 1e-5 * max(1.0, np.abs(found).max())
        column = system.residual(0.1, y + step, slopes + c * step) - system.residual(0.1, y - step, slopes - c * step)
        assert np.abs(whole[:, i] - column / (2 * h)).max() <= 1e-5 * max(1.0, np.abs(whole).max())


def test_a_drives_own_slopes_are_taken(built: Build) -> None:
    kernel = built(stiff_rod(1e4, 1.0), *KERNELS)

    class Proportional:
        calls = 0

        def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
            return -5.0 * q

        def slopes(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            Proportional.calls += 1
            return -5.0 * np.eye(2), np.zeros((2, 2))

    y = np.array([0.001, 0.3, 0.1, -0.2])
    found = System(kernel, Proportional(), None).jacobian(0.0, y)
    assert Proportional.calls == 1
    by_differences = System(kernel, lambda t, q, v: -5.0 * q, None).jacobian(0.0, y)
    assert np.abs(found - by_differences).max() <= 1e-6 * np.abs(found).max()


@pytest.mark.parametrize("method", ["scipy:DOP853", "scipy:Radau", "IDA", "CVODE", "rk4"])
def test_contacts_of_a_sliding_mass(method: str, built: Build) -> None:
    """Constant speed in the gap, half a period of sqrt(k / m) at its end."""
    gap, stiffness, speed = 0.01, 2e5, 0.4
    kernel = built(in_a_gap(gap, stiffness), *KERNELS)
    found = integrate(kernel, [0.0], [speed], 0.1, method=method, rtol=1e-9, step=2e-5)
    swing = np.pi / np.sqrt(stiffness / 2.0)
    hits = [gap / speed, gap / speed + swing, 3 * gap / speed + swing, 3 * gap / speed + 2 * swing]
    assert [(c.side, c.closes) for c in found.contacts] == [(1, True), (1, False), (-1, True), (-1, False)]
    assert np.abs(np.array([c.t for c in found.contacts]) - hits).max() <= 2e-6
    assert np.abs(np.abs([c.rate for c in found.contacts]) - speed).max() <= 1e-4 * speed
    assert {c.coordinate for c in found.contacts} == {"rail.z"}


def test_no_clearance_has_no_contacts(built: Build) -> None:
    kernel = built(stiff_rod(1e4, 1.0), *KERNELS)
    assert integrate(kernel, [0.0, 0.3], [0.0, 0.0], 0.1).contacts == ()


@pytest.mark.parametrize("method", ["IDA", "CVODE"])
def test_what_stops_a_motion_is_said(method: str, built: Build) -> None:
    kernel = built(stiff_rod(1e4, 1.0), *KERNELS)

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.full(2, np.nan if t > 0.05 else 0.0)

    with pytest.raises(IntegrationStopped, match=rf"t = 0\.0[45].*{method} cannot go on") as caught:
        integrate(kernel, [0.0, 0.3], [0.0, 0.0], 0.1, drive=drive, method=method)
    assert np.isfinite(caught.value.q).all()
    assert 0.04 <= caught.value.t <= 0.051


@pytest.mark.parametrize("method", ["IDA", "CVODE", "scipy:Radau", "scipy:DOP853"])
def test_a_mistake_of_the_input_is_not_met_by_shorter_steps(method: str, built: Build) -> None:
    """It has its own name, and ends the motion where it is made, though a ValueError of the state does not."""
    kernel, calls = built(stiff_rod(1e4, 1.0), *KERNELS), [0]

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if t > 0.05:
            calls[0] += 1
            raise UnknownNameError("no table of that name")
        return np.zeros(2)

    with pytest.raises(InputError, match=r"no table of that name"):
        integrate(kernel, [0.0, 0.3], [0.0, 0.0], 0.1, drive=drive, method=method)
    assert calls == [1]


def test_without_scikit_sundae_the_install_line_is_named(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sksundae.ida", None)
    with pytest.raises(InputError, match=r'IDA needs scikit-sundae, which is not installed: .*"eomgen\[sim\]"'):
        integrate(built(stiff_rod(1e4, 1.0), *KERNELS), [0.0, 0.3], [0.0, 0.0], 0.1, method="IDA")


@pytest.mark.soak
def test_a_simulation_says_when_its_clearances_closed(tmp_path: Path) -> None:
    """In its summary and in its file, where the piece of a payload's arrival does not lose them."""
    scenario = scenario_from_toml(
        'duration = 0.3\n[motion]\ntype = "point_to_point"\n'
        '[[payloads]]\nlink = "fore"\nmass = 0.1\npoint = [0.1, 0, 0]\nt0 = 0.1\n'
    )
    result = run_scenario(eomgen.load_robot("worn_arm"), scenario)
    assert {contact.coordinate for contact in result.trajectory.contacts} <= {"shoulder.x", "shoulder.y"}
    closed = [
        contact for contact in result.trajectory.contacts if contact.closes and contact.coordinate == "shoulder.y"
    ]
    line = f"clearance of shoulder.y: closed {len(closed)} times, first at {closed[0].t:.4f} s"
    assert any(line in text for text in result.summary_lines())
    assert eomgen.load_result(result.save(tmp_path / "r.npz")).trajectory.contacts == result.trajectory.contacts
