"""First-order changes of the equations of motion about a state, exact: what modes, responses and deflections need.

With r = M a + bias - Q the residual without drives, J the Jacobian of a frame under the dead wrench w, and g the
constraint of loop joints,

    r(q, v, a) = u + J^T w + (dg/dq)^T lambda

changes by M da + (dr/dv) dv + K dq with K = dr/dq - d(J^T w)/dq - d((dg/dq)^T lambda)/dq.  All parts are derivatives
in closed form; the last two are the geometric stiffness.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..arrays import RANK, Array, Index, Mask, independent_columns, rank_by
from ..errors import InputError, SingularError
from ..kernel.complete import Kernel
from ..names import joint_of
from ..runtime.internal_states import split_state
from ..runtime.singular import null_coordinates, scaled_eigenvalues
from ..shown import Shown
from ..state.drives import is_of_drive, stores_energy
from ..state.internal_states import InternalStates, slopes_of, states_of, zero_note
from .holding import Fixation

SINGULAR = 1e-5  # of the greatest singular value: what less belongs to a singular pose that is met to 1e-12 m
SWEEPS = 10  # of balancing internal states
BENT = 1e-6  # of second derivatives, m/rad^2 and the like: round-off


def frame_hessian(J: Array) -> Array:
    """Return second derivatives of a frame's motion from its Jacobian, (6, n, n): entry [:, i, j] is dJ_i/dq_j.

    Along the path to a frame coordinate order is the order of the elementary transforms.  What is upstream turns a
    column as a whole; downstream it moves the point that a rotation's column refers to.  Columns of coordinates
    off the path are zero.
    """
    n = J.shape[1]
    linear, axes = J[:3].T, J[3:].T
    order = np.arange(n)
    first, last = np.minimum.outer(order, order), np.maximum.outer(order, order)
    result = np.zeros((6, n, n))
    result[:3] = np.moveaxis(np.cross(axes[first], linear[last]), -1, 0)
    turned = np.cross(axes[np.newaxis, :], axes[:, np.newaxis])  # [i, j] = w_j x w_i
    turned[order[:, np.newaxis] <= order] = 0.0
    result[3:] = np.moveaxis(turned, -1, 0)
    return result


def constraint_hessian(kernel: Kernel, q: Array) -> Array:
    """Return second derivatives of the loops' constraint, (constraints, n, n): its bias is v^T H v, polarised."""
    n = kernel.n
    row, column = np.triu_indices(n)
    unit = np.eye(n)
    both = kernel.functions.constraint_bias(q, unit[row] + unit[column])
    single = kernel.functions.constraint_bias(q, unit)
    half = 0.5 * (both - single[row] - single[column])
    result = np.empty((both.shape[1], n, n))
    result[:, row, column] = result[:, column, row] = half.T
    return result


def load_force(kernel: Kernel, q: Array, loads: Mapping[str, Array]) -> Array:
    """Return generalized forces J^T w of dead wrenches at frames, (n,)."""
    return sum((kernel.frame_jacobian(q, frame).T @ w for frame, w in loads.items()), np.zeros(kernel.n))


class MotionState(NamedTuple):
    """State of a motion: q, a and the drives u that make it, (n,) each; v with internal states behind, (n + m,)."""

    q: Array
    v: Array
    a: Array
    u: Array


@dataclass(frozen=True)
class Tangent(Shown):
    """Tangent matrices at a state.

    Attributes:
        K, D, M: stiffness (with the geometric one), damping and mass, (n, n) each.
        whole: derivatives of the residual, with rows and columns of internal states, as of ``slopes_of``.
    """

    K: Array
    D: Array
    M: Array
    whole: tuple[Array, Array, Array]


def tangent(
    kernel: Kernel,
    q: Array,
    v: Array,
    a: Array,
    loads: Mapping[str, Array],
    multipliers: Array | None = None,
    u: Array | None = None,
) -> Tangent:
    """Return the derivatives at a state, drives constant: within their limits, or where inputs u leave them.

    Internal states stand behind v, (n + m,).
    """
    n, whole = kernel.n, slopes_of(kernel, q, v, a, u)
    K, D, M = (matrix[:n, :n].copy() for matrix in whole)
    for frame, w in loads.items():
        K -= np.einsum("k,kij->ij", w, frame_hessian(kernel.frame_jacobian(q, frame)))
    if multipliers is not None and multipliers.any():
        K -= np.einsum("k,kij->ij", multipliers, constraint_hessian(kernel, q))
    return Tangent(K, D, M, whole)


def moving_basis(kernel: Kernel, q: Array, moving: Mask, stays: Array | None = None) -> tuple[Array, tuple[int, ...]]:
    """Return changes of all coordinates per change of the independent ones, (n, m), and which those are.

    Without loops all that may move is independent.  With loops the null space of the constraint's Jacobian, in those
    coordinates that describe it best.  ``stays``: derivatives by q of what else does not change, (k, n).
    """
    index = np.flatnonzero(moving)
    rows = [kernel.functions.constraint_jacobian(q)] if kernel.constraints else []
    rows += [stays] if stays is not None and len(stays) else []
    if not rows:
        return np.eye(kernel.n)[:, index], tuple(int(i) for i in index)
    J = np.concatenate(rows)[:, index]
    _, S, Vt = np.linalg.svd(J)
    null = Vt[rank_by(S) :].T
    chosen = sorted(independent_columns(null.T, null.shape[1]))
    basis = np.zeros((kernel.n, len(chosen)))
    basis[index] = null @ np.linalg.inv(null[chosen])
    return basis, tuple(int(index[i]) for i in chosen)


def refuse_singular_pose(kernel: Kernel, q: Array, moving: Mask) -> None:
    """Refuse a pose at which the loops' constraint has a smaller rank than beside it: a bifurcation, a dead centre.

    To first order there are motions then that no motion of the mechanism begins with, so that nothing linear about the
    pose means anything.  With U the left and e, f vectors of the right null space of the constraint's Jacobian that is
    so where U^T (d^2 g / dq^2 e f) does not vanish.  Where constraints are redundant in all poses it does: the null
    space is that of a manifold.

    Args:
        kernel: with the kernels of ``pipeline.mechanisms.mechanism_kernels``.
        q: coordinates that close the loops, (n,).
        moving: which of them may move, (n,).

    Raises:
        InputError: it is one; names the loop.
    """
    index = np.flatnonzero(moving)
    if not kernel.constraints or not index.size:
        return
    U, S, Vt = np.linalg.svd(kernel.functions.constraint_jacobian(q)[:, index])
    rank = int((S / max(S.max(initial=0.0), 1e-300) > SINGULAR).sum())
    left, null = U[:, rank:], Vt[rank:].T
    if not left.size or not null.size:
        return
    H = constraint_hessian(kernel, q)[:, index[:, np.newaxis], index]
    bent = np.abs(np.einsum("kl,kij,ia,jb->lab", left, H, null, null)).max(axis=(1, 2))
    if bent.max() <= BENT * max(1.0, float(np.abs(H).max())):
        return
    worst = int(np.abs(left[:, int(bent.argmax())]).argmax())
    loop = joint_of(kernel.constraints[worst])
    raise InputError(
        f"{kernel.name}: at this pose loop {loop} is singular: the rank of the constraints drops to {rank}, so that not"
        f" all of the {null.shape[1]} motions that they leave to first order can be made; allowed: a pose beside it"
    )


def _is_of_free_drive(state: str, independent: Container[str]) -> bool:
    """Tell whether an internal state is one of a drive whose coordinate is among the independent ones."""
    return is_of_drive(state) and split_state(state)[0] in independent


def _basis_rates(
    kernel: Kernel, q: Array, basis: Array, bound: Index, J_rate: Array, J_second: Array
) -> tuple[Array, Array]:
    """Return first and second derivative of a basis by time, (n, m) each, from J N = 0.

    Independent rows are constant.
    """
    inverse = np.linalg.pinv(kernel.functions.constraint_jacobian(q)[:, bound], rcond=RANK)
    rate, second = np.zeros_like(basis), np.zeros_like(basis)
    rate[bound] = -inverse @ (J_rate @ basis)
    second[bound] = -inverse @ (2.0 * J_rate @ rate + J_second @ basis)
    return rate, second


@dataclass(frozen=True, kw_only=True)
class LinearSystem(Shown):
    """M e'' + D e' + K e = basis^T f about a state; e the change of m independent coordinates, f generalized forces.

    With internal states, ``internal_states``, they resist by F dz on the left side.

    Attributes:
        kernel: of the robot.
        q, a: the state, (n,) each.
        v: its rates, with internal states behind, (n + m,).
        u: drives there, (n,), as ``Kernel.inputs`` has them, or forces where only these are known; held forces, N or
            N m.
        independent: names of the independent coordinates, m.
        basis: change of all coordinates per independent one, (n, m).
        basis_rate: of it along the motion, (n, m); 0 at rest and without loops.
        M, D, K: (m, m).
        internal_states: internal states, without those of what is locked.
        notes: lines about what was assumed.
        inputs: of drives with states, (n,); None: they are within their limits.
    """

    kernel: Kernel
    q: Array
    v: Array
    a: Array
    u: Array
    independent: tuple[str, ...]
    basis: Array
    basis_rate: Array
    M: Array
    D: Array
    K: Array
    internal_states: InternalStates
    notes: tuple[str, ...]
    inputs: Array | None = None

    def hefts(self) -> Array:
        """Return factors that make internal states as large as rates of coordinates, (p,).

        They are sqrt(w); of states that store no energy those by which what they act with and what moves them is alike.
        """
        laws, size = self.internal_states, 1.0 / np.sqrt(np.diagonal(self.M))
        factors = np.sqrt(laws.inertia)
        light = np.flatnonzero([not stores_energy(name) for name in laws.names])
        factors[light] = 1.0
        speed = np.sqrt(np.linalg.norm(self.K * np.outer(size, size))) or 1.0
        for k in np.tile(light, SWEEPS):
            beside = np.arange(factors.size) != k
            acting = np.linalg.norm(size * laws.acts[:, k]) + np.linalg.norm((laws.by_z[:, k] * factors)[beside])
            moved = np.linalg.norm(laws.by_v[k] * size) + np.linalg.norm(laws.by_q[k] * size) / speed
            moved += np.linalg.norm((laws.by_z[k] / factors)[beside])
            if acting > 0.0 and moved > 0.0:
                factors[k] = np.sqrt(acting / moved)
        return factors

    def condensed(self, mask: Mask | None = None) -> LinearSystem:
        """Return the system in which states that stick hold as springs do, those of the mask, or all."""
        which = self.internal_states.stick if mask is None else mask
        if not which.any():
            return self
        stiffness = self.internal_states.acts[:, which] @ self.internal_states.by_v[which]
        return replace(self, K=self.K + stiffness, internal_states=self.internal_states.without(which))


def reduced(
    kernel: Kernel,
    state: MotionState,
    tangents: Tangent,
    fixation: Fixation,
    notes: tuple[str, ...] = (),
    bending: tuple[Array, Array] | None = None,
) -> LinearSystem:
    """Return the system in independent coordinates, what is locked left out, gains of the drives added.

    Where nothing can move, it has no coordinates, and says so in its notes.  With constraints the changes are N e,
    N the basis, all along the motion: those of rates are N e' + N' e, those of accelerations N e'' + 2 N' e' + N'' e.

    Args:
        kernel: of the robot.
        state: that the system is about.
        tangents: derivatives there.
        fixation: what is locked, and gains.
        notes: further lines.
        bending: about a motion with constraints: the first and the second derivative by time of their Jacobian.

    Raises:
        InputError: a loop is singular there, see ``refuse_singular_pose``.
        SingularError: a coordinate moves no inertia.
    """
    q = state.q
    refuse_singular_pose(kernel, q, ~fixation.locked)
    basis, independent = moving_basis(kernel, q, ~fixation.locked)
    names = tuple(kernel.coordinates[i] for i in independent)
    whole = tangents.M, tangents.D + np.diag(fixation.kd), tangents.K + np.diag(fixation.kp)
    rate, second = np.zeros_like(basis), np.zeros_like(basis)
    if bending is not None:
        moving = np.flatnonzero(~fixation.locked)
        rate, second = _basis_rates(kernel, q, basis, np.setdiff1d(moving, independent), *bending)
    M, D, K = (basis.T @ matrix @ basis for matrix in whole)
    D += basis.T @ (2.0 * whole[0] @ rate)
    K += basis.T @ (whole[1] @ rate + whole[0] @ second)
    if not independent:
        notes = (*notes, "nothing can move: what is held leaves the robot rigid (free or pd drives, fewer fixed: move)")
    elif scaled_eigenvalues(M)[0][0] <= 1e-13:
        if (bent := kernel.calls.bent_too_far(q)) is not None:
            raise SingularError(f"{kernel.name}: the mass matrix cannot be inverted: {bent}")
        null = " and ".join(null_coordinates(M, names))
        raise SingularError(f"{kernel.name}: the mass matrix cannot be inverted at {null}: it moves no inertia there")
    every = states_of(kernel, tangents.whole, basis, rate)
    internal_states = every.taking_part()
    idle = [name for name in every.names if name not in internal_states.names and _is_of_free_drive(name, names)]
    if idle:
        said = "their loops are at a limit, where nothing moves them and they act on nothing"
        notes = (*notes, f"states of drives are left out, {', '.join(idle)}: {said}")
    sticks = zip(internal_states.names, internal_states.stick, strict=True)
    sticking = [name for name, stays in sticks if stays and not is_of_drive(name)]
    if sticking:
        notes = (*notes, zero_note(sticking))
    return LinearSystem(
        kernel=kernel,
        **state._asdict(),
        independent=names,
        basis=basis,
        basis_rate=rate,
        M=M,
        D=D,
        K=K,
        internal_states=internal_states,
        notes=(*fixation.notes, *notes),
    )
