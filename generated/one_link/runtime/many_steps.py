"""Many steps of fixed length in one call of C: shapes of drives and targets, threads, and what went wrong.

A generated package carries a copy of this file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError, InputError, IntegrationStopped
from .calls import Calls

Array = NDArray[Any]

METHODS = {"rk4": 0, "implicit": 1}
SHARE = 16  # states that are worth a thread of their own
FAR = 1e6  # m or rad, beyond which no robot is: the integration has failed
ADVICE = " take a shorter dt, or method='implicit' where springs are stiff"


def rollout(
    calls: Calls,
    driven: Sequence[int],
    q0: ArrayLike,
    v0: ArrayLike,
    u: ArrayLike,
    dt: float,
    steps: int,
    *,
    method: str,
    every: int,
    kp: ArrayLike | None,
    kd: ArrayLike | None,
    target: ArrayLike | None,
) -> tuple[Array, Array]:
    """Integrate with fixed steps, as ``Kernel.rollout`` describes it.

    Args:
        calls: of the calls.
        driven: indices of the coordinates that a controller may act on.
        q0, v0, u, dt, steps, method, every, kp, kd, target: as of ``Kernel.rollout``.
    """
    if calls.raw.rollout is None:
        raise calls.raw.missing("rollout")
    if method not in METHODS:
        raise InputError(f"rollout: method {method!r} is unknown; allowed: {', '.join(METHODS)}")
    steps, every = _whole("steps", steps), _whole("every", every)
    if isinstance(dt, bool) or not isinstance(dt, (int, float, np.number)) or not 0.0 < dt < math.inf:
        raise InputError(f"rollout: dt = {dt!r} is not a length of time; a finite number above 0 is allowed")
    count = _count(q0=q0, v0=v0, u=u, target=target)
    starts = [_start(calls, label, value, count) for label, value in (("q0", q0), ("v0", v0))]
    drives = [_over_time(calls, "u", u, steps, count)]
    gains = _gains(calls, driven, kp, kd)
    if (target is None) != (not gains):
        raise InputError("rollout: a controller needs a target, the coordinates that it aims at, and kp or kd")
    if target is not None:
        drives.append(_over_time(calls, "target", target, steps, count))
    shape = (() if count is None else (count,)) + (steps // every + 1, calls.n)
    result = np.full(shape, np.nan, calls.dtype), np.full(shape, np.nan, calls.dtype)
    code = _call(calls, starts, drives, gains, (float(dt), steps, every, METHODS[method]), count, result)
    if code < 0 and all(np.isfinite(array).all() for array in result):
        return result
    trouble = _not_finite(calls, starts, drives)
    if code >= 0:
        state, step = divmod(code // calls.n, steps)
        place = f" in step {step}" + ("" if count is None else f" of state {state}")
        alone = [(_row(x, apart, state), 0) for x, apart in starts]
        drives = [(_row(x, apart, state), 0, n) for x, apart, n in drives]
        if trouble is None and not _begins_well(calls, alone, drives, gains, float(dt), step, METHODS[method]):
            raise calls.singular("rollout", code % calls.n, place, None if step else alone[0][0])
        reason = f"no acceleration{place}, though there is one where it begins;{ADVICE}"
        raise _stopped(calls, result, state, every * float(dt), code % calls.n, reason, trouble)
    ok = np.isfinite(np.concatenate(result, axis=-1)).all(axis=-1).reshape(-1, steps // every + 1)
    row = int(np.where(ok.all(axis=1), ok.shape[1], ok.argmin(axis=1)).min())  # where the first one ends
    state = int((~ok[:, row]).argmax())
    bad = [~np.isfinite(array.reshape(*ok.shape, calls.n)[state, row]) for array in result]
    i = int((bad[0] | bad[1]).argmax())
    place = "" if count is None else f" of state {state}"
    reason = f"{calls.coordinates[i]} is not finite after step {row * every}{place};{ADVICE}"
    raise _stopped(calls, result, state, every * float(dt), i, reason, trouble)


def _not_finite(
    calls: Calls, starts: Sequence[tuple[Array, int]], drives: Sequence[tuple[Array, int, int]]
) -> ArrayError | None:
    """The error that names an input that is not finite (``checks`` may have let it through), or None."""
    given = [(array, 0) for array, _ in starts] + [(array, apart) for array, _, apart in drives]
    for label, (array, apart) in zip(("q0", "v0", "u", "target"), given, strict=False):
        try:
            calls.refuse_not_finite(label, array, array.shape[-2:] if apart else (calls.n,))
        except ArrayError as error:
            return error
    return None


def _stopped(
    calls: Calls,
    result: tuple[Array, Array],
    state: int,
    apart: float,
    i: int,
    reason: str,
    trouble: ArrayError | None,
) -> ArrayError | IntegrationStopped:
    """The error of a rollout whose state of that number is not finite; what is stored of all of them goes with it.

    Args:
        apart: time between two rows of the result, s.
        i: coordinate to blame, unless an input is.
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
    name = (trouble.coordinate if trouble else "") or calls.coordinates[i]
    message = f"rollout: {reason}; the last good state that is stored is at t = {last * apart:.6g} s{detail}"
    stopped = IntegrationStopped(message, last * apart, q, v, name)
    stopped.stored = result
    return stopped


def _whole(label: str, number: int) -> int:
    if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < 1:
        raise InputError(f"rollout: {label} = {number!r} is not a whole number from 1 on")
    return int(number)


def _count(**values: ArrayLike | None) -> int | None:
    """Number of states, or None for a single one: the leading axes of those that have one."""
    sizes = {}
    for label, value in values.items():
        shape = np.shape(value) if value is not None else ()
        if len(shape) == (2 if label in ("q0", "v0") else 3):
            sizes[label] = shape[0]
    if len({size for size in sizes.values() if size != 1}) > 1:
        raise ArrayError(f"rollout: {', '.join(f'{size} states in {label}' for label, size in sizes.items())}")
    return max(sizes.values()) if sizes else None


def _start(calls: Calls, label: str, value: ArrayLike, count: int | None) -> tuple[Array, int]:
    """A state or many, and how far apart two lie."""
    array, states = calls.array(label, value, (calls.n,))
    return array, calls.n if states == count and count is not None else 0


def _over_time(calls: Calls, label: str, value: ArrayLike, steps: int, count: int | None) -> tuple[Array, int, int]:
    """The value, and how far apart its numbers of two states and of two steps are."""
    n = calls.n
    if np.ndim(value) == 3:
        array, states = calls.array(label, value, (steps, n))
        if states not in (1, count):
            raise ArrayError(f"{label}: {states} states, but {count} in other arrays")
        return array, steps * n if states == count else 0, n
    if count is None and np.shape(value) == (steps, n):
        return calls.array(label, value, (steps, n))[0], 0, n
    array, rows = calls.array(label, value, (n,))
    if rows is None:
        return array, 0, 0
    if rows != (steps if count is None else count):
        wanted = f"({steps}, {n}), a row for every step" if count is None else f"({count}, {n}), a row for every state"
        raise ArrayError(f"{label}: expected {calls.dtype} of shape ({n},) or {wanted}, got shape {array.shape}")
    return (array, 0, n) if count is None else (array, n, 0)


def _gains(calls: Calls, driven: Sequence[int], kp: ArrayLike | None, kd: ArrayLike | None) -> list[Array]:
    """kp and kd, (n,) each; none where there is no controller."""
    if kp is None and kd is None:
        return []
    found = []
    for label, value in (("kp", kp), ("kd", kd)):
        given = np.zeros(calls.n, calls.dtype)
        if value is not None and np.ndim(value) == 0:
            given[list(driven)] = value
            value = given
        array, many = calls.array(label, given if value is None else value, (calls.n,))
        deviations = np.setdiff1d(np.arange(calls.n), driven)
        if many is not None or (array < 0).any():
            raise InputError(f"rollout: {label} must be one number or (n,), none below 0")
        for i in deviations[array[deviations] != 0]:
            raise InputError(
                f"rollout: {label} is {array[i]} at {calls.coordinates[i]}; only principal coordinates, or the"
                " motors in front of them, have a drive that can be controlled; none that is prescribed"
            )
        found.append(array)
    return found


def _call(
    calls: Calls,
    starts: Sequence[tuple[Array, int]],
    drives: Sequence[tuple[Array, int, int]],
    gains: Sequence[Array],
    how: tuple[float, int, int, int],
    count: int | None,
    result: tuple[Array, Array],
) -> int:
    """Call the C for a state, or for many in threads; -1, or (state * steps + step) * n + i of a failure."""
    raw, setup = calls.raw, calls.parameters.setup
    rollout, view = raw.rollout, raw.view
    assert rollout is not None

    def run(first: int, last: int) -> int:
        def part(array: Array, step: int) -> Any:
            return view(array[first:last] if step else array)

        (u, u_state, u_step), *rest = ((part(x, state), state, step) for x, state, step in drives)
        fields = {"u": u, "u_state": u_state, "u_step": u_step}
        for target, target_state, target_step in rest:
            fields.update(target=target, target_state=target_state, target_step=target_step)
        fields.update(zip(("kp", "kd"), map(view, gains), strict=False))
        drive = raw.drive(**fields)
        if count is None:
            return int(rollout.code(setup.pointer, *(view(x) for x, _ in starts), drive, *how, *map(view, result)))
        q_and_v = [item for x, step in starts for item in (part(x, step), step)]
        outs = [view(array[first:last]) for array in result]
        failed = int(rollout.batch(last - first, setup.pointer, *q_and_v, drive, *how, *outs))
        return failed + first * how[1] * calls.n if failed >= 0 else -1

    return calls.shared(run, count, SHARE)


def _row(array: Array, apart: int, state: int) -> Array:
    return array[state] if apart else array


def _begins_well(
    calls: Calls,
    starts: Sequence[tuple[Array, int]],
    drives: Sequence[tuple[Array, int, int]],
    gains: Sequence[Array],
    dt: float,
    step: int,
    method: int,
) -> bool:
    """True if there are accelerations at the q where a step that failed begins, so that dt is to blame."""
    (q, _), n = starts[0], calls.n
    if step > 0:
        ends = np.empty((2, n), calls.dtype), np.empty((2, n), calls.dtype)
        if _call(calls, starts, drives, gains, (dt, step, step, method), None, ends) >= 0:
            return True
        q = ends[0][1]
    if not (np.abs(q) < FAR).all():
        return True
    still, ends = np.zeros(n, calls.dtype), (np.empty((2, n), calls.dtype), np.empty((2, n), calls.dtype))
    once = 1e-9 * dt, 1, 1, METHODS["implicit"]  # it asks for accelerations at q alone
    return _call(calls, [(q, 0), (still, 0)], [(still, 0, 0)], (), once, None, ends) < 0
