"""Internal states beside a kernel's coordinates: vectors of both, and their rows in linear systems.

There z' = G_q dq + G_v dv + G_z dz, and they resist motion by F dz.
A state whose rate depends on velocities alone, G_q = 0 and G_z = 0, as of bristles that stick, is z = G_v e and a
constant: it adds the stiffness F G_v, and an eigenvalue of 0 for the constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index, Mask
from ..errors import InputError, UnknownNameError
from ..kernel.complete import Kernel
from ..names import listed, nearest_or_all, show
from ..robot.internal_states.branches import BRANCHES
from ..runtime.internal_states import cut_apart, split_state
from ..shown import Shown
from .drives import drive_slopes, has_drives
from .vectors import state_vector

StatesLike = Mapping[str, float] | ArrayLike  # of laws, (m,), or by their names

GOLDEN = 0.6180339887498949
FINE = 1e-300  # m/s or rad/s: a velocity that only has a direction
STICKS = 1e-200  # 1/s: a rate of a state at such a velocity


def state_values(kernel: Kernel, z: StatesLike | None) -> Array:
    """Return internal states, (m,), m or rad: zeros where nothing is said, or by names, those left out 0.

    Raises:
        InputError: no law of the robot has a state.
        UnknownNameError: a name is none of ``kernel.internal_states``.
        ArrayError: another shape, or numbers that are not finite.
    """
    if z is None:
        return np.zeros(len(kernel.internal_states))
    if not kernel.internal_states:
        kernel.calls.refuse_z(0.0)
    if not isinstance(z, Mapping):
        return state_vector("z", z, kernel.internal_states)
    for name in z:
        if name not in kernel.internal_states:
            raise UnknownNameError(
                f"z: {show(str(name))} is unknown{nearest_or_all(str(name), kernel.internal_states)}"
            )
    return state_vector("z", [z.get(name, 0.0) for name in kernel.internal_states], kernel.internal_states)


def refuse_moving(kernel: Kernel, z: Array) -> None:
    """Refuse states of Maxwell branches, which a robot at rest does not have: they settle to 0.

    Raises:
        InputError: there is one.
    """
    for name, value in zip(kernel.internal_states, z, strict=True):
        if split_state(name)[1] == BRANCHES and value != 0.0:
            raise InputError(f"z: {name} = {value:g}, which settles to 0 at rest; allowed: 0, or a motion")


def at_rest_with(kernel: Kernel, z: Array) -> Array:
    """Return velocities of a robot at rest, with the states z of its laws, (m,), behind, (n + m,)."""
    return np.append(np.zeros(kernel.n), z)


@dataclass(frozen=True, kw_only=True)
class InternalStates(Shown):
    """Internal states beside m independent coordinates, p of them.

    Attributes:
        names: of the states.
        places: where they stand in arrays of the state, (p,).
        inertia: w, such that w z^2 / 2 is what a state stores, (p,).
        acts: generalized forces against the motion per state, F, (m, p).
        by_q, by_v, by_z: slopes of the states' rates, (p, m), (p, m), (p, p).
    """

    names: tuple[str, ...]
    places: Index
    inertia: Array
    acts: Array
    by_q: Array
    by_v: Array
    by_z: Array

    @property
    def stick(self) -> Mask:
        """Which rates depend on velocities alone, (p,)."""
        return np.asarray(~(self.by_q.any(axis=1) | self.by_z.any(axis=1)))

    def taking_part(self) -> InternalStates:
        """Return the states that motions change or that act on them, and those that are coupled to these."""
        part = self.by_q.any(axis=1) | self.by_v.any(axis=1) | self.acts.any(axis=0)
        coupled = (self.by_z != 0.0) | (self.by_z != 0.0).T
        for _ in range(part.size):
            part = part | coupled[:, part].any(axis=1)
        return self.without(np.asarray(~part))

    def without(self, mask: Mask) -> InternalStates:
        """Return the other states; those of the mask, which stick, follow the coordinates: z = G_v e."""
        left = ~mask
        return InternalStates(
            names=tuple(name for name, stays in zip(self.names, left, strict=True) if stays),
            places=self.places[left],
            inertia=self.inertia[left],
            acts=self.acts[:, left],
            by_q=self.by_q[left] + self.by_z[np.ix_(left, mask)] @ self.by_v[mask],
            by_v=self.by_v[left],
            by_z=self.by_z[np.ix_(left, left)],
        )

    def rates_by(self, forces: Array) -> Array:
        """Return rates of the states, (p, inputs), by inputs that enter the equations as forces, (n + m, inputs)."""
        return np.asarray(forces[self.places] / self.inertia[:, np.newaxis])


def states_of(kernel: Kernel, slopes: tuple[Array, Array, Array], basis: Array, basis_rate: Array) -> InternalStates:
    """Return the states of a kernel's laws, from slopes of the equations of motion.

    Args:
        kernel: whose they are.
        slopes: derivatives of the residual by q, v and a, as of ``slopes_of``.
        basis, basis_rate: change of all coordinates per independent one, and its rate along the motion, (n, m).
    """
    n, index = kernel.n, np.arange(kernel.n, kernel.calls.rates)
    K, D, M = slopes
    inertia = np.diagonal(M)[index]
    by_q, by_v = (-matrix[index] / inertia[:, np.newaxis] for matrix in (K, D))
    return InternalStates(
        names=kernel.internal_states,
        places=index,
        inertia=inertia,
        acts=basis.T @ D[:n, index],
        by_q=by_q[:, :n] @ basis + by_v[:, :n] @ basis_rate,
        by_v=by_v[:, :n] @ basis,
        by_z=by_v[:, index],
    )


def slopes_of(kernel: Kernel, q: Array, v: Array, a: Array, u: Array | None = None) -> tuple[Array, Array, Array]:
    """Return derivatives of the residual by q, v and a, with internal states at rest the means of both directions.

    They are (n + m, n + m) each: rows and columns of internal states stand behind those of coordinates.  Bristles that
    are bent yield in the one direction and not in the other.  Drives are within their limits, or where inputs u of
    them, (n,), leave them.
    """
    K, D, M = _passive_slopes(kernel, q, v, a)
    if has_drives(kernel):
        by_q, by_v, _ = drive_slopes(kernel, q, v, u)
        K, D = K - by_q, D - by_v
    return K, D, M


def _passive_slopes(kernel: Kernel, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    n = kernel.n
    rests = np.flatnonzero(v[:n] == 0.0)
    if not (kernel.internal_states and v[n:].any() and rests.size):
        return _residual_slopes(kernel, q, v, a)
    sides = np.tile(v, (2, 1))
    fine = FINE * (1.0 + GOLDEN * rests % 1.0)  # no two alike, so that no deviation of a loop or coupling stands still
    sides[0, rests], sides[1, rests] = fine, -fine
    both = [_residual_slopes(kernel, q, side, a) for side in sides]
    K, D, M = (0.5 * (one + other) for one, other in zip(*both, strict=True))
    for slopes in (K, D):
        rows = slopes[n:]
        rows[np.abs(rows) < STICKS * np.diagonal(M)[n:, np.newaxis]] = 0.0
    return K, D, M


def _residual_slopes(kernel: Kernel, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return derivatives of the residual by q, v and a, (n + m, n + m) each; internal states stand behind v."""
    velocities, z = cut_apart(v, kernel.n)
    K, D, M = kernel.calls.run(kernel.residual_jacobian, None, (q, velocities, a), z=z, whole=True)
    return K, D, M


def forces_needed(kernel: Kernel, q: Array, rates: Array, a: Array) -> Array:
    """Return the forces that a motion takes, loops open, (n,); internal states stand behind its rates, (n + m,)."""
    v, z = cut_apart(rates, kernel.n)
    return kernel.inverse_dynamics(q, v, a, z=z, cut=True)


def kept_note(names: Sequence[str], z: Array) -> str:
    """Return a line about states that an equilibrium leaves as they are."""
    values = ", ".join(f"{x:g}" for x in z) if z.any() else "0"
    return f"{listed(names)}: kept at {values}; with bristles and hysteresis a robot is at rest whatever they are"


def zero_note(names: Sequence[str]) -> str:
    """Return a line about states that stick about the state of a linear system."""
    what = "has an eigenvalue of 0" if len(names) == 1 else "have an eigenvalue of 0 each"
    return f"{listed(names)}: {what}: about a state at rest bristles and hysteresis stick, and hold as springs"
