"""Gradients of sums over the states of a rollout: its steps once more in C, and their adjoints backward."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError, LoopError
from ...names import listed, show
from ...runtime.calls import Calls
from ...runtime.internal_states import cut_apart, wrong_state
from ...runtime.many_steps import rollout
from ...runtime.raw import FFI, Array, Library, RawFunction
from ...runtime.rollouts import Inputs, RolloutArrays, allocate_states, read_arrays
from ..kernel_methods import KernelMethods
from ..slots import parameter_slots
from .adaptive import DONE, adaptive_rollout
from .input_signals import BACK, Slopes
from .input_slopes import DifferentiatedInputs
from .methods import ADAPTIVE, STEP_CODES
from .options import ErrorControl, InputStepOptions, StepOptions, rollout_of
from .reading_inputs import InputsLike
from .stiff_steps import Pair, refuse_different, substep_counts

Loss = Callable[[Array, Array, Array], tuple[Any, ArrayLike, ArrayLike]]

NAMES = ("q", "v", "u", "target", "kp", "kd")  # inputs that gradients are taken by
KEPT = 2**22  # numbers kept of all steps; segments of longer ones are stepped through again
SHORTEST = 256  # steps of such a segment: shorter ones would take longer in Python than in C
SEGMENT = 2**14  # coordinates of the steps of a segment where all are kept: their derivatives stay in the cache
STAYS = 2**20  # numbers of a buffer that stays for the next gradient
EXPLICIT = "tsit5"  # of the methods whose steps the error chooses, that which is not stable whatever its steps
RECORDED = 512  # ends of steps that a call tells


@dataclass(frozen=True)
class Steps:
    """Steps of a motion.

    Attributes:
        dt: their lengths, s, (steps,).
        times: where they begin, and where the last one ends, s, (steps + 1,).
        rows: of the drives that act in them, (steps,).
        sample_index: of each sample the number of steps in front of it, (samples,).
        stiffness: of each step, (steps,), as C saw it; None of methods that are stable, or whose steps are prescribed.
    """

    dt: Array
    times: Array
    rows: Array
    sample_index: Array
    stiffness: Array | None = None

    def split(self, substeps: Array) -> Steps:
        """Return the steps with each split into ``substeps`` equal ones, (steps,)."""
        firsts = np.cumsum([0, *substeps])
        within = np.arange(firsts[-1]) - np.repeat(firsts[:-1], substeps)
        share = within / np.repeat(substeps, substeps)
        times = np.repeat(self.times[:-1], substeps) + share * np.repeat(np.diff(self.times), substeps)
        dt = np.repeat((self.dt / substeps).astype(self.dt.dtype), substeps)
        return Steps(dt, np.append(times, self.times[-1]), np.repeat(self.rows, substeps), firsts[self.sample_index])


class CheckpointedTrajectory:
    """Steps of one state forward and their adjoints backward, from states kept as checkpoints.

    Args:
        method: one of STEP_CODES.
        acts: the drives and loads, for the function's library.
        slopes: sums that derivatives by them are added to.
        room: how many numbers may be kept.

    Attributes:
        is_kept: whether all states of the forward pass are kept.
    """

    def __init__(
        self,
        calls: Calls,
        function: RawFunction,
        method: str,
        acts: tuple[Any, Any],
        slopes: Any,
        steps: Steps,
        room: int,
    ) -> None:
        kind, self._number = STEP_CODES[method]
        self._calls, self._function, self._acts, self.slopes, self.steps = calls, function, acts, slopes, steps
        self._forwards = function.library.function(f"{kind}_states")
        self._kept: int = function.library.meta["kept"][function.name]  # numbers of a step, which spare work
        size, steady = len(steps.dt), max(SEGMENT // calls.rates, SHORTEST)
        self._sizes = calls.n, calls.rates
        self._state = sum(self._sizes)
        self.is_kept = size * (self._state + self._kept) <= room
        self._length = min(steady, size) if self.is_kept else max(math.isqrt(size - 1) + 1, SHORTEST)
        self._ends: list[tuple[Array, Array]] = []  # states at which segments begin

    def _begins(self) -> range:
        return range(0, len(self.steps.dt), self._length)

    def _of(self, begin: int) -> tuple[slice, Array]:
        """Return the segment that begins with this step, and a mask of its samples; the last one has the end, too."""
        end = min(begin + self._length, len(self.steps.dt))
        last = end + (end == len(self.steps.dt))
        return slice(begin, end), (self.steps.sample_index >= begin) & (self.steps.sample_index < last)

    def numbers(self) -> int:
        """Return the number of elements that it takes of a buffer."""
        size = len(self.steps.dt) if self.is_kept else self._length
        segments = len(self._begins()) if self.is_kept else 1
        return (size + segments) * self._state + size * self._kept

    def _of_buffer(self, segment: slice, buffer: Array) -> tuple[Array, Array, Array]:
        """Return views of q and v, (steps + 1, n), at the ends of a segment's steps, and of what the steps keep."""
        count, segments = segment.stop - segment.start, segment.start // self._length
        begin = (segment.start * (self._state + self._kept) + self._state * segments) if self.is_kept else 0
        ends = np.cumsum([begin, *((count + 1) * size for size in self._sizes), count * self._kept])
        q, v, kept = (buffer[i:j] for i, j in itertools.pairwise(ends.tolist()))
        return q.reshape(-1, self._sizes[0]), v.reshape(-1, self._sizes[1]), kept

    def forward(self, q: Array, v: Array, buffer: Array) -> tuple[Array, Array] | None:
        """Return q and v at the samples, (samples, n) each; None where a state is not finite, or has no accelerations.

        Args:
            buffer: ``numbers()`` elements, kept for the backward pass.
        """
        rows = self.steps.sample_index.size
        samples = tuple(np.empty((rows, size), self._calls.dtype) for size in self._sizes)
        for begin in self._begins():
            segment, here = self._of(begin)
            self._ends.append((q.copy(), v.copy()))
            states = self._run(segment, buffer, keep=self.is_kept)
            if states is None or not (np.isfinite(states[0]).all() and np.isfinite(states[1]).all()):
                return None
            for column, within in zip(samples, states, strict=False):
                column[here] = within[self.steps.sample_index[here] - begin]
            q, v = states[0][-1], states[1][-1]
        return samples[0], samples[1]

    def _run(self, segment: slice, buffer: Array, *, keep: bool) -> tuple[Array, Array, Array] | None:
        """Step through a segment: return q and v at the ends of its steps, and what they keep; None where one fails."""
        view, (q, v, kept) = self._calls.raw.view, self._of_buffer(segment, buffer)
        q[0], v[0] = self._ends[segment.start // self._length]
        status = self._forwards(*self._before(segment), view(q), view(v), view(kept) if keep else FFI.NULL)
        return (q, v, kept) if status < 0 else None

    def _before(self, segment: slice, steps: Steps | None = None) -> tuple[Any, ...]:
        """Return the first arguments of the forward and the backward function."""
        steps = self.steps if steps is None else steps
        setup, dt, rows = self._calls.parameters.setup, steps.dt[segment], steps.rows[segment]
        times = FFI.from_buffer("double[]", steps.times[segment.start : segment.stop + 1])
        pointers = self._calls.raw.view(dt), times, FFI.from_buffer("long long[]", rows)
        return setup.pointer(self._function.library), *self._acts, len(dt), *pointers, self._number

    def backward(
        self, by_q: Array, by_v: Array, buffer: Array, slopes: Any = None, substeps: Array | None = None
    ) -> tuple[Array, Array]:
        """Return derivatives by the first q and v, (n,) each; add those by drives, gains and parameters to the slopes.

        Args:
            by_q, by_v: derivatives by the samples, (samples, n).
            buffer: as ``forward`` left it.
            slopes: sums in place of those of the constructor.
            substeps: number of steps that each is split into, (steps,).
        """
        view, to = self._calls.raw.view, [np.zeros(size, self._calls.dtype) for size in self._sizes]
        adjoints = [np.empty((self._length + 1, size), self._calls.dtype) for size in self._sizes]
        for begin in reversed(self._begins()):
            segment, here = self._of(begin)
            if not self.is_kept:
                self._run(segment, buffer, keep=True)  # as in the forward pass
            by = [x[: segment.stop - segment.start + 1] for x in adjoints]
            for one, samples, end in zip(by, (by_q, by_v), to, strict=True):
                one[...] = 0.0
                one[-1] = end
                np.add.at(one, self.steps.sample_index[here] - begin, samples[here])
            states = self._of_buffer(segment, buffer)
            slopes = self.slopes if slopes is None else slopes
            if substeps is None:
                self._function.code(*self._before(segment), *map(view, (*states, *by)), slopes)
                to = [x[0].copy() for x in by]
            else:
                to = self._backward_by_substeps(segment, substeps, states[:2], by, slopes)
        return to[0], to[1]

    def _backward_by_substeps(
        self, segment: slice, substeps: Array, states: Sequence[Array], by: Sequence[Array], slopes: Any
    ) -> list[Array]:
        """Return derivatives by the state before a segment, with its steps split, see ``backward``."""
        steps, view = self.steps.split(substeps), self._calls.raw.view
        firsts = np.cumsum([0, *substeps])[segment.start : segment.stop + 1]
        q, v = (np.append(np.repeat(x[:-1], substeps[segment], axis=0), x[-1:], axis=0) for x in states)
        for k in np.flatnonzero(substeps[segment] > 1):
            begin, end = firsts[k], firsts[k + 1]
            states_within = [x[begin - firsts[0] : end - firsts[0] + 1].copy() for x in (q, v)]
            self._forwards(*self._before(slice(begin, end), steps), *map(view, states_within), FFI.NULL)
            for x, fine in zip((q, v), states_within, strict=True):  # but for the end, where the next one begins
                x[begin - firsts[0] : end - firsts[0]] = fine[:-1]
        to = [np.zeros(x.shape, self._calls.dtype) for x in (q, v)]
        for whole_by, one in zip(to, by, strict=True):
            whole_by[firsts - firsts[0]] = one
        whole = self._before(slice(firsts[0], firsts[-1]), steps)
        self._function.code(*whole, view(q), view(v), FFI.NULL, *map(view, to), slopes)
        return [x[0].copy() for x in to]


class CheckpointBuffer:
    """Memory for the checkpoints of all trajectories: those that keep all steps have one each, others share one.

    Up to ``STAYS`` numbers stay for the next gradient: memory from the operating system may take as long as the
    steps.
    """

    _left: ClassVar[list[Array]] = []

    def __init__(self, calls: Calls, trajectories: Sequence[CheckpointedTrajectory]) -> None:
        sizes = [trajectory.numbers() if trajectory.is_kept else 0 for trajectory in trajectories]
        self._starts = np.cumsum([0, *sizes]).tolist()
        self._trajectories, shared = (
            trajectories,
            max((trajectory.numbers() for trajectory in trajectories if not trajectory.is_kept), default=0),
        )
        bytes_ = (self._starts[-1] + shared) * calls.dtype.itemsize
        try:
            self._whole = self._left.pop()  # another thread may have it
        except IndexError:
            self._whole = np.empty(0, np.uint8)
        if self._whole.size < bytes_:
            self._whole = np.empty(bytes_, np.uint8)
        self._numbers: Array = self._whole[:bytes_].view(calls.dtype)

    def of(self, state: int) -> Array:
        """Return the block of a state's trajectory."""
        begin, end = self._starts[state], self._starts[state + 1]
        return self._numbers[begin:end] if self._trajectories[state].is_kept else self._numbers[self._starts[-1] :]

    def leave(self) -> None:
        """Keep the memory for the next gradient."""
        if self._whole.size <= 8 * STAYS and not self._left:
            self._left.append(self._whole)


def rollout_gradient(
    calls: Calls,
    inputs: Inputs,
    options: StepOptions,
    *,
    loss: Loss,
    parameters: Sequence[str],
    loads: InputsLike | Sequence[InputsLike] | None,
    out: Mapping[str, Array] | None,
) -> tuple[Any, dict[str, Any]]:
    """Return the gradient of a rollout, as ``Kernel.rollout_gradient`` describes it."""
    slots, method = parameter_slots(calls.parameters, parameters), options.method
    acting = None if loads is None else DifferentiatedInputs(calls, "gradient", loads, inputs.control.effort)
    motion, times, taken = taken_steps(calls, "gradient", inputs, acting, options)
    motion.write_to({} if out is None else out)

    trajectories = [motion.trajectory(method, state, steps) for state, steps in enumerate(taken) if steps is not None]
    buffer = CheckpointBuffer(calls, trajectories)
    samples = _forward_samples(motion, trajectories, times.size, buffer)
    if samples is None or wrong_state(calls, method, samples[1]) is not None:  # the rollout says why
        raise stopped(calls, inputs, options, loads)
    value, by_q, by_v = _asked(calls, loss, times, *samples, single=motion.is_single)
    substeps = [substep_counts(trajectory.steps.stiffness) for trajectory in trajectories]
    fine = motion if all(x is None for x in substeps) else motion.again()
    for state, trajectory in enumerate(trajectories):
        motion.add_start(state, trajectory.backward(by_q[state], by_v[state], buffer.of(state)))
        if fine is not motion:
            slopes = fine.trajectory(method, state, trajectory.steps).slopes
            fine.add_start(
                state, trajectory.backward(by_q[state], by_v[state], buffer.of(state), slopes, substeps[state])
            )
    buffer.leave()
    if fine is not motion:
        largest = max(float(np.abs(x).max(initial=0.0)) for x in (by_q, by_v))
        refuse_different(
            "rollout_gradient", motion.beside(fine, parameters, slots), largest, [x for x in substeps if x is not None]
        )
    gradients = motion.gradients(parameters, slots)
    if calls.checks:
        _refuse_not_finite(calls, gradients)
    return value, gradients


def _refuse_not_finite(calls: Calls, gradients: Mapping[str, Any]) -> None:
    """Name the first derivative that is not finite, where all states of the motion are."""
    loads = gradients.get("loads", {})
    each = [loads] if isinstance(loads, dict) else loads
    whole = [(name, by) for name, by in gradients.items() if name != "loads"]
    for name, by in (*whole, *(pair for by_input in each for pair in by_input.items())):
        bad = np.argwhere(~np.isfinite(by))
        if bad.size:
            place = tuple(int(i) for i in bad[0])
            is_coordinate = name in NAMES and bool(place)
            at, lead = (calls.rate_names[place[-1]], place[:-1]) if is_coordinate else ("", place)
            where = (f" at {at}" if at else "") + (f", {list(lead)}" if lead else "")
            raise ArrayError(
                f"rollout_gradient: the derivative by {name}{where} is {np.asarray(by)[place]}, though the motion is"
                " finite; allowed: motions with derivatives that the numbers can hold",
                at,
            )


def _refuse_singular(calls: Calls, q: ArrayLike, v: ArrayLike) -> None:
    """Raise SingularError for motions from singular poses of a mechanism, which implicit steps leave one way of two.

    An open state is not refused: steps close it.
    """
    if calls.raw.libraries.meta.get("constraints") and calls.raw.has(KernelMethods.forward_dynamics):
        with suppress(LoopError):
            rates, z = cut_apart(np.asarray(v), calls.n)
            none = np.zeros(calls.n, calls.dtype)
            calls.run(KernelMethods.forward_dynamics, None, (q, rates, none), z=z if calls.internal_states else None)


def taken_steps(
    calls: Calls, kind: str, inputs: Inputs, acting: DifferentiatedInputs | None, options: StepOptions
) -> tuple[Motion, Array, list[Steps | None]]:
    """Return a motion, times of its samples, s, and the steps of each state, None for one that does not reach its end.

    Args:
        kind: of the function that takes the steps, "gradient", which goes back, or "sensitivity".
    """
    function, count = _step_function(calls, options.method, kind), inputs.count()
    count = count if acting is None else acting.count(count)
    if options.is_adaptive:
        if acting is not None:
            acting.end_steps()
        times = options.times(calls, count)
        motion = _motion(calls, function, inputs, times.size - 1, count, acting)
        control = options.error_control(calls, calls.raw.function(rollout_of(options.method)).library.meta)
        return motion, times, [_chosen_steps(motion, i, times, control) for i in range(motion.states)]
    length, rows, every = options.fixed_steps(calls, count)
    motion = _motion(calls, function, inputs, rows, count, acting)
    try:
        times = length * every * np.arange(rows // every + 1)
        each = length * np.arange(rows + 1)
        same = Steps(np.full(rows, length, calls.dtype), each, np.arange(rows), np.arange(0, rows + 1, every))
    except MemoryError:
        raise InputError(f"rollout: {rows} steps are more than there is memory for; allowed: fewer steps") from None
    return motion, times, [same] * motion.states


def _motion(
    calls: Calls,
    function: RawFunction,
    inputs: Inputs,
    rows: int,
    count: int | None,
    acting: DifferentiatedInputs | None,
) -> Motion:
    """Return the motion of these inputs; SingularError if it begins in a singular pose."""
    motion = Motion(calls, function, read_arrays(calls, inputs, rows, count), acting)
    _refuse_singular(calls, inputs.q0, inputs.v0)
    return motion


def stopped(
    calls: Calls, inputs: Inputs, options: StepOptions, loads: InputsLike | Sequence[InputsLike] | None
) -> InputError:
    """Return the error of steps that do not reach their end, where the rollout does not raise its reason itself."""
    if options.is_adaptive:
        adaptive_rollout(calls, inputs, InputStepOptions(**vars(options), loads=loads))
    elif loads is None:
        rollout(calls, inputs, options)
    return InputError(f"rollout: {options.method} comes to an end that is not finite; allowed: shorter steps")


def _step_function(calls: Calls, method: str, kind: str) -> RawFunction:
    """Return the C function that takes the steps of a method.

    Raises:
        UnknownNameError: the kernel was built without it.
        InputError: the method has no derivatives, or joints have 3-DOF rotation.
    """
    if method not in STEP_CODES:
        raise InputError(f"rollout_{kind}: method {show(method)} has no derivatives; allowed: {', '.join(STEP_CODES)}")
    name = f"{STEP_CODES[method][0]}_{kind}"
    if name not in calls.raw.gradients:
        raise calls.raw.missing(name)
    if calls.raw.turning:
        joints = ", ".join(calls.raw.turning)
        raise InputError(f"rollout_{kind}: {joints} have 3-DOF rotation; allowed: robots without such joints")
    return calls.raw.gradients[name]


def _forward_samples(
    motion: Motion, trajectories: Sequence[CheckpointedTrajectory], samples: int, buffer: CheckpointBuffer
) -> tuple[Array, Array] | None:
    """Return q and v at the samples of all states, (states, samples, n) each; None where one does not reach its end."""
    calls = motion.calls
    lead = motion.states, samples
    q, v = (allocate_states(calls, (*lead, size), "fewer samples") for size in (calls.n, calls.rates))
    if len(trajectories) < motion.states:
        return None
    for state, trajectory in enumerate(trajectories):
        states = trajectory.forward(*motion.start(state), buffer.of(state))
        if states is None:
            return None
        q[state], v[state] = states
    return q, v


class Motion:
    """States and drives of a rollout, and the sums of derivatives by them."""

    def __init__(
        self, calls: Calls, function: RawFunction, arrays: RolloutArrays, acting: DifferentiatedInputs | None
    ) -> None:
        self.calls, self.function, self._arrays, self._acting = calls, function, arrays, acting
        self.states, self.is_single = 1 if arrays.count is None else arrays.count, arrays.count is None
        self._by_starts = [np.zeros_like(array) for array, _ in arrays.starts]
        self._by_drives = [np.zeros_like(array) for array, _, _ in arrays.drives]
        self._by_gains = [np.zeros_like(array) for array in arrays.gains]
        self._by_parameters = np.zeros(max(len(calls.parameters), 1), calls.dtype)
        self._pointers: list[dict[str, Any]] = []  # which C reads by, and so are kept alive
        if (trouble := arrays.trouble(calls)) is not None:
            raise trouble

    def again(self) -> Motion:
        """Return a motion of the same states and drives with sums of derivatives that begin at zero."""
        return Motion(self.calls, self.function, self._arrays, None if self._acting is None else self._acting.again())

    def start(self, state: int) -> tuple[Array, Array]:
        """Return the state at which the motion begins."""
        q, v = (x.reshape(-1, x.shape[-1])[state if apart else 0] for x, apart in self._arrays.starts)
        return (q, v) if self._acting is None else self._acting.placed(state, q, v)

    def rest(self, dq: Array, dv: Array, state: int) -> None:
        """Let rates of a state at the beginning, (directions, n) each, be zero where its motions are prescribed."""
        if self._acting is not None and self._acting.of(state).prescribed is not None:
            places = [self.calls.coordinates.index(name) for name in self.calls.prescribed]
            dq[:, places], dv[:, places] = 0.0, 0.0

    def add_start(self, state: int, by: tuple[Array, Array]) -> None:
        """Add derivatives by where a state begins."""
        if self._acting is not None:
            self._acting.back(state, *by)
        for whole, derivative, (_, apart) in zip(self._by_starts, by, self._arrays.starts, strict=True):
            whole.reshape(-1, whole.shape[-1])[state if apart else 0] += derivative

    def held(self, state: int) -> Array:
        """Return the first row of a state's u."""
        array, of_state, _ = self._arrays.drives[0]
        return array.reshape(-1)[state * of_state :][: self.calls.inputs]

    def drive(self, library: Library, state: int) -> Any:
        """Return the drives of a state, for a library."""
        self._pointers.append(self._arrays.fields(self.calls, state))
        return library.drive(**self._pointers[-1])

    def trajectory(self, method: str, state: int, steps: Steps) -> CheckpointedTrajectory:
        """Return the trajectory of a state by a method of STEP_CODES."""
        library, view = self.function.library, self.calls.raw.view
        fields: dict[str, Any] = {"parameters": view(self._by_parameters)}
        for name, array, (_, of_state, _) in zip(NAMES[2:4], self._by_drives, self._arrays.drives, strict=False):
            fields[name] = view(array.reshape(-1)[state * of_state :])
        fields |= zip(NAMES[4:], map(view, self._by_gains), strict=False)
        self._pointers.append(fields)
        if self._acting is not None:
            fields["loads"] = self._acting.slopes(library, state)
        slopes = library.new("slopes", **fields)
        acts = self.drive(library, state), self.loads(library, state, BACK)
        return CheckpointedTrajectory(self.calls, self.function, method, acts, slopes, steps, KEPT // self.states)

    def loads(self, library: Library, state: int, slopes: Slopes | None = None) -> Any:
        """Return the loads of a state, for a library, with these derivatives; NULL without any."""
        return FFI.NULL if self._acting is None else self._acting.packed(library, state, slopes)

    def gradients(self, parameters: Sequence[str], slots: Sequence[int]) -> dict[str, Any]:
        """Return derivatives by name, in the shapes of the inputs."""
        numbers = {name: float(self._by_parameters[slot]) for name, slot in zip(parameters, slots, strict=True)}
        loads = {} if self._acting is None else {"loads": self._acting.by_name()}
        return self._by_name() | loads | numbers

    def beside(self, other: Motion, parameters: Sequence[str], slots: Sequence[int]) -> Iterator[Pair]:
        """Pair derivatives of both motions by initial states, drives, gains, numbers of loads and parameters."""
        for name, whole in self._by_name().items():
            fine = other._by_name()[name]
            if name in NAMES[:2]:
                rows = zip(*(x.reshape(-1, x.shape[-1]) for x in (whole, fine)), strict=True)
                yield from (Pair(name, *row) for row in rows)
            else:
                yield Pair(name, whole, fine)
        if self._acting is not None and other._acting is not None:
            for (name, whole), (_, fine) in zip(self._acting.every(), other._acting.every(), strict=True):
                yield Pair(name, whole, fine)
        for name, slot in zip(parameters, slots, strict=True):
            size = abs(float(self.calls.parameters[name]))
            yield Pair(name, self._by_parameters[[slot]], other._by_parameters[[slot]], size)

    def write_to(self, out: Mapping[str, Array]) -> None:
        """Let derivatives by these names be written to arrays.

        Raises:
            InputError: other names, or no mapping.
            ArrayError: other shapes, or arrays that overlap an input, or each other.
        """
        known = self._by_name()
        if not isinstance(out, Mapping):
            raise InputError(f"out: {show(out)} is no mapping; allowed: arrays by {listed(known)}")
        read = [array for array, _ in self._arrays.starts] + [array for array, _, _ in self._arrays.drives]
        taken: list[Array] = [*read, *self._arrays.gains]
        for name, array in out.items():
            if name not in known:
                raise InputError(f"out: {show(name)} is unknown; allowed: {listed(known)}")
            self.calls.arrays.checked_out(array, known[name].shape, taken)[...] = 0.0
            taken.append(array)
        for whole, names in ((self._by_starts, NAMES[:2]), (self._by_drives, NAMES[2:4]), (self._by_gains, NAMES[4:])):
            whole[:] = [out.get(name, array) for name, array in zip(names, whole, strict=False)]

    def _by_name(self) -> dict[str, Array]:
        arrays = zip(NAMES[:2], self._by_starts, strict=True), zip(NAMES[2:4], self._by_drives, strict=False)
        return dict(itertools.chain(*arrays, zip(NAMES[4:], self._by_gains, strict=False)))


def _chosen_steps(motion: Motion, state: int, times: Array, control: ErrorControl) -> Steps | None:
    """Return the steps that error control chooses for a state; None where it does not reach its end."""
    calls, function = motion.calls, motion.calls.raw.function(control.kernel)
    library, view = function.library, calls.raw.view
    at = [x.copy() for x in motion.start(state)]
    stored = [np.empty((times.size, x.size), calls.dtype) for x in at]
    ends, kept = np.empty((2, RECORDED)), [np.empty((RECORDED, x.size), calls.dtype) for x in at]
    fields = {"t": FFI.from_buffer("double[]", ends[0]), "q": view(kept[0]), "v": view(kept[1])}
    if control.method == EXPLICIT:
        fields["stiffness"] = FFI.from_buffer("double[]", ends[1])
    record, progress = library.new("record", **fields, room=RECORDED), library.new("progress")
    tolerance = library.new("tolerance", rtol=control.rtol, atol=view(control.atol), most=RECORDED)
    drive, loads = motion.drive(library, state), motion.loads(library, state)
    if not drive.u_step and not drive.target_step:  # rows that change nothing: steps then end at samples
        rows = np.tile(motion.held(state), (times.size, 1))
        drive.u, drive.u_step = view(rows), calls.inputs
    where = FFI.from_buffer("double[]", times)
    recorded: list[Array] = []
    while not progress.reason:
        record.count = 0
        function.code(
            calls.parameters.setup.pointer(library),
            drive,
            loads,
            tolerance,
            where,
            times.size - 1,
            ADAPTIVE[control.method],
            *map(view, (*at, *stored)),
            progress,
            record,
        )
        recorded.append(ends[:, : record.count].copy())
    if progress.reason != DONE:
        return None
    every, stiffness = np.concatenate(recorded, axis=1)
    t = np.concatenate([times[:1], every])
    rows = np.searchsorted(times, (t[1:] + t[:-1]) / 2.0, side="right") - 1
    sample_index = np.searchsorted(t, times - 1e-9 * np.diff(t).min(initial=1.0), side="left")
    dt = np.diff(t).astype(calls.dtype)
    return Steps(dt, t, rows, sample_index, stiffness if control.method == EXPLICIT else None)


def _asked(calls: Calls, loss: Loss, times: Array, q: Array, v: Array, *, single: bool) -> tuple[Any, Array, Array]:
    """Evaluate a loss: return its value, and derivatives by q and v at all samples, (states, samples, n).

    Raises:
        InputError: it does not return three values.
        ArrayError: derivatives that are no finite numbers, or not as many as there are samples.
    """
    states = (q[0], v[0]) if single else (q, v)
    answer = loss(times.copy(), *(x.copy() for x in states))
    if not isinstance(answer, tuple) or len(answer) != 3:
        raise InputError(f"loss: it returned {show(answer)}; allowed: (value, dq, dv)")
    value, *by = answer
    derivatives = []
    for label, x, of, whole in zip(("dq", "dv"), by, states, (q, v), strict=True):
        try:
            array = np.asarray(x, dtype=calls.dtype)
        except (ValueError, TypeError):
            raise ArrayError(f"loss: {label} is {show(x)}; expected numbers of shape {of.shape}") from None
        if array.shape != of.shape:
            raise ArrayError(f"loss: {label} has shape {array.shape}; expected {of.shape}, that of {label[1]}")
        if not np.isfinite(array).all():
            raise ArrayError(f"loss: {label} has numbers that are not finite")
        derivatives.append(np.ascontiguousarray(array.reshape(whole.shape)))
    return value, derivatives[0], derivatives[1]
