"""Coordinates of a closed mechanism that may be chosen freely, and the others as functions of them.

g(q) = 0 is solved, by Newton's method, for as many dependent coordinates as there are independent constraints, out of
as many constraints; redundant ones follow where those are met, and are looked at there alone: at violating states they
contradict the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Index, Mask, independent_columns, rank_of
from ..errors import LoopError
from ..kernel.complete import Kernel
from ..names import joint_of, listed
from ..runtime.loop_errors import left_open
from ..runtime.singular import inertias
from ..state.vectors import prescribed_mask

CLOSED, NEARLY = 1e-12, 1e-11  # m, or sine of an angle: what is met, and what round-off may leave of it
ROUNDS = 15
STEEP = 8.0  # of dependent coordinates by independent ones, each over its size: another chart may be better
BETTER = 0.5  # of the steepness: what another chart must come below


class Followed(NamedTuple):
    """States that keep the loops closed.

    Attributes:
        q, v, a: coordinates, velocities and accelerations, (n,) or (N, n) each.
        slopes: derivatives of the dependent coordinates by all others, 0 by themselves, (rank, n) or (N, rank, n).
    """

    q: Array
    v: Array
    a: Array
    slopes: Array


class Chart:
    """Independent coordinates of a closed mechanism, with the assembled state of their last use.

    Attributes:
        free: indices of the independent coordinates, (f,).
        bound: those of the dependent ones, (rank,).
        rest: of all that are not dependent: the free ones and the prescribed ones, in the coordinates' order.
        rank: of the constraint in the coordinates that are not prescribed.
    """

    def __init__(
        self, kernel: Kernel, q: Array, *, prescribed: Mask | None = None, free: Sequence[int] | None = None
    ) -> None:
        """Choose the best independent coordinates about an assembled state.

        Args:
            kernel: of a robot with loops.
            q: an assembled state, (n,).
            prescribed: which coordinates something else moves, (n,); those of the robot by default.
            free: indices of the coordinates out of which the independent ones are to be; any by default.

        Raises:
            LoopError: these do not hold all the others.
        """
        self.kernel = kernel
        moving = np.flatnonzero(~(prescribed_mask(kernel) if prescribed is None else prescribed))
        J = kernel.functions.constraint_jacobian(q)
        self._sizes = 1.0 / np.sqrt(inertias(kernel.mass_matrix(q)))  # of equal kinetic energy
        scaled = J * self._sizes
        self.rank = rank_of(scaled[:, moving])
        others = moving if free is None else np.setdiff1d(moving, np.asarray(free, dtype=np.intp))
        first = rank_of(scaled[:, others])
        if free is not None and first < others.size:
            raise _loose(kernel, J, moving, others, [kernel.coordinates[i] for i in free])
        chosen = others[independent_columns(scaled[:, others], first)]
        if first < self.rank:  # more of them than there are freedoms
            also = np.setdiff1d(moving, others)
            left = _beside(scaled[:, also], scaled[:, chosen])
            chosen = np.concatenate([chosen, also[independent_columns(left, self.rank - first)]])
        self.bound = np.sort(chosen)
        self.free = np.setdiff1d(moving, self.bound)
        self.rest = np.setdiff1d(np.arange(kernel.n), self.bound)
        rows = np.array(independent_columns(scaled[:, self.bound].T, self.rank), dtype=np.intp)
        self._start(q, J, rows)

    def _start(self, q: Array, J: Array, rows: Index) -> None:
        """Prepare the arrays that ``following`` takes for this chart, with the slopes at an assembled state."""
        kernel = self.kernel
        n, m = kernel.n, len(kernel.constraints)
        self._function, self._still = kernel.raw.writing("following"), np.zeros(n)
        self._ends = np.cumsum([n, n, n, m * n, m])
        self._near_choice = np.zeros(2 * n + m + 1 + m * n)  # for good guesses, which nothing changes first
        self._near_choice[self.bound] = self._near_choice[n + rows] = 1.0
        self._near_choice[n + m] = ROUNDS
        self._chart = self._near_choice.copy()
        self._steps = (n, n, n, 0)
        square = J[np.ix_(rows, self.bound)]
        self._slopes = np.zeros((self.rank, n))
        try:
            self._slopes[:, self.rest] = -np.linalg.solve(square, J[np.ix_(rows, self.rest)])
        except np.linalg.LinAlgError:
            raise self._singular(J) from None
        self.use(q.copy(), self._slopes)

    @property
    def steepness(self) -> float:
        """Largest slope of dependent by independent coordinates, each over its size, at the last state."""
        scaled = self._slopes[:, self.free] * self._sizes[self.free] / self._sizes[self.bound, np.newaxis]
        return float(np.abs(scaled).max(initial=0.0))

    @property
    def q(self) -> Array:
        """Assembled state of the last use, (n,)."""
        return self._q

    @property
    def choice(self) -> Array:
        """Array of the choice for the kernel's function "following", with good guesses of dependent coordinates."""
        return np.array(self._near_choice)

    def assemble(self, q: Array, *, near: bool = False) -> tuple[Array, Array]:
        """Return states, (n,) or (N, n), closed by their dependent coordinates, and the slopes there.

        See ``follow``.
        """
        assembled = self.follow(q, near=near)
        return assembled.q, assembled.slopes

    def follow(self, q: Array, v: Array | None = None, a: Array | None = None, *, near: bool = False) -> Followed:
        """Return states whose dependent coordinates, velocities and accelerations keep loops closed, by one call of C.

        Args:
            q, v, a: (n,) or (N, n) each; what is not dependent stays.  Velocities and accelerations are 0 by default.
            near: whether the dependent coordinates are good guesses; otherwise they are not looked at.

        Raises:
            LoopError: there is none near the guess, or near where the state that was used last leads.
            ArrayError: something is not finite.
        """
        calls, chart = self.kernel.calls, self._near_choice if near else self._chart
        if not near:
            q = q.copy()
            q[..., self.bound] = self._q[self.bound]
        still = self._still if q.ndim == 1 else np.zeros_like(q)
        arrays = (*map(np.ascontiguousarray, (q, still if v is None else v, still if a is None else a)), chart)
        function, lead = self._function, q.shape[:-1]
        out = np.empty((*lead, self._ends[-1]))
        if lead:
            calls.call(function, arrays, self._steps, (), len(q), out)
        else:
            calls.call(function, arrays, (), (), None, out)
        first, second, third, fourth, _ = self._ends
        g = out[..., fourth:]
        if not (np.abs(g).max() <= NEARLY and np.isfinite(out).all()):
            raise self._trouble(arrays, out)
        slopes = out[..., third:fourth].reshape(*lead, -1, self.kernel.n)[..., : self.rank, :]
        return Followed(out[..., :first], out[..., first:second], out[..., second:third], slopes)

    def _trouble(self, arrays: tuple[Array, ...], out: Array) -> LoopError:
        """Return the error that says where C could not close states, or what cannot follow.

        It raises ArrayError where an argument is not finite.
        """
        kernel, n = self.kernel, self.kernel.n
        for label, x in zip("qva", arrays[:3], strict=True):
            kernel.calls.arrays.refuse_not_finite(label, x, (n,))
        q, g = np.atleast_2d(out)[:, :n], np.atleast_2d(out)[:, self._ends[-2] :]
        violations = np.abs(g).max(axis=1)
        bad = ~(violations <= NEARLY)
        if bad.any() and np.isfinite(q[bad]).all():
            worst = int(np.where(bad, violations, 0.0).argmax())
            return left_open(kernel.raw, g[worst], "comes open", "a motion that stays where it closes")
        worst = int((~np.isfinite(np.atleast_2d(out)).all(axis=1)).argmax())
        return self._singular(kernel.functions.constraint_jacobian(np.where(np.isfinite(q[worst]), q[worst], self._q)))

    def _singular(self, J: Array) -> LoopError:
        """Return the error that dependent coordinates do not follow where the constraint has this Jacobian."""
        what, allowed = "is in a singular position", "a motion that does not pass it"
        return left_open(self.kernel.raw, np.abs(J).max(axis=1), what, allowed)

    def use(self, q: Array, slopes: Array) -> None:
        """Go on from an assembled state, (n,), with the slopes there."""
        self._q, self._slopes = q, slopes
        n, first = self.kernel.n, self._ends[0] + len(self.kernel.constraints) + 1
        self._chart[first : first + n] = q
        self._chart[first + n : first + (1 + self.rank) * n] = slopes.ravel()

    def moved(self) -> Chart | None:
        """Return a better chart for the state of the last use.

        None while this one is good, or no other is better.
        """
        if self.steepness <= STEEP:
            return None
        other = Chart(self.kernel, self._q)
        return other if other.rank == self.rank and other.steepness <= BETTER * self.steepness else None

    def tangent_basis(self, slopes: Array) -> Array:
        """Return derivatives of all coordinates by the independent ones, (..., n, f)."""
        basis = np.zeros((*slopes.shape[:-2], self.kernel.n, self.free.size))
        basis[..., self.free, np.arange(self.free.size)] = 1.0
        basis[..., self.bound, :] = slopes[..., self.free]
        return basis


def _beside(J: Array, others: Array) -> Array:
    """Give what is left of columns beside the range of others."""
    Q = np.linalg.qr(others)[0]
    return np.asarray(J - Q @ (Q.T @ J))


def _loose(kernel: Kernel, J: Array, moving: Index, others: Index, free: list[str]) -> LoopError:
    """Return the error that says that some coordinates do not hold a mechanism, naming what they leave loose."""
    null_vectors = np.linalg.svd(J[:, others])[2]
    name = kernel.coordinates[others[int(np.abs(null_vectors[-1]).argmax())]]
    loop, freedoms, missing = joint_of(kernel.constraints[0]), moving.size - rank_of(J[:, moving]), others.size
    missing -= rank_of(J[:, others])
    return LoopError(
        f"{kernel.name}: loop {loop} is not held by drives at {listed(free) or 'nothing'}: {name} stays loose; allowed:"
        f" drives that hold all {freedoms} freedoms of the mechanism ({missing} more), in a pose that is not singular",
        loop=loop,
        gap=float("inf"),
    )
