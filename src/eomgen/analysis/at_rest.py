"""Static equilibria under gravity and dead wrenches, with contacts that close and loops; exact derivatives.

Newton's method inside a pseudo-transient continuation: the steps are those of an overdamped motion, linearly implicit,
whose time step grows without limit.  A coordinate in its clearance falls to the end that it rests on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arrays import RANK, Array, Mask
from ..errors import IntegrationError
from ..kernel.complete import Kernel
from ..runtime.singular import inertias
from ..shown import Shown
from ..state.drives import drives_at_rest
from ..state.internal_states import at_rest_with, forces_needed, refuse_moving
from .holding import Fixation, notes_of_play
from .tangent_system import LinearSystem, MotionState, Tangent, load_force, moving_basis, reduced, tangent

STEPS = 400
CLOSED = 1e-12  # m, or sine of an angle: a loop that is closed
ROUND_OFF = 1e-10  # of a pose that somebody else has closed
LONGEST = 0.5  # m or rad, of a step
# s^2, pseudo-time: a force on a mass m moves it by force / m times this
FIRST, GROWTH, LAST, SHORTEST = 1e-2, 5.0, 1e14, 1e-12
SMALL = 1e-11  # of a coordinate's size: round-off
POSE = 1e-14  # m or rad, or of the largest coordinate: round-off of the pose, which stiff coordinates pass on to others


@dataclass(frozen=True)
class RestState(Shown):
    """A static equilibrium.

    Attributes:
        q: coordinates, (n,).
        u: forces that hold it, (n,), N or N m: of drives, and of what is held.
        multipliers: of the loops' constraint, (constraints,).
        tangent: derivatives there, gains of drives not among them.
        notes: what is remarkable: coordinates that float in their clearance, a state that is not stable.
    """

    q: Array
    u: Array
    multipliers: Array
    tangent: Tangent
    notes: tuple[str, ...]


def rest(
    kernel: Kernel,
    q: Array,
    fixation: Fixation,
    loads: Mapping[str, Array] | None = None,
    *,
    sagging: bool = False,
) -> RestState:
    """Return the static equilibrium near q, (n,); internal states stay as ``fixation.z`` has them.

    Args:
        kernel: float64, with the kernels of ``options.KERNELS`` and ``mechanism_kernels``.
        q: where to begin; ``fixation.still`` stays there.
        fixation: what stays.
        loads: dead wrenches by frame, see ``options.checked_loads``.
        sagging: drives with gains hold their coordinates as springs about q, instead of exactly.

    Raises:
        IntegrationError: there is none near q; names the coordinate that stays out of balance.
        LoopError: loops do not close near q.
    """
    loads, zero, rates = loads or {}, np.zeros(kernel.n), at_rest_with(kernel, fixation.z)
    refuse_moving(kernel, fixation.z)
    target, springs = q.copy(), fixation.kp if sagging else zero
    still = fixation.still & ~(fixation.driven & (springs > 0.0))
    q = closed(kernel, q, still)
    inertia = inertias(kernel.residual_jacobian(q, zero, zero, z=fixation.z)[2])
    tau, before = FIRST, np.inf
    for _ in range(STEPS):
        force = forces_needed(kernel, q, rates, zero) - load_force(kernel, q, loads) + springs * (q - target)
        multipliers, closing = _constraint(kernel, q, force, still)
        slopes = tangent(kernel, q, rates, zero, loads, multipliers)
        basis, _ = moving_basis(kernel, q, ~still)
        K = slopes.K + np.diag(springs)
        change = closing
        if basis.shape[1]:
            left = basis.T @ (force + K @ closing)
            matrix, tau = _stable(basis.T @ K @ basis, basis.T @ np.diag(inertia) @ basis, tau)
            change = closing - basis @ _solve(matrix, left)
        size = np.minimum(1.0, 10.0 * inertia / np.maximum(np.abs(np.diagonal(K)), 1e-300))
        imbalance = float(np.linalg.norm((basis.T @ force) / np.sqrt(basis.T**2 @ inertia)))
        small = (np.abs(change) <= SMALL * size + POSE * max(1.0, np.abs(q).max())).all()
        if small and (tau > 1.0 or imbalance == before):
            return _rest_state(kernel, (q + change, rates), target, springs, still, loads)
        q = q + change * min(1.0, LONGEST / max(float(np.abs(change).max()), 1e-300))
        tau = min(tau * (GROWTH if imbalance <= before else 0.5), LAST)
        before = imbalance
    spread = np.where(still, 0.0, np.abs(change) / size)
    worst = kernel.coordinates[int(np.argmax(spread))]
    raise IntegrationError(
        f"{kernel.name}: no static equilibrium near the pose: {worst} stays out of balance; give it a stiffness, or"
        " list it in fixed"
    )


def closed(kernel: Kernel, q: Array, still: Mask) -> Array:
    """Return the pose near q, (n,), in which loops are closed and couplings kept; what is ``still`` stays.

    Where more stays than the mechanism has freedoms, the pose may be closed already, up to round-off, which is shared.

    Raises:
        LoopError: there is none near q.
    """
    if not kernel.constraints:
        return np.array(q)
    names = [name for name, stays in zip(kernel.coordinates, still, strict=True) if stays]
    if np.abs(kernel.functions.constraint(q)).max() <= ROUND_OFF:
        names = []
    return np.asarray(kernel.assemble(q, fixed=names))


def _rest_state(
    kernel: Kernel,
    state: tuple[Array, Array],
    target: Array,
    springs: Array,
    still: Mask,
    loads: Mapping[str, Array],
) -> RestState:
    (q, rates), zero = state, np.zeros(kernel.n)
    needed = forces_needed(kernel, q, rates, zero) - load_force(kernel, q, loads)
    multipliers, _ = _constraint(kernel, q, needed + springs * (q - target), still)
    reaction = kernel.functions.constraint_jacobian(q).T @ multipliers if kernel.constraints else zero
    u = np.where(still, needed - reaction, -springs * (q - target))
    slopes = tangent(kernel, q, rates, zero, loads, multipliers)
    notes = notes_of_play(kernel, q)
    basis, independent = moving_basis(kernel, q, ~still)
    if independent:
        K = basis.T @ (slopes.K + np.diag(springs)) @ basis
        root = np.sqrt(np.maximum(np.abs(np.diagonal(K)), 1e-300))
        values, vectors = np.linalg.eigh(0.5 * (K + K.T) / np.outer(root, root))
        if values[0] < -1e-9:
            name = kernel.coordinates[independent[int(np.argmax(np.abs(vectors[:, 0])))]]
            notes.append(f"the state is not stable: it buckles along {name}")
    return RestState(q, u, multipliers, slopes, tuple(notes))


def _constraint(kernel: Kernel, q: Array, force: Array, still: Mask) -> tuple[Array, Array]:
    """Return multipliers of least norm that balance a force best, and the smallest change that closes the loops."""
    change = np.zeros(kernel.n)
    if not kernel.constraints:
        return np.zeros(0), change
    J = kernel.functions.constraint_jacobian(q)[:, ~still]
    residual = kernel.functions.constraint(q)
    if np.abs(residual).max() > CLOSED:
        change[~still] = -np.linalg.lstsq(J, residual, rcond=RANK)[0]
    return np.asarray(np.linalg.lstsq(J.T, force[~still], rcond=RANK)[0], float), change


def _stable(K: Array, M: Array, tau: float) -> tuple[Array, float]:
    """Return M / tau + K and the longest time step, at most tau, with which it is positive definite: no way uphill."""
    while tau > SHORTEST:
        matrix = M / tau + K
        scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(matrix)), 1e-300))
        scaled = 0.5 * (matrix + matrix.T) * np.outer(scale, scale)
        if np.linalg.eigvalsh(scaled)[0] > -1e-12:
            break
        tau *= 0.3
    return M / tau + K, tau


def _solve(matrix: Array, right: Array) -> Array:
    """Solve with rows and columns of the same size; least squares where that is singular."""
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(matrix)), 1e-300))
    scaled = matrix * np.outer(scale, scale)
    try:
        return np.asarray(scale * np.linalg.solve(scaled, scale * right))
    except np.linalg.LinAlgError:
        return np.asarray(scale * np.linalg.lstsq(scaled, scale * right, rcond=None)[0])


def system_at_rest(
    kernel: Kernel, q: Array, fixation: Fixation, loads: Mapping[str, Array] | None = None
) -> tuple[LinearSystem, RestState]:
    """Return the linear system about the static equilibrium near q, and that; arguments and errors as of ``rest``.

    Drives that are not locked have the inputs and states with which they hold it, or are refused.
    """
    state = rest(kernel, q, fixation, loads)
    locked = {name for name, stays in zip(kernel.coordinates, fixation.locked, strict=True) if stays}
    u, z = drives_at_rest(kernel, state.q, state.u, fixation.z, fixed=locked)
    still = MotionState(state.q, at_rest_with(kernel, z), np.zeros(kernel.n), u)
    return reduced(kernel, still, state.tangent, fixation, state.notes), state
