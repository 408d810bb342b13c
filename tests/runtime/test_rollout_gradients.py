"""Gradients of rollouts: against differences of the same steps, checkpoints, batches, loops, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, IntegrationStopped
from eomgen.runtime.stepping import gradients
from tests.support.builds import Build

STEPS, DT = 12, 2e-3
FIXED: dict[str, Any] = {"dt": DT, "steps": STEPS}
CHOSEN: dict[str, Any] = {"duration": STEPS * DT, "samples": STEPS}
METHODS = {"rk4": FIXED, "implicit": FIXED, "rosenbrock": CHOSEN, "tsit5": CHOSEN}
KERNELS = ("rollout", "adaptive_rollout", "explicit_gradient", "implicit_gradient", "rosenbrock_gradient")


class Loss:
    """Weighted squares of coordinates, and weighted rates."""

    def __init__(self, n: int) -> None:
        self.weights = np.random.default_rng(4).uniform(-1.0, 1.0, (2, STEPS + 1, n))

    def __call__(self, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray]:
        of_q, of_v = (np.broadcast_to(x[: t.size], q.shape) for x in self.weights)
        return float((of_q * q**2 + of_v * v).sum()), 2.0 * of_q * q, of_v


class Case:
    """A kernel with a controller, a state and drives over time."""

    def __init__(self, kernel: eomgen.Kernel, method: str, **given: Any) -> None:
        rng, n = np.random.default_rng(7), kernel.n
        self.kernel, self.method, self.loss = kernel, method, Loss(n)
        self.driven = kernel.raw.libraries.meta["driven"]
        self.given: dict[str, Any] = {"q": rng.uniform(-0.3, 0.3, n), "v": rng.uniform(-1.0, 1.0, n)}
        self.given |= {"u": rng.uniform(-1.0, 1.0, (STEPS, n)), "target": rng.uniform(-0.3, 0.3, (STEPS, n))}
        for name, size in (("kp", 40.0), ("kd", 2.0)):
            self.given[name] = np.zeros(n)
            self.given[name][list(self.driven)] = size
        self.given |= given

    def gradient(self, parameters: tuple[str, ...] = (), **changed: Any) -> tuple[float, dict[str, Any]]:
        """The value and its gradient, with some of what is given changed."""
        x = self.given | changed
        arrays = {name: x[name] for name in ("kp", "kd", "target")}
        more = {**METHODS[self.method], **arrays, "loss": self.loss, "parameters": parameters, "out": x.get("out")}
        return self.kernel.rollout_gradient(x["q"], x["v"], x["u"], method=self.method, **more)


def slope(case: Case, name: str, direction: np.ndarray, h: float = 1e-5) -> float:
    """Derivative of the value along a direction, by differences."""
    there, before = (case.gradient(**{name: case.given[name] + s * h * direction})[0] for s in (1, -1))
    return (there - before) / (2.0 * h)


def frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let steps that the error chooses be those of the first motion."""
    found: list[Any] = []
    chosen = gradients._chosen_steps

    def once(*arguments: Any) -> Any:
        found.append(found[0] if found else chosen(*arguments))
        return found[0]

    monkeypatch.setattr(gradients, "_chosen_steps", once)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["one_link", "four_bar"])
def test_against_differences(name: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """By states, drives, targets, gains and parameters; of loops by what keeps them closed."""
    frozen(monkeypatch)
    robot = eomgen.load_robot(name)
    beside = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses") if robot.loops else ()
    kernel, rng = built(robot, *KERNELS, *beside), np.random.default_rng(9)
    state = {}
    if robot.loops:
        q = kernel.assemble([0.5, 0.2, 1.2])
        state = {"q": q, "v": kernel.project_velocity(q, [1.0, 0.0, 0.0])}
    case, parameters = Case(kernel, method, **state), tuple(kernel.parameters)
    value, found = case.gradient(parameters)
    assert set(found) == {"q", "v", "u", "target", "kp", "kd", *parameters}
    for given in ("u", "target", "kp", "kd", *(() if robot.loops else ("q", "v"))):
        direction = rng.uniform(-1.0, 1.0, case.given[given].shape) * (
            case.given["kp"] > 0 if given in ("kp", "kd") else 1
        )
        assert found[given].shape == case.given[given].shape
        wanted = slope(case, given, direction)
        assert (found[given] * direction).sum() == pytest.approx(wanted, rel=1e-6, abs=1e-7 * abs(value)), given
    for parameter in parameters:
        x = kernel.parameters[parameter]
        h = 1e-5 * max(1.0, abs(x))
        ends = []
        for s in (1, -1):
            case.kernel = kernel.with_parameters({parameter: x + s * h})
            ends.append(case.gradient()[0])
        assert found[parameter] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6, abs=1e-7 * abs(value))


@pytest.mark.parametrize("method", METHODS)
def test_values_are_those_of_the_rollout(method: str, built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), *KERNELS)
    case = Case(kernel, method)
    x = case.given
    controlled = {name: x[name] for name in ("kp", "kd", "target")}
    q, v = kernel.rollout(x["q"], x["v"], x["u"], method=method, **METHODS[method], **controlled)
    assert case.gradient()[0] == pytest.approx(case.loss(np.zeros(STEPS + 1), q, v)[0], rel=1e-12)
    held = {name: x[0] if name in ("u", "target") else x for name, x in x.items()}  # nothing tells samples apart
    controlled = {name: held[name] for name in ("kp", "kd", "target")}
    fine = METHODS[method] if METHODS[method] is FIXED else {**CHOSEN, "rtol": 1e-8}
    q, v = kernel.rollout(held["q"], held["v"], held["u"], method=method, **fine, **controlled)
    case.given = held
    assert case.gradient()[0] == pytest.approx(case.loss(np.zeros(STEPS + 1), q, v)[0], rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("every", [1, 3])
def test_parts_of_long_motions_are_stepped_through_again(
    method: str, every: int, built: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, whatever is kept."""
    case = Case(built(eomgen.load_robot("one_link"), *KERNELS), method)
    if METHODS[method] is FIXED:
        monkeypatch.setitem(METHODS, method, {**FIXED, "every": every})
    value, found = case.gradient(("gravity.z",))
    monkeypatch.setattr(gradients, "KEPT", 0)
    monkeypatch.setattr(gradients, "SHORTEST", 1)
    again, other = case.gradient(("gravity.z",))
    assert again == value
    for name, x in found.items():
        np.testing.assert_array_equal(other[name], x)


@pytest.mark.parametrize("method", METHODS)
def test_many_states(method: str, built: Build) -> None:
    """Each as alone; what all share adds up."""
    case, rng = Case(built(eomgen.load_robot("one_link"), *KERNELS), method), np.random.default_rng(2)
    states = {"q": rng.uniform(-0.3, 0.3, (3, 2)), "u": rng.uniform(-1.0, 1.0, (3, STEPS, 2))}
    shared = {"target": case.given["target"][None]}
    _, found = case.gradient(("gravity.y",), **states, **shared)
    alone = [
        case.gradient(("gravity.y",), q=states["q"][i], u=states["u"][i], target=shared["target"][0])[1]
        for i in range(3)
    ]
    for i in range(3):
        np.testing.assert_array_equal(found["q"][i], alone[i]["q"])
        np.testing.assert_array_equal(found["u"][i], alone[i]["u"])
    for name in ("v", "kp", "kd", "gravity.y"):
        np.testing.assert_allclose(found[name], sum(x[name] for x in alone), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found["target"][0], sum(x["target"] for x in alone), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("method", METHODS)
def test_arrays_to_write_to(method: str, built: Build) -> None:
    """Some of them or all, whatever they held; those of a batch, too."""
    case = Case(built(eomgen.load_robot("one_link"), *KERNELS), method)
    states = {"q": np.array([case.given["q"], -case.given["q"]]), "target": case.given["target"][None]}
    for changed in ({}, {**states, "u": case.given["u"][None]}):
        value, wanted = case.gradient(("gravity.y",), **changed)
        arrays = {name: x for name, x in wanted.items() if isinstance(x, np.ndarray)}
        for names in (tuple(arrays), ("u", "kd")):
            out = {name: np.full_like(arrays[name], np.nan) for name in names}
            again, found = case.gradient(("gravity.y",), **changed, out=out)
            assert again == value
            assert all(found[name] is own for name, own in out.items())
            for name, x in wanted.items():
                np.testing.assert_array_equal(found[name], x)


@pytest.mark.soak
def test_single_precision(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    double, single = built(robot, *KERNELS), built(robot, *KERNELS, dtype="float32")
    wanted = Case(double, "rk4").gradient(("gravity.y",))[1]
    case = Case(single, "rk4")
    case.given = {name: np.asarray(x, np.float32) for name, x in case.given.items()}
    for name, x in case.gradient(("gravity.y",))[1].items():
        np.testing.assert_allclose(x, wanted[name], rtol=2e-3, atol=2e-4 * np.abs(wanted[name]).max())


@pytest.mark.soak
def test_drives_that_are_left_out_are_zero(built: Build) -> None:
    """As those of a rollout are; sensitivities too."""
    kernel = built(eomgen.load_robot("one_link"), *KERNELS, "explicit_sensitivity")
    case = Case(kernel, "rk4")
    x = case.given
    given = {"loss": case.loss, "parameters": ("gravity.y",), **FIXED}
    value, by = kernel.rollout_gradient(x["q"], x["v"], **given)
    wanted, of_zeros = kernel.rollout_gradient(x["q"], x["v"], np.zeros(kernel.n), **given)
    assert value == wanted
    assert by["gravity.y"] == of_zeros["gravity.y"] != 0.0
    _, (dq, _) = kernel.rollout_sensitivity(x["q"], x["v"], parameters=("gravity.y",), **FIXED)
    zeros = np.zeros(kernel.n)
    np.testing.assert_array_equal(
        dq, kernel.rollout_sensitivity(x["q"], x["v"], zeros, parameters=("gravity.y",), **FIXED)[1][0]
    )


def test_what_is_wrong_is_named(built: Build) -> None:
    case = Case(built(eomgen.load_robot("one_link"), *KERNELS), "rk4")
    kernel, x = case.kernel, case.given

    def gradient(loss: Any, **changed: Any) -> None:
        kernel.rollout_gradient(x["q"], x["v"], x["u"], **{**FIXED, "loss": loss, **changed})

    with pytest.raises(InputError, match=r"loss: it returned 1.0; allowed: \(value, dq, dv\)"):
        gradient(lambda t, q, v: 1.0)
    with pytest.raises(ArrayError, match=r"loss: dq has shape \(2,\); expected \(13, 2\), that of q"):
        gradient(lambda t, q, v: (1.0, q[0], v))
    with pytest.raises(ArrayError, match="loss: dv has numbers that are not finite"):
        gradient(lambda t, q, v: (1.0, q, v * np.nan))
    with pytest.raises(InputError, match="steps = 0 is not a whole number"):
        gradient(case.loss, steps=0)
    with pytest.raises(eomgen.UnknownNameError, match="parameters: 'mass' is unknown"):
        gradient(case.loss, parameters=("mass",))
    with pytest.raises(InputError, match=r"out: 'gravity.y' is unknown; allowed: 'q', 'v', 'u'"):
        gradient(case.loss, out={"gravity.y": np.zeros(2)})
    with pytest.raises(InputError, match=r"out: .* is no mapping"):
        gradient(case.loss, out=np.zeros(2))
    with pytest.raises(ArrayError, match=r"out: expected float64 of shape \(12, 2\)"):
        gradient(case.loss, out={"u": np.zeros(2)})
    with pytest.raises(ArrayError, match="out: overlaps an argument"):
        gradient(case.loss, out={"u": x["u"]})
    with pytest.raises(ArrayError, match="out: overlaps an argument"):
        gradient(case.loss, out=dict.fromkeys(("q", "v"), np.zeros(2)))
    with pytest.raises(IntegrationStopped, match=r"^rollout: "):
        gradient(case.loss, dt=5.0, steps=STEPS)
    along = {"q": np.eye(kernel.n)}
    with pytest.raises(InputError, match="'radau' has no derivatives; allowed: rk4, tsit5, implicit, rosenbrock"):
        kernel.rollout_gradient(x["q"], x["v"], x["u"][0], loss=case.loss, method="radau", duration=0.1)
    with pytest.raises(InputError, match="'radau' has no derivatives; allowed: rk4, tsit5, implicit, rosenbrock"):
        kernel.rollout_sensitivity(x["q"], x["v"], x["u"][0], along=along, method="radau", duration=0.1)
    bare = built(eomgen.load_robot("one_link"), "rollout")
    with pytest.raises(eomgen.UnknownNameError, match="without the kernel explicit_gradient"):
        bare.rollout_gradient(x["q"], x["v"], x["u"], DT, STEPS, loss=case.loss)
