"""Rollouts of closed mechanisms in C: energy over long motions, open states at the beginning, other integrators."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.integration import integrate
from tests.support.builds import Build
from tests.support.linkages import KERNELS, bricard, threefold

pytestmark = pytest.mark.usefixtures("unoptimised")


def test_energy_of_a_driven_mechanism(built: Build) -> None:
    """A constant torque, as long as it takes to a fast crank: 2 s by steps of 10 us."""
    kernel = built(eomgen.load_robot("four_bar"), *KERNELS, "rollout")
    q = kernel.assemble([1.0, -0.5, 1.0])
    qs, vs = kernel.rollout(q, np.zeros(3), [20.0, 0.0, 0.0], 1e-5, 200_000, every=1000)
    energy, turned = kernel.energy(qs, vs).sum(axis=1), qs[:, 0] - q[0]
    assert turned[-1] > 900.0
    assert np.abs(energy - energy[0] - 20.0 * turned).max() <= 1e-5 * 20.0 * turned[-1]


@pytest.mark.soak
def test_bricards_mechanism_keeps_its_energy(built: Build) -> None:
    kernel = built(bricard(), *KERNELS, "rollout")
    signs = [np.array([1, s, 1, s, 1]) * threefold(1.8) for s in (1, -1)]
    q = kernel.assemble(min(signs, key=lambda x: np.abs(kernel.constraint(x)).max()))
    qs, vs = kernel.rollout(q, np.zeros(5), np.zeros(5), 2e-4, 50_000, every=50)
    energy = kernel.energy(qs, vs)
    assert np.ptp(energy.sum(axis=1)) <= 1e-8 * energy[:, 0].max()
    assert np.abs(kernel.constraint(qs)).max() <= 1e-10


def test_a_first_step_from_an_open_state_does_not_stop_the_mechanism(built: Build) -> None:
    """Open by a tenth of a millimetre, Bennett's redundant rows would block what it is free to do."""
    robot = eomgen.load_robot("bennett")
    kernel = built(robot, *KERNELS, "rollout")
    home = np.array([robot.home[name] for name in kernel.coordinates])
    v = kernel.project_velocity(home, [2.0, 0.0, 0.0], ["joint1.gamma"])
    qs, vs = kernel.rollout(home + [0.0, 1e-4, 0.0], v, np.zeros(3), 1e-7, 1)
    assert np.abs(kernel.constraint(qs[1])).max() <= 1e-10
    assert np.abs(vs[1] - v).max() <= 1e-2


@pytest.mark.soak
def test_rollouts_and_error_control_agree(built: Build) -> None:
    robot = replace(eomgen.load_robot("gough"), name="falling_platform")
    kernel = built(robot, *KERNELS, "rollout")
    q = np.array([robot.home.get(name, 0.0) for name in kernel.coordinates])
    q = kernel.assemble(q, [name for name in kernel.coordinates if name.startswith("leg")])
    qs, vs = kernel.rollout(q, np.zeros(24), np.zeros(24), 5e-4, 200)
    motion = integrate(kernel, q, np.zeros(24), 0.1, rtol=1e-9, output_step=0.1)
    assert np.abs(motion.q[-1] - qs[-1]).max() <= 1e-8
    assert np.abs(motion.v[-1] - vs[-1]).max() <= 1e-7
