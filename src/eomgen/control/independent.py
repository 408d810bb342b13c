"""Independent coordinates of closed mechanisms, and what forces and momenta on all coordinates are along them.

With velocities w of the independent coordinates all are v = Z w, Z = [1; S] with the slopes S = -J_d^-1 J_i of the
dependent ones, J being dg/dq of the constraint.  Forces of constraints J^T lambda do no work along them,
Z^T J^T = 0, and

    (Z^T p)' = Z^T p' + Z'^T p,    Z'^T p = -Z^T J'^T mu,    J_d^T mu = p_d,

as J_d S' = -J' Z.  J'^T mu is half the derivative by v of mu^T (J' v), which is quadratic in v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import independent_columns, rank_of
from ..errors import SingularError
from ..kernel.complete import Kernel
from ..names import listed
from ..runtime.singular import inertias

Numbers = NDArray[Any]


@dataclass(frozen=True)
class Independent:
    """Which coordinates of a closed mechanism are independent.

    Attributes:
        free: indices of the independent coordinates, (f,).
        bound: of the dependent ones, (b,).
        rows: of the constraint's components that they follow from, (b,); others are redundant.
    """

    free: tuple[int, ...]
    bound: tuple[int, ...]
    rows: tuple[int, ...]

    @classmethod
    def of(cls, kernel: Kernel, q: ArrayLike, driven: Sequence[int]) -> Independent:
        """Choose about an assembled state, (n,): driven coordinates are independent as far as they can.

        Args:
            kernel: with those of the group "independent coordinates".
            q: closes the loops.
            driven: indices of the driven coordinates.
        """
        M = np.asarray(kernel.mass_matrix(q), float)
        J = np.asarray(kernel.functions.constraint_jacobian(q), float) / np.sqrt(inertias(M))
        rank, others = rank_of(J), np.setdiff1d(np.arange(kernel.n), driven)
        chosen = others[independent_columns(J[:, others], rank_of(J[:, others]))]
        if chosen.size < rank:  # more drives than freedoms
            Q, _ = np.linalg.qr(J[:, chosen])
            left = J[:, driven] - Q @ (Q.T @ J[:, driven])
            chosen = np.concatenate([chosen, np.asarray(driven)[independent_columns(left, rank - chosen.size)]])
        bound = np.sort(chosen)
        rows = sorted(independent_columns(J[:, bound].T, rank))
        free = np.setdiff1d(np.arange(kernel.n), bound)
        return cls(tuple(map(int, free)), tuple(map(int, bound)), tuple(map(int, rows)))

    def follow(self, kernel: Kernel, q: ArrayLike) -> tuple[Numbers, Numbers]:
        """Return the slopes S, (..., b, f), and the inverse of J_d, (..., b, b).

        Raises:
            SingularError: the independent coordinates do not hold the others in this state.
        """
        J = kernel.functions.constraint_jacobian(q)[..., list(self.rows), :]
        try:
            inverse = np.linalg.inv(J[..., list(self.bound)])
        except np.linalg.LinAlgError:
            names = [kernel.coordinates[i] for i in self.free]
            raise SingularError(
                f"{kernel.name}: {listed(names)} do not hold the other coordinates in this state; allowed: motions"
                " that keep off singular configurations"
            ) from None
        return -inverse @ J[..., list(self.free)], inverse

    def along(self, slopes: Numbers, x: Numbers) -> Numbers:
        """Return Z^T x, (..., f), of forces or momenta x on all coordinates, (..., n)."""
        return np.asarray(x[..., list(self.free)] + np.einsum("...bf,...b->...f", slopes, x[..., list(self.bound)]))

    def turning(self, kernel: Kernel, q: ArrayLike, v: ArrayLike, p: Numbers, inverse: Numbers) -> Numbers:
        """Return J'^T mu, (..., n), with J_d^T mu = p_d: -Z^T of it is Z'^T p."""
        mu = np.zeros((*p.shape[:-1], len(kernel.constraints)), kernel.dtype)
        mu[..., list(self.rows)] = np.einsum("...br,...b->...r", inverse, p[..., list(self.bound)])
        return np.asarray(kernel.dtype.type(0.5) * kernel.vjp(kernel.functions.constraint_bias, (q, v), mu)[1])
