"""A kernel's equations of motion as a system of first order, with drives, wrenches and prescribed motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Index
from ..errors import ArrayError, InputError, IntegrationError, IntegrationStopped, SingularError
from ..runtime.by_name import WrenchLike, wrench_rows
from ..runtime.kernel import Kernel
from ..runtime.stepping.packed_inputs import PackedInputs
from ..runtime.stepping.reading_inputs import NamedWrenches
from ..runtime.stepping.single_motion import SingleMotion
from ..state.springs import coordinate_sizes, rate_step, smoothings
from ..state.vectors import Q_STEP, DriveFunction, MotionFunction, WrenchFunction, prescribed_mask
from .advance import Advance

EXACT = ("residual_jacobian", "forward_dynamics_jacobian")  # kernels with derivatives
MANY = 4096  # states of which forces are looked at together


def concerns_state(error: Exception) -> bool:
    """Whether a shorter step may avoid an error: the state is not finite, or its mass matrix is singular."""
    return not isinstance(error, InputError) or isinstance(error, (ArrayError, SingularError))


class System:
    """The equations of motion as y' = f(t, y), y = (q, v) or a part of it, with their Jacobian; counts its calls.

    Whatever ``kernel.checks`` says, a drive, wrench, prescribed motion, state or acceleration that is not finite is an
    ArrayError that names it.  With ``advance`` evaluations that lead nowhere are an IntegrationError.

    Attributes:
        here: the kernel whose coordinates y has.
        loaded: loads that are data, if C integrated by them.
        worked: the motion in C that integrates works, if one does.
        works_at_end: of such a motion that ended before its last sample, (4,), J.
        part: of the tolerances that is left to y, where that is a part of the state.
    """

    part = 1.0

    def __init__(
        self,
        kernel: Kernel,
        drive: DriveFunction | None,
        wrench: WrenchFunction | WrenchLike | None,
        prescribed: MotionFunction | None = None,
    ) -> None:
        if kernel.dtype != np.float64:
            raise InputError(f"integration needs a float64 kernel; {kernel.name} is {kernel.dtype}")
        self.kernel, self.n = kernel, kernel.n
        self.here = kernel
        self._drive = drive
        self._prescribed = prescribed
        self._given = [kernel.coordinates.index(name) for name in kernel.prescribed]
        self._free = ~prescribed_mask(kernel)
        if self._given and prescribed is None:
            raise InputError(f"prescribed: the motion of {', '.join(kernel.prescribed)} is not given")
        if prescribed is not None and not self._given:
            raise InputError(f"prescribed: {kernel.name} has no prescribed coordinate")
        self._batched = bool(getattr(drive, "batched", False))
        if isinstance(wrench, Mapping):
            wrench = NamedWrenches(kernel.calls, wrench)
        self._wrench = wrench
        if wrench is not None and not callable(wrench) and np.shape(wrench) == (len(kernel.links), 6):
            kernel.refuse_not_finite("wrench", np.asarray(wrench, dtype=np.float64), (len(kernel.links), 6))
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
        """Drive, wrench and motion of the prescribed coordinates, as they were given."""
        return self._drive, self._wrench, self._prescribed

    def begin(self, t: float, q: Array, v: Array) -> Array:
        """y of the state at the first time, (n,) each; what has to be put right is put into its arrays."""
        return np.concatenate([q, v])

    @property
    def index(self) -> Index:
        """Places of y in (q, v)."""
        return np.arange(2 * self.n)

    def resume(self, whole: Array) -> Array:
        """y that goes on from q and v, (2n,), in the coordinates of ``here``."""
        return whole

    def described(self, whole: Array) -> Array:
        """q and v as described, (N, 2n), of those in the coordinates of ``here``."""
        return whole

    def whole(self, times: Array, ys: Array) -> Array:
        """q and v, (N, 2n), of y, (N, size), at the times."""
        return ys

    def arrived(self, t: float, y: Array) -> tuple[Array, Array, bool]:
        """y to go on with from t, where a step has led, q and v there, and whether y begins anew."""
        return y, y, False

    def margins(self, q: Array) -> Array | None:
        """How far samples, (T, n), are from singular poses, (T,); None where there are no loops."""
        return None

    def edges(self, y: Array) -> Array:
        """Numbers of which none changes its sign between two times at which y begins anew."""
        return np.zeros(0)

    def about(self, q: Array, v: Array) -> dict[str, float]:
        """Counts of calls, and more that is said of the motion with samples q and v, (T, n)."""
        known = smoothings(self.kernel)
        return self.counts | ({"friction_smoothing": max(known.values())} if known else {})

    def prescribe(self, t: float, q: Array, v: Array) -> Array:
        """Put q and v of prescribed coordinates into a state's arrays; their accelerations."""
        if self._prescribed is None:
            return np.zeros(0)
        found = [np.asarray(x, dtype=np.float64) for x in self._prescribed(t)]
        if [x.shape for x in found] != [(len(self._given),)] * 3 or not np.isfinite(found).all():
            bad = np.argwhere(~np.isfinite(found)) if len({x.shape for x in found}) == 1 else np.zeros((0, 2), int)
            raise ArrayError(
                f"prescribed: expected three arrays of {len(self._given)} finite numbers at t = {t:.6g} s, got"
                f" {', '.join(str(x) for x in found)}",
                self.kernel.prescribed[bad[0][-1] % len(self._given)] if bad.size else "",
            )
        q[self._given], v[self._given] = found[:2]
        return found[2]

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a state: the drives, and what the motion of prescribed coordinates needs."""
        u = np.array(self.drives(t, q, v))
        if self._given:
            u[self._given] = self.prescribe(t, q, v)
            wrench = self.wrench(t, q, v)
            a = self.here.forward_dynamics(q, v, u, wrench=wrench)
            u[self._given] = self.here.inverse_dynamics(q, v, a, wrench=wrench, cut=True)[self._given]
        return u

    def forces_over(self, times: Array, q: Array, v: Array) -> tuple[Array, ArrayError | None]:
        """u at times, as far as it is finite, (k, n), and why no further; motions that are given are put into q, v.

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
        """Works at so many samples, (count, 4), J; None where they are not integrated."""
        if self.worked is None:
            return None
        found = self.worked.works_until(count)
        if self.works_at_end is not None:
            found[-1] = self.works_at_end
        return found

    def _loaded_forces(self, times: Array, q: Array, v: Array) -> tuple[Array, ArrayError | None]:
        """``forces_over`` by loads that are data."""
        assert self.loaded is not None
        u = self.loaded.drives(times, q, v)
        if self._given:
            wrench = self._wrench
            if callable(wrench):
                each = zip(times.tolist(), q, v, strict=True)
                wrench = np.array([wrench_rows(self.kernel.calls, state[1], wrench(*state)) for state in each])
            for first in range(0, len(u), MANY):
                rows = slice(first, first + MANY)
                pull = wrench if wrench is None or np.ndim(wrench) < 3 else np.asarray(wrench)[rows]
                u[rows, self._given] = self._needed(q[rows], v[rows], u[rows], pull)[:, self._given]
        for i in np.flatnonzero(~np.isfinite(u).all(axis=1))[:1].tolist():
            try:
                self._refuse_not_finite("drive", u[i], float(times[i]))
            except ArrayError as error:
                return u[:i], error
        return u, None

    def _needed(self, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
        """Forces that motions which are given need, at their places in (T, n), where u has their accelerations."""
        kernel = self.here.with_checks(False)
        a = kernel.forward_dynamics(q, v, u, wrench=wrench)
        return np.asarray(kernel.inverse_dynamics(q, v, a, wrench=wrench, cut=True))

    def drives(self, t: float, q: Array, v: Array) -> Array:
        """u of one state, (n,), or of a batch, (N, n)."""
        if self._drive is None:
            return self._no_drive if q.ndim == 1 else np.zeros_like(q)
        if q.ndim == 2 and not self._batched:
            return np.array([self.drives(t, *state) for state in zip(q, v, strict=True)])
        u = np.asarray(self._drive(t, q, v), dtype=np.float64)
        if u.shape != q.shape:
            raise ArrayError(f"drive: expected forces of shape {q.shape}, got shape {u.shape} at t = {t:.6g} s")
        self._refuse_not_finite("drive", u, t)
        return u

    def wrench(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """External wrenches in one state, (links, 6)."""
        if not callable(self._wrench):
            return self._wrench
        wrench = wrench_rows(self.kernel.calls, q, self._wrench(t, q, v))
        if wrench is None:
            return None
        if np.shape(wrench)[-2:] == (len(self.kernel.links), 6):  # another shape is the kernel's to refuse
            self._refuse_not_finite("wrench", np.asarray(wrench, dtype=np.float64), t)
        return wrench

    def _refuse_not_finite(self, label: str, values: Array, t: float) -> None:
        """ArrayError where one of the values, (n,), (N, n) or wrenches, is not finite."""
        if not np.isfinite(values).all():
            shape = (len(self.kernel.links), 6) if label == "wrench" else (self.n,)
            self.kernel.refuse_not_finite(label, values, shape, f" at t = {t:.6g} s")

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
        if self._given:
            q, v = q.copy(), v.copy()
            a = self.prescribe(t, q, v)
        u, wrench = self.drives(t, q, v), self.wrench(t, q, v)
        if self._given:
            u = np.array(u)
            u[self._given] = a
        result[: self.n] = v
        self.here.forward_dynamics(q, v, u, wrench=wrench, out=result[self.n :])
        self._refuse_not_finite("acceleration", result[self.n :], t)
        return result

    def trial(self, t: float, y: Array) -> Array:
        """y' of one state, NaN where there is none: a method with step control then takes a shorter step."""
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
        """dy'/dy, (2n, 2n): M da = -d(residual) at constant a.

        Without residual_jacobian the kernel's own derivatives of accelerations count.  They are not the first choice,
        since compilers take 1.4 times as long for them, 5 s more for 36 coordinates, and one takes 0.04 ms less.
        """
        self.counts["jacobians"] += 1
        n, y = self.n, y.copy()
        given = self.prescribe(t, y[:n], y[n:])
        result = np.zeros((2 * n, 2 * n))
        result[:n, n:] = np.eye(n)
        free = self._free
        if EXACT[0] not in self.here.operations and EXACT[1] in self.here.operations:
            result[n:] = self._acceleration_slopes(t, y[:n], y[n:], given)
        else:
            by_q, by_v, M = self._slopes(t, y[:n], y[n:], self.derivative(t, y)[n:])
            result[n:][free] = -np.linalg.solve(M[np.ix_(free, free)], np.hstack([by_q, by_v])[free])
        result[:, np.tile(~free, 2)] = 0.0  # what is prescribed depends on time alone
        return result

    def _acceleration_slopes(self, t: float, q: Array, v: Array, given: Array) -> Array:
        """Derivatives of accelerations by (q, v), (n, 2n), where ``given`` are those of prescribed coordinates."""
        u, wrench = np.array(self.drives(t, q, v)), self.wrench(t, q, v)
        if wrench is not None:
            u += self.here.external_force(q, wrench)
        u[self._given] = given
        by_q, by_v, by_u = self.here.forward_dynamics_jacobian(q, v, u)
        result, loads = np.hstack([by_q, by_v]), self._load_slopes(t, q, v)
        return np.asarray(result if loads is None else result + by_u[:, self._free] @ loads[self._free])

    def residual(self, t: float, y: Array, slopes: Array) -> Array:
        """F(t, y, y'), (2n,): q' - v, and the residual of the equations of motion at a = v'."""
        self.evaluated(t, y)
        n, y = self.n, y.copy()
        q, v, a = y[:n], y[n:], slopes[n:].copy()
        given = self.prescribe(t, q, v)
        wrench = self.wrench(t, q, v)
        result = np.concatenate([slopes[:n] - v, self.here.inverse_dynamics(q, v, a, wrench=wrench, cut=True)])
        result[n:] -= self.drives(t, q, v)
        if self._given:
            result[n:][self._given] = a[self._given] - given
        self._refuse_not_finite("rate less v", result[:n], t)
        self._refuse_not_finite("residual", result[n:], t)
        return result

    def residual_jacobian(self, t: float, y: Array, slopes: Array, c: float) -> Array:
        """dF/dy + c dF/dy', (2n, 2n)."""
        self.counts["jacobians"] += 1
        n, y = self.n, y.copy()
        self.prescribe(t, y[:n], y[n:])
        by_q, by_v, M = self._slopes(t, y[:n], y[n:], slopes[n:].copy())
        unit = np.eye(n)
        result = np.block([[c * unit, -unit], [by_q, by_v + c * M]])
        fixed = np.flatnonzero(~self._free)
        result[:, np.concatenate([fixed, n + fixed])] = 0.0
        result[n + fixed] = 0.0
        result[fixed, fixed] = result[n + fixed, n + fixed] = c
        result[n:, n + fixed] += np.where(self._free[:, None], c * M[:, fixed], 0.0)
        return result

    def _slopes(self, t: float, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Derivatives of inverse dynamics less drives and wrenches by q and v at constant a, and M, (n, n) each.

        The kernel's exact ones where it has them, else finite differences of a batch of inverse dynamics.
        """
        n, kernel = self.n, self.here
        if EXACT[0] in kernel.operations:
            *exact, M = kernel.residual_jacobian(q, v, a)
            result = np.hstack(exact)
        else:
            qs, vs, steps = self._beside(q, v)
            forces = kernel.inverse_dynamics(qs, vs, a, cut=True)
            result, M = (forces[1:] - forces[0]).T / steps, kernel.mass_matrix(q)
        loads = self._load_slopes(t, q, v)
        if loads is not None:
            result = result - loads
        return result[:, :n], result[:, n:], M

    def _beside(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """A state and those beside it, q and v, (2n + 1, n) each, and by how much these differ from it, (2n,).

        Steps of rates know of the friction.
        """
        n, kernel = self.n, self.here
        steps = np.concatenate([Q_STEP * np.maximum(1.0, np.abs(q)), rate_step(kernel) * np.maximum(1.0, np.abs(v))])
        states = np.tile(np.concatenate([q, v]), (2 * n + 1, 1))
        states[np.arange(1, 2 * n + 1), np.arange(2 * n)] += steps
        return np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:]), steps

    def _load_slopes(self, t: float, q: Array, v: Array) -> Array | None:
        """Derivatives of drives and wrenches by (q, v), (n, 2n); None where there are none of both.

        Finite differences, of drives unless they have a method ``slopes``.  Wrenches that turn a link have exact ones,
        too, in a kernel of their own; a compiler takes 0.5 s for it with one joint and 1 s with 36 coordinates, and a
        batch of one state per coordinate takes 0.01 ms.
        """
        n, wrench, exact = self.n, self.wrench(t, q, v), self._exact_slopes()
        if wrench is None and (self._drive is None or exact is not None):
            return None if exact is None else np.hstack(exact(t, q, v))
        qs, vs, steps = self._beside(q, v)
        result = np.zeros((n, 2 * n))
        if exact is not None:
            result[:] = np.hstack(exact(t, q, v))
        elif self._drive is not None:
            drives = self.drives(t, qs, vs)
            result[:] = (drives[1:] - drives[0]).T / steps
        if wrench is not None:
            forces = self.here.external_force(qs[: n + 1], wrench)
            result[:, :n] += (forces[1:] - forces[0]).T / steps[:n]
        return result

    def _exact_slopes(self) -> Any:
        """The drive's own slopes, which are in described coordinates; None where there are none, or y has others."""
        return getattr(self._drive, "slopes", None) if self.here is self.kernel else None

    def stopped(self, reason: str, t: float, y: Array, blame: Array | None = None) -> IntegrationStopped:
        """The error that says where a motion could not go on; ``blame`` is the state that shows it, if not y."""
        seen = blame if blame is not None else self._stuck if self._stuck is not None else y
        return self.ended(reason, t, self.described(y[np.newaxis])[0], seen)

    def ended(self, reason: str, t: float, whole: Array, seen: Array) -> IntegrationStopped:
        """The error of a motion that ends with q and v as described, (2n,); ``seen`` is the state that shows it."""
        q, v = np.split(whole.copy(), 2)
        bad = np.flatnonzero(~np.isfinite(seen))
        name, where = getattr(self.trouble, "coordinate", ""), f"{self.kernel.name}, t = {t:.6g} s"
        if bad.size:
            name = self.kernel.coordinates[int(bad[0]) % self.n]
            what = f"{name} is not finite"
        elif name:  # the trouble says it
            return IntegrationStopped(f"{where}: {reason}; {self.trouble}", t, q, v, name)
        else:
            rates, sizes = np.abs(seen[self.n :]), coordinate_sizes(self.kernel, q)[1]
            worst = int(np.argmax(rates / sizes) if rates.any() else np.argmin(sizes))
            name = self.kernel.coordinates[worst]
            what = f"{name} moves fastest for its size, at {seen[self.n + worst]:.3g} per second"
            if not rates.any():
                what = f"nothing moves, {name} is the stiffest"
        detail = f"; {self.trouble}" if self.trouble else ""
        return IntegrationStopped(f"{where}: {reason}; {what}{detail}", t, q, v, name)
