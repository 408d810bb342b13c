"""Integration with error control in C: samples at equal times, what the steps were, and why a motion ended early."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError, IntegrationStopped
from ...runtime.calls import Calls
from ...runtime.chunking import OPERATIONS, ROUND, shared
from ...runtime.loop_errors import stays_open
from ...runtime.raw import FFI, Array, Library, RawFunction
from ...runtime.rollouts import SHARE, Inputs, Rollout, RolloutArrays, allocate_states, read_arrays
from ..kernel_methods import KernelFunctions
from ..loop_assembly import OPEN
from .input_signals import WORKS, InputSignals
from .methods import ADAPTIVE, EVALUATIONS, RADAU
from .options import ErrorControl, InputStepOptions, rollout_of
from .packed_inputs import PackedBatch, PackedInputs
from .reading_inputs import clipped_signals, count_of, place_prescribed, read_signals

KEPT_COLUMNS, KEPT_NUMBERS = 14, 6  # EOM_KEPT_ROOM of the C library
DONE = 1  # reason to stop: all samples are there; above are the places of what stopped it


@dataclass
class _Motion:
    """Many states under integration: chunks of work go on from where the last one ended.

    at: q and v, (states, n), internal states behind v.
    stored: q and v, (states, samples + 1, n), likewise.
    progress: of every state, in C.
    control: the method and its tolerances.
    turned: how joints with 3-DOF rotation are turned, a row per state.
    loads: of all states, or of each; None without any.
    times: of the samples, s, (samples + 1,).
    left: room of ``keep_steps``.
    """

    calls: Calls
    function: RawFunction
    at: Sequence[Array]
    stored: Sequence[Array]
    progress: Any
    arrays: RolloutArrays
    control: ErrorControl
    turned: Array
    times: Array
    loads: PackedInputs | PackedBatch | None
    left: Array | None

    @property
    def single(self) -> bool:
        """Whether there is one state, and no batch."""
        return self.arrays.count is None

    def pieces(self, first: int, last: int) -> Iterator[int]:
        """Go on until these states have ended, a vector of them at a time; yields -1."""
        view, library = self.calls.raw.view, self.function.where(batch=not self.single)
        operations = max(self.function.operations, 1) * EVALUATIONS[self.control.method]  # none where all is prescribed
        times = FFI.from_buffer("double[]", self.times)
        pointer = self.calls.parameters.setup.pointer(library)
        rtol, atol = self.control.rtol, self.control.atol
        for begin in range(first, last, ROUND):
            end = min(begin + ROUND, last)
            fields = self.arrays.fields(self.calls, begin)
            if self.turned.size:
                fields["turned"] = view(self.turned[begin:end].reshape(-1))
            drive = library.drive(**fields)
            most = max(OPERATIONS // (operations * (end - begin)), 1)
            allowed = library.new("tolerance", rtol=rtol, atol=view(atol), most=most)
            arrays = [view(x[begin:end]) for x in (*self.at, *self.stored)]
            how = (times, self.times.size - 1, ADAPTIVE[self.control.method])
            loads, apart = library.ffi.NULL, 0
            if isinstance(self.loads, PackedBatch):
                apart = self.loads.distance
                loads = self.loads.pointer + begin * apart
            elif self.loads is not None:
                loads = self.loads.pointer
            rest = (*how, *arrays, self.progress + begin)
            while any(self.progress[i].reason == 0 for i in range(begin, end)):
                if self.single:
                    self.function.code(pointer, drive, loads, allowed, *rest, library.ffi.NULL)
                else:
                    of_states = pointer, 0, drive, loads, apart, allowed, 0  # h and tolerances are those of all
                    self.function.batch(end - begin, library.ffi.NULL, *of_states, *rest)
                yield -1


def adaptive_rollout(calls: Calls, inputs: Inputs, options: InputStepOptions) -> Rollout:
    """Integrate with error control, as ``Kernel.rollout`` describes it."""
    function, loads, works = calls.raw.function(rollout_of(options.method)), options.loads, options.works
    data = read_signals(calls, {} if loads is None else loads) if works or loads is not None else None
    if data is not None:
        data = clipped_signals(calls, data, inputs.control.effort)
    if works and calls.raw.turning:
        raise InputError(f"rollout: works: {', '.join(calls.raw.turning)} has 3-DOF rotation; allowed: other joints")
    count = count_of(inputs.count(), data)
    times = options.times(calls, count)
    control = options.error_control(calls, function.where(batch=count is not None).meta)
    arrays, samples = read_arrays(calls, inputs, times.size - 1, count), times.size - 1
    trouble = arrays.trouble(calls)
    if trouble is not None:
        raise trouble
    states, single = 1 if count is None else count, count is None
    at = [np.array(np.broadcast_to(x, (states, x.shape[-1])), order="C") for x, _ in arrays.starts]
    room = [allocate_states(calls, (states, samples + 1, x.shape[-1]), "fewer samples") for x in at]
    library = function.where(batch=not single)
    progress = library.new_array("progress", states)
    if data is not None:
        data = data[0] if isinstance(data, list) and len(data) == 1 else data
        place_prescribed(calls, data, *at)
    worked = allocate_states(calls, (states, samples + 1, len(WORKS)), "fewer samples", np.float64) if works else None
    for state, rows in enumerate(worked if worked is not None else ()):
        progress[state].works = FFI.from_buffer("double[]", rows)
    turned = np.zeros((states, calls.raw.turning_room), calls.dtype)
    left = keep_steps(progress, calls, control.methods)
    packed = _packed(library, calls, data, single=single, works=works)
    motion = _Motion(calls, function, at, room, progress, arrays, control, turned, times, packed, left)
    shared(motion.pieces, states, min(calls.threads, states // SHARE))
    for state in range(states):
        if progress[state].reason != DONE:
            raise _stopped(motion, state)
    return _result(motion, worked)


def keep_steps(progress: Any, calls: Calls, methods: Sequence[str]) -> Array | None:
    """Allocate what steps of Radau IIA leave to the next call, a row per state, to be kept as long."""
    if RADAU not in methods:
        return None
    kept = np.zeros((len(progress), KEPT_COLUMNS * calls.rates + KEPT_NUMBERS))
    for state, row in zip(progress, kept, strict=True):
        state.kept = FFI.from_buffer("double[]", row)
    return kept


def _packed(
    library: Library, calls: Calls, loads: InputSignals | list[InputSignals] | None, *, single: bool, works: bool
) -> PackedInputs | PackedBatch | None:
    """Pack loads for C, of a single state or of many."""
    if loads is None:
        return None
    each = [loads] if isinstance(loads, InputSignals) else loads
    if single:
        return PackedInputs(library, calls, each[0], works=works)
    return PackedBatch(library, [calls] * len(each), each, works=works)


def _result(motion: _Motion, works: Array | None) -> Rollout:
    """Return q and v with the figures of all states, and their works, if they were integrated."""
    q, v = (x[0] if motion.single else x for x in motion.stored)
    figures: dict[str, Any] = {}
    if works is not None:
        figures["works"] = works[0] if motion.single else works
    for name in ("steps", "rejected", "largest", "smallest"):
        column = np.array([getattr(motion.progress[i], name) for i in range(len(motion.at[0]))])
        figures[name] = column[0].item() if motion.single else column
    return Rollout.of(q, v, **figures)


def _stopped(motion: _Motion, state: int) -> IntegrationStopped:
    """Return the error of the first state that did not get to its end; what is stored goes with it.

    Raises:
        SingularError: M cannot be inverted where it begins.
    """
    calls, progress = motion.calls, motion.progress[state]
    place = "" if motion.single else f" of state {state}"
    q, v = (x[state].copy() for x in motion.at)
    refuse_unmoved(calls, progress, "rollout", "" if motion.single else f" in state {state}", q)
    what, name = why_ended(calls, progress, q)
    message = f"rollout: {what}{place}; it ends at t = {progress.t:.6g} s, after {progress.steps} steps"
    stopped = IntegrationStopped(message, progress.t, q, v, name)
    stored = motion.stored
    stopped.stored = (stored[0][0], stored[1][0]) if motion.single else (stored[0], stored[1])
    return stopped


def refuse_unmoved(calls: Calls, progress: Any, name: str, place: str, q: Array) -> None:
    """Raise SingularError where not even the first step has accelerations.

    Args:
        name, place: of the motion, for the message.
        q: where it begins, (n,).
    """
    pivot = _end_of(calls, progress, q) - calls.n - calls.rates
    if 0 <= pivot < calls.n and not progress.steps:
        raise calls.singular(name, pivot, place, q)


def _end_of(calls: Calls, progress: Any, q: Array) -> int:
    """Return the place of what ended steps at q, (n,): of an open state its loop, whatever is singular there.

    Places are those of numbers of the state, then of coordinates without accelerations, then of constraints.
    """
    n, where, state = calls.n, int(progress.reason) - 2, calls.n + calls.rates
    if state <= where < state + n and calls.raw.has(KernelFunctions.constraint):
        violations = np.abs(calls.run(KernelFunctions.constraint, None, (q,)))
        if violations.max() > OPEN[calls.dtype.itemsize]:
            return state + n + int(violations.argmax())
    return where


def why_ended(calls: Calls, progress: Any, q: Array) -> tuple[str, str]:
    """Return why steps ended early at q, (n,), for a message, and the coordinate that shows it, if one does."""
    n, where, state = calls.n, _end_of(calls, progress, q), calls.n + calls.rates
    if where >= state + n:
        return stays_open(calls.raw, where - state - n), ""
    if where >= state:
        reason = calls.why_singular(where - state, "", q)
        return f"no step is short enough: {reason}", calls.coordinates[where - state]
    name = calls.rate_names[where if where < n else where - n]
    what = f"{name}{' is' if where < n else chr(39) + 's rate is'}"
    return f"the error of {what} too great in steps of any length that leads on", name
