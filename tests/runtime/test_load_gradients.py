"""Gradients and sensitivities of rollouts under loads that are data: against differences, each other and rollouts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError
from eomgen.runtime.stepping.loads import (
    DriveData,
    Gains,
    LinkWrench,
    LoadData,
    MechanismData,
    ModelDrive,
    Signal,
    Track,
    Waves,
)
from tests.runtime.test_rollout_gradients import DT, KERNELS, METHODS, STEPS, Loss, frozen
from tests.support.builds import Build
from tests.support.random_robots import random_robot, some_prescribed

pytestmark = pytest.mark.usefixtures("unoptimised")

SENSITIVITIES = ("explicit_sensitivity", "implicit_sensitivity", "rosenbrock_sensitivity")
FORCES = ("external_force", "external_force_parameter_adjoint", "external_force_tangent")
POSES = ("kinematics", "frame_pose_parameter_adjoint", "frame_pose_tangent", "frame_pose_parameter_tangent")
MODELS = ("inverse_dynamics", "inverse_dynamics_adjoint", "inverse_dynamics_tangent")
ALL = (*KERNELS, *SENSITIVITIES, *FORCES, "external_force_parameter_tangent", *POSES, *MODELS)
TIMES = np.array([0.0, 0.4, 1.0, 1.7]) * STEPS * DT  # the last one behind the end


def signal(rng: np.random.Generator, columns: int, size: float = 1.0) -> Signal:
    """Cubics that jump from piece to piece."""
    shape = (len(TIMES) - 1, 4, columns)
    return Signal(TIMES, size * rng.uniform(-1.0, 1.0, shape) / (STEPS * DT) ** np.arange(4)[:, None])


def loads_of(kernel: eomgen.Kernel, model: eomgen.Kernel | None, *, seed: int = 5, holds: bool = False) -> LoadData:
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
    drive = DriveData(Track(signal(rng, 1, 5.0), free[:1]), Track(signal(rng, free.size, 0.2), free), ratio, gains, knows)
    last, arm = len(kernel.links) - 1, np.array([0.1, -0.05, 0.2])
    pulls = [LinkWrench(last, signal(rng, 6, 3.0)), LinkWrench(last, signal(rng, 6, 3.0), arm)]
    pulls += [LinkWrench(0, signal(rng, 6, 3.0), arm, t0=0.01, t1=0.02, turns=True)]
    waves = None
    if given:
        waves = Waves(np.tile([0.1, 8.0, 0.3, 0.05], (len(given), 1)), [Track(signal(rng, 1, 0.1), np.array([0]))])
    return LoadData(drive, pulls, waves)


def put(loads: LoadData, name: str, x: Any) -> LoadData:
    """The loads with other numbers by the name of their derivatives."""
    drive = loads.drive
    if name.startswith("wrench"):
        k = int(name[7:-1])
        rows = list(loads.wrenches)
        rows[k] = replace(rows[k], signal=replace(rows[k].signal, coefficients=x))
        return replace(loads, wrenches=rows)
    if name.startswith("prescribed"):
        assert loads.given is not None
        track = loads.given.tracks[0]
        moved = replace(track, signal=replace(track.signal, coefficients=x))
        return replace(loads, given=replace(loads.given, tracks=[moved]))
    _, field, *rest = name.split(".")
    if rest:
        return replace(loads, drive=replace(drive, **{field: replace(getattr(drive, field), **{rest[0]: x})}))
    track = getattr(drive, field)
    return replace(loads, drive=replace(drive, **{field: replace(track, signal=replace(track.signal, coefficients=x))}))


def numbers(loads: LoadData, name: str) -> Any:
    """The numbers by the name of their derivatives."""
    found: list[Any] = []

    class Taken(Exception):
        pass

    drive = loads.drive
    if name.startswith("wrench"):
        found = [loads.wrenches[int(name[7:-1])].signal.coefficients]
    elif name.startswith("prescribed"):
        assert loads.given is not None
        found = [loads.given.tracks[0].signal.coefficients]
    else:
        _, field, *rest = name.split(".")
        own = getattr(drive, field)
        found = [getattr(own, rest[0]) if rest else own.signal.coefficients]
    return np.asarray(found[0])


class Case:
    """A robot of the room's kinds with all loads."""

    def __init__(self, built: Build, kind: str, method: str, **options: Any) -> None:
        robot = random_robot(1453, joints=(2, 2), types=("revolute", "prismatic"))
        if kind == "prescribed":
            robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
        if kind == "elastic":
            robot = eomgen.load_robot("one_link")
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


KINDS = ("tree", "elastic", "prescribed")


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
