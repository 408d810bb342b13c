"""Rollouts of closed mechanisms in C: closed after every step, the same alone, in batches and by threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.integration import integrate
from tests.support.builds import Build
from tests.support.linkages import KERNELS, bricard, threefold

pytestmark = pytest.mark.usefixtures("unoptimised")


@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_batches_and_threads_do_as_single_ones(method: str, built: Build) -> None:
    kernel = built(eomgen.load_robot("four_bar"), *KERNELS, "rollout")
    rng = np.random.default_rng(3)
    angles = rng.uniform(-3.0, 3.0, 37)
    guesses = np.column_stack([angles, -0.5 - 0.0 * angles, 1.4 + 0.0 * angles])
    q = kernel.close(guesses, ["joint1.gamma"])
    v = kernel.close_rates(q, rng.normal(size=q.shape))
    u = np.array([3.0, 0.0, 0.0])
    qs, vs = kernel.rollout(q, v, u, 1e-3, 50, method=method)
    assert np.abs(kernel.constraint(qs)).max() <= 1e-10
    assert np.abs(np.einsum("ktmn,ktn->ktm", kernel.constraint_jacobian(qs), vs)).max() <= 1e-9
    for states in (kernel.with_threads(2).rollout(q, v, u, 1e-3, 50, method=method), (qs, vs)):
        assert np.array_equal(states[0], qs)
        assert np.array_equal(states[1], vs)
    for i in (0, 7, 36):
        alone = kernel.rollout(q[i], v[i], u, 1e-3, 50, method=method)
        assert np.array_equal(alone[0], qs[i])
        assert np.array_equal(alone[1], vs[i])


def test_energy_of_a_driven_mechanism(built: Build) -> None:
    """A constant torque, as long as it takes to a fast crank: 2 s by steps of 10 us."""
    kernel = built(eomgen.load_robot("four_bar"), *KERNELS, "rollout")
    q = kernel.close([1.0, -0.5, 1.0])
    qs, vs = kernel.rollout(q, np.zeros(3), [20.0, 0.0, 0.0], 1e-5, 200_000, every=1000)
    energy, turned = kernel.energy(qs, vs).sum(axis=1), qs[:, 0] - q[0]
    assert turned[-1] > 900.0
    assert np.abs(energy - energy[0] - 20.0 * turned).max() <= 1e-5 * 20.0 * turned[-1]


def test_bricards_mechanism_keeps_its_energy(built: Build) -> None:
    kernel = built(bricard(), *KERNELS, "rollout")
    signs = [np.array([1, s, 1, s, 1]) * threefold(1.8) for s in (1, -1)]
    q = kernel.close(min(signs, key=lambda x: np.abs(kernel.constraint(x)).max()))
    qs, vs = kernel.rollout(q, np.zeros(5), np.zeros(5), 2e-4, 50_000, every=50)
    energy = kernel.energy(qs, vs)
    assert np.ptp(energy.sum(axis=1)) <= 1e-8 * energy[:, 0].max()
    assert np.abs(kernel.constraint(qs)).max() <= 1e-10


def test_a_first_step_from_an_open_state_does_not_stop_the_mechanism(built: Build) -> None:
    """Open by a tenth of a millimetre, Bennett's redundant rows would block what it is free to do."""
    robot = eomgen.load_robot("bennett")
    kernel = built(robot, *KERNELS, "rollout")
    home = np.array([robot.home[name] for name in kernel.coordinates])
    v = kernel.close_rates(home, [2.0, 0.0, 0.0], ["joint1.gamma"])
    qs, vs = kernel.rollout(home + [0.0, 1e-4, 0.0], v, np.zeros(3), 1e-7, 1)
    assert np.abs(kernel.constraint(qs[1])).max() <= 1e-10
    assert np.abs(vs[1] - v).max() <= 1e-2


def test_rollouts_and_error_control_agree(built: Build) -> None:
    robot = replace(eomgen.load_robot("gough"), name="falling_platform")
    kernel = built(robot, *KERNELS, "rollout")
    q = np.array([robot.home.get(name, 0.0) for name in kernel.coordinates])
    q = kernel.close(q, [name for name in kernel.coordinates if name.startswith("leg")])
    qs, vs = kernel.rollout(q, np.zeros(24), np.zeros(24), 5e-4, 200)
    motion = integrate(kernel, q, np.zeros(24), 0.1, rtol=1e-9, output_step=0.1)
    assert np.abs(motion.q[-1] - qs[-1]).max() <= 1e-8
    assert np.abs(motion.v[-1] - vs[-1]).max() <= 1e-7
