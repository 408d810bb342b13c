"""Rollouts whose gradients and sensitivities are compared: robots of several kinds under drives, loads and laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.kernel.stepping import gradients
from eomgen.kernel.stepping.input_signals import (
    DriveData,
    Gains,
    InputSignals,
    LinkWrench,
    ModelDrive,
    Signal,
    Track,
    Waves,
)
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, some_prescribed
from tests.support.sliders import mass_on_rail, on_rail

STEPS, DT = 12, 2e-3
FIXED: dict[str, Any] = {"dt": DT, "steps": STEPS}
CHOSEN: dict[str, Any] = {"duration": STEPS * DT, "samples": STEPS}
METHODS = {"rk4": FIXED, "implicit": FIXED, "rosenbrock": CHOSEN, "tsit5": CHOSEN}
ROLLOUTS = ("rollout", "adaptive_rollout")
WAYS = ("explicit", "implicit", "rosenbrock")
KERNELS = (*ROLLOUTS, *(f"{way}_{kind}" for kind in ("gradient", "sensitivity") for way in WAYS))
CLOSED = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
FORCES = ("external_force", *(f"external_force_{x}" for x in ("parameter_adjoint", "tangent", "parameter_tangent")))
POSES = ("kinematics", *(f"frame_pose_{x}" for x in ("parameter_adjoint", "tangent", "parameter_tangent")))
MODELS = ("inverse_dynamics", "inverse_dynamics_adjoint", "inverse_dynamics_tangent")
LOADED = (*KERNELS, *FORCES, *POSES)  # under loads, of mechanisms too
ALL = (*LOADED, *MODELS)
JOINTS = ("revolute", "prismatic")
STOPS = {"stiffness": 4e3, "damping": 6.0, "restitution_damping": 0.3, "smoothing": 2e-3, "lower": -0.1, "upper": 0.2}
TIMES = np.array([-0.1, 0.4, 0.93, 1.7]) * STEPS * DT  # from before the beginning to behind the end
WINDING = "winding = { resistance = 1.0, inductance = 0.05, torque_constant = 0.5 }"
LOOPS = "position = { kp = 4.0, ki = 2.0, kd = 0.3, filter = 0.05 }, velocity = { kp = 3.0, ki = 4.0 }"
LAWS = {  # with internal states
    "bristles": 'friction = { model = "lugre", coulomb = 1.0, static = 1.4, stribeck = 0.4, viscous = 0.2,'
    " bristle_stiffness = 30.0, bristle_damping = 0.8, fade = 0.6 }",
    "hysteresis": "hysteresis = { stiffness = 40.0, A = 1.2, beta = 3.0, gamma = 1.0, n = 1.7, share = 0.3 }",
    "branches": "maxwell = [{ stiffness = 30.0, damping = 6.0 }, { stiffness = 20.0, damping = 1.0 }]",
    "cascade": f"drive = {{ {WINDING}, controller = {{ {LOOPS}, current = {{ kp = 0.4, ki = 3.0 }} }} }}",
    "limited": f"drive = {{ {WINDING}, voltage_limit = 0.6, controller = {{ {LOOPS} }} }}",
    "lag": "drive = { lag = 0.05 }",
}


class Loss:
    """Weighted coordinates, squared or not, and weighted velocities and internal states, of all samples."""

    def __init__(self, n: int, steps: int = STEPS, power: int = 2, states: int = 0) -> None:
        rng = np.random.default_rng(4)
        self.weights, self.power = rng.uniform(-1.0, 1.0, (2, steps + 1, n)), power
        self.of_states = rng.uniform(-1.0, 1.0, (steps + 1, states))

    def __call__(self, t: Array, q: Array, v: Array, *z: Array) -> tuple[float, Array, Array, *tuple[Array, ...]]:
        of_q, of_v = (np.broadcast_to(x[: t.size], q.shape).astype(q.dtype) for x in self.weights)
        of_z = [np.broadcast_to(self.of_states[: t.size], x.shape).astype(x.dtype) for x in z]
        value = (of_q * q**self.power + of_v * v).sum() + sum((w * x).sum() for w, x in zip(of_z, z, strict=True))
        return float(value), self.power * of_q * q ** (self.power - 1), of_v, *of_z


class Case:
    """A rollout by one method.

    Attributes:
        given: Its states, drives, controller and loads, by the names that derivatives have.
        options: Its other arguments, the method among them.
        inputs: Names of states and drives that may vary independently: of a loop the drives alone.
        parameters: Names of parameters to take derivatives by.
    """

    def __init__(self, kernel: eomgen.Kernel, method: str, given: dict[str, Any], *, power: int = 2) -> None:
        self.kernel, self.method, self.given = kernel, method, given
        self.loss = Loss(kernel.n, power=power, states=len(kernel.internal_states))
        self.options: dict[str, Any] = {"method": method, **METHODS[method]}
        self.inputs: tuple[str, ...] = (
            ("u",) if kernel.constraints else tuple(x for x in ("q", "v", "u", "z") if x in given)
        )
        self.parameters = tuple(kernel.parameters)

    def call(self, name: str, **changed: Any) -> Any:
        """Return what a method of the kernel returns, with some arguments changed."""
        x = self.options | self.given | changed
        kernel, *state = (x.pop(key, None) for key in ("kernel", "q", "v", "u"))
        return getattr(kernel or self.kernel, name)(*state, **x)

    def gradient(self, **changed: Any) -> tuple[Any, dict[str, Any]]:
        """Return the value of the loss and its gradient."""
        found: tuple[Any, dict[str, Any]] = self.call(
            "rollout_gradient", **{"loss": self.loss, "parameters": self.parameters, **changed}
        )
        return found

    def along(self, count: int = 2) -> dict[str, Array]:
        """Return random directions of states and drives."""
        rng = np.random.default_rng(3)
        return {name: rng.uniform(-1.0, 1.0, (count, *self.given[name].shape)) for name in self.inputs}

    def sensitivity(self, **changed: Any) -> list[Array]:
        """Return the samples of q, v and z if there are any, and their derivatives, by ``along()`` and parameters."""
        directions = {"parameters": self.parameters, "along": self.along()}
        return [x for pair in self.call("rollout_sensitivity", **{**directions, **changed}) for x in pair]

    def numbers(self, name: str) -> Array:
        """Return the numbers that have derivatives by this name: arguments, parameters, or those of the loads."""
        if name in self.kernel.parameters:
            return np.asarray(self.kernel.parameters[name])
        return np.asarray(self.given[name] if name in self.given else numbers(self.given["loads"], name))

    def changed(self, name: str, x: Array) -> dict[str, Any]:
        """Return the argument of ``call`` in which these numbers are others."""
        if name in self.kernel.parameters:
            return {"kernel": self.kernel.replaced(parameters={name: float(x)})}
        return {name: x} if name in self.given else {"loads": put(self.given["loads"], name, x)}

    def slope(self, name: str, direction: Array, h: float) -> float:
        """Return the derivative of the value along a direction of some numbers, by differences."""
        x = self.numbers(name)
        ends = [self.gradient(**self.changed(name, x + s * h * direction))[0] for s in (1.0, -1.0)]
        return float((ends[0] - ends[1]) / (2.0 * h))

    def check_differences(self, h: float = 1e-5, rel: float = 1e-6, floor: float = 1e-7) -> None:
        """Assert that derivatives by everything are differences along random directions."""
        (value, found), rng = self.gradient(), np.random.default_rng(9)
        found |= found.pop("loads", {})
        assert set(found) >= {*self.inputs, *self.parameters}
        for name in (name for name in found if name not in "qvz" or name in self.inputs):
            x = self.numbers(name)
            size = {"kp": x > 0.0, "kd": x > 0.0}.get(name, np.maximum(np.abs(x), 1e-3))
            direction = rng.uniform(-1.0, 1.0, x.shape) * (1.0 if name in self.inputs else size)
            wanted = pytest.approx(self.slope(name, direction, h), rel=rel, abs=floor * max(1.0, abs(value)))
            assert np.shape(found[name]) == x.shape
            assert (found[name] * direction).sum() == wanted, name

    def check_sensitivities(self, rel: float = 1e-11) -> None:
        """Assert that sensitivities are the gradient, of samples that are the rollout's."""
        found = self.sensitivity()
        samples, slopes = found[: len(found) // 2], found[len(found) // 2 :]
        rng = np.random.default_rng(4)
        weights = [
            *rng.uniform(-1.0, 1.0, (2, *samples[0].shape)),
            *(rng.uniform(-1.0, 1.0, x.shape) for x in samples[2:]),
        ]
        _, by = self.gradient(loss=lambda *_: (0.0, *weights))
        wanted = [sum((by[name] * x[i]).sum() for name, x in self.along().items()) for i in range(2)]
        wanted += [by[name] for name in self.parameters]
        found = sum(np.einsum("sn,sdn->d", *pair) for pair in zip(weights, slopes, strict=True))
        np.testing.assert_allclose(found, wanted, rtol=rel, atol=rel * np.abs(wanted).max())
        if "loads" not in self.given or "duration" in self.options:
            u, count = self.given["u"], self.options.get("steps", self.options.get("samples"))
            rolled = self.call("rollout", u=np.tile(u, (count, 1)) if u.ndim == 1 else u)
            for one, other in zip(samples, (*rolled, *([rolled.z] if samples[2:] else [])), strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13)


def frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let steps that the error chooses be those of the first motion."""
    found: list[Any] = []
    chosen = gradients._chosen_steps

    def once(*arguments: Any) -> Any:
        found.append(found[0] if found else chosen(*arguments))
        return found[0]

    monkeypatch.setattr(gradients, "_chosen_steps", once)


def signal(rng: np.random.Generator, columns: int, size: float = 1.0, degree: int = 3) -> Signal:
    """Return cubics that jump from piece to piece."""
    shape = (len(TIMES) - 1, 4, columns)
    return Signal(TIMES, size * rng.uniform(-1.0, 1.0, shape) / (STEPS * DT) ** np.arange(4)[:, None])


def loads_of(
    kernel: eomgen.Kernel,
    seed: int = 5,
    *,
    holds: bool = False,
    curve: Callable[..., Signal] = signal,
    window: tuple[float, float] = (0.01, 0.02),
) -> InputSignals:
    """Return everything at once: forces, a program that gains and a model follow, wrenches, prescribed motions.

    Args:
        kernel: Of the robot, and of the model.
        seed: Of all numbers.
        holds: Whether the model knows accelerations of the program alone.
        curve: (generator, columns, size, degree) -> a signal.
        window: Times between which one of the wrenches acts.
    """
    rng, n = np.random.default_rng(seed), kernel.n
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    free = np.setdiff1d(np.arange(n), given)
    gains = Gains(rng.uniform(20.0, 40.0, free.size), rng.uniform(1.0, 2.0, free.size))
    ratio, column, follows = rng.uniform(0.8, 1.5, free.size), np.full(n, -1), np.full(n, -1)
    column[free], follows[given] = np.arange(free.size), np.arange(len(given))
    model = ModelDrive(kernel.calls, np.arange(n), np.full(n, 1.1), column, follows, None if holds else 12.0)
    torque, program = Track(curve(rng, 1, 5.0, 0), free[:1]), Track(curve(rng, free.size, 0.2, 1), free)
    last, arm = len(kernel.links) - 1, np.array([0.1, -0.05, 0.2])
    pulls = [LinkWrench(last, curve(rng, 6, 3.0, 1)), LinkWrench(last, curve(rng, 6, 3.0, 1), arm)]
    pulls += [LinkWrench(0, curve(rng, 6, 3.0, 3), arm, t0=window[0], t1=window[1], turns=True)]
    waves = None
    if given:
        tracks = [Track(curve(rng, 1, 0.1, 1), np.array([0]))]
        waves = Waves(np.tile([0.1, 8.0, 0.3, 0.05], (len(given), 1)), tracks)
    return InputSignals(DriveData(torque, program, ratio, gains, model), pulls, waves)


def numbers(loads: InputSignals, name: str) -> Array:
    """Return the numbers of loads by the name of their derivatives."""
    if name.startswith("wrench"):
        return loads.wrenches[int(name[7:-1])].signal.coefficients
    if name.startswith("prescribed"):
        return loads.prescribed.tracks[0].signal.coefficients
    _, field, *rest = name.split(".")
    own = getattr(loads.drive, field)
    return np.asarray(getattr(own, rest[0]) if rest else own.signal.coefficients)


def put(loads: InputSignals, name: str, x: Any) -> InputSignals:
    """Return loads with other numbers by the name of their derivatives."""
    drive = loads.drive
    if name.startswith("wrench"):
        k, rows = int(name[7:-1]), list(loads.wrenches)
        rows[k] = replace(rows[k], signal=replace(rows[k].signal, coefficients=x))
        return replace(loads, wrenches=rows)
    if name.startswith("prescribed"):
        track = loads.prescribed.tracks[0]
        moved = replace(track, signal=replace(track.signal, coefficients=x))
        return replace(loads, prescribed=replace(loads.prescribed, tracks=[moved]))
    _, field, *rest = name.split(".")
    own, x = getattr(drive, field), x if np.ndim(x) else float(x)
    changed = replace(own, **({rest[0]: x} if rest else {"signal": replace(own.signal, coefficients=x)}))
    return replace(loads, drive=replace(drive, **{field: changed}))


def controlled(kernel: eomgen.Kernel) -> dict[str, Any]:
    """Return a state, drives over time and a controller of the driven joints; a loop begins assembled."""
    rng, n = np.random.default_rng(7), kernel.n
    given: dict[str, Any] = {"q": rng.uniform(-0.3, 0.3, n), "v": rng.uniform(-1.0, 1.0, n)}
    given |= {"u": rng.uniform(-1.0, 1.0, (STEPS, n)), "target": rng.uniform(-0.3, 0.3, (STEPS, n))}
    gains = np.zeros(n)
    gains[kernel.raw.libraries.meta["driven"]] = 1.0
    given |= {"kp": 40.0 * gains, "kd": 2.0 * gains}
    return given | (assembled(kernel) if kernel.constraints else {})


def assembled(kernel: eomgen.Kernel) -> dict[str, Any]:
    """Return a state of the four-bar."""
    q = kernel.assemble([0.5, 0.2, 1.2])
    return {"q": q, "v": kernel.project_velocity(q, [1.0, 0.0, 0.0])}


def prescribed_robot() -> Robot:
    """Return a small random robot with a prescribed coordinate."""
    return some_prescribed(random_robot(3, joints=(1, 2), types=JOINTS), 3)


def driven(built: Build, name: str, method: str, **options: Any) -> Case:
    """Return a controlled robot; "stops" is a mass that meets a stop."""
    stops = {f"stops.{key}": x for key, x in STOPS.items()}
    robot = mass_on_rail(further=stops) if name == "stops" else eomgen.load_robot(name)
    names = {"one_link": ALL, "four_bar": (*KERNELS, *CLOSED)}.get(name, KERNELS)
    kernel = built(robot, *names, **options)
    given = controlled(kernel)
    return Case(kernel, method, given | ({"q": np.array([0.195]), "v": np.array([0.6])} if name == "stops" else {}))


def loaded(built: Build, name: str, method: str, **options: Any) -> Case:
    """Return an elastic robot, or one with a prescribed coordinate, under all loads."""
    robot = prescribed_robot() if name == "prescribed" else eomgen.load_robot("one_link")
    return under_loads(built(robot, *ALL, **options), method, holds=name == "loads")


def under_loads(kernel: eomgen.Kernel, method: str, seed: int = 5, **how: Any) -> Case:
    """Return a rollout under all loads."""
    q, v, u = np.random.default_rng(7).uniform(-0.3, 0.3, (3, kernel.n))
    return Case(kernel, method, {"q": q, "v": v, "u": u, "loads": loads_of(kernel, seed, **how)})


def loaded_loop(built: Build, name: str, method: str) -> Case:
    """Return the four-bar under gains and a wrench."""
    kernel, rng = built(eomgen.load_robot("four_bar"), *LOADED, *CLOSED), np.random.default_rng(1)
    gains = Gains(np.array([30.0]), np.array([2.0]))
    drive = DriveData(program=Track(signal(rng, 1, 0.3), np.array([0])), gains=gains)
    loads = InputSignals(drive, [LinkWrench(1, signal(rng, 6, 3.0), np.array([0.1, 0.0, 0.0]), turns=True)])
    return Case(kernel, method, {**assembled(kernel), "u": np.zeros(kernel.n), "loads": loads})


def clipped(built: Build, name: str, method: str, **options: Any) -> Case:
    """Return a controlled robot or loop whose drives are clipped in about half of the steps."""
    loop = name == "clipped loop"
    robot = eomgen.load_robot("four_bar") if loop else random_robot(5, (2, 2), max_size=5, types=JOINTS)
    names = (*KERNELS, *(CLOSED if loop else FORCES), "forward_dynamics", "generalized_force", "energy")
    kernel = built(robot, *names, **options)
    given = controlled(kernel)
    asked = np.abs(given["u"] + given["kp"] * (given["target"] - given["q"]) - given["kd"] * given["v"])
    effort = np.where(given["kp"] > 0.0, np.quantile(asked, 0.5, axis=0), np.inf)
    case = Case(kernel, method, given)
    case.options["saturate"] = effort
    return case


def slide(built: Build, law: str, method: str, **options: Any) -> Case:
    """Return a slide with a law that has internal states."""
    robot = robot_from_toml(on_rail(f"stiffness = 20.0, damping = 0.3, {LAWS[law]}", law, 1.5))
    kernel = built(robot, **options)
    q, v, u = (np.array([x]) for x in (0.03, 0.4, 0.9))
    z = 0.02 * np.arange(1.0, 1.0 + len(kernel.internal_states))
    case = Case(kernel, method, {"q": q, "v": v, "u": u, "z": z}, power=1)
    fixed: dict[str, Any] = {"dt": 2e-3, "steps": 60, "every": 60 // STEPS}
    chosen: dict[str, Any] = {"duration": 0.12, "samples": STEPS, "rtol": 1e-10, "atol": 1e-13}
    case.options |= fixed if METHODS[method] is FIXED else chosen
    of_law = [x for x in kernel.parameters if x.startswith("joints.rail.z.") and x.count(".") > 3]
    case.parameters = (*of_law, "joints.rail.z.stiffness")
    return case


KINDS: dict[str, Callable[..., Case]] = {
    **dict.fromkeys(("one_link", "four_bar", "stops"), driven),
    **dict.fromkeys(("loads", "prescribed"), loaded),
    "loaded loop": loaded_loop,
    **dict.fromkeys(("clipped", "clipped loop"), clipped),
    **dict.fromkeys(LAWS, slide),
}
SLOW = ("loaded loop", "clipped loop", *LAWS.keys() - {"hysteresis", "limited"})  # left to the soak


def case_of(built: Build, kind: str, method: str, **options: Any) -> Case:
    """Return a rollout of a kind."""
    return KINDS[kind](built, kind, method, **options)
