"""Derivatives of rollouts' states along directions: against gradients, differences of the same steps, many states."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, IntegrationStopped
from eomgen.robot.value import Robot
from eomgen.runtime.stepping import sensitivities
from tests.codegen.forces.test_stops import stopped
from tests.runtime.test_rollout_gradients import DT, METHODS, STEPS, frozen
from tests.support.builds import Build

GRADIENTS = ("rollout", "adaptive_rollout", "explicit_gradient", "implicit_gradient", "rosenbrock_gradient")
KERNELS = (*GRADIENTS, "explicit_sensitivity", "implicit_sensitivity", "rosenbrock_sensitivity")
BESIDE = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
ROBOTS = {"one_link": (), "four_bar": BESIDE, "stops": ()}  # a tree, a loop, a mass that meets a stop


def robot_of(name: str) -> Robot:
    return stopped("stops") if name == "stops" else eomgen.load_robot(name)


class Case:
    """A kernel with a controller, a state, drives over time, and two directions of them."""

    def __init__(self, built: Build, name: str, method: str, **options: Any) -> None:
        rng = np.random.default_rng(7)
        self.kernel = built(robot_of(name), *KERNELS, *ROBOTS[name], **options)
        self.n, self.method = self.kernel.n, method
        n = self.n
        self.state: dict[str, Any] = {"q": rng.uniform(-0.3, 0.3, n), "v": rng.uniform(-1.0, 1.0, n)}
        if name == "four_bar":
            q = self.kernel.close([0.5, 0.2, 1.2])
            self.state = {"q": q, "v": self.kernel.close_rates(q, [1.0, 0.0, 0.0])}
        if name == "stops":
            self.state = {"q": np.array([0.195]), "v": np.array([0.6])}
        self.state["u"] = rng.uniform(-1.0, 1.0, (STEPS, n))
        gains = np.zeros(n)
        gains[list(self.kernel._driven)] = 1.0
        self.control = {"kp": 40.0 * gains, "kd": 2.0 * gains, "target": rng.uniform(-0.3, 0.3, (STEPS, n))}
        self.along = {"u": rng.uniform(-1.0, 1.0, (2, STEPS, n))}
        if name != "four_bar":  # of a loop states beside it are not those of a motion
            self.along |= {"q": rng.uniform(-1.0, 1.0, (2, n)), "v": rng.uniform(-1.0, 1.0, (2, n))}
        self.parameters = tuple(self.kernel.parameters)

    def call(self, name: str, state: dict[str, Any] | None = None, **more: Any) -> Any:
        """A method of the kernel from a state."""
        x = self.state | (state or {})
        options = {**METHODS[self.method], **self.control, "method": self.method, **more}
        return getattr(self.kernel, name)(x["q"], x["v"], x["u"], **options)

    def sensitivity(self, **more: Any) -> Any:
        return self.call("rollout_sensitivity", parameters=self.parameters, along=self.along, **more)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ROBOTS)
def test_equal_to_the_gradient(name: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighted and summed up they are what goes back through the steps; in parts of steps to the bit."""
    case = Case(built, name, method)
    (q, v), (dq, dv) = case.sensitivity()
    weights = np.random.default_rng(4).uniform(-1.0, 1.0, (2, *q.shape))
    _, by = case.call("rollout_gradient", loss=lambda t, q, v: (0.0, *weights), parameters=case.parameters)
    wanted = [sum((by[x][None] * rates)[i].sum() for x, rates in case.along.items()) for i in range(2)]
    wanted += [by[parameter] for parameter in case.parameters]
    found = np.einsum("sn,sdn->d", weights[0], dq) + np.einsum("sn,sdn->d", weights[1], dv)
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-12 * np.abs(wanted).max())
    for one, other in zip((q, v), case.call("rollout"), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13)
    monkeypatch.setattr(sensitivities, "PART", 1)
    monkeypatch.setattr(sensitivities, "SHORTEST", 5)
    for one, other in zip((q, v, dq, dv), (x for pair in case.sensitivity() for x in pair), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ROBOTS)
def test_against_differences(name: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all samples, by drives, states and parameters, with the steps of the motion itself."""
    frozen(monkeypatch)
    case, h = Case(built, name, method), 1e-7 if name == "stops" else 1e-5  # a stop sets in within 2 mm
    _, (dq, dv) = case.sensitivity()
    assert dq.shape == dv.shape == (STEPS + 1, 2 + len(case.parameters), case.n)

    def slopes(kernels: list[eomgen.Kernel], states: list[dict[str, Any]], step: float) -> list[np.ndarray]:
        ends = []
        for case.kernel, state in zip(kernels, states, strict=True):
            ends.append(case.call("rollout_sensitivity", state, along={"u": np.zeros((1, case.n))})[0])
        return [(there - back) / (2.0 * step) for there, back in zip(*ends, strict=True)]

    def near(wanted: np.ndarray) -> float:
        return 1e-6 * float(np.abs(wanted).max()) + 1e-15 / h  # round-off of the differences

    kernel = case.kernel
    for i in range(2):
        states = [{x: case.state[x] + s * h * rates[i] for x, rates in case.along.items()} for s in (1, -1)]
        for found, wanted in zip((dq, dv), slopes([kernel] * 2, states, h), strict=True):
            np.testing.assert_allclose(found[:, i], wanted, rtol=1e-6, atol=near(wanted))
    for i, parameter in enumerate(case.parameters):
        x = kernel.parameters[parameter]
        step = h * max(1.0, abs(x))
        moved = [kernel.with_parameters({parameter: x + s * step}) for s in (1, -1)]
        for found, wanted in zip((dq, dv), slopes(moved, [{}, {}], step), strict=True):
            np.testing.assert_allclose(found[:, 2 + i], wanted, rtol=1e-6, atol=near(wanted))


@pytest.mark.parametrize("method", METHODS)
def test_many_states(method: str, built: Build) -> None:
    """Each to the bit as alone."""
    case, rng = Case(built, "one_link", method), np.random.default_rng(2)
    q = rng.uniform(-0.3, 0.3, (3, 2))
    target = case.control["target"]
    case.control["target"] = target[None]
    u = case.state["u"]
    many = [x for pair in case.sensitivity(state={"q": q, "u": u[None]}) for x in pair]
    case.control["target"] = target
    for i in range(3):
        for whole, own in zip(many, (x for pair in case.sensitivity(state={"q": q[i]}) for x in pair), strict=True):
            np.testing.assert_array_equal(whole[i], own)


def test_arrays_to_write_to(built: Build) -> None:
    case = Case(built, "one_link", "rk4")
    wanted = [x for pair in case.sensitivity() for x in pair]
    out = [np.full_like(x, np.nan) for x in wanted]
    found = [x for pair in case.sensitivity(out=out) for x in pair]
    for own, result, x in zip(out, found, wanted, strict=True):
        assert result is own
        np.testing.assert_array_equal(own, x)
    with pytest.raises(ArrayError, match=r"out: .* expected four arrays"):
        case.sensitivity(out=out[:2])
    with pytest.raises(ArrayError, match=r"out: expected float64 of shape \(13, 2\)"):
        case.sensitivity(out=[x[1:] for x in out])


def test_what_is_wrong_is_named(built: Build) -> None:
    case = Case(built, "one_link", "rk4")

    def sensitivity(**changed: Any) -> None:
        case.call("rollout_sensitivity", **changed)

    with pytest.raises(InputError, match="no direction is given; allowed: parameters or along"):
        sensitivity()
    with pytest.raises(InputError, match="along: 'w' is unknown; allowed: 'q', 'v', 'u'"):
        sensitivity(along={"w": np.zeros((1, 2))})
    with pytest.raises(ArrayError, match=r"along: q has shape \(2,\); expected \(directions, 2\)"):
        sensitivity(along={"q": np.zeros(2)})
    with pytest.raises(ArrayError, match="along: 1 of q, 2 of v; expected as many directions of each"):
        sensitivity(along={"q": np.zeros((1, 2)), "v": np.zeros((2, 2))})
    with pytest.raises(eomgen.UnknownNameError, match="parameters: 'mass' is unknown"):
        sensitivity(parameters=("mass",))
    with pytest.raises(InputError, match="method 'euler' is unknown"):
        sensitivity(parameters=("gravity.y",), method="euler")
    with pytest.raises(IntegrationStopped, match=r"^rollout: "):
        sensitivity(parameters=("gravity.y",), dt=5.0)
    x, bare = case.state, built(eomgen.load_robot("one_link"), "rollout")
    with pytest.raises(eomgen.UnknownNameError, match="without the kernel explicit_sensitivity"):
        bare.rollout_sensitivity(x["q"], x["v"], x["u"], DT, STEPS, parameters=("gravity.y",))
