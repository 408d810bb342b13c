"""A compiled kernel is asked what is known of it, before it enters the cache.

Flags are only half of what decides how a compiler computes: its name may be that of a script, its specs may be changed.
So every fresh binary answers the samples of its source: in ordinary states and small ones, of denormal numbers,
infinities and what is no number.  It is loaded in a separate thread, since a library that was linked with fast
arithmetic turns denormal numbers off in the thread that loads it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..codegen.kernels.signatures import BATCHES, SINGLES
from ..codegen.samples.stored import MEASURED, STATES, UNITS, UNNAMED, read_samples
from ..errors import BuildError
from ..runtime.raw import BATCH, FFI, OneLibrary, RawFunction, RawKernel
from . import cache as store
from .load import fresh_module, keep_module

Array = NDArray[Any]


if TYPE_CHECKING:
    from ..codegen.c.source import Source
    from ..codegen.package.compile import Compiler


@dataclass(frozen=True)
class Difference:
    """A number that differs: of which function, in which state, where in its answer; and what it should be."""

    function: str
    state: str
    place: int
    actual: float
    expected: float

    def __str__(self) -> str:
        return f"{self.function} gives {self.actual!r} for {self.expected!r} at {self.place} in a state: {self.state}"


def check_package(
    package: store.Entry, source: Source, samples: bytes, compiler: Compiler, flags: Sequence[str]
) -> None:
    """Let a compiled package answer the samples of its source; it stays loaded if it does.

    Raises:
        BuildError: it does not load, or an answer is wrong; the compiler's command is named.
    """
    from ..codegen.package.compile import fuses
    from ..codegen.package.probe import refusal

    meta, expected = json.loads(source.meta), read_samples(samples)
    halves = [source.half] if source.half else list(meta["halves"])
    loaded: list[Any] = []

    def load() -> Any:
        loaded.append(fresh_module(package, source.name))
        return loaded[0]

    wrong = first_difference(load, meta, expected, bits=not fuses(flags), halves=halves)
    if wrong is not None:
        reason = f"the compiled kernels of {source.name} compute something else than their equations: {wrong}"
        raise BuildError(refusal(reason, (*compiler.command, *flags, f"{source.name}.c")))
    keep_module(package, source.name, loaded[0])


def first_difference(
    load: Callable[[], Any],
    meta: Mapping[str, Any],
    samples: Mapping[str, Array],
    bits: bool,
    halves: Sequence[str] = (SINGLES, BATCHES),
) -> Difference | None:
    """Return the first answer of a compiled module that is wrong, or None.

    Args:
        load: gives the module, with ``ffi`` and ``lib``; called in a new thread.
        meta: metadata of its package.
        samples: what it must answer.
        bits: whether the compiler may not fuse multiply-adds; then answers are equal to the bit.
        halves: of the code that the module has.
    """
    from ..codegen.package.running import in_new_thread

    def work() -> Difference | None:
        module = load()
        with np.errstate(all="ignore"):
            library = OneLibrary(module.ffi, module.lib, meta)
            return next(_Examination(library, samples, bits, halves).differences(), None)

    return in_new_thread(work)


class _Examination:
    """Asks all functions of a library; one number of every answer that is wrong is told."""

    def __init__(self, libraries: OneLibrary, samples: Mapping[str, Array], bits: bool, halves: Sequence[str]) -> None:
        self.known = {name for half in halves for name in libraries.meta["halves"][half]}
        self.libraries, self.raw, self.samples, self.bits = libraries, RawKernel(libraries), samples, bits
        self.h = self._pointer(samples["h"])
        # what rounding is to denormal numbers, and masses make more of: 1e-10 kg m^2 from force to acceleration
        self.least = 2.0**32 * float(np.finfo(self.raw.dtype).smallest_subnormal)

    def differences(self) -> Iterator[Difference]:
        """Yield all answers that are wrong."""
        yield from self._of_setup()
        for function in self.raw.functions.values():
            if function.name in self.known:
                yield from self._of_single_states(function)
            if f"{function.name}{BATCH}" in self.known:
                yield from self._of_batches(function)
        if self.raw.rollout is not None and self.raw.rollout.name in self.samples:
            yield from self._of_steps(self.raw.rollout)
        if self.raw.adaptive is not None and self.raw.adaptive.name in self.samples:
            yield from self._of_adapted_steps(self.raw.adaptive)

    def _of_setup(self) -> Iterator[Difference]:
        library = self.libraries.library("")
        for state, values in enumerate(self.samples["p"]):
            computed = library.compute(np.ascontiguousarray(values))
            yield from self._compared("setup", (state,), computed[: library.hoisted])

    def _of_single_states(self, function: RawFunction) -> Iterator[Difference]:
        status = self.samples[f"{function.name} status"]
        for state in range(len(STATES)):
            arguments = [self._pointer(self.samples[name][state]) for name in function.reads]
            for place, frame in self._frames(function):
                out = self._room(function)
                code = function.code(self.h, *arguments, *frame, self.raw.view(out))
                named = self._has_bits(function.name) and status[state] != UNNAMED
                if (code == 0) != (status[state] == 0) or (named and code != status[state]):
                    yield Difference(f"the status of {function.name}", STATES[state], 0, code, int(status[state]))
                elif code == 0 or code > self.samples["q"].shape[1]:  # a loop is open: it answers all the same
                    yield from self._compared(function.name, (state, *place), out)

    def _of_batches(self, function: RawFunction) -> Iterator[Difference]:
        """Yield states that do not fail, in one call, and those alone in which a loop is open."""
        status = self.samples[f"{function.name} status"]
        yield from self._of_batch(function, np.flatnonzero(status == 0), -1)
        for state in np.flatnonzero(status > self.samples["q"].shape[1]):
            yield from self._of_batch(function, np.array([state]), int(status[state]) - 1)

    def _of_batch(self, function: RawFunction, states: Array, expected: int) -> Iterator[Difference]:
        """Yield some states in one call, which says what is expected."""
        arguments: list[Any] = []
        for name in function.reads:
            rows = self.samples[name][states]
            arguments += [self._pointer(rows), rows.shape[1]]
        for place, frame in self._frames(function):
            out = self._room(function, states.size)
            code = function.batch(states.size, self.h, *arguments, *frame, self.raw.view(out))
            if (code == -1) != (expected == -1) or (self._has_bits(function.name) and code != expected):
                yield Difference(f"the status of {function.name}_batch", STATES[0], 0, code, expected)
            for state, row in zip(states, out.reshape(max(states.size, 1), -1), strict=False):
                yield from self._compared(function.name, (int(state), *place), row, "_batch")

    def _of_steps(self, rollout: RawFunction) -> Iterator[Difference]:
        """Yield the one step of every state by every method, for one state and as a batch of one."""
        n, dt = self.samples["q"].shape[1], float(self.samples["dt"])
        for method, state in np.ndindex(self.samples[f"{rollout.name} status"].shape):
            failing = self.samples[f"{rollout.name} status"][method, state] != 0
            q, u, effort = (_filled(self.samples[name][state]) for name in ("q", "u", "effort"))
            drive = self.libraries.library(rollout.kernel).drive(**self._drives(u, effort))
            at, v = self.raw.view(q), self._pointer(np.zeros(n))
            for suffix in ("", BATCH):
                if f"{rollout.name}{suffix}" not in self.known:
                    continue
                moved = np.zeros((2, 2 * n), self.raw.dtype)
                how = (drive, dt, 1, 1, int(method), *map(self.raw.view, moved))
                code = rollout.batch(1, self.h, at, n, v, n, *how) if suffix else rollout.code(self.h, at, v, *how)
                if (code == -1) == failing:
                    yield Difference(f"the status of {rollout.name}{suffix}", STATES[state], 0, code, -1)
                elif not failing:
                    yield from self._compared(rollout.name, (int(method), int(state)), moved[:, n:].ravel(), suffix)

    def _of_adapted_steps(self, rollout: RawFunction) -> Iterator[Difference]:
        """Take the sampled steps with error control that allows anything."""
        n, dt = self.samples["q"].shape[1], float(self.samples["dt"])
        library, view = self.libraries.library(rollout.kernel), self.raw.view
        atol = np.full(2 * n, np.finfo(self.raw.dtype).max, self.raw.dtype)
        times, NULL = FFI.from_buffer("double[]", np.array([0.0, dt])), FFI.NULL
        for method, state in np.ndindex(self.samples[f"{rollout.name} status"].shape):
            u, effort = (_filled(self.samples[name][state]) for name in ("u", "effort"))
            drive = library.drive(**self._drives(u, effort))
            allowed = library.new("tolerance", rtol=0.0, atol=view(atol), most=1)
            for suffix in ("", BATCH):
                if f"{rollout.name}{suffix}" not in self.known:
                    continue
                at = [np.array(self.samples["q"][state]), np.zeros(n, self.raw.dtype)]
                moved, progress = np.zeros((2, 2 * n), self.raw.dtype), library.new("progress", next=dt)
                how = (times, 1, int(method), *map(view, (*at, *moved)), progress)
                if suffix:
                    rollout.batch(1, NULL, self.h, 0, drive, NULL, 0, allowed, 0, *how)
                else:
                    rollout.code(self.h, drive, NULL, allowed, *how, NULL)
                taken = int(self.samples[f"{rollout.name} status"][method, state] == 0)
                if progress.steps != taken:
                    yield Difference(f"the steps of {rollout.name}{suffix}", STATES[state], 0, progress.steps, taken)
                elif taken:
                    yield from self._compared(rollout.name, (int(method), int(state)), moved[:, n:].ravel(), suffix)

    def _drives(self, u: Array, effort: Array) -> dict[str, Any]:
        """Return drives, clipped where one of them has an effort."""
        clips = {"effort": self.raw.view(effort)} if np.isfinite(effort).any() else {}
        return {"u": self.raw.view(u), **clips}

    def _frames(self, function: RawFunction) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
        """Return places of a function's answers behind that of the state, and its arguments beside arrays."""
        if not function.is_framed:
            return [((), ())]
        return [((place,), (int(number),)) for place, number in enumerate(self.samples["frames"])]

    def _room(self, function: RawFunction, states: int = 1) -> Array:
        return np.zeros(max(states * math.prod(self.raw.shapes[function.writes]), 1), self.raw.dtype)

    def _pointer(self, array: Array) -> Any:
        return self.raw.view(_filled(array.astype(self.raw.dtype, copy=False)))

    def _has_bits(self, name: str) -> bool:
        return self.bits and bool(self.samples[f"{name} bits"])

    def _compared(self, name: str, place: tuple[int, ...], answer: Array, suffix: str = "") -> Iterator[Difference]:
        """Yield the first number of an answer that is wrong; ``place`` is where it lies among the samples."""
        expected, state = self.samples[name][place], place[-1] if name.endswith("rollout") else place[0]
        yield from self._satisfied(name, state, answer, suffix)
        answer = answer[self.samples.get(f"{name} places", slice(expected.size))]
        right = (answer == expected) & (np.signbit(answer) == np.signbit(expected)) | (answer != answer) & (
            expected != expected
        )
        if not self._has_bits(name):
            if state < MEASURED:
                near = self.samples[f"{name} near"][place].astype(np.float64) + self.least
                right |= (np.abs(answer - expected) <= near) | (near == np.inf)
                # of infinite rates signs of coefficients that vanish but for rounding make infinity, or no number
                right |= ~(np.isfinite(answer) | np.isfinite(expected))
            else:
                right |= np.isfinite(answer) & np.isfinite(expected)
        if not right.all():
            at = int(np.argmin(right))
            yield Difference(name + suffix, STATES[state], at, float(answer[at]), float(expected[at]))

    def _satisfied(self, name: str, state: int, answer: Array, suffix: str) -> Iterator[Difference]:
        """Yield the first of an answer's equations that is not satisfied within round-off of its terms."""
        if state >= MEASURED or f"{name} unknown" not in self.samples:
            return
        x = answer[self.samples[f"{name} unknown"]].astype(np.float64)
        matrix, right, within = (self.samples[f"{name} {piece}"][state] for piece in ("matrix", "right", "within"))
        left, size = matrix @ x, np.abs(matrix)
        unit = UNITS * len(x) * float(np.finfo(self.raw.dtype).eps)
        least = 65536.0 * float(np.finfo(self.raw.dtype).tiny)  # masses make more of what denormal numbers lose
        terms = unit * (size @ np.abs(x) + np.abs(right)) + least * (1.0 + size.sum(axis=1)[:, np.newaxis])
        met = (np.abs(left - right) <= within + terms) | (within == np.inf)
        if not met.all():
            at = int(np.argmin(met))
            yield Difference(name + suffix, STATES[state], at, float(left.flat[at]), float(right.flat[at]))


def _filled(array: Array) -> Array:
    """Return the numbers one behind the other; one where there is none, since a pointer has to point somewhere."""
    return np.ascontiguousarray(array).ravel() if array.size else np.zeros(1, array.dtype)
