"""The step that an exported model is simulated with where nobody gives one: the longest that RK4 takes safely."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..codegen.kernels.groups import ACCELERATION_SLOPES, POLES_OF_MECHANISMS
from ..errors import InputError, SingularError
from ..names import listed
from ..pipeline.building import build
from ..pipeline.mechanisms import assembled_home
from ..progress import StageReport, no_report
from ..robot.internal_states.branches import BRANCHES
from ..robot.internal_states.drives import DRIVE
from ..robot.laws import COARSE
from ..robot.model import build_model
from ..robot.value import Robot
from ..runtime.kernel import Kernel

LONGEST_STEP = 1e-3  # s, of co-simulation
PART = 0.2  # of 1 / the fastest eigenvalue: a step of the Runge-Kutta method


def default_step(robot: Robot, method: str, progress: StageReport = no_report) -> float:
    """Return LONGEST_STEP, or less where the Runge-Kutta method needs it: of 1, 2 or 5 times a power of ten, s.

    By the eigenvalues about the state where all coordinates are zero, of robots with loops about their closed home,
    with friction that reverses over COARSE at least, as for ``integrate``: explicit steps chatter where it is narrower.
    Where laws have states also with velocities at their limits, as these states follow the faster.

    Raises:
        InputError: the Runge-Kutta method is asked for, and a coordinate whose law has a state has no velocity limit.
    """
    if method != "rk4":
        return LONGEST_STEP
    rate = max(_fastest(robot, v, progress) for v in _velocities(robot))
    longest = min(LONGEST_STEP, PART / rate) if rate > 0.0 else LONGEST_STEP
    power = 10.0 ** math.floor(math.log10(longest) + 1e-9)
    return float(f"{max(digit * power for digit in (1, 2, 5) if digit * power <= longest * (1.0 + 1e-9)):.0e}")


def _velocities(robot: Robot) -> list[Array]:
    """Return velocities at which eigenvalues are looked at, (n,): at rest, and at limits where laws have states."""
    model = build_model(robot)
    still = np.zeros(model.size)
    if not model.internal_states:
        return [still]
    owners = dict.fromkeys((x.owner, x.prefix) for x in model.states if x.law not in (BRANCHES, DRIVE))
    of_joints = [owner for owner, prefix in owners if prefix.startswith("joints.")]
    limits = {name: robot.limits_of(name).velocity for name in (*model.coordinates, *of_joints)}
    unlimited = [owner for owner, _ in owners if limits.get(owner) is None]
    if unlimited:
        raise InputError(
            f"step: internal states of {listed(unlimited)} follow the faster, the faster these move, and there is no"
            " velocity limit; allowed: a step, limits of velocity, or another method than rk4"
        )
    fast = still.copy()
    fast[: len(model.coordinates)] = [limits[name] or 0.0 for name in model.coordinates]
    return [still, fast]


def _fastest(robot: Robot, v: Array, progress: StageReport) -> float:
    """Return the greatest modulus of an eigenvalue where the robot starts, 1/s; 0 where there is no acceleration."""
    try:
        by_q, by_v = (_closed if build_model(robot).constraints else _open)(robot, v, progress)
    except SingularError:
        return 0.0
    whole = np.block([[np.zeros_like(by_q), np.eye(len(by_q))], [by_q, by_v]])
    return float(np.abs(np.linalg.eigvals(whole)).max()) if np.isfinite(whole).all() else 0.0


def _open(robot: Robot, v: Array, progress: StageReport) -> tuple[Array, Array]:
    """Return derivatives of the accelerations by q and v, (n, n) each, where all coordinates are zero."""
    kernel = _coarse(build(robot, kernels=ACCELERATION_SLOPES, flags=("-O0",), progress=progress)).augmented
    zero = np.zeros(kernel.n)
    return kernel.forward_dynamics_jacobian(zero, v, zero)[:2]


def _coarse(kernel: Kernel) -> Kernel:
    """Return the kernel with friction that reverses over COARSE at least."""
    narrow = {key for key, x in kernel.parameters.items() if key.endswith("friction.smoothing") and x < COARSE}
    return kernel.replaced(parameters=dict.fromkeys(narrow, COARSE)) if narrow else kernel


def _closed(robot: Robot, v: Array, progress: StageReport) -> tuple[Array, Array]:
    """Return the same of a robot with loops at its assembled home."""
    names = POLES_OF_MECHANISMS
    kernel = _coarse(build(robot, kernels=names, flags=("-O0",), progress=progress)).augmented
    n, zero = kernel.n, np.zeros(kernel.n)
    q = np.array([*assembled_home(robot, progress), *(0.0 for _ in kernel.internal_states)])
    kernel.calls.run(names[0], None, (q, v, zero))  # or a singular mass matrix would go unseen
    directions, still = np.eye(n), np.zeros((n, n))
    states = [
        kernel.jvp(names[0], (q, v, zero), (dq, dv, zero))[:, :n].T
        for dq, dv in ((directions, still), (still, directions))
    ]
    return states[0], states[1]
