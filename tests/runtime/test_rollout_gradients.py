"""Gradients and sensitivities of rollouts: against differences, each other and complex steps, and what is refused."""

from __future__ import annotations

import cmath
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.tableaus import transformed
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.errors import ArrayError, InputError, IntegrationStopped, UnknownNameError
from eomgen.kernel.stepping import gradients, sensitivities
from eomgen.kernel.stepping.input_signals import InputSignals, LinkWrench, MechanismData, Signal, Track, Waves
from eomgen.kernel.stepping.methods import TABLE
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.complex_step import COMPLEX
from tests.support.builds import Build
from tests.support.random_robots import random_robot, some_prescribed
from tests.support.refusals import refused
from tests.support.rollout_cases import (
    ALL,
    CHOSEN,
    CLOSED,
    DT,
    FIXED,
    JOINTS,
    KINDS,
    LAWS,
    LOADED,
    METHODS,
    SLOW,
    STEPS,
    TIMES,
    Case,
    assembled,
    case_of,
    frozen,
    loads_of,
    signal,
    under_loads,
)

pytestmark = [
    pytest.mark.usefixtures("unoptimised"),
    pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning"),
]
EVERY = [pytest.param(kind, marks=[pytest.mark.soak] if kind in SLOW else []) for kind in KINDS]
BARE = ("rollout", "explicit_gradient", "explicit_sensitivity", "external_force", "inverse_dynamics")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", EVERY)
def test_against_differences(kind: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """By states, drives, targets, gains, parameters and all numbers of loads; of the same steps."""
    frozen(monkeypatch)
    case_of(built, kind, method).check_differences(h=1e-7 if kind == "stops" else 1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", EVERY)
def test_sensitivities_are_gradients(kind: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighted and summed up they are what goes back through the steps; in parts of steps to the bit."""
    case = case_of(built, kind, method)
    case.check_sensitivities(1e-9 if kind in LAWS else 1e-11)
    whole = case.sensitivity()
    monkeypatch.setattr(sensitivities, "SEGMENT", 1)
    monkeypatch.setattr(sensitivities, "SHORTEST", 5)
    for one, other in zip(whole, case.sensitivity(), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["one_link", "hysteresis", "clipped"])
def test_values_are_those_of_the_rollout(kind: str, method: str, built: Build) -> None:
    """Also where nothing distinguishes samples, so that steps with error control do not end there."""
    case = case_of(built, kind, method)
    case.given |= {name: x[0] for name, x in case.given.items() if name in ("u", "target") and x.ndim == 2}
    if METHODS[method] is CHOSEN:
        case.options.setdefault("rtol", 1e-8)
    motion = case.call("rollout")
    samples = *motion, *([motion.z] if "z" in case.given else [])
    assert case.gradient()[0] == pytest.approx(case.loss(np.zeros(len(motion[0])), *samples)[0], rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("kind", "every"), [("one_link", 1), ("one_link", 3), ("prescribed", 1)])
def test_parts_of_long_motions_are_stepped_through_again(
    kind: str, every: int, method: str, built: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, whatever is kept; into arrays to write to, whatever they held."""
    case = case_of(built, kind, method)
    if METHODS[method] is FIXED:
        case.options["every"] = every
    value, found = case.gradient()
    arrays = {name: x for name, x in found.items() if isinstance(x, np.ndarray)}
    monkeypatch.setattr(gradients, "KEPT", 0)
    monkeypatch.setattr(gradients, "SHORTEST", 1)
    for names in ((), tuple(arrays), ("u", "q")):
        out = {name: np.full_like(arrays[name], np.nan) for name in names}
        again, other = case.gradient(out=out)
        assert again == value
        assert all(other[name] is x for name, x in out.items())
        for one, two in ((found, other), (found.get("loads", {}), other.get("loads", {}))):
            assert one.keys() == two.keys()
            assert all(np.array_equal(x, two[name]) for name, x in one.items() if name != "loads")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["one_link", "prescribed", pytest.param("hysteresis", marks=pytest.mark.soak)])
def test_many_states(kind: str, method: str, built: Build) -> None:
    """Each to the bit as alone, forwards and backwards, in given arrays too; what all share adds up."""
    case = case_of(built, kind, method)
    states = {name: np.array([s * case.given[name] for s in (1.0, -1.0, 0.5)]) for name in ("q", "u")}
    many = states | {"target": case.given["target"][None]} if "target" in case.given else states
    each = [loads_of(case.kernel, seed) for seed in (5, 6, 5)] if "loads" in case.given else None
    _, shared = case.gradient(**many)
    out = {name: np.full_like(shared[name], np.nan) for name in many if not case.kernel.internal_states}
    _, found = case.gradient(**many, **({"out": out} if out else {}), **({"loads": each} if each else {}))
    assert all(found[name] is x for name, x in out.items())
    alone = [case.gradient(**{name: x[i] for name, x in states.items()})[1] for i in range(3)]
    for name in alone[0].keys() - {*states, "loads"}:
        total = np.reshape(sum(x[name] for x in alone), np.shape(shared[name]))
        np.testing.assert_allclose(shared[name], total, rtol=1e-9, atol=1e-12 * np.abs(total).max() + 1e-15)
    for name, x in shared.get("loads", {}).items():
        total = sum(own["loads"][name] for own in alone)
        np.testing.assert_allclose(x, total, rtol=1e-12, atol=1e-13 * np.abs(total).max())
    rows = {name: x[None] for name, x in case.given.items() if name in ("u", "target") and x.ndim == 2}
    forwards = case.sensitivity(q=states["q"], **rows)
    for i in range(3):
        row = {name: x[i] for name, x in states.items()} | ({"loads": each[i]} if each else {})
        own = case.gradient(**row)[1]
        assert all(np.array_equal(found[name][i], own[name]) for name in states)
        for name, x in own.get("loads", {}).items():
            np.testing.assert_array_equal(found["loads"][i][name], x)
        single = case.sensitivity(q=row["q"])
        assert all(np.array_equal(x[i], y) for x, y in zip(forwards, single, strict=True))


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["one_link", "loads", *LAWS])
def test_single_precision(kind: str, method: str, built: Build) -> None:
    double, single = case_of(built, kind, method), case_of(built, kind, method, dtype="float32")
    single.given |= {name: x.astype(np.float32) for name, x in single.given.items() if isinstance(x, np.ndarray)}
    if "loads" in double.given:
        single.given["loads"] = double.given["loads"]
    for options in (single.options, double.options):
        options |= {"rtol": 1e-5, "atol": 1e-6} if "duration" in options else {}
    (_, found), (_, wanted) = single.gradient(), double.gradient()
    loads = (found.pop("loads", {}), wanted.pop("loads", {}))
    for of_single, of_double in ((found, wanted), loads):
        for name, x in of_double.items():
            np.testing.assert_allclose(of_single[name], x, rtol=5e-3, atol=5e-3 * np.abs(x).max() + 1e-6, err_msg=name)


@pytest.mark.soak
def test_drives_that_are_left_out_are_zero(built: Build) -> None:
    """As those of a rollout are; sensitivities too."""
    case = case_of(built, "one_link", "rk4")
    case.given = {name: case.given[name] for name in "qv"}
    zeros = np.zeros(case.kernel.n)
    (value, by), (wanted, of_zeros) = case.gradient(), case.gradient(u=zeros)
    assert value == wanted
    assert by["gravity.y"] == of_zeros["gravity.y"] != 0.0
    own = {"parameters": case.parameters}
    for x, y in zip(
        case.call("rollout_sensitivity", **own), case.call("rollout_sensitivity", u=zeros, **own), strict=True
    ):
        np.testing.assert_array_equal(x, y)


def test_arrays_of_sensitivities_to_write_to(built: Build) -> None:
    case = case_of(built, "one_link", "rk4")
    wanted = case.sensitivity()
    out = [np.full_like(x, np.nan) for x in wanted]
    for own, result, x in zip(out, case.sensitivity(out=out), wanted, strict=True):
        assert result is own
        np.testing.assert_array_equal(own, x)
    refused(ArrayError, r"out: .* expected four arrays", case.sensitivity, out=out[:2])
    short = [x[1:] for x in out]
    refused(ArrayError, r"out: expected float64 of shape \(13, 2\)", case.sensitivity, out=short)


@pytest.mark.soak
def test_a_mechanism_whose_only_freedom_is_prescribed(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages solve for nothing, and derivatives by what follows their factors are found all the same."""
    frozen(monkeypatch)
    robot = eomgen.load_robot("four_bar")
    crank, *others = robot.joints
    key, value = next(iter(crank.coordinates.items()))
    crank = replace(crank, coordinates={**crank.coordinates, key: replace(value, prescribed=True)})
    kernel = built(replace(robot, driven=(), joints=(crank, *others)), *LOADED, *CLOSED)
    track = Track(signal(np.random.default_rng(1), 1, 0.1), np.array([0]))
    loads = InputSignals(prescribed=Waves(np.array([[0.1, 8.0, 0.3, 0.5]]), [track]))
    case = Case(kernel, "rosenbrock", {**assembled(kernel), "u": np.zeros(3), "loads": loads})
    case.parameters = ("gravity.x", "gravity.y", "gravity.z")
    case.check_differences(floor=1e-8)
    found = case.gradient()[1]
    assert [found[name] for name in case.parameters] == pytest.approx([0.0] * 3, abs=1e-12)  # what moves is given
    assert found["gravity.z"] == 0.0  # across its plane


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("method", METHODS)
def test_random_robots(method: str, seed: int, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """With and without prescribed coordinates, under all loads."""
    frozen(monkeypatch)
    robot = random_robot(7000 + seed, joints=(2, 4), types=JOINTS)
    case = under_loads(built(some_prescribed(robot, seed) if seed % 2 else robot, *ALL), method, seed)
    case.check_differences()
    case.check_sensitivities(1e-9)


def test_a_profile_in_the_place_of_time(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives by the path, whose profile counts as given."""
    case = case_of(built, "loads", "rk4")
    profile = Signal(np.array([0.0, 1.0]), np.array([[[0.0], [9.0], [300.0]]]))
    drive = case.given["loads"].drive
    path = replace(drive.program, signal=replace(drive.program.signal, profile=profile))
    model = loads_of(case.kernel).drive.model
    case.given["loads"] = replace(case.given["loads"], drive=replace(drive, program=path, model=model))
    case.check_differences()


def test_samples() -> None:
    """Straight lines: derivatives by samples are those of what goes through them."""
    rng = np.random.default_rng(2)
    times, samples = np.array([0.0, 0.5, 0.6, 2.0]), rng.uniform(-1.0, 1.0, (4, 2))
    by, moved = rng.uniform(-1.0, 1.0, (3, 2, 2)), rng.uniform(-1.0, 1.0, (4, 2))
    line = Signal.through(times, samples)
    assert line.coefficients[:, 0] == pytest.approx(samples[:-1])
    assert (line.coefficients[:, 0] + line.coefficients[:, 1] * np.diff(times)[:, None]) == pytest.approx(samples[1:])
    wanted = (by * (Signal.through(times, samples + moved).coefficients - line.coefficients)).sum()
    assert (line.by_samples(by) * moved).sum() == pytest.approx(wanted, rel=1e-12)


def test_what_is_wrong_is_named(built: Build) -> None:
    case = case_of(built, "one_link", "rk4")
    gradient, x = case.gradient, case.given
    radau = {"method": "radau", "duration": 0.1, "dt": None, "steps": None, "u": x["u"][0], "target": x["target"][0]}
    none = "'radau' has no derivatives; allowed: rk4, tsit5, implicit, rosenbrock"
    two = dict.fromkeys(("q", "v"), np.zeros(2))
    message = r"loss: it returned 1.0; allowed: \(value, dq, dv\)"
    refused(InputError, message, gradient, loss=lambda t, q, v: 1.0)
    message = r"loss: dq has shape \(2,\); expected \(13, 2\), that of q"
    refused(ArrayError, message, gradient, loss=lambda t, q, v: (1.0, q[0], v))
    message = "loss: dv has numbers that are not finite"
    refused(ArrayError, message, gradient, loss=lambda t, q, v: (1.0, q, v * np.nan))
    refused(InputError, "steps = 0 is not a whole number", gradient, steps=0)
    refused(UnknownNameError, "parameters: 'mass' is unknown", gradient, parameters=("mass",))
    message = r"out: 'gravity.y' is unknown; allowed: 'q', 'v', 'u'"
    refused(InputError, message, gradient, out={"gravity.y": np.zeros(2)})
    refused(InputError, r"out: .* is no mapping", gradient, out=np.zeros(2))
    refused(ArrayError, r"out: expected float64 of shape \(12, 2\)", gradient, out={"u": np.zeros(2)})
    refused(ArrayError, "out: overlaps an argument", gradient, out={"u": x["u"]})
    refused(ArrayError, "out: overlaps an argument", gradient, out=two)
    refused(IntegrationStopped, r"^rollout: ", gradient, dt=5.0)
    refused(InputError, none, gradient, **radau)
    along, call = {"q": np.eye(2)}, case.call
    name = "rollout_sensitivity"
    refused(InputError, none, call, name, along=along, **radau)
    refused(InputError, "there is no direction; allowed: parameters or along", call, name)
    message = "along: 'w' is unknown; allowed: 'q', 'v', 'u'"
    refused(InputError, message, call, name, along={"w": np.zeros((1, 2))})
    message = r"along: q has shape \(2,\); expected \(directions, 2\)"
    refused(ArrayError, message, call, name, along={"q": np.zeros(2)})
    message = "along: 1 of q, 2 of v; expected as many directions of each"
    refused(ArrayError, message, call, name, along={"q": np.zeros((1, 2)), "v": np.zeros((2, 2))})
    refused(UnknownNameError, "parameters: 'mass' is unknown", call, name, parameters=("mass",))
    refused(InputError, "method 'euler' is unknown", call, name, along=along, method="euler")
    refused(IntegrationStopped, r"^rollout: ", call, name, along=along, dt=5.0)
    bare, without = built(eomgen.load_robot("one_link"), "rollout"), "without the kernel explicit"
    refused(UnknownNameError, f"{without}_gradient", gradient, kernel=bare)
    refused(UnknownNameError, f"{without}_sensitivity", call, name, along=along, kernel=bare)


def test_loads_without_derivatives_are_named(built: Build) -> None:
    case = case_of(built, "loads", "rk4")
    gradient, loads, sensitivity = case.gradient, case.given["loads"], case.sensitivity
    refused(InputError, r"rollout: loads: 'drives' is unknown", gradient, loads={"drives": 1})
    q = np.tile(case.given["q"], (3, 1))
    refused(ArrayError, "2 states in loads, but 3 in other arrays", gradient, q=q, loads=[loads] * 2)
    model = loads.drive.model
    looped = replace(model, mechanism=MechanismData([], [], np.zeros(2, bool)))
    other = replace(loads, drive=replace(loads.drive, model=looped))
    message = "loads: drive.model.mechanism has no derivatives"
    refused(InputError, f"rollout_gradient: {message}", gradient, loads=other)
    refused(InputError, f"rollout_sensitivity: {message}", sensitivity, loads=other)
    bare = {"kernel": built(eomgen.load_robot("one_link"), *BARE)}
    pull = InputSignals(wrenches=[LinkWrench(0, Signal.constant(np.ones(6)))])
    message = "without the kernel external_force_"
    refused(UnknownNameError, f"{message}parameter_adjoint", gradient, loads=pull, **bare)
    refused(UnknownNameError, f"{message}tangent", sensitivity, loads=pull, **bare)
    known = replace(model, calls=bare["kernel"].calls)
    other = replace(loads, wrenches=[], drive=replace(loads.drive, model=known))
    refused(UnknownNameError, "without the kernel inverse_dynamics_adjoint", gradient, loads=other, **bare)
    message = "rk4 comes to an end that is not finite"
    refused(InputError, message, gradient, dt=5.0, loads=InputSignals())


class Evaluated:
    """Steps of all methods by the programs themselves, evaluated with complex numbers."""

    names: tuple[str, ...] = ("forward_dynamics", "implicit_step", "stage_factors", "stage_solution")

    def __init__(self, robot: Robot, values: dict[str, np.ndarray]) -> None:
        self.model, self.values = build_model(robot), values
        self.programs = {name: derive(self.model, name) for name in self.names}
        self.begin, self.dt = 0.0, 0.0

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
        table = next(row for row in TABLE if row.name == method)
        rates: list[np.ndarray] = []
        for shares in table.a[: 4 if method == "rk4" else 6]:
            moved = sum((dt * w * k for w, k in zip(shares, rates, strict=False)), np.zeros((2, q.size), complex))
            q_here, v_here = np.array([q, v]) + moved
            rates.append(np.array([v_here, self.accelerations(row, q_here, v_here, sum(shares))]))
        q, v = np.array([q, v]) + sum(dt * w * k for w, k in zip(table.weights, rates, strict=False))
        return q, v

    def rosenbrock(self, row: int, dt: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        method = next(row for row in TABLE if row.name == "rosenbrock")
        ahead, back, weight, _ = transformed(method)
        c = method.gamma[0][0] * dt
        kept = self.run("stage_factors", q=q, v=v, times=np.array([c, c * c]), **self.gains())
        parts: list[np.ndarray] = []
        for more, less, part in zip(ahead, back, map(sum, method.a), strict=True):
            start = np.zeros((2, q.size), complex)
            q_here, v_here = np.array([q, v]) + sum((w * x for w, x in zip(more, parts, strict=False)), start)
            a = self.accelerations(row, q_here, v_here, part)
            shift, rate = np.array([v_here, a]) + sum((w / dt * x for w, x in zip(less, parts, strict=False)), start)
            v_part = c * (rate + self.run("stage_solution", kept=kept, rates=rate, shifts=shift))
            parts.append(np.array([c * (v_part + shift), v_part]))
        q, v = np.array([q, v]) + sum(w * x for w, x in zip(weight, parts, strict=True))
        return q, v


class UnderLoads(Evaluated):
    """Steps under forces, gains, a model and a wrench, all of them complex."""

    names = (*Evaluated.names, "inverse_dynamics", "external_force")
    places, links, chosen = np.zeros(0, int), 0, False

    def column(self, name: str, part: float) -> np.ndarray:
        """Columns of a signal, rates and accelerations; where steps end at knots, of the piece that is inside."""
        t, inside = self.begin + part * self.dt, self.begin + min(max(part, 1e-3), 1.0 - 1e-3) * self.dt
        k = min(int(np.searchsorted(TIMES, inside if self.chosen else t, side="right")) - 1, len(TIMES) - 2)
        found = [np.polynomial.Polynomial(x) for x in self.values[name][k].T]
        return np.array([[x.deriv(i)(t - TIMES[k]) if i else x(t - TIMES[k]) for x in found] for i in range(3)])

    def gains(self) -> dict[str, np.ndarray]:
        found = {name: np.zeros(self.model.size, complex) for name in ("kp", "kd")}
        for name, x in found.items():
            x[self.places] += self.values[f"drive.gains.{name}"] / self.values["ratio"] ** 2
        return found

    def held(self, row: int, q: np.ndarray, v: np.ndarray, share: float) -> np.ndarray:
        x, p = self.values, self.places
        u, ratio, b = x["u"].astype(complex), x["ratio"], x["drive.model.bandwidth"]
        u[p[:1]] += self.column("drive.torque", share)[0]
        goal, rate, second = self.column("drive.program", share)
        gain, damper = x["drive.gains.kp"], x["drive.gains.kd"]
        u[p] += (gain * (goal - q[p] / ratio) + damper * (rate - v[p] / ratio)) / ratio
        seen, speed = q / 1.1, v / 1.1
        a = np.zeros(q.size, complex)
        a[p] = second + b * (b * (goal - seen[p]) + 2.0 * (rate - speed[p]))
        u += self.run("inverse_dynamics", q=seen, v=speed, a=a) / 1.1
        wrench = np.zeros((self.links, 6), complex)
        wrench[-1] = self.column("wrench[0]", share)[0]
        return u + self.run("external_force", q=q, wrench=wrench.ravel())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["one_link", "elastic"])
def test_equal_to_complex_steps_of_the_programs(
    kind: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By everything that a rollout reads, all samples of sensitivities too, by the steps that were taken."""
    taken: list[gradients.Steps] = []
    chosen = gradients._chosen_steps
    monkeypatch.setattr(gradients, "_chosen_steps", lambda *x: taken.append(chosen(*x)) or taken[-1])
    robot = eomgen.load_robot("one_link")
    case = case_of(built, kind, method) if kind == "one_link" else under_loads(built(robot, *ALL), method)
    drive, rng = None, np.random.default_rng(3)
    if kind == "elastic":
        loads = case.given["loads"]
        case.given["loads"], drive = replace(loads, wrenches=loads.wrenches[:1]), loads.drive
    weights = rng.uniform(-1.0, 1.0, (2, STEPS + 1, case.kernel.n))
    _, by = case.gradient(loss=lambda t, q, v: (0.0, *weights))
    steps = taken[0] if taken else None
    lengths, rows = ([DT] * STEPS, range(STEPS)) if steps is None else (steps.dt, steps.rows)
    times = DT * np.arange(STEPS + 1) if steps is None else steps.times
    samples = range(STEPS + 1) if steps is None else steps.sample_index
    by |= {"p": np.array([by.pop(name) for name in case.parameters]), **by.pop("loads", {})}
    values = np.array(list(case.kernel.parameters.values()))
    given = {name: values if name == "p" else case.numbers(name) for name in by}
    ratio = {} if drive is None else {"ratio": drive.ratio}

    def moved(rates: dict[str, np.ndarray]) -> np.ndarray:
        values = {name: x + 1e-30j * rates.get(name, np.zeros_like(x)) for name, x in given.items()} | ratio
        evaluated = (Evaluated if drive is None else UnderLoads)(robot, values)
        if drive is not None:
            evaluated.places, evaluated.links = drive.program.place, len(case.kernel.links)
            evaluated.chosen = steps is not None
        states = [(values["q"], values["v"])]
        for evaluated.begin, evaluated.dt, row in zip(map(float, times), map(float, lengths), rows, strict=False):
            states.append(evaluated.step(method, row, evaluated.dt, *states[-1]))
        return np.array([states[i] for i in samples]).imag.swapaxes(0, 1) * 1e30

    if kind == "one_link":
        _, _, dq, dv = case.sensitivity()
        for i in range(2):
            for found, wanted in zip((dq, dv), moved({x: own[i] for x, own in case.along().items()}), strict=True):
                np.testing.assert_allclose(found[:, i], wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    if drive is not None:  # the model's parameters are its own
        by.pop("p")
    rates = {name: rng.uniform(-1.0, 1.0, given[name].shape) * np.maximum(np.abs(given[name]), 1e-3) for name in by}
    found = sum(float((by[name] * x).sum()) for name, x in rates.items())
    assert found == pytest.approx(float((moved(rates) * weights).sum()), rel=1e-9)
