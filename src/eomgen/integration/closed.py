"""The equations of motion of mechanisms with closed loops, which stay closed without drift."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, LoopError
from ..loops.closed import ClosedLoops
from ..runtime.kernel import Kernel
from ..state.vectors import DriveFunction, MotionFunction, WrenchFunction
from .system import System

Array = NDArray[np.float64]


class ClosedSystem(System):
    """The equations of motion with the loops' forces.

    After every step q and v go to the nearest state, in the metric of the kinetic energy, that is closed to 1e-12.
    With ``baumgarte`` a restoring acceleration does it instead: gaps then stay small, and are not zero.
    """

    def __init__(
        self,
        kernel: Kernel,
        drive: DriveFunction | None,
        wrench: WrenchFunction | ArrayLike | None,
        prescribed: MotionFunction | None = None,
        baumgarte: float | None = None,
    ) -> None:
        super().__init__(kernel, drive, wrench, prescribed)
        if baumgarte is not None and not (np.isfinite(baumgarte) and baumgarte > 0.0):
            raise InputError(f"baumgarte: {baumgarte!r} 1/s; allowed: a finite rate above 0, or None for projection")
        self.loops, self.baumgarte, self.rank = ClosedLoops(kernel), baumgarte or 0.0, 0

    def begin(self, t: float, q: Array, v: Array) -> None:
        """Put prescribed coordinates into the state's arrays, and find the rank there; LoopError if it is open."""
        self.prescribe(t, q, v)
        self.loops.refuse_open(q, v)
        self.rank = self.loops.redundancy(q).rank

    def derivative(self, t: float, y: Array) -> Array:
        """y' of one state."""
        self.evaluated(t, y)
        q, v = y[: self.n].copy(), y[self.n :].copy()
        return np.concatenate([v, self._solve(t, q, v)[0]])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a state: the drives, and what the motion of prescribed coordinates needs."""
        if not self._given:
            return np.array(self.drives(t, q, v))
        a, multipliers = self._solve(t, q, v)
        needed = self.kernel.inverse_dynamics(q, v, a, wrench=self.wrench(t, q, v), cut=True)
        needed -= self.kernel.constraint_jacobian(q).T @ multipliers
        return np.where(self._free, self.drives(t, q, v), needed)

    def _solve(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Accelerations and multipliers; q and v of prescribed coordinates are put into the arrays."""
        given = self.prescribe(t, q, v)
        u = np.array(self.drives(t, q, v))
        u[self._given] = given
        return self.loops.solve(q, v, u, self.wrench(t, q, v), self.baumgarte, self.rank)[:2]

    def settle(self, t: float, h: float, y: Array, good: Array) -> Array:
        """The nearest closed state to y, which a step of h from the state ``good`` at t has led to."""
        if self.baumgarte:
            return y
        try:
            q, v = y[: self.n].copy(), y[self.n :].copy()
            self.prescribe(t + h, q, v)
            q, v, self.rank = self.loops.settled(q, v, self.rank)
            return np.concatenate([q, v])
        except LoopError as error:
            self.trouble = error
            raise self.stopped("the loops do not stay closed", t, good) from error

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Counts, the greatest |g| and |J v| over all samples, (T, n), and the constraints that are redundant."""
        rates = np.einsum("tmn,tn->tm", self.kernel.constraint_jacobian(q), v)
        return {
            **super().about(q, v),
            "gap": float(np.abs(self.kernel.constraint(q)).max()),
            "gap_rate": float(np.abs(rates).max()),
            "redundant": float(len(self.kernel.constraints) - self.rank),
        }
