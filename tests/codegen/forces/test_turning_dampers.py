"""Slopes of bushings' dampers by directions that turn: stages are dense ones without symmetry, and spins need them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.kernels.equations import derive
from eomgen.robot import Bushing, JointDamping, JointStiffness, Placement, Robot
from eomgen.robot.model import build_model
from tests.support.builds import Build
from tests.support.dense_stages import dense_stage, run, staged
from tests.support.random_robots import random_state
from tests.support.small_robots import free_body

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
STIFFNESS, DAMPING = (900.0, 700.0, 0.0, 30.0, 20.0, 0.0), (30.0, 20.0, 40.0, 0.0, 2.0, 1.0)
PLACES = (Placement((0.1, -0.2, 0.3)), Placement((0.2, 0.1, -0.1)))
RATIO, AT_HZ = 0.3, 2.0


def mounts() -> dict[str, tuple[Bushing, Array, Array]]:
    """Return bushings with their K and D, by what is written in them."""
    K, D = (np.asarray(rows.T @ rows) for rows in np.random.default_rng(4).normal(size=(2, 7, 6)))
    spring, damper, none = JointStiffness.of(K.tolist()), JointDamping.of(D.tolist()), np.zeros((6, 6))
    tables = {
        "numbers": (STIFFNESS, DAMPING, np.diag(STIFFNESS), np.diag(DAMPING)),
        "matrices": (spring, damper, K, D),
        "ratio": (spring, JointDamping(ratio=RATIO, at_hz=AT_HZ), K, RATIO / (np.pi * AT_HZ) * K),
        "damping alone": (None, damper, none, D),
    }
    return {
        name: (Bushing("mount", ("base", "body"), placements=PLACES, stiffness=k, damping=d), K, D)
        for name, (k, d, K, D) in tables.items()
    }


def held(mount: Bushing) -> Robot:
    """Return a body that is free but for the bushing."""
    return replace(free_body(), name="held", gravity=(0.0, 0.0, 0.0), elements=(mount,))


@pytest.mark.parametrize("c", [0.02, 0.2 + 0.3j])
@pytest.mark.parametrize("form", mounts())
def test_stages_are_the_dense_ones(form: str, c: complex) -> None:
    """K has J^T D d(J v)/dq beside J^T K J; of a complex c, whose factors serve a whole step, it has not."""
    mount, K, D = mounts()[form]
    model, h = build_model(held(mount)), 1e-5
    s, p = random_state(held(mount), 3), list(model.parameters.values())
    q, v = np.array(s.q), 5.0 * np.array(s.v)

    def J(at: Array) -> Array:
        return run(derive(model, "element_jacobian"), {"q": at.tolist(), "p": p}).reshape(6, 6)

    M = run(derive(model, "mass_matrix"), {"q": q.tolist(), "p": p}).reshape(6, 6)
    T = np.array([(J(q + h * x) - J(q - h * x)) @ v / (2.0 * h) for x in np.eye(6)]).T
    by_place = K @ J(q) + (0.0 if isinstance(c, complex) else D @ T)
    r, shifts = np.random.default_rng(0).normal(size=(2, 2, 6))
    found = staged(model, {"q": q.tolist(), "v": v.tolist(), "p": p}, c, r, shifts)
    expected, without = (
        dense_stage((M, J(q).T @ D @ J(q), J(q).T @ slopes), c, r, shifts) for slopes in (by_place, K @ J(q))
    )
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
    assert isinstance(c, complex) or np.abs(expected - without).max() > 1e-3 * np.abs(expected).max()


def test_fast_spins_in_dampers_take_long_steps(built: Build) -> None:
    """A body spins in a stiff damper beside its axis: the spin bounds the steps, not the damper."""
    at = (Placement(), Placement((0.01, 0.0, 0.0)))
    mount = Bushing("mount", ("base", "body"), placements=at, stiffness=(1e4,) * 3 + (0.0,) * 3)
    kernel = built(held(replace(mount, damping=(1e5,) * 3 + (0.0,) * 3)), "adaptive_rollout")
    q, v = np.zeros(6), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 300.0])
    loose, tight = (
        kernel.rollout(q, v, duration=0.1, samples=1, rtol=rtol, atol=1e-3 * rtol, method="rosenbrock")
        for rtol in (1e-4, 1e-6)
    )
    assert np.abs(loose[0][-1] - tight[0][-1]).max() < 1e-3
    assert loose.steps < 2000  # without slopes of the directions there are 5250
