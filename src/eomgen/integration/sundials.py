"""CVODE and IDA of SUNDIALS, through scikit-sundae, on a kernel's equations of motion.

CVODE takes y' = f(t, y), that is forward dynamics; IDA takes F(t, y, y') = 0, that is the residual, in which no mass
matrix is inverted.  Both have the exact Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import EomgenError, IntegrationError
from ..kernel.stepping.options import ErrorControl
from ..optional import optional_import
from ..progress import Progress
from .contacts import ContactWatch
from .steps import Samples
from .system import System, concerns_state

MOST_STEPS = 1_000_000  # between two samples
MOST_FAILURES = 30  # calls without a result at nearly the same time: SUNDIALS would halve its step for ever
NEAR = 1e-9  # of a time


def sundials_states(
    system: System, y: Array, samples: Samples, control: ErrorControl, report: Progress, watch: ContactWatch
) -> None:
    """Fill the samples by CVODE or IDA, from y at the first of them; where y restarts, so does the solver.

    Raises:
        IntegrationStopped: it cannot go on, with the last good state.
        InputError: scikit-sundae is not installed.
    """
    method, good, reached = control.method, y, float(samples.times[0])
    solver = _start(system, good, reached, control, watch)
    for t in samples.times[1:]:
        whole = samples.states[samples.done - 1]
        while reached < t:
            try:
                step = solver.step(float(t))
            except EomgenError as error:
                system.trouble = error
                raise system.stopped(f"{method} cannot go on", reached, good) from error
            if not (step.success and np.isfinite(step.y).all()):
                reason = str(step.message).rstrip(".").lower()
                raise system.stopped(f"{method} cannot go on: {reason}", reached, good)
            reached = float(step.t)
            good, whole, anew = system.accept(reached, np.array(step.y))
            system.trouble = None  # it was overcome
            if reached < t:  # an event stopped it
                for end in np.flatnonzero(step.i_events[-1][: len(watch)]):
                    watch.note(int(end), reached, whole, bool(step.i_events[-1][end] > 0))
            if anew:
                solver = _start(system, good, reached, control, watch)
        samples.take(whole[np.newaxis])
        report(reached, f"t = {reached:.3f} s, {method}, {system.counts['evaluations']} calls")


def _start(system: System, y0: Array, t0: float, control: ErrorControl, watch: ContactWatch) -> Any:
    with optional_import("scikit-sundae", f"method {control.method} needs"):
        from sksundae.cvode import CVODE
        from sksundae.ida import IDA
    is_ida = control.method == "IDA"
    function, jacobian, events = _ida(system, watch) if is_ida else _cvode(system, watch)
    options = {"rtol": control.rtol, "atol": control.atol, "max_num_steps": MOST_STEPS, "jacfn": jacobian}
    count = len(watch) + system.chart_events(y0).size
    if count:
        options |= {"eventsfn": events, "num_events": count}
    slopes = system.derivative(t0, y0)  # a state that cannot move is the caller's: its error comes as it is
    solver = (IDA if is_ida else CVODE)(function, **options)
    solver.init_step(t0, y0, *([slopes] if is_ida else []))
    return solver


class _Patience:
    """Fills arrays, with NaN where that is impossible, so that the solver takes a shorter step; but not for ever."""

    def __init__(self, system: System) -> None:
        self.system, self.failures, self.failed_at = system, 0, -np.inf

    def __call__(self, t: float, y: Array, compute: Callable[[], Array], out: Array) -> None:
        try:
            out[...] = compute()
            if np.isfinite(out).all():
                return
        except (ValueError, ArithmeticError) as error:
            if not concerns_state(error):
                raise
            self.system.note(error, y)
            out[...] = np.nan
        near = abs(t - self.failed_at) <= NEAR * max(abs(t), 1e-3)
        self.failures, self.failed_at = self.failures + 1 if near else 1, t
        if self.failures > MOST_FAILURES:
            trouble = self.system.trouble
            raise trouble if isinstance(trouble, EomgenError) else IntegrationError("forces are not finite there")


def _cvode(system: System, watch: ContactWatch) -> tuple[Any, Any, Any]:
    fill = _Patience(system)

    def right_side(t: float, y: Array, out: Array) -> None:
        fill(t, y, lambda: system.derivative(t, y), out)

    def jacobian(t: float, y: Array, _slopes: Array, out: Array) -> None:
        fill(t, y, lambda: system.jacobian(t, y), out)

    def events(_t: float, y: Array, out: Array) -> None:
        out[:] = np.concatenate([watch.gaps(y), system.chart_events(y)])

    return right_side, jacobian, events


def _ida(system: System, watch: ContactWatch) -> tuple[Any, Any, Any]:
    fill = _Patience(system)

    def residual(t: float, y: Array, slopes: Array, out: Array) -> None:
        fill(t, y, lambda: system.residual(t, y, slopes), out)

    def jacobian(t: float, y: Array, slopes: Array, _residual: Array, c: float, out: Array) -> None:
        fill(t, y, lambda: system.residual_jacobian(t, y, slopes, c), out)

    def events(_t: float, y: Array, _slopes: Array, out: Array) -> None:
        out[:] = np.concatenate([watch.gaps(y), system.chart_events(y)])

    return residual, jacobian, events
