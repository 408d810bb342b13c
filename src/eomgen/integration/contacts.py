"""When the clearances of joints close and open along a motion, and when journals touch their bearings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..runtime.kernel import Kernel
from ..state.journals import JournalContact, journal_contacts
from ..state.motors import deflections
from ..state.springs import clearances

Array = NDArray[np.float64]

HALVINGS = 52  # of a step, to the last bit of a time


@dataclass(frozen=True)
class Contact:
    """A coordinate that reaches an end of its clearance, or leaves it; or a journal that comes to its bearing.

    Attributes:
        t: s.
        coordinate: its name; of a motor's transmission the motor's; of a journal "JOINT.radial".
        side: 1 at the positive end, -1 at the negative one; of a journal the end of its bearing, 0 without a length.
        closes: whether it comes, or goes.
        rate: of the coordinate, or of the transmission's deflection, m/s or rad/s; of a journal that of its distance
            from the bearing's axis.
        angle: of a journal, rad: the direction of x and y in which it touches, atan2(y, x); None of others.
    """

    t: float
    coordinate: str
    side: int
    closes: bool
    rate: float
    angle: float | None = None


class ContactWatch:
    """Finds contacts between two states of a motion; ``found`` grows.

    A clearance that closes and opens again within one step is not seen: the solver has not seen it either.
    """

    def __init__(self, kernel: Kernel) -> None:
        self.names = kernel.coordinates
        gaps = clearances(kernel)
        ends = [(i, side, gaps[name]) for i, name in enumerate(self.names) if name in gaps for side in (1, -1)]
        self.index = [i for i, _, _ in ends]
        self.side = [side for _, side, _ in ends]
        self.clearance = np.array([c for _, _, c in ends])
        springs = deflections(kernel)
        self.rows = np.array([side * springs[i] for i, side, _ in ends]).reshape(-1, kernel.n)
        self.journals = journal_contacts(kernel)
        self.found: list[Contact] = []

    def __len__(self) -> int:
        """Number of ends that are watched."""
        return len(self.index) + len(self.journals)

    def gaps(self, y: Array) -> Array:
        """Distances of coordinates beyond each of their ends, m or rad, below 0 inside; y = (q, v) or q.

        Those of journals come behind them.
        """
        q = y[: len(self.names)]
        found = self.rows @ q - self.clearance
        return np.append(found, [journal.gap(q) for journal in self.journals]) if self.journals else np.asarray(found)

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
        if end >= len(self.index):
            q, v = y[: len(self.names)], y[len(self.names) :]
            self.found.append(_touched(self.journals[end - len(self.index)], float(t), q, v, closes))
            return
        side = self.side[end]
        rate = float(side * (self.rows[end] @ y[len(self.names) :]))
        self.found.append(Contact(float(t), self.names[self.index[end]], side, closes, rate))


def _touched(journal: JournalContact, t: float, q: Array, v: Array, closes: bool) -> Contact:
    """The contact of a journal at a state."""
    x, y = journal.centre(q)
    angle = float(np.arctan2(y, x))
    rate = np.array([np.cos(angle), np.sin(angle)]) @ journal.arms(q) @ v[list(journal.index)]
    return Contact(t, journal.name, journal.end, closes, float(rate), angle)


def hermite(t: float, t0: float, y0: Array, t1: float, y1: Array) -> Array:
    """The state at t on the cubic through q and v at both ends, (2n,)."""
    n, h = y0.size // 2, t1 - t0
    x = (t - t0) / h
    d = y1[:n] - y0[:n]
    a = h * (y0[n:] + y1[n:]) - 2.0 * d
    b = 3.0 * d - h * (2.0 * y0[n:] + y1[n:])
    q = y0[:n] + x * (h * y0[n:] + x * (b + x * a))
    return np.concatenate([q, y0[n:] + x * (2.0 * b + 3.0 * x * a) / h])
