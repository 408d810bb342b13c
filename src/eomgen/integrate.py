"""Numerical integration of a compiled kernel's equations of motion, explicit and implicit.

SciPy is imported when an integration with one of its methods begins, not with this file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import sundials
from .contacts import Contact, ContactWatch
from .errors import ArrayError, EomgenError, InputError, IntegrationError
from .kernel import Kernel

Array = NDArray[np.float64]
Drive = Callable[[float, Array, Array], ArrayLike]
Wrench = Callable[[float, Array, Array], ArrayLike]
Prescribed = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike]]
Progress = Callable[[float, str], None]
Record = Callable[[Array, Array], None]

EXPLICIT = ("DOP853", "RK45", "rk4")
IMPLICIT = ("Radau", "BDF", "LSODA")  # SciPy's
METHODS = ("auto", *IMPLICIT, *sundials.METHODS, *EXPLICIT)

REFERENCE_ACCELERATION = 10.0  # m/s^2, rad/s^2: about 1 g; what it does to a spring is the size of its deviation
Q_STEP, V_STEP = 1e-7, 1e-6  # finite differences: small beside 1 rad, 1e9 times the round-off of a force


class IntegrationStopped(IntegrationError):
    """An integration that could not go on, with its last good state.

    Attributes:
        t: time of the last good state, s.
        q, v: that state, (n,).
        coordinate: name of the coordinate that is to blame: it is not finite, or moves fastest for its size.
    """

    def __init__(self, message: str, t: float, q: Array, v: Array, coordinate: str) -> None:
        super().__init__(message)
        self.t, self.q, self.v, self.coordinate = t, q, v, coordinate


@dataclass(frozen=True)
class Trajectory:
    """A motion, sampled at equal distances in time.

    Attributes:
        t: times, (T,), s.
        q, v: coordinates and rates, (T, n).
        u: drives, (T, n), N or N m.
        energy: kinetic and potential energy, (T, 2), J.
        coordinates: names, (n,).
        method: the method that was used.
        info: numbers of steps (0: not known), evaluations (of forward or inverse dynamics) and jacobians; wall_s, s.
        contacts: when clearances closed and opened, by time.
    """

    t: Array
    q: Array
    v: Array
    u: Array
    energy: Array
    coordinates: tuple[str, ...]
    method: str
    info: Mapping[str, float] = field(default_factory=dict)
    contacts: tuple[Contact, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", MappingProxyType(dict(self.info)))

    def of(self, coordinate: str) -> Array:
        """One coordinate over time, (T,), m or rad; InputError if there is none of that name."""
        if coordinate not in self.coordinates:
            raise InputError(f"coordinate: {coordinate!r} is unknown; known: {', '.join(self.coordinates)}")
        return self.q[:, self.coordinates.index(coordinate)]


def integrate(
    kernel: Kernel,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    *,
    drive: Drive | None = None,
    wrench: Wrench | ArrayLike | None = None,
    prescribed: Prescribed | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    atol: ArrayLike | None = None,
    step: float | None = None,
    output_step: float | None = None,
    times: ArrayLike | None = None,
    progress: Progress | None = None,
    record: Record | None = None,
) -> Trajectory:
    """Integrate M(q) a + bias = generalized force + u from a state.

    Args:
        kernel: float64, with forward_dynamics and energy; implicit methods and ``atol=None`` need mass_matrix, and
            implicit ones inverse_dynamics.
        q0, v0: the state at t = 0, (n,).
        duration: s.
        drive: (t, q, v) -> u, (n,), N or N m; none if not given.  With an attribute ``batched`` that is true it is
            called with q and v of shape (N, n), too, and returns (N, n).
        wrench: (links, 6) as in the kernel's methods, or (t, q, v) -> that.
        prescribed: t -> (q, v, a) of the prescribed coordinates, (m,) each, in the order of ``kernel.prescribed``
            (``eomgen.motion.Harmonic``, say); v and a must be the derivatives of q.  What q0, v0 and drive say of them
            does not count.  The trajectory's u is there the force that the motion needs, so that the kernel must have
            inverse_dynamics.
        method: "auto" (Radau if any coordinate or spring has a stiffness, else DOP853), "Radau", "BDF", "LSODA",
            "DOP853", "RK45" (all SciPy's), "CVODE", "IDA" (SUNDIALS'), or "rk4" with a fixed step.
        rtol, atol: tolerances; atol is a number or (2n,), first of q, then of v.  By default rtol times the size of
            each coordinate: ``coordinate_sizes``.
        step: of rk4, s; shortened so that it divides ``output_step``.  Default: half the time in which the fastest
            spring turns by 1 rad, or a damper between two points slows down by a factor e.
        output_step: distance of the samples, s, shortened so that it divides the duration; default duration / 1000.
        times: of the samples, s, (T,), increasing; instead of ``output_step``.  The state given is that at the first,
            which need not be 0; the last must be the duration.
        progress: called with a fraction from 0 to 1 and a line of text.
        record: called with times of samples (k,) and states (k, 2n) as they are reached, the first one not among them.

    Raises:
        IntegrationStopped: the state diverges, the step becomes too small or M singular; an IntegrationError that
            names coordinate and time and has the last good state.
        InputError: an argument is wrong, a prescribed coordinate has no motion, or SciPy is not installed.
    """
    system = System(kernel, drive, wrench, prescribed)
    q0, v0 = (state_vector(label, x, kernel.coordinates) for label, x in (("q0", q0), ("v0", v0)))
    times = output_times(duration, output_step) if times is None else _checked_times(times, duration, output_step)
    method = choose_method(kernel, method)
    began = time.perf_counter()
    report = reporter(progress, float(times[-1]))
    y0 = np.concatenate([q0, v0])
    watch = ContactWatch(kernel)
    if method == "rk4":
        states = rk4(system, y0, times, fixed_step(kernel, q0, step, times), report, watch=watch, record=record)
    else:
        tolerances = _tolerances(system, y0, rtol, atol)
        if method in sundials.METHODS:
            states = sundials.sundials_states(system, y0, times, method, rtol, tolerances, report, watch, record)
        else:
            solver = _start_solver(system, y0, times, method, rtol, tolerances)
            states = _sampled(solver, system, times, report, watch, record)
    q, v = np.ascontiguousarray(states[:, : system.n]), np.ascontiguousarray(states[:, system.n :])
    u = np.empty_like(q)
    for i, t in enumerate(times):
        system.prescribe(float(t), q[i], v[i])
        u[i] = system.forces(float(t), q[i], v[i])
    info = {**system.counts, "wall_s": time.perf_counter() - began}
    energy = np.asarray(kernel.energy(q, v))
    return Trajectory(times, q, v, u, energy, kernel.coordinates, method, info, tuple(watch.found))


def choose_method(kernel: Kernel, method: str = "auto") -> str:
    """The method that ``integrate`` takes: "auto" becomes Radau if anything has a stiffness, else DOP853.

    Raises:
        InputError: the method is unknown.
    """
    if method not in METHODS:
        raise InputError(f"method: {method!r} is unknown; allowed: {', '.join(METHODS)}")
    if method != "auto":
        return method
    stiff = bool(stiffnesses(kernel).any()) or any(
        kernel.parameters.get(f"springs.{name}.stiffness", 0.0) or name in kernel.knots for name in kernel.springs
    )
    return "Radau" if stiff else "DOP853"


def stiffnesses(kernel: Kernel) -> Array:
    """Stiffness of every coordinate as the kernel has it now, (n,), N/m or N m/rad; 0 where there is no spring.

    Of two sides the stiffer one, of a clearance that of its end, of a curve that of its steepest piece.  A transmission
    holds its motor with stiffness / ratio^2 and its joint with the stiffness, each as if the other stood still.
    """
    return np.array(np.diagonal(stiffness_matrix(kernel)))


def stiffness_matrix(kernel: Kernel) -> Array:
    """``stiffnesses`` with what transmissions have beside the diagonal, (n, n)."""
    K = np.diag(_own_stiffnesses(kernel))
    for motor, principal in kernel.motors.items():
        m, p, ratio = kernel.coordinates.index(motor), kernel.coordinates.index(principal), kernel.ratio(motor)
        k = K[m, m]
        K[p, p] += k
        K[m, m], K[m, p], K[p, m] = k / ratio**2, -k / ratio, -k / ratio
    return K


def _own_stiffnesses(kernel: Kernel) -> Array:
    """Stiffness of every coordinate's own table, (n,); of a motor's that of its transmission."""
    found = np.maximum(coordinate_numbers(kernel, "stiffness"), coordinate_numbers(kernel, "stiffness_negative"))
    for i, coordinate in enumerate(kernel.coordinates):
        if coordinate in kernel.knots:
            knots = kernel.knots[coordinate]
            forces = [kernel.parameters[f"joints.{coordinate}.curve.{j}"] for j in range(len(knots))]
            found[i] = max(0.0, float(np.max(np.diff(forces) / np.diff(knots))))
    return found


def spring_rates(kernel: Kernel, q: Array) -> tuple[Array, Array]:
    """Stiffness and damping by springs between points at q, (n, n) each; cables count as taut."""
    if not kernel.springs:
        return np.zeros((kernel.n, kernel.n)), np.zeros((kernel.n, kernel.n))
    arms = kernel.spring_jacobian(q)
    damping = np.array([kernel.parameters.get(f"springs.{name}.damping", 0.0) for name in kernel.springs])
    return np.asarray(kernel.spring_stiffness(q)), np.asarray(arms.T @ (damping[:, None] * arms))


def coordinate_numbers(kernel: Kernel, key: str) -> Array:
    """A parameter of every coordinate, such as "damping", (n,); 0 where there is none."""
    names = (f"joints.{coordinate}.{key}" for coordinate in kernel.coordinates)
    return np.array([kernel.parameters.get(name, 0.0) for name in names])


def coordinate_sizes(kernel: Kernel, q: Array) -> tuple[Array, Array]:
    """Sizes of coordinates and rates that tolerances refer to, (n,) each; m, rad, s.

    A coordinate with stiffness k, its own and that of springs between points, and inertia m, the diagonal entry of
    M(q), has w^2 = k / m; at 10 m/s^2 or rad/s^2 it gives way by 10 / w^2, often micrometres, and swings with rates of
    10 / w.  Without a spring, or with a soft one, the size is 1.
    """
    stiffness = stiffnesses(kernel) + np.diagonal(spring_rates(kernel, q)[0])
    inertia = np.diagonal(kernel.mass_matrix(q))
    with np.errstate(divide="ignore", invalid="ignore"):
        period = np.where((stiffness > 0.0) & (inertia > 0.0), np.sqrt(inertia / stiffness), np.inf)
    return np.minimum(1.0, REFERENCE_ACCELERATION * period**2), np.minimum(1.0, REFERENCE_ACCELERATION * period)


def state_vector(label: str, value: ArrayLike, coordinates: tuple[str, ...]) -> Array:
    """The value as a vector of one finite number per coordinate, a copy.

    Raises:
        ArrayError: it is none; the message begins with the label.
    """
    n = len(coordinates)
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArrayError(f"{label}: expected {n} numbers, got {type(value).__name__} ({error})") from None
    if array.shape != (n,):
        raise ArrayError(f"{label}: expected float64 of shape ({n},), got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise ArrayError(f"{label}: {coordinates[bad[0]]} is {array[bad[0]]}; numbers must be finite")
    return array


class System:
    """The equations of motion as y' = f(t, y), y = (q, v), with their Jacobian; counts its calls."""

    def __init__(
        self,
        kernel: Kernel,
        drive: Drive | None,
        wrench: Wrench | ArrayLike | None,
        prescribed: Prescribed | None = None,
    ) -> None:
        if kernel.dtype != np.float64:
            raise InputError(f"integration needs a float64 kernel; {kernel.name} is {kernel.dtype}")
        self.kernel, self.n = kernel, kernel.n
        self._drive = drive
        self._prescribed = prescribed
        self._given = [kernel.coordinates.index(name) for name in kernel.prescribed]
        self._free = np.array([name not in kernel.prescribed for name in kernel.coordinates])
        if self._given and prescribed is None:
            raise InputError(f"prescribed: the motion of {', '.join(kernel.prescribed)} is not given")
        if prescribed is not None and not self._given:
            raise InputError(f"prescribed: {kernel.name} has no prescribed coordinate")
        self._batched = bool(getattr(drive, "batched", False))
        self._wrench = wrench
        self._no_drive = np.zeros(self.n)
        self.counts = {"steps": 0, "evaluations": 0, "jacobians": 0}
        self.trouble: Exception | None = None

    def prescribe(self, t: float, q: Array, v: Array) -> Array:
        """Put q and v of prescribed coordinates into a state's arrays; their accelerations."""
        if self._prescribed is None:
            return np.zeros(0)
        found = [np.asarray(x, dtype=np.float64) for x in self._prescribed(t)]
        if [x.shape for x in found] != [(len(self._given),)] * 3 or not np.isfinite(found).all():
            raise ArrayError(
                f"prescribed: expected three arrays of {len(self._given)} finite numbers at t = {t:.6g} s, got"
                f" {', '.join(str(x) for x in found)}"
            )
        q[self._given], v[self._given] = found[:2]
        return found[2]

    def forces(self, t: float, q: Array, v: Array) -> Array:
        """u in a state: the drives, and what the motion of prescribed coordinates needs."""
        u = np.array(self.drives(t, q, v))
        if self._given:
            u[self._given] = self.prescribe(t, q, v)
            wrench = self.wrench(t, q, v)
            a = self.kernel.forward_dynamics(q, v, u, wrench=wrench)
            u[self._given] = self.kernel.inverse_dynamics(q, v, a, wrench=wrench)[self._given]
        return u

    def drives(self, t: float, q: Array, v: Array) -> Array:
        """u of one state, (n,), or of a batch, (N, n)."""
        if self._drive is None:
            return self._no_drive if q.ndim == 1 else np.zeros_like(q)
        if q.ndim == 2 and not self._batched:
            return np.array([self.drives(t, *state) for state in zip(q, v, strict=True)])
        u = np.asarray(self._drive(t, q, v), dtype=np.float64)
        if u.shape != q.shape:
            raise ArrayError(f"drive: expected forces of shape {q.shape}, got shape {u.shape} at t = {t:.6g} s")
        return u

    def wrench(self, t: float, q: Array, v: Array) -> ArrayLike | None:
        """External wrenches in one state, (links, 6)."""
        return self._wrench(t, q, v) if callable(self._wrench) else self._wrench

    def derivative(self, t: float, y: Array) -> Array:
        """y' of one state."""
        self.counts["evaluations"] += 1
        q, v = y[: self.n], y[self.n :]
        result = np.empty_like(y)
        if self._given:
            q, v = q.copy(), v.copy()
            a = self.prescribe(t, q, v)
        u, wrench = self.drives(t, q, v), self.wrench(t, q, v)
        if self._given:
            u = np.array(u)
            u[self._given] = a
        result[: self.n] = v
        self.kernel.forward_dynamics(q, v, u, wrench=wrench, out=result[self.n :])
        return result

    def trial(self, t: float, y: Array) -> Array:
        """As ``derivative``, but NaN where that is impossible: a method with step control then takes a shorter step."""
        try:
            return self.derivative(t, y)
        except (ValueError, ArithmeticError) as error:  # a state that is not finite, or M is singular there
            self.trouble = error
            return np.full_like(y, np.nan)

    def jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy, (2n, 2n): M da = -d(residual) at constant a."""
        self.counts["jacobians"] += 1
        n, y = self.n, y.copy()
        self.prescribe(t, y[:n], y[n:])
        by_q, by_v, M = self._slopes(t, y[:n], y[n:], self.derivative(t, y)[n:])
        result = np.zeros((2 * n, 2 * n))
        result[:n, n:] = np.eye(n)
        free = self._free
        result[n:][free] = -np.linalg.solve(M[np.ix_(free, free)], np.hstack([by_q, by_v])[free])
        result[:, np.tile(~free, 2)] = 0.0  # what is prescribed depends on time alone
        return result

    def residual(self, t: float, y: Array, slopes: Array) -> Array:
        """F(t, y, y'), (2n,): q' - v, and the residual of the equations of motion at a = v'."""
        self.counts["evaluations"] += 1
        n, y = self.n, y.copy()
        q, v, a = y[:n], y[n:], slopes[n:].copy()
        given = self.prescribe(t, q, v)
        wrench = self.wrench(t, q, v)
        result = np.concatenate([slopes[:n] - v, self.kernel.inverse_dynamics(q, v, a, wrench=wrench)])
        result[n:] -= self.drives(t, q, v)
        if self._given:
            result[n:][self._given] = a[self._given] - given
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
        """Derivatives of inverse dynamics less drives by q and v at constant a, and M, (n, n) each.

        The kernel's exact ones where it has them, else finite differences of a batch of inverse dynamics; those of
        drives and wrenches are finite differences unless the drive has a method ``slopes``.
        """
        n, kernel, wrench = self.n, self.kernel, self.wrench(t, q, v)
        steps = np.concatenate([Q_STEP * np.maximum(1.0, np.abs(q)), V_STEP * np.maximum(1.0, np.abs(v))])
        states = np.tile(np.concatenate([q, v]), (2 * n + 1, 1))
        states[np.arange(1, 2 * n + 1), np.arange(2 * n)] += steps
        qs, vs = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
        if "residual_jacobian" in kernel.operations:
            *exact, M = kernel.residual_jacobian(q, v, a)
            result = np.hstack(exact)
            if wrench is not None:
                forces = kernel.external_force(qs[: n + 1], wrench)
                result[:, :n] -= (forces[1:] - forces[0]).T / steps[:n]
        else:
            forces = kernel.inverse_dynamics(qs, vs, a, wrench=wrench)
            result, M = (forces[1:] - forces[0]).T / steps, kernel.mass_matrix(q)
        if self._drive is not None:
            result -= self._drive_slopes(t, qs, vs, steps)
        return result[:, :n], result[:, n:], M

    def _drive_slopes(self, t: float, qs: Array, vs: Array, steps: Array) -> Array:
        """Derivatives of the drives by (q, v), (n, 2n), about the first of the states, which differ by the steps."""
        exact = getattr(self._drive, "slopes", None)
        if exact is not None:
            return np.hstack(exact(t, qs[0], vs[0]))
        drives = self.drives(t, qs, vs)
        slopes: Array = (drives[1:] - drives[0]).T / steps
        return slopes

    def stopped(self, reason: str, t: float, y: Array, blame: Array | None = None) -> IntegrationStopped:
        """The error that says where a motion could not go on; ``blame`` is the state that shows it, if not y."""
        q, v = y[: self.n].copy(), y[self.n :].copy()
        seen = y if blame is None else blame
        bad = np.flatnonzero(~np.isfinite(seen))
        if bad.size:
            worst, what = int(bad[0]) % self.n, "is not finite"
        else:
            worst = int(np.argmax(np.abs(seen[self.n :]) / coordinate_sizes(self.kernel, q)[1]))
            what = f"moves fastest for its size, at {seen[self.n + worst]:.3g} per second"
        name = self.kernel.coordinates[worst]
        detail = f"; {self.trouble}" if self.trouble else ""
        return IntegrationStopped(f"{self.kernel.name}, t = {t:.6g} s: {reason}; {name} {what}{detail}", t, q, v, name)


def output_times(duration: float, output_step: float | None) -> Array:
    """Times of the samples, s, the duration at the end; InputError if one of both is no time."""
    if not (np.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: {duration!r} s; an integration takes a finite time greater than 0")
    if output_step is None:
        output_step = duration / 1000.0
    if not (np.isfinite(output_step) and output_step > 0.0):
        raise InputError(f"output_step: {output_step!r} s; samples are a finite time greater than 0 apart")
    return np.linspace(0.0, duration, max(1, int(np.ceil(duration / output_step - 1e-9))) + 1)


def _checked_times(times: ArrayLike, duration: float, output_step: float | None) -> Array:
    found = np.array(times, dtype=np.float64)
    if output_step is not None:
        raise InputError("times and output_step are both given; allowed: one of them")
    if found.ndim != 1 or found.size < 2 or not np.isfinite(found).all() or not (np.diff(found) > 0.0).all():
        raise InputError("times: allowed: two or more finite times, increasing")
    if found[-1] != duration:
        raise InputError(f"times: end at {found[-1]:g} s; allowed: at the duration, {duration:g} s")
    return found


def reporter(progress: Progress | None, duration: float) -> Callable[[float, str], None]:
    """A report of the time reached, at most one per percent."""
    last = -1.0

    def report(t: float, text: str) -> None:
        nonlocal last
        fraction = min(1.0, t / duration)
        if progress is not None and (fraction - last >= 0.01 or (fraction == 1.0 and last < 1.0)):
            last = fraction
            progress(fraction, text)

    return report


def fixed_step(kernel: Kernel, q0: Array, step: float | None, times: Array) -> float:
    """The step of rk4, s: as given, or half the time of the fastest spring or line damper, at most 1 ms.

    That is the time in which a spring turns by 1 rad, or a damper between two points takes 1 - 1 / e of a rate.
    """
    if step is not None:
        if not (np.isfinite(step) and step > 0.0):
            raise InputError(f"step: {step!r} s; a step is a finite time greater than 0")
        return step
    between, damping = spring_rates(kernel, q0)
    stiffness = stiffness_matrix(kernel) + between
    fastest = 0.0
    if stiffness.any():
        fastest = float(np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(kernel.mass_matrix(q0), stiffness))).max()))
    if damping.any():
        slowing = np.abs(np.linalg.eigvals(np.linalg.solve(kernel.mass_matrix(q0), damping))).max()
        fastest = max(fastest, float(slowing))
    return min(1e-3, 0.5 / fastest if fastest else np.inf, float(np.diff(times).max()))


def rk4(
    system: System,
    y: Array,
    times: Array,
    step: float,
    report: Callable[[float, str], None],
    settle: Callable[[float, float, Array, Array], Array] | None = None,
    watch: ContactWatch | None = None,
    record: Record | None = None,
) -> Array:
    """The classical Runge-Kutta method of order 4; states at the times, (T, 2n).

    ``settle(t, h, y, good)`` corrects y, the state after a step of h from ``good`` at t.
    """
    states = np.empty((times.size, y.size))
    states[0] = y
    f = system.derivative
    for i, (t0, t1) in enumerate(pairwise(times), 1):
        count = max(1, int(np.ceil((t1 - t0) / step - 1e-9)))
        h = (t1 - t0) / count
        for j in range(count):
            t = float(t0 + j * h)
            good = y
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    k1 = f(t, y)
                    k2 = f(t + 0.5 * h, y + 0.5 * h * k1)
                    k3 = f(t + 0.5 * h, y + 0.5 * h * k2)
                    k4 = f(t + h, y + h * k3)
                    y = y + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
            except (ValueError, ArithmeticError) as error:
                system.trouble = error
                raise system.stopped(f"rk4 cannot go on with a step of {h:.3g} s", t, good) from error
            if not np.isfinite(y).all():
                raise system.stopped(f"rk4 diverged with a step of {h:.3g} s", t, good, y)
            if settle is not None:
                y = settle(t, h, y, good)
            if watch is not None:
                watch.step(t, good, t + h, y)
            system.counts["steps"] += 1
        states[i] = y
        if record is not None:
            record(times[i : i + 1], states[i : i + 1])
        report(float(t1), f"t = {t1:.3f} s, rk4, {system.counts['steps']} steps")
    return states


def _start_solver(system: System, y0: Array, times: Array, method: str, rtol: float, atol: Array) -> Any:
    """SciPy's solver at the first time: the classes that solve_ivp drives, stepped here to show progress."""
    try:
        from scipy import integrate as scipy_integrate
    except ImportError:
        raise InputError(f'method {method} needs SciPy: pip install "eomgen[sim]"; "rk4" works without') from None
    system.derivative(float(times[0]), y0)  # a state that cannot move is the caller's: its error comes as it is
    options: dict[str, Any] = {"rtol": rtol, "atol": atol}
    if method in IMPLICIT:
        options["jac"] = system.jacobian
    function = system.derivative if method == "LSODA" else system.trial
    return getattr(scipy_integrate, method)(function, times[0], y0, times[-1], **options)


def _tolerances(system: System, y0: Array, rtol: float, atol: ArrayLike | None) -> Array:
    """Absolute ones of (q, v), (2n,)."""
    n = system.n
    if not (np.isfinite(rtol) and 1e-13 <= rtol < 1.0):
        raise InputError(f"rtol: {rtol!r}; allowed: from 1e-13 to less than 1")
    if atol is None:
        return rtol * np.concatenate(coordinate_sizes(system.kernel, y0[:n]))
    try:
        tolerance = np.broadcast_to(np.asarray(atol, dtype=np.float64), (2 * n,))
    except (TypeError, ValueError):
        raise ArrayError(f"atol: expected a number or shape ({2 * n},), got shape {np.shape(atol)}") from None
    if not (np.isfinite(tolerance).all() and (tolerance >= 0.0).all()):
        raise InputError("atol: tolerances are finite and at least 0")
    return tolerance


def _sampled(
    solver: Any,
    system: System,
    times: Array,
    report: Callable[[float, str], None],
    watch: ContactWatch,
    record: Record | None = None,
) -> Array:
    """Step SciPy's solver to the end; states at the times, (T, 2n)."""
    states = np.empty((times.size, solver.y.size))
    states[0] = solver.y
    done = 1
    name = type(solver).__name__
    while solver.status == "running":
        t, y = solver.t, solver.y
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                message = solver.step()
        except EomgenError as error:
            system.trouble = error
            raise system.stopped(f"{name} cannot go on", t, y) from error
        except (ValueError, ArithmeticError) as error:  # LU of a Jacobian that is not finite, say
            system.trouble = system.trouble or error
            raise system.stopped(f"{name} cannot go on", t, y) from error
        if solver.status == "failed":
            raise system.stopped(f"{name} cannot go on: {str(message).rstrip('.').lower()}", t, y)
        if not np.isfinite(solver.y).all():
            raise system.stopped(f"{name} diverged", t, y, solver.y)
        system.counts["steps"] += 1
        end = int(np.searchsorted(times, solver.t, side="right"))
        if end > done or len(watch):
            between = solver.dense_output()
            watch.step(t, y, solver.t, solver.y, between)
            if end > done:
                states[done:end] = between(times[done:end]).T
                if record is not None:
                    record(times[done:end], states[done:end])
            done = end
        report(solver.t, f"t = {solver.t:.3f} s, {name}, {system.counts['steps']} steps")
    return states
