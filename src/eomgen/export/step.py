"""The step that an exported model is simulated with where nobody gives one: the longest that RK4 takes safely."""

from __future__ import annotations

import math

import numpy as np

from ..errors import SingularError
from ..pipeline.stages import build
from ..progress import StageReport, no_report
from ..robot.value import Robot
from ..runtime.kernel import Kernel

LONGEST_STEP = 1e-3  # s, of co-simulation
PART = 0.2  # of 1 / the fastest eigenvalue: a step of the Runge-Kutta method


def default_step(robot: Robot, method: str, progress: StageReport = no_report) -> float:
    """LONGEST_STEP, or less where the Runge-Kutta method needs it: of 1, 2 or 5 times a power of ten, s.

    By the eigenvalues about the state where all coordinates are zero.
    """
    if method != "rk4":
        return LONGEST_STEP
    rate = _fastest(build(robot, kernels=("forward_dynamics_jacobian",), flags=("-O0",), progress=progress))
    longest = min(LONGEST_STEP, PART / rate) if rate > 0.0 else LONGEST_STEP
    power = 10.0 ** math.floor(math.log10(longest) + 1e-9)
    return float(f"{max(digit * power for digit in (1, 2, 5) if digit * power <= longest * (1.0 + 1e-9)):.0e}")


def _fastest(kernel: Kernel) -> float:
    """The greatest modulus of an eigenvalue where all coordinates are zero, 1/s; 0 where there is no acceleration."""
    zero = np.zeros(kernel.n)
    try:
        by_q, by_v, _ = kernel.forward_dynamics_jacobian(zero, zero, zero)
    except SingularError:
        return 0.0
    whole = np.block([[np.zeros_like(by_q), np.eye(kernel.n)], [by_q, by_v]])
    return float(np.abs(np.linalg.eigvals(whole)).max()) if np.isfinite(whole).all() else 0.0
