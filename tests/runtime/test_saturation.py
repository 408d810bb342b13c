"""Drives that are clipped at their efforts: against SciPy, differences and themselves, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.robot.value import Robot
from eomgen.runtime.stepping import gradients
from eomgen.runtime.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track
from tests.support.builds import Build
from tests.support.random_robots import random_robot, some_prescribed

pytestmark = pytest.mark.usefixtures("unoptimised")

STEPS, DT = 20, 2e-3
FIXED: dict[str, Any] = {"dt": DT, "steps": STEPS}
CHOSEN: dict[str, Any] = {"duration": STEPS * DT, "samples": STEPS}
METHODS = {"rk4": FIXED, "implicit": FIXED, "rosenbrock": CHOSEN, "tsit5": CHOSEN}
ROLLED = (
    "rollout",
    "adaptive_rollout",
    "forward_dynamics",
    "mass_matrix",
    "generalized_force",
    "external_force",
    "energy",
)
KINDS = ("gradient", "sensitivity")
GRADIENTS = tuple(f"{way}_{kind}" for way in ("explicit", "implicit", "rosenbrock") for kind in KINDS)
CLOSED = ("constrained_dynamics", "kinematics", "constraint", "constraint_jacobian", "cut_poses")
SLOPED = ("external_force_parameter_adjoint", "external_force_tangent", "external_force_parameter_tangent")
Array = np.ndarray


def robot_of(seed: int) -> Robot:
    return random_robot(seed, joints=(2, 2), max_size=5, types=("revolute", "prismatic"))


class Case:
    """A kernel, a state, drives over time and a controller of which some are clipped, some are not, and some change."""

    def __init__(self, kernel: eomgen.Kernel, seed: int = 3) -> None:
        rng, n = np.random.default_rng(seed), kernel.n
        self.kernel, self.driven = kernel, kernel.raw.libraries.meta["driven"]
        self.x: dict[str, Any] = {"q0": rng.uniform(-0.2, 0.2, n), "v0": rng.uniform(-0.5, 0.5, n)}
        self.x |= {"u": rng.uniform(-1.0, 1.0, (STEPS, n)), "target": rng.uniform(-0.3, 0.3, (STEPS, n))}
        for name, size in (("kp", 40.0), ("kd", 1.0)):
            self.x[name] = np.zeros(n)
            self.x[name][self.driven] = size
        self.effort = np.full(n, np.inf)
        self.effort[self.driven] = np.quantile(np.abs(self.asked(self.x["q0"], self.x["v0"])), 0.5, axis=0)[self.driven]

    def asked(self, q: Array, v: Array) -> Array:
        """Drives of all steps in one state, before they are clipped, (STEPS, n)."""
        x = self.x
        return np.asarray(x["u"] + x["kp"] * (x["target"] - q) - x["kd"] * v)

    def weights(self) -> Array:
        return np.random.default_rng(5).uniform(-1.0, 1.0, (2, STEPS + 1, self.kernel.n))

    def loss(self, _: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
        by_q, by_v = (x[: len(q)] for x in self.weights())
        return float((by_q * q + by_v * v).sum()), by_q, by_v

    def gradient(self, method: str, **changed: Any) -> tuple[float, dict[str, Any]]:
        """The value of the loss and its gradient, with some of what is given changed."""
        how = {**METHODS[method], "loss": self.loss, "saturate": self.effort}
        found: tuple[float, dict[str, Any]] = self.kernel.rollout_gradient(
            **{**self.x, **changed}, method=method, **how
        )
        return found

    def slope(self, method: str, name: str, direction: Array, h: float = 1e-6) -> float:
        """Derivative of the value along a direction, by differences."""
        there, before = (self.gradient(method, **{name: self.x[name] + s * h * direction})[0] for s in (1, -1))
        return (there - before) / (2.0 * h)


def same_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let steps that the error chooses be those of the first motion."""
    found: list[Any] = []
    chosen = gradients._chosen_steps

    def once(*arguments: Any) -> Any:
        found.append(found[0] if found else chosen(*arguments))
        return found[0]

    monkeypatch.setattr(gradients, "_chosen_steps", once)


@pytest.fixture(scope="module")
def case(built: Build) -> Case:
    return Case(built(robot_of(5), *ROLLED, *GRADIENTS, *SLOPED))


@pytest.mark.parametrize("method", METHODS)
def test_against_scipy(method: str, case: Case) -> None:
    """Drives are held over a step, and the controller follows the state within it."""
    kernel, x, n = case.kernel, case.x, case.kernel.n
    y, wanted = np.concatenate([x["q0"], x["v0"]]), []
    for k in range(STEPS):

        def rate(_: float, y: Array, k: int = k) -> Array:
            u = np.clip(case.asked(y[:n], y[n:])[k], -case.effort, case.effort)
            return np.concatenate([y[n:], kernel.forward_dynamics(y[:n], y[n:], u)])

        y = solve_ivp(rate, (0.0, DT), y, method="DOP853", rtol=1e-10, atol=1e-12, max_step=DT / 4).y[:, -1]
        wanted.append(y[:n])
    how: dict[str, Any] = {**METHODS[method], **({"rtol": 1e-9} if method in ("rosenbrock", "tsit5") else {})}
    if method == "implicit":  # of first order
        x = {name: np.repeat(value, 16, axis=0) if value.ndim > 1 else value for name, value in x.items()}
        how = {"dt": DT / 16, "steps": 16 * STEPS, "every": 16}
    found = case.kernel.rollout(**x, method=method, saturate=case.effort, **how)[0][1:]
    free = case.kernel.rollout(**x, method=method, **how)[0][1:]
    size = np.abs(free - found).max()
    off = np.abs(np.array(wanted) - found).max()
    assert size > 1e-4
    assert off < {"rk4": 1e-3, "implicit": 0.05}.get(method, 1e-4) * size


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_bits_stay_where_nothing_is_clipped(dtype: str, built: Build) -> None:
    """And many states have those of each alone, in lanes that are clipped beside others that are not."""
    case = Case(built(robot_of(5), "rollout", "adaptive_rollout", dtype=dtype))
    case.x = {name: value.astype(dtype) for name, value in case.x.items()}
    rng, options = np.random.default_rng(1), {"rtol": 1e-5}
    q0 = (case.x["q0"] + rng.uniform(-0.3, 0.3, (21, case.kernel.n))).astype(dtype)
    for method, how in METHODS.items():
        more = {**how, **(options if "duration" in how else {})}
        free = case.kernel.rollout(**case.x, method=method, **more)
        loose = case.kernel.rollout(**case.x, method=method, saturate=1e9 * np.ones(case.kernel.n), **more)
        assert all(np.array_equal(a, b) for a, b in zip(free, loose, strict=True))
        shared = {name: x if x.ndim == 1 else x[np.newaxis] for name, x in case.x.items() if name != "q0"}
        many = case.kernel.rollout(q0, method=method, saturate=case.effort, **{**shared, **more})
        for i in (0, 7, 20):
            alone = case.kernel.rollout(q0[i], method=method, saturate=case.effort, **shared, **more)
            assert np.array_equal(alone[0][0] if alone[0].ndim == 3 else alone[0], many[0][i])


@pytest.mark.parametrize("method", METHODS)
def test_gradients_against_differences(method: str, case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same steps, by states, drives, targets and gains; sensitivities are the same."""
    same_steps(monkeypatch)
    rng, (_, by) = np.random.default_rng(2), case.gradient(method)
    clipped = np.abs(case.asked(case.x["q0"], case.x["v0"]))[:, case.driven] > case.effort[case.driven]
    assert 0.2 < clipped.mean() < 0.8
    for given, label in (("q0", "q"), ("v0", "v"), ("u", "u"), ("target", "target"), ("kp", "kp"), ("kd", "kd")):
        direction = rng.uniform(-1.0, 1.0, case.x[given].shape) * (case.x["kp"] > 0 if given in ("kp", "kd") else 1.0)
        wanted = case.slope(method, given, direction)
        assert (by[label] * direction).sum() == pytest.approx(wanted, rel=1e-6, abs=1e-8), given
    along = {"q": np.eye(case.kernel.n), "v": np.zeros((case.kernel.n,) * 2)}
    _, (dq, dv) = case.kernel.rollout_sensitivity(
        **case.x, method=method, along=along, saturate=case.effort, **METHODS[method]
    )
    of_q, of_v = case.weights()
    np.testing.assert_allclose((dq * of_q[:, None] + dv * of_v[:, None]).sum(axis=(0, 2)), by["q"], rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_slopes_of_what_is_clipped_and_of_what_is_at_its_effort(method: str, case: Case) -> None:
    n, i = case.kernel.n, case.driven[0]
    u, state = np.zeros(n), {"q0": case.x["q0"], "v0": case.x["v0"]}
    u[i] = 2.0

    def by_u(effort: float) -> Array:
        how = {**METHODS[method], "saturate": {case.kernel.coordinates[i]: effort}, "loss": case.loss}
        return np.asarray(case.kernel.rollout_gradient(**state, u=u, method=method, **how)[1]["u"])

    free = case.kernel.rollout_gradient(**state, u=u, method=method, loss=case.loss, **METHODS[method])[1]["u"]
    assert by_u(1.0)[i] == 0.0
    assert by_u(2.0)[i] == pytest.approx(free[i], rel=1e-12)
    assert free[i] != 0.0


def loads_of(case: Case) -> InputSignals:
    """A program that gains follow, a force, and a wrench, which is not clipped."""
    place = np.array(case.driven)
    m = place.size
    knots = np.linspace(0.0, STEPS * DT, 5)
    samples = np.random.default_rng(8).uniform(-0.3, 0.3, (5, m))
    gains = Gains(np.full(m, 60.0), np.full(m, 1.0))
    drive = DriveData(Track(Signal.constant(np.full(m, 0.5)), place), Track(Signal.through(knots, samples), place))
    drive = DriveData(drive.torque, drive.program, np.ones(m), gains)
    return InputSignals(drive, [LinkWrench(0, Signal.constant([3.0, -2.0, 5.0, 0.1, 0.2, -0.3]))])


@pytest.mark.parametrize("method", ["rosenbrock", "tsit5"])
def test_loads_are_clipped_without_their_wrenches(method: str, case: Case) -> None:
    """As SciPy integrates them in Python; the works of clipped drives balance."""
    kernel, n, loads = case.kernel, case.kernel.n, loads_of(case)
    program, gains = loads.drive.program, loads.drive.gains
    assert program is not None
    assert gains is not None
    place, wrench = program.place, np.zeros((len(kernel.links), 6))
    wrench[0] = loads.wrenches[0].signal.coefficients[0, 0]
    effort = np.full(n, np.inf)
    effort[place] = 4.0

    def drive(t: float, q: Array, v: Array) -> Array:
        u = np.zeros(n)
        k = int(np.clip(np.searchsorted(program.signal.knots, t, side="right") - 1, 0, 3))
        first, slope = program.signal.coefficients[k]
        x = first + slope * (t - program.signal.knots[k])
        u[place] = 0.5 + gains.kp * (x - q[place]) + gains.kd * (slope - v[place])
        return np.clip(u, -effort, effort)

    def rate(t: float, y: Array) -> Array:
        u = drive(t, y[:n], y[n:]) + kernel.external_force(y[:n], wrench)
        return np.concatenate([y[n:], kernel.forward_dynamics(y[:n], y[n:], u)])

    state = {"q0": case.x["q0"], "v0": case.x["v0"]}
    begin = np.concatenate([state["q0"], state["v0"]])
    end = STEPS * DT
    wanted = solve_ivp(rate, (0.0, end), begin, method="DOP853", rtol=1e-10, atol=1e-13, max_step=DT / 4).y[:n, -1]
    how = {"method": method, "duration": end, "samples": 40, "rtol": 1e-9, "works": True, "loads": loads}
    found = kernel.rollout(**state, saturate=effort, **how)
    free = kernel.rollout(**state, **how)
    size = np.abs(free[0][-1] - found[0][-1]).max()
    assert size > 1e-3
    assert np.abs(found[0][-1] - wanted).max() < 1e-5 * size
    energy = np.diff(kernel.energy(found[0], found[1]).sum(axis=1)[[0, -1]])[0]
    drives, _, wrenches, dissipated = found.works[-1]
    assert abs(drives + wrenches - dissipated - energy) < 1e-6 * np.abs(found.works[-1]).max()
    assert abs(drives - free.works[-1, 0]) > 1e-2 * abs(drives)


@pytest.mark.parametrize("method", METHODS)
def test_gradients_under_loads(method: str, case: Case) -> None:
    """Back and forth agree, and the wrench acts on what is clipped, too."""
    effort = {case.kernel.coordinates[i]: 4.0 for i in case.driven}
    state = {"q0": case.x["q0"], "v0": case.x["v0"], "loads": loads_of(case), "saturate": effort}
    by = case.kernel.rollout_gradient(**state, method=method, loss=case.loss, **METHODS[method])[1]
    along = {"q": np.eye(case.kernel.n), "v": np.zeros((case.kernel.n,) * 2)}
    _, (dq, dv) = case.kernel.rollout_sensitivity(**state, method=method, along=along, **METHODS[method])
    of_q, of_v = case.weights()
    np.testing.assert_allclose((dq * of_q[:, None] + dv * of_v[:, None]).sum(axis=(0, 2)), by["q"], rtol=1e-8)
    free = {**state, "saturate": None}
    other = case.kernel.rollout_gradient(**free, method=method, loss=case.loss, **METHODS[method])[1]
    assert np.abs(other["q"] - by["q"]).max() > 1e-3 * np.abs(by["q"]).max()
    assert np.abs(by["loads"]["wrench[0]"]).max() > 0.0


def test_a_mechanism_whose_drive_is_clipped(built: Build) -> None:
    """Loops stay closed; Python integrates the same by its own steps."""
    kernel = built(eomgen.load_robot("four_bar"), *ROLLED, *CLOSED)
    q = kernel.assemble([0.5, 0.2, 1.2])
    v, i = np.zeros(kernel.n), kernel.raw.libraries.meta["driven"][0]
    kp, target = np.zeros(kernel.n), np.full(kernel.n, 3.0)
    kp[i] = 50.0
    effort = {kernel.coordinates[i]: 0.7}
    how = {"kp": kp, "kd": 0.0 * kp, "target": target, "duration": 0.2, "samples": 4, "rtol": 1e-9}
    ends = [kernel.rollout(q, v, method=method, saturate=effort, **how)[0] for method in ("tsit5", "rosenbrock")]
    assert np.abs(ends[0] - ends[1]).max() < 1e-6

    def drive(_: float, q: Array, v: Array) -> Array:
        u = np.zeros(kernel.n)
        u[i] = np.clip(kp[i] * (3.0 - q[i]), -0.7, 0.7)
        return u

    wanted = integrate(kernel, q, v, 0.2, drive=drive, method="DOP853", rtol=1e-9)
    assert np.abs(wanted.q[-1] - ends[0][-1]).max() < 1e-6
    assert np.abs(wanted.q[-1] - kernel.rollout(q, v, method="tsit5", **how)[0][-1]).max() > 1e-3


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_gradients_of_a_mechanism(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops are closed after steps whose drive is clipped, and differentiated with that."""
    kernel = built(eomgen.load_robot("four_bar"), *ROLLED, *CLOSED, *GRADIENTS)
    case = Case(kernel)
    case.x["q0"] = kernel.assemble([0.5, 0.2, 1.2])
    case.x["v0"] = kernel.project_velocity(case.x["q0"], [1.0, 0.0, 0.0])
    i = case.driven[0]
    case.effort[i] = np.median(np.abs(case.asked(case.x["q0"], case.x["v0"])[:, i]))
    same_steps(monkeypatch)
    rng, (_, by) = np.random.default_rng(2), case.gradient(method)
    for given in ("u", "target", "kp", "kd"):
        direction = rng.uniform(-1.0, 1.0, case.x[given].shape) * (case.x["kp"] > 0 if given in ("kp", "kd") else 1.0)
        assert (by[given] * direction).sum() == pytest.approx(case.slope(method, given, direction), rel=1e-5, abs=1e-7)


def test_what_cannot_be_clipped_is_named(case: Case, built: Build) -> None:
    kernel, state = case.kernel, (case.x["q0"], case.x["v0"])
    name = kernel.coordinates[case.driven[0]]
    for saturate, kind, message in (
        (True, InputError, "no drive has a limit of its effort"),
        ({}, InputError, "no drive has a limit of its effort"),
        ({"joint9.gamma": 1.0}, UnknownNameError, "there is no coordinate 'joint9.gamma'"),
        ({name: -1.0}, InputError, f"{name} is -1.0; allowed: a number above 0"),
        ({name: float("nan")}, InputError, f"{name} is nan; allowed: a number above 0"),
        ({name: "much"}, InputError, "'much'; allowed: a number above 0"),
        (np.ones(kernel.n + 1), ArrayError, r"numbers of shape"),
        (2.0, ArrayError, "got 2.0; allowed: True, efforts by coordinate"),
    ):
        for method, how in METHODS.items():
            with pytest.raises(kind, match=message):
                kernel.rollout(*state, method=method, saturate=saturate, **({"u": np.zeros(kernel.n)} | how))
    given = built(some_prescribed(robot_of(5), 1), "adaptive_rollout")
    what = given.prescribed[0]
    with pytest.raises(InputError, match=f"{what} has 2, but its motion is prescribed; allowed: drives"):
        given.rollout(np.zeros(given.n), np.zeros(given.n), method="tsit5", duration=1.0, saturate={what: 2.0})
    loads = InputSignals(DriveData(effort=np.zeros(kernel.n)))
    with pytest.raises(InputError, match=r"loads: drive\.effort: .* is 0\.0; allowed: a number above 0"):
        kernel.rollout(*state, method="tsit5", duration=1.0, loads=loads)
