"""When the clearances of joints close and open along a motion, and when their stops are touched and left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..runtime.kernel import Kernel
from ..state.motors import deflections
from ..state.springs import clearances, stops

Array = NDArray[np.float64]

CLEARANCE, STOP = "clearance", "stop"
HALVINGS = 52  # of a step, to the last bit of a time


@dataclass(frozen=True)
class Contact:
    """A coordinate that reaches an end of its clearance or one of its stops, or leaves it.

    Attributes:
        t: s.
        coordinate: its name; of a motor's transmission the motor's.
        side: 1 at the positive end or upper stop, -1 at the negative end or lower stop.
        closes: whether it comes, or goes.
        rate: of the coordinate, or of the transmission's deflection, m/s or rad/s.
        kind: CLEARANCE or STOP.
    """

    t: float
    coordinate: str
    side: int
    closes: bool
    rate: float
    kind: str = CLEARANCE


class ContactWatch:
    """Finds contacts between two states of a motion; ``found`` grows.

    A contact that closes and opens again within one step is not seen: the solver has not seen it either.
    """

    def __init__(self, kernel: Kernel) -> None:
        self.names = kernel.coordinates
        gaps, places = clearances(kernel), stops(kernel)
        ends = [(i, side, gaps[name]) for i, name in enumerate(self.names) if name in gaps for side in (1, -1)]
        self.kind = [CLEARANCE] * len(ends)
        for i, name in enumerate(self.names):
            lower, upper = places.get(name, (-np.inf, np.inf))
            ends += [(i, side, side * x) for side, x in ((1, upper), (-1, lower)) if np.isfinite(x)]
        self.kind += [STOP] * (len(ends) - len(self.kind))
        self.index = [i for i, _, _ in ends]
        self.side = [side for _, side, _ in ends]
        self.end = np.array([x for _, _, x in ends])
        deflected, own = deflections(kernel), np.eye(kernel.n)  # a motor's stops are those of its shaft
        rows = [
            side * (own if kind == STOP else deflected)[i] for (i, side, _), kind in zip(ends, self.kind, strict=True)
        ]
        self.rows = np.array(rows).reshape(-1, kernel.n)
        self.found: list[Contact] = []

    def __len__(self) -> int:
        """Number of ends that are watched."""
        return len(self.index)

    def gaps(self, y: Array) -> Array:
        """Distances of coordinates beyond each of their ends, m or rad, below 0 inside; y = (q, v) or q."""
        return np.asarray(self.rows @ y[: len(self.names)] - self.end)

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
        rate = float(side * (self.rows[end] @ y[len(self.names) :]))
        self.found.append(Contact(float(t), self.names[self.index[end]], side, closes, rate, self.kind[end]))


def hermite(t: float, t0: float, y0: Array, t1: float, y1: Array) -> Array:
    """The state at t on the cubic through q and v at both ends, (2n,)."""
    n, h = y0.size // 2, t1 - t0
    x = (t - t0) / h
    d = y1[:n] - y0[:n]
    a = h * (y0[n:] + y1[n:]) - 2.0 * d
    b = 3.0 * d - h * (2.0 * y0[n:] + y1[n:])
    q = y0[:n] + x * (h * y0[n:] + x * (b + x * a))
    return np.concatenate([q, y0[n:] + x * (2.0 * b + 3.0 * x * a) / h])
