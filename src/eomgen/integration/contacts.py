"""When the clearances of joints, cut ones too, and of elastic couplings close and open along a motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..runtime.kernel import Kernel
from ..state.motors import deflections
from ..state.springs import clearances, cut_clearances

Array = NDArray[np.float64]

HALVINGS = 52  # of a step, to the last bit of a time


@dataclass(frozen=True)
class Contact:
    """A coordinate that reaches an end of its clearance, or leaves it.

    Attributes:
        t: s.
        coordinate: its name; of a motor's transmission the motor's, of a coupling the coupling's.
        side: 1 at the positive end, -1 at the negative one.
        closes: whether it comes, or goes.
        rate: of the coordinate, or of the transmission's or coupling's deflection, m/s or rad/s.
    """

    t: float
    coordinate: str
    side: int
    closes: bool
    rate: float


class ContactWatch:
    """Finds contacts between two states of a motion; ``found`` grows.

    A clearance that closes and opens again within one step is not seen: the solver has not seen it either.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._kernel, self._n = kernel, kernel.n
        own, cut = clearances(kernel), cut_clearances(kernel)
        names = [(name, gaps[name]) for gaps in (own, cut) for name in gaps]
        ends = [(name, side, gap) for name, gap in names for side in (1, -1)]
        self.names = [name for name, _, _ in ends]
        self.side = [side for _, side, _ in ends]
        self.clearance = np.array([gap for _, _, gap in ends])
        springs = deflections(kernel)
        rows = [side * springs[kernel.coordinates.index(name)] for name, side, _ in ends[: 2 * len(own)]]
        self._rows = np.array(rows).reshape(-1, kernel.n)
        self._cuts = [kernel.cut_laws.index(name) for name, _, _ in ends[2 * len(own) :]]
        self._cut_sides = np.array(self.side[2 * len(own) :])
        self.found: list[Contact] = []

    def __len__(self) -> int:
        """Number of ends that are watched."""
        return len(self.names)

    def gaps(self, y: Array) -> Array:
        """Distances beyond each of the ends, m or rad, below 0 inside; y = (q, v)."""
        q, v = y[: self._n], y[self._n :]
        own = self._rows @ q
        if not self._cuts:
            return np.asarray(own - self.clearance)
        deviations = self._kernel.cut_forces(q, v)[self._cuts, 0]
        return np.asarray(np.concatenate([own, self._cut_sides * deviations]) - self.clearance)

    def _rate(self, end: int, y: Array) -> float:
        """Rate of what one of the ends stops, towards it."""
        q, v, own = y[: self._n], y[self._n :], len(self._rows)
        if end < own:
            return float(self._rows[end] @ v)
        cut = self._cuts[end - own]
        return float(self._cut_sides[end - own] * (self._kernel.cut_jacobian(q)[cut] @ v))

    def find(self, t0: float, y0: Array, t1: float, y1: Array, at: Callable[[float], Array] | None = None) -> None:
        """Find the contacts between two states of a motion, and note them.

        Args:
            t0, t1: s.
            y0, y1: states (q, v) there, (2n,).
            at: t -> state between; a cubic through both ends' q and v if not given.
        """
        if not len(self):
            return
        crossed = np.flatnonzero((self.gaps(y0) > 0.0) != (self.gaps(y1) > 0.0))
        for end in crossed:
            state = at or (lambda t: hermite(t, t0, y0, t1, y1))
            closes = bool(self.gaps(y1)[end] > 0.0)
            low, high = t0, t1
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if (self.gaps(state(middle))[end] > 0.0) == closes:
                    high = middle
                else:
                    low = middle
            self.note(int(end), high, state(high), closes)
        self.found.sort(key=lambda contact: contact.t)

    def note(self, end: int, t: float, y: Array, closes: bool) -> None:
        """Add a contact at one of the ends, whose time t (s) and state y are known."""
        side = self.side[end]
        self.found.append(Contact(float(t), self.names[end], side, closes, side * self._rate(end, y)))


def hermite(t: float, t0: float, y0: Array, t1: float, y1: Array) -> Array:
    """The state at t on the cubic through q and v at both ends, (2n,)."""
    n, h = y0.size // 2, t1 - t0
    x = (t - t0) / h
    d = y1[:n] - y0[:n]
    a = h * (y0[n:] + y1[n:]) - 2.0 * d
    b = 3.0 * d - h * (2.0 * y0[n:] + y1[n:])
    q = y0[:n] + x * (h * y0[n:] + x * (b + x * a))
    return np.concatenate([q, y0[n:] + x * (2.0 * b + 3.0 * x * a) / h])
