"""Many motions in C side by side, each under its input signals, parameters and tolerances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calls import Calls
from ..chunking import OPERATIONS
from ..raw import FFI, Array
from .adaptive import keep_steps
from .alternation import TRIAL, Alternation, Spent
from .input_signals import InputSignals
from .methods import ADAPTIVE, AUTO, EVALUATIONS
from .options import ErrorControl
from .packed_inputs import PackedBatch

SIDE_BY_SIDE = 16  # states of a call that go equally far: as many as the widest vector has numbers


class BatchMotion:
    """Integrate many states: each call of ``go`` leads on those that have not ended, a vector of them at a time.

    Each is moved as ``SingleMotion`` moves it alone, to the bit, whoever goes beside it.

    Args:
        calls: of kernels of one code, one for each state, with the method's kernel and what the loads ask for.
        loads: the data for each state; where they are one object, all states share it.
        q, v: the states at the first time, (states, n).
        control: the method, or AUTO: then each state has an alternation; tolerances, of which atol has a row for
            each state, (states, 2n).

    Attributes:
        samples: q and v, (2, states, T, n), as far as the states got; NaN behind.
        state: q and v that were reached, (2, states, n).
        progress: of every state, in C; its ``reason`` is DONE, or what ended it, or 0 before.
        evaluations, spans: as of ``SingleMotion``, by state.
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
        library, view, n = function.where(batch=True), raw.view, calls[0].n
        self._function, self._times, self._method = function, np.array(times, dtype=np.float64), control.method
        self.state = np.array([q, v], dtype=raw.dtype)
        self.samples = np.full((2, count, self._times.size, n), np.nan, raw.dtype)
        self.progress = library.new_array("progress", count)
        self._left = keep_steps(self.progress, calls[0], control.methods)
        self.evaluations = [0] * count
        self.spans = [dict.fromkeys(ADAPTIVE, 0.0) for _ in calls]
        self._alternations = [Alternation(control.turns) for _ in calls] if control.method == AUTO else []
        self._going = list(range(count))
        self._operations = function.operations * max(EVALUATIONS.values())
        self._h = np.array([each.parameters.setup.computed(library) for each in calls])
        self._u, self._atol = np.zeros(n, raw.dtype), np.array(control.atol, dtype=raw.dtype)
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
            turns.setdefault(self._alternations[i].method if self._alternations else self._method, []).append(i)
        for method, states in turns.items():
            self._take_steps(method, states)
        self._going = [i for i in self._going if not self.progress[i].reason]
        return bool(self._going)

    def _take_steps(self, method: str, states: list[int]) -> None:
        """Take steps of states by a method, those of a vector equally many, and count them with those rejected."""
        most = max(OPERATIONS // (self._operations * len(states)), TRIAL)
        if self._alternations:
            states.sort(key=lambda i: self._alternations[i].steps)
            for k in range(0, len(states), SIDE_BY_SIDE):
                least = min(self._alternations[states[k]].steps, most)
                for i in states[k : k + SIDE_BY_SIDE]:
                    self._allowed[i].most = least
        else:
            for i in states:
                self._allowed[i].most = most
        each, begin = [self.progress[i] for i in states], float(self._times[0])
        spent = [Spent(p, begin, self._row(i)) for i, p in zip(states, each, strict=True)]
        place = np.array(states, dtype=np.uintp)
        pointer = FFI.from_buffer("size_t[]", place)
        self._function.batch(len(states), pointer, *self._first, ADAPTIVE[method], *self._last)
        for i, before in zip(states, spent, strict=True):
            turn = before.until_now(method)
            self.evaluations[i] += turn.evaluations
            self.spans[i][method] += turn.led
            if self._alternations:
                self._alternations[i].took(turn)
                self._alternations[i].hand_over(self.progress[i], self._row(i))

    def _row(self, i: int) -> Array | None:
        """Return the row of what steps of Radau IIA leave to a state's next call."""
        return None if self._left is None else self._left[i]
