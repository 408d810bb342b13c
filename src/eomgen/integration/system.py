"""A kernel's equations of motion as a system of first order, with drives, wrenches and prescribed motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..errors import ArrayError, InputError, IntegrationError, IntegrationStopped, SingularError
from ..kernel.complete import Kernel
from ..kernel.stepping.motions import SingleMotion
from ..kernel.stepping.packed_inputs import PackedInputs
from ..kernel.stepping.reading_inputs import NamedWrenches
from ..runtime.arrays import numbers_in
from ..runtime.bound import WrenchLike, with_wrench, wrench_rows
from ..runtime.internal_states import cut_apart
from ..runtime.raw import name_of
from ..state.drives import acceleration_slopes, drive_jacobian, has_drives, is_of_drive, places_of_forces
from ..state.springs import rate_sizes, rate_step, smoothings
from ..state.vectors import Q_STEP, DriveFunction, MotionFunction, WrenchFunction, prescribed_mask

MANY = 4096  # states of which forces are looked at together
WORK = 10_000  # evaluations between two looks: a hundred times what a jump or an impact takes
LEAST = 1e-7  # of the span by which they lead on; with less all of it would take 1e11 of them, that is weeks


class Advance:
    """Watches the times at which the equations of motion are evaluated, whatever method asks for them.

    A method evaluates at the time that it has reached and ahead of it, so that the earliest of many evaluations is
    where it stood.  How large states, velocities and forces are does not matter: they may be right.  What is judged is
    ``WORK`` evaluations that lead on by less than ``LEAST`` of the span.  Stiff motions and series of impacts stay far
    from that: an impact of 1 us in a motion of 1000 s is 1e-9 of it and takes some hundred evaluations.

    Args:
        first, last: times of the span, s.
    """

    def __init__(self, first: float, last: float) -> None:
        self.first, self.last = first, last
        self._calls, self._earliest, self._before = 0, np.inf, -np.inf

    def look(self, t: float) -> None:
        """Note an evaluation at t, s.

        Raises:
            IntegrationError: there is hardly any progress.
        """
        self._calls += 1
        self._earliest = min(self._earliest, t)
        if self._calls < WORK:
            return
        led, least = self._earliest - self._before, LEAST * (self.last - self.first)
        if not led >= least:
            left = self.last - self._earliest
            raise IntegrationError(
                f"{WORK} evaluations led on by {max(led, 0.0):.3g} s, and {left:.6g} s are left; is a force, a rate or"
                " a stiffness too large? allowed: smaller ones, an implicit method for stiff springs, or a shorter"
                " duration"
            )
        self._calls, self._earliest, self._before = 0, np.inf, self._earliest


def concerns_state(error: Exception) -> bool:
    """Return whether a shorter step may avoid an error: the state is not finite, or its mass matrix is singular."""
    return not isinstance(error, InputError) or isinstance(error, (ArrayError, SingularError))


def _numbers(label: str, value: ArrayLike, t: float, shape: tuple[int, ...]) -> Array:
    """Return what a function of the user returned at a time as an array of float64, of whatever shape.

    Raises:
        ArrayError: it is no array of numbers; says which shape is expected.
    """
    if type(value) is np.ndarray and value.dtype == np.float64:  # in every evaluation
        return value
    return numbers_in(f"{label} at t = {t:.6g} s", value, f"numbers of shape {shape}", finite=False)


class System:
    """The equations of motion as y' = f(t, y), y = (q, v, z) or some of it, with their Jacobian; counts its calls.

    Internal states z stand behind velocities: an argument ``v`` of methods is (n + m,), where loads get (n,).

    Whatever ``kernel.checks`` says, a drive, wrench, prescribed motion, state or acceleration that is not finite is an
    ArrayError that names it.  With ``advance`` evaluations that lead nowhere are an IntegrationError.

    Attributes:
        here: the kernel in whose coordinates y is (others than ``kernel``'s after a switch of charts).
        loaded: the time-signal inputs, if C integrated with them.
        worked: the motion in C that integrates work integrals, if one does.
        works_at_end: work integrals of such a motion that ended before its last sample, (4,), J.
        n, size: number of coordinates, and of (q, v, z).
        tolerance_share: factor of tolerances for y, below 1 where y is some of the state.
    """

    tolerance_share = 1.0

    def __init__(
        self,
        kernel: Kernel,
        drive: DriveFunction | None,
        wrench: WrenchFunction | WrenchLike | None,
        prescribed: MotionFunction | None = None,
    ) -> None:
        if kernel.dtype != np.float64:
            raise InputError(f"integration needs a float64 kernel; {kernel.name} is {kernel.dtype}")
        self.kernel, self.n, self.size = kernel, kernel.n, kernel.n + kernel.calls.rates
        self.here = kernel
        self._drive = drive
        self._prescribed = prescribed
        self._prescribed_index = [kernel.coordinates.index(name) for name in kernel.prescribed]
        self._free = ~prescribed_mask(kernel)
        self._free_rates = np.append(self._free, np.ones(len(kernel.internal_states), np.bool_))
        if self._prescribed_index and prescribed is None:
            raise InputError(f"prescribed: the motion of {', '.join(kernel.prescribed)} is missing")
        if prescribed is not None and not self._prescribed_index:
            raise InputError(f"prescribed: {kernel.name} has no prescribed coordinate")
        self._batched = bool(getattr(drive, "batched", False))
        if isinstance(wrench, Mapping):
            wrench = NamedWrenches(kernel.calls, wrench)
        self._wrench = wrench
        if wrench is not None and not callable(wrench):
            rows = len(kernel.links), 6
            numbers = numbers_in("wrench", wrench, f"numbers of shape {rows}, or by frame or link", finite=False)
            if numbers.shape == rows:  # another shape is the kernel's to refuse
                kernel.calls.arrays.refuse_not_finite("wrench", numbers, rows)
        self._no_drive = np.zeros(self.n)
        self.counts: dict[str, float] = {"steps": 0, "evaluations": 0, "jacobians": 0}
        self.trouble: Exception | None = None
        self.loaded: PackedInputs | None = None
        self.worked: SingleMotion | None = None
        self.works_at_end: Array | None = None
        self.advance: Advance | None = None
        self._stuck: Array | None = None  # where evaluations lead nowhere

    @property
    def loads(self) -> tuple[DriveFunction | None, WrenchFunction | WrenchLike | None, MotionFunction | None]:
        """Drive, wrench and motion of the prescribed coordinates, as passed to the constructor."""
        return self._drive, self._wrench, self._prescribed

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """Return y of the initial state, q and v; corrects these in place where loops or charts need it."""
        return np.concatenate([q, v])

    @property
    def index(self) -> Index:
        """Places of y in (q, v, z)."""
        return np.arange(self.size)

    def resume(self, whole: Array) -> Array:
        """Restart from (q, v, z), (size,), in the coordinates of ``here``; return y."""
        return whole

    def described(self, whole: Array) -> Array:
        """Convert states (q, v, z), (N, size), from the coordinates of ``here`` to those of the description."""
        return whole

    def expand(self, times: Array, ys: Array) -> Array:
        """Expand reduced states y, (N, k), at times, (N,), to (q, v, z), (N, size)."""
        return ys

    def accept(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """Accept a step that led to t: return the next y, (q, v, z), and whether the chart changed."""
        return y, y, False

    def margins(self, q: Array) -> Array | None:
        """Return distances of samples, (T, n), from singular poses, (T,); None without loops."""
        return None

    def chart_events(self, y: Array) -> Array:
        """Evaluate event functions whose zeros are chart switches, (k,)."""
        return np.zeros(0)

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Return counts of calls, and more figures of the motion with samples q and v, (T, n)."""
        known = smoothings(self.kernel)
        return self.counts | ({"friction_smoothing": max(known.values())} if known else {})

    def prescribe(self, t: float, q: Array, v: Array) -> Array:
        """Write q and v of prescribed coordinates into a state's arrays; return their accelerations, (m,)."""
        if self._prescribed is None:
            return np.zeros(0)
        motion = [_numbers("prescribed", x, t, (len(self._prescribed_index),)) for x in self._prescribed(t)]
        if [x.shape for x in motion] != [(len(self._prescribed_index),)] * 3 or not np.isfinite(motion).all():
            bad = np.argwhere(~np.isfinite(motion)) if len({x.shape for x in motion}) == 1 else np.zeros((0, 2), int)
            raise ArrayError(
                f"prescribed: expected three arrays of {len(self._prescribed_index)} finite numbers at"
                f" t = {t:.6g} s, got {', '.join(str(x) for x in motion)}",
                self.kernel.prescribed[bad[0][-1] % len(self._prescribed_index)] if bad.size else "",
            )
        q[self._prescribed_index], v[self._prescribed_index] = motion[:2]
        return motion[2]

    def apart(self, rates: Array) -> tuple[Array, Array | None]:
        """Return velocities, (..., n), and internal states, which stand behind them; None without such."""
        return cut_apart(rates, self.n) if self.kernel.internal_states else (rates, None)

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate actuator forces in a state, (n,): the drives, and forces of prescribed motions."""
        u = np.array(self.drives(t, q, v))
        if self._prescribed_index:
            u[self._prescribed_index] = self.prescribe(t, q, v)
            (velocities, z), wrench = self.apart(v), self.wrench(t, q, v)
            a = self.here.forward_dynamics(q, velocities, u, z, wrench=wrench)
            needed = self.here.inverse_dynamics(q, velocities, a, z=z, wrench=wrench, cut=True)
            u[self._prescribed_index] = needed[self._prescribed_index]
        return u

    def forces_over(self, times: Array, q: Array, v: Array) -> tuple[Array, ArrayError | None]:
        """Evaluate u at times as far as it is finite, (k, n), and why no further; writes prescribed motions into q, v.

        Args:
            times: s, (T,).
            q, v: states, (T, n).
        """
        if self.loaded is not None:
            return self._loaded_forces(times, q, v)
        u = np.empty_like(q)
        for i, t in enumerate(times.tolist()):
            try:
                self.prescribe(t, q[i], v[i])
                u[i] = self.forces(t, q[i], v[i])
            except ArrayError as error:
                return u[:i], error
        return u, None

    def works_until(self, count: int) -> Array | None:
        """Return work integrals at the first ``count`` samples, (count, 4), J; None where they are not integrated."""
        if self.worked is None:
            return None
        works = self.worked.works_until(count)
        if self.works_at_end is not None:
            works[-1] = self.works_at_end
        return works

    def _loaded_forces(self, times: Array, q: Array, v: Array) -> tuple[Array, ArrayError | None]:
        """Evaluate ``forces_over`` from time-signal inputs."""
        assert self.loaded is not None
        u = np.ascontiguousarray(self.loaded.drives(times, q, v)[:, : self.n])
        if self._prescribed_index:
            wrench = self._wrench
            if callable(wrench):
                each = zip(times.tolist(), q, v, strict=True)
                pulls = ((q, wrench(t, q, v[: self.n])) for t, q, v in each)
                wrench = np.array([wrench_rows(self.kernel.calls, *pull) for pull in pulls])
            for first in range(0, len(u), MANY):
                rows = slice(first, first + MANY)
                pull = wrench if wrench is None or np.ndim(wrench) < 3 else np.asarray(wrench)[rows]
                u[rows, self._prescribed_index] = self._prescribed_forces(q[rows], v[rows], u[rows], pull)[
                    :, self._prescribed_index
                ]
        for i in np.flatnonzero(~np.isfinite(u).all(axis=1))[:1].tolist():
            try:
                self._refuse_not_finite("drive", u[i], float(times[i]))
            except ArrayError as error:
                return u[:i], error
        return u, None

    def _prescribed_forces(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Compute forces of prescribed motions, at their columns of (T, n), where u has their accelerations."""
        kernel, (v, z) = self.here.replaced(checks=False), self.apart(v)
        a = kernel.forward_dynamics(q, v, u, z, wrench=wrench)
        return np.asarray(kernel.inverse_dynamics(q, v, a, z=z, wrench=wrench, cut=True))

    def drives(self, t: float, q: Array, v: Array) -> Array:
        """Evaluate the drives in one state, (n,), or a batch, (N, n)."""
        if self._drive is None:
            return self._no_drive if q.ndim == 1 else np.zeros_like(q)
        if q.ndim == 2 and not self._batched:
            return np.array([self.drives(t, *state) for state in zip(q, v, strict=True)])
        u = _numbers("drive", self._drive(t, q, self.apart(v)[0]), t, q.shape)
        if u.shape != q.shape:
            raise ArrayError(f"drive: expected forces of shape {q.shape}, got shape {u.shape} at t = {t:.6g} s")
        self._refuse_not_finite("drive", u, t)
        return u

    def wrench(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """Evaluate external wrenches in one state, (links, 6)."""
        if not callable(self._wrench):
            return self._wrench
        wrench = wrench_rows(self.kernel.calls, q, self._wrench(t, q, self.apart(v)[0]))
        if wrench is None:
            return None
        rows = len(self.kernel.links), 6
        numbers = _numbers("wrench", wrench, t, rows)
        if numbers.shape[-2:] == rows:  # another shape is the kernel's to refuse
            self._refuse_not_finite("wrench", numbers, t)
        return numbers

    def _refuse_not_finite(self, label: str, values: Array, t: float) -> None:
        """Raise ArrayError where one of the values, (n,), (N, n) or wrenches, is not finite."""
        if not np.isfinite(values).all():
            shape = (len(self.kernel.links), 6) if label == "wrench" else values.shape[-1:]
            self.kernel.calls.arrays.refuse_not_finite(label, values, shape, f" at t = {t:.6g} s")

    def evaluated(self, t: float, y: Array) -> None:
        """Count an evaluation at t, s, and y; IntegrationError where evaluations lead nowhere."""
        self.counts["evaluations"] += 1
        try:
            if self.advance is not None:
                self.advance.look(t)
        except IntegrationError:
            self._stuck = y.copy()
            raise

    def derivative(self, t: float, y: Array) -> Array:
        """y' of one state."""
        self.evaluated(t, y)
        q, v = y[: self.n], y[self.n :]
        result = np.empty_like(y)
        self._refuse_not_finite("q", q, t)
        self._refuse_not_finite("v", v, t)
        if self._prescribed_index:
            q, v = q.copy(), v.copy()
            a = self.prescribe(t, q, v)
        u, wrench = self.drives(t, q, v), self.wrench(t, q, v)
        if self._prescribed_index:
            u = np.array(u)
            u[self._prescribed_index] = a
        result[: self.n] = v[: self.n]
        if self.kernel.internal_states:
            (v, z), calls, name = self.apart(v), self.here.calls, name_of(self.here.forward_dynamics)
            values, forces = ((q, v, u), None) if wrench is None else with_wrench(calls, name, (q, v, u), wrench)
            calls.run(name, result[self.n :], calls.arguments(name, values, z, forces), whole=True)
        else:
            self.here.forward_dynamics(q, v, u, wrench=wrench, out=result[self.n :])
        self._refuse_not_finite("acceleration", result[self.n :], t)
        return result

    def trial(self, t: float, y: Array) -> Array:
        """Evaluate y' of one state, NaN where there is none: a method with step control then takes a shorter step."""
        try:
            return self.derivative(t, y)
        except (ValueError, ArithmeticError) as error:
            if not concerns_state(error):
                raise
            self.note(error, y)
            return np.full_like(y, np.nan)

    def note(self, error: Exception, y: Array) -> None:
        """Keep what went wrong at y; where y is not finite itself, what made it so remains to blame."""
        if self.trouble is None or np.isfinite(y).all():
            self.trouble = error

    def jacobian(self, t: float, y: Array) -> Array:
        """Evaluate dy'/dy, (size, size): M da = -d(residual) at constant a.

        Without residual_jacobian the kernel's derivatives of accelerations count.  They are not the first choice,
        since compilers take 1.4 times as long for them, 5 s more for 36 coordinates, and one takes 0.04 ms less.
        """
        self.counts["jacobians"] += 1
        n, y = self.n, y.copy()
        prescribed = self.prescribe(t, y[:n], y[n:])
        jacobian = np.zeros((self.size, self.size))
        jacobian[:n, n : 2 * n] = np.eye(n)
        free = self._free_rates
        has, here = self.here.raw.has, self.here
        if has(here.forward_dynamics_jacobian) and not has(here.residual_jacobian):
            jacobian[n:] = self._acceleration_slopes(t, y[:n], y[n:], prescribed)
        else:
            dtau_dq, dtau_dv, M = self._slopes(t, y[:n], y[n:], self.derivative(t, y)[n:])
            jacobian[n:][free] = -np.linalg.solve(M[np.ix_(free, free)], np.hstack([dtau_dq, dtau_dv])[free])
        jacobian[:, ~np.append(self._free, free)] = 0.0  # what is prescribed depends on time alone
        return jacobian

    def _acceleration_slopes(self, t: float, q: Array, v: Array, prescribed: Array) -> Array:
        """Differentiate rates by (q, v, z), (n + m, size); ``prescribed`` are accelerations of such coordinates."""
        u, forces = np.array(self.drives(t, q, v)), None
        wrench = self.wrench(t, q, v)
        if wrench is not None:
            u, forces = self.here.calls.arrays.beside_drives(u, self.here.functions.external_force(q, wrench))
        u[self._prescribed_index] = prescribed
        da_dq, da_dv, da_du = acceleration_slopes(self.here, q, v, u, forces)
        slopes, loads = np.hstack([da_dq[:, : self.n], da_dv]), self._load_slopes(t, q, v)
        return np.asarray(slopes if loads is None else slopes + da_du[:, self._free_rates] @ loads[self._free_rates])

    def residual(self, t: float, y: Array, slopes: Array) -> Array:
        """Evaluate F(t, y, y'), (size,): q' - v, the residual of the equations of motion at a = v', and z' less its
        value.
        """
        self.evaluated(t, y)
        n, y = self.n, y.copy()
        q, v, a = y[:n], y[n:], slopes[n:].copy()
        prescribed = self.prescribe(t, q, v)
        wrench = self.wrench(t, q, v)
        u = self.drives(t, q, v)
        v, z = self.apart(v)
        a, states = a[:n], a[n:]
        if has_drives(self.here):
            left = self.here.residual(q, v, a, u, z=z, wrench=wrench)
        else:
            left = self.here.inverse_dynamics(q, v, a, z=z, wrench=wrench, cut=True) - u
        rest = states if z is None else states - self.here.internal_state_derivatives(q, v, z, u)
        residuals = np.concatenate([slopes[:n] - v, left, rest])
        if self._prescribed_index:
            residuals[n:][self._prescribed_index] = a[self._prescribed_index] - prescribed
        self._refuse_not_finite("velocity residual", residuals[:n], t)
        self._refuse_not_finite("residual", residuals[n:], t)
        return residuals

    def residual_jacobian(self, t: float, y: Array, slopes: Array, c: float) -> Array:
        """Evaluate dF/dy + c dF/dy', (size, size)."""
        self.counts["jacobians"] += 1
        n, y = self.n, y.copy()
        self.prescribe(t, y[:n], y[n:])
        dtau_dq, dtau_dv, M = self._slopes(t, y[:n], y[n:], slopes[n:].copy())
        inertias = np.append(np.ones(n), np.diagonal(M)[n:])[:, np.newaxis]  # of internal states: F has their rates
        rates = np.eye(n, self.size - n)
        jacobian = np.block([[c * np.eye(n), -rates], [dtau_dq / inertias, (dtau_dv + c * M) / inertias]])
        fixed = np.flatnonzero(~self._free)
        jacobian[:, np.concatenate([fixed, n + fixed])] = 0.0
        jacobian[n + fixed] = 0.0
        jacobian[fixed, fixed] = jacobian[n + fixed, n + fixed] = c
        jacobian[n:, n + fixed] += np.where(self._free_rates[:, None], c * M[:, fixed], 0.0)
        return jacobian

    def _slopes(self, t: float, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Differentiate inverse dynamics less drives and wrenches by q and by v and z at constant a; and M.

        Rows are those of coordinates, then of rates of internal states, whose inertias M has.  The kernel's exact ones
        where it has them, else finite differences of a batch of inverse dynamics.
        """
        n, kernel = self.n, self.here
        if kernel.raw.has(kernel.residual_jacobian):
            velocities, z = self.apart(v)
            values = (q, velocities, a[:n])
            by_q, by_v, M = kernel.calls.run(kernel.residual_jacobian, None, values, z=z, whole=True)
            slopes = np.hstack([by_q[:, :n], by_v])
        else:
            slopes, M = self._differences_of_forces(q, v, a)
        loads = self._load_slopes(t, q, v)
        if has_drives(kernel):
            by_q, by_v, by_u = drive_jacobian(kernel, q, v, np.array(self.drives(t, q, v)))
            slopes = slopes - np.hstack([by_q[:, :n], by_v])
            loads = None if loads is None else by_u @ loads
        if loads is not None:
            slopes = slopes - loads
        return slopes[:, :n], slopes[:, n:], M

    def _differences_of_forces(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Differentiate inverse dynamics and, with the sign of a residual, rates of states that are of no drive."""
        n, kernel = self.n, self.here
        qs, vs, steps = self._beside(q, v)
        velocities, z = self.apart(vs)
        forces = kernel.inverse_dynamics(qs, velocities, a[:n], z=z, cut=True)
        M = kernel.mass_matrix(q)
        if z is not None:
            own = np.array([not is_of_drive(name) for name in kernel.internal_states])
            rates = np.where(own, kernel.internal_state_derivatives(qs, velocities, z), 0.0)
            forces = np.hstack([forces, -rates])
            M = np.block([[M, np.zeros((n, own.size))], [np.zeros((own.size, n)), np.eye(own.size)]])
        return np.asarray((forces[1:] - forces[0]).T / steps), M

    def _beside(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return a state and its perturbations, q and v, a row more than there are numbers, and the steps, (size,).

        Steps of velocities allow for the smoothing of friction.
        """
        n, kernel = self.n, self.here
        steps = np.concatenate([Q_STEP * np.maximum(1.0, np.abs(q)), rate_step(kernel) * np.maximum(1.0, np.abs(v))])
        states = np.tile(np.concatenate([q, v]), (self.size + 1, 1))
        states[np.arange(1, self.size + 1), np.arange(self.size)] += steps
        return np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:]), steps

    def _load_slopes(self, t: float, q: Array, v: Array) -> Array | None:
        """Differentiate drives and wrenches by (q, v, z), (n + m, size); None without any.

        Rows are columns of derivatives by u: those of forces beside drives with states are at their first states.

        Finite differences, of drives unless they have a method ``slopes``.  Wrenches that turn a link have exact ones,
        too, in a separate kernel; a compiler takes 0.5 s for it with one joint and 1 s with 36 coordinates, and a
        batch of one state per coordinate takes 0.01 ms.
        """
        n, wrench, exact = self.n, self.wrench(t, q, v), self._exact_slopes()
        if wrench is None and self._drive is None:
            return None
        slopes = np.zeros((self.size - n, self.size))
        if exact is not None:
            slopes[:n, : 2 * n] = np.hstack(exact(t, q, self.apart(v)[0]))
            if wrench is None:
                return slopes
        qs, vs, steps = self._beside(q, v)
        if exact is None and self._drive is not None:
            drives = self.drives(t, qs, vs)
            slopes[:n] = (drives[1:] - drives[0]).T / steps
        if wrench is not None:
            forces = self.here.functions.external_force(qs[: n + 1], wrench)
            slopes[places_of_forces(self.here), :n] += (forces[1:] - forces[0]).T / steps[:n]
        return slopes

    def _exact_slopes(self) -> Any:
        """Return the drive's ``slopes``, in described coordinates; None where there are none, or y has others."""
        return getattr(self._drive, "slopes", None) if self.here is self.kernel else None

    def stopped(self, reason: str, t: float, y: Array, blame: Array | None = None) -> IntegrationStopped:
        """Return the error that says where a motion stopped; ``blame`` is the state that shows it, if not y."""
        seen = blame if blame is not None else self._stuck if self._stuck is not None else y
        return self.ended(reason, t, self.described(y[np.newaxis])[0], seen)

    def ended(self, reason: str, t: float, whole: Array, seen: Array) -> IntegrationStopped:
        """Return the error of a motion that ends at described (q, v, z); ``seen`` is the state that shows it."""
        q, v = np.split(whole.copy(), [self.n])
        names, bad = self.kernel.calls.rate_names, np.flatnonzero(~np.isfinite(seen))
        name, where = getattr(self.trouble, "coordinate", ""), f"{self.kernel.name}, t = {t:.6g} s"
        if bad.size:
            name = names[int(bad[0]) - self.n * (bad[0] >= self.n)]
            what = f"{name} is not finite"
        elif name:  # the trouble says it
            return IntegrationStopped(f"{where}: {reason}; {self.trouble}", t, q, v, name)
        else:
            velocities, sizes = np.abs(seen[self.n :]), rate_sizes(self.kernel, q)
            worst = int(np.argmax(velocities / sizes) if velocities.any() else np.argmin(sizes))
            name = names[worst]
            what = f"{name} moves fastest for its size, at {seen[self.n + worst]:.3g} per second"
            if not velocities.any():
                what = f"nothing moves, {name} is the stiffest"
        detail = f"; {self.trouble}" if self.trouble else ""
        return IntegrationStopped(f"{where}: {reason}; {what}{detail}", t, q, v, name)
