"""The equations of motion of robots with joints that turn freely, in angles that are not singular."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..runtime.kernel import Kernel
from ..runtime.turning import ON, SINGULAR, singular_joints
from ..state.turning import Turns
from .closed import ClosedSystem
from .system import System

LATE = 0.8 * SINGULAR  # of |cos beta|, at which a method that looks for events stops: y surely begins anew there


class TurningSystem(System):
    """The equations of motion, y = (q, v) with other coordinates of joints whose described angles are singular.

    Where |cos beta| of such a joint becomes small, y begins anew with its other angles, and with the described ones
    when those are singular.  Drives, wrenches and prescribed motions are asked in described coordinates, and so are
    results; a force on a described angle keeps its meaning.
    """

    def __init__(self, kernel: Kernel, *loads: Any) -> None:
        super().__init__(kernel, *loads)
        self._turns = Turns(kernel)
        self._told = np.zeros(kernel.n)  # q of the state that was reached, as described

    @property
    def index(self) -> Index:
        """Places of y in (q, v) as described: where origins are turned, those of the axes that they have."""
        places = np.arange(2 * self.n)
        for _, origin in self._turns.places:
            for first in () if origin < 0 else (origin, self.n + origin):
                places[first : first + 3] = np.roll(places[first : first + 3], -ON)
        return np.asarray(places[super().index])

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """y of the state at the first time, (n,) each; what has to be put right is put into its arrays."""
        self._told = q.copy()
        whole = self._turn(singular_joints(q, self._turns.joints), np.concatenate([q, v]))
        given = whole.copy()
        y = super().begin(t, *np.split(whole, 2))
        if not np.array_equal(whole, given):
            q[:], v[:] = np.split(self.described(whole[np.newaxis])[0], 2)
        return y

    def whole(self, times: Array, ys: Array) -> Array:
        """q and v as described, (N, 2n), of y, (N, size), at the times; angles follow those of the last state."""
        return self.described(super().whole(times, ys))

    def described(self, whole: Array) -> Array:
        """q and v as described, (N, 2n), of those in the coordinates of ``here``."""
        return self._turns.back(whole, self._told)

    def arrived(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """y to go on with from t, where a step has led, q and v there, and whether y begins anew."""
        y, reached, anew = super().arrived(t, y)
        whole = self.described(reached[np.newaxis])[0]
        self._told = whole[: self.n].copy()
        singular = singular_joints(reached, self._turns.joints)
        if not singular:
            return y, whole, anew
        return self.resume(self._turn(self._turns.turned ^ singular, whole)), whole, True

    def edges(self, y: Array) -> Array:
        """Numbers of which none changes its sign between two times at which y begins anew."""
        return np.array([abs(np.cos(y[first + 1])) - LATE for first, _ in self._turns.joints.values()])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a described state: the drives, and what the motion of prescribed coordinates needs."""
        u = np.array(super().drives(t, q, v))
        if self._given:
            self._told = q.copy()
            y = self._turn(singular_joints(q, self._turns.joints), np.concatenate([q, v]))
            u[self._given] = super().forces(t, y[: self.n], y[self.n :])[self._given]
        return u

    def _needed(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Forces that motions which are given need, at their places in (T, n), where u has their accelerations."""
        found = np.empty_like(q)
        for rows, x, rate in self._regular(q, v):
            pull = wrench if wrench is None or np.ndim(wrench) < 3 else np.asarray(wrench)[rows]
            found[rows] = super()._needed(x, rate, self._turns.forces(u[rows], q[rows], x), pull)
        return found

    def drives(self, t: float, q: Array, v: Array) -> Array:
        """u of one state, (n,), or of a batch, (N, n), on the coordinates that y has."""
        if not self._turns.turned or self._drive is None:
            return super().drives(t, q, v)
        told = self._told_beside(q, v)
        return self._turns.forces(super().drives(t, *told), told[0], q)

    def wrench(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """External wrenches in one state, (links, 6)."""
        if not self._turns.turned or not callable(self._wrench):
            return super().wrench(t, q, v)
        return super().wrench(t, *self._told_beside(q, v))

    def _told_beside(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Described q and v of one state, or of a batch whose states lie about one."""
        ys = np.atleast_2d(np.concatenate([q, v], axis=-1))
        found = self.described(ys).reshape(*q.shape[:-1], 2 * self.n)
        return found[..., : self.n], found[..., self.n :]

    def _turn(self, turned: frozenset[str], whole: Array) -> Array:
        """q and v of a described state with these joints turned, which are so from now on."""
        self._turns.take(turned)
        self.here = self._turns.here
        return np.array(self._turns.on(whole[np.newaxis])[0])

    def _regular(self, q: Array, v: Array) -> Iterator[tuple[Index, Array, Array]]:
        """Samples in angles that are not singular, where ``here`` is of these: their rows, and q and v of them."""
        for rows in self._turns.regular(q):
            self.here = self._turns.here
            part = self._turns.on(np.hstack([q[rows], v[rows]]))
            yield rows, np.ascontiguousarray(part[:, : self.n]), np.ascontiguousarray(part[:, self.n :])


class ClosedTurningSystem(TurningSystem, ClosedSystem):
    """System of a mechanism with closed loops: y has the independent ones of the coordinates that are taken."""

    def margins(self, q: Array) -> Array | None:
        """How far samples, (T, n), are from singular poses, (T,); None where that would take long."""
        found = np.empty(len(q))
        for rows, part, _ in self._regular(q, np.zeros_like(q)):
            margins = super().margins(part)
            if margins is None:
                return None
            found[rows] = margins
        return found

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Counts of calls, and more that is said of the motion with samples q and v, (T, n)."""
        found = [super(ClosedTurningSystem, self).about(*part) for _, *part in self._regular(q, v)]
        return {key: max(part[key] for part in found) for key in found[0]}
