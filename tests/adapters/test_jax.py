"""Functions of JAX against the kernels they are made of: values, derivatives both ways, batches, refusals."""

from __future__ import annotations

import sys
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.adapters.jax import function, rollout
from eomgen.adapters.mappings import DifferentiableFunction, kernels_for
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.runtime.calls import Calls
from eomgen.runtime.raw import RawFunction
from tests.support.adapter_samples import BENDING, built_for, functions_of, sample, states
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.optional import needs
from tests.support.random_followers import with_followers
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("doubles")
jax, jnp = needs("jax"), needs("jax.numpy")
FEW = 41  # a seed of which some functions alone are compared


def eager(function: Any) -> Any:
    return function


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int | None]]:
    """Every call of C with its number of states."""
    found: list[tuple[str, int | None]] = []
    own = Calls.call

    def counted(
        self: Calls, function: RawFunction, arrays: Any, steps: Any, extra: Any, count: int | None, out: Any
    ) -> int:
        found.append((function.name, count))
        return own(self, function, arrays, steps, extra, count, out)

    monkeypatch.setattr(Calls, "call", counted)
    return found


@pytest.mark.parametrize("way", [eager, pytest.param(jax.jit, marks=pytest.mark.soak)], ids=["eager", "jit"])
@pytest.mark.parametrize("seed", [FEW, *seeds(4100, 0, 31), pytest.param(BENDING, marks=pytest.mark.soak)])
def test_values_and_derivatives_are_the_kernels(seed: int, way: Any, built: Build, figures: Figures) -> None:
    """Of all functions, but of FEW where seconds count, forward and in reverse; jit takes a second for each."""
    robot = sample(4100 if seed == FEW else seed)
    kernel = built_for(robot, built)
    given = states(robot, kernel, seed)
    rng = np.random.default_rng(seed)
    for there in functions_of(robot, kernel):
        if seed == FEW and there.name not in ("forward_dynamics", "energy", "frame_pose"):
            continue
        made = function(kernel, there.name, there.frame, cut=True)
        arrays = [given[name] for name in there.reads]
        moves = [rng.uniform(-1.0, 1.0, array.shape) for array in arrays]
        pull = rng.uniform(-1.0, 1.0, there.output)
        value, along, back = way(partial(both_ways, made))(arrays, moves, pull)
        figures.at_most("value", float(np.abs(value - there.value(*arrays)).max()), 1e-14)
        blocks = there.derivatives(*arrays)
        expected = sum(np.tensordot(b, m, axes=m.ndim) for b, m in zip(blocks, moves, strict=True))
        figures.at_most("forward", distance(along, expected), 1e-12)
        for found, block in zip(back, blocks, strict=True):
            figures.at_most("reverse", distance(found, np.tensordot(pull, block, axes=pull.ndim)), 1e-12)
        figures.count("functions")


@pytest.mark.soak
def test_closed_mechanisms(built: Build) -> None:
    robot = eomgen.load_robot("four_bar")
    names = ("forward_dynamics", "inverse_dynamics", "constraint_forces")
    kernel = built(robot, *kernels_for(*names, closed=True))
    q, v, u = np.array(build_model(robot).home), np.zeros(3), np.array([2.0, -1.0, 0.5])
    for name in names:
        there, made = DifferentiableFunction(kernel, name), function(kernel, name)
        np.testing.assert_allclose(made(q, v, u), there.value(q, v, u), rtol=1e-13)
        for at, block in enumerate(jax.jacrev(made, argnums=(0, 1, 2))(q, v, u)):
            expected = there.derivatives(q, v, u)[at]
            assert distance(block, expected) <= 1e-12


def both_ways(made: Any, arrays: Any, moves: Any, pull: Any) -> Any:
    """The value, its change along the moves, and what pulls it back to the arrays."""
    value, along = jax.jvp(made, arrays, moves)
    return value, along, jax.vjp(made, *arrays)[1](pull)


def distance(found: Any, expected: Any) -> float:
    return float(np.abs(np.asarray(found) - expected).max() / max(float(np.abs(expected).max()), 1.0))


def test_vmap_calls_the_batch_kernel_once(built: Build, calls: list[tuple[str, int | None]]) -> None:
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("forward_dynamics"))
    made = function(kernel, "forward_dynamics")
    rng = np.random.default_rng(2)
    q, v, u = rng.uniform(-1.0, 1.0, (3, 24, kernel.n))
    expected = kernel.forward_dynamics(q, v, u)
    beside = kernel.forward_dynamics(q, v, u[0])
    by_q, by_v, by_u = kernel.forward_dynamics_jacobian(q, v, u)
    calls.clear()
    found = jax.jit(jax.vmap(made))(q, v, u)
    assert np.allclose(found, expected, rtol=1e-14, atol=0.0)
    assert calls == [("forward_dynamics", 24)]
    calls.clear()
    assert np.allclose(jax.vmap(made, (0, 0, None))(q, v, u[0]), beside, rtol=1e-14, atol=0.0)
    assert calls == [("forward_dynamics", 24)]
    calls.clear()
    nested = jax.vmap(jax.vmap(made, (None, 0, None)), (0, None, None))(q[:3], v, u[0])
    assert nested.shape == (3, 24, kernel.n)
    assert np.allclose(nested[2], kernel.forward_dynamics(np.tile(q[2], (24, 1)), v, u[0]), rtol=1e-13, atol=1e-13)
    assert calls[0] == ("forward_dynamics", 72)
    calls.clear()
    slopes = jax.vmap(jax.jacrev(made, (0, 1, 2)))(q, v, u)
    assert sorted(calls) == [("forward_dynamics", 24), ("forward_dynamics_jacobian", 24)]
    for block, wanted in zip(slopes, (by_q, by_v, by_u), strict=True):
        assert distance(block, wanted) < 1e-12
    assert jax.vmap(made)(q[:0], v[:0], u[:0]).shape == (0, kernel.n)
    assert np.allclose(jax.vmap(made)(q[:1], v[:1], u[:1]), expected[:1], rtol=1e-13, atol=1e-13)


def steps(made: Any, q: Any, v: Any, u: Any, dt: float) -> Any:
    """The classical Runge-Kutta method as a scan."""

    def step(state: Any, drive: Any) -> Any:
        def rate(x: Any) -> Any:
            return jnp.concatenate([x[n:], made(x[:n], x[n:], drive)])

        n = drive.size
        k1 = rate(state)
        k2 = rate(state + dt / 2 * k1)
        k3 = rate(state + dt / 2 * k2)
        k4 = rate(state + dt * k3)
        return state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), None

    return jax.lax.scan(step, jnp.concatenate([q, v]), u)[0]


@pytest.mark.soak
def test_a_rollout_is_that_of_the_kernel_and_has_its_gradient(built: Build) -> None:
    """Through a scan: the state at the end as C has it, its gradient by all drives against differences of C."""
    robot = eomgen.load_robot("one_link")
    kernel = built(robot, *kernels_for("forward_dynamics"), "rollout")
    made, dt = function(kernel, "forward_dynamics"), 2e-3
    rng = np.random.default_rng(3)
    q, v, u = np.array([-1e-3, 0.4]), np.zeros(2), rng.uniform(-2.0, 2.0, (20, 2))

    def end(u: Array) -> Array:
        return np.concatenate([x[-1] for x in kernel.rollout(q, v, u, dt, 20)])

    weights = rng.uniform(-1.0, 1.0, 4)
    gradient = jax.jit(jax.value_and_grad(lambda u: weights @ steps(made, q, v, u, dt)))
    value, slope = gradient(u)
    assert value == pytest.approx(weights @ end(u), rel=1e-12)
    h = 1e-4
    for place in [(0, 0), (3, 1), (19, 0)]:
        other = np.zeros_like(u)
        other[place] = h
        difference = weights @ (end(u + other) - end(u - other)) / (2 * h)
        assert slope[place] == pytest.approx(difference, rel=1e-6, abs=1e-9)


@pytest.mark.soak
def test_frames_have_derivatives_of_any_order(built: Build) -> None:
    robot = random_robot(4540, joints=(2, 2), max_coordinates=2)
    kernel = built(robot, *kernels_for("frame_pose"))
    q, h = random_state(robot, 1).q, 1e-5
    orders = [jax.jit(function(kernel, "frame_pose", "tcp"))]
    for _ in range(3):
        orders.append(jax.jit(jax.jacfwd(orders[-1])))
    for lower, higher in pairwise(orders):
        for j, unit in enumerate(np.eye(kernel.n)):
            difference = (lower(q + h * unit) - lower(q - h * unit)) / (2 * h)
            assert np.allclose(difference, higher(q)[..., j], atol=1e-8)
    assert np.abs(orders[3](q)).max() > 0.1


@pytest.mark.soak
@pytest.mark.parametrize("name", ["forward_dynamics", "inverse_dynamics", "energy", "frame_pose"])
@pytest.mark.parametrize("robot", ["one_link", "four_bar"])
def test_second_derivatives_of_closed_and_open_mechanisms(robot: str, name: str, built: Build) -> None:
    """Forward over reverse, reverse over forward and forward twice, under jit, against differences of the gradient."""
    h = 1e-6
    kernel = built(eomgen.load_robot(robot), *kernels_for(name, closed=robot == "four_bar"))
    rng = np.random.default_rng(5)
    x = np.concatenate(
        [np.array(build_model(eomgen.load_robot(robot)).home) + 1e-3, rng.uniform(-1.0, 1.0, 2 * kernel.n)]
    )
    frame = "tcp" if name == "frame_pose" else None
    made, there = function(kernel, name, frame), DifferentiableFunction(kernel, name, frame)
    parts, size = len(there.reads), kernel.n * len(there.reads)
    weights = rng.uniform(-1.0, 1.0, there.output)
    weights /= 1.0 + np.abs(made(*np.split(x[:size], parts))).max()

    def loss(x: Any) -> Any:
        y = made(*jnp.split(x, parts))
        return jnp.sum(weights * y) + jnp.sum(weights * y) ** 2

    slope, at = jax.jit(jax.grad(loss)), x[:size]
    units = h * np.eye(size)
    expected = np.stack([(slope(at + unit) - slope(at - unit)) / (2 * h) for unit in units])
    scale = max(float(np.abs(expected).max()), float(np.abs(slope(at)).max()), 1.0)
    for way in (jax.hessian(loss), jax.jacrev(jax.jacfwd(loss)), jax.jacfwd(jax.jacfwd(loss))):
        assert np.abs(jax.jit(way)(at) - expected).max() < 1e-7 * scale


@pytest.mark.soak
def test_a_batch_of_hessians_is_one_call(built: Build, calls: list[tuple[str, int | None]]) -> None:
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("inverse_dynamics"))
    made = function(kernel, "inverse_dynamics")
    q, v, a = np.random.default_rng(6).uniform(-1.0, 1.0, (3, 24, 2))
    calls.clear()
    found = jax.vmap(jax.hessian(lambda q, v, a: made(q, v, a)[0]))(q, v, a)
    assert [count for name, count in calls if name == "inverse_dynamics_hessian"] == [48]  # of both results
    expected = kernel.hessian("inverse_dynamics", (q, v, a), [1.0, 0.0])[:, :2, :2]
    assert np.allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("controlled", soaked([False, True], [True]))
def test_rollouts_of_the_kernel_have_gradients(controlled: bool, built: Build) -> None:
    """As ``rollout_gradient`` gives them; of a batch each state its own."""
    kernel = built(eomgen.load_robot("one_link"), "rollout", "explicit_gradient", "implicit_gradient")
    made = rollout(kernel, 2e-3, 20, every=5, method="implicit")
    rng = np.random.default_rng(7)
    q, v = np.array([[-1e-3, 0.4], [1e-3, -0.2], [0.0, 0.1]]), rng.uniform(-0.1, 0.1, (3, 2))
    u, gains = rng.uniform(-2.0, 2.0, (20, 2)), {"kp": np.array([0.0, 5.0]), "kd": np.array([0.0, 0.3])}
    more = {**gains, "target": np.array([0.0, 0.5])} if controlled else {}
    weights = rng.uniform(-1.0, 1.0, (2, 5, 2))

    def loss(*arrays: Any) -> Any:
        return sum(jnp.sum(w * x) for w, x in zip(weights, made(*arrays), strict=True))

    given = (q[0], v[0], u, *more.values())
    places = tuple(range(len(given)))
    value, slopes = jax.jit(jax.value_and_grad(loss, places))(*given)
    told = kernel.rollout(q[0], v[0], u, 2e-3, 20, every=5, method="implicit", **more)
    assert value == pytest.approx(sum(np.sum(w * x) for w, x in zip(weights, told, strict=True)), rel=1e-12)
    for place in places:
        other = rng.uniform(-1.0, 1.0, given[place].shape) * (1.0 if place < 3 else [0.0, 1.0])  # what is driven
        ends = [loss(*given[:place], given[place] + s * 1e-5 * other, *given[place + 1 :]) for s in (1.0, -1.0)]
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(float(np.sum(slopes[place] * other)), rel=1e-6, abs=1e-9)
    axes = (0, 0, *(None for _ in given[2:]))
    many = jax.vmap(jax.grad(loss, places), axes)(q, v, *given[2:])
    for i in range(3):
        for found, alone in zip(many, jax.grad(loss, places)(q[i], v[i], *given[2:]), strict=True):
            assert np.allclose(found[i], alone, rtol=1e-10, atol=1e-12)
    refused(InputError, "got 2 arrays; allowed: q0, v0, u, or", made, q[0], v[0])
    refused(ArrayError, r"u: expected shape \(2,\) or \(20, 2\), got \(3, 2\)", made, q[0], v[0], u[:3])


@pytest.mark.soak
def test_in_single_precision(built: Build) -> None:
    robot = random_robot(4550, joints=(2, 2))
    kernel = built(robot, *kernels_for("inverse_dynamics"), dtype="float32")
    made, s = function(kernel, "inverse_dynamics"), random_state(robot, 1)
    single = [x.astype(np.float32) for x in (s.q, s.v, s.a)]
    refused(ArrayError, "q: expected float32, got float64", made, s.q, s.v, s.a)
    jax.config.update("jax_enable_x64", False)
    found = made(*single)
    assert found.dtype == np.float32
    assert np.allclose(found, kernel.inverse_dynamics(*single), rtol=1e-6)
    assert jax.grad(lambda a: made(single[0], single[1], a).sum())(single[2]).dtype == np.float32
    assert np.array_equal(made([0] * kernel.n, [0.0] * kernel.n, single[2]).shape, (kernel.n,))


def test_what_is_refused(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = random_robot(976, joints=(1, 1), types=("free",), armature=False)
    kernel = built(robot, *kernels_for("forward_dynamics"))
    made, s = function(kernel, "forward_dynamics"), random_state(robot, 1)
    singular = s.q.copy()
    singular[kernel.coordinates.index("joint1.beta")] = np.pi / 2
    with pytest.raises(jax.errors.JaxRuntimeError, match=r"SingularError: .*joint1\.beta"):
        jax.block_until_ready(jax.jit(made)(singular, s.v, s.u))
    with pytest.raises(jax.errors.JaxRuntimeError, match=r"ArrayError: v: joint1\.x is nan"):
        jax.block_until_ready(made(s.q, s.v * np.nan, s.u))
    kernel.checks = False
    through = function(kernel, "forward_dynamics")
    assert np.isnan(through(s.q, s.v, s.u * np.nan)).all()
    with pytest.raises(ArrayError, match=r"q: expected shape \(6,\), got \(2, 6\); vmap takes many"):
        made(np.stack([s.q, s.q]), s.v, s.u)
    refused(InputError, "got 2 arrays; allowed: q, v, u", made, s.q, s.v)
    refused(ArrayError, "u: expected float64, got complex128", made, s.q, s.v, s.u * 1j)
    for wrong in ({"joint1": 0.0}, "x", None, [[1], [1, 2]], 10**400, np.ma.zeros(6), ["1"] * 6):
        refused(ArrayError, r"^v: .*; allowed: numbers of shape \(6,\)$", made, s.q, wrong, s.u)
    with pytest.raises(InputError, match="third derivatives are asked for"):
        jax.jacfwd(jax.hessian(lambda q: made(q, s.v, s.u).sum()))(s.q)
    first = function(built(robot, *kernels_for("energy", order=1)), "energy")
    with pytest.raises(UnknownNameError, match="built without energy_adjoint, energy_hessian"):
        jax.hessian(lambda q: first(q, s.v).sum())(s.q)
    jax.config.update("jax_enable_x64", False)
    refused(InputError, "kernel of float64, which JAX has switched off; allowed: jax", made, s.q, s.v, s.u)
    monkeypatch.setitem(sys.modules, "jax", None)
    refused(InputError, r'pip install "eomgen\[jax\]"', function, kernel, "forward_dynamics")


@pytest.mark.soak
def test_frames_of_robots_with_followers(built: Build) -> None:
    """Columns of their Jacobians are sums, whose derivatives are no matter of the Jacobian alone."""
    robot = with_followers(random_robot(5, joints=(3, 4), max_coordinates=2, max_size=6, tree=True, rods=False), 5)
    assert robot.followers
    kernel = built(robot, "kinematics", "frame_pose_tangent", "frame_jacobian_tangent")
    frame, rng = kernel.frames[0], np.random.default_rng(0)
    q, rates = rng.uniform(-0.5, 0.5, (2, 3, kernel.n))
    for name in ("frame_pose", "frame_jacobian"):
        made, step = function(kernel, name, frame), 1e-6
        found = jax.vmap(lambda x, dx, made=made: jax.jvp(made, (x,), (dx,))[1])(q, rates)
        ends = [getattr(kernel, name)(q + sign * step * rates, frame) for sign in (1.0, -1.0)]
        assert np.abs(np.asarray(found) - (ends[0] - ends[1]) / (2 * step)).max() <= 1e-8
        weights = rng.uniform(-1.0, 1.0, found.shape[1:])
        back = jax.grad(lambda x, made=made, weights=weights: jax.numpy.sum(weights * made(x)))(q[0])
        assert float(back @ rates[0]) == pytest.approx(float(np.sum(weights * np.asarray(found)[0])), rel=1e-9)
    pull, weights = function(kernel, "frame_pose", frame), rng.uniform(-1.0, 1.0, (4, 4))
    slope = jax.grad(lambda x: jax.numpy.sum(weights * pull(x)))
    moved = (slope(q[0] + 1e-6 * rates[0]) - slope(q[0] - 1e-6 * rates[0])) / 2e-6
    assert np.abs(np.asarray(jax.jacfwd(slope)(q[0])) @ rates[0] - np.asarray(moved)).max() <= 1e-8
    with pytest.raises(InputError, match=r"second derivatives of Jacobians .* follow others; allowed: first ones"):
        jax.hessian(function(kernel, "frame_jacobian", frame))(q[0])
