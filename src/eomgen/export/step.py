"""The step that an exported model is simulated with where nobody gives one: the longest that RK4 takes safely."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import SingularError
from ..pipeline.mechanisms import assembled_home
from ..pipeline.stages import build
from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.value import Robot

LONGEST_STEP = 1e-3  # s, of co-simulation
PART = 0.2  # of 1 / the fastest eigenvalue: a step of the Runge-Kutta method


def default_step(robot: Robot, method: str, progress: StageReport = no_report) -> float:
    """Return LONGEST_STEP, or less where the Runge-Kutta method needs it: of 1, 2 or 5 times a power of ten, s.

    By the eigenvalues about the state where all coordinates are zero, of robots with loops about their closed home.
    """
    if method != "rk4":
        return LONGEST_STEP
    rate = _fastest(robot, progress)
    longest = min(LONGEST_STEP, PART / rate) if rate > 0.0 else LONGEST_STEP
    power = 10.0 ** math.floor(math.log10(longest) + 1e-9)
    return float(f"{max(digit * power for digit in (1, 2, 5) if digit * power <= longest * (1.0 + 1e-9)):.0e}")


def _fastest(robot: Robot, progress: StageReport) -> float:
    """Return the greatest modulus of an eigenvalue where the robot starts, 1/s; 0 where there is no acceleration."""
    try:
        by_q, by_v = (_closed if build_model(robot).constraints else _open)(robot, progress)
    except SingularError:
        return 0.0
    whole = np.block([[np.zeros_like(by_q), np.eye(len(by_q))], [by_q, by_v]])
    return float(np.abs(np.linalg.eigvals(whole)).max()) if np.isfinite(whole).all() else 0.0


def _open(robot: Robot, progress: StageReport) -> tuple[Array, Array]:
    """Return derivatives of the accelerations by q and v, (n, n) each, where all coordinates are zero."""
    kernel = build(robot, kernels=("forward_dynamics_jacobian",), flags=("-O0",), progress=progress)
    zero = np.zeros(kernel.n)
    return kernel.forward_dynamics_jacobian(zero, zero, zero)[:2]


def _closed(robot: Robot, progress: StageReport) -> tuple[Array, Array]:
    """Return the step of a robot with loops at its assembled home, at rest."""
    names = ("constrained_dynamics", "constrained_dynamics_tangent")
    kernel = build(robot, kernels=names, flags=("-O0",), progress=progress)
    n, zero = kernel.n, np.zeros(kernel.n)
    q = np.array([*assembled_home(robot, progress), *(0.0 for _ in kernel.memory)])
    kernel.calls.run("constrained_dynamics", None, (q, zero, zero))  # or a singular mass matrix would go unseen
    directions, still = np.eye(n), np.zeros((n, n))
    states = [
        kernel.jvp("constrained_dynamics", (q, zero, zero), (dq, dv, zero))[:, :n].T
        for dq, dv in ((directions, still), (still, directions))
    ]
    return states[0], states[1]
