"""The problem of the horizon as one nonlinear program for fatrop, an interior-point method that goes stage by stage."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from prediction import Goal, Problem

Array = Any
OPTIONS = {"print_level": 0, "tol": 1e-4, "max_iter": 300}  # round-off of gradients ends at 2e-5


@dataclass(frozen=True)
class Solution:
    """States, (N + 1, 2n), and drives, (N, drives), their cost, the iterations and the processor time, s."""

    x: Array
    u: Array
    cost: float
    iterations: int
    seconds: float


def straight(function: Any) -> Any:
    """Return the function with its Jacobian, and without derivatives of that: second ones are left out."""
    inputs = [casadi.MX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())]
    value = function(*inputs)
    found = function.jacobian()(*inputs, value)
    slopes = [casadi.densify(x) for x in (found if isinstance(found, (list, tuple)) else [found])]
    name, result = function.name(), casadi.MX.sym("result", value.sparsity())
    fixed = {"is_diff_in": [False] * (len(inputs) + 1), "never_inline": True}
    jacobian = casadi.Function(f"jac_straight_{name}", [*inputs, result], slopes, fixed)
    options = {"custom_jacobian": jacobian, "jac_penalty": 0, "never_inline": True}
    return casadi.Function(f"straight_{name}", inputs, [value], options)


class WholeProgram:
    """The nonlinear program of a problem, with the Gauss-Newton Hessian.

    ``step`` and ``tip`` are functions of CasADi, (x, u) -> next x and x -> place.  Variables are x, u and the excess s
    of the rates, stage after stage, then the last x.  Constraints of a stage are its dynamics, then the first state, or
    bounds of the rates.
    """

    def __init__(self, problem: Problem, step: Any, tip: Any) -> None:
        self.problem, following, tip_of = problem, straight(step), straight(tip)
        count, self.nx, self.m = problem.intervals, len(problem.state), len(problem.drive)
        self.stage, self.interval = self.nx + 2 * self.m, problem.duration / count
        self.size = count * self.stage + self.nx
        w = casadi.MX.sym("w", self.size)
        p = casadi.MX.sym("p", 2 * self.nx + self.m + 3)  # first state, then the goal
        stages = [self._parts(w, k) for k in range(count)]
        last = w[count * self.stage :]
        first, goal, held, place = (p[a:b] for a, b in self._places())
        value, rows = casadi.MX(0), []
        for k, (x, u, s) in enumerate([*stages, (last, None, None)]):
            h = self.interval if k < count else 1.0
            weights, pull = (problem.state, problem.tip) if k < count else (problem.last_state, problem.last_tip)
            value += h / 2 * (casadi.dot(weights, (x - goal) ** 2) + pull * casadi.sumsqr(tip_of(x) - place))
            if k < count:
                excess, square = problem.excess
                value += h / 2 * casadi.dot(problem.drive, (u - held) ** 2)
                value += h * (excess * casadi.sum1(s) + square / 2 * casadi.sumsqr(s))
                after = stages[k + 1][0] if k + 1 < count else last
                rows += [after - following(x, u), x - first if k == 0 else self._rates(x, s)]
        structure = {"structure_detection": "manual", "N": count, "nx": [self.nx] * (count + 1)}
        structure |= {"nu": [2 * self.m] * count + [0], "ng": [self.nx, *[2 * self.m] * (count - 1), 0]}
        self.value = casadi.Function("value", [w, p], [value])
        program = {"x": w, "p": p, "f": value, "g": casadi.vertcat(*rows)}
        self.solver = casadi.nlpsol("whole", "fatrop", program, {**structure, "fatrop": OPTIONS, "print_time": False})

    def _places(self) -> list[tuple[int, int]]:
        ends = np.cumsum([0, self.nx, self.nx, self.m, 3]).tolist()
        return list(itertools.pairwise(ends))

    def _parts(self, w: Any, k: int) -> tuple[Any, Any, Any]:
        x = w[k * self.stage : (k + 1) * self.stage]
        return x[: self.nx], x[self.nx : self.nx + self.m], x[self.nx + self.m :]

    def _rates(self, x: Any, s: Any) -> Any:
        """Return rates of driven joints, less the excess, then with it."""
        rates = x[(self.nx // 2 + self.problem.driven).tolist()]
        return casadi.vertcat(rates - s, rates + s)

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
        given = self._given(x, goal)
        begin = time.process_time()
        found = self.solver(x0=guess, p=given, lbx=low, ubx=high, lbg=below, ubg=above)
        seconds, stats = time.process_time() - begin, self.solver.stats()
        if not stats["success"]:
            raise RuntimeError(f"fatrop finds no solution: {stats['return_status']}")
        w = found["x"].full().ravel()
        stages = w[: -self.nx].reshape(count, self.stage)
        states = np.vstack([stages[:, : self.nx], w[-self.nx :]])
        drives = stages[:, self.nx : self.nx + self.m]
        return Solution(states, drives, float(found["f"]), int(stats["iter_count"]), seconds)

    def cost(self, x: Array, u: Array, goal: Goal) -> float:
        """Return the cost of states, (N + 1, 2n), and drives, (N, drives); rates exceed their bounds as they must."""
        excess = np.maximum(np.abs(x[:-1, self.nx // 2 + self.problem.driven]) - self.problem.rate, 0.0)
        excess[0] = 0.0
        w = np.append(np.hstack([x[:-1], u, excess]).ravel(), x[-1])
        return float(self.value(w, self._given(x[0], goal)))

    @staticmethod
    def _given(x: Array, goal: Goal) -> Array:
        return np.concatenate([x, goal.x, goal.u, goal.tip])
