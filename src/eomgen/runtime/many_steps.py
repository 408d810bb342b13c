"""Many steps of fixed length in one call of C: shapes of drives and targets, threads, and what went wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import ArrayError, IntegrationStopped
from .calls import Calls
from .chunking import OPERATIONS, ROUND, shared
from .raw import ROLLOUT, Array, RawFunction
from .rollouts import FIXED, SHARE, FixedSteps, Inputs, Rollout, RolloutArrays, allocate_states, read_arrays

BUFFER = 2**15  # numbers of many states that are stored at once where a piece of work does not reach the end
SHORT = 1e-12  # s, in which nothing moves
FAR = 1e6  # m or rad, beyond which no robot is: the integration has failed
ADVICE = " take a shorter dt, or method='implicit' where springs are stiff"


def rollout(calls: Calls, inputs: Inputs, options: FixedSteps) -> Rollout:
    """Integrate with fixed steps, as ``Kernel.rollout`` describes it; internal states stand behind velocities."""
    calls.raw.function(ROLLOUT)  # or the error that it is not there
    count, method = inputs.count(), FIXED[options.method]
    dt, steps, every = options.fixed_steps(calls, count)
    arrays = read_arrays(calls, inputs, steps, count)
    shape = (() if count is None else (count,)) + (steps // every + 1,)
    q, v = (allocate_states(calls, (*shape, size), "a larger `every`") for size in (calls.n, calls.rates))
    result = q, v
    code = _call(calls, arrays, (dt, steps, every, method), result)
    _refuse_wrong_states(calls, options.method, result, every * dt)
    if code < 0 and all(np.isfinite(array).all() for array in result):
        figures: dict[str, Any] = {"steps": steps, "rejected": 0, "largest": dt, "smallest": dt}
        return Rollout.of(*result, **{k: x if count is None else np.full(count, x) for k, x in figures.items()})
    trouble = arrays.trouble(calls)
    if code >= 0:
        reason = code % calls.raw.statuses
        state, step = divmod(code // calls.raw.statuses, steps)
        place = f" in step {step}" + ("" if count is None else f" of state {state}")
        alone = replace(
            arrays,
            count=None if count is None else 1,  # by the same code
            starts=[(_row(x, apart, state), 0) for x, apart in arrays.starts],
            drives=[(_row(x, apart, state), 0, n) for x, apart, n in arrays.drives],
        )
        if reason >= calls.n:
            from .loop_errors import stays_open

            what = f"{stays_open(calls.raw, reason - calls.n)}{place};{ADVICE}"
            raise _stopped(calls, result, state, every * dt, 0, what, trouble)
        if trouble is None and not _begins_well(calls, alone, dt, step, method):
            raise calls.singular(ROLLOUT, reason, place, None if step else alone.starts[0][0])
        advice = _turned_about(calls, alone) or ADVICE
        what = f"no acceleration{place}, though there is one where it begins;{advice}"
        raise _stopped(calls, result, state, every * dt, reason, what, trouble)
    ok = np.isfinite(np.concatenate(result, axis=-1)).all(axis=-1).reshape(-1, steps // every + 1)
    row = int(np.where(ok.all(axis=1), ok.shape[1], ok.argmin(axis=1)).min())  # where the first one ends
    state = int((~ok[:, row]).argmax())
    bad = [~np.isfinite(array.reshape(*ok.shape, array.shape[-1])[state, row]) for array in result]
    bad[1][: calls.n] |= bad[0]
    i = int(bad[1].argmax())
    place = "" if count is None else f" of state {state}"
    advice = _turned_about(calls, arrays) or ADVICE
    what = f"{calls.rate_names[i]} is not finite after step {row * every}{place};{advice}"
    raise _stopped(calls, result, state, every * dt, i, what, trouble)


def _refuse_wrong_states(calls: Calls, method: str, result: tuple[Array, Array], apart: float) -> None:
    """Refuse explicit steps that are too long for laws with internal states: motions are then wrong, if finite.

    Args:
        apart: time between two rows of the result, s.

    Raises:
        IntegrationStopped: an internal state leaves the bounds that it cannot leave.
    """
    if not calls.internal_states:
        return
    from .internal_states import wrong_state

    q, v = result
    found = wrong_state(calls, method, v)
    if found is None:
        return
    bounds, (*lead, row, state), said = found
    good = np.logical_and.accumulate(bounds.within(v).all(axis=-1), axis=-1)
    q[~good], v[~good] = np.nan, np.nan
    place = f" of state {lead[0]}" if lead else ""
    what = f"dt is too long: at t = {row * apart:.6g} s{place} {said}"
    raise _stopped(calls, result, lead[0] if lead else 0, apart, calls.n + state, what, None)


def _turned_about(calls: Calls, arrays: RolloutArrays) -> str:
    """Say which forces are on angles of joints with 3-DOF rotation; nothing where there are none."""
    angles = [at + i for at, _ in calls.raw.turning.values() for i in range(3)]
    names = [calls.coordinates[i] for i in angles if arrays.drives[0][0].reshape(-1, calls.inputs)[:, i].any()]
    if not names:
        return ""
    return f" u on {', '.join(names)} has no finite moment where beta is at +-pi/2; allowed: 0, or forces elsewhere"


def _stopped(
    calls: Calls,
    result: tuple[Array, Array],
    state: int,
    apart: float,
    i: int,
    reason: str,
    trouble: ArrayError | None,
) -> ArrayError | IntegrationStopped:
    """Return the error of a rollout whose state of that number is not finite, with what is stored of all states.

    Args:
        apart: time between two rows of the result, s.
        i: coordinate or internal state to blame, unless an input is.
    """
    good = np.logical_and.accumulate(np.isfinite(np.concatenate(result, axis=-1)).all(axis=-1), axis=-1)
    for array in result:
        array[~good] = np.nan
    rows = int(good.reshape(-1, good.shape[-1])[state].sum())
    if rows == 0 and trouble is not None:
        return trouble  # not even the first state is one
    last = max(rows - 1, 0)
    q, v = (array.reshape(-1, *array.shape[-2:])[state, last].copy() for array in result)
    detail = f"; {trouble}" if trouble else ""
    name = (trouble.coordinate if trouble else "") or calls.rate_names[i]
    message = f"rollout: {reason}; the last good state that is stored is at t = {last * apart:.6g} s{detail}"
    stopped = IntegrationStopped(message, last * apart, q, v, name)
    stopped.stored = result
    return stopped


def _call(calls: Calls, arrays: RolloutArrays, how: tuple[float, int, int, int], result: tuple[Array, Array]) -> int:
    """Call the C for a state, or for many in threads; -1, or (state * steps + step) * statuses + i of a failure.

    Args:
        arrays: states and drives.
        how: dt, steps, every, number of the method.
        result: q and v, (rows, n) or (count, rows, n), v with internal states behind it; written.
    """
    function, count = calls.raw.rollout, arrays.count
    assert function is not None
    function.where(batch=count is not None)  # compiled before work is shared out
    stored = result if count is not None else (result[0][np.newaxis], result[1][np.newaxis])
    run = _Run(calls, function, arrays, how, stored)
    return shared(run.pieces, 1 if count is None else count, min(calls.threads, (count or 0) // SHARE))


@dataclass
class _Run:
    """A rollout as chunks of work: of many states to the end, or of few over some of the steps.

    What a chunk reaches is handed on to the next one as it is, so that the chunks change no bit.
    """

    calls: Calls
    function: RawFunction
    arrays: RolloutArrays
    how: tuple[float, int, int, int]
    stored: tuple[Array, Array]

    @property
    def single(self) -> bool:
        """Whether there is one state, and no batch."""
        return self.arrays.count is None

    def pieces(self, first: int, last: int) -> Iterator[int]:
        """Do the work on some of the states; for each piece -1, or the number of its first failure."""
        _, steps, every, _ = self.how
        vector = 1 if self.single else ROUND
        whole = OPERATIONS // (self.function.operations * steps) // vector * vector
        for begin in range(first, last, whole or vector):
            end = min(begin + (whole or vector), last)
            if whole:
                q, v = (array[begin:end] if apart else array for array, apart in self.arrays.starts)
                yield self._call((begin, end), (0, steps), every, (q, v), [x[begin:end] for x in self.stored])
            else:
                yield from self._over_steps(begin, end)

    def _over_steps(self, first: int, last: int) -> Iterator[int]:
        """Take the steps of states that take longer than one piece."""
        every, count = self.how[2], last - first
        most = max(OPERATIONS // (self.function.operations * count), 1)
        if count > 1:
            most = max(min(most, BUFFER // (count * self.calls.rates) * every), 1)
        at = [
            np.array(np.broadcast_to(x[first:last] if apart else x, (count, x.shape[-1])), order="C")
            for x, apart in self.arrays.starts
        ]
        room = [np.empty(count * (most // every + 2) * x.shape[-1], x.dtype) for x in self.stored]
        turned = np.zeros((count, self.calls.raw.turning_room), self.calls.dtype)
        for begin, end in _spans(self.how[1], every, most):
            apart = min(every, end - begin)
            rows, row, kept = (end - begin) // apart, begin // every, end // every - begin // every
            ends = [x[first:last, row : row + rows + 1] for x in self.stored]
            in_place = count == 1 and begin % every == 0 and kept == rows
            if not in_place:
                sizes = [(count, rows + 1, x.shape[-1]) for x in self.stored]
                ends = [x[: math.prod(size)].reshape(size) for x, size in zip(room, sizes, strict=True)]
            for x in () if in_place else ends:
                x.fill(np.nan)  # until it is reached
            failed = self._call((first, last), (begin, end), apart, at, ends, turned)
            if not in_place:
                for whole, chunk in zip(self.stored, ends, strict=True):
                    whole[first:last, row + (begin > 0) : row + kept + 1] = chunk[:, int(begin > 0) : kept + 1]
            yield failed
            for x, chunk in zip(at, ends, strict=True):
                x[:] = chunk[:, rows]

    def _call(
        self,
        states: tuple[int, int],
        span: tuple[int, int],
        every: int,
        at: Sequence[Array],
        ends: Sequence[Array],
        turned: Array | None = None,
    ) -> int:
        """Step some states in one call of C; return -1, or the failure's number among all states and steps.

        Args:
            states, span: the first of both, and the one behind the last.
            every: one of so many steps is stored.
            at: q and v where it begins, for one state or (states, n).
            ends: where q and v are stored, (states, rows, n).
            turned: how joints with 3-DOF rotation are turned, a row per state: zeros at first; written.
        """
        view, statuses = self.calls.raw.view, self.calls.raw.statuses
        (first, last), (begin, end) = states, span
        dt, steps, _, method = self.how
        fields = self.arrays.fields(self.calls, first, begin)
        if turned is not None and turned.size:
            fields["turned"] = view(turned.reshape(-1))
        library = self.function.where(batch=not self.single)
        pointer, drive = self.calls.parameters.setup.pointer(library), library.drive(**fields)
        how, outs = (dt, end - begin, every, method), [view(x) for x in ends]
        if self.single:
            failed = int(self.function.code(pointer, *map(view, at), drive, *how, *outs))
        else:
            apart = [x.shape[-1] if x.ndim > 1 and len(x) == last - first else 0 for x in at]
            q_and_v = [item for x, step in zip(at, apart, strict=True) for item in (view(x), step)]
            failed = int(self.function.batch(last - first, pointer, *q_and_v, drive, *how, *outs))
        if failed < 0:
            return -1
        state, rest = divmod(failed, (end - begin) * statuses)
        return ((first + state) * steps + begin) * statuses + rest


def _spans(steps: int, every: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield begin and end of chunks of steps, none with more than ``most``; they end where states are stored.

    Where these are further apart than that, parts end in between, too.
    """
    length = most // every * every
    if length:
        yield from ((begin, min(begin + length, steps)) for begin in range(0, steps, length))
        return
    for stored in range(0, steps, every):
        last = min(stored + every, steps)
        yield from ((begin, min(begin + most, last)) for begin in range(stored, last, most))


def _row(array: Array, apart: int, state: int) -> Array:
    return array[state] if apart else array


def _begins_well(calls: Calls, alone: RolloutArrays, dt: float, step: int, method: int) -> bool:
    """Whether there are accelerations at the q where a failed step begins, so that dt is to blame."""
    q, lead = alone.starts[0][0], (2,) if alone.count is None else (1, 2)
    ends = np.empty((*lead, calls.n), calls.dtype), np.empty((*lead, calls.rates), calls.dtype)
    if step > 0:
        if _call(calls, alone, (dt, step, step, method), ends) >= 0:
            return True
        q = ends[0].reshape(2, calls.n)[1].copy()
    if not (np.abs(q) < FAR).all():
        return True
    still, none = np.zeros(calls.rates, calls.dtype), np.zeros(calls.inputs, calls.dtype)
    once = min(1e-9 * dt, SHORT), 1, 1, method  # so short that all of its stages are at q
    free = RolloutArrays(alone.count, [(q, 0), (still, 0)], [(none, 0, 0)], [])
    return _call(calls, free, once, ends) < 0
