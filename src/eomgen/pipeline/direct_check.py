"""A compiled extension module is asked what is known of it, before it enters the cache.

It is loaded in a separate thread, for the reason that ``self_test`` gives, and calls functions that are written here.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BuildError
from . import cache as store
from .load import fresh_module

if TYPE_CHECKING:
    from ..codegen.package.compile import Compiler

Array = NDArray[Any]

ASKED = "the method in Python was asked"
FAILS = 5.0  # a number that the function refuses
NUMBERS = (1.5, -0.0, 0.1, -3e7)
PLAIN = (NUMBERS, (1e-40, -1e-42, 1.0, 0.0), (1e-310, 5e-324, 2.0, -1.0))
REFUSED = ((math.nan, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, -math.inf), (FAILS, 0.0, 0.0, 0.0))
OVERFLOWING = (2e38, 0.0, 0.0, 0.0)  # doubled in single precision


def check_extension(made: store.Entry, compiler: Compiler) -> None:
    """Let a fresh extension module call functions with plain arrays and others.

    Raises:
        BuildError: it does not load, or does something else than it should; the compiler's command is named.
    """
    from ..codegen.package.extension import FILE, FLAGS
    from ..codegen.package.probe import refusal
    from ..codegen.package.running import in_new_thread

    def work() -> str | None:
        module = fresh_module(made, "direct")
        with np.errstate(all="ignore"):
            errors = (wrong for dtype in (np.float64, np.float32) for wrong in _wrong(module, np.dtype(dtype)))
            return next(errors, None)

    wrong = in_new_thread(work)
    if wrong is not None:
        reason = f"the extension module for calls from Python does something else than it should: {wrong}"
        raise BuildError(refusal(reason, (*compiler.command, *FLAGS, *compiler.flags, FILE)))


def _wrong(module: ModuleType, dtype: np.dtype[Any]) -> Iterator[str]:
    """Yield all that a module does wrong with a function that multiplies by 2 (so in ``h``), for this dtype."""
    code, batch, setup, kept = _doubling(dtype)
    function = module.Function(
        name="doubled",
        method=_asked,
        arming=_asked,
        dtype=dtype,
        places=(("q", "read", (4,)), ("out", "out", ())),
        positional=1,
        result=(4,),
        in_parts=False,
        cut_must_be_false=False,
        frames={},
        added=(1.0, -1, ()),
    )
    state = module.State(np.ones(1, dtype), _asked)
    bound: dict[str, Any] = {}
    module.bind((function,), kept, state, bound)
    call = bound["doubled"]
    for many, address in ((False, code), (True, batch)):
        function.arm("main", many, kept, int(many), address, setup, 1, 1.0, 32)
    for numbers in PLAIN:
        argument, out = np.array(numbers, dtype), np.empty(4, dtype)
        rows = np.array([numbers, numbers[::-1]], dtype)  # which no memory holds twice of before
        for taken, answer in ((argument, call(argument)), (argument, call(q=argument, out=out)), (rows, call(rows))):
            if not isinstance(answer, np.ndarray) or answer.tobytes() != (taken * dtype.type(2)).tobytes():
                yield f"twice {taken} is {answer}"
    for place in np.ndindex(9, 4):  # more than four lines of 64 bytes in double precision, two in single
        rows = np.ones((9, 4), dtype)
        rows[place] = math.nan
        if call(rows) is not ASKED:
            yield f"rows with NaN at {place} are taken as they are"
    for numbers in REFUSED:
        for argument in (np.array(numbers, dtype), np.array([NUMBERS, numbers], dtype)):
            if call(argument) is not ASKED:
                yield f"{argument} is taken as it is"
    large = np.array(OVERFLOWING, dtype) * (1 if dtype == np.float32 else dtype.type(5e269))
    for argument in (large, np.array([large])):
        state.checks = True
        if call(argument) is not ASKED:
            yield f"twice {argument} is taken as finite"
        state.checks = False
        if call(argument) is ASKED:
            yield f"{argument} is looked at"
    state.checks = True
    if not float(np.array([5e-324])[0] * 1.0) > 0.0:
        yield "denormal numbers are lost"


def _asked(kernel: object, q: Array, *, out: Array | None = None) -> str:
    return ASKED


def _doubling(dtype: np.dtype[Any]) -> tuple[int, int, int, object]:
    """Return addresses of code for one state, for many, and of a setup; and what keeps them."""
    real = ctypes.c_double if dtype == np.float64 else ctypes.c_float
    pointer = ctypes.POINTER(real)

    def one(h: Any, q: Any, out: Any) -> int:
        for i in range(4):
            out[i] = h[0] * q[i]
        return int(q[0] == FAILS)

    def many(count: int, h: Any, q: Any, step: int, out: Any) -> int:
        failed = -1
        for state in range(count):
            for i in range(4):
                out[4 * state + i] = h[0] * q[step * state + i]
            if failed < 0 and q[step * state] == FAILS:
                failed = 4 * state
        return failed

    def setup(p: Any, h: Any) -> None:
        h[0] = 2.0 * p[0]

    size = ctypes.c_size_t
    kept = (
        ctypes.CFUNCTYPE(ctypes.c_int, pointer, pointer, pointer)(one),
        ctypes.CFUNCTYPE(ctypes.c_longlong, size, pointer, pointer, size, pointer)(many),
        ctypes.CFUNCTYPE(None, pointer, pointer)(setup),
    )
    first, second, third = (int(ctypes.cast(x, ctypes.c_void_p).value or 0) for x in kept)
    return first, second, third, kept
