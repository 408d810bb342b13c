"""Compiled kernels of robots whose links bend, with all other parts: batches, derivatives, motions, gradients."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from eomgen import Kernel
from eomgen.errors import LoopError
from eomgen.robot.model import build_model
from tests.support.bending_mixtures import Mixture, mixture
from tests.support.builds import Build
from tests.support.random_robots import Array, State, seeds

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.soak]

READS = {
    "mass_matrix": "q",
    "bias_force": "qv",
    "generalized_force": "qv",
    "residual": "qvau",
    "inverse_dynamics": "qva",
    "forward_dynamics": "qvu",
    "coriolis_matrix": "qv",
    "energy": "qv",
    "reactions": "qva",
    "center_of_mass": "q",
    "centroidal_momentum": "qv",
    "frame_velocities": "qv",
    "frame_accelerations": "qva",
}
OF_TREE = ("inverse_dynamics", "reactions")  # which a mechanism has for its open tree, too
KERNELS = (
    *(*READS, "kinematics", "residual_jacobian", "forward_dynamics_jacobian"),
    *("forward_dynamics_tangent", "forward_dynamics_adjoint", "rollout", "adaptive_rollout", "radau_rollout"),
    *(f"{method}_{way}" for method in ("explicit", "implicit", "rosenbrock") for way in ("gradient", "sensitivity")),
)
LOOPS = ("constraint", "constraint_jacobian", "constraint_bias", "cut_poses", "constrained_dynamics")
STATES = 5
GRADIENTS: dict[str, dict[str, Any]] = {
    "rk4": {"dt": 1e-3, "steps": 8},
    "implicit": {"dt": 1e-3, "steps": 8},
    "rosenbrock": {"duration": 8e-3, "samples": 4},
    "tsit5": {"duration": 8e-3, "samples": 4},
}


def subject(seed: int, built: Build, **options: Any) -> tuple[Mixture, Kernel, list[State]]:
    """Build a robot, and draw states of it; of a mechanism with loops one that is closed."""
    for number in range(seed, seed + 10_000, 1000):
        mixed = mixture(number)
        kernel = built(mixed.robot, *KERNELS, *(LOOPS if mixed.robot.loops else ()), **options)
        states = [mixed.state(number + i) for i in range(STATES)]
        if not mixed.robot.loops:
            return mixed, kernel, states
        for s in states:
            try:
                q = kernel.assemble(s.q)
                closed = replace(s, q=q, v=kernel.project_velocity(q, s.v))
            except LoopError:
                continue
            return mixed, kernel, [replace(closed, v=x * closed.v) for x in np.linspace(-1.0, 1.0, STATES)]
    raise AssertionError(seed)


def off(found: Any, expected: Any) -> float:
    """Return the greatest deviation by the greatest number."""
    one, other = np.asarray(found), np.asarray(expected)
    return float(np.abs(one - other).max(initial=0.0) / max(1e-9, np.abs(other).max(initial=0.0)))


@pytest.mark.parametrize("seed", seeds(0, 0, 24, 4))
def test_batches_and_float32(seed: int, built: Build) -> None:
    """States of a batch have the bits of each alone; single precision is near double."""
    mixed, kernel, states = subject(seed, built)
    single = built(mixed.robot, *READS, *(LOOPS if mixed.robot.loops else ()), dtype="float32")
    of = {label: np.array([getattr(s, label) for s in states]) for label in "qvau"}
    for name, reads in READS.items():
        more = {"cut": True} if mixed.robot.loops and name in OF_TREE else {}
        call, rough = (partial(getattr(x, name), **more) for x in (kernel, single))
        arrays = [of[label] for label in reads]
        together = call(*arrays)
        assert np.array_equal(together, [call(*(x[i] for x in arrays)) for i in range(STATES)]), name
        if name != "forward_dynamics" and not mixed.robot.loops:
            assert off(rough(*(x.astype(np.float32) for x in arrays)), together) < 1e-3, name


@pytest.mark.parametrize("seed", seeds(100, 0, 24, 4))
def test_derivatives_of_accelerations(seed: int, built: Build) -> None:
    """Tangents and adjoints are products with whole Jacobians; of trees these are differences'."""
    mixed, kernel, (s, *_) = subject(seed, built)
    rng = np.random.default_rng(seed)
    arguments, weights = (s.q, s.v, s.u), rng.normal(size=kernel.n)
    blocks, rates = kernel.forward_dynamics_jacobian(*arguments), rng.normal(size=(3, kernel.n))
    if mixed.robot.loops:
        rates[0] = kernel.project_velocity(s.q, rates[0])
    along = sum(block @ rate for block, rate in zip(blocks, rates, strict=True))
    assert off(kernel.jvp("forward_dynamics", arguments, tuple(rates)), along) < 1e-9
    for found, block in zip(kernel.vjp("forward_dynamics", arguments, weights), blocks, strict=True):
        expected = weights @ block
        assert np.abs(found - expected).max() < 1e-9 * max(1.0, float(np.abs(expected).max()))
    if not mixed.robot.loops and "drives" not in mixed.parts:  # whose limits are corners
        h = 1e-6
        ends = [
            kernel.forward_dynamics(*(x + sign * h * d for x, d in zip(arguments, rates, strict=True)))
            for sign in (1.0, -1.0)
        ]
        assert off((ends[0] - ends[1]) / (2.0 * h), along) < 1e-5


def begin(mixed: Mixture, s: State) -> tuple[Array, Array, Array, int]:
    """Return q, slow v and u where a motion begins, and the number of coordinates; drives' inner states have no u."""
    n = len(build_model(mixed.robot).coordinates)
    u = s.u.copy()
    u[n:] = 0.0
    return s.q, 0.3 * s.v, u, n


@pytest.mark.parametrize("seed", seeds(200, 0, 24, 4))
def test_motions_by_all_methods(seed: int, built: Build) -> None:
    """All methods find one motion, and a motion that is resumed half way is the whole one."""
    mixed, kernel, (*_, s) = subject(seed, built)
    q, v, u, n = begin(mixed, s)
    adaptive = {"tsit5": 1e-8, "rosenbrock": 1e-7, "radau": 1e-8}
    found = {x: kernel.rollout(q, v, u, method=x, rtol=r, duration=0.02, samples=2) for x, r in adaptive.items()}  # type: ignore[arg-type]
    found["rk4"] = kernel.rollout(q, v, u, method="rk4", dt=1e-5, steps=2000, every=1000)
    found["implicit"] = kernel.rollout(q, v, u, method="implicit", dt=1e-5, steps=2000, every=1000)
    q_end, v_end = (x[-1] for x in found["tsit5"])
    for method, (qs, vs) in found.items():
        limit = 1e-2 if method == "implicit" else 1e-5
        assert off(qs[-1][:n], q_end[:n]) < limit, method
        assert off(vs[-1], v_end) < limit, method
    qs, vs = found["rk4"]
    again = kernel.rollout(qs[1], vs[1], u, method="rk4", dt=1e-5, steps=1000, every=1000)
    assert np.array_equal(again[0][-1], qs[-1])
    assert np.array_equal(again[1][-1], vs[-1])


@pytest.mark.parametrize("seed", seeds(300, 0, 24, 4))
def test_gradients_of_motions_are_their_sensitivities(seed: int, built: Build) -> None:
    """By drives, states and parameters, those of modes among them; those of Runge-Kutta's steps are differences'."""
    mixed, kernel, (*_, s) = subject(seed, built)
    q, v, u, n = begin(mixed, s)
    rng, loops = np.random.default_rng(seed), mixed.robot.loops
    along = {"u": rng.normal(size=(2, kernel.n))}
    along["u"][:, n:] = 0.0
    if not loops:
        along |= {"q": rng.normal(size=(2, kernel.n)), "v": rng.normal(size=(2, kernel.n))}
    parameters = tuple(x for x in kernel.parameters if ".modes." in x)[:4] + tuple(kernel.parameters)[:3]
    for method, options in GRADIENTS.items():
        asked: dict[str, Any] = {"method": method, "parameters": parameters, **options}
        (qs, _), (dq, dv) = kernel.rollout_sensitivity(q, v, u, along=along, **asked)
        weights = rng.normal(size=(2, *qs.shape))
        loss = partial(lambda w, t, q, v: (0.0, *w), weights)
        _, by = kernel.rollout_gradient(q, v, u, loss=loss, **asked)
        found = np.einsum("sn,sdn->d", weights[0], dq) + np.einsum("sn,sdn->d", weights[1], dv)
        wanted = [sum((by[x][None] * rates)[i].sum() for x, rates in along.items()) for i in range(2)]
        assert off(found, [*wanted, *(by[x] for x in parameters)]) < 1e-8, method
        if method == "rk4" and not loops and "drives" not in mixed.parts:
            h = 1e-6
            moved = [[x + sign * h * along[k][0] for k, x in (("q", q), ("v", v), ("u", u))] for sign in (1.0, -1.0)]
            ends = [kernel.rollout(*x, method="rk4", **options) for x in moved]
            for one, other, slope in zip(*ends, (dq[:, 0], dv[:, 0]), strict=True):
                assert off((one - other) / (2.0 * h), slope) < 1e-5
