"""Contact events of an integration: clearances that close and open, stops, journals in their bearings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel
from ..state.elements import Numbers
from ..state.journals import JournalContact, cut_contacts, cut_deviations, journal_contacts
from ..state.motors import acting, deflections
from ..state.springs import clearances, cut_numbers, law_numbers, stops
from .cubics import Cubics
from .until import Until, bisected

CLEARANCE, STOP = "clearance", "stop"


@dataclass(frozen=True)
class Contact:
    """A coordinate that reaches an end of its clearance or one of its stops, or leaves it; a journal in its bearing.

    Attributes:
        t: s.
        coordinate: its name; of a motor's transmission the motor's, of a coupling the coupling's; of a
            journal "JOINT.radial".
        side: 1 at the positive end or upper stop, -1 at the negative end or lower stop; of a journal the end of its
            bearing, 0 without a length.
        closes: whether it comes, or goes.
        rate: of the coordinate, or of the transmission's or coupling's deflection, m/s or rad/s; of a journal
            that of its distance from the bearing's axis.
        kind: CLEARANCE or STOP.
        angle: of a journal, rad: the direction of x and y in which it touches, atan2(y, x); None of others.
    """

    t: float
    coordinate: str
    side: int
    closes: bool
    rate: float
    kind: str = CLEARANCE
    angle: float | None = None


class Ends(Protocol):
    """Ends of one kind whose contacts a motion may make."""

    ends: Sequence[Any]

    def gaps(self, q: Array, v: Array) -> Array:
        """Return penetrations of each end in a state, (n,), or in many, (N, n): m or rad, below 0 inside."""

    def contact(self, end: int, t: float, q: Array, v: Array, closes: bool) -> Contact:
        """Return the contact at one of the ends, in the state at its time."""


@dataclass(frozen=True)
class _End:
    """An end of a coordinate: its name, which side, where (m or rad, towards that side), and the kind of contact."""

    name: str
    side: int
    place: float
    kind: str


def _ends(numbers: Numbers) -> list[_End]:
    """Return both ends of clearances, then the finite stops."""
    ends = [_End(name, side, gap, CLEARANCE) for name, gap in clearances(numbers).items() for side in (1, -1)]
    for name, (lower, upper) in stops(numbers).items():
        ends += [_End(name, side, side * x, STOP) for side, x in ((1, upper), (-1, lower)) if np.isfinite(x)]
    return ends


class CoordinateEnds(Ends):
    """Ends of tree coordinates and of transmission deflections; a motor's stops are those of its shaft."""

    def __init__(self, kernel: Kernel) -> None:
        self.ends = _ends(law_numbers(kernel))
        deflected, names = deflections(kernel), acting(kernel)
        followers, offsets = follower_matrix(kernel)
        coordinates, shifts = np.vstack([np.eye(kernel.n), followers]), np.concatenate([np.zeros(kernel.n), offsets])
        index = [names.index(end.name) for end in self.ends]
        rows = [
            end.side * (coordinates if end.kind == STOP else deflected)[i]
            for end, i in zip(self.ends, index, strict=True)
        ]
        self._rows = np.array(rows).reshape(-1, kernel.n)
        pairs = zip(self.ends, shifts[index], strict=True)
        self._places = np.array([end.place - end.side * shift for end, shift in pairs])

    def gaps(self, q: Array, v: Array) -> Array:
        return np.asarray(q @ self._rows.T - self._places)

    def contact(self, end: int, t: float, q: Array, v: Array, closes: bool) -> Contact:
        here = self.ends[end]
        return Contact(t, here.name, here.side, closes, float(here.side * (self._rows[end] @ v)), here.kind)


class CutEnds(Ends):
    """Ends of loop joints' coordinates and of elastic couplings."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self.ends = _ends(cut_numbers(kernel))
        self._index = [kernel.cut_laws.index(end.name) for end in self.ends]
        self._sides = np.array([end.side for end in self.ends])
        self._places = np.array([end.place for end in self.ends])

    def gaps(self, q: Array, v: Array) -> Array:
        return np.asarray(self._sides * self._kernel.functions.cut_forces(q, v)[..., self._index, 0] - self._places)

    def contact(self, end: int, t: float, q: Array, v: Array, closes: bool) -> Contact:
        here, velocity = self.ends[end], self._kernel.functions.cut_jacobian(q)[self._index[end]] @ v
        return Contact(t, here.name, here.side, closes, float(velocity), here.kind)


class Bearings(Ends):
    """Contacts of journals in bearings."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self.ends = journal_contacts(kernel)

    def gaps(self, q: Array, v: Array) -> Array:
        return np.stack([journal.penetration(q) for journal in self.ends], axis=-1)

    def contact(self, end: int, t: float, q: Array, v: Array, closes: bool) -> Contact:
        journal: JournalContact = self.ends[end]
        x, y = journal.centre(q)
        angle = float(np.arctan2(y, x))
        velocity = np.array([np.cos(angle), np.sin(angle)]) @ journal.centre_jacobian(q) @ v[list(journal.index)]
        return Contact(t, journal.name, journal.end, closes, float(velocity), angle=angle)


class CutBearings(Bearings):
    """Contacts of loop joints' journals, in the coordinates of these joints."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self.ends = cut_contacts(kernel)

    def gaps(self, q: Array, v: Array) -> Array:
        return super().gaps(cut_deviations(self._kernel, q), v)

    def contact(self, end: int, t: float, q: Array, v: Array, closes: bool) -> Contact:
        return super().contact(
            end, t, cut_deviations(self._kernel, q), self._kernel.functions.cut_jacobian(q) @ v, closes
        )


class ContactWatch:
    """Locates contacts between two states of a motion, and the end of ``until``; ``contacts`` grows.

    A contact that closes and opens again within one step is not seen: the solver has not seen it either.
    """

    def __init__(self, kernel: Kernel, until: Until | None = None) -> None:
        self._until, self._cubics = until, Cubics(kernel.raw.turning, kernel.n)
        self._n = kernel.n
        groups: Sequence[Ends] = (CoordinateEnds(kernel), CutEnds(kernel), Bearings(kernel), CutBearings(kernel))
        self._groups = [group for group in groups if group.ends]
        self.contacts: list[Contact] = []

    @property
    def is_needed(self) -> bool:
        """Whether there is anything to watch."""
        return self._until is not None or len(self) > 0

    def __len__(self) -> int:
        """Return the number of ends that are watched."""
        return sum(len(group.ends) for group in self._groups)

    def gaps(self, y: Array) -> Array:
        """Return penetrations of each end, m or rad, below 0 inside; y = (q, v, z), (size,) or (N, size)."""
        q, v = y[..., : self._n], y[..., self._n : 2 * self._n]
        distances = [group.gaps(q, v) for group in self._groups]
        return np.concatenate(distances, axis=-1) if distances else np.zeros((*y.shape[:-1], 0))

    def find_all(self, times: Array, states: Array) -> None:
        """Locate the contacts between successive states, (k, size), at times, (k,), s, and note them.

        Raises:
            Reached: what the motion goes on to is there.
        """
        if self._until is not None:
            self._until.look(times, states, lambda t: self._cubics.among(t, times, states))
        beyond = self.gaps(states) > 0.0
        for k in np.flatnonzero((beyond[1:] != beyond[:-1]).any(axis=1)).tolist():
            self._find(float(times[k]), states[k], float(times[k + 1]), states[k + 1])

    def find(
        self,
        t0: float,
        y0: Array,
        t1: float,
        y1: Array,
        at: Callable[[float], Array] | None = None,
        rates: Array | None = None,
    ) -> None:
        """Locate the contacts between two states of a motion, and note them.

        Args:
            t0, t1: s.
            y0, y1: states (q, v, z) there.
            at: t -> state between; default a cubic through both ends' q and v.
            rates: of internal states at t0, (m,), for that.

        Raises:
            Reached: what the motion goes on to is there.
        """
        if self._until is not None:
            between = at or (lambda t: self._cubics.at(t, t0, y0, t1, y1, rates))
            self._until.look(np.array([t0, t1]), np.stack([y0, y1]), between)
        self._find(t0, y0, t1, y1, at)

    def _find(self, t0: float, y0: Array, t1: float, y1: Array, at: Callable[[float], Array] | None = None) -> None:
        """Locate contacts alone, as ``find``."""
        if not len(self):
            return
        before, closes = (self.gaps(y) > 0.0 for y in (y0, y1))
        state = at or (lambda t: self._cubics.at(t, t0, y0, t1, y1))
        for end in np.flatnonzero(before != closes).tolist():
            t = bisected(t0, t1, lambda t, i=end: (self.gaps(state(t))[i] > 0.0) == before[i])  # type: ignore[misc]
            self.note(end, t, state(t), bool(closes[end]))
        self.contacts.sort(key=lambda contact: contact.t)

    def note(self, end: int, t: float, y: Array, closes: bool) -> None:
        """Add a contact at one of the ends, whose time t (s) and state y are known."""
        for group in self._groups:
            if end < len(group.ends):
                self.contacts.append(group.contact(end, float(t), y[: self._n], y[self._n : 2 * self._n], closes))
                return
            end -= len(group.ends)
