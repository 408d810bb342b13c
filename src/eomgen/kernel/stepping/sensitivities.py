"""Derivatives of a rollout's states along directions: steps in C that carry them forwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError
from ...names import listed, show
from ...runtime.calls import Calls
from ...runtime.internal_states import wrong_state
from ...runtime.raw import FFI, Array
from ...runtime.rollouts import Inputs, allocate_states, shape_of
from ..slots import parameter_slots
from .gradients import Motion, Steps, stopped, taken_steps
from .input_signals import ALONG
from .input_slopes import DifferentiatedInputs
from .methods import STEP_CODES
from .options import StepOptions
from .reading_inputs import InputsLike
from .stiff_steps import Pair, refuse_different, substep_counts

MOVING = ("q", "v", "u")  # inputs that directions may change
SEGMENT = 2**14  # numbers of the steps of a segment, which stay near to the processor
SHORTEST = 64  # least steps of a segment


class Directions:
    """Rates of the state at the beginning, of drives and of parameters, a row for each direction.

    Attributes:
        starts: rates of q and v, (directions, n) each, those of internal states behind those of v.
        named: of each direction the parameter that it is of and how large that is, or None and 1.
    """

    def __init__(self, calls: Calls, motion: Motion, rows: int, along: Mapping[str, ArrayLike], slots: Sequence[int]):
        """Collect directions ``along``, then one of each parameter.

        Args:
            motion: whose function reads them.
            rows: of drives.
            along: rates by names of MOVING.

        Raises:
            InputError: another name, or no direction.
            ArrayError: another shape.
        """
        arrays = _arrays(calls, along, rows)
        requested = next(iter(arrays.values())).shape[0] if arrays else 0
        self.count = requested + len(slots)
        names = list(calls.parameters)
        self._names = [f"direction {i}" for i in range(requested)] + [names[slot] for slot in slots]
        if not self.count:
            raise InputError("rollout_sensitivity: there is no direction; allowed: parameters or along")
        n = calls.inputs
        self.starts = [np.zeros((self.count, size), calls.dtype) for size in (calls.n, calls.rates)]
        for start, name in zip(self.starts, ("q", "v"), strict=True):
            start[:requested] = arrays.get(name, 0.0)
        by_rows = "u" in arrays and arrays["u"].ndim == 3
        self._u = np.zeros((self.count, rows if by_rows else 1, n), calls.dtype)
        if "u" in arrays:
            self._u[:requested] = arrays["u"].reshape(requested, -1, n)
        self._parameters = np.zeros((self.count, max(len(calls.parameters), 1)), calls.dtype)
        self._parameters[range(requested, self.count), list(slots)] = 1.0
        values = calls.parameters
        self.named: list[tuple[str | None, float]] = [(None, 1.0)] * requested
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
    loads: InputsLike | Sequence[InputsLike] | None,
    out: Sequence[Array] | None,
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return samples and their derivatives, as ``Kernel.rollout_sensitivity`` describes it."""
    slots = parameter_slots(calls.parameters, parameters)
    acting = None if loads is None else DifferentiatedInputs(calls, "sensitivity", loads, inputs.control.effort)
    motion, times, taken = taken_steps(calls, "sensitivity", inputs, acting, options)
    rows = max(int(steps.rows[-1]) + 1 for steps in taken if steps is not None) if any(taken) else 1
    directions = Directions(calls, motion, rows, {} if along is None else along, slots)
    lead, sizes = (motion.states, times.size), (calls.n, calls.rates)
    shapes: list[tuple[int, ...]] = [(*lead, size) for size in sizes]
    shapes += [(*lead, directions.count, size) for size in sizes]
    samples = [allocate_states(calls, shape, "fewer samples") for shape in shapes]
    for state, steps in enumerate(taken):
        of_state = [x[state] for x in samples]
        carried = None if steps is None else _Carried(motion, state, steps, STEP_CODES[options.method][1], directions)
        if carried is None or not carried.carry(of_state):
            raise stopped(calls, inputs, options, loads)
        substeps = substep_counts(carried.steps.stiffness)
        if substeps is not None:
            carried.refuse_stiff(substeps, of_state)
    if wrong_state(calls, options.method, samples[1]) is not None:
        raise stopped(calls, inputs, options, loads)
    results = [x[0] if motion.is_single else x for x in samples]
    if out is not None:
        results = _written(calls, out, results)
    return (results[0], results[1]), (results[2], results[3])


class _Carried:
    """A state with its derivatives along directions; ``number`` is that of the method among those of the function."""

    def __init__(self, motion: Motion, state: int, steps: Steps, number: int, directions: Directions) -> None:
        self.motion, self.state, self.steps, self.number, self.directions = motion, state, steps, number, directions
        library = motion.function.library
        self.acts = motion.drive(library, state), motion.loads(library, state, ALONG)

    def _buffer(self, length: int, stored: Sequence[Array]) -> list[Array]:
        """Return arrays of q, v and their derivatives at the ends of some steps; those before the first are set."""
        buffer = [np.empty((length + 1, *x.shape[1:]), self.motion.calls.dtype) for x in stored]
        for rows, first in zip(buffer, (*self.motion.start(self.state), *self.directions.starts), strict=True):
            rows[0] = first
        self.motion.rest(buffer[2][0], buffer[3][0], self.state)
        return buffer

    def refuse_stiff(self, substeps: Array, stored: Sequence[Array]) -> None:
        """Raise InputError where derivatives are not those of several steps, ``substeps``, in the place of each.

        These begin where it does, so that sensitive motions stay the same.
        """
        steps, buffer, aside = self.steps, *(self._buffer(substeps.max(), stored) for _ in range(2))
        fine, finer, firsts = [np.zeros_like(x) for x in stored[2:]], steps.split(substeps), np.cumsum([0, *substeps])
        for k, count in enumerate([*substeps, 0]):
            for samples, rows in zip(fine, buffer[2:], strict=True):
                samples[steps.sample_index == k] = rows[0]
            if count == 0:
                break
            for rows, first in zip(aside, buffer, strict=True):
                rows[0] = first[0]
            self._step(finer, firsts[k], count, buffer)
            self._step(steps, k, 1, aside)
            for rows, end in zip(
                buffer, (*(x[1] for x in aside[:2]), *(x[count].copy() for x in buffer[2:])), strict=True
            ):
                rows[0] = end
        pairs = []
        for d, (name, size) in enumerate(self.directions.named):
            whole, other = (np.concatenate([x[0][:, d], x[1][:, d]], axis=1) for x in (stored[2:], fine))
            pairs.append(Pair(f"direction {d}" if name is None else name, whole, other, size))
        largest = max(float(np.abs(x).max()) for x in stored[:2])
        refuse_different("rollout_sensitivity", pairs, largest, [substeps])

    def _step(self, steps: Steps, begin: int, count: int, buffer: Sequence[Array]) -> int:
        """Take so many steps from ``begin`` on, and write to the buffer: status of C."""
        view, function, end = self.motion.calls.raw.view, self.motion.function, begin + count
        times = FFI.from_buffer("double[]", steps.times[begin : end + 1])
        rows = FFI.from_buffer("long long[]", steps.rows[begin:end])
        along = self.directions
        arguments = count, view(steps.dt[begin:end]), times, rows, self.number, along.count, along.rates
        setup = self.motion.calls.parameters.setup.pointer(function.library)
        return int(function.code(setup, *self.acts, *arguments, *(view(x.reshape(-1)) for x in buffer)))

    def carry(self, stored: Sequence[Array]) -> bool:
        """Take the steps segment by segment; False where one is not finite, or has no accelerations.

        Args:
            stored: samples of q, v and their derivatives, which are written.

        Raises:
            ArrayError: a derivative is not finite, where the states are.
        """
        calls, steps = self.motion.calls, self.steps
        length = min(max(SEGMENT // (calls.rates * (self.directions.count + 1)), SHORTEST), steps.dt.size)
        buffer = self._buffer(length, stored)
        for begin in range(0, steps.dt.size, length):
            end = min(begin + length, steps.dt.size)
            status = self._step(steps, begin, end - begin, buffer)
            if status >= 0 or not all(np.isfinite(x[: end - begin + 1]).all() for x in buffer[:2]):
                return False
            if calls.checks:
                rates = [x[: end - begin + 1] for x in buffer[2:]]
                _refuse_not_finite(calls, self.directions, steps.times[begin:], rates)
            here = (steps.sample_index >= begin) & (steps.sample_index <= end)
            for samples, rows in zip(stored, buffer, strict=True):
                samples[here] = rows[steps.sample_index[here] - begin]
                rows[0] = rows[end - begin]
        return True


def _arrays(calls: Calls, along: Mapping[str, ArrayLike], rows: int) -> dict[str, Array]:
    """Return rates by name, (directions, n), those of u perhaps (directions, rows, n)."""
    if not isinstance(along, Mapping):
        raise InputError(f"along: {show(along)}; allowed: arrays by {listed(MOVING)}")
    rates: dict[str, Array] = {}
    for name, value in along.items():
        if name not in MOVING:
            raise InputError(f"along: {show(name)} is unknown; allowed: {listed(MOVING)}")
        n = {"q": calls.n, "v": calls.rates, "u": calls.inputs}[name]
        inner = (rows, n) if name == "u" and len(shape_of(value)) == 3 else (n,)
        array, lead = calls.array(name, value, inner)
        if len(lead) != 1:
            wanted = f"(directions, {n})" + (f" or (directions, {rows}, {n})" if name == "u" else "")
            raise ArrayError(f"along: {name} has shape {array.shape}; expected {wanted}")
        rates[name] = array
    if len({array.shape[0] for array in rates.values()}) > 1:
        counts = ", ".join(f"{array.shape[0]} of {name}" for name, array in rates.items())
        raise ArrayError(f"along: {counts}; expected as many directions of each")
    return rates


def _refuse_not_finite(calls: Calls, directions: Directions, times: Array, rates: Sequence[Array]) -> None:
    """Name the first derivative by q or v, (states, directions, n) each, that is not finite where the states are."""
    for label, by in zip("qv", rates, strict=True):
        bad = np.argwhere(~np.isfinite(by))
        if bad.size:
            state, direction, i = (int(x) for x in bad[0])
            name = calls.rate_names[i]
            raise ArrayError(
                f"rollout_sensitivity: the derivative of {name} in {label} along {directions.name(direction)} is"
                f" {by[state, direction, i]} at t = {times[state]:.6g} s, though the motion is finite; allowed: motions"
                " with derivatives that the numbers can hold",
                name,
            )


def _written(calls: Calls, out: Sequence[Array], results: Sequence[Array]) -> list[Array]:
    """Return arrays to write to, with the results."""
    if not isinstance(out, (tuple, list)) or len(out) != len(results):
        raise ArrayError(f"out: {show(out)}; expected four arrays, q, v and their derivatives")
    for array, result in zip(out, results, strict=True):
        calls.arrays.checked_out(array, result.shape, ())[...] = result
    return list(out)
