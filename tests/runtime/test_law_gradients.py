"""Gradients and sensitivities of rollouts of all laws with states, by all methods, beside differences of rollouts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from tests.support.builds import Build
from tests.support.random_robots import Array
from tests.support.soak import soaked

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")]

SLIDE = """
name = "{name}"
gravity = [0.0, 0.0, 0.0]
[[links]]
name = "body"
mass = 1.5
inertia = {{ xx = 0.1, yy = 0.1, zz = 0.1 }}
[[joints]]
name = "rail"
type = "prismatic"
parent = "base"
child = "body"
z = {{ stiffness = 20.0, damping = 0.3, {law} }}
"""
WINDING = "winding = { resistance = 1.0, inductance = 0.05, torque_constant = 0.5 }"
LOOPS = "position = { kp = 4.0, ki = 2.0, kd = 0.3, filter = 0.05 }, velocity = { kp = 3.0, ki = 4.0 }"
LAWS = {
    "bristles": 'friction = { model = "lugre", coulomb = 1.0, static = 1.4, stribeck = 0.4, viscous = 0.2,'
    " bristle_stiffness = 30.0, bristle_damping = 0.8, fade = 0.6 }",
    "hysteresis": "hysteresis = { stiffness = 40.0, A = 1.2, beta = 3.0, gamma = 1.0, n = 1.7, share = 0.3 }",
    "branches": "maxwell = [{ stiffness = 30.0, damping = 6.0 }, { stiffness = 20.0, damping = 1.0 }]",
    "cascade": f"drive = {{ {WINDING}, controller = {{ {LOOPS}, current = {{ kp = 0.4, ki = 3.0 }} }} }}",
    "limited": f"drive = {{ {WINDING}, voltage_limit = 0.6, controller = {{ {LOOPS} }} }}",
    "lag": "drive = { lag = 0.05 }",
}
FIXED: dict[str, Any] = {"dt": 2e-3, "steps": 60, "every": 20}
ADAPTIVE: dict[str, Any] = {"duration": 0.12, "samples": 3, "rtol": 1e-10, "atol": 1e-13}
METHODS = {"rk4": FIXED, "implicit": FIXED, "tsit5": ADAPTIVE, "rosenbrock": ADAPTIVE}
Q, V, U = 0.03, 0.4, 0.9


def _begin(kernel: eomgen.Kernel) -> tuple[Array, Array, Array]:
    """Return a state in which nothing changes its sense for a while, with states of laws behind the velocity."""
    q, v, u = np.zeros((3, kernel.n))
    q[0], v[0], u[0] = Q, V, U
    v[1:] = 0.02 * np.arange(1, kernel.n)
    return q, v, u


def _weights(kernel: eomgen.Kernel) -> tuple[Array, Array]:
    rng = np.random.default_rng(3)
    return rng.normal(size=(2, 4, kernel.n)) * np.r_[1.0, 0.3 * np.ones(kernel.n - 1)]  # type: ignore[return-value]


def _total(kernel: eomgen.Kernel, begin: tuple[Array, Array, Array], method: Any) -> float:
    q, v = kernel.rollout(*begin, method=method, **METHODS[method])
    by_q, by_v = _weights(kernel)
    return float((by_q[:, 0] * q[:, 0]).sum() + (by_v * v).sum())


def _loss(kernel: eomgen.Kernel) -> Any:
    by_q, by_v = (x.astype(kernel.dtype) for x in _weights(kernel))
    by_q[:, 1:] = 0.0  # positions of states are integrals of no use

    def loss(_: Any, q: Array, v: Array) -> tuple[Any, Array, Array]:
        whole = np.broadcast_to(by_q, q.shape), np.broadcast_to(by_v, v.shape)
        value = (whole[0] * q + whole[1] * v).sum(axis=(-2, -1))
        return (float(value) if value.ndim == 0 else value), *(np.array(x) for x in whole)

    return loss


@pytest.mark.parametrize("law", soaked(LAWS, ("hysteresis",)))
def test_gradients_are_differences_of_the_motion(law: str, built: Build) -> None:
    kernel = built(robot_from_toml(SLIDE.format(name=law, law=LAWS[law])))
    begin, n = _begin(kernel), kernel.n
    named = "joints.rail.z."
    names = [x for x in kernel.parameters if x.startswith(named) and x.count(".") > 3] + [f"{named}stiffness"]
    for method in METHODS:
        options: dict[str, Any] = {"method": method, **METHODS[method]}
        value, slopes = kernel.rollout_gradient(*begin, loss=_loss(kernel), parameters=names, **options)
        assert value == pytest.approx(_total(kernel, begin, method), rel=1e-7)
        size = max(abs(value), 1.0)
        places = [(0, 0), (1, 0), (2, 0), *((1, i) for i in range(1, n))]
        for which, i in places:
            h = 1e-5
            ends = []
            for sign in (1.0, -1.0):
                moved = [x.copy() for x in begin]
                moved[which][i] += sign * h
                ends.append(_total(kernel, (moved[0], moved[1], moved[2]), method))
            key = "qvu"[which]
            found = slopes[key][..., i].sum() if key == "u" else slopes[key][i]
            assert found == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=2e-5, abs=2e-6 * size), (method, key, i)
        for name in names:
            x = kernel.parameters[name]
            h = 1e-4 * abs(x)
            ends = [_total(kernel.with_parameters({name: x + sign * h}), begin, method) for sign in (1.0, -1.0)]
            expected = (ends[0] - ends[1]) / (2.0 * h)
            assert slopes[name] == pytest.approx(expected, rel=1e-4, abs=2e-6 * size / max(abs(x), 1.0)), (method, name)
    with pytest.raises(InputError, match="radau"):
        kernel.rollout_gradient(*begin, loss=_loss(kernel), method="radau", **ADAPTIVE)  # type: ignore[arg-type]


@pytest.mark.soak
@pytest.mark.parametrize("law", soaked(LAWS, ("hysteresis",)))
def test_batches_and_sensitivities_agree(law: str, built: Build) -> None:
    kernel = built(robot_from_toml(SLIDE.format(name=law, law=LAWS[law])))
    one, n = _begin(kernel), kernel.n
    many = [np.tile(x, (3, 1)) * np.array([[1.0], [0.8], [1.1]]) for x in one]
    name = next(x for x in kernel.parameters if x.startswith("joints.rail.z.") and x.count(".") > 3)
    for method in METHODS:
        options: dict[str, Any] = {"method": method, **METHODS[method]}
        values, slopes = kernel.rollout_gradient(*many, loss=_loss(kernel), parameters=[name], **options)
        alone = [
            kernel.rollout_gradient(*(x[k] for x in many), loss=_loss(kernel), parameters=[name], **options)
            for k in range(3)
        ]
        assert np.asarray(values) == pytest.approx(np.array([x for x, _ in alone]), rel=1e-9)
        for key in "qv":
            expected = np.array([by[key] for _, by in alone])
            assert slopes[key] == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())
        assert np.sum(slopes[name]) == pytest.approx(sum(float(by[name]) for _, by in alone), rel=1e-6, abs=1e-9)
        along = np.zeros((1, n))
        along[0, -1] = 1.0
        by_q, weights = _weights(kernel)
        _, (moved_q, moved_v) = kernel.rollout_sensitivity(*one, along={"v": along}, **options)
        forward = float((by_q[:, 0] * moved_q[:, 0, 0]).sum() + (weights * moved_v[:, 0]).sum())
        assert forward == pytest.approx(alone[0][1]["v"][-1], rel=1e-6, abs=1e-8), method


@pytest.mark.soak
@pytest.mark.parametrize("law", soaked(LAWS, ("hysteresis",)))
def test_gradients_in_single_precision(law: str, built: Build) -> None:
    robot = robot_from_toml(SLIDE.format(name=law, law=LAWS[law]))
    double, single = built(robot), built(robot, dtype="float32")
    begin = _begin(double)
    for method in METHODS:
        options: dict[str, Any] = {"method": method, **METHODS[method]}
        options |= {"rtol": 1e-5, "atol": 1e-6} if "rtol" in options else {}
        expected = double.rollout_gradient(*begin, loss=_loss(double), **options)[1]
        found = single.rollout_gradient(*(x.astype(np.float32) for x in begin), loss=_loss(single), **options)[1]
        for key in "qv":
            size = np.abs(expected[key]).max()
            assert found[key] == pytest.approx(expected[key], abs=5e-3 * size), (method, key)
