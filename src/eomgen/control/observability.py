"""Observability: which directions of a state measurements do not show at all, and which ones they hardly show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..limits import LARGEST
from ..names import listed
from ..shown import Shown

Numbers = NDArray[Any]
Severity = Literal["note", "warning", "error"]
RANK = 1e-9  # singular values below this share of the greatest one are round-off
NAMED = 0.05  # share of a state in a direction from which on it is named
HORIZON = 1.0  # s of measurements
PARTS = 8  # of the horizon: across one of them errors of rounding grow as an unstable state does
POOR = 0.5  # of a standard deviation at the beginning: what remains of it after the horizon where little was measured
ROUND_OFF = 1e-13  # of the greatest singular value of the Gramian's root: smaller ones count as zero
HUGE = 1e150  # whose square nearly overflows
LISTED = 3  # poorly known directions that lines have


@dataclass(frozen=True, kw_only=True)
class Observability(Shown):
    """Observability of a filter's states: what is not observable, and how well the rest is known after some time.

    States are in units of ``scale``, so that numbers of all of them can be compared.

    Attributes:
        states: names of the states.
        rank: of the observability matrix (H; H F; H F^2; ...).
        directions: unobservable ones, (states - rank, states), orthonormal.
        scale: standard deviations of the states at the beginning, (states,); SI units, rad.
        horizon: time of measurements, s; less than was asked for where unstable states would overflow.
        condition: of the observability Gramian W = sum_k (H F^k)^T R^-1 (H F^k), R the noise of measurements, over the
            horizon; infinite where it is singular to round-off, above 1e26.
        remaining: directions, (states, states), orthogonal, the least known one first, each as long as its standard
            deviation after the horizon.  Their squares make the covariance F^k (1 + W)^-1 F^kT: the information
            of the measurements and the prior, without noise of the motion.
    """

    states: tuple[str, ...]
    rank: int
    directions: Numbers
    scale: Numbers
    horizon: float
    condition: float
    remaining: Numbers

    @property
    def is_complete(self) -> bool:
        """Whether all states are observable."""
        return self.rank == len(self.states)

    @property
    def deviations(self) -> Numbers:
        """Standard deviations of the states after the horizon, (states,); SI units, rad."""
        return np.asarray(self.scale * np.sqrt((self.remaining**2).sum(axis=0)))

    @property
    def poor(self) -> int:
        """Number of directions along which more than half of the standard deviation at the beginning remains."""
        return int(np.count_nonzero(np.linalg.norm(self.remaining, axis=1) > POOR))

    @property
    def severity(self) -> Severity:
        """The word "error" with unobservable directions, "warning" with poorly known ones, else "note"."""
        return "error" if not self.is_complete else "warning" if self.poor else "note"

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Names of the states in unobservable directions, that of the largest share first."""
        share = np.sqrt((self.directions**2).sum(axis=0))
        return tuple(self.states[i] for i in np.argsort(-share, kind="stable") if share[i] > NAMED)

    def lines(self) -> list[str]:
        """Return the rank, the condition, and unobservable and least known directions by their states, for people."""
        lines = [f"rank {self.rank} of {len(self.states)} states"]
        lines += [f"  unobservable: {self._moves(direction)}" for direction in self.directions]
        condition = f"{self.condition:.3g}" if np.isfinite(self.condition) else f"above {ROUND_OFF**-2:.0e}"
        what = f"observability Gramian over {self.horizon:.4g} s: condition {condition}"
        count = f"{self.poor} direction{'s' * (self.poor > 1)}"
        poor = f"; {count} known hardly better than at the beginning" if self.poor else ""
        lines.append(f"{self.severity}: {what}{poor}")
        for direction in self.remaining[: min(max(self.poor, 1), LISTED)]:
            share = f"{float(np.linalg.norm(direction)):.3g} of that at the beginning"
            lines.append(f"  standard deviation after {self.horizon:.4g} s: {self._moves(direction)} ({share})")
        return lines

    def _moves(self, direction: Numbers) -> str:
        """Return a direction by the states that it moves, the greatest shares first."""
        least = NAMED * float(np.linalg.norm(direction))
        parts = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > least]
        moves = ", ".join(f"{direction[i] * self.scale[i]:+.3g} of {self.states[i]}" for i in parts[:6])
        return moves + (f" and {len(parts) - 6} more" if len(parts) > 6 else "")

    def message(self) -> str:
        """Return what errors say."""
        return (
            f"measurements tell {self.rank} of {len(self.states)} states; along {len(self.states) - self.rank}"
            f" directions nothing is known, of {listed(self.unobservable)}"
        )


def common_observability(
    states: Sequence[str],
    systems: Sequence[tuple[Numbers, Numbers]],
    scale: Numbers,
    deviations: Numbers,
    *,
    dt: float,
    horizon: float = HORIZON,
) -> Observability:
    """Return what systems x+ = F x, y = H x tell together: a direction counts as unobservable where none shows it.

    By the staircase algorithm: of what H does not see, what F keeps there, and so on; each step is orthogonal, so that
    no powers of F are taken.

    Args:
        states: names.
        systems: F, (N, N), and H, (m, N), of each.
        scale: the states' uncertainty, (N,).
        deviations: the measurements', (m,).
        dt: time of one step, which a measurement ends, s.
        horizon: time of measurements, s, of which the systems have equal shares, one after the other.
    """
    scaled = [(np.asarray(F, float) * scale / scale[:, None], H * scale / deviations[:, None]) for F, H in systems]
    seen = []
    for F, H in scaled:
        Z = _null(H)
        while Z.shape[1]:
            moved = F @ Z
            left = _null(moved - Z @ (Z.T @ moved), float(np.linalg.norm(moved, 2)))
            if left.shape[1] == Z.shape[1]:
                break
            Z = Z @ left
        seen.append(np.eye(len(states)) - Z @ Z.T)
    hidden = _null(np.vstack(seen))
    count = PARTS * len(systems)
    steps = max(round(min(horizon / dt, LARGEST)), 1)
    bounds = [steps * k // count for k in range(count + 1)]
    kinds = [(k // PARTS, bounds[k + 1] - bounds[k]) for k in range(count)]
    made = {kind: _part(*scaled[kind[0]], kind[1]) for kind in dict.fromkeys(kinds)}
    root, remaining, done = _measured([made[kind] for kind in kinds])
    least, greatest = (float(x) for x in np.linalg.svd(root, compute_uv=False)[[-1, 0]])
    return Observability(
        states=tuple(states),
        rank=len(states) - hidden.shape[1],
        directions=_sparse(hidden),
        scale=scale,
        horizon=bounds[done] * dt,
        condition=np.inf if hidden.shape[1] or least <= ROUND_OFF * greatest else (greatest / least) ** 2,
        remaining=remaining,
    )


def _measured(parts: Sequence[tuple[Numbers, Numbers]]) -> tuple[Numbers, Numbers, int]:
    """Return a root of the Gramian of parts that follow each other, directions that remain, and how many parts count.

    By orthogonal transformations, so that eigenvalues far below round-off of the largest one are found.  Parts count up
    to the first one in which a number overflows.
    """
    size = len(parts[0][1])
    root, power, remaining = np.zeros((size, size)), np.eye(size), np.eye(size)
    for done, (R, F) in enumerate(parts):
        with np.errstate(over="ignore", invalid="ignore"):
            rows, further, ahead, carried = R @ power, F @ power, R @ remaining, F @ remaining
        if not all((np.abs(x) < HUGE).all() for x in (rows, further, ahead, carried)):
            return root, _by_length(remaining), done
        root, power = _root(root, rows), further
        _, S, V = np.linalg.svd(ahead)
        remaining = carried @ V.T / np.hypot(1.0, S)
    return root, _by_length(remaining), len(parts)


def _part(F: Numbers, H: Numbers, steps: int) -> tuple[Numbers, Numbers]:
    """Return R, with R'R = sum of (H F^k)'(H F^k) for k = 1 ... steps, and F^steps, by doubling."""
    R, power = np.zeros_like(F), np.eye(len(F))
    with np.errstate(over="ignore", invalid="ignore"):
        for bit in bin(steps)[2:]:
            R, power = _root(R, R @ power), power @ power
            if bit == "1":
                R, power = _root(R, H @ F @ power), F @ power
    return R, power


def _by_length(root: Numbers) -> Numbers:
    """Return orthogonal rows of the covariance root root', the longest first; greatest entries are positive."""
    U, S, _ = np.linalg.svd(root)
    greatest = U[np.abs(U).argmax(axis=0), np.arange(len(U))]
    return np.asarray((U * S * np.sign(greatest)).T)


def _root(*rows: Numbers) -> Numbers:
    """Return R with R'R of stacked rows; NaN where one of them is not finite."""
    stacked = np.vstack(rows)
    return np.asarray(np.linalg.qr(stacked, mode="r")) if np.isfinite(stacked).all() else np.full_like(rows[0], np.nan)


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
