"""Motions in C under input signals, one or many side by side, by one method or by automatic stiffness switching."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...runtime.calls import Calls
from ...runtime.chunking import OPERATIONS
from ...runtime.raw import FFI, Array
from .adaptive import keep_steps
from .alternation import TRIAL, Alternation, Spent
from .input_signals import WORKS, InputSignals
from .methods import ADAPTIVE, AUTO, EVALUATIONS
from .options import ErrorControl
from .packed_inputs import PackedBatch, PackedInputs
from .reading_inputs import check_signals

CALLS = 8  # in the time of a piece of many states: a single one is asked for its progress more often
SIDE_BY_SIDE = 16  # states of a call that go equally far: as many as the widest vector has numbers


class StateTurns:
    """Turns of one state: which method takes its steps, and what they took.

    Args:
        control: the method, or AUTO.
        progress: of the state, in C.
        begin: time at the first sample, s.
        row: what steps of Radau IIA leave to the next call, if they take turns.

    Attributes:
        evaluations: of accelerations.
        spans: how much time each method led on by, s.
    """

    def __init__(self, control: ErrorControl, progress: Any, begin: float, row: Array | None) -> None:
        self._alternation = Alternation(control.turns) if control.method == AUTO else None
        self._name, self._of_state = control.method, (progress, begin, row)
        self.evaluations, self.spans = 0, dict.fromkeys(ADAPTIVE, 0.0)
        self._spent: Spent | None = None

    @property
    def method(self) -> str:
        """The method that takes the next steps."""
        return self._name if self._alternation is None else self._alternation.method

    def steps(self, most: int) -> int:
        """Return how many steps the next call takes, at most so many."""
        return most if self._alternation is None else min(self._alternation.steps, most)

    def begin(self) -> None:
        """Begin a call by ``method``."""
        self._spent = Spent(*self._of_state)

    def end(self) -> int:
        """End the call: return its steps with those that were rejected; the next method may be another one."""
        assert self._spent is not None
        turn, (progress, _, row) = self._spent.until_now(self.method), self._of_state
        self.evaluations += turn.evaluations
        self.spans[self.method] += turn.led
        if self._alternation is not None:
            self._alternation.took(turn)
            self._alternation.hand_over(progress, row)
        return turn.steps


class SingleMotion:
    """Integrate one state: each call of ``go`` leads on, to the end or until it cannot.

    Args:
        calls: of the kernel, with that of ``control`` and what the loads ask for.
        times: of the samples, s, (T,).
        q, v: the state at the first time, (n,), internal states behind v; so are those of the attributes.
        control: the method, or AUTO, and its tolerances.
        steps_kept: how many steps a call takes at most, whose ends it keeps; none are kept without.
        works: whether works are integrated, too; not where a joint has 3-DOF rotation.

    Attributes:
        samples: q and v, (T, n) each, as far as ``done`` says.
        progress: t, steps, rejected, largest, smallest, and the reason why it ended, 0 before.
        state: q and v that were reached, (n,) each.
        turns: what the steps took.
        works: of ``input_signals.WORKS``, (T, 4), J, as far as ``done`` says; None if they are not integrated.
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
        self.state = tuple(np.array(x, dtype=calls.dtype) for x in (q, v))
        self.samples = tuple(np.full((self._times.size, x.size), np.nan, calls.dtype) for x in self.state)
        self._atol, self._nothing = np.array(control.atol, dtype=calls.dtype), np.zeros(calls.inputs, calls.dtype)
        operations = max(function.operations, 1) * max(EVALUATIONS.values())  # none where all is prescribed
        self._most = max(OPERATIONS // CALLS // operations, 1)
        self._allowed = library.new("tolerance", rtol=control.rtol, atol=view(self._atol), most=self._most)
        self._turned = np.zeros(calls.raw.turning_room, calls.dtype)  # by which a call goes on, to the bit
        fields: dict[str, Any] = {"turned": view(self._turned)} if self._turned.size else {}
        self._drive = library.drive(u=view(self._nothing), **fields)
        self.progress = library.new("progress")
        self._left = keep_steps([self.progress], calls, control.methods)
        self.turns = StateTurns(control, self.progress, self._times[0], None if self._left is None else self._left[0])
        if self.works is not None:
            self.progress.works = FFI.from_buffer("double[]", self.works)
        self._record = library.ffi.NULL
        self._kept = [np.zeros(steps_kept), *(np.zeros((steps_kept, x.size), calls.dtype) for x in self.state)]
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
        self._allowed.most = self.turns.steps(most)
        self.turns.begin()
        self._function.code(*self._first, ADAPTIVE[self.turns.method], *self._last)
        return self.turns.end()

    def works_until(self, count: int) -> Array:
        """Return works at so many samples, (count, 4), J; at those that are not there, where it got to."""
        assert self.works is not None
        works = self.works[np.minimum(np.arange(count), self.done - 1)]
        works[self.done :] = list(self.progress.work)
        return works


class BatchMotion:
    """Integrate many states: each call of ``go`` leads on those that have not ended, a vector of them at a time.

    Each is moved as ``SingleMotion`` moves it alone, to the bit, whoever goes beside it.

    Args:
        calls: of kernels of one code, one for each state, with the method's kernel and what the loads ask for.
        loads: the data for each state; where they are one object, all states share it.
        q, v: the states at the first time, (states, n), internal states behind v; so are those of the attributes.
        control: the method, or AUTO: then each state has an alternation; tolerances, of which atol has a row for
            each state.

    Attributes:
        samples: q and v, (states, T, n) each, as far as the states got; NaN behind.
        state: q and v that were reached, (states, n) each.
        turns: what the steps of each state took.
        progress: of every state, in C; its ``reason`` is DONE, or what ended it, or 0 before.
    """

    def __init__(
        self,
        calls: Sequence[Calls],
        loads: Sequence[InputSignals],
        times: Array,
        q: Array,
        v: Array,
        control: ErrorControl,
    ) -> None:
        raw, count = calls[0].raw, len(calls)
        function = raw.function(control.kernel)
        library, view = function.where(batch=True), raw.view
        self._function, self._times = function, np.array(times, dtype=np.float64)
        self.state = tuple(np.array(x, dtype=raw.dtype) for x in (q, v))
        lead = count, self._times.size
        self.samples = tuple(np.full((*lead, x.shape[-1]), np.nan, raw.dtype) for x in self.state)
        self.progress = library.new_array("progress", count)
        left = keep_steps(self.progress, calls[0], control.methods)
        rows = [None] * count if left is None else list(left)
        begin = float(self._times[0])
        each = zip(self.progress, rows, strict=True)
        self.turns = [StateTurns(control, progress, begin, row) for progress, row in each]
        self._going = list(range(count))
        self._operations = function.operations * max(EVALUATIONS.values())
        self._h = np.array([each.parameters.setup.computed(library) for each in calls])
        self._u, self._atol = np.zeros(calls[0].inputs, raw.dtype), np.array(control.atol, dtype=raw.dtype)
        self._loads = PackedBatch(library, calls, loads, works=False)
        self._allowed = library.new_array("tolerance", count)
        for allowed, row in zip(self._allowed, self._atol, strict=True):
            allowed.rtol, allowed.atol = control.rtol, view(row)
        of_states = view(self._h), self._h.shape[1], library.drive(u=view(self._u))
        followed = self._loads.pointer, self._loads.distance
        samples = FFI.from_buffer("double[]", self._times), self._times.size - 1
        self._first = *of_states, *followed, self._allowed, 1, *samples
        self._last = *map(view, (*self.state, *self.samples)), self.progress

    def go(self) -> bool:
        """Go on by a piece of every state that has not ended; whether one is left."""
        turns: dict[str, list[int]] = {}
        for i in self._going:
            turns.setdefault(self.turns[i].method, []).append(i)
        for method, states in turns.items():
            self._take_steps(method, states)
        self._going = [i for i in self._going if not self.progress[i].reason]
        return bool(self._going)

    def _take_steps(self, method: str, states: list[int]) -> None:
        """Take steps of states by a method, those of a vector equally many, and count them with those rejected."""
        most = max(OPERATIONS // (self._operations * len(states)), TRIAL)
        states.sort(key=lambda i: self.turns[i].steps(most))
        for k in range(0, len(states), SIDE_BY_SIDE):
            least = self.turns[states[k]].steps(most)
            for i in states[k : k + SIDE_BY_SIDE]:
                self._allowed[i].most = least
        for i in states:
            self.turns[i].begin()
        pointer = FFI.from_buffer("size_t[]", np.array(states, dtype=np.uintp))
        self._function.batch(len(states), pointer, *self._first, ADAPTIVE[method], *self._last)
        for i in states:
            self.turns[i].end()
