"""Predictive control by real-time iterations (M. Diehl and others, 2005): one QP a sample, about shifted iterates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

Array = Any
Step = Callable[[Array, Array], tuple[Array, Array, Array]]  # next states, and derivatives by states and drives
Tip = Callable[[Array], tuple[Array, Array]]  # places of the tip, and derivatives by states
DYNAMICS = np.inf  # marks where derivatives of the dynamics stand among the constraints
TOLERANCES = {
    "res_g_max": 1e-2,
    "res_b_max": 1e-5,
    "res_d_max": 1e-5,
    "res_m_max": 1e-3,
}  # 6 of 8 iterations are enough
LARGE = 1e3  # rad, rad/s, N m: takes the place of bounds that there are not; HPIPM does not converge with 1e8


@dataclass(frozen=True)
class Problem:
    """What is to be least within which bounds; weights of a stage are multiplied by the length of its interval.

    Rates of driven joints may exceed their bounds, for ``excess``: weights of that and of half its square.
    """

    intervals: int
    duration: float  # s
    state: Array  # half the squares of states less those of the goal, (2n,)
    last_state: Array
    drive: Array  # half the squares of drives less those of the goal, (drives,)
    tip: float  # half the square of the tip's distance to that of the goal
    last_tip: float
    effort: Array  # N m
    rate: Array  # rad/s
    excess: tuple[float, float]
    driven: Array  # places of the driven coordinates among all


@dataclass(frozen=True)
class Goal:
    """A state at rest, the drives that hold it, and where the tip is then."""

    x: Array
    u: Array
    tip: Array


class QuadraticProgram:
    """The QP of a problem for HPIPM, which solves it from stage to stage.

    Variables are the changes of x and u and the excess s of the rates, stage after stage, then the change of the last
    x.  The first x is known: it acts on the right sides alone.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        count, nx, m = problem.intervals, len(problem.state), len(problem.drive)
        self.nx, self.m, self.stage = nx, m, nx + 2 * m
        self.interval = problem.duration / count
        self.blocks = np.zeros((count, self.stage, self.stage))  # of the Hessian, without that of the last state
        weights = np.concatenate([np.zeros(nx), problem.drive, np.full(m, problem.excess[1])])
        self.blocks[:] = self.interval * np.diag(weights)
        self.rows = nx * count + 2 * m * (count - 1)
        structure: dict[str, Any] = {"N": count, "nx": [0, *[nx] * count], "nu": [2 * m] * count + [0], "inf": LARGE}
        structure |= {"ng": [0] + [2 * m] * (count - 1) + [0], "hpipm": TOLERANCES}
        self.solver = casadi.conic("qp", "hpipm", {"h": self._hessian_shape(), "a": self._constraints()}, structure)
        # numbers that the solver reads and writes where they are; without room for guesses HPIPM's interface fails
        self.given = {name: np.zeros(self.solver.nnz_in(name)) for name in self.solver.name_in()}
        self.results = {name: np.zeros(self.solver.nnz_out(name)) for name in self.solver.name_out()}
        self.buffer, self.evaluate = self.solver.buffer()

    def _hessian_shape(self) -> Any:
        """Return the sparsity of the Hessian: a dense block for each stage."""
        sizes = [2 * self.m, *[self.stage] * (self.problem.intervals - 1), self.nx]
        return casadi.diagcat(*[casadi.DM.ones(size, size) for size in sizes]).sparsity()

    def _constraints(self) -> Any:
        """Return the sparsity of the constraints; set the constant numbers and the places of the dynamics among them.

        A stage has the rows of its dynamics, then those of the bounds of its rates, which the first does not need.
        """
        count, nx, m, stage = self.problem.intervals, self.nx, self.m, self.stage
        rows, columns, values = [], [], []

        def put(row: int, column: int, block: Array) -> None:
            for i, j in zip(*np.nonzero(block), strict=True):
                rows.append(row + i), columns.append(column + j), values.append(block[i, j])

        rates = np.zeros((m, nx))
        rates[np.arange(m), nx // 2 + self.problem.driven] = 1.0
        # rates less their excess are below the upper bound, with it above the lower
        within = np.hstack([np.tile(rates, (2, 1)), np.zeros((2 * m, m)), np.vstack([-np.eye(m), np.eye(m)])])
        for k in range(count):
            row, column = k * nx + max(k - 1, 0) * 2 * m, k * stage - nx
            put(row, max(column, 0), np.full((nx, nx + m if k else m), DYNAMICS))
            put(row, column + stage, -np.eye(nx))
            if k:
                put(row + nx, column, within)
        order = np.lexsort([rows, columns])  # column by column, as CasADi stores them
        self.constant = np.array(values)[order]
        places = np.empty(len(order), int)
        places[order] = np.arange(len(order))
        self.dynamics = places[np.array(values) == DYNAMICS]
        return casadi.Sparsity.triplet(self.rows, count * stage, [int(i) for i in rows], [int(j) for j in columns])

    def set_dynamics(self, by_state: Array, by_drive: Array) -> None:
        """Write the derivatives of the discrete dynamics, (N, nx, nx) and (N, nx, drives)."""
        self.by_first = by_state[0]
        both = np.concatenate([by_state[1:], by_drive[1:]], axis=2)
        self.given["a"][:] = self.constant
        self.given["a"][self.dynamics] = np.append(by_drive[0], both)

    def set_objective(self, x: Array, u: Array, tip: tuple[Array, Array], goal: Goal) -> None:
        """Write the Hessian of Gauss and Newton and the gradient at iterates; ``tip`` has places and derivatives."""
        p, h, nx, m = self.problem, self.interval, self.nx, self.m
        (*before, last), places = tip[1], tip[0] - goal.tip
        slope = np.array(before)
        self.blocks[:, :nx, :nx] = h * (np.diag(p.state) + p.tip * slope.transpose(0, 2, 1) @ slope)
        first, others = self.blocks[0, nx:, nx:].ravel(), self.blocks[1:].ravel()
        end = np.diag(p.last_state) + p.last_tip * last.T @ last
        self.given["h"][:] = np.concatenate([first, others, end.ravel()])
        gradient = np.full((p.intervals, self.stage), h * p.excess[0])
        pulled = np.einsum("kij,ki->kj", slope, places[:-1])
        gradient[:, :nx] = h * (p.state * (x[:-1] - goal.x) + p.tip * pulled)
        gradient[:, nx : nx + m] = h * p.drive * (u - goal.u)
        end = p.last_state * (x[-1] - goal.x) + p.last_tip * places[-1] @ last
        self.given["g"][:] = np.append(gradient.ravel()[nx:], end)

    def set_bounds(self, x: Array, u: Array, after: Array) -> None:
        """Write bounds at iterates, of which the dynamics make the states ``after``."""
        p, nx, m = self.problem, self.nx, self.m
        low, high = np.full((2, p.intervals, self.stage), [[[-np.inf]], [[np.inf]]])
        low[:, nx : nx + m], high[:, nx : nx + m] = -p.effort - u, p.effort - u
        low[:, nx + m :] = 0.0
        last = np.full(nx, np.inf)
        self.given["lbx"][:] = np.append(low.ravel()[nx:], -last)
        self.given["ubx"][:] = np.append(high.ravel()[nx:], last)
        gaps, rates = x[1:] - after, x[1:-1, nx // 2 + p.driven]
        free = np.full_like(rates, np.inf)
        below, above = np.hstack([gaps[1:], -free, -p.rate - rates]), np.hstack([gaps[1:], p.rate - rates, free])
        self.row_bounds = [np.append(gaps[0], side) for side in (below, above)]

    def solve(self, change: Array) -> tuple[Array, Array]:
        """Return the changes of states and drives where the first state changes by ``change``.

        Raises:
            RuntimeError: the solver finds none.
        """
        known = np.zeros(self.rows)
        known[: self.nx] = self.by_first @ change
        self.given["lba"][:], self.given["uba"][:] = (side - known for side in self.row_bounds)
        # each time anew: the interface of HPIPM loses them
        for name, array in self.given.items():
            self.buffer.set_arg(self.solver.index_in(name), memoryview(array))
        for name, array in self.results.items():
            self.buffer.set_res(self.solver.index_out(name), memoryview(array))
        self.evaluate()
        if self.buffer.ret():
            raise RuntimeError("HPIPM finds no solution of the QP")
        flat = np.append(change, self.results["x"])
        stages = flat[: -self.nx].reshape(-1, self.stage)
        return np.vstack([stages[:, : self.nx], flat[-self.nx :]]), stages[:, self.nx : self.nx + self.m]


class Tracker:
    """A controller: ``prepare`` before the state of a sample is known, ``feedback`` when it is."""

    def __init__(self, problem: Problem, step: Step, tip: Tip) -> None:
        self.step, self.tip, self.program = step, tip, QuadraticProgram(problem)

    def start(self, x: Array, goal: Goal, iterations: int = 10) -> None:
        """Iterate before a motion begins, from a state that stays as it is on."""
        count = self.program.problem.intervals
        self.goal, self.x, self.u = goal, np.tile(x, (count + 1, 1)), np.tile(goal.u, (count, 1))
        for _ in range(iterations):
            self.prepare(0.0)
            self.feedback(x)

    def prepare(self, elapsed: float) -> None:
        """Shift the iterates by the time since the last sample, s, linearize about them and write the QP."""
        part = elapsed / self.program.interval
        self.x[:-1] += part * np.diff(self.x, axis=0)
        self.u[:-1] += part * np.diff(self.u, axis=0)
        after, *slopes = self.step(self.x[:-1], self.u)
        self.program.set_dynamics(*slopes)
        self.program.set_objective(self.x, self.u, self.tip(self.x), self.goal)
        self.program.set_bounds(self.x, self.u, after)

    def feedback(self, x: Array) -> Array:
        """Return the drives for a state, those of the QP that begins there."""
        by_state, by_drive = self.program.solve(x - self.x[0])
        self.x += by_state
        self.u += by_drive
        return self.u[0].copy()
