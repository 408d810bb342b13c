"""Integration of mechanisms with closed loops, without drift."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, LoopError
from ..loops.closed import ClosedLoops
from ..progress import Progress
from ..state.vectors import Drive, Prescribed, Wrench, state_vector
from .contacts import ContactWatch
from .steps import Samples, fixed_step, output_times, reporter, rk4
from .system import System
from .trajectory import Motion, Trajectory, trajectory_of

Array = NDArray[np.float64]


def integrate_loops(
    loops: ClosedLoops,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    *,
    drive: Drive | None = None,
    wrench: Wrench | ArrayLike | None = None,
    prescribed: Prescribed | None = None,
    step: float | None = None,
    output_step: float | None = None,
    baumgarte: float | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Integrate with the classical Runge-Kutta method of fourth order, and keep the loops closed.

    After every step q and v go to the nearest state, in the metric of the kinetic energy, that is closed to 1e-12.
    With ``baumgarte`` a restoring acceleration does it instead: gaps then stay small, and are not zero.

    Args:
        loops: the mechanism.
        q0, v0: the state at t = 0, (n,): of ``consistent_positions`` and ``consistent_velocities``, closed with what
            ``prescribed`` says of its coordinates.
        duration: s.
        drive, wrench, prescribed, output_step, progress: as in ``eomgen.integrate.integrate``.
        step: s; by default 1 ms, or less where springs or samples ask for it.
        baumgarte: w, 1/s, of g_ddot = -2 w g_dot - w^2 g; a fraction of 1 / step.

    Returns:
        The samples; ``info`` also has gap and gap_rate, the greatest |g| and |J v| among them, and the number of
        ``redundant`` constraints at the end.

    Raises:
        LoopError: the state at t = 0 is open.
        IntegrationStopped: a loop comes open, the state diverges, M is singular, or a drive or wrench is not finite;
            with the last good state and the trajectory up to it.
        InputError: another argument is wrong.
    """
    kernel = loops.kernel
    q0, v0 = (state_vector(label, x, kernel.coordinates) for label, x in (("q0", q0), ("v0", v0)))
    times = output_times(duration, output_step)
    began = time.perf_counter()
    system = _LoopSystem(loops, drive, wrench, prescribed, _rate(baumgarte))
    system.prescribe(0.0, q0, v0)
    loops.refuse_open(q0, v0)
    system.rank = loops.redundancy(q0).rank
    report = reporter(progress, float(times[-1]))
    settle = None if baumgarte else system.settled
    y0 = np.concatenate([q0, v0])
    watch = ContactWatch(kernel)
    samples = Samples(times, y0)

    def run() -> None:
        rk4(system, samples, fixed_step(kernel, q0, step, times), report, settle, watch)

    def info(motion: Motion) -> dict[str, float]:
        rates = np.einsum("tmn,tn->tm", kernel.constraint_jacobian(motion.q), motion.v)
        return {
            **system.counts,
            "gap": float(np.abs(kernel.constraint(motion.q)).max()),
            "gap_rate": float(np.abs(rates).max()),
            "redundant": float(len(kernel.constraints) - system.rank),
            "wall_s": time.perf_counter() - began,
        }

    return trajectory_of(system, samples, run, "rk4", watch, info)


def _rate(baumgarte: float | None) -> float:
    if baumgarte is not None and not (np.isfinite(baumgarte) and baumgarte > 0.0):
        raise InputError(f"baumgarte: {baumgarte!r} 1/s; allowed: a finite rate above 0, or None for projection")
    return baumgarte or 0.0


class _LoopSystem(System):
    """The equations of motion with the loops' forces."""

    def __init__(
        self,
        loops: ClosedLoops,
        drive: Drive | None,
        wrench: Wrench | ArrayLike | None,
        prescribed: Prescribed | None,
        baumgarte: float,
    ) -> None:
        super().__init__(loops.kernel, drive, wrench, prescribed)
        self.loops, self.baumgarte, self.rank = loops, baumgarte, 0

    def derivative(self, t: float, y: Array) -> Array:
        """y' of one state."""
        self.counts["evaluations"] += 1
        q, v = y[: self.n].copy(), y[self.n :].copy()
        return np.concatenate([v, self._solve(t, q, v)[0]])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a state: the drives, and what the motion of prescribed coordinates needs."""
        if not self._given:
            return np.array(self.drives(t, q, v))
        a, multipliers = self._solve(t, q, v)
        kernel = self.loops.kernel
        needed = kernel.inverse_dynamics(q, v, a, wrench=self.wrench(t, q, v))
        needed -= kernel.constraint_jacobian(q).T @ multipliers
        return np.where(self._free, self.drives(t, q, v), needed)

    def _solve(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Accelerations and multipliers; q and v of prescribed coordinates are put into the arrays."""
        given = self.prescribe(t, q, v)
        u = np.array(self.drives(t, q, v))
        u[self._given] = given
        return self.loops.solve(q, v, u, self.wrench(t, q, v), self.baumgarte, self.rank)[:2]

    def settled(self, t: float, h: float, y: Array, good: Array) -> Array:
        """The nearest closed state to y, which a step of h from the state ``good`` at t has led to."""
        try:
            q, v = y[: self.n].copy(), y[self.n :].copy()
            self.prescribe(t + h, q, v)
            q, v, self.rank = self.loops.settled(q, v, self.rank)
            return np.concatenate([q, v])
        except LoopError as error:
            self.trouble = error
            raise self.stopped("the loops do not stay closed", t, good) from error
