"""Integration with error control in C: samples at equal times, what the steps were, and why a motion ended early.

A generated package carries a copy of this file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import ArrayError, InputError, IntegrationStopped, LoopError
from ...names import show
from ..calls import Calls
from ..opened import stays_open
from ..pieces import OPERATIONS, ROUND, shared
from ..raw import FFI, Library, RawFunction
from .given_loads import clipped_loads, place_given, read_loads
from .loads import WORKS, LoadData, Packed, Side
from .many_steps import METHODS as FIXED
from .rollouts import (
    LONGEST,
    NUMBERS,
    SHARE,
    Given,
    Rollout,
    as_number,
    count_states,
    read_given,
    room_for,
    whole_number,
)

Array = NDArray[Any]

METHODS = {"rosenbrock": 0, "tsit5": 1}
STAGES = {"rosenbrock": 5, "tsit5": 6}  # evaluations of a step
DONE = 1  # reason to stop: all samples are there; above are the places of what stopped it
LEAST = {"float64": 1e-13, "float32": 1e-5}  # relative tolerances that round-off lets steps reach


def takes_samples(method: str, **given: Any) -> bool:
    """Whether a method of ``Kernel.rollout`` chooses its steps.

    Args:
        method: its name.
        given: dt, steps, every, duration, samples, atol, and loads and works where there are such arguments; None,
            False, or 1 of ``every``, where they are not given.

    Raises:
        InputError: there is no such method, or an argument of the others is given.
    """
    if not isinstance(method, str) or (method not in METHODS and method not in FIXED):
        raise InputError(f"rollout: method {show(method)} is unknown; allowed: {', '.join((*FIXED, *METHODS))}")
    chooses = method in METHODS
    sampled = (
        "duration, samples, tolerances, loads and works" if "loads" in given else "duration, samples and tolerances"
    )
    own, others = (sampled, "dt, steps and every")[:: 1 if chooses else -1]
    absent: dict[str, Any] = {"every": 1, "works": False}
    for name in ("dt", "steps", "every") if chooses else ("duration", "samples", "atol", "loads", "works"):
        value = given.get(name)
        if value is not None and not (name in absent and isinstance(value, int) and value == absent[name]):
            raise InputError(f"rollout: {name} is given; allowed: {own} with method={method!r}, not {others}")
    return chooses


@dataclass
class _Motion:
    """Many states on their way: pieces of work go on from where the last one ended.

    at: q and v, (states, n).
    stored: q and v, (states, samples + 1, n).
    progress: of every state, in C.
    allowed: rtol, and atol of every number, (2n,).
    turned: how joints that turn freely are turned, a row per state.
    loads: of all states, or of each; None without any.
    times: of the samples, s, (samples + 1,).
    method: its name.
    """

    calls: Calls
    function: RawFunction
    at: tuple[Array, Array]
    stored: tuple[Array, Array]
    progress: Any
    given: Given
    allowed: tuple[float, Array]
    turned: Array
    times: Array
    method: str
    loads: Packed | Side | None

    @property
    def single(self) -> bool:
        """Whether there is one state, and no batch."""
        return self.given.count is None

    def pieces(self, first: int, last: int) -> Iterator[int]:
        """Go on until these states have ended, a vector of them at a time; yields -1."""
        view, library = self.calls.raw.view, self.function.where(batch=not self.single)
        operations = max(self.function.operations, 1) * STAGES[self.method]  # none where all is prescribed
        times = FFI.from_buffer("double[]", self.times)
        pointer = self.calls.parameters.setup.pointer(library)
        rtol, atol = self.allowed
        for begin in range(first, last, ROUND):
            end = min(begin + ROUND, last)
            fields: dict[str, Any] = {}
            for name, (array, of_state, of_step) in zip(("u", "target"), self.given.drives, strict=False):
                here = view(array.reshape(-1)[begin * of_state :])
                fields |= {name: here, f"{name}_state": of_state, f"{name}_step": of_step}
            fields |= zip(("kp", "kd"), map(view, self.given.gains), strict=False)
            if self.given.effort is not None:
                fields["effort"] = view(self.given.effort)
            if self.turned.size:
                fields["turned"] = view(self.turned[begin:end].reshape(-1))
            drive = library.drive(**fields)
            most = max(OPERATIONS // (operations * (end - begin)), 1)
            allowed = library.new("tolerance", rtol=rtol, atol=view(atol), most=most)
            arrays = [view(x[begin:end]) for x in (*self.at, *self.stored)]
            how = (times, self.times.size - 1, METHODS[self.method])
            loads, apart = library.ffi.NULL, 0
            if isinstance(self.loads, Side):
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


def adaptive_rollout(
    calls: Calls,
    driven: Sequence[int],
    q0: ArrayLike,
    v0: ArrayLike,
    u: ArrayLike | None,
    duration: float | None,
    samples: int | None,
    *,
    method: str,
    rtol: float,
    atol: ArrayLike | None,
    kp: ArrayLike | None,
    kd: ArrayLike | None,
    target: ArrayLike | None,
    loads: Any = None,
    works: bool = False,
    effort: Array | None = None,
) -> Rollout:
    """Integrate with error control, as ``Kernel.rollout`` describes it.

    Args:
        calls: of the calls.
        driven: indices of the coordinates that a controller may act on.
        q0, v0, u, duration, samples, loads, works, method, rtol, atol, kp, kd, target: as of ``Kernel.rollout``.
        effort: greatest forces of drives, (n,), or none.
    """
    function = calls.raw.adaptive
    if function is None:
        raise calls.raw.missing("adaptive_rollout")
    data = read_loads(calls, {} if loads is None else loads) if works or loads is not None else None
    if data is not None:
        data = clipped_loads(calls, data, effort)
    if works and calls.raw.turning:
        raise InputError(f"rollout: works: {', '.join(calls.raw.turning)} turns freely; allowed: other joints")
    u = np.zeros(calls.n, calls.dtype) if u is None else u
    count = _count(count_states(q0=q0, v0=v0, u=u, target=target), data)
    samples = whole_number("samples", 1 if samples is None else samples, NUMBERS // (calls.n * max(count or 1, 1)))
    times = times_of_samples(duration, samples)
    allowed = tolerances(calls, rtol, atol, function.where(batch=count is not None).meta)
    given = read_given(calls, driven, samples, count, q0=q0, v0=v0, u=u, kp=kp, kd=kd, target=target, effort=effort)
    trouble = given.trouble(calls)
    if trouble is not None:
        raise trouble
    states, single = 1 if count is None else count, count is None
    at = [np.array(np.broadcast_to(x, (states, calls.n)), order="C") for x, _ in given.starts]
    room = [room_for(calls, (states, samples + 1, calls.n), "fewer samples") for _ in at]
    library = function.where(batch=not single)
    progress = library.new_array("progress", states)
    if data is not None:
        data = data[0] if isinstance(data, list) and len(data) == 1 else data
        place_given(calls, data, *at)
    worked = room_for(calls, (states, samples + 1, len(WORKS)), "fewer samples", np.float64) if works else None
    for state, rows in enumerate(worked if worked is not None else ()):
        progress[state].works = FFI.from_buffer("double[]", rows)
    motion = _Motion(
        calls,
        function,
        (at[0], at[1]),
        (room[0], room[1]),
        progress,
        given,
        allowed,
        np.zeros((states, calls.raw.turning_room), calls.dtype),
        times,
        method,
        _packed(library, calls, data, single=single, works=works),
    )
    shared(motion.pieces, states, min(calls.threads, states // SHARE))
    for state in range(states):
        if progress[state].reason != DONE:
            raise _stopped(motion, state)
    return _result(motion, worked)


def _count(count: int | None, loads: LoadData | list[LoadData] | None) -> int | None:
    """Number of states with that of their loads, if each has its own; None for a single one."""
    if not isinstance(loads, list):
        return count
    if count not in (None, 1) and len(loads) not in (1, count):
        raise ArrayError(f"rollout: {len(loads)} states in loads, but {count} in other arrays")
    return max(count or 1, len(loads))


def _packed(
    library: Library, calls: Calls, loads: LoadData | list[LoadData] | None, *, single: bool, works: bool
) -> Packed | Side | None:
    """Loads as C takes them, of a single state or of many."""
    if loads is None:
        return None
    if isinstance(loads, LoadData):
        return Packed(library, calls, loads, works=works) if single else Side(library, [calls], [loads], works=works)
    return Side(library, [calls] * len(loads), loads, works=works)


def _result(motion: _Motion, works: Array | None) -> Rollout:
    """q and v with the figures of all states, and their works, if they were integrated."""
    q, v = (x[0] if motion.single else x for x in motion.stored)
    figures: dict[str, Any] = {}
    if works is not None:
        figures["works"] = works[0] if motion.single else works
    for name in ("steps", "rejected", "largest", "smallest"):
        column = np.array([getattr(motion.progress[i], name) for i in range(len(motion.at[0]))])
        figures[name] = column[0].item() if motion.single else column
    return Rollout.of(q, v, **figures)


def length_of_time(duration: float | None) -> float:
    """Give a duration back, s; InputError of what is none."""
    found = as_number(duration)
    if not 0.0 < found <= LONGEST:
        allowed = f"a number above 0, of up to {LONGEST:g}, is allowed"
        raise InputError(f"rollout: duration = {show(duration)} is not a length of time; {allowed}")
    return found


def times_of_samples(duration: float | None, samples: int) -> Array:
    """Times of samples at equal distances, s, (samples + 1,); InputError where there is no room for them."""
    length = length_of_time(duration)
    try:
        return np.linspace(0.0, length, samples + 1)
    except MemoryError:
        size = f"{samples + 1} samples take {8e-9 * samples:.3g} GB for their times alone"
        raise InputError(f"rollout: {size}, more than there is; allowed: fewer samples") from None


def tolerances(calls: Calls, rtol: float, atol: ArrayLike | None, meta: Mapping[str, Any]) -> tuple[float, Array]:
    """rtol, and atol of every coordinate and rate, (2n,)."""
    least = LEAST[str(calls.dtype)]
    if not least <= as_number(rtol) < 1.0:
        raise InputError(f"rollout: rtol = {show(rtol)} is not allowed; a number from {least:g} to below 1 is")
    if atol is None:
        found = float(rtol) * np.array(meta["sizes"])
        for i, name in meta["rubbing"]:
            found[calls.n + i] = min(found[calls.n + i], calls.parameters[name])
        return float(rtol), found.astype(calls.dtype)
    try:
        found = np.broadcast_to(np.asarray(atol, dtype=np.float64), (2 * calls.n,)).astype(calls.dtype)
    except (ValueError, TypeError, OverflowError):
        raise ArrayError(f"rollout: atol: expected a number or ({2 * calls.n},), got {show(atol)}") from None
    if not ((found > 0.0) & (found < np.inf)).all():
        raise InputError(f"rollout: atol = {show(atol)} is not allowed; finite numbers above 0 are")
    return float(rtol), found


def _stopped(motion: _Motion, state: int) -> IntegrationStopped:
    """The error of the first state that did not get to its end; what is stored goes with it.

    Raises:
        SingularError: M cannot be inverted where it ends.
    """
    calls, progress = motion.calls, motion.progress[state]
    place = "" if motion.single else f" of state {state}"
    what, name = why_ended(calls, progress)
    q, v = (x[state].copy() for x in motion.at)
    if progress.reason - 2 < 2 * calls.n:  # a loop that stays open is the reason itself, also where it is stretched out
        _refuse_singular(calls, q)
    message = f"rollout: {what}{place}; it ends at t = {progress.t:.6g} s, after {progress.steps} steps"
    stopped = IntegrationStopped(message, progress.t, q, v, name)
    stored = motion.stored
    stopped.stored = (stored[0][0], stored[1][0]) if motion.single else (stored[0], stored[1])
    return stopped


def why_ended(calls: Calls, progress: Any) -> tuple[str, str]:
    """Why steps ended early, for a message, and the coordinate that shows it, if one does."""
    n, where = calls.n, progress.reason - 2
    if where >= 2 * n:
        return stays_open(calls.raw, where - 3 * n), ""
    name = calls.coordinates[where % n]
    what = f"{name}{' is' if where < n else chr(39) + 's rate is'}"
    return f"the error of {what} too great in steps of any length that leads on", name


def _refuse_singular(calls: Calls, q: Array) -> None:
    """SingularError where M cannot be inverted, if there are the kernels that say so."""
    still = np.zeros_like(q)
    if "forward_dynamics" in calls.raw.functions:
        with suppress(LoopError, ArrayError):
            calls.run("forward_dynamics", None, (q, still, still))
