"""The problem of the horizon as one nonlinear program for fatrop, an interior-point method that goes stage by stage."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from prediction import Goal, Problem

Array = Any
OPTIONS = {"print_level": 0, "tol": 1e-6, "max_iter": 300}


@dataclass(frozen=True)
class Solution:
    """States, (N + 1, 2n), and drives, (N, drives), the iterations and the processor time that they took, s."""

    x: Array
    u: Array
    iterations: int
    seconds: float


class WholeProgram:
    """The nonlinear program of a problem, its Jacobian in blocks and its Hessian as Gauss and Newton have it.

    ``step`` is a function of CasADi, (x, u) -> (next x, its derivatives by x and u); ``tip`` is x -> (place, slope).
    Variables are x, u and the excess s of the rates, stage after stage, then the last x.  Constraints of a stage are its
    dynamics, then the first state, or bounds of the rates.
    """

    def __init__(self, problem: Problem, step: Any, tip: Any) -> None:
        self.problem = problem
        count, self.nx, self.m = problem.intervals, len(problem.state), len(problem.drive)
        self.stage, self.interval = self.nx + 2 * self.m, problem.duration / count
        self.size = count * self.stage + self.nx
        w = casadi.MX.sym("w", self.size)
        p = casadi.MX.sym("p", 2 * self.nx + self.m + 3)  # first state, then the goal
        stages = [self._parts(w, k) for k in range(count)]
        last = w[count * self.stage :]
        first, goal, held, place = (p[a:b] for a, b in self._places())
        value, gradient, hessian = casadi.MX(0), [], []
        for k, (x, u, s) in enumerate([*stages, (last, None, None)]):
            at, slope = tip(x)
            h = self.interval if k < count else 1.0
            weights, pull = (problem.state, problem.tip) if k < count else (problem.last_state, problem.last_tip)
            value += h / 2 * (casadi.dot(weights, (x - goal) ** 2) + pull * casadi.sumsqr(at - place))
            gradient.append(h * (weights * (x - goal) + pull * slope.T @ (at - place)))
            hessian.append(h * (casadi.diag(weights) + pull * slope.T @ slope))
            if k < count:
                excess, square = problem.excess
                value += h / 2 * casadi.dot(problem.drive, (u - held) ** 2)
                value += h * (excess * casadi.sum1(s) + square / 2 * casadi.sumsqr(s))
                gradient += [h * problem.drive * (u - held), h * (excess + square * s)]
                hessian.append(h * casadi.diag(casadi.DM([*problem.drive, *[square] * self.m])))
        rows, jacobian = [], []
        for k, (x, u, s) in enumerate(stages):
            after, by_x, by_u = step(x, u)
            following = stages[k + 1][0] if k + 1 < count else last
            rows.append(following - after)
            jacobian.append(self._wide(k, [-by_x, -by_u, casadi.DM(self.nx, self.m), casadi.DM.eye(self.nx)]))
            rows.append(x - first if k == 0 else self._rates(x, s))
            jacobian.append(self._wide(k, [casadi.DM.eye(self.nx)] if k == 0 else [self._rate_slopes()]))
        g, slopes = casadi.vertcat(*rows), casadi.vertcat(*jacobian)
        scale, multipliers = casadi.MX.sym("scale"), casadi.MX.sym("multipliers", g.numel())
        names = {"jac_g": ([w, p], [g, slopes], ["x", "p"], ["g", "jac_g_x"])}
        names["grad_f"] = ([w, p], [value, casadi.vertcat(*gradient)], ["x", "p"], ["f", "grad_f_x"])
        upper = casadi.triu(scale * casadi.diagcat(*hessian))
        names["hess_lag"] = ([w, p, scale, multipliers], [upper], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])
        made = {name: casadi.Function(f"nlp_{name}", *parts) for name, parts in names.items()}
        structure = {"structure_detection": "manual", "N": count, "nx": [self.nx] * (count + 1)}
        structure |= {"nu": [2 * self.m] * count + [0], "ng": [self.nx, *[2 * self.m] * (count - 1), 0]}
        options = {**structure, **made, "fatrop": OPTIONS, "print_time": False}
        self.solver = casadi.nlpsol("whole", "fatrop", {"x": w, "p": p, "f": value, "g": g}, options)

    def _places(self) -> list[tuple[int, int]]:
        ends = np.cumsum([0, self.nx, self.nx, self.m, 3]).tolist()
        return list(zip(ends[:-1], ends[1:], strict=True))

    def _parts(self, w: Any, k: int) -> tuple[Any, Any, Any]:
        x = w[k * self.stage : (k + 1) * self.stage]
        return x[: self.nx], x[self.nx : self.nx + self.m], x[self.nx + self.m :]

    def _wide(self, k: int, blocks: list[Any]) -> Any:
        """Put blocks of rows side by side from stage k on, between zeros."""
        block = casadi.horzcat(*blocks)
        before, behind = k * self.stage, self.size - k * self.stage - block.shape[1]
        return casadi.horzcat(casadi.MX(block.shape[0], before), block, casadi.MX(block.shape[0], behind))

    def _rates(self, x: Any, s: Any) -> Any:
        """Return rates of driven joints, less the excess, then with it."""
        rates = x[(self.nx // 2 + self.problem.driven).tolist()]
        return casadi.vertcat(rates - s, rates + s)

    def _rate_slopes(self) -> Any:
        x, s = casadi.SX.sym("x", self.nx), casadi.SX.sym("s", self.m)
        rows = self._rates(x, s)
        drives = casadi.DM(2 * self.m, self.m)
        return casadi.horzcat(casadi.DM(casadi.jacobian(rows, x)), drives, casadi.DM(casadi.jacobian(rows, s)))

    def solve(self, x: Array, goal: Goal) -> Solution:
        """Return the motion from a state to a goal, from the guess that nothing moves.

        Raises:
            RuntimeError: fatrop does not converge.
        """
        p, count, free = self.problem, self.problem.intervals, np.full(self.nx, np.inf)
        low = np.append(np.tile(np.concatenate([-free, -p.effort, np.zeros(self.m)]), count), -free)
        high = np.append(np.tile(np.concatenate([free, p.effort, np.full(self.m, np.inf)]), count), free)
        still, one = np.zeros(self.nx), np.full(self.m, np.inf)
        below = np.append(still, np.concatenate([still, *[np.concatenate([still, -one, -p.rate])] * (count - 1)]))
        above = np.append(still, np.concatenate([still, *[np.concatenate([still, p.rate, one])] * (count - 1)]))
        guess = np.append(np.tile(np.concatenate([x, goal.u, np.zeros(self.m)]), count), x)
        given = np.concatenate([x, goal.x, goal.u, goal.tip])
        begin = time.process_time()
        found = self.solver(x0=guess, p=given, lbx=low, ubx=high, lbg=below, ubg=above)
        seconds, stats = time.process_time() - begin, self.solver.stats()
        if not stats["success"]:
            raise RuntimeError(f"fatrop finds no solution: {stats['return_status']}")
        w = found["x"].full().ravel()
        stages = w[: -self.nx].reshape(count, self.stage)
        states = np.vstack([stages[:, : self.nx], w[-self.nx :]])
        return Solution(states, stages[:, self.nx : self.nx + self.m], int(stats["iter_count"]), seconds)
