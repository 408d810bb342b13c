"""An arm with elastic gears from rest to rest with the least effort: direct collocation with CasADi and IPOPT.

    python examples/least_effort.py [INTERVALS]

Between a motor and its joint the gear winds up, and what it stores comes back.  The drives are to bring the arm from
hanging to stretched out in one second, with the least integral of the squares of their torques, and to leave nothing
that rings.  Hermite and Simpson's collocation; the accelerations are the kernel's C, their first and second
derivatives are exact.  For comparison the same is solved with a Hessian that IPOPT makes up from gradients (limited
memory).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

import eomgen
from eomgen.adapters.casadi import function, kernels_for
from eomgen.description import robot_from_toml

ARM = """
name = "springy_arm"
gravity = [0.0, -9.81, 0.0]

[[links]]
name = "upper"
mass = 2.0
com = [0.2, 0.0, 0.0]
inertia = { xx = 1e-3, yy = 3e-2, zz = 3e-2 }

[[links]]
name = "fore"
mass = 1.0
com = [0.15, 0.0, 0.0]
inertia = { xx = 1e-3, yy = 1e-2, zz = 1e-2 }

[[joints]]
name = "shoulder"
parent = "base"
child = "upper"
type = "revolute"
motor = { inertia = 1e-4, ratio = 50.0, stiffness = 150.0, damping = 0.5 }

[[joints]]
name = "elbow"
parent = "upper"
child = "fore"
type = "revolute"
placement = { xyz = [0.4, 0.0, 0.0] }
motor = { inertia = 5e-5, ratio = 50.0, stiffness = 60.0, damping = 0.2 }
"""

DURATION = 1.0  # s
START, GOAL = (-np.pi / 2, 0.0), (0.0, 0.0)  # rad: hanging, stretched out
IPOPT = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.limited_memory_max_history": 30,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.tol": 1e-6,
    "ipopt.max_iter": 1000,
}


@dataclass(frozen=True)
class Motion:
    """States [q, v], (intervals + 1, 2n), and drives at the intervals' ends and middles, (motors, 2 intervals + 1).

    ``effort`` is the integral of the squared torques, N^2 m^2 s; ``defect`` the greatest residue of the collocation.
    """

    states: Any
    drives: Any
    effort: float
    defect: float
    iterations: int


class Collocation:
    """The problem for a number of intervals: states and drives as variables, scaled, defects as constraints."""

    def __init__(self, kernel: eomgen.Kernel, intervals: int) -> None:
        n, motors = kernel.n, list(kernel.motors)
        self.kernel, self.n, self.intervals = kernel, n, intervals
        scale = np.array([kernel.ratio(name) if name in motors else 1.0 for name in kernel.coordinates])
        self.scale = np.concatenate([scale, scale])
        select = np.array([[float(name == motor) for motor in motors] for name in kernel.coordinates])
        dynamics = function(kernel, "forward_dynamics")
        x, u = casadi.MX.sym("x", 2 * n), casadi.MX.sym("u", len(motors))
        whole = casadi.DM(self.scale) * x
        a = dynamics(whole[:n], whole[n:], casadi.DM(select) @ u)
        rate = casadi.Function("rate", [x, u], [casadi.vertcat(x[n:], a / casadi.DM(scale))])
        h = DURATION / intervals
        self.opti = opti = casadi.Opti()
        self.x = opti.variable(2 * n, intervals + 1)
        self.u = opti.variable(len(motors), 2 * intervals + 1)
        ends, middles = self.u[:, ::2], self.u[:, 1::2]
        slopes = rate.map(intervals + 1)(self.x, ends)
        left, right = self.x[:, :-1], self.x[:, 1:]
        inside = (left + right) / 2 + h / 8 * (slopes[:, :-1] - slopes[:, 1:])
        self.defects = (
            right - left - h / 6 * (slopes[:, :-1] + 4 * rate.map(intervals)(inside, middles) + slopes[:, 1:])
        )
        opti.subject_to(casadi.vec(self.defects) == 0)
        joints = [i for i, name in enumerate(kernel.coordinates) if name not in motors]
        for place, angles in ((0, START), (intervals, GOAL)):
            opti.subject_to(self.x[joints, place] == casadi.DM(list(angles)))
            opti.subject_to(slopes[:, place] == 0)  # at rest, and so it stays
        squares = casadi.sum1(self.u**2)
        self.effort = h / 6 * casadi.sum2(squares[:, :-1:2] + 4 * squares[:, 1::2] + squares[:, 2::2])
        line = np.linspace(START, GOAL, intervals + 1).T
        guess = np.zeros((2 * n, intervals + 1))
        for row, name in enumerate(kernel.coordinates):
            guess[row] = line[joints.index(kernel.coordinates.index(kernel.motors.get(name, name)))]
        opti.set_initial(self.x, guess)

    def solve(self, objective: Any, first: Motion | None = None, hessian: str = "exact") -> Motion:
        """The motion with the least value of the objective; from ``first`` on, if it is given.

        ``hessian`` is "exact" or "limited-memory".
        """
        opti = self.opti
        opti.minimize(objective)
        if first is not None:
            opti.set_initial(self.x, first.states.T / self.scale[:, None])
            opti.set_initial(self.u, first.drives)
        opti.solver("ipopt", {**IPOPT, "ipopt.hessian_approximation": hessian})
        found = opti.solve()
        return Motion(
            self.scale * found.value(self.x).T,
            found.value(self.u),
            float(found.value(self.effort)),
            float(np.abs(found.value(self.defects)).max()),
            found.stats()["iter_count"],
        )


def main(intervals: int) -> None:
    robot = robot_from_toml(ARM)
    kernel = eomgen.build(robot, kernels=(*kernels_for("forward_dynamics"), "energy"))
    problem = Collocation(kernel, intervals)
    some = problem.solve(0.0)
    least = problem.solve(problem.effort, some)
    approximate = problem.solve(problem.effort, some, "limited-memory")
    for name, motion in (("some motion", some), ("the best", least), ("by limited memory", approximate)):
        print(
            f"{name}: effort {motion.effort:.4f} N^2 m^2 s, greatest torque {np.abs(motion.drives).max():.2f} N m,"
            f" defect {motion.defect:.1e}, {motion.iterations} iterations"
        )
    q, v = np.hsplit(least.states, 2)
    kinetic = kernel.energy(q, v)[:, 0]
    print(f"at rest at both ends: {kinetic[0]:.1e} J, {kinetic[-1]:.1e} J; {kinetic.max():.2f} J between")
    upper, gear = (kernel.coordinates.index(f"shoulder.{name}") for name in ("gamma", "motor"))
    wound = q[:, gear] / 50.0 - q[:, upper]
    print(f"the shoulder's gear winds up by {np.abs(wound).max():.3f} rad")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
