"""Derivatives of a rollout's states along directions: steps in C that carry them forwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError
from ...names import listed, show
from ..calls import Calls
from ..derivatives import parameter_slots
from ..raw import FFI, Array
from .given_loads import Loads
from .gradients import WAYS, Motion, Steps, stopped, taken_steps
from .load_slopes import Acting
from .loads import ALONG
from .options import StepOptions
from .rollouts import Inputs, room_for, shape_of
from .stiff_steps import Pair, parts_of, refuse_different

MOVING = ("q", "v", "u")  # names of what directions are given of
PART = 2**14  # numbers of the steps of a part, which stay near to the processor
SHORTEST = 64  # steps of a part at least


class Directions:
    """Rates of the state at the beginning, of drives and of parameters, a row for each direction.

    Attributes:
        starts: rates of q and v, (directions, n) each.
        named: of each direction the parameter that it is of and how large that is, or None and 1.
    """

    def __init__(self, calls: Calls, motion: Motion, rows: int, along: Mapping[str, ArrayLike], slots: Sequence[int]):
        """Directions that are given, then one of each parameter.

        Args:
            motion: whose function reads them.
            rows: of drives.
            along: rates by names of MOVING.

        Raises:
            InputError: another name, or no direction.
            ArrayError: another shape.
        """
        arrays = _arrays(calls, along, rows)
        given = next(iter(arrays.values())).shape[0] if arrays else 0
        self.count = given + len(slots)
        names = list(calls.parameters)
        self._names = [f"direction {i}" for i in range(given)] + [names[slot] for slot in slots]
        if not self.count:
            raise InputError("rollout_sensitivity: no direction is given; allowed: parameters or along")
        n = calls.n
        self.starts = [np.zeros((self.count, n), calls.dtype) for _ in range(2)]
        for own, name in zip(self.starts, ("q", "v"), strict=True):
            own[:given] = arrays.get(name, 0.0)
        by_rows = "u" in arrays and arrays["u"].ndim == 3
        self._u = np.zeros((self.count, rows if by_rows else 1, n), calls.dtype)
        if "u" in arrays:
            self._u[:given] = arrays["u"].reshape(given, -1, n)
        self._parameters = np.zeros((self.count, max(len(calls.parameters), 1)), calls.dtype)
        self._parameters[range(given, self.count), list(slots)] = 1.0
        values = calls.parameters
        self.named: list[tuple[str | None, float]] = [(None, 1.0)] * given
        self.named += [(names[slot], abs(float(values[names[slot]]))) for slot in slots]
        view = calls.raw.view
        self._pointers = {"u": view(self._u), "parameters": view(self._parameters)}  # which C reads by
        steps = {"u_direction": self._u[0].size, "u_step": n if by_rows else 0}
        self.rates = motion.function.library.new("rates", **self._pointers, **steps)

    def name(self, direction: int) -> str:
        """Give a direction as messages say it: its number in ``along``, or the parameter."""
        return self._names[direction]


def rollout_sensitivity(
    calls: Calls,
    inputs: Inputs,
    options: StepOptions,
    *,
    parameters: Sequence[str],
    along: Mapping[str, ArrayLike] | None,
    loads: Loads | Sequence[Loads] | None,
    out: Sequence[Array] | None,
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return samples and their derivatives, as ``Kernel.rollout_sensitivity`` describes it."""
    slots = parameter_slots(calls.parameters, parameters)
    acting = None if loads is None else Acting(calls, "sensitivity", loads, inputs.control.effort)
    motion, times, taken = taken_steps(calls, "sensitivity", inputs, acting, options)
    rows = max(int(steps.rows[-1]) + 1 for steps in taken if steps is not None) if any(taken) else 1
    directions = Directions(calls, motion, rows, {} if along is None else along, slots)
    lead = (motion.states, times.size)
    shapes: list[tuple[int, ...]] = [(*lead, calls.n)] * 2 + [(*lead, directions.count, calls.n)] * 2
    found = [room_for(calls, shape, "fewer samples") for shape in shapes]
    for state, steps in enumerate(taken):
        own = [x[state] for x in found]
        carried = None if steps is None else _Carried(motion, state, steps, WAYS[options.method][1], directions)
        if carried is None or not carried.carry(own):
            raise stopped(calls, inputs, options, loads)
        parts = parts_of(carried.steps.stiffness)
        if parts is not None:
            carried.refuse_stiff(parts, own)
    results = [x[0] if motion.is_single else x for x in found]
    if out is not None:
        results = _written(calls, out, results)
    return (results[0], results[1]), (results[2], results[3])


class _Carried:
    """A state with its derivatives along directions; ``number`` is that of the method among those of the function."""

    def __init__(self, motion: Motion, state: int, steps: Steps, number: int, directions: Directions) -> None:
        self.motion, self.state, self.steps, self.number, self.directions = motion, state, steps, number, directions
        library = motion.function.library
        self.acts = motion.drive(library, state), motion.loads(library, state, ALONG)

    def _room(self, length: int, found: Sequence[Array]) -> list[Array]:
        """Room for q, v and their derivatives before the first of some steps and behind each; those before are set."""
        room = [np.empty((length + 1, *x.shape[1:]), self.motion.calls.dtype) for x in found]
        for own, first in zip(room, (*self.motion.start(self.state), *self.directions.starts), strict=True):
            own[0] = first
        self.motion.rest(room[2][0], room[3][0], self.state)
        return room

    def refuse_stiff(self, parts: Array, found: Sequence[Array]) -> None:
        """InputError where derivatives are not those of several steps, ``parts``, in the place of each.

        These begin where it does, so that motions that are sensitive go the same way.
        """
        steps, room, aside = self.steps, *(self._room(parts.max(), found) for _ in range(2))
        fine, finer, firsts = [np.zeros_like(x) for x in found[2:]], steps.split(parts), np.cumsum([0, *parts])
        for k, count in enumerate([*parts, 0]):
            for samples, own in zip(fine, room[2:], strict=True):
                samples[steps.told == k] = own[0]
            if count == 0:
                break
            for own, first in zip(aside, room, strict=True):
                own[0] = first[0]
            self._step(finer, firsts[k], count, room)
            self._step(steps, k, 1, aside)
            for own, end in zip(room, (*(x[1] for x in aside[:2]), *(x[count].copy() for x in room[2:])), strict=True):
                own[0] = end
        pairs = []
        for d, (name, size) in enumerate(self.directions.named):
            whole, other = (np.concatenate([x[0][:, d], x[1][:, d]]) for x in (found[2:], fine))
            pairs.append(Pair(f"direction {d}" if name is None else name, whole, other, size))
        largest = max(float(np.abs(x).max()) for x in found[:2])
        refuse_different("rollout_sensitivity", pairs, largest, [parts])

    def _step(self, steps: Steps, begin: int, count: int, room: Sequence[Array]) -> int:
        """Take so many steps from ``begin`` on, and write to the room: status of C."""
        view, function, end = self.motion.calls.raw.view, self.motion.function, begin + count
        times = FFI.from_buffer("double[]", steps.times[begin : end + 1])
        rows = FFI.from_buffer("long long[]", steps.rows[begin:end])
        along = self.directions
        given = count, view(steps.dt[begin:end]), times, rows, self.number, along.count, along.rates
        setup = self.motion.calls.parameters.setup.pointer(function.library)
        return int(function.code(setup, *self.acts, *given, *(view(x.reshape(-1)) for x in room)))

    def carry(self, found: Sequence[Array]) -> bool:
        """Take the steps part by part; False where one is not finite, or has no accelerations.

        Args:
            found: samples of q, v and their derivatives, which are written.

        Raises:
            ArrayError: a derivative is not finite, where the states are.
        """
        calls, steps = self.motion.calls, self.steps
        length = min(max(PART // (calls.n * (self.directions.count + 1)), SHORTEST), steps.dt.size)
        room = self._room(length, found)
        for begin in range(0, steps.dt.size, length):
            end = min(begin + length, steps.dt.size)
            status = self._step(steps, begin, end - begin, room)
            if status >= 0 or not all(np.isfinite(x[: end - begin + 1]).all() for x in room[:2]):
                return False
            if calls.checks:
                rates = [x[: end - begin + 1] for x in room[2:]]
                _refuse_not_finite(calls, self.directions, steps.times[begin:], rates)
            here = (steps.told >= begin) & (steps.told <= end)
            for samples, own in zip(found, room, strict=True):
                samples[here] = own[steps.told[here] - begin]
                own[0] = own[end - begin]
        return True


def _arrays(calls: Calls, along: Mapping[str, ArrayLike], rows: int) -> dict[str, Array]:
    """Rates by name, (directions, n), those of u perhaps (directions, rows, n)."""
    if not isinstance(along, Mapping):
        raise InputError(f"along: {show(along)}; allowed: arrays by {listed(MOVING)}")
    found: dict[str, Array] = {}
    for name, value in along.items():
        if name not in MOVING:
            raise InputError(f"along: {show(name)} is unknown; allowed: {listed(MOVING)}")
        inner = (rows, calls.n) if name == "u" and len(shape_of(value)) == 3 else (calls.n,)
        array, lead = calls.array(name, value, inner)
        if len(lead) != 1:
            wanted = f"(directions, {calls.n})" + (f" or (directions, {rows}, {calls.n})" if name == "u" else "")
            raise ArrayError(f"along: {name} has shape {array.shape}; expected {wanted}")
        found[name] = array
    if len({array.shape[0] for array in found.values()}) > 1:
        counts = ", ".join(f"{array.shape[0]} of {name}" for name, array in found.items())
        raise ArrayError(f"along: {counts}; expected as many directions of each")
    return found


def _refuse_not_finite(calls: Calls, directions: Directions, times: Array, rates: Sequence[Array]) -> None:
    """Name the first derivative by q or v, (states, directions, n) each, that is not finite where the states are."""
    for label, by in zip("qv", rates, strict=True):
        bad = np.argwhere(~np.isfinite(by))
        if bad.size:
            state, direction, i = (int(x) for x in bad[0])
            name = calls.coordinates[i]
            raise ArrayError(
                f"rollout_sensitivity: the derivative of {name} in {label} along {directions.name(direction)} is"
                f" {by[state, direction, i]} at t = {times[state]:.6g} s, though the motion is finite; allowed: motions"
                " with derivatives that the numbers can hold",
                name,
            )


def _written(calls: Calls, out: Sequence[Array], results: Sequence[Array]) -> list[Array]:
    """Arrays to write to, with the results."""
    if not isinstance(out, (tuple, list)) or len(out) != len(results):
        raise ArrayError(f"out: {show(out)}; expected four arrays, q, v and their derivatives")
    for own, result in zip(out, results, strict=True):
        calls.arrays.checked_out(own, result.shape, ())[...] = result
    return list(out)
