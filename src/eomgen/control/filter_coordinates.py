"""Coordinates that a filter estimates: all of a tree, the independent ones of a closed mechanism."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kernel.complete import Kernel
from .independent import Independent

Numbers = NDArray[Any]


class FilterCoordinates(Protocol):
    """Estimated coordinates and velocities x, (2 f,), and the states (q, v) of the robot, (n,) each, that they tell."""

    @property
    def free(self) -> list[int]:
        """Indices of the estimated coordinates among all, (f,)."""
        ...

    def state(self, x: Numbers) -> tuple[Numbers, Numbers]:
        """Return q and v, (n,) each."""
        ...

    def directions(self, q: Numbers, v: Numbers) -> tuple[Numbers, Numbers]:
        """Return derivatives of q and v by x, a row for each of its numbers, (2 f, n) each."""
        ...


@dataclass(frozen=True)
class AllCoordinates:
    """All n coordinates of a robot without loops."""

    n: int

    @property
    def free(self) -> list[int]:
        """Indices of all coordinates."""
        return list(range(self.n))

    def state(self, x: Numbers) -> tuple[Numbers, Numbers]:
        """Return q and v, (n,) each."""
        return np.array(x[: self.n]), np.array(x[self.n :])

    def directions(self, q: Numbers, v: Numbers) -> tuple[Numbers, Numbers]:
        """Return derivatives of q and v by x, (2 n, n) each."""
        del v
        unit = np.eye(2 * self.n, dtype=q.dtype)
        return unit[:, : self.n], unit[:, self.n :]


@dataclass
class IndependentCoordinates:
    """Independent coordinates of a closed mechanism; the others follow on the branch on which the last state was.

    Attributes:
        kernel: with those of the groups "independent coordinates" and "slopes of closure".
        choice: which coordinates are independent.
    """

    kernel: Kernel
    choice: Independent
    _x: Numbers = field(init=False, repr=False)
    _state: tuple[Numbers, Numbers] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._x, self._state = np.full(2 * len(self.free), np.nan), (np.zeros(0), np.zeros(0))

    @property
    def free(self) -> list[int]:
        """Indices of the independent coordinates, (f,)."""
        return list(self.choice.free)

    def begin(self, q: ArrayLike, v: ArrayLike) -> Numbers:
        """Return x, (2 f,), of a state whose dependent coordinates are guesses, q and v, (n,) each."""
        guess, rate = (np.asarray(values, self.kernel.dtype) for values in (q, v))
        x = np.concatenate([guess[self.free], rate[self.free]])
        self._place(x, guess)
        return x

    def state(self, x: Numbers) -> tuple[Numbers, Numbers]:
        """Return assembled q and v, (n,) each.

        Raises:
            LoopError: the loops do not close with these coordinates, near the state before.
            SingularError: the independent coordinates do not hold the others there.
        """
        if not np.array_equal(x, self._x):
            guess = self._state[0].copy()
            guess[self.free] = x[: len(self.free)]
            self._place(x, guess)
        return self._state[0].copy(), self._state[1].copy()

    def directions(self, q: Numbers, v: Numbers) -> tuple[Numbers, Numbers]:
        """Return derivatives of q and v by x, (2 f, n) each.

        With J v = 0 the dependent velocities change with q along dq by -J_d^-1 (J' v), J' along dq: half the derivative
        by v along dq of the constraint's bias, which is quadratic in v.
        """
        f, bound, rows = len(self.free), list(self.choice.bound), list(self.choice.rows)
        slopes, inverse = self.choice.follow(self.kernel, q)
        Z = np.zeros((f, q.size), q.dtype)
        Z[range(f), self.free], Z[:, bound] = 1.0, slopes.T
        dq, dv = np.zeros((2 * f, q.size), q.dtype), np.zeros((2 * f, q.size), q.dtype)
        dq[:f] = dv[f:] = Z
        still, half = np.zeros_like(q), q.dtype.type(0.5)
        for row, along in zip(dv, Z, strict=False):
            bias = half * self.kernel.jvp(self.kernel.functions.constraint_bias, (q, v), (still, along))
            row[bound] = -inverse @ bias[rows]
        return dq, dv

    def _place(self, x: Numbers, guess: Numbers) -> None:
        """Let the dependent coordinates follow, near a guess, and keep the state."""
        f = len(self.free)
        q = self.kernel.assemble(guess, fixed=[self.kernel.coordinates[i] for i in self.free])
        slopes, _ = self.choice.follow(self.kernel, q)
        v = np.zeros_like(q)
        v[self.free] = x[f:]
        v[list(self.choice.bound)] = slopes @ v[self.free]
        self._x, self._state = np.array(x), (q, v)
