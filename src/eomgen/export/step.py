"""The step that an exported model is simulated with where nobody gives one: the longest that RK4 takes safely."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..codegen.kernels.groups import ACCELERATION_SLOPES, POLES_OF_MECHANISMS
from ..errors import InputError, SingularError
from ..kernel.complete import Kernel
from ..names import listed
from ..pipeline.building import build
from ..pipeline.mechanisms import assembled_home
from ..progress import StageReport, no_report
from ..robot.internal_states.branches import BRANCHES
from ..robot.internal_states.drives import DRIVE
from ..robot.laws import COARSE
from ..robot.model import build_model
from ..robot.value import Robot
from ..state.drives import acceleration_slopes

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
    still = np.zeros(len(model.coordinates))
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
    return [still, np.array([limits[name] or 0.0 for name in model.coordinates])]


def _fastest(robot: Robot, v: Array, progress: StageReport) -> float:
    """Return the greatest modulus of an eigenvalue where the robot starts, 1/s; 0 where there is no acceleration."""
    is_closed = bool(build_model(robot).constraints)
    names = POLES_OF_MECHANISMS if is_closed else ACCELERATION_SLOPES
    kernel = _coarse(build(robot, kernels=names, flags=("-O0",), progress=progress))
    try:
        q = np.array(assembled_home(robot, progress)) if is_closed else np.zeros(kernel.n)
        rates = _slopes(kernel, q, v)
    except SingularError:
        return 0.0
    whole = np.vstack([np.eye(kernel.n, rates.shape[1], kernel.n), rates])
    return float(np.abs(np.linalg.eigvals(whole)).max()) if np.isfinite(whole).all() else 0.0


def _coarse(kernel: Kernel) -> Kernel:
    """Return the kernel with friction that reverses over COARSE at least."""
    narrow = {key for key, x in kernel.parameters.items() if key.endswith("friction.smoothing") and x < COARSE}
    return kernel.replaced(parameters=dict.fromkeys(narrow, COARSE)) if narrow else kernel


def _slopes(kernel: Kernel, q: Array, v: Array) -> Array:
    """Return derivatives of accelerations and rates of the m internal states by q, v and these, (n + m, 2 n + m).

    All states are 0.
    """
    calls, n, zero, z = kernel.calls, kernel.n, np.zeros(kernel.n), np.zeros(len(kernel.internal_states))
    if not kernel.constraints:
        by_q, by_v, _ = acceleration_slopes(kernel, q, np.append(v, z), zero)
        return np.hstack([by_q[:, :n], by_v])
    name, m = POLES_OF_MECHANISMS[0], z.size
    calls.run(name, None, (q, v, zero), z=z)  # or a singular mass matrix would go unseen
    values = calls.arguments(name, (q, v, zero), z)
    along = dict(zip("qvz", np.split(np.eye(2 * n + m), (n, 2 * n), axis=1), strict=True))
    rates = [along.get(x, np.zeros(np.shape(y))) for x, y in zip(calls.raw.functions[name].reads, values, strict=True)]
    return calls.run(f"{name}_tangent", None, [*values, *rates], whole=True)[:, : n + m].T
