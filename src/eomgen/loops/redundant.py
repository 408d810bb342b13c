"""Constraints that may be redundant: how many are independent, and what they leave free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import independent_columns, rank_by
from ..errors import InputError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..shown import Shown
from ..state.vectors import prescribed_mask, state_vector

Array = NDArray[Any]


@dataclass(frozen=True)
class Redundancy(Shown):
    """Rank of the constraint in a state, and the constraints that are redundant.

    Attributes:
        rank: number of independent constraints.
        mobility: degrees of freedom that are left: coordinates that are not prescribed, less rank.
        redundant: names of constraints that follow from the others, as many as there are too many; which ones is a
            choice, made by pivoting.
        undetermined: names of constraints whose multipliers are not unique: rigid bodies do not determine them.
    """

    rank: int
    mobility: int
    redundant: tuple[str, ...]
    undetermined: tuple[str, ...]


def redundancy(kernel: Kernel, q: ArrayLike) -> Redundancy:
    """Return rank of a mechanism's constraint at q, where prescribed coordinates do not move, and what is redundant.

    Args:
        kernel: of a robot with loops.
        q: coordinates that close the loops, (n,); elsewhere redundant constraints seem independent.

    Raises:
        InputError: the robot has no constraint.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    if not kernel.constraints:
        raise InputError(
            f"{kernel.name} has nothing to close; allowed: a kernel of a robot with [[loops]] or [[couplings]]"
        )
    q, free = state_vector("q", q, kernel.coordinates), ~prescribed_mask(kernel)
    M = np.asarray(kernel.mass_matrix(q.astype(kernel.dtype)), dtype=np.float64)[np.ix_(free, free)]
    factors = Factors(
        np.asarray(kernel.functions.constraint_jacobian(q.astype(kernel.dtype)), dtype=np.float64)[:, free], M
    )
    return factors.redundancy(kernel.constraints)


class Factors:
    """J L^-T = U S V^T without its singular values that are zero; M = L L^T."""

    def __init__(self, J: Array, M: Array) -> None:
        self.J = J
        self.scaled = np.linalg.solve(np.linalg.cholesky(M), J.T).T
        U, S, _ = np.linalg.svd(self.scaled, full_matrices=False)
        self.rank = rank_by(S)
        self.U = U[:, : self.rank]

    def dependent_rows(self) -> list[int]:
        """Return rows of J that follow from the others.

        What Gram-Schmidt with pivoting leaves when the rank is reached.
        """
        independent = independent_columns(self.scaled.T, self.rank)
        return [i for i in range(len(self.J)) if i not in independent]

    def undetermined_rows(self) -> list[int]:
        """Return rows that take part in a dependence between rows: their projection onto the range of J is shorter."""
        inside = np.einsum("ij,ij->i", self.U, self.U)
        return [i for i, share in enumerate(inside) if share < 1.0 - 1e-8]

    def redundancy(self, constraints: Sequence[str]) -> Redundancy:
        """Name what is redundant, by the constraints."""
        redundant, undetermined = (
            tuple(constraints[i] for i in rows) for rows in (self.dependent_rows(), self.undetermined_rows())
        )
        return Redundancy(self.rank, self.J.shape[1] - self.rank, redundant, undetermined)
