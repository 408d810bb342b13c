"""A scenario in rollouts of C, for many kernels of one code at a time, each with parameters of its own.

Drives, torque tables and wrenches are held over a period: what they are in its middle, where the state is extrapolated
to, so that the error is of second order.  Joint PD is part of the C and acts at every step.  Linearly implicit steps
are of first order; each period is done with steps of one and of half the length, and their results extrapolated: second
order, and stable all the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import ArrayError, EomgenError, InputError, IntegrationStopped
from ..integration.resting import rests
from ..integration.steps import fixed_step
from ..integration.trajectory import Trajectory
from ..robot.model import build_model
from ..robot.value import Robot
from ..runtime.kernel import Kernel
from ..runtime.stepping.many_steps import FAR
from ..runtime.stepping.options import FIXED
from ..scenario.value import Scenario
from ..simulation.assembly import Assembly
from ..simulation.balance import TERMS, EnergyBalance
from ..simulation.controls import JointPD
from ..simulation.initial import initial_state
from ..simulation.loads import loaded_parameters
from ..state.springs import stiffness_matrix
from ..state.turning import extrapolated

Array = NDArray[np.float64]

PERIOD = 5e-4  # s, of the drives, at most
HOLD = 0.5  # time constants of what drives damp, or rad by which they turn a swing, in which they may be held
ADVICE = "a shorter step or period may help"
MOST_STEPS, MOST_PERIODS = 1e11, 1e8  # of a motion: a day in C, and what memory holds
SLOWEST_TURN = 0.05  # rad by which the slowest spring turns in an implicit step


@dataclass(frozen=True)
class Pace:
    """method of ``options.FIXED``; ``periods`` of the drives in the duration, each of ``steps`` steps."""

    method: str
    periods: int
    steps: int
    duration: float

    @property
    def step(self) -> float:
        """Length of a step, s."""
        return self.duration / (self.periods * self.steps)

    @property
    def passes(self) -> tuple[int, ...]:
        """Divisors of the step in the passes over a period: implicit ones are done twice, and extrapolated."""
        return (1, 2) if self.method == "implicit" else (1,)

    @property
    def times(self) -> Array:
        """Begins of the periods and the end, (periods + 1,), s."""
        return np.linspace(0.0, self.duration, self.periods + 1)


def why_not(robot: Robot, scenario: Scenario) -> str | None:
    """Reason why rollouts cannot do a robot's scenario; None if they can."""
    if scenario.until is not None:
        return "until: motions that end before the duration does are not part of rollouts"
    if scenario.control is not None and scenario.control.get("saturate"):
        return "control.saturate: drives that are clipped are not part of rollouts"
    model = build_model(robot)
    names = [model.coordinates[i] for i in model.prescribed]
    return f"{', '.join(names)}: motions that are prescribed are not part of rollouts" if names else None


def choose_pace(
    assembly: Assembly, q: Array, duration: float, method: str, step: float | None, period: float | None
) -> Pace:
    """Steps as given, or by what is at q: rk4 by the fastest, implicit by the slowest spring; at most a period.

    The period is as given, or so short that drives that are held over it stay stable at q.

    Raises:
        InputError: that would be steps without end.
    """
    period = min(min(PERIOD, _longest_hold(assembly, q)) if period is None else period, duration)
    if step is None:
        step = fixed_step(assembly.kernel, q, None, np.array([0.0, period]), explicit=method != "implicit")
        if method == "implicit":
            step = max(step, _slowest_step(assembly, q))
    if duration / period > MOST_PERIODS or duration / min(step, period) > MOST_STEPS:
        raise InputError(
            f"engine: periods of {period:.3g} s and steps of {step:.3g} s in {duration:g} s; allowed: at most"
            f' {MOST_PERIODS:g} periods and {MOST_STEPS:g} steps; method = "implicit" takes fewer where springs are'
            " stiff"
        )
    periods = max(1, int(np.ceil(duration / period - 1e-9)))
    return Pace(method, periods, max(1, int(np.ceil(duration / periods / step - 1e-9))), duration)


def _longest_hold(assembly: Assembly, q: Array) -> float:
    """Time over which drives may be held, s, by how they change with rates and coordinates about rest at q."""
    if isinstance(assembly.drive, JointPD):
        return np.inf  # part of the C
    n, h = assembly.kernel.n, 1e-6
    states = np.tile(np.concatenate([q, np.zeros(n)]), (2 * n + 1, 1))
    states[np.arange(1, 2 * n + 1), np.arange(2 * n)] += h
    u = assembly.drive(0.0, np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:]))
    by_state = np.linalg.solve(assembly.kernel.mass_matrix(q), (u[1:] - u[0]).T / h)
    swing, decay = (float(np.abs(np.linalg.eigvals(part)).max()) for part in (by_state[:, :n], by_state[:, n:]))
    return HOLD / max(decay, math.sqrt(swing), 1e-9)


def _slowest_step(assembly: Assembly, q: Array) -> float:
    kernel = assembly.kernel
    eigenvalues = np.linalg.eigvals(np.linalg.solve(kernel.mass_matrix(q), stiffness_matrix(kernel))).real
    swinging = eigenvalues[eigenvalues > 1e-9 * max(eigenvalues.max(initial=0.0), 1e-300)]
    return SLOWEST_TURN / float(np.sqrt(swinging.min())) if swinging.size else 0.0


@dataclass(frozen=True)
class Rolled:
    """A motion at the begins of all periods: trajectory, wrenches (T, links, 6) or None, work of TERMS or None."""

    trajectory: Trajectory
    wrench: Array | None
    balance: EnergyBalance | None


class _Steps:
    """Steps of one length over a period, in C, with buffers of their own."""

    def __init__(self, kernel: Kernel, method: str, steps: int, step: float, gains: tuple[Array, Array] | None) -> None:
        n, view = kernel.n, kernel.raw.view
        assert kernel.raw.rollout is not None
        self.steps, self.step, self._parameters = steps, step, kernel.parameters
        rows = steps if gains else 1
        self._u, self._target = np.zeros((rows, n)), np.zeros((rows, n))
        self._start, self._ends = np.empty((2, n)), np.empty((2, 2, n))
        fields = {"u": view(self._u), "u_step": n if gains else 0}
        if gains:
            fields |= {"kp": view(gains[0]), "kd": view(gains[1]), "target": view(self._target), "target_step": n}
        self._code, self._library = kernel.raw.rollout.code, kernel.raw.rollout.library
        self._drive, self._kept = self._library.drive(**fields), (fields, gains)
        self._views = [view(x) for x in (*self._start, *self._ends)]
        self._how = step, steps, steps, FIXED[method]

    def run(self, q: Array, v: Array, u: Array, command: tuple[Array, Array] | None) -> tuple[int, Array]:
        """Under u, (n,), and what ``_commands`` says: -1 and the end, (2, n); or where there is no acceleration."""
        self._u[:] = u
        if command is not None:
            self._u += command[0]
            self._target[:] = command[1]
        self._start[0], self._start[1] = q, v
        start, rates, *ends = self._views
        pointer = self._parameters.setup.pointer(self._library)
        code = self._code(pointer, start, rates, self._drive, *self._how, *ends)
        return int(code), self._ends[:, 1]


@dataclass(frozen=True)
class _Failure:
    """Why a sample failed in period ``k``, and the coordinate that is to blame."""

    k: int
    coordinate: str
    message: str


class _Sample:
    """One kernel's way, and what went wrong on it."""

    def __init__(
        self, robot: Robot, scenario: Scenario, assembly: Assembly, pace: Pace, gains: tuple[Array, Array] | None
    ):
        self.assembly, self.kernel = assembly, assembly.kernel
        self.failure: _Failure | None = None
        n = self.kernel.n
        self.q, self.v = np.empty((pace.periods + 1, n)), np.empty((pace.periods + 1, n))
        self.q[0], self.v[0], _ = initial_state(robot, scenario, assembly)
        self.held = np.zeros((pace.periods, n))
        self.external = np.zeros((pace.periods, n)) if assembly.wrenches else None
        self._passes = [_Steps(self.kernel, pace.method, k * pace.steps, pace.step / k, gains) for k in pace.passes]
        self._period = pace.duration / pace.periods

    def advance(self, k: int, u: Array, commands: Sequence[tuple[Array, Array] | None]) -> None:
        """Period k under u, (n,), and a command for every pass; of two passes the second one weighs 2, the first -1."""
        try:
            self.kernel.refuse_not_finite("drive and wrenches", u, u.shape)
        except ArrayError as error:
            return self._fail(k, error.coordinate, str(error))
        ends = []
        for steps, command in zip(self._passes, commands, strict=True):
            code, end = steps.run(self.q[k], self.v[k], u, command)
            if code >= 0:
                step, i = divmod(code, self.kernel.n)
                at = k * self._period + step * steps.step
                name = self.kernel.coordinates[i]
                return self._fail(k, name, f"no acceleration of {name} at t = {at:.6g} s; {ADVICE}")
            ends.append(end)
        q, v = ends[0]
        if len(ends) > 1:
            q, v = extrapolated(ends[0].ravel(), ends[1].ravel(), self.kernel.raw.turning).reshape(2, -1)
        bad = ~(np.abs(q) < FAR) | ~np.isfinite(v)
        if bad.any():
            name = self.kernel.coordinates[int(bad.argmax())]
            return self._fail(k, name, f"{name} diverged before t = {(k + 1) * self._period:.6g} s; {ADVICE}")
        self.q[k + 1], self.v[k + 1] = q, v
        return None

    def _fail(self, k: int, coordinate: str, message: str) -> None:
        """Stand still from period k on: the others of the batch go on."""
        self.failure = _Failure(k, coordinate, message)
        self.q[k + 1 :], self.v[k + 1 :] = self.q[k], self.v[k]


def roll(
    robot: Robot, scenario: Scenario, assemblies: Sequence[Assembly], pace: Pace, *, balance: bool = False
) -> list[Rolled | EomgenError]:
    """The scenario's motion for each assembly, whose kernels are of one code, or why there is none.

    A motion does not depend on what others are done with it.
    """
    first = assemblies[0]
    law = first.drive
    inner = law if isinstance(law, JointPD) else None
    gains = None if inner is None else _gains(inner, first.kernel.n)
    found: list[Rolled | EomgenError | None] = [None] * len(assemblies)
    samples: dict[int, _Sample] = {}
    for i, assembly in enumerate(assemblies):
        try:
            samples[i] = _Sample(robot, scenario, assembly, pace, gains)
        except EomgenError as error:
            found[i] = error
    if samples:
        try:
            _run(robot, scenario, list(samples.values()), pace, inner)
        except EomgenError as error:
            if len(assemblies) == 1:
                return [error]
            return [roll(robot, scenario, [assembly], pace, balance=balance)[0] for assembly in assemblies]
    for i, sample in samples.items():
        try:
            found[i] = _result(sample, pace, balance)
        except EomgenError as error:  # what follows from a motion that is finite need not be
            found[i] = error
    return [item for item in found if item is not None]


def _run(robot: Robot, scenario: Scenario, samples: list[_Sample], pace: Pace, inner: JointPD | None) -> None:
    period, law = pace.duration / pace.periods, samples[0].assembly.drive
    if inner is not None:  # what is held is the rest: what holds the rigid robot
        law = replace(inner, kp=0.0 * inner.kp, kd=0.0 * inner.kd)
    edges = [t for load in scenario.payloads for t in (load.t0, load.t1) if t is not None]
    for sample in samples:
        sample.kernel.parameters.update(loaded_parameters(robot, scenario, 0.5 * period))
    q, v = np.array([s.q[0] for s in samples]), np.array([s.v[0] for s in samples])
    before, kernel = v, samples[0].kernel
    for k, t in enumerate(pace.times[:-1].tolist()):
        middle = t + 0.5 * period
        if k and any(t - 0.5 * period < edge <= middle for edge in edges):
            for sample in samples:
                sample.kernel.parameters.update(loaded_parameters(robot, scenario, middle))
        q_ahead, v_ahead = q + 0.5 * period * v, v + 0.5 * (v - before)  # in the middle, to second order
        u = law(middle, q_ahead, v_ahead)
        commands = [None if inner is None else _commands(inner, t, pace, times, kernel.n) for times in pace.passes]
        acting = any(w.t0 <= middle and (w.t1 is None or middle < w.t1) for w in scenario.wrenches)
        for i, sample in enumerate(samples):
            if sample.failure:
                continue
            sample.held[k] = u[i]
            forces = u[i]
            if acting and sample.assembly.wrenches is not None and sample.external is not None:
                wrench = sample.assembly.wrenches(middle, q_ahead[i], v_ahead[i])
                sample.external[k] = sample.kernel.external_force(q_ahead[i], wrench)
                forces = forces + sample.external[k]
            sample.advance(k, forces, commands)
        before = v
        q, v = (np.array([x[k + 1] for x in xs]) for xs in ([s.q for s in samples], [s.v for s in samples]))


def _drives(sample: _Sample, pace: Pace, inner: bool, last: int) -> Array:
    """Drives at the begins of periods up to the last one: of what was held, the mean of before and after."""
    law, t, q, v = sample.assembly.drive, *(x[: last + 1] for x in (pace.times, sample.q, sample.v))
    if inner:
        return np.array([law(at, *state) for at, *state in zip(t.tolist(), q, v, strict=True)])
    u = np.empty_like(q)
    u[1:-1] = 0.5 * (sample.held[1:last] + sample.held[: max(last - 1, 0)])
    u[0] = law(0.0, q[0], v[0])
    if last > 0:
        u[-1] = sample.held[last - 1] if sample.failure else law(pace.duration, q[-1], v[-1])
    return u


def _gains(law: JointPD, n: int) -> tuple[Array, Array]:
    """kp and kd at what is driven; of a motor those of its joint over the ratio squared."""
    kp, kd = np.zeros(n), np.zeros(n)
    kp[law.actuators.index], kd[law.actuators.index] = law.kp / law.actuators.ratio**2, law.kd / law.actuators.ratio**2
    return kp, kd


def _commands(law: JointPD, t: float, pace: Pace, finer: int, n: int) -> tuple[Array, Array]:
    """u and target of the steps of a period, (steps, n) each: at their ends if implicit, else in their middles."""
    ahead, steps, index = 1.0 if pace.method == "implicit" else 0.5, finer * pace.steps, law.actuators.index
    q_d, v_d, _ = law.motion.at(t + (np.arange(steps) + ahead) * (pace.step / finer))
    u, target = np.zeros((steps, n)), np.zeros((steps, n))
    u[:, index], target[:, index] = law.kd * v_d / law.actuators.ratio, q_d * law.actuators.ratio
    return u, target


def _result(sample: _Sample, pace: Pace, balance: bool) -> Rolled | EomgenError:
    kernel, t = sample.kernel, pace.times
    failure = sample.failure
    last = pace.periods if failure is None else failure.k
    t, q, v = t[: last + 1], sample.q[: last + 1], sample.v[: last + 1]
    energy = np.asarray(kernel.energy(q, v))
    u = _drives(sample, pace, isinstance(sample.assembly.drive, JointPD), last)
    info = {"steps": pace.periods * pace.steps, "evaluations": 0, "jacobians": 0, "wall_s": 0.0}
    held = rests(kernel, t, q, v)
    trajectory = Trajectory(t, q, v, u, energy, kernel.coordinates, f"rollout, {pace.method}", info, rests=held)
    if failure is not None:
        message = f"{kernel.name}, t = {t[-1]:.6g} s: {failure.message}"
        stop = IntegrationStopped(message, float(t[-1]), q[-1].copy(), v[-1].copy(), failure.coordinate)
        stop.trajectory = trajectory
        return stop
    wrenches, wrench = sample.assembly.wrenches, None
    if wrenches is not None:
        wrench = np.array([wrenches(at, q, v) for at, q, v in zip(t.tolist(), sample.q, sample.v, strict=True)])
    return Rolled(trajectory, wrench, _balance(sample, pace, u, energy) if balance else None)


def _balance(sample: _Sample, pace: Pace, u: Array, energy: Array) -> EnergyBalance:
    """Works by what was held over each period, of PD and dampers by the trapezoidal rule."""
    kernel, q, v = sample.kernel, sample.q, sample.v
    h = pace.duration / pace.periods
    work = np.zeros((pace.periods + 1, len(TERMS)))
    law = sample.assembly.drive
    if isinstance(law, JointPD):
        work[1:, 0] = 0.5 * h * ((u * v).sum(axis=1)[1:] + (u * v).sum(axis=1)[:-1])
    else:
        work[1:, 0] = (sample.held * np.diff(q, axis=0)).sum(axis=1)
    if sample.external is not None:
        work[1:, 2] = (sample.external * np.diff(q, axis=0)).sum(axis=1)
    lost = ((kernel.generalized_force(q, np.zeros_like(q)) - kernel.generalized_force(q, v)) * v).sum(axis=1)
    work[1:, 4] = 0.5 * h * (lost[1:] + lost[:-1])
    return EnergyBalance(np.cumsum(work, axis=0), energy)
