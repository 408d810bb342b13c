"""Integration by the C of a kernel: adaptive step size, time-signal inputs, no Python in between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..errors import EomgenError, IntegrationStopped
from ..kernel.complete import Kernel
from ..kernel.stepping.adaptive import DONE, refuse_unmoved, why_ended
from ..kernel.stepping.alternation import implicit_spans
from ..kernel.stepping.input_signals import InputSignals
from ..kernel.stepping.methods import AUTO
from ..kernel.stepping.motions import SingleMotion
from ..kernel.stepping.options import ErrorControl
from ..progress import Progress
from .contacts import ContactWatch
from .steps import Samples
from .system import System
from .until import Reached

STEP_SHARE = 0.5  # of tolerances, for each step: errors of many add up
LEAST_ATOL = 1e-30  # in place of smaller ones: numbers that stay 0 have an allowed error
KEPT = 1024  # steps of a call in which contacts are looked for


def compiled_states(
    system: System,
    loads: InputSignals,
    samples: Samples,
    control: ErrorControl,
    report: Progress,
    watch: ContactWatch,
    works: bool = False,
) -> None:
    """Fill the samples from the first of them, and ``system.loaded``, which has the drives at each.

    With ``works`` work integrals are computed, too, and ``system.worked`` has them.

    Raises:
        IntegrationStopped: the motion ends early.
        Reached: what it goes on to is there.
    """
    kernel, n, method = system.kernel, system.n, control.method
    q, v = samples.states[0, :n], samples.states[0, n:]
    kept = KEPT if watch.is_needed else 0
    control = per_step(control)
    motion = SingleMotion(kernel.calls, loads, samples.times, q, v, control, kept, works=works)
    system.worked = motion if works else None
    at, before, progress = float(samples.times[0]), samples.states[0], motion.progress
    while progress.reason == 0:
        times, q_steps, v_steps = motion.go()
        done, reached = motion.done, None
        if times.size:
            try:
                watch.find_all(np.append(at, times), np.vstack([before, np.hstack([q_steps, v_steps])]))
            except Reached as error:
                reached, done = error, int(np.searchsorted(samples.times, error.t))
            at, before = float(times[-1]), np.concatenate([q_steps[-1], v_steps[-1]])
        if done > samples.done:
            samples.take(np.hstack([x[samples.done : done] for x in motion.samples]))
        system.loaded = motion.loads
        system.counts |= {
            "steps": int(progress.steps),
            "evaluations": motion.turns.evaluations,
            "rejected": int(progress.rejected),
        }
        if method == AUTO:
            system.counts |= implicit_spans(control.turns, motion.turns.spans)
        if reached is not None:
            end = reached.exactly(lambda t0, y, t: np.concatenate(_moved(kernel, loads, (t0, t), y, control).state))
            if motion.works is not None:
                k = int(np.searchsorted(samples.times[: samples.done], end.t)) - 1
                span = float(samples.times[k]), end.t
                last = _moved(kernel, loads, span, samples.states[k], control, works=True)
                system.works_at_end = motion.works[k] + last.works_until(2)[-1]
            raise end
        report(float(progress.t), f"t = {progress.t:.3f} s, {method}, {progress.steps} steps")
    if progress.reason != DONE:
        raise _stopped(system, motion, method)


def per_step(control: ErrorControl) -> ErrorControl:
    """Return the control with tolerances of each step, of a motion that has these as a whole."""
    return replace(control, rtol=STEP_SHARE * control.rtol, atol=STEP_SHARE * np.maximum(control.atol, LEAST_ATOL))


def _moved(
    kernel: Kernel,
    loads: InputSignals,
    span: tuple[float, float],
    y: Array,
    control: ErrorControl,
    *,
    works: bool = False,
) -> SingleMotion:
    """Integrate over a span, s, from a state (q, v, z) at its beginning; return the finished motion."""
    n = kernel.n
    motion = SingleMotion(kernel.calls, loads, np.array(span), y[:n], y[n:], control, works=works)
    while not motion.progress.reason:
        motion.go()
    return motion


def _stopped(system: System, motion: SingleMotion, method: str) -> IntegrationStopped:
    """Return the error that says where and why steps ended.

    Raises:
        EomgenError: the first state cannot move.
    """
    kernel, progress = system.kernel, motion.progress
    t, (q, v) = float(progress.t), (x.copy() for x in motion.state)
    refuse_unmoved(kernel.calls, progress, kernel.name, f" at t = {t:.6g} s", q)
    what, name = why_ended(kernel.calls, progress, q)
    trouble: Exception | None = None
    try:
        u, wrench = System.drives(system, t, q, v), System.wrench(system, t, q, v)  # of described states
        if kernel.raw.has(kernel.forward_dynamics):
            velocities, z = system.apart(v)
            kernel.forward_dynamics(q, velocities, u, z, wrench=wrench)
    except (EomgenError, ValueError, ArithmeticError) as error:
        trouble = error
        if not progress.steps:
            raise
    where = f"{kernel.name}, t = {t:.6g} s: {method} cannot go on: {what}"
    stop = IntegrationStopped(f"{where}; {trouble}" if trouble else where, t, q, v, name)
    stop.__cause__ = trouble
    return stop
