"""One state on its way in C under loads that are data, by one method or by two in turn."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calls import Calls
from ..pieces import OPERATIONS
from ..raw import FFI, Array
from .adaptive import STAGES, keep_steps
from .given_loads import check_loads
from .loads import WORKS, LoadData
from .options import ADAPTIVE, ErrorControl, rollout_of
from .packed_inputs import Packed

AUTO = "auto"  # both methods in turn
COST = {"rosenbrock": 15, "tsit5": 6, "radau": 40}  # of a step, in evaluations: the former factors and solves besides
CALLS = 8  # in the time of a piece of many states: a single one is asked for its progress more often
TRIAL = 24  # steps by which a method shows what it is worth
FEW, MANY = 8, 64  # trials' lengths that the better one then goes on for, longer and longer


class Alternation:
    """Which of the two methods takes the next steps: the one that leads on further for its cost, tried now and then.

    What stiffness costs an explicit method, and accuracy an implicit one of low order, shows on the way alone; both are
    counted in steps, so that a motion is the same on every machine.

    Attributes:
        method: that takes the next steps.
        steps: how many of them.
    """

    def __init__(self) -> None:
        self.method, self.steps = "tsit5", TRIAL
        self._worth: dict[str, float] = {}
        self._taken, self._led = 0, 0.0
        self._better, self._length = "", FEW

    def took(self, steps: int, time: float) -> None:
        """Note that the method led on by a time, s, in so many steps, rejected too; choose anew at its end."""
        self._taken, self._led, self.steps = self._taken + steps, self._led + time, self.steps - steps
        if self.steps > 0:
            return
        self._worth[self.method] = self._led / (self._taken * COST[self.method])
        is_trial, self._taken, self._led = self._taken <= TRIAL, 0, 0.0
        other = "rosenbrock" if self.method == "tsit5" else "tsit5"
        if other not in self._worth or (self.method == self._better and not is_trial):
            self.method, self.steps = other, TRIAL
            return
        better = max(self._worth, key=lambda name: self._worth[name])
        self._length = min(2 * self._length, MANY) if better == self._better else FEW
        self._better = self.method = better
        self.steps = TRIAL * self._length


class Loaded:
    """One state on its way: each call of ``go`` leads on, to the end or until it cannot.

    Args:
        calls: of the kernel, with ``rollout_of`` the method and what the loads ask for.
        times: of the samples, s, (T,).
        q, v: the state at the first time, (n,).
        control: the method, or AUTO, and its tolerances.
        steps_kept: how many steps a call takes at most, whose ends it keeps; none are kept without.
        works: whether works are integrated, too; not where a joint turns freely.

    Attributes:
        samples: q and v, (2, T, n), as far as ``done`` says.
        progress: t, steps, rejected, largest, smallest, and the reason why it ended, 0 before.
        state: q and v that were reached, (2, n).
        works: of ``loads.WORKS``, (T, 4), J, as far as ``done`` says; None if they are not integrated.
        evaluations: of accelerations.
        spans: how much time each method led on by, s.
    """

    def __init__(
        self,
        calls: Calls,
        loads: LoadData,
        times: Array,
        q: Array,
        v: Array,
        control: ErrorControl,
        steps_kept: int = 0,
        *,
        works: bool = False,
    ) -> None:
        function = calls.raw.function(rollout_of(control.method))
        library, view = function.library, calls.raw.view
        self._function, self._setup = function, calls.parameters.setup
        self.works = np.zeros((len(times), len(WORKS))) if works else None
        check_loads(calls, loads)
        self.loads = Packed(library, calls, loads, works=works)
        self._times = np.array(times, dtype=np.float64)
        self.state = np.array([q, v], dtype=calls.dtype)
        self.samples = np.full((2, self._times.size, calls.n), np.nan, calls.dtype)
        self._atol, self._nothing = np.array(control.atol, dtype=calls.dtype), np.zeros(calls.n, calls.dtype)
        self._alternation, self._method = Alternation() if control.method == AUTO else None, control.method
        operations = max(function.operations, 1) * max(STAGES.values())  # none where all is prescribed
        self._most = max(OPERATIONS // CALLS // operations, 1)
        self._allowed = library.new("tolerance", rtol=control.rtol, atol=view(self._atol), most=self._most)
        self._turned = np.zeros(calls.raw.turning_room, calls.dtype)  # by which a call goes on, to the bit
        fields: dict[str, Any] = {"turned": view(self._turned)} if self._turned.size else {}
        self._drive = library.drive(u=view(self._nothing), **fields)
        self.progress = library.new("progress")
        self._left = keep_steps([self.progress], calls, control.method)
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
        before, t = progress.steps + progress.rejected, progress.t if progress.sample else self._times[0]
        self._function.code(*self._first, ADAPTIVE[method], *self._last)
        steps = int(progress.steps + progress.rejected - before)
        self.evaluations += STAGES[method] * steps
        self.spans[method] += float(progress.t - t)
        if alternation is not None:
            alternation.took(steps, float(progress.t - t))
        return steps

    def works_until(self, count: int) -> Array:
        """Works at so many samples, (count, 4), J; at those that are not there, where it got to."""
        assert self.works is not None
        found = self.works[np.minimum(np.arange(count), self.done - 1)]
        found[self.done :] = list(self.progress.work)
        return found
