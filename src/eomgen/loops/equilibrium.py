"""Static equilibrium of a closed mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import RANK, Array, Mask
from ..errors import IntegrationError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..kernel.turning import singular_joints
from ..robot.sizes import REFERENCE_ACCELERATION
from ..runtime.bound import WrenchLike, evaluate, wrench_rows
from ..runtime.raw import name_of
from ..runtime.singular import inertias
from ..state.drives import DrivesAtRest, is_of_drive
from ..state.equilibrium import (
    given_forces,
    known_coordinates,
    refuse_singular,
    rest_within_limits,
    static_equilibrium,
)
from ..state.internal_states import StatesLike, refuse_moving, state_values
from ..state.springs import coordinate_sizes, line_rates, stiffnesses
from ..state.turning import Turns
from ..state.vectors import Q_STEP, state_vector
from .chart import Chart

ROUNDS = 100
STEP = 0.5  # m or rad, the longest
SMALL = 1e-9  # of a coordinate's size


def closed_equilibrium(
    kernel: Kernel,
    q_guess: ArrayLike,
    *,
    u: ArrayLike | Callable[[Array], ArrayLike] | None = None,
    fixed: Iterable[str] = (),
    wrench: WrenchLike | None = None,
    z: StatesLike | None = None,
) -> Array:
    """Return the static equilibrium near a guess, loops closed, (n,); without loops ``static_equilibrium``.

    Internal states stay as they are, those of drives settle, as there.

    Args:
        kernel: float64, with residual, mass_matrix and the constraint.
        q_guess: coordinates, (n,).
        u: drives, (n,), as ``Kernel.inputs`` has them, or a function of q, (n,) or (N, n), to the same shape; none by
            default.
        fixed: names of coordinates that stay at their guess, whatever drive that takes; prescribed ones do.
        wrench: external wrenches, as of the kernel's methods: (links, 6), or by frame and link.
        z: internal states, (m,), or by name; 0 by default.

    Raises:
        LoopError: the loops do not close near the guess.
        IntegrationError: there is no such state near the guess: a coordinate that nothing holds is named, or a drive
            whose limits do not leave the force.
        UnknownNameError, ArrayError: a name or an array is wrong.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    if not kernel.constraints:
        return static_equilibrium(kernel, q_guess, u=u, fixed=fixed, wrench=wrench, z=z)[0]
    guess = state_vector("q_guess", q_guess, kernel.coordinates)
    kept = known_coordinates(fixed, kernel) | set(kernel.prescribed)
    stays = np.array([name in kept for name in kernel.coordinates])
    inputs, drives = given_forces(kernel, u), DrivesAtRest(kernel)
    places = drives.places(guess, inputs, kept)
    guess[list(places)] = list(places.values())
    q = kernel.assemble(guess, kept | {kernel.coordinates[i] for i in places})
    states = state_values(kernel, z)
    refuse_moving(kernel, states)
    states[[is_of_drive(name) for name in kernel.internal_states]] = 0.0  # which exert nothing where they have no error
    balance = _Balance(kernel, states if kernel.internal_states else None, wrench, stays)

    def rest(limited: bool) -> tuple[Array, Array]:
        def exerted(qs: Array) -> Array:
            return drives.forces(qs, inputs(qs), limited=limited)

        def acting(qs: Array) -> Array:
            return drives.beside(qs, exerted(qs))

        balanced = balance.near(q, acting, list(places))
        forces = exerted(balanced) + balance.holding(balanced, acting, list(places))
        return balanced, drives.alone(forces, inputs(balanced))

    return rest_within_limits(drives, rest, kept)[0]


class _Balance:
    """Imbalance of a mechanism's forces, in angles that are not singular."""

    def __init__(self, kernel: Kernel, z: Array | None, wrench: WrenchLike | None, fixed: Mask) -> None:
        """Begin with what acts on it.

        Args:
            kernel: of the mechanism.
            z: internal states, (m,), or None without any.
            wrench: external wrenches.
            fixed: which coordinates stay, (n,).
        """
        self.kernel, self._z, self._wrench, self._fixed = kernel, z, wrench, fixed
        self._turns = Turns(kernel, fixed)

    def near(self, q: Array, acting: Callable[[Array], Array], places: list[int]) -> Array:
        """Return the balanced state near an assembled one, (n,).

        Args:
            q: to begin with, (n,).
            acting: forces as a function of q.
            places: indices of further coordinates that stay.
        """
        turns, fixed = self._turns, self._fixed.copy()
        fixed[places] = True
        for _ in range(ROUNDS):
            turns.take(singular_joints(q, turns.joints))
            here = turns.q_on(q)
            chart = Chart(turns.here, here, prescribed=fixed)
            if not chart.free.size:
                return q
            imbalance = self._imbalance(q, acting)
            change, size = _newton_step(chart, here, imbalance)
            here, done = _taken(chart, here, change, imbalance)
            q = turns.q_back(here, q)
            if done or (np.abs(change) <= SMALL * size + 1e-13 * np.abs(here[chart.free])).all():
                return q
        worst = self.kernel.coordinates[chart.free[int(np.argmax(np.abs(change) / size))]]
        raise IntegrationError(
            f"{self.kernel.name}: no static equilibrium near the guess; {worst} stays out of balance"
        )

    def holding(self, q: Array, acting: Callable[[Array], Array], places: list[int]) -> Array:
        """Return the least forces at these places, (n,), that hold a state balanced elsewhere."""
        forces = np.zeros(self.kernel.n)
        if not places:
            return forces
        here = self._turns.q_on(q)
        chart = Chart(self._turns.here, here, prescribed=self._fixed)
        if chart.free.size:
            states, slopes = chart.assemble(here[np.newaxis])
            basis, left = chart.tangent_basis(slopes)[0], self._imbalance(q, acting)(states)[0]
            forces[places] = np.linalg.lstsq(basis[places].T, basis.T @ left, rcond=RANK)[0]
        return forces

    def _imbalance(self, near: Array, acting: Callable[[Array], Array]) -> Callable[[Array], Array]:
        """Return what is left of the forces as a function of q, (N, n), in angles that are not singular."""
        turns, kernel = self._turns, self.kernel

        def imbalance(qs: Array) -> Array:
            zero, described, calls = np.zeros_like(qs), turns.q_back(qs, near), turns.here.calls
            u_here, forces = np.split(turns.forces(acting(described), described, qs), [kernel.n], axis=-1)
            wrench = wrench_rows(kernel.calls, described, self._wrench)
            name = name_of(kernel.residual)
            values = calls.arguments(name, (qs, zero, zero, u_here), self._z, forces)
            return evaluate(calls, name, values, wrench=wrench)

        return imbalance


def _newton_step(chart: Chart, q: Array, imbalance: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Change of the independent coordinates that balances the forces along them, and their sizes, (f,) each.

    Slopes are differences of one batch, for the reason that ``state.equilibrium`` gives.
    """
    kernel, free = chart.kernel, chart.free
    size = coordinate_sizes(kernel, q)[0][free]
    states = np.tile(q, (free.size + 1, 1))
    states[np.arange(1, free.size + 1), free] += Q_STEP
    states, slopes = chart.assemble(states)
    r, basis = _along(chart, imbalance(states), slopes), chart.tangent_basis(slopes[:1])[0]
    springs = (stiffnesses(kernel) + np.diagonal(line_rates(kernel, q)[0]))[free] * size / REFERENCE_ACCELERATION
    inertia = np.maximum(inertias(basis.T @ kernel.mass_matrix(q) @ basis), springs)
    matrix = ((r[1:] - r[0]).T / Q_STEP * size) / inertia[:, np.newaxis]
    refuse_singular(matrix, [kernel.coordinates[i] for i in free], kernel.name)
    change = -np.linalg.solve(matrix, r[0] / inertia) * size
    return np.asarray(change * min(1.0, STEP / max(np.abs(change).max(), 1e-300))), size


def _taken(chart: Chart, q: Array, change: Array, imbalance: Callable[[Array], Array]) -> tuple[Array, bool]:
    """Return the state to which as much of a change as lessens the imbalance leads, and whether none of it does."""
    before = np.linalg.norm(_along(chart, imbalance(q[np.newaxis]), chart.assemble(q[np.newaxis])[1]))
    for factor in 0.5 ** np.arange(12):
        trial = q[np.newaxis].copy()
        trial[0, chart.free] += factor * change
        trial, slopes = chart.assemble(trial)
        if np.linalg.norm(_along(chart, imbalance(trial), slopes)) <= (1.0 - 1e-4 * factor) * before:
            return trial[0], False
    return q, bool(np.abs(change).max() <= 1e-7)


def _along(chart: Chart, forces: Array, slopes: Array) -> Array:
    """Return forces, (N, n), of states as the independent coordinates feel them, (N, f); the loops do no work."""
    return np.asarray(np.einsum("kni,kn->ki", chart.tangent_basis(slopes), forces))
