"""The equations of motion of mechanisms with closed loops, in coordinates that keep them closed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..errors import ArrayError, IntegrationStopped, LoopError
from ..kernel.complete import Kernel
from ..loops.chart import Chart, Followed
from ..runtime.loop_errors import left_open
from ..runtime.singular import inertias
from ..state.drives import acceleration_slopes, places_of_forces
from ..state.springs import rate_step
from ..state.vectors import Q_STEP
from .system import System

TURN = 2.0 * np.pi  # rad, or m: how far y goes from its origin
LARGE = 2500  # entries of J: of more no singular values are looked at in every sample
OPEN = 1e-9  # m or rad, and per second and the largest velocity: more is not round-off


class ClosedSystem(System):
    """Equations of motion with loop forces, y = (independent coordinates less an origin, their velocities, z).

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
        self._last = np.zeros(self.size)  # the state that was reached
        self._function = kernel.raw.writing("constrained")

    @property
    def chart(self) -> Chart:
        """The choice of independent coordinates; there is one once the motion has begun."""
        assert self._chart is not None
        return self._chart

    @property
    def index(self) -> Index:
        """Places of y in (q, v, z)."""
        return self._places

    @property
    def _places(self) -> Index:
        return np.concatenate([self.chart.free, self.n + self.chart.free, np.arange(2 * self.n, self.size)])

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """Return y of the initial state, assembled to the last digit; LoopError if constraints are violated."""
        self.prescribe(t, q, v)
        kernel = self.here
        velocities = v[: self.n]
        residuals, rows = kernel.functions.constraint(q), kernel.functions.constraint_jacobian(q)
        velocity_residuals = rows @ velocities
        if np.abs(residuals).max() > OPEN:
            raise left_open(kernel.raw, residuals, "is open", "q of kernel.assemble")
        if np.abs(velocity_residuals).max() > OPEN * max(1.0, float(np.abs(velocities).max())):
            raise left_open(kernel.raw, velocity_residuals, "is opening", "v of kernel.project_velocity", "/s")
        y, self._last, _ = ClosedSystem.accept(self, t, self.resume(np.concatenate([q, v])))
        q[:], v[:] = self._last[: self.n], self._last[self.n :]
        return y

    def expand(self, times: Array, ys: Array) -> Array:
        """Expand reduced states y, (N, k), at times, (N,), to assembled (q, v, z), (N, size)."""
        return np.hstack([*self._closed_states(times, ys)[:2], self._states_of(ys)])

    def accept(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """Accept a step that led to t: return the next y, (q, v, z), and whether y restarts; LoopError if open."""
        closed = self._closed_state(t, y)
        self.chart.use(closed.q, closed.slopes)
        self._loop_error = None
        self._last = np.concatenate([closed.q, closed.v, self._states_of(y)])
        other = self.chart.moved()
        if other is None and np.abs(y[: self.chart.free.size]).max(initial=0.0) <= TURN:
            return y, self._last, False
        self._chart = other or self._chart
        return self._restart(), self._last, True

    def resume(self, whole: Array) -> Array:
        """Restart from assembled (q, v, z), (size,), in the coordinates of ``here``; return y."""
        self._last = whole
        self._chart = Chart(self.here, whole[: self.n])
        return self._restart()

    def _restart(self) -> Array:
        """Return y of the last accepted state, which becomes the origin."""
        self._origin = self._last[: self.n].copy()
        free = self.chart.free
        return np.concatenate([np.zeros(free.size), self._last[self.n + free], self._last[2 * self.n :]])

    def _states_of(self, ys: Array) -> Array:
        """Return the internal states of y, (..., m), which stand behind velocities."""
        return ys[..., 2 * self.chart.free.size :]

    def derivative(self, t: float, y: Array) -> Array:
        """Evaluate y' of one state."""
        self.evaluated(t, y)
        closed, f = self._closed_state(t, y), self.chart.free.size
        rates = np.append(closed.v, self._states_of(y))
        slopes = np.empty_like(y)
        slopes[:f] = y[f : 2 * f]
        slopes[f:] = self._accelerations(t, closed.q, rates, self._prescribed_accelerations(t))[self._free_places]
        return slopes

    @property
    def _free_places(self) -> Index:
        """Places among rates of those of y: of independent coordinates, then of internal states."""
        return np.append(self.chart.free, np.arange(self.n, self.size - self.n))

    def trial(self, t: float, y: Array) -> Array:
        """Evaluate y' of one state, NaN where there is none, and where the loops do not close."""
        try:
            return super().trial(t, y)
        except LoopError as error:
            self._loop_error = error
            self.note(error, y)
            return np.full_like(y, np.nan)

    def jacobian(self, t: float, y: Array) -> Array:
        """Evaluate dy'/dy: the kernel's exact one, else finite differences in one batch."""
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
        n, f, rates = self.n, self.chart.free.size, np.append(v, self._states_of(y))
        u, forces = self._loads(t, q, rates)
        if self._prescribed_index:
            u[self._prescribed_index] = self._prescribed_accelerations(t)
        da_dq, da_dv, da_du = acceleration_slopes(self.here, q, rates, u, forces)
        basis, places = self.chart.tangent_basis(slopes), self._free_places
        dv_dq = self._velocity_slopes(q, v, basis)
        jacobian = np.zeros((y.size, y.size))
        jacobian[:f, f : 2 * f] = np.eye(f)
        jacobian[f:, :f] = (da_dq[:, :n] @ basis + da_dv[:, :n] @ dv_dq)[places]
        jacobian[f:, f : 2 * f] = (da_dv[:, :n] @ basis)[places]
        jacobian[f:, 2 * f :] = da_dv[places, n:]
        if self._drive is not None or self._wrench is not None:
            da_du[:, self._prescribed_index] = 0.0
            jacobian[f:] += da_du[places] @ self._load_slopes_along(t, y, (q, rates), basis, dv_dq)
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
        """Differentiate drives and wrenches by y about its state, rows as of ``_load_slopes``."""
        exact, slopes = self._exact_slopes(), np.zeros((self.size - self.n, y.size))
        if exact is not None:
            du_dq, du_dv = exact(t, state[0], self.apart(state[1])[0])
            along = np.hstack([du_dq @ basis + du_dv @ dv_dq, du_dv @ basis])
            slopes[: self.n, : along.shape[1]] = along
            if self._wrench is None:
                return slopes
        steps, ys = self._differences(y), y + np.vstack([np.zeros_like(y), np.diag(self._differences(y))])
        q, v, *_ = self._closed_states(np.full(len(ys), t), ys)
        u, forces = self._loads(t, q, np.hstack([v, self._states_of(ys)]), drives=exact is None)
        slopes[: self.n] += (u[1:] - u[0]).T / steps
        if forces is not None:
            places = [place for i, place in enumerate(places_of_forces(self.here)) if place != i]
            slopes[places] += (forces[1:] - forces[0]).T / steps
        return slopes

    def _differences(self, y: Array) -> Array:
        """Return steps of finite differences of y."""
        f, size = self.chart.free.size, np.maximum(1.0, np.abs(y))
        return np.concatenate([Q_STEP * size[:f], rate_step(self.kernel) * size[f:]])

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate actuator forces in a state, (n,): the drives, and forces of prescribed motions."""
        u = np.array(self.drives(t, q, v))
        if not self._prescribed_index:
            return u
        accelerations, n = self.prescribe(t, q, v), self.n
        solution = self._constrained(t, q[np.newaxis], v[np.newaxis], accelerations)[0]
        a, multipliers = solution[:n], self._multipliers(solution)
        velocities, z = self.apart(v)
        needed = self.here.residual(q, velocities, a, np.zeros(n), z=z, wrench=self.wrench(t, q, v))
        needed -= self.here.functions.constraint_jacobian(q).T @ multipliers
        return np.where(self._free, u, needed)

    def _prescribed_forces(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Compute forces of prescribed motions, at their columns of (T, n), where u has their accelerations."""
        kernel, loads, forces = self.here.replaced(checks=False), u, None
        if wrench is not None:
            loads, forces = kernel.calls.arrays.beside_drives(u, kernel.functions.external_force(q, wrench))
            loads = np.where(self._free, loads, u)
        v, z = self.apart(v)
        values = kernel.calls.arguments(self._function.name, (q, v, loads), z, forces)
        solution = kernel.calls.run(self._function.name, None, values)
        a, multipliers = np.ascontiguousarray(solution[:, : self.n]), self._multipliers(solution)
        needed = kernel.residual(q, v, a, np.zeros(self.n), z=z, wrench=wrench)
        return np.asarray(needed - np.einsum("tmn,tm->tn", kernel.functions.constraint_jacobian(q), multipliers))

    def _multipliers(self, solution: Array) -> Array:
        """Return multipliers of solutions of constrained dynamics, (..., constraints)."""
        rates = self.kernel.calls.rates
        return solution[..., rates : rates + len(self.kernel.constraints)]

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
        chart, f = self.chart, self.chart.free.size
        q, v = chart.q.copy(), np.zeros(self.n)
        q[chart.free], v[chart.free] = y[:f] + self._origin[chart.free], y[f : 2 * f]
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
        chart, f = self.chart, self.chart.free.size
        q, v = np.zeros((len(ys), self.n)), np.zeros((len(ys), self.n))
        q[:, chart.free], v[:, chart.free] = ys[:, :f] + self._origin[chart.free], ys[:, f : 2 * f]
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
        """Evaluate y' of states at one time, (N, k)."""
        q, v, *_ = self._closed_states(np.full(len(ys), t), ys)
        rates = np.hstack([v, self._states_of(ys)])
        a = self._constrained(t, q, rates, self._prescribed_accelerations(t))[:, : self.kernel.calls.rates]
        self._refuse_not_finite("acceleration", a, t)
        return np.hstack([v[:, self.chart.free], a[:, self._free_places]])

    def _accelerations(self, t: float, q: Array, v: Array, prescribed: Array | None) -> Array:
        """Evaluate accelerations of one assembled state, (n,), then rates of internal states."""
        u, forces = self._loads(t, q, v)
        if prescribed is not None:
            u[self._prescribed_index] = prescribed
        calls, solution = self.here.calls, np.empty(self.here.raw.shapes[self._function.writes])
        values, rates = self._arguments(q, v, u, forces), self.kernel.calls.rates
        if calls.call(self._function, values, (), (), None, solution) >= 0:
            return calls.run(self._function.name, None, values)[:rates]  # which says what is wrong
        a = solution[:rates]
        self._refuse_not_finite("acceleration", a, t)
        return a

    def _constrained(self, t: float, q: Array, v: Array, prescribed: Array | None) -> Array:
        """Evaluate rates, multipliers and residuals of assembled states at one time, (N, k)."""
        u, forces = self._loads(t, q, v)
        if prescribed is not None:
            u[:, self._prescribed_index] = prescribed
        return self.here.calls.run(self._function.name, None, self._arguments(q, v, u, forces))

    def _arguments(self, q: Array, v: Array, u: Array, forces: Array | None) -> list[Array]:
        """Return the arguments of constrained dynamics in the order of the C."""
        velocities, z = self.apart(v)
        values = self.here.calls.arguments(self._function.name, (q, velocities, u), z, forces)
        return [np.asarray(x) for x in values]

    def _loads(self, t: float, q: Array, v: Array, *, drives: bool = True) -> tuple[Array, Array | None]:
        """Return drives with forces of wrenches, (..., n), N or N m, and of these what acts beside drives with states.

        Without ``drives`` they are of wrenches alone.
        """
        u = np.array(self.drives(t, q, v)) if drives else np.zeros(q.shape)
        wrench = self._wrenches(t, q, v)
        if wrench is None:
            return u, None
        return self.here.calls.arrays.beside_drives(u, self.here.functions.external_force(q, wrench))

    def _wrenches(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """Evaluate external wrenches in a state, or in states at one time: for all of them or for each."""
        if q.ndim == 1 or not callable(self._wrench):
            return self.wrench(t, q, v)
        return np.array([self.wrench(t, *state) for state in zip(q, v, strict=True)])
