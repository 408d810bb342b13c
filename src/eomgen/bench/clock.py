"""The stopwatch in C: functions with a kernel's arguments take turns, in rounds, in one process.

Single times move with the machine's load; the ratio of two that took turns moves much less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array

DECLARATIONS = """
typedef void (*Code)(void);
typedef struct { Code code; const double *h; double *out; size_t calls; int batch; } Timed;
void stopwatch(size_t count, const Timed *timed, int reads, const double *const *inputs, const size_t *steps,
               size_t states, size_t rounds, double *ns);
"""
SAMPLE = 3e5  # ns that one sample takes at least
FRAME = 0  # ``reads`` of a kernel of q and a frame's number


@dataclass(frozen=True)
class Timed:
    """A function that is timed, by addresses.

    code: ``int (const double *h, const double *..., double *out)``, with as many arrays as ``time`` gets; if
    ``batch``, ``long long (size_t count, const double *h, const double *, size_t step, ..., double *out)``, one call
    for all states.  h, out: its first and last argument; whoever asks for a time keeps them alive.
    """

    code: int
    h: int
    out: int
    batch: bool = False


class Stopwatch:
    """The compiled stopwatch: a cffi library that was declared with ``DECLARATIONS``."""

    def __init__(self, ffi: Any, lib: Any) -> None:
        self._ffi, self._lib = ffi, lib

    def time(self, timed: Sequence[Timed], reads: int, arrays: Sequence[Array], rounds: int) -> Array:
        """Return nanoseconds per state, (rounds, functions).

        Args:
            timed: the functions, in the order of their turns.
            reads: how many of the arrays a function reads, or FRAME.
            arrays: each (states, size), C-contiguous; every sample cycles through the states.
            rounds: number of rounds; in each, every function is timed once, for at least 0.3 ms.
        """
        states = len(arrays[0])
        self._run(timed, [states] * len(timed), reads, arrays, 1)  # warm
        once = np.maximum(self._run(timed, [states] * len(timed), reads, arrays, 3).min(axis=0), 1.0)
        calls = [states * max(1, round(SAMPLE / (states * ns))) for ns in once]
        return self._run(timed, calls, reads, arrays, rounds)

    def _run(
        self, timed: Sequence[Timed], calls: Sequence[int], reads: int, arrays: Sequence[Array], rounds: int
    ) -> Array:
        ffi = self._ffi
        table = ffi.new("Timed[]", len(timed))
        for entry, code, number in zip(table, timed, calls, strict=True):
            entry.code, entry.batch, entry.calls = ffi.cast("Code", code.code), code.batch, number
            entry.h, entry.out = ffi.cast("double *", code.h), ffi.cast("double *", code.out)
        inputs = ffi.new("const double *[]", [ffi.cast("double *", array.ctypes.data) for array in arrays])
        steps = ffi.new("size_t[]", [array[0].size for array in arrays])
        ns = np.zeros((rounds, len(timed)))
        target = ffi.cast("double *", ns.ctypes.data)
        self._lib.stopwatch(len(timed), table, reads, inputs, steps, len(arrays[0]), rounds, target)
        return ns
