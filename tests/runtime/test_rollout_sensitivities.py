"""Derivatives of the states of rollouts: against gradients, and differences and complex steps of the same steps."""

from __future__ import annotations

import cmath
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.steps.methods import RK4, TSIT5, W643
from eomgen.codegen.program.ir import evaluate
from eomgen.errors import ArrayError, InputError, IntegrationStopped
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.stepping import gradients, sensitivities
from tests.codegen.forces.test_stops import stopped
from tests.oracles.complex_step import COMPLEX
from tests.runtime.test_rollout_gradients import DT, METHODS, STEPS, frozen
from tests.support.builds import Build
from tests.support.soak import across

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
            q = self.kernel.assemble([0.5, 0.2, 1.2])
            self.state = {"q": q, "v": self.kernel.project_velocity(q, [1.0, 0.0, 0.0])}
        if name == "stops":
            self.state = {"q": np.array([0.195]), "v": np.array([0.6])}
        self.state["u"] = rng.uniform(-1.0, 1.0, (STEPS, n))
        gains = np.zeros(n)
        gains[self.kernel.raw.libraries.meta["driven"]] = 1.0
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


@pytest.mark.parametrize(("name", "method"), across(ROBOTS, METHODS))
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
    monkeypatch.setattr(sensitivities, "SEGMENT", 1)
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

    with pytest.raises(InputError, match="there is no direction; allowed: parameters or along"):
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


class Evaluated:
    """Steps of all methods by the programs themselves, evaluated with complex numbers."""

    names: tuple[str, ...] = ("forward_dynamics", "implicit_step", "stage_factors", "stage_solution")

    def __init__(self, robot: Robot, values: dict[str, np.ndarray]) -> None:
        self.model, self.values = build_model(robot), values
        self.programs = {name: derive(self.model, name) for name in self.names}

    def run(self, name: str, **arrays: np.ndarray) -> np.ndarray:
        given = {key: list(x) for key, x in {**arrays, "p": self.values["p"]}.items()}
        found = evaluate(self.programs[name], given, lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
        return np.array([found["out", i] for i in range(sum(key[0] == "out" for key in found))], complex)

    def gains(self) -> dict[str, np.ndarray]:
        """Gains in the matrix of a step."""
        return {name: self.values[name] for name in ("kp", "kd")}

    def held(self, row: int, q: np.ndarray, v: np.ndarray, share: float) -> np.ndarray:
        """Drives at a share of the step under a row."""
        x = self.values
        return x["u"][row] + x["kp"] * (x["target"][row] - q) - x["kd"] * v

    def accelerations(self, row: int, q: np.ndarray, v: np.ndarray, share: float) -> np.ndarray:
        return self.run("forward_dynamics", q=q, v=v, u=self.held(row, q, v, share))

    def step(self, method: str, row: int, dt: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if method == "implicit":
            x, u = self.gains(), self.held(row, q + dt * v, v, 1.0)
            added, times = dt * (x["kd"] + dt * x["kp"]), np.array([dt, dt * dt])
            v_end = v + dt * self.run("implicit_step", q=q, v=v, u=u, added=added, dt=times)
            return q + dt * v_end, v_end
        if method == "rosenbrock":
            return self.rosenbrock(row, dt, q, v)
        table = RK4 if method == "rk4" else TSIT5
        rates: list[np.ndarray] = []
        for shares in table.a[: 4 if method == "rk4" else 6]:
            moved = sum((dt * w * k for w, k in zip(shares, rates, strict=False)), np.zeros((2, q.size), complex))
            q_here, v_here = np.array([q, v]) + moved
            rates.append(np.array([v_here, self.accelerations(row, q_here, v_here, shares.sum())]))
        q, v = np.array([q, v]) + sum(dt * w * k for w, k in zip(table.b, rates, strict=False))
        return q, v

    def rosenbrock(self, row: int, dt: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ahead, back, weight, _ = W643.transformed()
        c = W643.diagonal * dt
        kept = self.run("stage_factors", q=q, v=v, times=np.array([c, c * c]), **self.gains())
        parts: list[np.ndarray] = []
        for more, less, share in zip(ahead, back, W643.alpha.sum(axis=1), strict=True):
            start = np.zeros((2, q.size), complex)
            q_here, v_here = np.array([q, v]) + sum((w * x for w, x in zip(more, parts, strict=False)), start)
            a = self.accelerations(row, q_here, v_here, share)
            shift, rate = np.array([v_here, a]) + sum((w / dt * x for w, x in zip(less, parts, strict=False)), start)
            v_part = c * (rate + self.run("stage_solution", kept=kept, rates=rate, shifts=shift))
            parts.append(np.array([c * (v_part + shift), v_part]))
        q, v = np.array([q, v]) + sum(w * x for w, x in zip(weight, parts, strict=True))
        return q, v


@pytest.mark.parametrize("method", METHODS)
def test_equal_to_complex_steps_of_the_programs(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all samples along random directions of everything that a rollout reads, by the steps that were taken."""
    taken: list[gradients.Steps] = []
    chosen = gradients._chosen_steps
    monkeypatch.setattr(gradients, "_chosen_steps", lambda *x: taken.append(chosen(*x)) or taken[-1])
    case, rng = Case(built, "one_link", method), np.random.default_rng(3)
    (q, _), (dq, dv) = case.sensitivity()
    weights = rng.uniform(-1.0, 1.0, (2, *q.shape))
    _, by = case.call("rollout_gradient", loss=lambda t, q, v: (0.0, *weights), parameters=case.parameters)
    plan = list(zip(taken[0].dt, taken[0].rows, strict=True)) if taken else []
    told = list(taken[0].sample_index) if taken else list(range(STEPS + 1))
    plan = plan or [(DT, row) for row in range(STEPS)]
    given = {**case.state, **case.control, "p": np.array(list(case.kernel.parameters.values()))}
    by = {**by, "p": np.array([by[name] for name in case.parameters])}

    def moved(rates: dict[str, np.ndarray]) -> np.ndarray:
        values = {name: x + 1e-30j * rates.get(name, np.zeros_like(x)) for name, x in given.items()}
        evaluated, states = Evaluated(robot_of("one_link"), values), [(values["q"], values["v"])]
        for dt, row in plan:
            states.append(evaluated.step(method, row, float(dt), *states[-1]))
        return np.array([states[i] for i in told]).imag * 1e30

    for i in range(2):
        for found, wanted in zip(
            (dq, dv), moved({x: own[i] for x, own in case.along.items()}).swapaxes(0, 1), strict=True
        ):
            np.testing.assert_allclose(found[:, i], wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    everything = {name: rng.uniform(-1.0, 1.0, x.shape) for name, x in given.items()}
    wanted = float((moved(everything) * weights.swapaxes(0, 1)).sum())
    assert sum(float((by[name] * x).sum()) for name, x in everything.items()) == pytest.approx(wanted, rel=1e-9)
