"""Closed mechanisms step by step in C: batches, threads, single precision, energy, and what is said of failures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import IntegrationStopped, LoopError
from eomgen.integration import integrate
from eomgen.robot.model import build_model
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.linkages import KERNELS as CLOSING
from tests.support.linkages import bricard, threefold
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import Array, seeds

pytestmark = pytest.mark.usefixtures("unoptimised")

KERNELS = ("forward_dynamics", "rollout", "constraint", "energy")


def about(q: Array, v: Array, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """A state with ever other rates: those of one motion, faster and slower."""
    return np.stack([q] * count), v * rng.uniform(-1.0, 1.0, (count, 1))


@pytest.mark.parametrize("number", seeds(3, 1, 60))
def test_batches_are_single_states_to_the_bit(number: int, built: Build, figures: Figures) -> None:
    m = mechanism(number)
    kernel, rng = built(m.robot, *KERNELS), np.random.default_rng(number)
    q, v = about(m.q, m.v * 0.1, rng, 11)
    several = kernel.forward_dynamics(q, v, m.u)
    assert np.array_equal(several, [kernel.forward_dynamics(q[i], v[i], m.u) for i in range(11)])
    for method in ("rk4", "implicit"):
        found = kernel.rollout(q, v, m.u, 1e-5, 20, method=method, every=10)
        one = [kernel.rollout(q[i], v[i], m.u, 1e-5, 20, method=method, every=10) for i in range(11)]
        assert np.array_equal(found, np.swapaxes(one, 0, 1))
        figures.at_most("gap after steps", float(np.abs(kernel.functions.constraint(found[0])).max()), 1e-10)
        kernel.threads = 2
        assert np.array_equal(kernel.rollout(q, v, m.u, 1e-5, 20, method=method, every=10), found)
        kernel.threads = 1


@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.soak)])
@pytest.mark.parametrize("number", seeds(2, 1, 30))
@pytest.mark.soak
def test_steps_of_radau(number: int, dtype: str, built: Build) -> None:
    """They are closed, go where the explicit ones go, and have the same bits in a batch."""
    m = mechanism(number)
    kernel = built(m.robot, *KERNELS, "adaptive_rollout", "radau_rollout", dtype=dtype)
    q, v = (x.astype(dtype) for x in about(m.q, m.v * 0.1, np.random.default_rng(number), 5))
    u, rtol = m.u.astype(dtype), 1e-9 if dtype == "float64" else 1e-4
    how: dict[str, Any] = {"duration": 2e-3, "samples": 3, "rtol": rtol}
    found = kernel.rollout(q, v, u, method="radau", **how)
    for i in range(5):
        alone = kernel.rollout(q[i], v[i], u, method="radau", **how)
        assert all(np.array_equal(x[i], y) for x, y in zip(found, alone, strict=True))
    other = kernel.rollout(q, v, u, method="tsit5", **how)
    for x, y in zip(found, other, strict=True):
        assert np.abs(x - y).max() <= 100.0 * rtol * max(1.0, float(np.abs(y).max()))
    assert np.abs(kernel.functions.constraint(found[0])).max() <= (1e-10 if dtype == "float64" else 1e-4)


@pytest.mark.soak
@pytest.mark.parametrize("number", seeds(5, 1, 60))
def test_single_precision(number: int, built: Build, figures: Figures) -> None:
    """Accelerations of float32 at rest, as near as the mechanism's pose lets a rounded state be; steps stay closed."""
    m = mechanism(number)
    kernel, double = built(m.robot, "forward_dynamics", "rollout", dtype="float32"), built(m.robot, *KERNELS)
    q, v, u = m.q.astype(np.float32), np.zeros_like(m.v, np.float32), m.u.astype(np.float32)
    expected = double.forward_dynamics(m.q, 0.0 * m.v, m.u)
    off = float(np.abs(kernel.forward_dynamics(q, v, u) - expected).max() / np.abs(expected).max())
    figures.at_most("accelerations of float32", off, 0.05)
    moved = kernel.rollout(q, v, u, 1e-5, 5)[0]
    figures.at_most(
        "gap after steps of float32", float(np.abs(double.functions.constraint(moved[1:].astype(float))).max()), 1e-5
    )


@pytest.mark.parametrize(("steps", "angle", "within"), [(10_000, 0.5, 1e-8), (200_000, 900.0, 1e-5)])
def test_energy_of_a_driven_four_bar(steps: int, angle: float, within: float, built: Build) -> None:
    """A crank under 20 N m, for a tenth of a second and until it is fast: the work is what the energy grows by."""
    robot = eomgen.load_robot("four_bar")
    kernel, q = built(robot, *KERNELS), np.array(build_model(robot).home)
    qs, vs = kernel.rollout(q, 0 * q, [20.0, 0.0, 0.0], 1e-5, steps, every=steps // 100)
    grown = kernel.energy(qs, vs).sum(axis=1) - kernel.energy(q, 0 * q).sum()
    turned = qs[:, 0] - q[0]
    assert turned[-1] > angle
    assert np.abs(grown - 20.0 * turned).max() <= within * 20.0 * turned[-1]
    assert np.abs(kernel.functions.constraint(qs)).max() <= 1e-13


def test_a_state_that_is_open_is_closed_by_the_first_step_or_named(built: Build) -> None:
    robot = eomgen.load_robot("four_bar")
    kernel, q = built(robot, *KERNELS), np.array(build_model(robot).home)
    off = q + [0.0, 1e-3, 0.0]
    with pytest.raises(LoopError, match=r"loop joint4 is open: joint4\.[xy] is left with \S+ m") as raised:
        kernel.forward_dynamics(off, 0 * q, 0 * q)
    assert raised.value.loop == "joint4"
    assert 1e-5 < raised.value.gap < 1e-3
    with pytest.raises(LoopError, match=r"is opening in state 1: joint4\.[xy] is left with \S+ m/s"):
        kernel.forward_dynamics(q, np.array([0 * q, [0.1, 0.0, 0.0]]), 0 * q)
    moved = kernel.rollout(off, 0 * q, 0 * q, 1e-4, 1)[0][1]
    assert np.abs(kernel.functions.constraint(moved)).max() <= 1e-13
    assert np.abs(kernel.rollout(off, 0 * q, 0 * q, 1e-4, 1, method="implicit")[0][1] - moved).max() < 1e-4
    with pytest.raises(IntegrationStopped, match="loop joint4 does not stay closed at joint4"):
        kernel.rollout(q, 0 * q, [1e9, 0.0, 0.0], 1e-2, 50)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["bricard", "bennett"])
def test_energy_of_redundant_mechanisms(name: str, built: Build) -> None:
    """Five constraints of which four hold, for ten seconds; rows in space that answer to the gaps inside a step."""
    if name == "bricard":
        kernel, q, how = built(bricard(), *KERNELS), threefold(np.pi / 2), (5e-4, 20_000)
    else:
        robot = eomgen.load_robot(name)
        kernel, q, how = built(robot, *KERNELS), np.array(build_model(robot).home), (1e-3, 2000)
    qs, vs = kernel.rollout(q, 0 * q, 0 * q, *how, every=how[1] // 100)
    energy = kernel.energy(qs, vs)
    assert np.ptp(energy[:, 0]) > (10.0 if name == "bricard" else 0.0)
    assert np.abs(energy.sum(axis=1) - energy[0].sum()).max() <= 1e-8 * np.ptp(energy[:, 0])
    assert np.abs(kernel.functions.constraint(qs)).max() <= (1e-13 if name == "bricard" else 1e-10)


def test_a_first_step_from_an_open_state_does_not_stop_the_mechanism(built: Build) -> None:
    """Open by a tenth of a millimetre, Bennett's redundant rows would block what it is free to do."""
    robot = eomgen.load_robot("bennett")
    kernel = built(robot, *CLOSING, "rollout")
    home = np.array([robot.home[name] for name in kernel.coordinates])
    v = kernel.project_velocity(home, [2.0, 0.0, 0.0], ["joint1.gamma"])
    qs, vs = kernel.rollout(home + [0.0, 1e-4, 0.0], v, np.zeros(3), 1e-7, 1)
    assert np.abs(kernel.functions.constraint(qs[1])).max() <= 1e-10
    assert np.abs(vs[1] - v).max() <= 1e-2


@pytest.mark.soak
def test_rollouts_and_error_control_agree(built: Build) -> None:
    robot = replace(eomgen.load_robot("gough"), name="falling_platform")
    kernel = built(robot, *CLOSING, "rollout")
    q = np.array([robot.home.get(name, 0.0) for name in kernel.coordinates])
    q = kernel.assemble(q, [name for name in kernel.coordinates if name.startswith("leg")])
    qs, vs = kernel.rollout(q, np.zeros(24), np.zeros(24), 5e-4, 200)
    motion = integrate(kernel, q, np.zeros(24), 0.1, rtol=1e-9, output_step=0.1)
    assert np.abs(motion.q[-1] - qs[-1]).max() <= 1e-8
    assert np.abs(motion.v[-1] - vs[-1]).max() <= 1e-7
