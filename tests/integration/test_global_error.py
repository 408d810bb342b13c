"""Estimated global errors against errors that are known: closed forms, conserved energy, far closer integrations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import eomgen
from eomgen import InputError, IntegrationError
from eomgen.integration.accuracy import error_transport
from eomgen.integration.accuracy.error_transport import GlobalError, global_error
from eomgen.integration.solve import integrate
from eomgen.integration.trajectory import Trajectory
from tests.integration.test_solve import closed_form
from tests.integration.test_turning import Q0, V0, tumbler
from tests.support.bristles import remembering_arm
from tests.support.builds import Build
from tests.support.pendulums import pendulum
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused
from tests.support.swinging import NEEDED, elastic_arm, oscillator

pytestmark = pytest.mark.quick

ALL = (*NEEDED, "adaptive_rollout", "radau_rollout")
IN_PYTHON: dict[str, dict[str, float]] = {"DOP853": {"rtol": 1e-5}, "Radau": {"rtol": 1e-5}, "rk4": {"step": 5e-3}}
OTHERS: dict[str, dict[str, float]] = {"RK45": {"rtol": 1e-5}, "BDF": {"rtol": 1e-5}, "LSODA": {"rtol": 1e-5}}
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
    motion = integrate(kernel, [2.0 - np.pi / 2.0], [0.0], 3.0, method="DOP853", rtol=1e-5, output_step=0.02)
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
    motion = integrate(kernel, q, v, 0.4, method="DOP853", rtol=1e-4, output_step=4e-3)
    estimated, true = drift(kernel, motion, global_error(kernel, motion))
    assert np.abs(true).max() > 1e-6
    assert effectivity(estimated, true) < 0.05


def test_samples_that_nobody_integrated_are_found_out(built: Build) -> None:
    """A sample that is moved is off by that, and the others are as they were."""
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 0.5, method="DOP853", rtol=1e-10, output_step=1e-2)
    q = motion.q.copy()
    q[20] += 1e-5
    estimate = global_error(kernel, replace(motion, q=q))
    assert estimate.q_error[20, 0] == pytest.approx(1e-5, rel=1e-3)
    assert np.abs(np.delete(estimate.q_error, 20)).max() < 1e-8


def test_what_is_not_followed_closely_is_said(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples 1.3 periods apart need more than two parts between them."""
    kernel = built(oscillator(damping=None), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 4.0, method="DOP853", rtol=1e-6, output_step=0.4)
    true = motion.q[:, 0] - 0.1 * np.cos(20.0 * motion.t) - 0.025 * np.sin(20.0 * motion.t)
    estimate = global_error(kernel, motion)
    assert estimate.is_resolved
    assert effectivity(estimate.q_error[:, 0], true) < 1e-2
    monkeypatch.setattr(error_transport, "FINEST", 2)
    rough = global_error(kernel, motion)
    assert not rough.is_resolved
    assert "not reliable" in rough.line()


def test_results_have_the_tools_error_and_keep_it(tmp_path: Path) -> None:
    options: dict[str, Any] = {"duration": 0.2, "output_step": 4e-3}
    result = eomgen.simulate("one_link", rtol=1e-4, global_error=True, **options)
    closer = eomgen.simulate("one_link", rtol=1e-11, **options)
    true, estimate = result.pose[:, :3, 3] - closer.pose[:, :3, 3], result.global_error
    assert estimate is not None
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
    assert kept.global_error is not None
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
    exact = integrate(kernel, q, v, 0.2, method="Radau", rtol=1e-12, output_step=2e-3)
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
    assert estimate is not None
    assert estimate.is_resolved
    assert effectivity(estimate.q_error, true) < 0.3


@pytest.mark.soak
def test_robots_on_a_shaken_platform_are_off_as_estimated() -> None:
    """Prescribed motions, which have no error."""
    scenario = eomgen.load_scenario("shaken_platform")
    result = eomgen.run_scenario("shaken_arm", scenario, global_error=True)
    narrow = replace(scenario, integrator=replace(scenario.integrator, rtol=1e-11))
    true = result.trajectory.q - eomgen.run_scenario("shaken_arm", narrow).trajectory.q
    estimate = result.global_error
    assert estimate is not None
    assert estimate.is_resolved
    prescribed = [name in result.prescribed for name in estimate.coordinates]
    assert not estimate.q_error[:, prescribed].any()
    assert effectivity(estimate.q_error, true) < 0.3


@pytest.mark.soak
@pytest.mark.parametrize("method", ["auto", "rosenbrock", "Radau"])
def test_laws_with_states_are_off_as_estimated(method: str, built: Build) -> None:
    """Maxwell branches, hysteresis, bristles: their states have errors, too, and bend those of coordinates."""
    kernel = built(remembering_arm(), *ALL)
    q, v = np.full(kernel.n, 0.01), np.full(kernel.n, 0.05)
    motion = integrate(kernel, q, v, 0.2, output_step=1e-3, method=method, rtol=1e-4)
    exact = integrate(kernel, q, v, 0.2, output_step=1e-3, method="Radau", rtol=1e-12)
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
    exact = integrate(kernel, Q0, V0, 6.0, method="DOP853", rtol=1e-12, output_step=5e-3)
    far = np.abs(np.cos(exact.q[:, 4])) > 0.5
    assert not far.all()
    estimate, true = global_error(kernel, motion), motion.q - exact.q
    true[:, 3:] = (true[:, 3:] + np.pi) % (2.0 * np.pi) - np.pi
    assert estimate.is_resolved
    assert effectivity(estimate.q_error[far], true[far]) < 0.1
