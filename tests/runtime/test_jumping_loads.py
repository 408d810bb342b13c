"""Loads that jump, or whose rates do, between samples: steps with error control end there, derivatives' too."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.errors import InputError
from eomgen.robot.value import Friction
from eomgen.runtime.stepping.input_signals import (
    DriveData,
    Gains,
    InputSignals,
    LinkWrench,
    ModelDrive,
    Signal,
    Track,
    Waves,
    jump_times,
)
from eomgen.runtime.stepping.options import ADAPTIVE as METHODS
from tests.runtime.test_load_gradients import ALL, numbers, put
from tests.runtime.test_stiff_gradients import last, slider
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, some_prescribed
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

T = 0.3
TIGHT = {"tsit5": 1e-11, "rosenbrock": 1e-10}


def bent(rng: np.random.Generator, columns: int, size: float, degree: int = 1) -> Signal:
    """Straight lines between samples at odd times; with a degree of 0, or of 3, values jump there."""
    times = np.concatenate([[-0.1], np.sort(rng.uniform(0.0, T, 4)), [0.8 * T + 0.1 * T * rng.random(), 0.6]])
    times = np.sort(times)
    if degree == 1:
        return Signal.through(times, size * rng.uniform(-1.0, 1.0, (times.size, columns)))
    shape = (times.size - 1, degree + 1, columns)
    return Signal(times, size * rng.uniform(-1.0, 1.0, shape) / T ** np.arange(degree + 1)[:, None])


def loads_of(kernel: eomgen.Kernel, seed: int, *, jumps: bool = True) -> InputSignals:
    """Forces, a program that gains and a model follow, wrenches and prescribed motions, all with knots of their own."""
    rng, n = np.random.default_rng(seed), kernel.n
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    free = np.setdiff1d(np.arange(n), given)
    gains = Gains(rng.uniform(20.0, 40.0, free.size), rng.uniform(1.0, 2.0, free.size))
    column, follows = np.full(n, -1), np.full(n, -1)
    column[free], follows[given] = np.arange(free.size), np.arange(len(given))
    model = ModelDrive(kernel.calls, np.arange(n), np.ones(n), column, follows, 12.0)
    torque = Track(bent(rng, 1, 5.0, 0 if jumps else 1), free[:1])
    drive = DriveData(torque, Track(bent(rng, free.size, 0.2), free), None, gains, model)
    arm, link = np.array([0.1, -0.05, 0.2]), len(kernel.links) - 1
    pulls = [
        LinkWrench(link, bent(rng, 6, 3.0)),
        LinkWrench(0, bent(rng, 6, 3.0, 3), arm, t0=0.07, t1=0.21, turns=True),
    ]
    waves = None
    if given:
        track = Track(bent(rng, 1, 0.05), np.array([0]))
        waves = Waves(np.tile([0.1, 8.0, 0.3, 0.05], (len(given), 1)), [track])
    return InputSignals(drive, pulls, waves)


def robot_of(kind: str) -> Any:
    if kind == "one_link":
        return eomgen.load_robot("one_link")
    robot = random_robot(3, joints=(1, 2), types=("revolute", "prismatic"))
    return some_prescribed(robot, 3)


@pytest.mark.soak
@pytest.mark.parametrize("method", TIGHT)
@pytest.mark.parametrize("kind", soaked(("one_link", "prescribed"), ("prescribed",)))
def test_gradients_are_those_of_the_motion(kind: str, method: str, built: Build) -> None:
    """By all numbers of loads, against differences of rollouts whose steps are their own."""
    compare(built(robot_of(kind), *ALL), method, 5)


@pytest.mark.soak
@pytest.mark.parametrize("method", TIGHT)
@pytest.mark.parametrize("seed", range(8))
def test_so_they_are_of_random_robots(seed: int, method: str, built: Build) -> None:
    robot = random_robot(7100 + seed, joints=(1, 3), types=("revolute", "prismatic"))
    compare(built(some_prescribed(robot, seed) if seed % 2 else robot, *ALL), method, seed)


def compare(kernel: eomgen.Kernel, method: str, seed: int) -> None:
    """Gradients of a rollout under loads that jump against differences, and sensitivities against gradients."""
    rng, loads = np.random.default_rng(11), loads_of(kernel, seed)
    q, v = rng.uniform(-0.3, 0.3, (2, kernel.n))
    weights = rng.uniform(-1.0, 1.0, (2, 3, kernel.n))
    how: dict[str, Any] = {"method": method, "duration": T, "samples": 2, "rtol": TIGHT[method]}

    def loss(t: Array, x: Array, rate: Array) -> tuple[float, Array, Array]:
        return float((weights[0] * x + weights[1] * rate).sum()), weights[0], weights[1]

    value, found = kernel.rollout_gradient(q, v, loss=loss, loads=loads, **how)
    for name, by in found["loads"].items():
        x = np.asarray(numbers(loads, name), dtype=float)
        direction, h = rng.uniform(-1.0, 1.0, x.shape) * np.maximum(np.abs(x), 1e-3), 1e-3
        ends = []
        for s in (2.0, 1.0, -1.0, -2.0):
            moved = put(loads, name, x + s * h * direction if x.ndim else float(x + s * h * direction))
            ends.append(loss(np.zeros(3), *kernel.rollout(q, v, loads=moved, **how))[0])
        wanted = (8.0 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12.0 * h)
        assert (by * direction).sum() == pytest.approx(wanted, rel=1e-6, abs=1e-6 * max(abs(value), 1e-2)), name
    along = rng.uniform(-1.0, 1.0, (1, kernel.n))
    _, (dq, dv) = kernel.rollout_sensitivity(q, v, loads=loads, along={"v": along}, **how)
    assert (weights[0] * dq[:, 0] + weights[1] * dv[:, 0]).sum() == pytest.approx(
        (found["v"] * along[0]).sum(), rel=1e-9
    )


@pytest.mark.parametrize("method", METHODS)
def test_motions_are_scipys(method: str, built: Build) -> None:
    """A mass under a force that jumps, against integrations from jump to jump; few steps are tried in vain."""
    kernel = built(slider(damping=3.0, stiffness=50.0), *ALL, "radau_rollout", "generalized_force")
    signal = bent(np.random.default_rng(3), 1, 20.0, 0)
    loads = InputSignals(DriveData(torque=Track(signal, np.array([0]))))
    inside = [t for t in jump_times(loads) if 0.0 < t < T]
    y, times = np.array([0.1, -0.2]), np.array([0.0, *inside, T])
    for begin, end in itertools.pairwise(times):
        force = signal.coefficients[np.searchsorted(signal.knots, 0.5 * (begin + end)) - 1, 0, 0]

        def rate(_: float, x: Array, force: float = force) -> list[float]:
            return [x[1], (force - 50.0 * x[0] - 3.0 * x[1]) / 2.0]

        y = solve_ivp(rate, (begin, end), y, rtol=1e-12, atol=1e-14).y[:, -1]
    found = kernel.rollout([0.1], [-0.2], loads=loads, method=method, duration=T, samples=1, rtol=1e-9, works=True)
    assert [float(x[-1, 0]) for x in found] == pytest.approx(y, rel=1e-7)
    assert found.rejected <= 2 * times.size
    assert found.works[-1, 0] - found.works[-1, 3] == pytest.approx(
        y[1] ** 2 - 0.04 + 25.0 * (y[0] ** 2 - 0.01), rel=1e-6
    )


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_every_lane_has_jumps_of_its_own(dtype: str, method: str, built: Build) -> None:
    """Many states, each with other knots: the bits, works and steps of a state alone."""
    kernel = built(robot_of("prescribed"), *ALL, "radau_rollout", "generalized_force", dtype=dtype)
    model = kernel if dtype == "float64" else built(robot_of("prescribed"), *ALL)
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-0.3, 0.3, (2, 11, kernel.n)).astype(dtype)
    loads = [loads_of(model, seed) for seed in range(11)]
    loads[4] = InputSignals()
    how: dict[str, Any] = {"method": method, "duration": T, "samples": 4, "rtol": 1e-4, "works": True}
    whole = kernel.rollout(q, v, loads=loads, **how)
    assert np.ptp(whole.steps) > 0
    for i in range(11):
        alone = kernel.rollout(q[i], v[i], loads=loads[i], **how)
        assert alone.steps == whole.steps[i]
        assert np.array_equal(alone.works, whole.works[i])
        assert all(np.array_equal(x[i], y) for x, y in zip(whole, alone, strict=True))


@pytest.mark.soak
def test_mechanisms(built: Build) -> None:
    """Loops are closed where steps end: gains whose program bends, against differences."""
    beside = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
    names = [name for name in ALL if not name.startswith("inverse_dynamics")]
    kernel = built(eomgen.load_robot("four_bar"), *names, *beside)
    rng = np.random.default_rng(1)
    gains = Gains(np.array([30.0]), np.array([2.0]))
    loads = InputSignals(DriveData(program=Track(bent(rng, 1, 0.3), np.array([0])), gains=gains))
    q = kernel.assemble([0.5, 0.2, 1.2])
    v = kernel.project_velocity(q, [1.0, 0.0, 0.0])
    how: dict[str, Any] = {"method": "tsit5", "duration": T, "samples": 2, "rtol": 1e-11}
    _, found = kernel.rollout_gradient(q, v, loss=last, loads=loads, **how)
    x = numbers(loads, "drive.program")
    direction, h = rng.uniform(-1.0, 1.0, x.shape), 1e-4
    ends = [kernel.rollout(q, v, loads=put(loads, "drive.program", x + s * h * direction), **how)[0] for s in (1, -1)]
    wanted = float((ends[0][-1] - ends[1][-1]).sum()) / (2.0 * h)
    assert (found["loads"]["drive.program"] * direction).sum() == pytest.approx(wanted, rel=1e-6)


def test_times_at_which_loads_jump() -> None:
    """Values, rates and accelerations, on both sides of a knot; what rests outside; windows; profiles."""
    place, rng = np.array([0]), np.random.default_rng(0)

    def times(signal: Signal, **how: Any) -> list[float]:
        return jump_times(InputSignals(DriveData(torque=Track(signal, place))), **how).tolist()

    assert times(Signal.constant([1.0])) == []
    assert times(Signal.constant([1.0]), every=True) == []
    assert times(Signal.through([0.0, 1.0, 2.0, 3.0], [[0.0], [1.0], [2.0], [2.0]])) == [0.0, 2.0]
    assert times(Signal.through([0.0, 1.0, 2.0, 3.0], [[0.0], [1.0], [2.0], [2.0]]), every=True) == [0.0, 1.0, 2.0, 3.0]
    steps = Signal(np.array([0.0, 1.0, 2.0]), np.array([[[1.0]], [[1.0 + 1e-6]]]))
    assert times(steps) == [1.0]
    whole = np.polynomial.Polynomial(rng.uniform(-1.0, 1.0, 4))  # a cubic in three pieces
    knots = np.array([0.0, 0.3, 0.7, 1.1])
    pieces = [[whole.deriv(i)(x) / [1, 1, 2, 6][i] if i else whole(x) for i in range(4)] for x in knots[:-1]]
    smooth = Signal(knots, np.array(pieces)[:, :, np.newaxis])
    assert times(smooth) == [0.0, 1.1]
    profile = Signal(np.array([0.0, 2.0]), np.array([[[0.0], [0.0], [1.0]]]))  # t^2
    found = times(replace(Signal.through([0.0, 1.0, 4.0, 9.0], [[0.0], [1.0], [0.0], [0.0]]), profile=profile))
    assert found == pytest.approx([0.0, 1.0, 2.0], abs=1e-12)
    there_and_back = Signal(np.array([0.0, 2.0]), np.array([[[0.0], [2.0], [-1.0]]]))  # to 1 and back
    found = times(replace(Signal.through([-1.0, 0.5, 3.0], [[0.0], [1.0], [0.0]]), profile=there_and_back))
    assert found == pytest.approx([0.0, 1.0 - np.sqrt(0.5), 1.0 + np.sqrt(0.5), 2.0], abs=1e-12)
    wrench = LinkWrench(0, Signal.constant(np.ones(6)), t0=0.25, t1=0.5)
    assert jump_times(InputSignals(wrenches=[wrench], first=0.1)).tolist() == [0.1, 0.25, 0.5]


def test_a_path_over_a_profile(built: Build) -> None:
    """Knots of a path come where its profile leads to them."""
    kernel = built(slider(damping=3.0), *ALL)
    profile = Signal(np.array([0.0, 1.0]), np.array([[[0.0], [1.0], [3.0]]]))
    path = replace(Signal.through([0.0, 0.07, 0.2, 0.5, 2.0], [[0.0], [0.1], [-0.1], [0.3], [0.0]]), profile=profile)
    gains = Gains(np.array([400.0]), np.array([20.0]))
    loads = InputSignals(DriveData(program=Track(path, np.array([0])), gains=gains))
    how: dict[str, Any] = {"method": "tsit5", "duration": T, "samples": 1, "rtol": 1e-11}
    _, found = kernel.rollout_gradient([0.1], [0.0], loss=last, loads=loads, **how)
    x, rng = path.coefficients, np.random.default_rng(1)
    direction = rng.uniform(-1.0, 1.0, x.shape)
    ends = [
        kernel.rollout([0.1], [0.0], loads=put(loads, "drive.program", x + s * 1e-4 * direction), **how)[0][-1, 0]
        for s in (1, -1)
    ]
    by = found["loads"]["drive.program"]
    assert (by * direction).sum() == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-6)


def test_stiff_robots_are_refused_under_loads(built: Build) -> None:
    """A mass that friction holds against a force that jumps."""
    kernel = built(slider(friction=Friction(coulomb=6.0)), *ALL)
    loads = InputSignals(DriveData(torque=Track(bent(np.random.default_rng(2), 1, 1.0, 0), np.array([0]))))
    with pytest.raises(InputError, match="take rosenbrock"):
        kernel.rollout_gradient([0.0], [0.0], loss=last, loads=loads, method="tsit5", duration=1e-4, samples=1)
