"""Check of a freshly compiled package against its equations, before it enters the cache.

Flags do not say everything about a compiler: its name may be that of a script.  So every function is called in two
random states, alone and in a batch that fills all lanes of vectors, and compared with what the programs evaluate to
(``codegen/c/expected.py``), within their rounding errors.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..codegen.c.expected import FAILS, ITERATED, PASSES, ROUNDING, STATES, STEP, read_expected, within
from ..codegen.kernels.signatures import BATCHES, SINGLES
from ..errors import BuildError
from ..kernel.stepping.methods import ADAPTIVE as METHODS_IN_C
from ..kernel.stepping.options import rollout_of
from ..runtime.raw import ADAPTIVE, BATCH, FFI, Libraries, RawFunction, RawKernel
from ..runtime.rollouts import FIXED
from . import cache as store
from .load import tried_module

if TYPE_CHECKING:
    from ..codegen.c.source import Source
    from ..codegen.package.running import Compiler

Array = NDArray[Any]

ROWS = [row.bit_count() % STATES for row in range(35)]  # states of a batch: two vectors of 16 lanes, and some


def check_package(
    package: store.Entry, source: Source, expected: bytes, compiler: Compiler, flags: Sequence[str]
) -> None:
    """Compare the functions of a compiled package with what they have to return; it stays loaded if they do.

    Args:
        package: compiled files.
        source: the C that they were compiled from.
        expected: of ``pack_expected``.
        compiler, flags: those that compiled it, for messages.

    Raises:
        BuildError: it does not load, a number differs, or loading it turns denormal numbers off; the compiler's command
            is named.
    """
    from ..codegen.package.probe import refusal
    from ..threads import in_new_thread

    meta = json.loads(source.meta)
    halves = [source.half] if source.half else list(meta["halves"])
    with tried_module(package, source.name) as load:
        module, turned_off = in_new_thread(lambda: _loaded(load))
        wrong: str | None = "loading them turns denormal numbers off"
        if not turned_off:
            wrong = first_difference(module, meta, read_expected(expected), halves)
        if wrong is not None:
            reason = f"the compiled kernels of {source.name} compute something else than their equations: {wrong}"
            raise BuildError(refusal(reason, (*compiler.command, *flags, f"{source.name}.c")))


def _methods(rollout: str) -> range:
    """Return the numbers of the methods that the C of a rollout has."""
    numbers = {**METHODS_IN_C, **FIXED}
    return range(1 + max(number for method, number in numbers.items() if rollout_of(method) == rollout))


def _loaded(load: Callable[[], Any]) -> tuple[Any, bool]:
    """Load a module, and return whether that turned denormal numbers off in this thread, as fast arithmetic does."""
    tiny = np.array([5e-324])
    kept = (tiny * 1.0).any()
    module = load()
    return module, bool(kept and not (tiny * 1.0).any())


def first_difference(
    module: Any, meta: Mapping[str, Any], expected: Mapping[str, Array], halves: Sequence[str] = (SINGLES, BATCHES)
) -> str | None:
    """Return a message about the first number of a compiled module that differs, or None.

    Args:
        module: it, with ``ffi`` and ``lib``.
        meta: metadata of its package.
        expected: of ``read_expected``.
        halves: of the code that the module has.
    """
    with np.errstate(all="ignore"):
        return next(_Check(Libraries(module.ffi, module.lib, meta), expected, halves).differences(), None)


class _Check:
    """Calls the functions of a library."""

    def __init__(self, library: Libraries, expected: Mapping[str, Array], halves: Sequence[str]) -> None:
        self.library, self.raw, self.expected = library.library(""), RawKernel(library), expected
        self.compiled = {name for half in halves for name in library.meta["halves"][half]}
        self.h, self.eps = self._pointer(expected["h"]), float(np.finfo(self.raw.dtype).eps)

    def differences(self) -> Iterator[str]:
        """Yield a message for each result that differs."""
        computed = self.library.compute(np.ascontiguousarray(self.expected["p"]))[: self.library.hoisted]
        yield from self._compared("setup", computed, self.expected["h"], self.expected["h near"])
        for name, function in {**self.raw.functions, **self.raw.rollouts}.items():
            for called in (name, f"{name}{BATCH}"):
                if name in self.expected and called in self.compiled:
                    steps = name in self.raw.rollouts
                    yield from self._of_steps(function, called) if steps else self._of_function(function, called)

    def _of_function(self, function: RawFunction, called: str) -> Iterator[str]:
        """Call a function in both states, or once in a batch of them.

        In random states loops are open, which the status says: results are the same, of a batch those up to there, and
        of other states whose vectors were complete; NaN stands where nothing was written.
        """
        is_batch, status = called != function.name, self.expected[f"{function.name} status"]
        size = math.prod(self.raw.shapes[function.writes])
        states = [[x for x in ROWS if status[x] == PASSES]] if is_batch else [[x] for x in range(STATES)]
        frames = [(int(x),) for x in self.expected["frames"]] if function.is_framed else [()]
        for place, frame in enumerate(frames):
            for rows in filter(None, states):
                out = np.full((len(rows), max(size, 1)), np.nan, self.raw.dtype)
                arrays = [self._pointer(self.expected[name][rows]) for name in function.reads]
                if is_batch:
                    sizes = [self.expected[name].shape[1] for name in function.reads]
                    pairs = [x for pair in zip(arrays, sizes, strict=True) for x in pair]
                    code = function.batch(len(rows), self.h, *pairs, *frame, self.raw.view(out))
                    done = len(rows) if code == -1 else 1 + code // self.raw.statuses
                    code = 0 if code == -1 else 1 + code % self.raw.statuses
                else:
                    done, code = 1, function.code(self.h, *arrays, *frame, self.raw.view(out))
                is_open = code > self.expected["q"].shape[1]
                if (code == 0) != (status[rows[0]] == PASSES) and not is_open and status[rows[0]] in (PASSES, FAILS):
                    yield f"{called} returns status {code}"
                for lane, (row, numbers) in enumerate(zip(rows, out[:, :size], strict=True)):
                    if status[row] == PASSES and (lane < done or not np.isnan(numbers).all()):
                        yield from self._of_state(function.name, called, row, numbers, frame and place)

    def _of_state(self, name: str, called: str, state: int, numbers: Array, frame: Any) -> Iterator[str]:
        """Compare the results of a function in a state; ``frame`` is empty, or the place of a frame."""
        at = (frame, state) if frame != () else (state,)
        wanted, near = self.expected[name][at], self.expected[f"{name} near"][at]
        if f"{name} places" in self.expected:
            terms = numbers[self.expected[f"{name} places"]].astype(np.float64) * self.expected[f"{name} weights"]
            numbers = terms.sum(axis=1)
            near = near + ROUNDING * self.eps * np.abs(terms).sum(axis=1).max(initial=0.0)
        yield from self._compared(called, numbers, wanted, near)

    def _of_steps(self, rollout: RawFunction, called: str) -> Iterator[str]:
        """Compare velocities after one step from rest by each method with the accelerations there."""
        name, dt = rollout.name, STEP[str(self.raw.dtype)]
        for method, state in itertools.product(_methods(name), range(STATES)):
            if self.expected[f"{name} status"][state] != PASSES:
                continue
            inputs = [self.expected[x][state] for x in ("u", "forces") if x in self.expected]
            start = self.expected["q"][state], np.zeros(self.expected[name].shape[1])
            at, moved = tuple(map(self._pointer, start)), [np.zeros((2, x.size), self.raw.dtype) for x in start]
            u = self._pointer(np.concatenate(inputs))
            drive, views = self.library.drive(u=u), tuple(self.raw.view(x.reshape(-1)) for x in moved)
            step = self._adaptive_step if rollout.kind == ADAPTIVE else self._fixed_step
            if not step(rollout, called != name, drive, dt, method, at, views):
                yield f"{called} takes no step by method {method}"
            wanted, velocities = self.expected[name][state], moved[1][1].astype(np.float64)
            near = self.expected[f"{name} near"][state] + ITERATED * self.eps * np.abs(wanted).max(initial=0.0)
            yield from self._compared(f"{called} by method {method}", velocities / dt, wanted, near)

    def _fixed_step(
        self, rollout: RawFunction, is_batch: bool, drive: Any, dt: float, method: int, at: Any, views: Any
    ) -> bool:
        """Take one step; return whether it was taken."""
        how = drive, dt, 1, 1, method, *views
        if is_batch:
            return bool(rollout.batch(1, self.h, at[0], 0, at[1], 0, *how) == -1)
        return bool(rollout.code(self.h, *at, *how) == -1)

    def _adaptive_step(
        self, rollout: RawFunction, is_batch: bool, drive: Any, dt: float, method: int, at: Any, views: Any
    ) -> bool:
        """Take one step, whatever its error is; return whether it was taken."""
        numbers = self.expected["q"].shape[1] + self.expected[rollout.name].shape[1]
        most = self._pointer(np.full(numbers, np.finfo(self.raw.dtype).max))
        allowed = self.library.new("tolerance", rtol=0.0, atol=most, most=1)
        progress, times = self.library.new("progress", next=dt), FFI.from_buffer("double[]", np.array([0.0, dt]))
        how = (times, 1, method, *at, *views, progress)
        if is_batch:
            rollout.batch(1, FFI.NULL, self.h, 0, drive, FFI.NULL, 0, allowed, 0, *how)
        else:
            rollout.code(self.h, drive, FFI.NULL, allowed, *how, FFI.NULL)
        return bool(progress.steps == 1)

    def _pointer(self, array: Array) -> Any:
        """Return a pointer to numbers; to one where there are none."""
        filled = array if array.size else np.zeros(1)
        return self.raw.view(np.ascontiguousarray(filled, self.raw.dtype).ravel())

    def _compared(self, called: str, numbers: Array, wanted: Array, near: Array) -> Iterator[str]:
        """Yield a message about the first number that is not near that which is wanted; NaN never is."""
        allowed = within(wanted, near, str(self.raw.dtype))
        right = (np.abs(numbers - wanted) <= allowed) | np.isinf(allowed)
        if not right.all():
            at = int(np.argmin(right))
            yield f"{called} returns {float(numbers[at])!r} for {float(wanted[at])!r} at {at}"
