"""Works of what acts along a motion, and estimated errors of motions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import eomgen
from eomgen import InputError, IntegrationError, IntegrationStopped
from eomgen.errors import UnknownNameError
from eomgen.integration.reference_motions import GlobalError, global_error
from eomgen.integration.solve import integrate
from eomgen.integration.trajectory import Trajectory
from eomgen.integration.until import Until
from eomgen.kernel.stepping.input_signals import WORKS
from eomgen.kernel.stepping.methods import ADAPTIVE as METHODS
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Coordinate, Placement, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.integration.test_solve import closed_form
from tests.support.bristles import stateful_arm
from tests.support.builds import Build
from tests.support.pendulums import pendulum
from tests.support.random_robots import random_robot, random_state, seeds, some_prescribed
from tests.support.refusals import refused
from tests.support.small_robots import Q0, V0, tumbler
from tests.support.soak import across
from tests.support.swinging import DAMPING, MASS, NEEDED, STIFFNESS, elastic_arm, oscillator

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]
NAMES = (*NEEDED, "adaptive_rollout", "radau_rollout", "generalized_force", "external_force", "kinematics")
CLOSED = ("constrained_dynamics", "constraint", "constraint_jacobian", "residual", "cut_poses", "following")


def residue(motion: Trajectory) -> float:
    """Energy that does not balance, by the size of the works and of the energies' ranges."""
    total = motion.energy.sum(axis=1)
    found = total - total[0] - motion.works[:, :3].sum(axis=1) + motion.works[:, 3]
    return float(np.abs(found).max() / max(np.abs(motion.works).max(), np.ptp(motion.energy, axis=0).max()))


def same_bits(motion: Trajectory, other: Trajectory) -> bool:
    counts = all(motion.info[name] == other.info[name] for name in ("steps", "rejected"))
    return counts and np.array_equal(motion.q, other.q) and np.array_equal(motion.v, other.v)


@pytest.mark.parametrize("method", METHODS)
def test_a_closed_form(method: str, built: Build) -> None:
    """A damped mass on a spring under a force that stays, at a few samples between the steps."""
    kernel, force = built(oscillator(), *NAMES), 5.0
    times = np.array([0.0, 0.11, 0.35, 0.351, 0.8, 1.0])
    how: dict[str, Any] = {"drive": [force], "times": times, "method": method, "rtol": 1e-8}
    motion = integrate(kernel, [0.0], [0.0], 1.0, works=True, **how)
    plain = integrate(kernel, [0.0], [0.0], 1.0, **how)
    assert plain.works is None
    assert same_bits(motion, plain)
    decay = DAMPING / (2.0 * MASS)
    rate = np.sqrt(STIFFNESS / MASS - decay**2)

    def taken(end: float) -> float:
        """What the damper has taken until then."""
        nodes, weights = np.polynomial.legendre.leggauss(60)
        t = 0.5 * end * (nodes + 1.0)
        v = force / (MASS * rate) * np.exp(-decay * t) * np.sin(rate * t)
        return float(0.5 * end * weights @ (DAMPING * v**2))

    assert motion.works[:, WORKS.index("drives")] == pytest.approx(force * motion.q[:, 0], abs=1e-8)
    assert motion.works[:, WORKS.index("dissipated")] == pytest.approx([taken(t) for t in times.tolist()], abs=1e-8)
    assert (motion.works[:, [WORKS.index("prescribed"), WORKS.index("wrenches")]] == 0.0).all()


@pytest.mark.parametrize(("kind", "method"), across(["worn", "prescribed"], [*METHODS, "auto"]))
def test_balances_are_as_good_as_tolerances(kind: str, method: str, built: Build) -> None:
    """Clearances and frictions, or prescribed coordinates among others, under wrenches: at two samples as at many."""
    if kind == "worn":
        from tests.codegen.forces.test_laws import worn  # with the oracle of Pinocchio

        robot, prescribed = worn(1467, (1, 2)), None
    else:
        robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel, s = built(robot, *NAMES), random_state(robot, 3)
    if kernel.prescribed:
        prescribed = Harmonic(np.full(len(kernel.prescribed), 0.1), 3.0, 0.4)
    rng = np.random.default_rng(4)
    how: dict[str, Any] = {"drive": s.u, "wrench": rng.uniform(-5.0, 5.0, (len(kernel.links), 6))}
    how |= {"prescribed": prescribed, "method": method, "works": True}
    ends, found = [], []
    for rtol, step in ((1e-5, 0.05), (1e-7, 0.05), (1e-7, 0.0005)):
        motion = integrate(kernel, s.q, s.v, 0.05, rtol=rtol, output_step=step, **how)
        found.append(residue(motion))
        ends.append(motion.works[-1])
    assert np.array_equal(ends[1], ends[2])  # steps do not end at samples
    assert found[1] <= 1e-6
    assert found[2] <= 2e-6
    if method != "auto":
        assert found[1] <= max(0.1 * found[0], 1e-9)
    assert (np.abs(ends[1][[WORKS.index("drives"), WORKS.index("wrenches")]]) > 0.0).all()
    assert (ends[1][WORKS.index("prescribed")] != 0.0) == bool(kernel.prescribed)


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_a_mechanism_with_a_prescribed_crank(method: str, built: Build) -> None:
    """What moves the crank does what the energy changes by and what the rocker's damper takes: loops do no work."""
    robot = eomgen.load_robot("four_bar")
    crank, *others = robot.joints
    given = replace(crank, coordinates={"gamma": Coordinate(prescribed=True)})
    damped = replace(others[-1], coordinates={"gamma": Coordinate(damping=0.5)})
    robot = Robot(
        **{**vars(robot), "name": "cranked", "driven": (), "joints": (given, *others[:-1], damped), "home": {}}
    )
    kernel = built(robot, *NAMES, *CLOSED)
    wave = Harmonic([0.6], 1.0, 1.0)
    start, rate, _ = wave(0.0)
    q = kernel.assemble([float(start[0]), *(robot.home.get(x, 0.3) for x in kernel.coordinates[1:])], kernel.prescribed)
    v = kernel.project_velocity(q, [float(rate[0]), 0.0, 0.0], kernel.prescribed)
    motion = integrate(kernel, q, v, 0.2, prescribed=wave, method=method, rtol=1e-7, output_step=0.1, works=True)
    assert motion.works is not None
    assert residue(motion) <= 1e-6
    moved, taken = (abs(motion.works[-1, WORKS.index(name)]) for name in ("prescribed", "dissipated"))
    assert min(moved, taken) > 1e-3
    fine = integrate(kernel, q, v, 0.2, prescribed=wave, method="scipy:DOP853", rtol=1e-10, output_step=2e-4)
    power = (fine.u * fine.v)[:, 0]
    assert np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(fine.t)) == pytest.approx(
        motion.works[-1, WORKS.index("prescribed")], rel=1e-4
    )


@pytest.mark.parametrize("method", METHODS)
def test_steps_that_are_too_long_for_powers(method: str, built: Build) -> None:
    """Of a mass that is moved to and fro no number has an error, and steps are as long as can be; works are exact."""
    robot = oscillator(damping=3.0)
    joint = replace(robot.joints[0], coordinates={"z": Coordinate(damping=3.0, prescribed=True)})
    kernel = built(replace(robot, name="moved", joints=(joint,)), *NAMES)
    wave, end = Harmonic([0.2], 1.3, 0.4), 5.0
    times = np.array([0.0, 0.7, 3.0, end])
    motion = integrate(kernel, [0.0], [0.0], end, prescribed=wave, method=method, rtol=1e-8, times=times, works=True)
    amplitude, rate = 0.2, 2.0 * np.pi * 1.3
    assert motion.info["steps"] < 100
    angle = 2.0 * (rate * times + 0.4)
    taken = 3.0 * (amplitude * rate) ** 2 * (0.5 * times + (np.sin(angle) - np.sin(0.8)) / (4.0 * rate))
    assert motion.works[:, WORKS.index("dissipated")] == pytest.approx(taken, rel=1e-7)
    assert residue(motion) <= 1e-7


def test_ends_before_the_last_sample(built: Build) -> None:
    """Where a coordinate reaches a value, and where nothing leads on: works of all that is there."""
    kernel = built(oscillator(), *NAMES)
    how: dict[str, Any] = {"drive": [5.0], "method": "tsit5", "rtol": 1e-9, "works": True}
    until = Until.coordinate(kernel, "slide.z", 0.004)
    for step in (0.5, 0.003):
        motion = integrate(kernel, [0.0], [0.0], 1.0, until=until, output_step=step, **how)
        assert motion.works[:, 0] == pytest.approx(5.0 * motion.q[:, 0], abs=1e-10)
        assert residue(motion) <= 1e-8
    stop = refused(IntegrationStopped, "", integrate, kernel, [0.0], [0.0], 1e9, **{**how, "drive": [1e300]}, atol=1e-9)
    stopped = stop.trajectory
    assert stopped.works.shape == (stopped.t.size, len(WORKS))


def test_what_cannot_be_integrated_along_is_said(built: Build) -> None:
    kernel = built(oscillator(), *NAMES)
    with pytest.raises(
        InputError, match="works: oscillator: scipy:DOP853 integrates in Python; allowed: integrations in C"
    ):
        integrate(kernel, [0.0], [0.0], 0.1, method="scipy:DOP853", works=True)
    with pytest.raises(
        InputError, match="scipy:Radau integrates in Python, because the drive is a function that only Python"
    ):
        integrate(kernel, [0.0], [0.0], 0.1, drive=lambda _t, _q, _v: [1.0], works=True)
    with pytest.raises(UnknownNameError, match="without the kernel generalized_force"):
        integrate(built(oscillator(), *NEEDED, "adaptive_rollout"), [0.0], [0.0], 0.1, works=True)


@pytest.mark.soak
@pytest.mark.parametrize("robot", ["geared_arm", "worn_arm"])
def test_a_simulation_balances_at_any_samples(robot: str) -> None:
    """Powers at samples that lie far apart say little of the works in between, which are known all the same."""
    text = "duration = 0.3\n[motion]\ntype = 'point_to_point'\n"
    works = []
    for step in (0.1, 0.01):
        found = run_scenario(robot, scenario_from_toml(f"output_step = {step}\n{text}"))
        assert found.balance.relative_residue <= 1e-6
        works.append(found.balance.work[:: round(0.1 / step)])
    assert works[0] == pytest.approx(works[1], rel=1e-9, abs=1e-12)


ALL = (*NEEDED, "adaptive_rollout", "radau_rollout")
IN_PYTHON: dict[str, dict[str, float]] = {
    "scipy:DOP853": {"rtol": 1e-5},
    "scipy:Radau": {"rtol": 1e-5},
    "rk4": {"step": 5e-3},
}
OTHERS: dict[str, dict[str, float]] = {
    "scipy:RK45": {"rtol": 1e-5},
    "scipy:BDF": {"rtol": 1e-5},
    "scipy:LSODA": {"rtol": 1e-5},
}
IN_C: dict[str, dict[str, float]] = {name: {"rtol": 1e-5} for name in ("tsit5", "rosenbrock", "radau", "auto")}


def effectivity(estimate: np.ndarray, true: np.ndarray) -> float:
    """How far an estimate, (T, n), is from the true error, relative to the largest of both."""
    return float(np.abs(estimate - true).max() / np.abs(true).max())


@pytest.mark.parametrize("method", IN_PYTHON)
def test_errors_of_an_oscillator_are_those_beside_its_closed_form(method: str, built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 1.0, method=method, output_step=5e-3, **IN_PYTHON[method])
    true = motion.q - closed_form(motion.t, 0.1, 0.5)[:, np.newaxis]
    estimate = global_error(kernel, motion)
    assert np.abs(true).max() > 1e-8
    assert effectivity(estimate.q_error, true) < 1e-3
    assert estimate.is_resolved


def test_errors_of_a_pendulum_are_those_beside_elliptic_functions(built: Build) -> None:
    """sin(theta / 2) = k sn(K - w t, k) from rest at an amplitude of 2 rad, theta from hanging down."""
    mass, com, inertia = 2.0, 0.3, 0.05
    kernel = built(pendulum((), mass, com), *NEEDED)
    w, k = np.sqrt(mass * 9.81 * com / (inertia + mass * com**2)), np.sin(1.0)
    motion = integrate(kernel, [2.0 - np.pi / 2.0], [0.0], 3.0, method="scipy:DOP853", rtol=1e-5, output_step=0.02)
    exact = 2.0 * np.arcsin(k * ellipj(ellipk(k**2) - w * motion.t, k**2)[0]) - np.pi / 2.0
    true = motion.q - exact[:, np.newaxis]
    assert np.abs(true).max() > 1e-6
    assert effectivity(global_error(kernel, motion).q_error, true) < 1e-2


def drift(kernel: eomgen.Kernel, motion: Trajectory, estimate: GlobalError) -> tuple[np.ndarray, np.ndarray]:
    """By how much a conserved energy has drifted, (T,), and what the estimate makes of it."""
    of_exact = kernel.energy(motion.q - estimate.q_error, motion.v - estimate.v_error).sum(axis=1)
    energy = motion.energy.sum(axis=1)
    return energy - of_exact, energy - energy[0]


def test_energy_drifts_as_estimated(built: Build) -> None:
    kernel = built(elastic_arm(damping=0.0), *NEEDED)
    q, v = 0.02 * np.sin(np.arange(12.0)), 0.1 * np.cos(np.arange(12.0))
    motion = integrate(kernel, q, v, 0.4, method="scipy:DOP853", rtol=1e-4, output_step=4e-3)
    estimated, true = drift(kernel, motion, global_error(kernel, motion))
    assert np.abs(true).max() > 1e-6
    assert effectivity(estimated, true) < 0.05


def test_samples_that_nobody_integrated_are_found_out(built: Build) -> None:
    """A sample that is moved is off by that, and the others are as they were."""
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 0.5, method="scipy:DOP853", rtol=1e-10, output_step=1e-2)
    q = motion.q.copy()
    q[20] += 1e-5
    estimate = global_error(kernel, replace(motion, q=q))
    assert estimate.q_error[20, 0] == pytest.approx(1e-5, rel=1e-3)
    assert np.abs(np.delete(estimate.q_error, 20)).max() < 1e-8


def double_pendulum() -> Robot:
    """Two rods, one at the other's end."""
    robot = pendulum(())
    second = replace(robot.links[0], name="outer")
    joint = replace(robot.joints[0], name="second", parent="rod", child="outer", placement=Placement((0.6, 0.0, 0.0)))
    return replace(robot, links=(*robot.links, second), joints=(*robot.joints, joint))


def swinging(duration: float, within: float | None = None, output_step: float | None = None) -> tuple[Any, np.ndarray]:
    """Simulate a pendulum that falls from the horizontal, undriven, and return its exact angle, too."""
    mass, com, inertia = 2.0, 0.3, 0.05
    robot = pendulum((), mass, com)
    text = f"duration = {duration}\n" + ("" if output_step is None else f"output_step = {output_step}\n")
    scenario = scenario_from_toml(text)
    asked = {"global_error": True} if within is None else {"within": {"pivot.gamma": within}}
    result = run_scenario(robot, scenario, **asked)
    w, k = np.sqrt(mass * 9.81 * com / (inertia + mass * com**2)), np.sin(np.pi / 4.0)
    exact = 2.0 * np.arcsin(k * ellipj(ellipk(k**2) - w * result.trajectory.t, k**2)[0]) - np.pi / 2.0
    return result, result.trajectory.q[:, 0] - exact


@pytest.mark.parametrize("duration", [20.0, 100.0])
@pytest.mark.parametrize("output_step", [None, 1.0])
def test_long_motions_are_off_as_estimated_at_any_sampling(duration: float, output_step: float | None) -> None:
    result, true = swinging(duration, output_step=output_step)
    assert result.global_error.is_resolved
    assert np.abs(true).max() > 1e-7
    assert effectivity(result.global_error.q_error[:, 0], true) < 0.3


@pytest.mark.parametrize("within", [1e-4, 1e-8])
def test_a_pendulum_stays_within_what_is_asked_for(within: float) -> None:
    result, true = swinging(20.0, within)
    assert np.abs(true).max() <= within
    assert result.global_error.is_resolved


def test_motions_that_part_are_said_not_to_be_reliable() -> None:
    """A double pendulum after so long a time: tolerances decide where it is."""
    result = run_scenario(double_pendulum(), scenario_from_toml("duration = 60.0\n"), global_error=True)
    assert not result.global_error.is_resolved
    assert "not reliable: estimates by two narrower tolerances differ by" in result.global_error.line()
    with pytest.raises(IntegrationError, match=r"within: .*allowed: more than"):
        run_scenario(double_pendulum(), scenario_from_toml("duration = 60.0\n"), within={"second.gamma": 1e-13})


def test_results_have_the_tools_error_and_keep_it(tmp_path: Path) -> None:
    options: dict[str, Any] = {"duration": 0.2, "output_step": 4e-3}
    result = eomgen.simulate("one_link", rtol=1e-4, global_error=True, **options)
    closer = eomgen.simulate("one_link", rtol=1e-11, **options)
    true, estimate = result.pose[:, :3, 3] - closer.pose[:, :3, 3], result.global_error
    assert estimate.tool_error is not None
    assert effectivity(estimate.tool_error, true) < 1e-2
    assert estimate.line() in "\n".join(result.summary_lines())
    assert (
        result.summary()["global_error"]["tool"]
        == estimate.tool_max
        == np.linalg.norm(estimate.tool_error, axis=1).max()
    )
    assert np.array_equal(result.series(f"{result.tool}.error").values, estimate.tool_error)
    kept = eomgen.load_result(result.save(tmp_path / "r.npz"))
    assert isinstance(kept, eomgen.SimulationResult)
    assert kept.global_error.summary() == estimate.summary()
    assert closer.global_error is None


def test_a_tolerance_of_the_tool_is_met_or_refused() -> None:
    options: dict[str, Any] = {"duration": 0.2, "output_step": 4e-3, "rtol": 1e-3}
    closer = eomgen.simulate("one_link", **{**options, "rtol": 1e-11})
    result = eomgen.simulate("one_link", within={"tool": 1e-8, "joint1.gamma": 1e-8}, **options)
    off = result.pose[:, :3, 3] - closer.pose[:, :3, 3]
    assert 1e-11 < np.linalg.norm(off, axis=1).max() < 1.1e-8
    assert result.scenario["integrator"]["rtol"] < 1e-3
    assert "errors within what was asked for" in result.notes[-1]
    with pytest.raises(IntegrationError, match=r"within: tool: .* at rtol .*; allowed: more than"):
        eomgen.simulate("one_link", within={"tool": 1e-19}, **options)
    for within, said in (({}, "by name"), ({"hand": 1.0}, "'hand' is unknown"), ({"tool": 0.0}, "above 0")):
        refused(InputError, said, eomgen.simulate, "one_link", within=within, **options)


def test_a_motion_of_another_kernel_is_refused(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 0.1, method="rk4", step=1e-2)
    other = built(pendulum(()), *NEEDED)
    refused(InputError, r"trajectory: is of 'slide\.z'; allowed: .* 'pivot\.gamma'", global_error, other, motion)


@pytest.mark.soak
@pytest.mark.parametrize("method", [*IN_PYTHON, *OTHERS, *IN_C])
@pytest.mark.parametrize("seed", seeds(4100, 0, 6))
def test_random_robots_are_off_as_estimated(seed: int, method: str, built: Build) -> None:
    """Beside SciPy's DOP853 or Radau at the narrowest tolerance."""
    robot = random_robot(seed, max_size=6)
    kernel, rng = built(robot, *ALL), np.random.default_rng(seed)
    q, v = 0.1 * rng.uniform(-1.0, 1.0, (2, kernel.n))
    options = {**IN_PYTHON, **OTHERS, **IN_C}[method]
    motion = integrate(kernel, q, v, 0.2, method=method, output_step=2e-3, **options)
    exact = integrate(kernel, q, v, 0.2, method="scipy:Radau", rtol=1e-12, output_step=2e-3)
    true, estimate = motion.q - exact.q, global_error(kernel, motion)
    if estimate.is_resolved and np.abs(true).max() > 1e-9:
        assert effectivity(estimate.q_error, true) < 0.3


@pytest.mark.soak
@pytest.mark.parametrize("robot", ["four_bar", "worn_arm", "geared_arm", "balanced_arm", "puma560_elastic"])
def test_built_in_robots_are_off_as_estimated(robot: str) -> None:
    """Closed mechanisms, backlash, elastic gears, followers."""
    result = eomgen.simulate(robot, duration=0.5, global_error=True)
    closer = eomgen.simulate(robot, duration=0.5, rtol=1e-11)
    true, estimate = result.trajectory.q - closer.trajectory.q, result.global_error
    assert estimate.is_resolved or np.abs(true).max() < 1e-10  # m or rad: as large as round-off, by the processor
    if estimate.is_resolved:
        assert effectivity(estimate.q_error, true) < 0.3


@pytest.mark.soak
def test_robots_on_a_shaken_platform_are_off_as_estimated() -> None:
    """Prescribed motions, which have no error."""
    scenario = eomgen.load_scenario("shaken_platform")
    result = eomgen.run_scenario("shaken_arm", scenario, global_error=True)
    narrow = replace(scenario, integrator=replace(scenario.integrator, rtol=1e-11))
    true = result.trajectory.q - eomgen.run_scenario("shaken_arm", narrow).trajectory.q
    estimate = result.global_error
    assert estimate.is_resolved
    prescribed = [name in result.prescribed for name in estimate.coordinates]
    assert not estimate.q_error[:, prescribed].any()
    assert effectivity(estimate.q_error, true) < 0.3


@pytest.mark.soak
@pytest.mark.parametrize("method", ["auto", "rosenbrock", "scipy:Radau"])
def test_laws_with_states_are_off_as_estimated(method: str, built: Build) -> None:
    """Maxwell branches, hysteresis, bristles: their states have errors, too, and bend those of coordinates."""
    kernel = built(stateful_arm(), *ALL)
    q, v = np.full(kernel.n, 0.01), np.full(kernel.n, 0.05)
    motion = integrate(kernel, q, v, 0.2, output_step=1e-3, method=method, rtol=1e-4)
    exact = integrate(kernel, q, v, 0.2, output_step=1e-3, method="scipy:Radau", rtol=1e-12)
    estimate, true = global_error(kernel, motion), motion.q - exact.q
    assert estimate.is_resolved
    assert effectivity(estimate.q_error, true) < 0.3
    assert effectivity(estimate.z_error, motion.z - exact.z) < 0.3


@pytest.mark.soak
@pytest.mark.parametrize("method", ["tsit5", "rosenbrock"])
def test_a_tumbling_body_is_off_as_estimated(method: str, built: Build) -> None:
    """Through singular angles; compared where they are far."""
    kernel = built(tumbler(), *ALL)
    motion = integrate(kernel, Q0, V0, 6.0, method=method, rtol=1e-5, output_step=5e-3)
    exact = integrate(kernel, Q0, V0, 6.0, method="scipy:DOP853", rtol=1e-12, output_step=5e-3)
    far = np.abs(np.cos(exact.q[:, 4])) > 0.5
    assert not far.all()
    estimate, true = global_error(kernel, motion), motion.q - exact.q
    true[:, 3:] = (true[:, 3:] + np.pi) % (2.0 * np.pi) - np.pi
    assert estimate.is_resolved
    assert effectivity(estimate.q_error[far], true[far]) < 0.1
