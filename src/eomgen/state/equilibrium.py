"""Static equilibrium of a compiled kernel's equations of motion."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Mask
from ..errors import ArrayError, InputError, IntegrationError, LoopError, UnknownNameError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..robot.sizes import REFERENCE_ACCELERATION
from ..runtime.bound import WrenchLike
from ..runtime.singular import inertias
from .drives import DrivesAtRest
from .internal_states import StatesLike, refuse_moving, state_values
from .springs import coordinate_sizes, line_rates, stiffnesses
from .vectors import Q_STEP, state_vector


def static_equilibrium(
    kernel: Kernel,
    q_guess: ArrayLike,
    *,
    u: ArrayLike | Callable[[Array], ArrayLike] | None = None,
    fixed: Iterable[str] = (),
    wrench: WrenchLike | None = None,
    z: StatesLike | None = None,
) -> tuple[Array, Array]:
    """Find the static equilibrium near a guess by Newton's method: springs, gravity, drives and wrenches in balance.

    Internal states stay as they are: whatever z bristles have, they may be at rest, so that the equilibria of a robot
    that has some are a continuum.  Those of drives settle, see ``drives_at_rest``: a drive whose loops have an integral
    holds its coordinate where its reference u is, of a velocity where the guess has it, and others with the error that
    their gains leave.

    Args:
        kernel: float64, with inverse_dynamics and mass_matrix.
        q_guess: coordinates, (n,).
        u: drives, (n,), as ``Kernel.inputs`` has them, or a function of q, (n,) or (N, n), to the same shape, whose
            references of drives without an error are those of the guess; None: zero.
        fixed: names of coordinates that stay at their guess, whatever drive that takes; prescribed ones do.
        wrench: external wrenches, as of the kernel's methods: (links, 6), or by frame and link.
        z: internal states, (m,), or by name; 0 by default.

    Returns:
        q, (n,), and the forces that hold it, (n,): u, or what drives exert under it, and in fixed coordinates what is
        needed.

    Raises:
        IntegrationError: there is no such state near the guess: a coordinate that nothing holds is named, or a drive
            whose limits do not leave the force.
        UnknownNameError, ArrayError: a name or an array is wrong.
        InputError: the robot has loops or couplings that are rigid.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    if kernel.constraints:
        raise InputError(f"static_equilibrium: {kernel.name} is to be closed; see eomgen.loops.closed_equilibrium")
    q = state_vector("q_guess", q_guess, kernel.coordinates)
    kept = known_coordinates(fixed, kernel) | set(kernel.prescribed)
    free = np.array([name not in kept for name in kernel.coordinates])
    states = state_values(kernel, z)
    refuse_moving(kernel, states)
    zero, at_rest = np.zeros(kernel.n), states if kernel.internal_states else None
    applied, drives = given_forces(kernel, u), DrivesAtRest(kernel)

    def needed(qs: Array) -> Array:
        return np.asarray(kernel.inverse_dynamics(qs, zero, zero, z=at_rest, wrench=wrench, cut=True))

    places = drives.places(q, applied, kept)
    q[list(places)], free[list(places)] = list(places.values()), False

    def rest(limited: bool) -> tuple[Array, Array]:
        def exerted(qs: Array) -> Array:
            return drives.forces(qs, applied(qs), limited=limited)

        found = _newton(kernel, q, free, lambda qs: needed(qs) - exerted(qs))
        return found, drives.alone(np.where(free, exerted(found), needed(found)), applied(found))

    return rest_within_limits(drives, rest, kept)


def rest_within_limits(
    drives: DrivesAtRest, rest: Callable[[bool], tuple[Array, Array]], kept: Container[str]
) -> tuple[Array, Array]:
    """Return q and forces of an equilibrium, or say whose limits leave none.

    Args:
        drives: of the kernel.
        rest: returns both, with limits of the drives or without them.
        kept: names of coordinates that stay whatever their drives do.

    Raises:
        IntegrationError: there is none.
    """
    try:
        q, forces = rest(True)
    except IntegrationError as error:
        if not drives.drives:
            raise
        try:
            q, forces = rest(False)
        except IntegrationError:  # limits are not to blame
            raise error from None
        drives.refuse_overload(forces, kept)
        raise
    drives.refuse_overload(forces, kept)
    return q, forces


def given_forces(kernel: Kernel, u: ArrayLike | Callable[[Array], ArrayLike] | None) -> Callable[[Array], Array]:
    """Return inputs, (..., kernel.calls.inputs), as a function of q, (n,) or (N, n), that checks shapes.

    Args:
        u: of drives, as of ``static_equilibrium``; forces beside drives with states may stand behind.
    """
    constant = np.zeros(kernel.n) if u is None or callable(u) else state_vector("u", u, kernel.coordinates)
    wide = kernel.calls.inputs

    def applied(qs: Array) -> Array:
        forces = np.asarray(u(qs), dtype=np.float64) if callable(u) else np.broadcast_to(constant, qs.shape)
        if forces.shape == qs.shape:
            return np.concatenate([forces, np.zeros((*qs.shape[:-1], wide - kernel.n))], axis=-1)
        if forces.shape != (*qs.shape[:-1], wide):
            raise ArrayError(f"u: expected forces of shape {qs.shape}, got shape {forces.shape}")
        return forces

    return applied


def known_coordinates(names: Iterable[str], kernel: Kernel) -> set[str]:
    """Return the names of fixed coordinates, once each; UnknownNameError if one is none."""
    known = set(names)
    for name in known:
        if name not in kernel.coordinates:
            raise UnknownNameError(f"fixed: {name!r} is unknown; known: {', '.join(kernel.coordinates)}")
    return known


def _newton(kernel: Kernel, q: Array, free: Mask, residual: Callable[[Array], Array]) -> Array:
    """Return the root of the residual's free rows in the free coordinates; scaled by sizes, with backtracking.

    Slopes are differences of one batch.  The whole search takes two or three of them, 96 states of the PUMA with 36
    coordinates, that is 0.05 ms; a compiler takes 1 s for the tangent of its inverse dynamics, and 8 s for all
    derivatives of the residual.  ``analysis.at_rest`` has these anyhow, and takes them.
    """
    size = coordinate_sizes(kernel, q)[0][free]
    held = stiffnesses(kernel) + np.diagonal(line_rates(kernel, q)[0])
    springs = held[free] * size / REFERENCE_ACCELERATION  # what stands for inertia where a spring holds none
    inertia = np.maximum(inertias(kernel.mass_matrix(q))[free], springs)
    index = np.flatnonzero(free)
    if not index.size:
        return q
    for _ in range(60):
        states = np.tile(q, (index.size + 1, 1))
        states[np.arange(1, index.size + 1), index] += Q_STEP
        r = residual(states)[:, free] / inertia  # as accelerations
        slopes = (r[1:] - r[0]).T / Q_STEP * size
        refuse_singular(slopes, [kernel.coordinates[i] for i in index], kernel.name)
        change = -np.linalg.solve(slopes, r[0]) * size
        change *= 0.5 / max(0.5, np.abs(change).max())
        for factor in 0.5 ** np.arange(12):
            trial = q.copy()
            trial[free] += factor * change
            try:
                left = np.linalg.norm(residual(trial)[free] / inertia)
            except LoopError:  # drives that know a closed mechanism do not know it so far away
                continue
            if left <= (1.0 - 1e-4 * factor) * np.linalg.norm(r[0]):
                break
        q = trial
        # the slopes are good to 1e-7: what is left is round-off, of springs between points that of q itself
        if (np.abs(change) <= 1e-9 * size + 1e-13 * np.abs(q[free])).all():
            return q
    worst = kernel.coordinates[index[int(np.argmax(np.abs(r[0])))]]
    raise IntegrationError(f"{kernel.name}: no static equilibrium near the guess; {worst} stays out of balance")


def refuse_singular(slopes: Array, names: list[str], robot: str) -> None:
    """Raise IntegrationError if nothing holds one of the coordinates, whose slopes of forces these are, (m, m)."""
    if _is_well_conditioned(slopes):
        return
    _, values, directions = np.linalg.svd(slopes)
    if values[-1] <= 1e-12 * values[0]:
        loose = names[int(np.argmax(np.abs(directions[-1])))]
        raise IntegrationError(
            f"{robot}: no static equilibrium: nothing holds {loose}; give it a stiffness or a drive,"
            " or list it in fixed"
        )


def _is_well_conditioned(slopes: Array) -> bool:
    """Whether a matrix is far from singular for certain, by its inverse, which costs less than singular values."""
    try:
        inverse = np.linalg.inv(slopes)
    except np.linalg.LinAlgError:
        return False
    condition = np.abs(slopes).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max()
    return bool(len(slopes) * condition < 1e11)
