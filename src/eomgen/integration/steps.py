"""Steps from sample to sample: RK4 with a fixed step, and SciPy's methods, with progress, records and contacts."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, EomgenError, InputError, IntegrationStopped, SingularError
from ..kernel.complete import Kernel
from ..kernel.stepping.methods import SCIPY_IMPLICIT
from ..kernel.stepping.options import ErrorControl, joined_tolerances
from ..limits import LARGEST, is_usable
from ..names import show
from ..optional import optional_import
from ..progress import Progress
from ..robot.laws import COARSE
from ..runtime.arrays import numbers_in
from ..runtime.internal_states import StateBounds
from ..state.springs import coordinate_sizes, fastest_rates, internal_state_sizes, rubbing_rates
from .contacts import ContactWatch
from .plan import IntegratorOptions
from .system import System
from .until import Reached

Record = Callable[[Array, Array], None]

DIFFERENCE = 1e-4  # of an internal state, or of its size: for the slope of its rate
MOST_SAMPLES = 100_000_000  # of a motion: with one coordinate some 5 GB


def output_times(duration: float, output_step: float | None) -> Array:
    """Return the times of samples, s, the duration at the end; InputError if one of both is no time."""
    if not (is_usable(duration) and duration > 0.0):
        raise InputError(f"duration: {show(duration)} s; an integration takes a time above 0, up to {LARGEST:g}")
    if output_step is None:
        output_step = duration / 1000.0
    if not (is_usable(output_step) and output_step > 0.0):
        raise InputError(f"output_step: {show(output_step)} s; samples are a time above 0, up to {LARGEST:g}, apart")
    if duration / output_step > MOST_SAMPLES:
        raise InputError(
            f"output_step: {output_step!r} s; allowed: at most {MOST_SAMPLES:.0e} samples in the duration of"
            f" {duration:g} s"
        )
    return np.linspace(0.0, duration, max(1, int(np.ceil(duration / output_step - 1e-9))) + 1)


def checked_times(times: ArrayLike, duration: float, output_step: float | None) -> Array:
    samples = numbers_in("times", times, "two or more finite times, increasing")
    if output_step is not None:
        raise InputError("times and output_step are both set; allowed: one of them")
    if samples.ndim != 1 or samples.size < 2 or not (np.diff(samples) > 0.0).all():
        raise InputError("times: allowed: two or more finite times, increasing")
    if samples[-1] != duration:
        raise InputError(f"times: end at {samples[-1]:g} s; allowed: at the duration, {duration:g} s")
    return samples


def reporter(progress: Progress | None, duration: float) -> Progress:
    """Return a report of the time reached that calls ``progress`` at most once per percent."""
    last = -1.0

    def report(t: float, text: str) -> None:
        nonlocal last
        fraction = min(1.0, t / duration)
        if progress is not None and (fraction - last >= 0.01 or (fraction == 1.0 and last < 1.0)):
            last = fraction
            progress(fraction, text)

    return report


def fixed_step(kernel: Kernel, q0: Array, step: float | None, times: Array) -> float:
    """Return the step of rk4, s: ``step``, or half the time constant of the fastest spring or damper, at most 1 ms.

    That of a spring is 1 / its angular frequency, that of a damper, or of friction about zero velocity, the decay time
    of a velocity by 1 / e; of friction whose smoothing is too narrow for that, one of COARSE.
    """
    if step is not None:
        return step
    try:
        swing, slowing = fastest_rates(kernel, q0, COARSE)
    except np.linalg.LinAlgError:  # M is singular, as the first evaluation says
        swing, slowing = 0.0, 0.0
    fastest = max(swing, slowing)
    return min(1e-3, 0.5 / fastest if fastest else np.inf, float(np.diff(times).max()))


def _decay(kernel: Kernel, state: Array) -> float:
    """Return how fast internal states follow in (q, v, z), 1/s: the largest eigenvalue of their rates' slopes.

    Of bristles that is sigma_0 |v| / g(v): it depends on the velocity, and no default for all of a motion is good.
    """
    q, v, z = np.split(state, [kernel.n, 2 * kernel.n])
    change = np.diag(DIFFERENCE * np.maximum(np.abs(z), internal_state_sizes(kernel)))
    try:
        rates = kernel.internal_state_derivatives(q, v, np.stack([z - change, z + change]))
        slopes = (rates[1] - rates[0]) / (2.0 * np.diagonal(change)[:, np.newaxis])
        return float(np.abs(np.linalg.eigvals(slopes)).max())
    except (EomgenError, np.linalg.LinAlgError):  # as the next step says
        return 0.0


class Samples:
    """States of a motion at sample times, as they are reached.

    Attributes:
        times: (T,), s.
        states: q, v and internal states there, (T, size).
        done: how many are there; the first one is at the beginning.
    """

    def __init__(self, times: Array, y0: Array, record: Record | None = None) -> None:
        self.times, self.states, self.done, self._record = times, np.empty((times.size, y0.size)), 1, record
        self.states[0] = y0

    def take(self, states: Array) -> None:
        """Append the next ones, (k, size), and pass them on to ``record``."""
        rows = slice(self.done, self.done + len(states))
        self.states[rows] = states
        self.done = rows.stop
        if self._record is not None:
            self._record(self.times[rows], self.states[rows])

    def end(self, reached: Reached) -> None:
        """End with the state that was to be reached; samples before it that are not there yet are taken."""
        missing = self.times[self.done : int(np.searchsorted(self.times, reached.t))]
        if reached.at is not None and missing.size:
            self.take(np.array([reached.at(t) for t in missing.tolist()]))
        self.times = np.append(self.times[: self.done], reached.t)
        self.states = np.vstack([self.states[: self.done], reached.state])
        self.done = self.times.size
        if self._record is not None:
            self._record(self.times[-1:], self.states[-1:])

    def until(self, stop: IntegrationStopped) -> tuple[Array, Array]:
        """Return times and states so far, and the last good state behind them."""
        times, states = self.times[: self.done], self.states[: self.done]
        if stop.t > times[-1]:
            times, states = np.append(times, stop.t), np.vstack([states, np.concatenate([stop.q, stop.v])])
        return times, states


def rk4(
    system: System,
    y: Array,
    samples: Samples,
    step: float,
    report: Progress,
    watch: ContactWatch | None = None,
    *,
    chosen: bool = True,
) -> None:
    """Fill the samples by the classical Runge-Kutta method of order 4, from y at the first of them.

    Args:
        chosen: whether somebody chose the step; else it is shortened from sample to sample as internal states need.

    Raises:
        SingularError: M cannot be inverted at the first state.
        IntegrationStopped: the state diverges, or that of a law leaves the bounds that it cannot leave.
    """
    f, whole, kernel, longest = system.derivative, samples.states[0], system.kernel, step
    bounds = StateBounds.of(kernel.calls, whole) if kernel.internal_states else None
    for t0, t1 in pairwise(samples.times):
        if bounds is not None and not chosen:
            decay = _decay(kernel, whole)
            step = min(longest, 0.5 / decay) if decay > 0.0 else longest
        count = max(1, int(np.ceil((t1 - t0) / step - 1e-9)))
        h = (t1 - t0) / count
        for j in range(count):
            t = float(t0 + j * h)
            good, before, k1 = y, whole, None
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    k1 = f(t, y)
                    k2 = f(t + 0.5 * h, y + 0.5 * h * k1)
                    k3 = f(t + 0.5 * h, y + 0.5 * h * k2)
                    k4 = f(t + h, y + h * k3)
                    y = y + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
                if np.isfinite(y).all():
                    y, whole, _ = system.accept(t + h, y)
            except (EomgenError, ValueError, ArithmeticError) as error:
                if k1 is None and not system.counts["steps"] and isinstance(error, SingularError):
                    raise
                system.trouble = error
                raise system.stopped(f"rk4 cannot go on with a step of {h:.3g} s", t, good) from error
            if not np.isfinite(y).all():
                raise system.stopped(f"rk4 diverged with a step of {h:.3g} s", t, good, y)
            beyond = None if bounds is None else bounds.first_beyond(whole[np.newaxis, kernel.n :])
            if beyond is not None:
                (_, state), said = beyond
                system.trouble = ArrayError(said, kernel.internal_states[state])
                raise system.stopped(f"rk4 cannot go on with a step of {h:.3g} s", t, good)
            if watch is not None:
                watch.find(t, before, t + h, whole, rates=k1[k1.size - len(kernel.internal_states) :])
            system.counts["steps"] += 1
        samples.take(whole[np.newaxis])
        report(float(t1), f"t = {t1:.3f} s, rk4, {system.counts['steps']} steps")


def _solver(system: System, control: ErrorControl, y: Array, span: tuple[float, float], first: float = 0.0) -> Any:
    """Return SciPy's solver from y over a span, s: the classes that solve_ivp drives, stepped here to show progress.

    The first step, s, is looked for where it is 0.
    """
    name, (t, end) = control.method, span
    with optional_import("SciPy", f"method {name} needs", '"rk4" works without'):
        from scipy import integrate as scipy_integrate
    system.derivative(t, y)  # a state that cannot move is the caller's: its error comes as it is
    share = 1.0 if name == "scipy:Radau" else system.tolerance_share  # whose estimate is larger than its error
    options: dict[str, Any] = {"rtol": max(share * control.rtol, 1e-13), "atol": share * control.atol[system.index]}
    if name in SCIPY_IMPLICIT:
        options["jac"] = system.jacobian
    if first:
        options["first_step"] = min(first, end - t)
    function = system.derivative if name == "scipy:LSODA" else system.trial
    return getattr(scipy_integrate, name.removeprefix("scipy:"))(function, t, y, end, **options)


def sampled(
    system: System, y: Array, samples: Samples, control: ErrorControl, report: Progress, watch: ContactWatch
) -> None:
    """Step SciPy's solver from y to the end, and fill the samples; where y restarts, so does the solver."""
    times, name, whole = samples.times, control.method, samples.states[0]
    last = float(times[-1])
    solver = _solver(system, control, y, (float(times[0]), last))
    while solver.status == "running":
        t, y, before = solver.t, solver.y, whole
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
        system.trouble = None  # it was overcome
        end = int(np.searchsorted(times, solver.t, side="right"))
        try:
            taken = _between(solver, system, times[samples.done : end], (t, before), watch)
            y, whole, anew = system.accept(float(solver.t), solver.y)
        except EomgenError as error:
            system.trouble = error
            raise system.stopped(f"{name} cannot go on", t, y) from error
        if len(taken):
            samples.take(taken)
        report(solver.t, f"t = {solver.t:.3f} s, {name}, {system.counts['steps']} steps")
        if anew and solver.status == "running":
            solver = _solver(system, control, y, (float(solver.t), last), getattr(solver, "h_abs", 0.0))


def _between(solver: Any, system: System, times: Array, begin: tuple[float, Array], watch: ContactWatch) -> Array:
    """Interpolate (q, v, z), (k, size), within the last step, which began at ``begin``; locates contacts, too."""
    if not (times.size or watch.is_needed):
        return np.empty((0, system.size))
    between = solver.dense_output()

    def at(t: float) -> Array:
        return np.asarray(system.expand(np.array([t]), between(t)[np.newaxis])[0])

    if watch.is_needed:
        watch.find(*begin, solver.t, system.expand(np.array([solver.t]), solver.y[np.newaxis])[0], at)
    return system.expand(times, between(times).T) if times.size else np.empty((0, system.size))


def tolerances(system: System, q0: Array, options: IntegratorOptions) -> Array:
    """Return absolute tolerances of (q, v, z), (size,)."""
    rtol, atol, kernel = options.rtol, options.atol, system.kernel
    sizes = np.zeros(system.size)
    if atol is None or kernel.internal_states:
        q_sizes, v_sizes = coordinate_sizes(kernel, q0)
        rates = np.minimum(rtol * v_sizes, rubbing_rates(kernel, q0))
        sizes = np.concatenate([rtol * q_sizes, rates, rtol * np.array(internal_state_sizes(kernel))])
    tolerance = sizes if atol is None else joined_tolerances(kernel.calls, atol, sizes)
    if not (np.isfinite(tolerance).all() and (tolerance >= 0.0).all()):
        raise InputError("atol: tolerances are finite and at least 0")
    return tolerance
