"""Predictive control of the public arm with flexible links: the tip goes to a place and stays there.

    python examples/flexible_arm/track.py [SECONDS] [--method gauss|implicit|rosenbrock] [--coarse] [--times] [--whole]

A controller that knows two segments of each link, and their state by a Kalman filter from noisy measurements, moves a
plant of ten.  --method integrates the intervals: by collocation at Gauss's points, with dynamics and derivatives of all
of them in one call, or by a step of eomgen.adapters.casadi, a function of C for each.  --coarse has the published
defaults, 30 intervals over 2 s, in the place of the 130 over 1.3 s of the published simulation.  --times shows what the
linearization takes with the model by eomgen and by CasADi alone; --whole has the first prediction solved by fatrop,
too, as one nonlinear program.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi
import numpy as np
from arm import DRIVEN, arm
from collocation import Collocation
from plain import PlainDynamics, PlainIntegrator, tip
from prediction import Goal, Problem, Step, Tracker
from whole import WholeProgram

import eomgen
from eomgen.adapters.casadi import kernels_for_step, step
from eomgen.state import static_equilibrium

Array = Any
SEGMENTS, PLANT = 2, 10
START, END = np.array([np.pi / 2, np.pi / 10, -np.pi / 8]), np.array([0.0, 2 * np.pi / 5, -np.pi / 3])  # rad
NOISE = np.sqrt([3e-6] * 3 + [2e-3] * 3 + [1e-4] * 3)  # rad, rad/s, m: standard deviations
DYNAMICS = ("forward_dynamics", "forward_dynamics_jacobian")
KERNELS = (*DYNAMICS, "inverse_dynamics", "mass_matrix", "frame_pose", "frame_jacobian")
METHODS = ("gauss", "implicit", "rosenbrock")
ROUNDS = 5
NEAR, MOST_STEPS = 1e-4, 60  # N m, by which drives change at last


@dataclass(frozen=True)
class Horizon:
    """Equal intervals over a duration, s, each of some steps of collocation; a sample is as long as an interval."""

    intervals: int
    duration: float
    steps: int

    @property
    def sample(self) -> float:
        return self.duration / self.intervals


FINE, COARSE = Horizon(130, 1.3, 1), Horizon(30, 2.0, 4)


class Model:
    """A compiled arm: its driven coordinates, measurements and states at rest."""

    def __init__(self, segments: int, *kernels: str) -> None:
        self.kernel = eomgen.build(arm(segments), kernels=(*KERNELS, *kernels))
        self.n = self.kernel.n
        self.driven = np.array([self.kernel.coordinates.index(name) for name in DRIVEN])
        self.select = np.eye(self.n)[:, self.driven]

    def dynamics(self, q: Array, v: Array, u: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        """Return accelerations of (N, n) states, and their derivatives by q, v and u."""
        return self.kernel.forward_dynamics(q, v, u), self.kernel.forward_dynamics_jacobian(q, v, u)

    def tip(self, x: Array) -> tuple[Array, Array]:
        """Return the places of the tip in states, (..., 3), and their derivatives by them, (..., 3, 2n)."""
        q = np.ascontiguousarray(x[..., : self.n])
        slope = self.kernel.frame_jacobian(q, "tip")[..., :3, :]
        return self.kernel.frame_pose(q, "tip")[..., :3, 3], np.concatenate([slope, np.zeros_like(slope)], axis=-1)

    def measured(self, x: Array) -> tuple[Array, Array]:
        """Return angles and rates of driven joints and the place of the tip, (9,), and derivatives by the state."""
        place, slope = self.tip(x)
        both = np.concatenate([self.driven, self.n + self.driven])
        return np.append(x[both], place), np.vstack([np.eye(2 * self.n)[both], slope])

    def at_rest(self, driven: Array) -> Goal:
        """Return the static equilibrium in which driven joints have these angles, and the drives that hold it."""
        q, u = static_equilibrium(self.kernel, self.select @ driven, fixed=DRIVEN)
        x = np.append(q, np.zeros(self.n))
        return Goal(x, u[self.driven], self.tip(x)[0])


class CompiledStep:
    """Discrete steps in C, of the method of a rollout, with derivatives that are exact for them."""

    def __init__(self, method: str, segments: int, horizon: Horizon) -> None:
        kernel = eomgen.build(arm(segments), kernels=kernels_for_step(method))
        self.states = step(kernel, method, dt=horizon.sample, substeps=horizon.steps, drives=DRIVEN)
        x, u = casadi.MX.sym("x", 2 * kernel.n), casadi.MX.sym("u", len(DRIVEN))
        after = self.states(x, u)
        both = casadi.Function("both", [x, u], [after, *self.states.jacobian()(x, u, after)])
        self.function = both.map(horizon.intervals)

    def __call__(self, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the states after an interval, (N, 2n), and their derivatives by states before and drives."""
        after, *slopes = (result.full() for result in self.function(x.T, u.T))
        by_x, by_u = (slope.reshape(len(slope), len(x), -1).transpose(1, 0, 2) for slope in slopes)
        return after.T, by_x, by_u


def intervals(method: str, model: Model, horizon: Horizon) -> Step:
    """Return what integrates the intervals of a horizon."""
    if method == "gauss":
        return Collocation(model.dynamics, model.select, horizon.sample, horizon.steps)
    return CompiledStep(method, SEGMENTS, horizon)


class Filter:
    """An extended Kalman filter of the controller's model, with the published covariances of a sample of 10 ms."""

    def __init__(self, model: Model, x: Array, sample: float) -> None:
        self.model, self.x, n = model, x, model.n
        self.step = Collocation(model.dynamics, model.select, sample, max(round(sample / 0.015), 1))
        self.covariance = np.diag([0.05] * n + [1e-3] * n)
        self.process = np.diag([1e-4] + [1e-3] * (n - 1) + [1e-1] + [5e-1] * (n - 1))
        self.noise = 10.0 * np.diag([3e-5] * 3 + [5e-2] * 3 + [1e-3] * 3)

    def predict(self, u: Array) -> None:
        """Go on by a sample under the drives u."""
        x, by_x, _ = self.step(self.x[None], u[None])
        self.x, self.covariance = x[0], by_x[0] @ self.covariance @ by_x[0].T + self.process

    def correct(self, y: Array) -> Array:
        """Take measurements, (9,), and return the state."""
        expected, slope = self.model.measured(self.x)
        across = slope @ self.covariance
        gain = np.linalg.solve(across @ slope.T + self.noise, across).T
        self.x, self.covariance = self.x + gain @ (y - expected), self.covariance - gain @ across
        return self.x


def problem(model: Model, horizon: Horizon) -> Problem:
    """Return the published problem without its wall and floor, and with a weight of the tip at the end."""
    driven = np.isin(np.arange(model.n), model.driven)

    def weights(angle: float, deflection: float, rate: float, deflection_rate: float) -> Array:
        return np.append(np.where(driven, angle, deflection), np.where(driven, rate, deflection_rate))

    return Problem(
        intervals=horizon.intervals,
        duration=horizon.duration,
        state=weights(0.01, 0.01, 0.1, 10.0),
        last_state=weights(0.1, 0.01, 1.0, 10.0),
        drive=np.array([0.1, 1.0, 1.0]),
        tip=3e3,
        last_tip=1e4,
        effort=np.array([20.0, 10.0, 10.0]),
        rate=np.array([2.5, 3.5, 3.5]),
        excess=(1e3, 1e6),
        driven=model.driven,
    )


@dataclass(frozen=True)
class Run:
    """What samples show: distances of the tip to its goal, m, drives, N m, rates of driven joints, rad/s.

    And the processor time of what is done before the state is measured, and after it, s.
    """

    distances: Array
    drives: Array
    rates: Array
    before: Array
    after: Array

    @property
    def settled(self) -> int | None:
        """The first sample from which on the tip is within 20 mm, or None."""
        late = np.nonzero(self.distances > 0.02)[0]
        return int(late[-1]) + 1 if late[-1] + 1 < len(self.distances) else None

    @property
    def times(self) -> tuple[float, float]:
        """Medians of the times before the state is measured and after it, ms."""
        return 1e3 * float(np.median(self.before)), 1e3 * float(np.median(self.after))


def closed_loop(model: Model, plant: Model, horizon: Horizon, seconds: float, by: Step, noise: Array = NOISE) -> Run:
    """Return a motion of the plant from START to END, by what integrates intervals; noise has the same seed always."""
    random, sample = np.random.default_rng(1), horizon.sample
    here, goal = model.at_rest(START), model.at_rest(END)
    tracker, state = Tracker(problem(model, horizon), by, model.tip), Filter(model, here.x, sample)
    tracker.start(here.x, goal)
    x, effort = plant.at_rest(START).x, tracker.program.problem.effort
    rows: list[tuple[Any, ...]] = []
    for k in range(round(seconds / sample)):
        begin = time.process_time()
        if k:
            state.predict(rows[-1][1])
        tracker.prepare(sample if k else 0.0)
        ready = time.process_time()
        y = plant.measured(x)[0] + noise * random.standard_normal(len(noise))
        measured = time.process_time()
        u = np.clip(tracker.feedback(state.correct(y)), -effort, effort)
        done = time.process_time()
        off = float(np.linalg.norm(plant.tip(x)[0] - goal.tip))
        rows.append((off, u, x[plant.n + plant.driven], ready - begin, done - measured))
        q, v = np.split(x, 2)
        qs, vs = plant.kernel.rollout(q, v, plant.select @ u, duration=sample, method="rosenbrock", rtol=1e-6)
        x = np.append(qs[-1], vs[-1])
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))


def opening(model: Model, plant: Model, horizon: Horizon) -> str:
    """Say what is controlled by what."""
    return (
        f"controller: {model.n} coordinates, {horizon.intervals} intervals over {horizon.duration} s; plant: {plant.n}"
    )


def report(run: Run, horizon: Horizon) -> str:
    """Say what a run shows."""
    off, sample = run.distances, horizon.sample
    settled = "not within 20 mm" if run.settled is None else f"within 20 mm from {sample * run.settled:.2f} s on"
    drives, rates = (np.abs(found).max(axis=0).round(1) for found in (run.drives, run.rates))
    before, after = run.times
    return (
        f"tip: {1e3 * off[0]:.0f} mm to go, {settled}, at the end {1e3 * off[-1]:.1f} mm off\n"
        f"drives up to {drives} N m, rates up to {rates} rad/s\n"
        f"a sample of {1e3 * sample:.1f} ms: {before:.1f} ms before the state is measured, {after:.1f} ms after"
    )


class Linearization(NamedTuple):
    """What it takes to linearize all intervals of a horizon.

    Attributes:
        method, model: how intervals are integrated, and by whose equations.
        milliseconds: least processor time.
        error: largest error of an angle, mrad.
        ready: time until it could begin, s.
    """

    method: str
    model: str
    milliseconds: float
    error: float
    ready: float


def compare(model: Model, horizon: Horizon) -> list[Linearization]:
    """Measure what it takes to linearize the first prediction once and to get ready for that, and the angles' error."""
    tracker = Tracker(problem(model, horizon), intervals("gauss", model, horizon), model.tip)
    tracker.start(model.at_rest(START).x, model.at_rest(END))
    x, u = tracker.x[:-1], tracker.u

    def collocation(dynamics: Any) -> Step:
        return Collocation(dynamics, model.select, horizon.sample, horizon.steps)

    ways = {
        ("gauss", "eomgen, the states of all intervals in one call"): lambda: intervals("gauss", model, horizon),
        ("gauss", "CasADi's SX, interpreted"): lambda: collocation(PlainDynamics(SEGMENTS)),
        ("gauss", "CasADi's SX as C, `-O2`"): lambda: collocation(PlainDynamics(SEGMENTS, compiled=True)),
        ("gauss", "CasADi's integrator and its Newton's method"): lambda: PlainIntegrator(
            SEGMENTS, model.select, horizon.sample, horizon.steps
        ),
        ("implicit", "a step of `eomgen.adapters.casadi`"): lambda: intervals("implicit", model, horizon),
        ("rosenbrock", "a step of `eomgen.adapters.casadi`"): lambda: intervals("rosenbrock", model, horizon),
    }
    exact = Collocation(model.dynamics, model.select, horizon.sample, 16 * horizon.steps)(x, u)[0]
    found = []
    for name, make in ways.items():
        begin = time.perf_counter()
        by = make()
        after, ready, taken = by(x, u)[0], time.perf_counter(), []
        for _ in range(ROUNDS):
            start = time.process_time()
            by(x, u)
            taken.append(time.process_time() - start)
        error = 1e3 * np.abs(after - exact)[:, : model.n].max()
        found.append(Linearization(*name, 1e3 * min(taken), error, ready - begin))
    return found


class Solved(NamedTuple):
    """The first prediction as one nonlinear program, and by Gauss-Newton steps with a QP of HPIPM each.

    Attributes:
        method: how intervals are integrated.
        iterations, seconds, cost: of fatrop, its processor time, and what is to be least.
        steps, of_steps, cost_of_steps: how many steps come as near, their processor time, s, and the cost.
        apart: largest difference of a drive of both, N m.
        has_settled: whether drives change by less than NEAR at last.
    """

    method: str
    iterations: int
    seconds: float
    cost: float
    steps: int
    of_steps: float
    cost_of_steps: float
    apart: float
    has_settled: bool


def solved(model: Model, horizon: Horizon, method: str) -> Solved:
    """Solve the first prediction in both ways, from the guess that nothing moves."""
    by, here, goal = CompiledStep(method, SEGMENTS, horizon), model.at_rest(START), model.at_rest(END)
    program = WholeProgram(problem(model, horizon), by.states, tip(SEGMENTS))
    whole = program.solve(here.x, goal)
    tracker, steps, begin = Tracker(problem(model, horizon), by, model.tip), 0, time.process_time()
    tracker.start(here.x, goal, 0)
    change = np.inf
    while change > NEAR and steps < MOST_STEPS:
        before, steps = tracker.u.copy(), steps + 1
        tracker.prepare(0.0)
        tracker.feedback(here.x)
        change = np.abs(tracker.u - before).max()
    taken, apart = time.process_time() - begin, np.abs(tracker.u - whole.u).max()
    cost = program.cost(tracker.x, tracker.u, goal)
    return Solved(method, whole.iterations, whole.seconds, whole.cost, steps, taken, cost, apart, change <= NEAR)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seconds", type=float, nargs="?", default=2.0, help="of the motion; default 2")
    parser.add_argument("--method", choices=METHODS, default="gauss", help="of the intervals; default gauss")
    parser.add_argument("--coarse", action="store_true", help="30 intervals over 2 s, sampled as seldom")
    parser.add_argument("--times", action="store_true", help="of the linearization, beside CasADi alone")
    parser.add_argument("--whole", action="store_true", help="solve the first prediction by fatrop, too")
    arguments = parser.parse_args()
    horizon = COARSE if arguments.coarse else FINE
    model, plant = Model(SEGMENTS), Model(PLANT, "adaptive_rollout")
    print(opening(model, plant, horizon))
    by = intervals(arguments.method, model, horizon)
    print(report(closed_loop(model, plant, horizon, arguments.seconds, by), horizon))
    for row in compare(model, horizon) if arguments.times else ():
        way = f"{row.method}, {row.model}"
        print(f"{way}: {row.milliseconds:.1f} ms, error {row.error:.1g} mrad, ready in {row.ready:.1f} s")
    if arguments.whole:
        found = solved(model, horizon, "implicit" if arguments.method == "gauss" else arguments.method)
        print(f"{found.method}: fatrop {found.iterations} iterations, {1e3 * found.seconds:.0f} ms")
        print(f"HPIPM {found.steps} QPs, {1e3 * found.of_steps:.0f} ms; drives {found.apart:.1g} N m apart")


if __name__ == "__main__":
    main()
