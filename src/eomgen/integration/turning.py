"""Equations of motion of robots with joints of 3-DOF rotation: chart switching of Euler angles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..kernel.complete import Kernel
from ..kernel.turning import ON, SINGULAR, singular_joints
from ..state.turning import Turns
from .closed import ClosedSystem
from .system import System

LATE = 0.8 * SINGULAR  # of |cos beta|, at which a method that looks for events stops: the chart surely changes there


class TurningSystem(System):
    """Equations of motion, y = (q, v) in the other chart of joints whose described Euler angles are singular.

    Where |cos beta| of such a joint becomes small, y restarts in its other chart, and in the described one when that
    is singular.  Drives, wrenches and prescribed motions are evaluated in described coordinates, and so are results;
    a force on a described angle keeps its meaning.
    """

    def __init__(self, kernel: Kernel, *loads: Any) -> None:
        super().__init__(kernel, *loads)
        self._turns = Turns(kernel)
        self._reference = np.zeros(kernel.n)  # q of the state that was reached, as described

    @property
    def index(self) -> Index:
        """Places of y in described (q, v, z): of joints in their other chart, translations along that chart's axes."""
        places = np.arange(self.size)
        for _, origin in self._turns.places:
            for first in () if origin < 0 else (origin, self.n + origin):
                places[first : first + 3] = np.roll(places[first : first + 3], -ON)
        return np.asarray(places[super().index])

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """Return y of the initial state, q and v, (n,) each; corrects these in place."""
        self._reference = q.copy()
        whole = self._turn(singular_joints(q, self._turns.joints), np.concatenate([q, v]))
        unchanged = whole.copy()
        y = super().begin(t, *np.split(whole, [self.n]))
        if not np.array_equal(whole, unchanged):
            q[:], v[:] = np.split(self.described(whole[np.newaxis])[0], [self.n])
        return y

    def expand(self, times: Array, ys: Array) -> Array:
        """Expand states y, (N, k), at times, (N,), to described (q, v, z), (N, size), unwrapped from the last state."""
        return self.described(super().expand(times, ys))

    def described(self, whole: Array) -> Array:
        """Convert states (q, v, z), (N, size), from the coordinates of ``here`` to those of the description."""
        return self._turns.back(whole, self._reference)

    def accept(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """Accept a step that led to t: return the next y, described (q, v), and whether the chart changed."""
        y, reached, anew = super().accept(t, y)
        whole = self.described(reached[np.newaxis])[0]
        self._reference = whole[: self.n].copy()
        singular = singular_joints(reached, self._turns.joints)
        if not singular:
            return y, whole, anew
        return self.resume(self._turn(self._turns.turned ^ singular, whole)), whole, True

    def chart_events(self, y: Array) -> Array:
        """Evaluate event functions whose zeros are chart switches, (k,)."""
        return np.array([abs(np.cos(y[first + 1])) - LATE for first, _ in self._turns.joints.values()])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate actuator forces in a described state, (n,): the drives, and forces of prescribed motions."""
        u = np.array(super().drives(t, q, v))
        if self._prescribed_index:
            self._reference = q.copy()
            y = self._turn(singular_joints(q, self._turns.joints), np.concatenate([q, v]))
            u[self._prescribed_index] = super().forces(t, y[: self.n], y[self.n :])[self._prescribed_index]
        return u

    def _prescribed_forces(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Compute forces of prescribed motions, at their columns of (T, n), where u has their accelerations."""
        forces = np.empty_like(q)
        for rows, regular_q, regular_v in self._regular(q, v):
            pull = wrench if wrench is None or np.ndim(wrench) < 3 else np.asarray(wrench)[rows]
            forces[rows] = super()._prescribed_forces(
                regular_q, regular_v, self._turns.forces(u[rows], q[rows], regular_q), pull
            )
        return forces

    def drives(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate the drives in one state, (n,), or a batch, (N, n), on the coordinates of y."""
        if not self._turns.turned or self._drive is None:
            return super().drives(t, q, v)
        described = self._described_beside(q, v)
        return self._turns.forces(super().drives(t, *described), described[0], q)

    def wrench(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """Evaluate external wrenches in one state, (links, 6)."""
        if not self._turns.turned or not callable(self._wrench):
            return super().wrench(t, q, v)
        return super().wrench(t, *self._described_beside(q, v))

    def _described_beside(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return described q and v of one state, or of a batch of states about one."""
        ys = np.atleast_2d(np.concatenate([q, v], axis=-1))
        states = self.described(ys).reshape(*q.shape[:-1], self.size)
        return states[..., : self.n], states[..., self.n :]

    def _turn(self, turned: frozenset[str], whole: Array) -> Array:
        """Switch these joints to their other chart from now on; return a described state's (q, v, z) there."""
        self._turns.take(turned)
        self.here = self._turns.here
        return np.array(self._turns.on(whole[np.newaxis])[0])

    def _regular(self, q: Array, v: Array) -> Iterator[tuple[Index, Array, Array]]:
        """Yield groups of samples in charts that are not singular, with ``here`` set to each: rows, q and v."""
        for rows in self._turns.regular(q):
            self.here = self._turns.here
            states = self._turns.on(np.hstack([q[rows], v[rows]]))
            yield rows, np.ascontiguousarray(states[:, : self.n]), np.ascontiguousarray(states[:, self.n :])


class ClosedTurningSystem(TurningSystem, ClosedSystem):
    """Equations of motion of a mechanism with closed loops: y has independent coordinates of the current chart."""

    def margins(self, q: Array) -> Array | None:
        """Return distances of samples, (T, n), from singular poses, (T,); None where that would take long."""
        margins = np.empty(len(q))
        for rows, regular, _ in self._regular(q, np.zeros_like(q)):
            at_rows = super().margins(regular)
            if at_rows is None:
                return None
            margins[rows] = at_rows
        return margins

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Return counts of calls, and more figures of the motion with samples q and v, (T, n)."""
        groups = [super(ClosedTurningSystem, self).about(*states) for _, *states in self._regular(q, v)]
        return {key: max(group[key] for group in groups) for key in groups[0]}
