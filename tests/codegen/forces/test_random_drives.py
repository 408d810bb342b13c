"""Laws of mechanics and calculus on random robots whose principal coordinates have servo drives, beside other laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomgen.codegen.closed_form.trace import closed_form
from eomgen.integration.solve import integrate
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.state.drives import drive_jacobian
from tests.oracles.force_laws import DriveOracle, with_drives, with_laws
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.random_robots import Array, random_robot, random_state, seeds

pytestmark = pytest.mark.usefixtures("unoptimised")

TYPES = ("revolute", "prismatic", "fixed")


def driven(seed: int, joints: tuple[int, int] = (1, 3), size: int = 5) -> Robot:
    """A random robot with a drive at least."""
    for attempt in range(50):
        robot = random_robot(seed + 1000 * attempt, joints=joints, max_size=size, types=TYPES, armature=True)
        robot = with_drives(with_laws(robot, seed), seed)
        if build_model(robot).drives:
            return robot
    raise AssertionError(seed)


@pytest.mark.parametrize("seed", seeds(1360, 1, 16))
def test_kernels_are_the_equations(seed: int, built: Build) -> None:
    robot = driven(seed)
    kernel, oracle = built(robot), DriveOracle(robot)
    n, states = len(kernel.coordinates), [random_state(robot, seed + i) for i in range(6)]
    for s in states:
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), oracle.inverse_dynamics(s.q, s.v, s.a))
        residual, expected = kernel.residual(s.q, s.v, s.a, s.u), oracle.residual(s.q, s.v, s.a, s.u)
        scale = np.where(np.isnan(oracle.inertias()), 1.0, oracle.inertias())
        assert close(residual / scale, expected / scale)
        forces, _, voltages = oracle.driven(s.q, s.v, s.u)
        assert close(kernel.drive_forces(s.q, s.v, s.u)[:n], forces[:n])
        behind = list(build_model(robot).states_of_drives)
        assert close(kernel.drive_forces(s.q, s.v, s.u)[behind], voltages[behind])
        M = kernel.mass_matrix(s.q)[:n, :n]
        allowed = max(1e-11, 100 * np.finfo(float).eps * np.linalg.cond(M))
        found, expected = kernel.forward_dynamics(s.q, s.v, s.u), oracle.forward_dynamics(s.q, s.v, s.u)
        assert close(found[:n], expected[:n], allowed)
        assert close(found[n:], expected[n:])
        assert close(kernel.energy(s.q, s.v), oracle.energy(s.q, s.v))
    q, v, u = (np.array([getattr(s, x) for s in states]) for x in "qvu")
    assert close(kernel.forward_dynamics(q, v, u), np.array([kernel.forward_dynamics(*x) for x in zip(q, v, u)]), 1e-12)  # noqa: B905


@pytest.mark.parametrize("seed", seeds(1380, 1, 16))
def test_slopes_are_those_of_the_equations(seed: int, built: Build) -> None:
    """M da = (drives' slopes - residual's) d, and drives' slopes are differences of what they do."""
    robot = driven(seed)
    kernel, oracle = built(robot), DriveOracle(robot)
    n = len(kernel.coordinates)
    for i in range(3):
        s = random_state(robot, seed + i)
        a = kernel.forward_dynamics(s.q, s.v, s.u)
        by_q, by_v, M = kernel.residual_jacobian(s.q, s.v, a)
        ours = drive_jacobian(kernel, s.q, s.v, s.u)
        scale = 1.0 / np.diagonal(M).copy()
        scale[:n] = 1.0 / np.abs(M[:n, :n]).max()
        blocks = kernel.forward_dynamics_jacobian(s.q, s.v, s.u)
        wanted = (ours[0] - by_q, ours[1] - by_v, ours[2])
        for block, other in zip(blocks, wanted, strict=True):
            assert close(scale[:, None] * (M @ block), scale[:, None] * other, 1e-8)
        w = np.where(np.isnan(oracle.inertias()), 1.0, oracle.inertias())
        for which, slopes in enumerate(ours):
            for k in range(kernel.n):
                h, ends, beside = 1e-6, [], []
                for sign in (1.0, -1.0, 2.0, -2.0):
                    moved = [s.q.copy(), s.v.copy(), s.u.copy()]
                    moved[which][k] += sign * h
                    forces, rates, _ = oracle.driven(*moved)
                    kept = np.where(np.isnan(oracle.inertias()), forces, w * rates)
                    (ends if abs(sign) == 1.0 else beside).append(kept)
                one, two = (ends[0] - ends[1]) / (2.0 * h), (beside[0] - beside[1]) / (4.0 * h)
                smooth = np.abs(one - two) <= 1e-6 * (w + np.abs(one))  # no limit in between
                found = slopes[:, k] / w
                assert (np.abs(found - one / w) <= 1e-5 * (1.0 + np.abs(one / w)))[smooth].all(), (which, k)


@pytest.mark.parametrize("seed", [1400, 1401, 1402])
def test_closed_forms_have_them(seed: int) -> None:
    robot = driven(seed, (1, 2), 3)
    model, oracle, s = build_model(robot), DriveOracle(robot), random_state(robot, seed)
    n = len(model.coordinates)
    s.u[n:] = 0.0
    function = closed_form(model).function("residual", "rates")
    residual, rates = function(*(x[:n] for x in (s.q, s.v, s.a, s.u)), z=s.v[n:])
    assert close(residual, oracle.residual(s.q, s.v, s.a, s.u)[:n])
    places = list(model.states_of_drives)
    assert close(rates[[k - n for k in places]], oracle.driven(s.q, s.v, s.u)[1][places])


@pytest.mark.parametrize("seed", seeds(1410, 1, 12))
def test_motions_by_all_methods_agree_and_energies_balance(seed: int, built: Build) -> None:
    """What drives take in is what energies gain and what dissipates; friction by its own smoothing."""
    robot = driven(seed, (1, 2), 4)
    kernel = built(robot)
    s = random_state(robot, seed)
    n, options = len(kernel.coordinates), {"duration": 0.02, "samples": 2}
    s.u[n:] = 0.0
    s.q[n:] = 0.0
    motions: list[Array] = []
    for method, rtol in (("tsit5", 1e-8), ("rosenbrock", 1e-7), ("radau", 1e-8)):
        chosen: Any = {"method": method, "rtol": rtol, **options}
        q, v = kernel.rollout(0.1 * s.q, 0.1 * s.v, s.u, **chosen)
        motions.append(np.hstack([q[:, :n], v]))
    for motion in motions[:-1]:
        assert close(motion, motions[-1], 2e-5)
    found = integrate(kernel, 0.1 * s.q, 0.1 * s.v, duration=0.02, drive=s.u, method="radau", rtol=1e-8, works=True)
    assert found.works is not None
    gained = found.energy[-1].sum() - found.energy[0].sum()
    assert gained == pytest.approx(
        float((found.works[-1] - found.works[0]) @ [1.0, 1.0, 1.0, -1.0]), rel=1e-5, abs=1e-6
    )
