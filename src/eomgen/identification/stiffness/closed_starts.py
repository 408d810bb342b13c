"""States at the beginning of a closed mechanism's motion: by its independent coordinates, with derivatives by these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index, independent_columns, rank_of
from ...kernel.complete import Kernel
from ...state.vectors import prescribed_mask

LAST = 1e-6  # of a column: what is measured, or prescribed, becomes dependent after all others
STEP = 1e-5  # m or rad, of differences of rates


@dataclass(frozen=True)
class ClosedStarts:
    """Coordinates of a mechanism from which all others follow, near a state that closes it.

    Attributes:
        kernel: with what closes loops.
        independent: their indices, prescribed ones among them, (f,).
    """

    kernel: Kernel
    independent: Index

    @staticmethod
    def near(kernel: Kernel, q: Array, measured: Sequence[str]) -> ClosedStarts:
        """Choose independent coordinates at a closed q, (n,), among those measured as far as these are independent."""
        J = np.array(kernel.functions.constraint_jacobian(q))
        rank = rank_of(J)
        late = np.isin(kernel.coordinates, measured)
        scaled = J * np.where(prescribed_mask(kernel), LAST**2, np.where(late, LAST, 1.0))
        dependent = independent_columns(scaled, rank)
        return ClosedStarts(kernel, np.setdiff1d(np.arange(kernel.n), dependent))

    @property
    def names(self) -> list[str]:
        """Names of the independent coordinates."""
        return [self.kernel.coordinates[i] for i in self.independent]

    def state(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state with these independent coordinates and rates, (n,) each; LoopError if there is none.

        Args:
            q, v: (n,), dependent ones as a guess.
        """
        q = np.asarray(self.kernel.assemble(q, self.names))
        return q, np.asarray(self.kernel.project_velocity(q, v, self.names))

    def slopes(self, q: Array, v: Array, moving: Index) -> tuple[Array, Array]:
        """Return changes of q and v by some of the independent numbers of q, then of v (from n on), (k, n) each."""
        n, by_q, by_v = self.kernel.n, np.zeros((moving.size, self.kernel.n)), np.zeros((moving.size, self.kernel.n))
        N = self._basis(q)
        for row, i in enumerate(moving.tolist()):
            column = N[:, self.independent.tolist().index(i % n)]
            if i >= n:
                by_v[row] = column
                continue
            by_q[row] = column
            plus, minus = (self.state(q + step * column, v)[1] for step in (STEP, -STEP))
            by_v[row] = (plus - minus) / (2.0 * STEP)
        return by_q, by_v

    def _basis(self, q: Array) -> Array:
        """Return motions of all coordinates by unit rates of the independent ones, (n, f)."""
        J, n = np.asarray(self.kernel.functions.constraint_jacobian(q)), self.kernel.n
        dependent = np.setdiff1d(np.arange(n), self.independent)
        N = np.zeros((n, self.independent.size))
        N[self.independent] = np.eye(self.independent.size)
        N[dependent] = -np.linalg.lstsq(J[:, dependent], J[:, self.independent], rcond=None)[0]
        return N
