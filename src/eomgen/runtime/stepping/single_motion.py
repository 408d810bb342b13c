"""One motion in C under input signals, by one method or by automatic stiffness switching."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calls import Calls
from ..chunking import OPERATIONS
from ..raw import FFI, Array
from .adaptive import keep_steps
from .alternation import Alternation, Spent
from .input_signals import WORKS, InputSignals
from .methods import ADAPTIVE, AUTO, EVALUATIONS
from .options import ErrorControl
from .packed_inputs import PackedInputs
from .reading_inputs import check_signals

CALLS = 8  # in the time of a piece of many states: a single one is asked for its progress more often


class SingleMotion:
    """Integrate one state: each call of ``go`` leads on, to the end or until it cannot.

    Args:
        calls: of the kernel, with that of ``control`` and what the loads ask for.
        times: of the samples, s, (T,).
        q, v: the state at the first time, (n,).
        control: the method, or AUTO, and its tolerances.
        steps_kept: how many steps a call takes at most, whose ends it keeps; none are kept without.
        works: whether works are integrated, too; not where a joint has 3-DOF rotation.

    Attributes:
        samples: q and v, (2, T, n), as far as ``done`` says.
        progress: t, steps, rejected, largest, smallest, and the reason why it ended, 0 before.
        state: q and v that were reached, (2, n).
        works: of ``input_signals.WORKS``, (T, 4), J, as far as ``done`` says; None if they are not integrated.
        evaluations: of accelerations.
        spans: how much time each method led on by, s.
    """

    def __init__(
        self,
        calls: Calls,
        loads: InputSignals,
        times: Array,
        q: Array,
        v: Array,
        control: ErrorControl,
        steps_kept: int = 0,
        *,
        works: bool = False,
    ) -> None:
        function = calls.raw.function(control.kernel)
        library, view = function.library, calls.raw.view
        self._function, self._setup = function, calls.parameters.setup
        self.works = np.zeros((len(times), len(WORKS))) if works else None
        check_signals(calls, loads)
        self.loads = PackedInputs(library, calls, loads, works=works)
        self._times = np.array(times, dtype=np.float64)
        self.state = np.array([q, v], dtype=calls.dtype)
        self.samples = np.full((2, self._times.size, calls.n), np.nan, calls.dtype)
        self._atol, self._nothing = np.array(control.atol, dtype=calls.dtype), np.zeros(calls.n, calls.dtype)
        self._alternation = Alternation(control.turns) if control.method == AUTO else None
        self._method = control.method
        operations = max(function.operations, 1) * max(EVALUATIONS.values())  # none where all is prescribed
        self._most = max(OPERATIONS // CALLS // operations, 1)
        self._allowed = library.new("tolerance", rtol=control.rtol, atol=view(self._atol), most=self._most)
        self._turned = np.zeros(calls.raw.turning_room, calls.dtype)  # by which a call goes on, to the bit
        fields: dict[str, Any] = {"turned": view(self._turned)} if self._turned.size else {}
        self._drive = library.drive(u=view(self._nothing), **fields)
        self.progress = library.new("progress")
        self._left = keep_steps([self.progress], calls, control.methods)
        if self.works is not None:
            self.progress.works = FFI.from_buffer("double[]", self.works)
        self.evaluations, self.spans = 0, dict.fromkeys(ADAPTIVE, 0.0)
        self._view, self._record = view, library.ffi.NULL
        self._kept = [np.zeros(steps_kept), *(np.zeros((steps_kept, calls.n), calls.dtype) for _ in range(2))]
        if steps_kept:
            t, q_kept, v_kept = self._kept
            fields = {"t": FFI.from_buffer("double[]", t), "q": view(q_kept), "v": view(v_kept)}
            self._record = library.new("record", **fields, room=steps_kept)
        pointers = FFI.from_buffer("double[]", self._times), self._times.size - 1
        self._first = (self._setup.pointer(library), self._drive, self.loads.pointer, self._allowed, *pointers)
        self._last = (*map(view, (*self.state, *self.samples)), self.progress, self._record)

    @property
    def done(self) -> int:
        """How many samples are there."""
        return min(max(int(self.progress.sample), 1), self._times.size)

    def go(self) -> tuple[Array, Array, Array]:
        """Go on for one call; times, s, (k,), and q and v, (k, n), at the ends of its steps, if they are kept."""
        if self._record:
            self._record.count = 0
        left = self._most
        while left > 0 and not self.progress.reason and not (self._record and self._record.count == self._record.room):
            left -= max(self._steps(left), 1)
        count = int(self._record.count) if self._record else 0
        t, q, v = (x[:count].copy() for x in self._kept)
        return t, q, v

    def _steps(self, most: int) -> int:
        """Take steps, so many at most, and count them with those that were rejected."""
        method, alternation, progress = self._method, self._alternation, self.progress
        if alternation is not None:
            method, most = alternation.method, min(alternation.steps, most)
        self._allowed.most = most
        row = None if self._left is None else self._left[0]
        before = Spent(progress, self._times[0], row)
        self._function.code(*self._first, ADAPTIVE[method], *self._last)
        turn = before.until_now(method)
        self.evaluations += turn.evaluations
        self.spans[method] += turn.led
        if alternation is not None:
            alternation.took(turn)
            alternation.hand_over(progress, row)
        return turn.steps

    def works_until(self, count: int) -> Array:
        """Return works at so many samples, (count, 4), J; at those that are not there, where it got to."""
        assert self.works is not None
        works = self.works[np.minimum(np.arange(count), self.done - 1)]
        works[self.done :] = list(self.progress.work)
        return works
