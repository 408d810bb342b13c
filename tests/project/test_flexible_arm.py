"""The example of predictive control: its arm, its discrete steps and its QP, each beside something independent."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from tests.support.optional import needs

FOLDER = Path(__file__).parents[2] / "examples" / "flexible_arm"
MODULES = ("arm", "collocation", "figures", "plain", "prediction", "track", "whole")

Array = NDArray[np.float64]
Modules = Callable[[str], ModuleType]


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[Modules]:
    """Import modules of the example by their names, which are free again afterwards."""
    needs("casadi")
    monkeypatch.syspath_prepend(str(FOLDER))
    yield importlib.import_module
    for name in MODULES:
        sys.modules.pop(name, None)


def test_segments_have_the_published_numbers(module: Modules) -> None:
    """Of models/three_dof/two_segments and ten_segments there, which round to four digits and more."""
    arm = module("arm")
    for segments, stiffness, damping, inner in ((2, 25.33, 0.1135, 0.19675), (10, 126.67, 0.5674, 0.03935)):
        chain = arm.bodies(segments)
        assert len(chain) == 2 * (segments + 1)
        elastic = [body for body in chain if body.stiffness]
        assert len(elastic) == 2 * segments
        assert all(abs(body.stiffness - stiffness) < 0.005 for body in elastic)
        assert all(abs(body.damping - damping) < 5e-5 for body in elastic)
        assert chain[1].mass == pytest.approx(inner, rel=1e-12)
        assert sum(body.mass for body in chain) == pytest.approx(2 * 0.3935, rel=1e-12)
        assert sum(body.length for body in chain) == pytest.approx(1.0, rel=1e-12)
    assert arm.bodies(2)[0].inertia == pytest.approx((2.05275833e-05, 1.48587240e-04, 1.28125240e-04), rel=1e-8)
    assert arm.arm(0).joints[-1].name == "joint3"


def test_the_page_says_what_the_code_has(module: Modules) -> None:
    """Numbers between marks are written by figures.py; the others are those of the code."""
    figures, track, arm = module("figures"), module("track"), module("arm")
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    names = ("motion", "motions", "linearizations", "programs")
    rest = figures.filled(page, dict.fromkeys(names, ""))
    assert not any(line.startswith("|") and " ms" in line for line in rest.splitlines())
    wide, fine, coarse = arm.LENGTH, track.FINE, track.COARSE
    said = [
        *(f"{wide} m long", f"{1e3 * arm.HEIGHT:.0f} mm thick", f"chains of {track.SEGMENTS} segments"),
        *(
            f"plant of {track.PLANT}",
            f"`--coarse`: {figures.RUNS[-1][2]:.0f} s",
            f"{1e3 * coarse.sample:.1f} ms a sample",
        ),
        *(
            f"{fine.intervals} intervals over {fine.duration} s",
            *(f"{coarse.intervals} intervals over {coarse.duration:g} s", f"not settled after {track.MOST_STEPS}"),
        ),
        *(f"fine horizon is {1e3 * fine.sample:.0f} ms", f"less than {track.NEAR:.0e} N m".replace("e-0", "e-")),
    ]
    flat = " ".join(rest.split())
    assert [text for text in said if text not in flat] == []


def test_collocation_of_a_linear_system_is_the_pade_approximant(module: Modules) -> None:
    rng = np.random.default_rng(0)
    n, h, steps = 3, 0.05, 3
    stiffness, damping, select = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=(n, 2))

    def dynamics(q: Array, v: Array, u: Array) -> tuple[Array, tuple[Array, ...]]:
        slopes = (-stiffness, -damping, np.eye(n))
        return u - q @ stiffness.T - v @ damping.T, tuple(np.tile(slope, (len(q), 1, 1)) for slope in slopes)

    x, u = rng.normal(size=(4, 2 * n)), rng.normal(size=(4, 2))
    after, by_x, by_u = module("collocation").Collocation(dynamics, select, steps * h, steps)(x, u)
    rate = np.zeros((2 * n + 2, 2 * n + 2))  # of x and u, which stays
    rate[:n, n : 2 * n] = np.eye(n)
    rate[n : 2 * n] = np.hstack([-stiffness, -damping, select])
    one, z = np.eye(len(rate)), h * rate
    exact = np.linalg.matrix_power(np.linalg.solve(one - z / 2 + z @ z / 12, one + z / 2 + z @ z / 12), steps)
    assert np.allclose(after, np.hstack([x, u]) @ exact[: 2 * n].T, rtol=0.0, atol=1e-13)
    assert np.allclose(by_x, exact[: 2 * n, : 2 * n], rtol=0.0, atol=1e-13)
    assert np.allclose(by_u, exact[: 2 * n, 2 * n :], rtol=0.0, atol=1e-13)


def dense_solution(prediction: ModuleType, problem: Any, step: Any, goal: Any, x: Array, u: Array) -> Array:
    """Return the drives of the QP about x and u from NumPy alone: states eliminated, no bound met."""
    count, nx, m = problem.intervals, x.shape[1], u.shape[1]
    after, by_x, by_u = step(x[:-1], u)
    effect, offset = np.zeros((count + 1, nx, count * m)), np.zeros((count + 1, nx))
    for k in range(count):
        effect[k + 1] = by_x[k] @ effect[k]
        effect[k + 1][:, k * m : (k + 1) * m] += by_u[k]
        offset[k + 1] = by_x[k] @ offset[k] + after[k] - x[k + 1]
    h = problem.duration / count
    matrix, right = np.diag(np.tile(h * problem.drive, count)), np.ravel(-h * problem.drive * (u - goal.u))
    for k in range(count + 1):
        weight, tip = (h, problem.tip) if k < count else (1.0, problem.last_tip)
        states = weight * (problem.state if k < count else problem.last_state)
        pull = (weight if k < count else 1.0) * tip * (x[k, :3] - goal.tip)  # the tip is the first three states
        matrix += effect[k].T @ (states[:, None] * effect[k])
        right -= effect[k].T @ (states * (x[k] + offset[k] - goal.x))
        scale = (weight if k < count else 1.0) * tip
        matrix += scale * effect[k][:3].T @ effect[k][:3]
        right -= effect[k][:3].T @ (pull + scale * offset[k][:3])
    return np.asarray(u + np.linalg.solve(matrix, right).reshape(count, m))


def test_the_qp_is_that_of_dense_matrices(module: Modules) -> None:
    """Within its bounds; then with narrow ones, which hold."""
    prediction, rng = module("prediction"), np.random.default_rng(1)
    n, count, driven = 4, 6, np.array([1, 3])
    by_x, by_u = 0.5 * rng.normal(size=(2 * n, 2 * n)), rng.normal(size=(2 * n, 2))

    def step(x: Array, u: Array) -> tuple[Array, Array, Array]:
        return x @ by_x.T + u @ by_u.T + 0.1, np.tile(by_x, (len(x), 1, 1)), np.tile(by_u, (len(x), 1, 1))

    def tip(x: Array) -> tuple[Array, Array]:
        return x[..., :3], np.tile(np.eye(3, 2 * n), (*x.shape[:-1], 1, 1))

    weights = {name: rng.uniform(0.5, 2.0, 2 * n) for name in ("state", "last_state")}
    wide = {"effort": np.full(2, 50.0), "rate": np.full(2, 50.0), "excess": (1.0, 1e3), "driven": driven}
    problem = prediction.Problem(count, 1.2, drive=np.array([0.5, 1.5]), tip=3.0, last_tip=7.0, **weights, **wide)
    goal = prediction.Goal(rng.normal(size=2 * n), rng.normal(size=2), rng.normal(size=3))
    tracker = prediction.Tracker(problem, step, tip)
    start = rng.normal(size=2 * n)
    tracker.start(start, goal, 0)
    expected = dense_solution(prediction, problem, step, goal, tracker.x, tracker.u)
    for _ in range(2):  # the problem is linear: one step is enough, and a second changes nothing
        tracker.prepare(0.0)
        tracker.feedback(start)
        assert np.allclose(tracker.u, expected, rtol=0.0, atol=1e-4)
        assert np.allclose(tracker.x[1:], step(tracker.x[:-1], tracker.u)[0], rtol=0.0, atol=1e-4)

    narrow = {**wide, "effort": np.full(2, 0.3), "rate": np.full(2, 0.8), "excess": (1e3, 1e3)}
    bounded = prediction.Problem(count, 1.2, drive=np.array([0.5, 1.5]), tip=3.0, last_tip=7.0, **weights, **narrow)
    tracker = prediction.Tracker(bounded, step, tip)
    tracker.start(start, goal, 1)
    assert np.abs(expected).max() > 0.3
    assert np.abs(tracker.u).max() < 0.3 + 1e-4


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_the_arm_is_that_of_casadi_alone(module: Modules) -> None:
    arm, plain = module("arm"), module("plain")
    kernel = eomgen.build(arm.arm(2), kernels=("forward_dynamics", "forward_dynamics_jacobian"))
    q, v, u = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 5, kernel.n))
    a, slopes = plain.PlainDynamics(2)(q, v, u)
    assert np.abs(a - kernel.forward_dynamics(q, v, u)).max() < 1e-10 * np.abs(a).max()
    for slope, expected in zip(slopes, kernel.forward_dynamics_jacobian(q, v, u), strict=True):
        assert np.abs(slope - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_methods_of_intervals_agree(module: Modules) -> None:
    """Gauss's points with CasADi's integrator of the same order, and with steps in C that are short enough."""
    track = module("track")
    model, horizon = track.Model(track.SEGMENTS), track.Horizon(4, 0.02, 1)
    x, u = np.tile(model.at_rest(track.START).x, (4, 1)), np.linspace(-1.0, 1.0, 12).reshape(4, 3)
    results = track.intervals("gauss", model, horizon)(x, u)
    again = track.PlainIntegrator(track.SEGMENTS, model.select, horizon.sample, 1)(x, u)
    for result, other in zip(results, again, strict=True):
        assert np.abs(result - other).max() < 1e-6 * np.abs(other).max()
    fine = track.Horizon(4, 0.02, 16)
    exact = track.intervals("gauss", model, fine)(x, u)
    for result, other in zip(track.intervals("rosenbrock", model, fine)(x, u), exact, strict=True):
        assert np.abs(result - other).max() < 1e-4 * np.abs(other).max()


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_fatrop_finds_what_steps_with_hpipm_find(module: Modules) -> None:
    track = module("track")
    found = track.solved(track.Model(track.SEGMENTS), track.Horizon(20, 0.2, 1), "implicit")
    assert 0 < found.iterations < 100
    assert 0 < found.steps < track.MOST_STEPS
    assert found.has_settled
    assert found.apart < 1e-2
    assert found.cost_of_steps == pytest.approx(found.cost, rel=1e-4)


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize("method", ["gauss", "implicit"])
def test_the_tip_goes_to_its_goal(method: str, module: Modules) -> None:
    """With ten segments in the plant and two in the controller, from noisy measurements."""
    track = module("track")
    model, plant = track.Model(track.SEGMENTS), track.Model(track.PLANT, "adaptive_rollout")
    by = track.intervals(method, model, track.FINE)
    run = track.closed_loop(model, plant, track.FINE, 2.0, by)
    assert run.distances[0] > 1.2
    assert run.distances[-50:].max() < 0.02
    assert np.all(np.abs(run.drives) <= [20.0, 10.0, 10.0])
