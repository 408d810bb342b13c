"""Coordinates of a closed mechanism that may be chosen freely, and the others as functions of them.

g(q) = 0 is solved, by Newton's method, for as many dependent coordinates as there are independent constraints, out of
as many constraints; redundant ones follow where those are met, and are looked at there alone: at open states they
contradict the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..names import joint_of, listed
from ..runtime.kernel import Kernel
from ..runtime.opened import left_open
from ..state.vectors import prescribed_mask, rank_of

Array = NDArray[np.float64]

CLOSED, NEARLY = 1e-12, 1e-11  # m, or sine of an angle: what is met, and what round-off may leave of it
ROUNDS = 15
FARTHEST = 0.5  # m or rad, from where linear extrapolation leads: beyond it may be another way to close the loops
STEEP = 8.0  # of dependent coordinates by independent ones, each over its size: another chart may be better
BETTER = 0.5  # of the steepness: what another chart must come below


class Chart:
    """A choice of independent coordinates, with the closed state about which it was used last.

    Attributes:
        free: indices of the independent coordinates, (f,).
        bound: those of the dependent ones, (rank,).
        rest: of all that are not dependent: the free ones and those that are given, in the coordinates' order.
        rank: of the constraint in the coordinates that are not given.
    """

    def __init__(
        self, kernel: Kernel, q: Array, *, given: NDArray[np.bool_] | None = None, free: Sequence[int] | None = None
    ) -> None:
        """The best chart about a closed state.

        Args:
            kernel: of a robot with loops.
            q: a closed state, (n,).
            given: which coordinates something else moves, (n,); the prescribed ones if not given.
            free: indices of the coordinates out of which the independent ones are to be; any if not given.

        Raises:
            LoopError: these do not hold all the others.
        """
        self.kernel = kernel
        moving = np.flatnonzero(~(prescribed_mask(kernel) if given is None else given))
        J = kernel.constraint_jacobian(q)
        self._sizes = 1.0 / np.sqrt(np.maximum(np.diagonal(kernel.mass_matrix(q)), 1e-12))  # of equal kinetic energy
        scaled = J * self._sizes
        self.rank = rank_of(scaled[:, moving])
        others = moving if free is None else np.setdiff1d(moving, np.asarray(free, dtype=np.intp))
        first = rank_of(scaled[:, others])
        if free is not None and first < others.size:
            raise _loose(kernel, J, moving, others, [kernel.coordinates[i] for i in free])
        chosen = others[_pivots(scaled[:, others], first)]
        if first < self.rank:  # more of them than there are freedoms
            also = np.setdiff1d(moving, others)
            left = _beside(scaled[:, also], scaled[:, chosen])
            chosen = np.concatenate([chosen, also[_pivots(left, self.rank - first)]])
        self.bound = np.sort(chosen)
        self.free = np.setdiff1d(moving, self.bound)
        self.rest = np.setdiff1d(np.arange(kernel.n), self.bound)
        self._rows = np.sort(np.array(_pivots(scaled[:, self.bound].T, self.rank), dtype=np.intp))
        self._square = self._rows[:, np.newaxis] * kernel.n + self.bound
        self._beside = self._rows[:, np.newaxis] * kernel.n + self.rest
        self._q, self._slopes = q.copy(), self._slopes_at(J[np.newaxis])[0]

    @property
    def steepness(self) -> float:
        """See above; where the chart was used last."""
        columns = np.isin(self.rest, self.free)
        scaled = self._slopes[:, columns] * self._sizes[self.free] / self._sizes[self.bound, np.newaxis]
        return float(np.abs(scaled).max(initial=0.0))

    def close(self, q: Array, *, near: bool = False) -> tuple[Array, Array]:
        """States, (N, n), closed by their dependent coordinates, and d(dependent)/d(rest) there, (N, rank, n - rank).

        Args:
            q: the states; the rest of their coordinates stays.
            near: whether the dependent coordinates are good guesses; otherwise they are not looked at.

        Raises:
            LoopError: there is none near the guess, or near where the state that was used last leads.
        """
        q = q.copy()
        if not near:
            q[:, self.bound] = self._q[self.bound] + (q[:, self.rest] - self._q[self.rest]) @ self._slopes.T
        expected, before = q[:, self.bound], np.full(len(q), np.inf)
        for _ in range(ROUNDS):
            g, J = self.kernel.constraint(q), self.kernel.constraint_jacobian(q)
            gap = np.abs(g).max(axis=1)
            if (gap <= CLOSED).all() or ((gap <= NEARLY) & (gap >= 0.1 * before)).all():
                return q, self._slopes_at(J)
            if not (gap <= np.maximum(0.7 * before, NEARLY)).all():
                break
            before = gap
            q[:, self.bound] -= self._solved(J, g[:, self._rows, np.newaxis])[:, :, 0]
            if not (np.abs(q[:, self.bound] - expected) <= FARTHEST).all():
                break
        raise left_open(self.kernel.raw, g[int(gap.argmax())], "comes open", "a motion that stays where it closes")

    def use(self, q: Array, slopes: Array) -> None:
        """Go on from a closed state, (n,), with the slopes there."""
        self._q, self._slopes = q, slopes

    def moved(self) -> Chart | None:
        """A better chart for where this one was used last; None while this one is good, or no other is better."""
        if self.steepness <= STEEP:
            return None
        other = Chart(self.kernel, self._q)
        return other if other.rank == self.rank and other.steepness <= BETTER * self.steepness else None

    def rates(self, v: Array, slopes: Array) -> Array:
        """Rates, (N, n), whose dependent ones keep the loops closed; the rest of them stays."""
        found = v.copy()
        found[:, self.bound] = np.einsum("kij,kj->ki", slopes, v[:, self.rest])
        return np.asarray(found)

    def accelerations(self, q: Array, v: Array, a: Array, slopes: Array) -> Array:
        """Accelerations, (N, n), whose dependent ones keep the loops closed; the rest of them stays."""
        found = self.rates(a, slopes)
        bias = self.kernel.constraint_bias(q, v)[:, self._rows, np.newaxis]
        found[:, self.bound] -= self._solved(self.kernel.constraint_jacobian(q), bias)[:, :, 0]
        return np.asarray(found)

    def ways(self, slopes: Array) -> Array:
        """Derivatives of all coordinates by the independent ones, (N, n, f)."""
        found = np.zeros((len(slopes), self.kernel.n, self.free.size))
        found[:, self.free, np.arange(self.free.size)] = 1.0
        found[:, self.bound] = slopes[:, :, np.isin(self.rest, self.free)]
        return found

    def _slopes_at(self, J: Array) -> Array:
        """d(dependent)/d(rest), (N, rank, n - rank)."""
        return np.asarray(-self._solved(J, J.reshape(len(J), -1)[:, self._beside]))

    def _solved(self, J: Array, right: Array) -> Array:
        """The dependent coordinates' part of J^-1 right, (N, rank, columns)."""
        square = J.reshape(len(J), -1)[:, self._square]
        try:
            return np.asarray(np.linalg.solve(square, right))
        except np.linalg.LinAlgError:
            worst = int(np.argmin(np.abs(np.linalg.det(square))))
            gaps = np.abs(J[worst]).max(axis=1)
            what, allowed = "is in a singular position", "a motion that does not pass it"
            raise left_open(self.kernel.raw, gaps, what, allowed) from None


def _beside(J: Array, others: Array) -> Array:
    """Give what is left of columns beside the range of others."""
    Q = np.linalg.qr(others)[0]
    return np.asarray(J - Q @ (Q.T @ J))


def _loose(kernel: Kernel, J: Array, moving: NDArray[np.intp], others: NDArray[np.intp], free: list[str]) -> LoopError:
    """The error that says that some coordinates do not hold a mechanism, naming what they leave loose."""
    ways = np.linalg.svd(J[:, others])[2]
    name = kernel.coordinates[others[int(np.abs(ways[-1]).argmax())]]
    loop, freedoms, missing = joint_of(kernel.constraints[0]), moving.size - rank_of(J[:, moving]), others.size
    missing -= rank_of(J[:, others])
    return LoopError(
        f"{kernel.name}: loop {loop} is not held by drives at {listed(free) or 'nothing'}: {name} stays loose; allowed:"
        f" drives that hold all {freedoms} freedoms of the mechanism ({missing} more), in a pose that is not singular",
        loop=loop,
        gap=float("inf"),
    )


def _pivots(J: Array, rank: int) -> list[int]:
    """Columns of J that are as independent as possible, ``rank`` of them: Gram and Schmidt's method with pivoting."""
    left, found = J.copy(), list[int]()
    for _ in range(rank):
        norms = np.linalg.norm(left, axis=0)
        norms[found] = -1.0
        found.append(int(norms.argmax()))
        unit = left[:, found[-1]] / norms[found[-1]]
        for _ in range(2):  # once more for round-off
            left -= np.outer(unit, unit @ left)
    return found
