"""The equations of motion of robots with joints that turn freely, in angles that are not singular."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import IntegrationStopped
from ..runtime.kernel import Kernel
from ..state.turning import BACK, ON, SINGULAR, other_forces, seen, singular_joints
from ..state.vectors import DriveFunction, MotionFunction, WrenchFunction
from .system import System

Array = NDArray[np.float64]

LATE = 0.8 * SINGULAR  # of |cos beta|, at which a method that looks for events stops: y surely begins anew there


class TurningSystem(System):
    """The equations of motion, y = (q, v) with other coordinates of joints whose described angles are singular.

    Where |cos beta| of such a joint becomes small, y begins anew with its other angles, and with the described ones
    when those are singular.  Drives, wrenches and prescribed motions are asked in described coordinates, and so are
    results; a force on a described angle keeps its meaning.
    """

    def __init__(
        self,
        kernel: Kernel,
        drive: DriveFunction | None,
        wrench: WrenchFunction | ArrayLike | None,
        prescribed: MotionFunction | None = None,
    ) -> None:
        super().__init__(kernel, drive, wrench, prescribed)
        self._joints = kernel.raw.turning
        self._kernels = {frozenset[str](): kernel}
        self._turned = frozenset[str]()
        self._told = np.zeros(kernel.n)  # q of the state that was reached, as described

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """y of the state at the first time, (n,) each; what has to be put right is put into its arrays."""
        return self.arrived(t, super().begin(t, q, v))[0]

    def whole(self, times: Array, ys: Array) -> Array:
        """q and v as described, (N, 2n), of y, (N, size), at the times; angles follow those of the last state."""
        return self._described(ys)

    def arrived(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """y to go on with from t, where a step has led, q and v there, and whether y begins anew."""
        whole = self._described(y[np.newaxis])[0]
        self._told = whole[: self.n].copy()
        singular = singular_joints(y, self._joints)
        if not singular:
            return y, whole, False
        return self._turn(self._turned ^ singular, whole), whole, True

    def edges(self, y: Array) -> Array:
        """Numbers of which none changes its sign between two times at which y begins anew."""
        return np.array([abs(np.cos(y[first + 1])) - LATE for first, _ in self._joints.values()])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a described state: the drives, and what the motion of prescribed coordinates needs."""
        u = np.array(super().drives(t, q, v))
        if self._given:
            self._told = q.copy()
            y = self._turn(singular_joints(q, self._joints), np.concatenate([q, v]))
            u[self._given] = super().forces(t, y[: self.n], y[self.n :])[self._given]
        return u

    def drives(self, t: float, q: Array, v: Array) -> Array:
        """u of one state, (n,), or of a batch, (N, n), on the coordinates that y has."""
        if not self._turned or self._drive is None:
            return super().drives(t, q, v)
        told = self._told_beside(q, v)
        u = np.array(super().drives(t, *told))
        for first, origin in self._turned_places():
            angles, along = slice(first, first + 3), slice(origin, origin + 3)
            u[..., angles] = other_forces(told[0][..., angles], q[..., angles], u[..., angles])
            if origin >= 0:
                u[..., along] = np.roll(u[..., along], -ON, axis=-1)
        return u

    def wrench(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """External wrenches in one state, (links, 6)."""
        if not self._turned or not callable(self._wrench):
            return super().wrench(t, q, v)
        return super().wrench(t, *self._told_beside(q, v))

    def stopped(self, reason: str, t: float, y: Array, blame: Array | None = None) -> IntegrationStopped:
        """The error that says where a motion could not go on, with the last good state as described."""
        blame = y if blame is None and self._stuck is None else blame
        return super().stopped(reason, t, self._described(y[np.newaxis])[0], blame)

    def _turned_places(self) -> list[tuple[int, int]]:
        return [self._joints[name] for name in self._joints if name in self._turned]

    def _told_beside(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Described q and v of one state, or of a batch whose states lie about one."""
        ys = np.atleast_2d(np.concatenate([q, v], axis=-1))
        found = self._described(ys).reshape(*q.shape[:-1], 2 * self.n)
        return found[..., : self.n], found[..., self.n :]

    def _described(self, ys: Array) -> Array:
        """q and v as described, (N, 2n), of y, (N, 2n)."""
        return seen(ys, self._turned_places(), BACK, self._told) if self._turned else ys

    def _turn(self, turned: frozenset[str], whole: Array) -> Array:
        """y of a described state with these joints turned, which are so from now on."""
        self._turned = turned
        if turned not in self._kernels:
            self._kernels[turned] = self.kernel.with_turned(turned)
        self.here = self._kernels[turned]
        return np.asarray(seen(whole[np.newaxis], self._turned_places(), ON, np.zeros(self.n))[0])
