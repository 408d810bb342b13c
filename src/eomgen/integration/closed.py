"""The equations of motion of mechanisms with closed loops, in coordinates that keep them closed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..errors import ArrayError, IntegrationStopped, LoopError
from ..loops.chart import Chart, Followed
from ..runtime.kernel import Kernel
from ..runtime.loop_errors import left_open
from ..state.springs import rate_step
from ..state.vectors import Q_STEP
from .system import System

TURN = 2.0 * np.pi  # rad, or m: how far y goes from its origin
LARGE = 2500  # entries of J: of more no singular values are looked at in every sample
OPEN = 1e-9  # m or rad, and per second and the largest rate: more is not round-off


class ClosedSystem(System):
    """The equations of motion with the loops' forces, y = (independent coordinates less an origin, their rates).

    The dependent coordinates follow from closing the loops wherever the equations are evaluated, so that nothing
    drifts, whatever the method and its steps.  Where others are better independent ones, y begins anew; and once in a
    turn of a crank, so that relative tolerances do not grow with the angle.
    """

    part = 0.02  # an error of one coordinate is one of all that depend on it, and of their kinetic energy

    def __init__(self, kernel: Kernel, *loads: Any) -> None:
        super().__init__(kernel, *loads)
        self._chart: Chart | None = None
        self._opened: LoopError | None = None  # since the state that was reached
        self._origin = np.zeros(self.n)
        self._last = np.zeros(2 * self.n)  # the state that was reached
        if "constrained_dynamics" not in kernel.raw.functions:
            raise kernel.raw.missing("constrained_dynamics")
        self._function = kernel.raw.functions["constrained_dynamics"]
        self._size = self.n + 3 * len(kernel.constraints)

    @property
    def chart(self) -> Chart:
        """The choice of independent coordinates; there is one once the motion has begun."""
        assert self._chart is not None
        return self._chart

    @property
    def index(self) -> Index:
        """Places of y in (q, v)."""
        return self._places

    @property
    def _places(self) -> Index:
        return np.concatenate([self.chart.free, self.n + self.chart.free])

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """y of the state at the first time, closed to the last digit; LoopError if it is open, or opening."""
        self.prescribe(t, q, v)
        kernel = self.here
        gaps, rates = kernel.constraint(q), kernel.constraint_jacobian(q) @ v
        if np.abs(gaps).max() > OPEN:
            raise left_open(kernel.raw, gaps, "is open", "q of kernel.close")
        if np.abs(rates).max() > OPEN * max(1.0, float(np.abs(v).max())):
            raise left_open(kernel.raw, rates, "is opening", "v of kernel.close_rates", "/s")
        y, self._last, _ = ClosedSystem.arrived(self, t, self.resume(np.concatenate([q, v])))
        q[:], v[:] = self._last[: self.n], self._last[self.n :]
        return y

    def whole(self, times: Array, ys: Array) -> Array:
        """q and v, (N, 2n), of y, (N, size), at the times."""
        return np.hstack(self._states(times, ys)[:2])

    def arrived(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """y to go on with from t, q and v there, and whether y begins anew; LoopError where the loops come open."""
        found = self._followed(t, y)
        self.chart.use(found.q, found.slopes)
        self._opened = None
        self._last = np.concatenate([found.q, found.v])
        other = self.chart.moved()
        if other is None and np.abs(y[: y.size // 2]).max(initial=0.0) <= TURN:
            return y, self._last, False
        self._chart = other or self._chart
        return self._anew(), self._last, True

    def resume(self, whole: Array) -> Array:
        """y that goes on from q and v, (2n,), closed, in the coordinates of ``here``."""
        self._last = whole
        self._chart = Chart(self.here, whole[: self.n])
        return self._anew()

    def _anew(self) -> Array:
        """y of the state that was reached, which becomes the origin."""
        self._origin = self._last[: self.n].copy()
        return np.concatenate([np.zeros(self.chart.free.size), self._last[self.n + self.chart.free]])

    def derivative(self, t: float, y: Array) -> Array:
        """y' of one state."""
        self.evaluated(t, y)
        found, f = self._followed(t, y), y.size // 2
        result = np.empty_like(y)
        result[:f] = y[f:]
        result[f:] = self._accelerations(t, found.q, found.v, self._given_at(t))[self.chart.free]
        return result

    def trial(self, t: float, y: Array) -> Array:
        """y' of one state, NaN where there is none, and where the loops do not close."""
        try:
            return super().trial(t, y)
        except LoopError as error:
            self._opened = error
            self.note(error, y)
            return np.full_like(y, np.nan)

    def jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy: the kernel's exact one, and where it has none by finite differences, all at once."""
        self.counts["jacobians"] += 1
        if "forward_dynamics_jacobian" in self.here.operations:
            return self._exact_jacobian(t, y)
        steps = self._differences(y)
        found = self._derivatives(t, np.vstack([y, y + np.diag(steps)]))
        return np.asarray((found[1:] - found[0]).T / steps)

    def _exact_jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy from the derivatives of the closed accelerations along the loops.

        Those of wrenches, and of drives without a method ``slopes``, are finite differences.
        """
        q, v, _, slopes = self._followed(t, y)
        u, f = self._loads(t, q, v), y.size // 2
        if self._given:
            u[self._given] = self._given_at(t)
        by_q, by_v, by_u = self.here.forward_dynamics_jacobian(q, v, u)
        ways, free = self.chart.tangent_basis(slopes), self.chart.free
        turning = self._turning(q, v, ways)
        result = np.zeros((2 * f, 2 * f))
        result[:f, f:] = np.eye(f)
        result[f:, :f] = (by_q @ ways + by_v @ turning)[free]
        result[f:, f:] = (by_v @ ways)[free]
        if self._drive is not None or self._wrench is not None:
            by_u[:, self._given] = 0.0
            result[f:] += by_u[free] @ self._loads_along(t, y, (q, v), ways, turning)
        return result

    def _turning(self, q: Array, v: Array, ways: Array) -> Array:
        """Derivatives of all rates, (n, f), by the independent coordinates whose rates stay.

        J v = 0 says how: J dv = -(dJ) v.  That is half of what the bias of the constraint, which is quadratic in v,
        changes by along the ways, and accelerations that follow from none of the others are what it makes.
        """
        size = max(1.0, float(np.abs(v).max()))
        both = np.vstack([v + size * ways.T, v - size * ways.T])
        plus, minus = np.split(self.chart.follow(np.tile(q, (len(both), 1)), both, near=True).a, 2)
        return np.asarray((plus - minus).T / (4.0 * size))

    def _loads_along(self, t: float, y: Array, state: tuple[Array, Array], ways: Array, turning: Array) -> Array:
        """Derivatives of drives and wrenches by y, (n, 2f), about its state."""
        exact, result = self._exact_slopes(), np.zeros((self.n, y.size))
        if exact is not None:
            by_q, by_v = exact(t, *state)
            result = np.hstack([by_q @ ways + by_v @ turning, by_v @ ways])
            if self._wrench is None:
                return result
        steps = self._differences(y)
        q, v, *_ = self._states(np.full(y.size + 1, t), np.vstack([y, y + np.diag(steps)]))
        loads = self._loads(t, q, v, drives=exact is None)
        return np.asarray(result + (loads[1:] - loads[0]).T / steps)

    def _differences(self, y: Array) -> Array:
        """Steps of finite differences, (2f,)."""
        f, size = y.size // 2, np.maximum(1.0, np.abs(y))
        return np.concatenate([Q_STEP * size[:f], rate_step(self.kernel) * size[f:]])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a state: the drives, and what the motion of prescribed coordinates needs."""
        u = np.array(self.drives(t, q, v))
        if not self._given:
            return u
        given, n = self.prescribe(t, q, v), self.n
        found = self._constrained(t, q[np.newaxis], v[np.newaxis], given)[0]
        a, multipliers = found[:n], found[n : n + len(self.kernel.constraints)]
        needed = self.here.residual(q, v, a, np.zeros(n), wrench=self.wrench(t, q, v))
        needed -= self.here.constraint_jacobian(q).T @ multipliers
        return np.where(self._free, u, needed)

    def _needed(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Forces that motions which are given need, at their places in (T, n), where u has their accelerations."""
        kernel, n, loads = self.here.with_checks(False), self.n, u
        if wrench is not None:
            loads = np.where(self._free, u + kernel.external_force(q, wrench), u)
        found = kernel.calls.run("constrained_dynamics", None, (q, v, loads))
        a, multipliers = np.ascontiguousarray(found[:, :n]), found[:, n : n + len(kernel.constraints)]
        needed = kernel.residual(q, v, a, np.zeros(n), wrench=wrench)
        return np.asarray(needed - np.einsum("tmn,tm->tn", kernel.constraint_jacobian(q), multipliers))

    def margins(self, q: Array) -> Array | None:
        """The smallest of as many singular values of J as it has rank, by the greatest, at samples, (T,).

        Lengths are by the coordinates' kinetic energy; None of large mechanisms, where that would take long.
        """
        moving = np.flatnonzero(self._free)
        if len(self.kernel.constraints) * moving.size > LARGE or not self.chart.rank:
            return None
        inertia = np.diagonal(self.here.mass_matrix(q), axis1=1, axis2=2)[:, np.newaxis, moving]
        scaled = self.here.constraint_jacobian(q)[:, :, moving] / np.sqrt(np.maximum(inertia, 1e-12))
        sizes = np.linalg.svd(scaled, compute_uv=False)
        return np.asarray(sizes[:, self.chart.rank - 1] / np.maximum(sizes[:, 0], 1e-300))

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Counts, the greatest |g| and |J v| over all samples, (T, n), and the constraints that are redundant."""
        rates = np.einsum("tmn,tn->tm", self.here.constraint_jacobian(q), v)
        return {
            **super().about(q, v),
            "gap": float(np.abs(self.here.constraint(q)).max()),
            "gap_rate": float(np.abs(rates).max()),
            "redundant": float(len(self.kernel.constraints) - self.chart.rank),
        }

    def stopped(self, reason: str, t: float, y: Array, blame: Array | None = None) -> IntegrationStopped:
        """The error that says where a motion could not go on, with the last closed state."""
        seen = blame if blame is not None else self._stuck
        whole = None
        if seen is not None:
            whole = self._last.copy()
            whole[self._places] = seen
            whole[self.chart.free] += self._origin[self.chart.free]
        self._stuck = None
        if self._opened is not None:
            self.trouble = self._opened
            return super().stopped("the loops do not stay closed", t, self._last)
        return super().stopped(reason, t, self._last, whole)

    def _followed(self, t: float, y: Array) -> Followed:
        """The closed state of y."""
        chart, f = self.chart, y.size // 2
        q, v = chart.q.copy(), np.zeros(self.n)
        q[chart.free], v[chart.free] = y[:f] + self._origin[chart.free], y[f:]
        if self._given:
            self.prescribe(t, q, v)
        try:
            return chart.follow(q, v)
        except ArrayError:
            for label, x in (("q", q), ("v", v)):
                self._refuse_not_finite(label, x, t)
            raise

    def _states(self, times: Array, ys: Array) -> Followed:
        """The closed states of many y, (N, size)."""
        chart, f = self.chart, ys.shape[1] // 2
        q, v = np.zeros((len(ys), self.n)), np.zeros((len(ys), self.n))
        q[:, chart.free], v[:, chart.free] = ys[:, :f] + self._origin[chart.free], ys[:, f:]
        if self._given:
            for i, t in enumerate(times.tolist()):
                self.prescribe(t, q[i], v[i])
        for label, x in (("q", q), ("v", v)):
            self._refuse_not_finite(label, x, float(times[0]))
        return chart.follow(q, v)

    def _given_at(self, t: float) -> Array | None:
        """Accelerations of the prescribed coordinates, None without any."""
        return self.prescribe(t, np.zeros(self.n), np.zeros(self.n)) if self._given else None

    def _derivatives(self, t: float, ys: Array) -> Array:
        """y' of states at one time, (N, size)."""
        q, v, *_ = self._states(np.full(len(ys), t), ys)
        a = self._constrained(t, q, v, self._given_at(t))[:, : self.n]
        self._refuse_not_finite("acceleration", a, t)
        free = self.chart.free
        return np.hstack([v[:, free], a[:, free]])

    def _accelerations(self, t: float, q: Array, v: Array, given: Array | None) -> Array:
        """Accelerations of one closed state, (n,)."""
        u = self._loads(t, q, v)
        if given is not None:
            u[self._given] = given
        calls, found = self.here.calls, np.empty(self._size)
        if calls.call(self._function, (q, v, u), (), (), None, found) >= 0:
            return calls.run("constrained_dynamics", None, (q, v, u))[: self.n]  # which says what is wrong
        a = found[: self.n]
        self._refuse_not_finite("acceleration", a, t)
        return a

    def _constrained(self, t: float, q: Array, v: Array, given: Array | None) -> Array:
        """Accelerations and multipliers, and gaps, of closed states at one time, (N, n + 3 m)."""
        u = self._loads(t, q, v)
        if given is not None:
            u[:, self._given] = given
        return self.here.calls.run("constrained_dynamics", None, (q, v, u))

    def _loads(self, t: float, q: Array, v: Array, *, drives: bool = True) -> Array:
        """Drives and what wrenches do, (n,) or (N, n), N or N m; of wrenches alone where drives do not count."""
        u = np.array(self.drives(t, q, v)) if drives else np.zeros(q.shape)
        wrench = self._wrenches(t, q, v)
        if wrench is not None:
            u += self.here.external_force(q, wrench)
        return u

    def _wrenches(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """External wrenches in a state, or in states at one time: for all of them or for each."""
        if q.ndim == 1 or not callable(self._wrench):
            return self.wrench(t, q, v)
        return np.array([self.wrench(t, *state) for state in zip(q, v, strict=True)])
