"""Observability: which directions of a state measurements tell nothing of, however long they are taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..names import listed
from ..shown import Shown

Numbers = NDArray[Any]
RANK = 1e-9  # singular values below this share of the greatest one are round-off
NAMED = 0.05  # share of a state in an unobservable direction from which on it is named


@dataclass(frozen=True, kw_only=True)
class Observability(Shown):
    """How many of a filter's states measurements tell of, and along which directions they tell nothing.

    Attributes:
        states: names of the states.
        rank: of the observability matrix (H; H F; H F^2; ...), with states in units of their uncertainty.
        directions: unobservable ones, (states - rank, states), orthonormal in those units, where ``scale`` has them.
        scale: standard deviations of the states at the beginning, (states,).
    """

    states: tuple[str, ...]
    rank: int
    directions: Numbers
    scale: Numbers

    @property
    def is_complete(self) -> bool:
        """Whether all states are observable."""
        return self.rank == len(self.states)

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Names of the states in unobservable directions, that of the largest share first."""
        share = np.sqrt((self.directions**2).sum(axis=0))
        return tuple(self.states[i] for i in np.argsort(-share, kind="stable") if share[i] > NAMED)

    def lines(self) -> list[str]:
        """Return the rank, and each unobservable direction by its states, for people."""
        lines = [f"rank {self.rank} of {len(self.states)} states"]
        for direction in self.directions:
            parts = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > NAMED]
            moves = ", ".join(f"{direction[i] * self.scale[i]:+.3g} of {self.states[i]}" for i in parts[:6])
            more = f" and {len(parts) - 6} more" if len(parts) > 6 else ""
            lines.append(f"  unobservable: {moves}{more}")
        return lines

    def message(self) -> str:
        """Return what errors say."""
        return (
            f"measurements tell {self.rank} of {len(self.states)} states; along {len(self.states) - self.rank}"
            f" directions nothing is known, of {listed(self.unobservable)}"
        )


def common_observability(
    states: Sequence[str], systems: Sequence[tuple[Numbers, Numbers]], scale: Numbers, deviations: Numbers
) -> Observability:
    """Return what systems x+ = F x, y = H x tell together: a direction counts as unobservable where none shows it.

    By the staircase algorithm: of what H does not see, what F keeps there, and so on; each step is orthogonal, so that
    no powers of F are taken.

    Args:
        states: names.
        systems: F, (N, N), and H, (m, N), of each.
        scale: the states' uncertainty, (N,).
        deviations: the measurements', (m,).
    """
    seen = []
    for F, H in systems:
        scaled = np.asarray(F, float) * scale / scale[:, None]
        Z = _null(np.asarray(H, float) * scale / deviations[:, None])
        while Z.shape[1]:
            moved = scaled @ Z
            left = _null(moved - Z @ (Z.T @ moved), float(np.linalg.norm(moved, 2)))
            if left.shape[1] == Z.shape[1]:
                break
            Z = Z @ left
        seen.append(np.eye(len(states)) - Z @ Z.T)
    hidden = _null(np.vstack(seen))
    return Observability(
        states=tuple(states), rank=len(states) - hidden.shape[1], directions=_sparse(hidden), scale=scale
    )


def _null(A: Numbers, size: float = 0.0) -> Numbers:
    """Return an orthonormal basis of the null space of A, (N, k); what is small beside ``size`` counts as 0, too."""
    _, S, V = np.linalg.svd(A, full_matrices=True)
    rank = int(np.count_nonzero(max(S.max(initial=0.0), size) * RANK < S))
    return np.asarray(V[rank:].T)


def _sparse(Z: Numbers) -> Numbers:
    """Return the same directions as rows, turned so that each has few states: by a pivoted factorisation."""
    rows, left = list[Numbers](), Z.copy()
    while left.shape[1]:
        i = int(np.argmax((left**2).sum(axis=1)))
        along = left @ left[i]
        along /= np.linalg.norm(along)
        rows.append(np.where(np.abs(along) > RANK, along, 0.0))
        left = left - np.outer(along, along @ left)
        U, S, _ = np.linalg.svd(left, full_matrices=False)
        left = U[:, : Z.shape[1] - len(rows)] * (S[: Z.shape[1] - len(rows)] > 0.5)
    return np.array(rows).reshape(-1, Z.shape[0])
