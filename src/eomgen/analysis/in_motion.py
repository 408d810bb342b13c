"""The linear system about a motion at one time, its loops closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import RANK, Array, Mask
from ..codegen.kernels.groups import SLOPES_OF_CLOSURE
from ..errors import InputError, LoopError
from ..kernel.complete import Kernel
from ..names import joint_of
from ..pipeline.building import build
from ..runtime.internal_states import cut_apart
from ..runtime.loop_errors import left_open
from ..state.drives import has_drives
from ..state.internal_states import forces_needed
from ..state.vectors import prescribed_mask, state_vector
from .at_rest import closed
from .holding import notes_of_play
from .options import HeldRobot
from .tangent_system import LinearSystem, MotionState, constraint_hessian, load_force, moving_basis, reduced, tangent

OPEN = 1e-9  # of the greatest of what adds up: more is not round-off


def moving_system(arm: HeldRobot, q: Array, v: ArrayLike, a: ArrayLike | None, u: ArrayLike | None) -> LinearSystem:
    """Return the system about a motion at one time: drives are constant, or gains about the motion.

    Args:
        arm: the robot.
        q: coordinates, (n,); loops are closed near them, what is still stays.
        v: rates of coordinates, (n,).
        a, u: accelerations or drives as ``Kernel.inputs`` has them, (n,); one of them.  With accelerations drives with
            states are within their limits.

    Raises:
        InputError: both or none of a and u, or one is no such array.
        LoopError: v or a open a loop, or these drives cannot make the motion.
    """
    driving = a if u is None else u
    if driving is None or (a is not None and u is not None):
        raise InputError("a and u: a motion is set by one of them; allowed: v and a, or v and u")
    kernel = arm.kernel
    rates = np.append(state_vector("v", v, kernel.coordinates), arm.fixation.z)
    wanted = state_vector("a" if u is None else "u", driving, kernel.coordinates)
    if kernel.constraints:
        return _closed_system(arm, closed(kernel, q, arm.fixation.still), rates, wanted, is_drive=u is not None)
    dead = load_force(kernel, q, arm.loads)
    inputs = wanted if u is not None and has_drives(kernel) else None
    if u is None:
        acceleration = wanted
    else:
        missing = _exerted(kernel, q, rates, wanted) + dead - forces_needed(kernel, q, rates, 0 * q)
        M, free = _masses(kernel, q, rates), ~arm.fixation.locked
        acceleration = np.zeros(kernel.n)
        acceleration[free] = np.linalg.solve(M[np.ix_(free, free)], missing[free])
    forces = forces_needed(kernel, q, rates, acceleration) - dead
    forces = forces if inputs is None else np.where(arm.fixation.locked, forces, inputs)
    slopes = tangent(kernel, q, rates, acceleration, arm.loads, u=inputs)
    state, unsaid = MotionState(q, rates, acceleration, forces), replace(arm.fixation, notes=())  # those are about rest
    return replace(reduced(kernel, state, slopes, unsaid, tuple(notes_of_play(kernel, q))), inputs=inputs)


def _exerted(kernel: Kernel, q: Array, rates: Array, u: Array) -> Array:
    """Return the forces of drives on coordinates under inputs u, (n,), N or N m."""
    v, z = cut_apart(rates, kernel.n)
    return np.asarray(kernel.functions.drive_forces(q, v, u, z=z)) if has_drives(kernel) else u


def _needed(kernel: Kernel, q: Array, rates: Array, a: Array) -> Array:
    """Return the forces that a motion takes, loops open, (n,): the residual without what drives do."""
    v, z = cut_apart(rates, kernel.n)
    zero = np.zeros(kernel.n)
    needed = kernel.residual(q, v, a, zero, z=z)
    return np.asarray(needed + _exerted(kernel, q, rates, zero))


def _masses(kernel: Kernel, q: Array, rates: Array) -> Array:
    """Return the mass matrix of a motion, (n, n), loops open."""
    v, z = cut_apart(rates, kernel.n)
    return np.asarray(kernel.residual_jacobian(q, v, np.zeros(kernel.n), z=z)[2])


def _closed_system(arm: HeldRobot, q: Array, rates: Array, driving: Array, *, is_drive: bool) -> LinearSystem:
    """Return the system about a motion with loops closed; ``driving`` are the drives, or the accelerations, (n,)."""
    kernel, fixation, v = arm.kernel, arm.fixation, rates[: arm.kernel.n]
    inputs = driving if is_drive and has_drives(kernel) else None
    driving = _exerted(kernel, q, rates, driving) if is_drive else driving
    J, bias = kernel.functions.constraint_jacobian(q), kernel.functions.constraint_bias(q, v)
    _refuse_opening(kernel, J @ v, np.abs(J).max() * np.abs(v).max(), "v", "/s", "v of kernel.project_velocity")
    dead = load_force(kernel, q, arm.loads)
    if is_drive:
        a = _accelerations(kernel, q, rates, J, bias, driving + dead, ~fixation.locked)
    else:
        a = driving
        size = max(float(np.abs(J).max() * np.abs(a).max()), float(np.abs(bias).max()))
        _refuse_opening(kernel, J @ a + bias, size, "a", "/s^2", "those of its motion, or u")
    needed = _needed(kernel, q, rates, a) - dead
    prescribed = prescribed_mask(kernel)
    u = driving.copy() if is_drive else np.zeros(kernel.n)
    basis, _ = moving_basis(kernel, q, ~prescribed)
    if not is_drive:
        u[fixation.driven] = np.linalg.lstsq(basis[fixation.driven].T, basis.T @ needed, rcond=RANK)[0]
    held = fixation.locked if is_drive else prescribed
    basis, _ = moving_basis(kernel, q, ~held)
    left = np.abs(basis.T @ (needed - u)).max(initial=0.0)
    if not left <= 1e-8 * max(1.0, float(np.abs(needed).max())):
        names = ", ".join(np.array(kernel.coordinates)[fixation.driven])
        raise LoopError(
            f"{kernel.name}: drives at {names or 'no coordinate'} cannot make this motion: {left:.3g} N or N m are"
            " left; allowed: drives that hold the mechanism, or v and u",
            loop=joint_of(kernel.constraints[0]),
            gap=float(left),
        )
    multipliers = np.asarray(np.linalg.lstsq(J[:, ~held].T, (needed - u)[~held], rcond=RANK)[0], float)
    u[held] = (needed - J.T @ multipliers)[held]
    u = u if inputs is None else np.where(held, u, inputs)
    slopes = tangent(kernel, q, rates, a, arm.loads, multipliers, inputs)
    bending = _jacobian_rates(arm, q, v, a)
    state, unsaid = MotionState(q, rates, a, u), replace(fixation, notes=())  # those are about rest
    return replace(reduced(kernel, state, slopes, unsaid, tuple(notes_of_play(kernel, q)), bending), inputs=inputs)


def _accelerations(kernel: Kernel, q: Array, rates: Array, J: Array, bias: Array, forces: Array, moving: Mask) -> Array:
    """Return accelerations, (n,), under generalized forces, loops closed; what does not move has none."""
    a = np.zeros(kernel.n)
    a[moving] = -np.linalg.lstsq(J[:, moving], bias, rcond=RANK)[0]
    size = max(float(np.abs(J).max() * np.abs(a).max()), float(np.abs(bias).max()))
    _refuse_opening(kernel, J @ a + bias, size, "what stays", "/s^2", "fewer coordinates that stay")
    basis, independent = moving_basis(kernel, q, moving)
    if independent:
        missing = basis.T @ (forces - _needed(kernel, q, rates, a))
        a += basis @ np.linalg.solve(basis.T @ _masses(kernel, q, rates) @ basis, missing)
    return np.asarray(a)


def _jacobian_rates(arm: HeldRobot, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Return first and second derivative by time of the constraint's Jacobian, (constraints, n) each.

    With H the second derivatives of g the bias is v^T H v, whose derivatives by q are those of H along the motion.
    """
    kernel = arm.kernel
    beside = build(arm.robot, kernels=SLOPES_OF_CLOSURE)
    beside.parameters.update(kernel.parameters)
    H, along = constraint_hessian(kernel, q), np.eye(kernel.n)
    states, rates = (np.tile(x, (kernel.n, 1)) for x in (q, v))
    by_q = beside.jvp(beside.functions.constraint_bias, (states, rates), (along, np.zeros_like(along))).T
    return H @ v, H @ a + by_q


def _refuse_opening(kernel: Kernel, violations: Array, size: float, what: str, per: str, allowed: str) -> None:
    """Raise LoopError if velocities or accelerations open a loop by more than round-off of their size."""
    if np.abs(violations).max() > OPEN * max(1.0, size):
        raise left_open(kernel.raw, violations, f"opens at {what}", allowed, per)
