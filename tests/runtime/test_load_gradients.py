"""Gradients and sensitivities of rollouts under loads that are data: against differences, each other and rollouts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError
from eomgen.runtime.stepping import gradients
from eomgen.runtime.stepping.input_signals import (
    DriveData,
    Gains,
    InputSignals,
    LinkWrench,
    MechanismData,
    ModelDrive,
    Signal,
    Track,
    Waves,
)
from tests.runtime.test_rollout_gradients import DT, KERNELS, METHODS, STEPS, Loss, frozen
from tests.runtime.test_rollout_sensitivities import Evaluated
from tests.support.builds import Build
from tests.support.random_robots import random_robot, some_prescribed
from tests.support.soak import share

pytestmark = pytest.mark.usefixtures("unoptimised")

SENSITIVITIES = ("explicit_sensitivity", "implicit_sensitivity", "rosenbrock_sensitivity")
FORCES = ("external_force", "external_force_parameter_adjoint", "external_force_tangent")
POSES = ("kinematics", "frame_pose_parameter_adjoint", "frame_pose_tangent", "frame_pose_parameter_tangent")
MODELS = ("inverse_dynamics", "inverse_dynamics_adjoint", "inverse_dynamics_tangent")
ALL = (*KERNELS, *SENSITIVITIES, *FORCES, "external_force_parameter_tangent", *POSES, *MODELS)
TIMES = np.array([-0.1, 0.4, 0.93, 1.7]) * STEPS * DT  # from before the beginning to behind the end


def signal(rng: np.random.Generator, columns: int, size: float = 1.0) -> Signal:
    """Cubics that jump from piece to piece."""
    shape = (len(TIMES) - 1, 4, columns)
    return Signal(TIMES, size * rng.uniform(-1.0, 1.0, shape) / (STEPS * DT) ** np.arange(4)[:, None])


def loads_of(kernel: eomgen.Kernel, model: eomgen.Kernel | None, *, seed: int = 5, holds: bool = False) -> InputSignals:
    """Everything at once: forces, gains and a model that follow a program, wrenches of all kinds, given motions."""
    rng, n = np.random.default_rng(seed), kernel.n
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    free = np.setdiff1d(np.arange(n), given)
    gains = Gains(rng.uniform(20.0, 40.0, free.size), rng.uniform(1.0, 2.0, free.size))
    ratio, knows = rng.uniform(0.8, 1.5, free.size), None
    if model is not None:
        column = np.full(n, -1)
        column[free] = np.arange(free.size)
        place, follows = np.arange(n), np.full(n, -1)
        follows[given] = np.arange(len(given))
        knows = ModelDrive(model.calls, place, np.full(n, 1.1), column, follows, None if holds else 12.0)
    drive = DriveData(
        Track(signal(rng, 1, 5.0), free[:1]), Track(signal(rng, free.size, 0.2), free), ratio, gains, knows
    )
    last, arm = len(kernel.links) - 1, np.array([0.1, -0.05, 0.2])
    pulls = [LinkWrench(last, signal(rng, 6, 3.0)), LinkWrench(last, signal(rng, 6, 3.0), arm)]
    pulls += [LinkWrench(0, signal(rng, 6, 3.0), arm, t0=0.01, t1=0.02, turns=True)]
    waves = None
    if given:
        waves = Waves(np.tile([0.1, 8.0, 0.3, 0.05], (len(given), 1)), [Track(signal(rng, 1, 0.1), np.array([0]))])
    return InputSignals(drive, pulls, waves)


def put(loads: InputSignals, name: str, x: Any) -> InputSignals:
    """The loads with other numbers by the name of their derivatives."""
    drive = loads.drive
    if name.startswith("wrench"):
        k = int(name[7:-1])
        rows = list(loads.wrenches)
        rows[k] = replace(rows[k], signal=replace(rows[k].signal, coefficients=x))
        return replace(loads, wrenches=rows)
    if name.startswith("prescribed"):
        assert loads.prescribed is not None
        track = loads.prescribed.tracks[0]
        moved = replace(track, signal=replace(track.signal, coefficients=x))
        return replace(loads, prescribed=replace(loads.prescribed, tracks=[moved]))
    _, field, *rest = name.split(".")
    if rest:
        return replace(loads, drive=replace(drive, **{field: replace(getattr(drive, field), **{rest[0]: x})}))
    track = getattr(drive, field)
    return replace(loads, drive=replace(drive, **{field: replace(track, signal=replace(track.signal, coefficients=x))}))


def numbers(loads: InputSignals, name: str) -> Any:
    """The numbers by the name of their derivatives."""
    if name.startswith("wrench"):
        return loads.wrenches[int(name[7:-1])].signal.coefficients
    if name.startswith("prescribed"):
        assert loads.prescribed is not None
        return loads.prescribed.tracks[0].signal.coefficients
    _, field, *rest = name.split(".")
    own = getattr(loads.drive, field)
    return np.asarray(getattr(own, rest[0]) if rest else own.signal.coefficients)


class Case:
    """A robot of the room's kinds with all loads."""

    def __init__(self, built: Build, kind: str, method: str, **options: Any) -> None:
        robot = eomgen.load_robot("one_link")
        if kind == "prescribed":
            robot = some_prescribed(random_robot(3, joints=(1, 2), types=("revolute", "prismatic")), 3)
        self.kernel, self.method = built(robot, *ALL, **options), method
        rng, n = np.random.default_rng(7), self.kernel.n
        self.loads = loads_of(self.kernel, self.kernel, holds=kind == "elastic")
        self.q, self.v, self.u = rng.uniform(-0.3, 0.3, (3, n))
        self.loss, self.parameters = Loss(n), tuple(self.kernel.parameters)[:3]

    def call(self, name: str, **changed: Any) -> Any:
        given = {"q": self.q, "v": self.v, "u": self.u, "loads": self.loads, **METHODS[self.method], **changed}
        q, v, u = (given.pop(x) for x in ("q", "v", "u"))
        return getattr(self.kernel, name)(q, v, u, method=self.method, **given)

    def gradient(self, **changed: Any) -> tuple[float, dict[str, Any]]:
        found: tuple[float, dict[str, Any]] = self.call(
            "rollout_gradient", loss=self.loss, parameters=self.parameters, **changed
        )
        return found


KINDS = ("elastic", "prescribed")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", KINDS)
def test_against_differences(kind: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """By states, drives, parameters, and all numbers of the loads."""
    frozen(monkeypatch)
    case, rng, h = Case(built, kind, method), np.random.default_rng(9), 1e-5
    value, found = case.gradient()

    def near(x: float) -> Any:
        return pytest.approx(x, rel=1e-6, abs=2e-9 * max(1.0, abs(value)))

    for name, x in (("q", case.q), ("v", case.v), ("u", case.u)):
        direction = rng.uniform(-1.0, 1.0, x.shape)
        ends = [case.gradient(**{name: x + s * h * direction})[0] for s in (1, -1)]
        assert (found[name] * direction).sum() == near((ends[0] - ends[1]) / (2 * h)), name
    for name, by in found["loads"].items():
        x = numbers(case.loads, name)
        direction = rng.uniform(-1.0, 1.0, x.shape) * np.maximum(np.abs(x), 1e-3)
        moved = [put(case.loads, name, x + s * h * direction) for s in (1, -1)]
        moved = [put(y, name, float(numbers(y, name))) if x.ndim == 0 else y for y in moved]
        ends = [case.gradient(loads=y)[0] for y in moved]
        assert (by * direction).sum() == near((ends[0] - ends[1]) / (2 * h)), name
        assert np.any(by), name
    kernel = case.kernel
    for parameter in case.parameters:
        x = kernel.parameters[parameter]
        ends = []
        for s in (1, -1):
            case.kernel = kernel.with_parameters({parameter: x + s * h})
            ends.append(case.gradient()[0])
        case.kernel = kernel
        assert found[parameter] == near((ends[0] - ends[1]) / (2 * h)), parameter


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", KINDS)
def test_sensitivities_are_gradients(kind: str, method: str, built: Build) -> None:
    """By states, drives and parameters; samples are those of the rollout, where that takes loads."""
    case, rng = Case(built, kind, method), np.random.default_rng(3)
    n, weights = case.kernel.n, rng.uniform(-1.0, 1.0, (2, STEPS + 1, case.kernel.n))
    _, by = case.gradient()
    along = {name: rng.uniform(-1.0, 1.0, (2, n)) for name in ("q", "v", "u")}
    (q, v), (dq, dv) = case.call("rollout_sensitivity", parameters=case.parameters, along=along)
    case.loss = lambda t, q, v: (0.0, *weights)  # type: ignore[assignment]
    _, by = case.gradient()
    wanted = [sum((by[name] * x[i]).sum() for name, x in along.items()) for i in range(2)]
    wanted += [by[name] for name in case.parameters]
    found = np.einsum("sn,sdn->d", weights[0], dq) + np.einsum("sn,sdn->d", weights[1], dv)
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-12 * np.abs(wanted).max())
    if METHODS[method].get("duration"):
        for one, other in zip((q, v), case.call("rollout", u=np.tile(case.u, (STEPS, 1))), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_parts_and_batches(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is kept changes no bit, nor do other states; what states share adds up."""
    case = Case(built, "prescribed", method)
    q = np.array([case.q, -case.q, 0.5 * case.q])
    each = [case.loads, loads_of(case.kernel, case.kernel, seed=6), case.loads]
    value, whole = case.gradient(q=q, loads=each)
    _, shared = case.gradient(q=q)
    alone = [case.gradient(q=q[i], loads=each[i])[1] for i in range(3)]
    for i, own in enumerate(alone):
        np.testing.assert_array_equal(whole["q"][i], own["q"])
        for name, x in own["loads"].items():
            np.testing.assert_array_equal(whole["loads"][i][name], x)
    other = case.gradient(q=q[1])[1]["loads"]
    for name, x in shared["loads"].items():
        total = alone[0]["loads"][name] + other[name] + alone[2]["loads"][name]
        np.testing.assert_allclose(x, total, rtol=1e-12, atol=1e-13 * np.abs(total).max())
    out = {name: np.full_like(whole[name], np.nan) for name in ("q", "u")}
    monkeypatch.setattr(gradients, "KEPT", 0)
    monkeypatch.setattr(gradients, "SHORTEST", 1)
    again, parts = case.gradient(q=q, loads=each, out=out)
    assert again == value
    assert all(parts[name] is x for name, x in out.items())
    for name in ("q", "v", "u", *case.parameters):
        np.testing.assert_array_equal(parts[name], whole[name])
    for one, two in zip(parts["loads"], whole["loads"], strict=True):
        assert all(np.array_equal(one[name], x) for name, x in two.items())


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_loops(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains and wrenches move a mechanism, too."""
    frozen(monkeypatch)
    beside = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
    wanted = (x for x in ALL if x not in MODELS)
    kernel = built(eomgen.load_robot("four_bar"), *wanted, *beside)
    rng, case = np.random.default_rng(1), object.__new__(Case)
    case.kernel, case.method, case.loss, case.parameters = kernel, method, Loss(3), ("gravity.y",)
    case.q = kernel.assemble([0.5, 0.2, 1.2])
    case.v, case.u = kernel.project_velocity(case.q, [1.0, 0.0, 0.0]), np.zeros(3)
    gains = Gains(np.array([30.0]), np.array([2.0]))
    drive = DriveData(program=Track(signal(rng, 1, 0.3), np.array([0])), gains=gains)
    case.loads = InputSignals(drive, [LinkWrench(1, signal(rng, 6, 3.0), np.array([0.1, 0.0, 0.0]), turns=True)])
    value, found = case.gradient()
    for name, by in found["loads"].items():
        x = numbers(case.loads, name)
        direction = rng.uniform(-1.0, 1.0, x.shape) * np.abs(x)
        ends = [case.gradient(loads=put(case.loads, name, x + s * 1e-5 * direction))[0] for s in (1, -1)]
        assert (by * direction).sum() == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-8 * abs(value)), (
            name
        )


@pytest.mark.soak
def test_a_mechanism_whose_only_freedom_is_prescribed(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages solve for nothing, and derivatives by what follows their factors are found all the same."""
    frozen(monkeypatch)
    robot = eomgen.load_robot("four_bar")
    crank, *others = robot.joints
    key, value = next(iter(crank.coordinates.items()))
    crank = replace(crank, coordinates={**crank.coordinates, key: replace(value, prescribed=True)})
    robot = replace(robot, driven=(), joints=(crank, *others))
    beside = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
    kernel = built(robot, *(x for x in ALL if x not in MODELS), *beside)
    rng, case = np.random.default_rng(1), object.__new__(Case)
    case.kernel, case.method, case.loss = kernel, "rosenbrock", Loss(3)
    case.parameters = ("gravity.x", "gravity.y", "gravity.z")
    case.q, case.u = kernel.assemble([0.5, 0.2, 1.2]), np.zeros(3)
    case.v = kernel.project_velocity(case.q, [1.0, 0.0, 0.0])
    track = Track(signal(rng, 1, 0.1), np.array([0]))
    case.loads = InputSignals(prescribed=Waves(np.array([[0.1, 8.0, 0.3, 0.5]]), [track]))
    value, found = case.gradient()
    assert [found[name] for name in case.parameters] == pytest.approx([0.0] * 3, abs=1e-12)  # what moves is given
    assert found["gravity.z"] == 0.0  # across its plane
    by, name = found["loads"]["prescribed.tracks[0]"], "prescribed.tracks[0]"
    x = numbers(case.loads, name)
    direction = rng.uniform(-1.0, 1.0, x.shape) * np.abs(x)
    ends = [case.gradient(loads=put(case.loads, name, x + s * 1e-5 * direction))[0] for s in (1, -1)]
    assert (by * direction).sum() == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-8 * abs(value))


class SingleMotion(Evaluated):
    """Steps under forces, gains, a model and a wrench, all of them complex."""

    names = (*Evaluated.names, "inverse_dynamics", "external_force")
    begin, dt, places, links, chosen = 0.0, 0.0, np.zeros(0, int), 0, False

    def column(self, name: str, share: float) -> np.ndarray:
        """Columns of a signal, rates and accelerations; where steps end at knots, of the piece that is inside."""
        t, inside = self.begin + share * self.dt, self.begin + min(max(share, 1e-3), 1.0 - 1e-3) * self.dt
        beside = inside if self.chosen else t
        k = min(int(np.searchsorted(TIMES, beside, side="right")) - 1, len(TIMES) - 2)
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
def test_equal_to_complex_steps_of_the_programs(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of everything that the loads consist of, and of the state, by the steps that were taken."""
    taken: list[gradients.Steps] = []
    chosen = gradients._chosen_steps
    monkeypatch.setattr(gradients, "_chosen_steps", lambda *x: taken.append(chosen(*x)) or taken[-1])
    case, rng = Case(built, "elastic", method), np.random.default_rng(3)
    loads = loads_of(case.kernel, case.kernel)
    case.loads, case.parameters = replace(loads, wrenches=loads.wrenches[:1]), ()
    weights = rng.uniform(-1.0, 1.0, (2, STEPS + 1, case.kernel.n))
    case.loss = lambda t, q, v: (0.0, *weights)  # type: ignore[assignment]
    _, by = case.gradient()
    steps = taken[0] if taken else None
    lengths = [DT] * STEPS if steps is None else list(steps.dt)
    times = DT * np.arange(STEPS + 1) if steps is None else steps.times
    told = list(range(STEPS + 1)) if steps is None else list(steps.sample_index)
    by = {**by, **by["loads"]}
    given = {"q": case.q, "v": case.v, "u": case.u} | {name: numbers(case.loads, name) for name in by["loads"]}
    rates = {name: rng.uniform(-1.0, 1.0, x.shape) * np.maximum(np.abs(x), 1e-3) for name, x in given.items()}
    values = {name: x + 1e-30j * rates[name] for name, x in given.items()}
    values |= {"ratio": case.loads.drive.ratio, "p": np.array(list(case.kernel.parameters.values()))}
    assert case.loads.drive.program is not None
    evaluated = SingleMotion(eomgen.load_robot("one_link"), values)
    evaluated.places, evaluated.links = case.loads.drive.program.place, len(case.kernel.links)
    evaluated.chosen = steps is not None
    states = [(values["q"], values["v"])]
    for begin, dt in zip(times, lengths, strict=False):
        evaluated.begin, evaluated.dt = float(begin), float(dt)
        states.append(evaluated.step(method, 0, float(dt), *states[-1]))
    wanted = float((np.array([states[i] for i in told]).imag * 1e30 * weights.swapaxes(0, 1)).sum())
    found = sum(float((by[name] * rates[name]).sum()) for name in given)
    assert found == pytest.approx(wanted, rel=1e-9)


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


def test_a_profile_in_the_place_of_time(built: Build) -> None:
    """Derivatives by the path, whose profile counts as given."""
    case = Case(built, "elastic", "rk4")
    profile = Signal(np.array([0.0, 1.0]), np.array([[[0.0], [9.0], [300.0]]]))
    program = case.loads.drive.program
    assert program is not None
    path = replace(program, signal=replace(program.signal, profile=profile))
    model = loads_of(case.kernel, case.kernel).drive.model
    case.loads = replace(case.loads, drive=replace(case.loads.drive, program=path, model=model))
    value, found = case.gradient()
    x, rng = path.signal.coefficients, np.random.default_rng(1)
    direction = rng.uniform(-1.0, 1.0, x.shape) * np.abs(x)
    ends = [case.gradient(loads=put(case.loads, "drive.program", x + s * 1e-5 * direction))[0] for s in (1, -1)]
    by = found["loads"]["drive.program"]
    assert (by * direction).sum() == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-8 * abs(value))


@pytest.mark.soak
def test_single_precision(built: Build) -> None:
    wanted = Case(built, "elastic", "rk4")
    single = Case(built, "elastic", "rk4", dtype="float32")
    single.loads = replace(wanted.loads)
    single.q, single.v, single.u = (np.asarray(x, np.float32) for x in (single.q, single.v, single.u))
    for name, x in single.gradient()[1]["loads"].items():
        other = wanted.gradient()[1]["loads"][name]
        np.testing.assert_allclose(x, other, rtol=2e-3, atol=2e-3 * np.abs(other).max())


def test_what_is_wrong_is_named(built: Build) -> None:
    case = Case(built, "elastic", "rk4")
    with pytest.raises(InputError, match=r"rollout: loads: 'drives' is unknown"):
        case.gradient(loads={"drives": 1})
    with pytest.raises(ArrayError, match="2 states in loads, but 3 in other arrays"):
        case.gradient(q=np.tile(case.q, (3, 1)), loads=[case.loads] * 2)
    model = case.loads.drive.model
    assert model is not None
    looped = replace(model, mechanism=MechanismData([], [], np.zeros(2, bool)))
    for name in ("gradient", "sensitivity"):
        call = {"gradient": {"loss": case.loss}, "sensitivity": {"parameters": case.parameters}}[name]
        loads = replace(case.loads, drive=replace(case.loads.drive, model=looped))
        with pytest.raises(InputError, match=f"rollout_{name}: loads: drive.model.mechanism has no derivatives"):
            case.call(f"rollout_{name}", loads=loads, **call)
    bare = built(eomgen.load_robot("one_link"), *KERNELS, *SENSITIVITIES, "external_force", "inverse_dynamics")
    case.kernel = bare
    pull = [LinkWrench(0, Signal.constant(np.ones(6)))]
    with pytest.raises(eomgen.UnknownNameError, match="without the kernel external_force_parameter_adjoint"):
        case.gradient(loads=InputSignals(wrenches=pull))
    with pytest.raises(eomgen.UnknownNameError, match="without the kernel external_force_tangent"):
        case.call("rollout_sensitivity", parameters=case.parameters, loads=InputSignals(wrenches=pull))
    with pytest.raises(eomgen.UnknownNameError, match="without the kernel inverse_dynamics_adjoint"):
        case.gradient(
            loads=replace(
                case.loads, wrenches=[], drive=replace(case.loads.drive, model=replace(model, calls=bare.calls))
            )
        )
    with pytest.raises(InputError, match="rk4 comes to an end that is not finite"):
        case.gradient(dt=5.0, loads=InputSignals())


@pytest.mark.soak
@pytest.mark.parametrize("seed", share(range(12), 4))
@pytest.mark.parametrize("method", METHODS)
def test_random_robots(method: str, seed: int, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """With and without prescribed coordinates: gradients are sensitivities and differences."""
    frozen(monkeypatch)
    robot = random_robot(7000 + seed, joints=(2, 4), types=("revolute", "prismatic"))
    robot = some_prescribed(robot, seed) if seed % 2 else robot
    case, rng = object.__new__(Case), np.random.default_rng(seed)
    case.kernel, case.method = built(robot, *ALL), method
    n = case.kernel.n
    case.loads = loads_of(case.kernel, case.kernel, seed=seed)
    case.q, case.v, case.u = rng.uniform(-0.3, 0.3, (3, n))
    case.loss, case.parameters = Loss(n), tuple(case.kernel.parameters)
    value, found = case.gradient()
    along = {name: rng.uniform(-1.0, 1.0, (1, n)) for name in ("q", "v", "u")}
    (q, _), (dq, dv) = case.call("rollout_sensitivity", parameters=case.parameters, along=along)
    _, by_q, by_v = case.loss(np.zeros(STEPS + 1), q, q)
    forwards = np.einsum("sn,sdn->d", by_q, dq) + np.einsum("sn,sdn->d", by_v, dv)
    backwards = [sum((found[name] * x[0]).sum() for name, x in along.items())]
    backwards += [found[name] for name in case.parameters]
    np.testing.assert_allclose(forwards, backwards, rtol=1e-9, atol=1e-11 * np.abs(backwards).max())
    moved, wanted = {}, 0.0
    for name, by in found["loads"].items():
        x = numbers(case.loads, name)
        moved[name] = rng.uniform(-1.0, 1.0, x.shape) * np.maximum(np.abs(x), 1e-3)
        wanted += float((by * moved[name]).sum())
    ends = []
    for s in (1, -1):
        loads = case.loads
        for name, direction in moved.items():
            x = numbers(loads, name) + s * 1e-5 * direction
            loads = put(loads, name, x if x.ndim else float(x))
        ends.append(case.gradient(loads=loads)[0])
    assert wanted == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-8 * max(1.0, abs(value)))
