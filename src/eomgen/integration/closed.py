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
from ..runtime.singular import inertias
from ..state.springs import rate_step
from ..state.vectors import Q_STEP
from .system import System

TURN = 2.0 * np.pi  # rad, or m: how far y goes from its origin
LARGE = 2500  # entries of J: of more no singular values are looked at in every sample
OPEN = 1e-9  # m or rad, and per second and the largest velocity: more is not round-off


class ClosedSystem(System):
    """Equations of motion with loop forces, y = (independent coordinates less an origin, their velocities).

    Dependent coordinates are solved from the loops wherever the equations are evaluated, so that nothing drifts,
    whatever the method and its steps.  Where others are better independent ones, y restarts; and once in a revolution
    of a crank, so that relative tolerances do not grow with the angle.
    """

    tolerance_share = 0.02  # an error of one coordinate is one of all that depend on it, and of their kinetic energy

    def __init__(self, kernel: Kernel, *loads: Any) -> None:
        super().__init__(kernel, *loads)
        self._chart: Chart | None = None
        self._loop_error: LoopError | None = None  # since the state that was reached
        self._origin = np.zeros(self.n)
        self._last = np.zeros(2 * self.n)  # the state that was reached
        self._function = kernel.raw.writing("constrained")
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
        """Return y of the initial state, assembled to the last digit; LoopError if constraints are violated."""
        self.prescribe(t, q, v)
        kernel = self.here
        residuals, velocity_residuals = kernel.functions.constraint(q), kernel.functions.constraint_jacobian(q) @ v
        if np.abs(residuals).max() > OPEN:
            raise left_open(kernel.raw, residuals, "is open", "q of kernel.assemble")
        if np.abs(velocity_residuals).max() > OPEN * max(1.0, float(np.abs(v).max())):
            raise left_open(kernel.raw, velocity_residuals, "is opening", "v of kernel.project_velocity", "/s")
        y, self._last, _ = ClosedSystem.accept(self, t, self.resume(np.concatenate([q, v])))
        q[:], v[:] = self._last[: self.n], self._last[self.n :]
        return y

    def expand(self, times: Array, ys: Array) -> Array:
        """Expand reduced states y, (N, size), at times, (N,), to assembled (q, v), (N, 2n)."""
        return np.hstack(self._closed_states(times, ys)[:2])

    def accept(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """Accept a step that led to t: return the next y, (q, v), and whether y restarts; LoopError if loops open."""
        closed = self._closed_state(t, y)
        self.chart.use(closed.q, closed.slopes)
        self._loop_error = None
        self._last = np.concatenate([closed.q, closed.v])
        other = self.chart.moved()
        if other is None and np.abs(y[: y.size // 2]).max(initial=0.0) <= TURN:
            return y, self._last, False
        self._chart = other or self._chart
        return self._restart(), self._last, True

    def resume(self, whole: Array) -> Array:
        """Restart from assembled (q, v), (2n,), in the coordinates of ``here``; return y."""
        self._last = whole
        self._chart = Chart(self.here, whole[: self.n])
        return self._restart()

    def _restart(self) -> Array:
        """Return y of the last accepted state, which becomes the origin."""
        self._origin = self._last[: self.n].copy()
        return np.concatenate([np.zeros(self.chart.free.size), self._last[self.n + self.chart.free]])

    def derivative(self, t: float, y: Array) -> Array:
        """Evaluate y' of one state."""
        self.evaluated(t, y)
        closed, f = self._closed_state(t, y), y.size // 2
        slopes = np.empty_like(y)
        slopes[:f] = y[f:]
        slopes[f:] = self._accelerations(t, closed.q, closed.v, self._prescribed_accelerations(t))[self.chart.free]
        return slopes

    def trial(self, t: float, y: Array) -> Array:
        """Evaluate y' of one state, NaN where there is none, and where the loops do not close."""
        try:
            return super().trial(t, y)
        except LoopError as error:
            self._loop_error = error
            self.note(error, y)
            return np.full_like(y, np.nan)

    def jacobian(self, t: float, y: Array) -> Array:
        """Evaluate dy'/dy, (2f, 2f): the kernel's exact one, else finite differences in one batch."""
        self.counts["jacobians"] += 1
        if self.here.raw.has(self.here.forward_dynamics_jacobian):
            return self._exact_jacobian(t, y)
        steps = self._differences(y)
        slopes = self._derivatives(t, np.vstack([y, y + np.diag(steps)]))
        return np.asarray((slopes[1:] - slopes[0]).T / steps)

    def _exact_jacobian(self, t: float, y: Array) -> Array:
        """Evaluate dy'/dy from derivatives of constrained accelerations along the constraint's tangent space.

        Those of wrenches, and of drives without a method ``slopes``, are finite differences.
        """
        q, v, _, slopes = self._closed_state(t, y)
        u, f = self._loads(t, q, v), y.size // 2
        if self._prescribed_index:
            u[self._prescribed_index] = self._prescribed_accelerations(t)
        da_dq, da_dv, da_du = self.here.forward_dynamics_jacobian(q, v, u)
        basis, free = self.chart.tangent_basis(slopes), self.chart.free
        dv_dq = self._velocity_slopes(q, v, basis)
        jacobian = np.zeros((2 * f, 2 * f))
        jacobian[:f, f:] = np.eye(f)
        jacobian[f:, :f] = (da_dq @ basis + da_dv @ dv_dq)[free]
        jacobian[f:, f:] = (da_dv @ basis)[free]
        if self._drive is not None or self._wrench is not None:
            da_du[:, self._prescribed_index] = 0.0
            jacobian[f:] += da_du[free] @ self._load_slopes_along(t, y, (q, v), basis, dv_dq)
        return jacobian

    def _velocity_slopes(self, q: Array, v: Array, basis: Array) -> Array:
        """Differentiate all velocities, (n, f), by the independent coordinates at constant independent velocities.

        From J v = 0: J dv = -(dJ) v.  The right side is half of the change of the constraint's bias, which is quadratic
        in v, along the basis; dependent accelerations that balance this change are dv.
        """
        size = max(1.0, float(np.abs(v).max()))
        both = np.vstack([v + size * basis.T, v - size * basis.T])
        plus, minus = np.split(self.chart.follow(np.tile(q, (len(both), 1)), both, near=True).a, 2)
        return np.asarray((plus - minus).T / (4.0 * size))

    def _load_slopes_along(self, t: float, y: Array, state: tuple[Array, Array], basis: Array, dv_dq: Array) -> Array:
        """Differentiate drives and wrenches by y, (n, 2f), about its state."""
        exact, slopes = self._exact_slopes(), np.zeros((self.n, y.size))
        if exact is not None:
            du_dq, du_dv = exact(t, *state)
            slopes = np.hstack([du_dq @ basis + du_dv @ dv_dq, du_dv @ basis])
            if self._wrench is None:
                return slopes
        steps = self._differences(y)
        q, v, *_ = self._closed_states(np.full(y.size + 1, t), np.vstack([y, y + np.diag(steps)]))
        loads = self._loads(t, q, v, drives=exact is None)
        return np.asarray(slopes + (loads[1:] - loads[0]).T / steps)

    def _differences(self, y: Array) -> Array:
        """Return steps of finite differences, (2f,)."""
        f, size = y.size // 2, np.maximum(1.0, np.abs(y))
        return np.concatenate([Q_STEP * size[:f], rate_step(self.kernel) * size[f:]])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate actuator forces in a state, (n,): the drives, and forces of prescribed motions."""
        u = np.array(self.drives(t, q, v))
        if not self._prescribed_index:
            return u
        accelerations, n = self.prescribe(t, q, v), self.n
        solution = self._constrained(t, q[np.newaxis], v[np.newaxis], accelerations)[0]
        a, multipliers = solution[:n], solution[n : n + len(self.kernel.constraints)]
        needed = self.here.residual(q, v, a, np.zeros(n), wrench=self.wrench(t, q, v))
        needed -= self.here.functions.constraint_jacobian(q).T @ multipliers
        return np.where(self._free, u, needed)

    def _prescribed_forces(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Compute forces of prescribed motions, at their columns of (T, n), where u has their accelerations."""
        kernel, n, loads = self.here.replaced(checks=False), self.n, u
        if wrench is not None:
            loads = np.where(
                self._free, kernel.calls.arrays.beside_drives(u, kernel.functions.external_force(q, wrench)), u
            )
        solution = kernel.calls.run(self._function.name, None, (q, v, loads))
        a, multipliers = np.ascontiguousarray(solution[:, :n]), solution[:, n : n + len(kernel.constraints)]
        needed = kernel.residual(q, v, a, np.zeros(n), wrench=wrench)
        return np.asarray(needed - np.einsum("tmn,tm->tn", kernel.functions.constraint_jacobian(q), multipliers))

    def margins(self, q: Array) -> Array | None:
        """Return the ratio of J's smallest singular value within its rank to the greatest, at samples, (T,).

        Lengths are by the coordinates' kinetic energy; None of large mechanisms, where that would take long.
        """
        moving = np.flatnonzero(self._free)
        if len(self.kernel.constraints) * moving.size > LARGE or not self.chart.rank:
            return None
        inertia = inertias(self.here.mass_matrix(q))[:, np.newaxis, moving]
        scaled = self.here.functions.constraint_jacobian(q)[:, :, moving] / np.sqrt(inertia)
        sizes = np.linalg.svd(scaled, compute_uv=False)
        return np.asarray(sizes[:, self.chart.rank - 1] / np.maximum(sizes[:, 0], 1e-300))

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Return counts, the greatest |g| and |J v| over samples, (T, n), and the number of redundant constraints."""
        velocity_residuals = np.einsum("tmn,tn->tm", self.here.functions.constraint_jacobian(q), v)
        return {
            **super().about(q, v),
            "gap": float(np.abs(self.here.functions.constraint(q)).max()),
            "gap_rate": float(np.abs(velocity_residuals).max()),
            "redundant": float(len(self.kernel.constraints) - self.chart.rank),
        }

    def stopped(self, reason: str, t: float, y: Array, blame: Array | None = None) -> IntegrationStopped:
        """Return the error that says where a motion stopped, with the last assembled state."""
        seen = blame if blame is not None else self._stuck
        whole = None
        if seen is not None:
            whole = self._last.copy()
            whole[self._places] = seen
            whole[self.chart.free] += self._origin[self.chart.free]
        self._stuck = None
        if self._loop_error is not None:
            self.trouble = self._loop_error
            return super().stopped("the loops do not stay closed", t, self._last)
        return super().stopped(reason, t, self._last, whole)

    def _closed_state(self, t: float, y: Array) -> Followed:
        """Solve the dependent coordinates of y; return the assembled state."""
        chart, f = self.chart, y.size // 2
        q, v = chart.q.copy(), np.zeros(self.n)
        q[chart.free], v[chart.free] = y[:f] + self._origin[chart.free], y[f:]
        if self._prescribed_index:
            self.prescribe(t, q, v)
        try:
            return chart.follow(q, v)
        except ArrayError:
            for label, x in (("q", q), ("v", v)):
                self._refuse_not_finite(label, x, t)
            raise

    def _closed_states(self, times: Array, ys: Array) -> Followed:
        """Solve the dependent coordinates of many y, (N, size); return the assembled states."""
        chart, f = self.chart, ys.shape[1] // 2
        q, v = np.zeros((len(ys), self.n)), np.zeros((len(ys), self.n))
        q[:, chart.free], v[:, chart.free] = ys[:, :f] + self._origin[chart.free], ys[:, f:]
        if self._prescribed_index:
            for i, t in enumerate(times.tolist()):
                self.prescribe(t, q[i], v[i])
        for label, x in (("q", q), ("v", v)):
            self._refuse_not_finite(label, x, float(times[0]))
        return chart.follow(q, v)

    def _prescribed_accelerations(self, t: float) -> Array | None:
        """Return accelerations of the prescribed coordinates, (m,); None without any."""
        return self.prescribe(t, np.zeros(self.n), np.zeros(self.n)) if self._prescribed_index else None

    def _derivatives(self, t: float, ys: Array) -> Array:
        """Evaluate y' of states at one time, (N, size)."""
        q, v, *_ = self._closed_states(np.full(len(ys), t), ys)
        a = self._constrained(t, q, v, self._prescribed_accelerations(t))[:, : self.n]
        self._refuse_not_finite("acceleration", a, t)
        free = self.chart.free
        return np.hstack([v[:, free], a[:, free]])

    def _accelerations(self, t: float, q: Array, v: Array, prescribed: Array | None) -> Array:
        """Evaluate accelerations of one assembled state, (n,)."""
        u = self._loads(t, q, v)
        if prescribed is not None:
            u[self._prescribed_index] = prescribed
        calls, solution = self.here.calls, np.empty(self._size)
        if calls.call(self._function, (q, v, u), (), (), None, solution) >= 0:
            return calls.run(self._function.name, None, (q, v, u))[: self.n]  # which says what is wrong
        a = solution[: self.n]
        self._refuse_not_finite("acceleration", a, t)
        return a

    def _constrained(self, t: float, q: Array, v: Array, prescribed: Array | None) -> Array:
        """Evaluate accelerations, multipliers and residuals of assembled states at one time, (N, n + 3 m)."""
        u = self._loads(t, q, v)
        if prescribed is not None:
            u[:, self._prescribed_index] = prescribed
        return self.here.calls.run(self._function.name, None, (q, v, u))

    def _loads(self, t: float, q: Array, v: Array, *, drives: bool = True) -> Array:
        """Sum the forces of drives and wrenches, (n,) or (N, n), N or N m; of wrenches alone without ``drives``."""
        u = np.array(self.drives(t, q, v)) if drives else np.zeros(q.shape)
        wrench = self._wrenches(t, q, v)
        if wrench is not None:
            u = self.here.calls.arrays.beside_drives(u, self.here.functions.external_force(q, wrench))
        return u

    def _wrenches(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """Evaluate external wrenches in a state, or in states at one time: for all of them or for each."""
        if q.ndim == 1 or not callable(self._wrench):
            return self.wrench(t, q, v)
        return np.array([self.wrench(t, *state) for state in zip(q, v, strict=True)])
