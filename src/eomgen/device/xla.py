"""Functions on devices as foreign functions of XLA: plans, and the handlers that launch them on XLA's streams."""

from __future__ import annotations

import ctypes
import hashlib
import json
import threading
from collections.abc import Mapping
from functools import cache
from math import prod
from pathlib import Path
from typing import Any

from ..codegen.package.compile import WARNINGS, compile_flags, find_compiler, link_shared, toolchain
from ..codegen.package.running import run_all
from ..pipeline import cache as store
from ..pipeline.load import linked
from .cuda import LINE, DeviceArray, Functions
from .face import Device
from .texts import KIND, FunctionText

SOURCE = Path(__file__).with_name("xla_handler.c")
LIBRARY, OBJECT = "eomgen_xla.so", "handler.o"
HEADER = "xla/ffi/api/c_api.h"  # of JAX
FLAGS: tuple[str, ...] = ()  # further ones of the compiler
HANDLERS: Mapping[str, str] = {"CUDA": "eomgen_launch", "cpu": "eomgen_refuse"}  # by XLA's names of platforms
STATUS_BITS = 32
CALLS = ("push", "pop", "launch", "fill", "to_host", "wait", "pointer", "message")  # of the driver


class Calls(ctypes.Structure):
    """Addresses of the driver's calls."""

    _fields_ = tuple((word, ctypes.c_void_p) for word in CALLS)


class Plan(ctypes.Structure):
    """A function as handlers know it; ``xla_handler.c`` has the same structure."""

    _fields_ = (
        ("number", ctypes.c_uint64),
        ("h", ctypes.c_uint64),
        ("name", ctypes.c_char_p),
        ("device", ctypes.c_char_p),
        ("context", ctypes.c_void_p),
        ("calls", ctypes.POINTER(Calls)),
        ("sizes", ctypes.POINTER(ctypes.c_uint64)),
        ("labels", ctypes.POINTER(ctypes.c_char_p)),
        ("functions", ctypes.POINTER(ctypes.c_void_p)),
        ("reasons", ctypes.POINTER(ctypes.c_char_p)),
        ("begin", ctypes.c_void_p),
        ("end", ctypes.c_void_p),
        ("find", ctypes.c_void_p),
        ("ordinal", ctypes.c_int32),
        ("is_double", ctypes.c_int32),
        ("arrays", ctypes.c_int32),
        ("parts", ctypes.c_int32),
        ("checks", ctypes.c_int32),
        ("next", ctypes.c_void_p),
    )


_kept: dict[
    tuple[int, int], Any
] = {}  # plans by their library and number, with what they point to: XLA may call always
_lock = threading.Lock()


def handlers(include: str) -> ctypes.CDLL:
    """Return the library of handlers, compiled when it is first asked for.

    Args:
        include: folder of XLA's headers, ``jax.ffi.include_dir()``.

    Raises:
        BuildError: no compiler of C, or one that fails.
    """
    return _handlers(include, FLAGS)


@cache
def _handlers(include: str, further: tuple[str, ...]) -> ctypes.CDLL:
    compiler = find_compiler()
    flags = compile_flags(compiler, False, further)
    texts = [path.read_text(encoding="utf-8") for path in (SOURCE, Path(include, HEADER))]
    key = hashlib.sha256(json.dumps([toolchain(compiler, flags), texts], sort_keys=True).encode())

    def make(folder: Path) -> None:
        compiled = folder / OBJECT
        command = [*compiler.command, "-c", "-fPIC", *WARNINGS, *flags, "-isystem", include, str(SOURCE)]
        run_all([[*command, "-o", str(compiled)]])
        link_shared(compiler, [compiled], folder / LIBRARY)
        compiled.unlink()

    return linked(store.entry(KIND, key.hexdigest(), make), LIBRARY, ctypes.CDLL)  # type: ignore[no-any-return]


def scratch_size(text: FunctionText, count: int, item: int) -> int:
    """Return how many bytes a call of so many states needs beside its arrays; item: bytes of a number."""
    sizes = _sizes(text)
    whole = -(-count // text.tile) * text.tile
    parts = [4 * (1 + len(sizes)), 4 * count, *(whole * size * item for size in sizes)]
    return sum(-(-part // LINE) * LINE for part in parts)


def plan_number(library: ctypes.CDLL, device: Device, name: str) -> tuple[int, FunctionText]:
    """Return the number by which handlers know a function with the parameters that the kernel has now, and its text.

    Raises:
        UnknownNameError, InputError: the device has no such method.
    """
    text, functions, h = device.prepared(name)
    known = [device.name, device.cuda.contract, device.checks, text.code, name]
    digest = hashlib.sha256(json.dumps(known).encode() + device.get(h).tobytes()).digest()
    number = int.from_bytes(digest[:8], "little") >> 1  # attributes of XLA are signed
    with _lock:
        if (library._handle, number) not in _kept:  # noqa: SLF001
            plan, held = _plan(number, device, text, functions, h)
            _kept[library._handle, number] = plan, held, functions, h  # noqa: SLF001
            library.eomgen_add_plan(ctypes.byref(plan))
    return number, text


def _plan(
    number: int, device: Device, text: FunctionText, functions: Functions, h: DeviceArray
) -> tuple[Plan, list[Any]]:
    """Return a plan, and what it points to."""
    chosen = device.cuda.chosen
    with chosen.current():
        parts = [functions.find(name) for name in text.about["functions"]]
        beside = {word: functions.find(text.beside(word)) for word in ("begin", "end", "find")}
    calls = Calls(*(chosen.driver.address(word) for word in CALLS))
    sizes = _sizes(text)
    labels = [*text.shapes("reads"), *text.shapes("writes")]
    reasons = [
        text.reasons(1 << bit) or f"the mass matrix cannot be inverted at {' or '.join(text.vanished(1 << bit))}"
        for bit in range(STATUS_BITS)
    ]
    arrays = [
        (ctypes.c_uint64 * len(sizes))(*sizes),
        *((ctypes.c_char_p * len(words))(*(word.encode() for word in words)) for words in (labels, reasons)),
        (ctypes.c_void_p * len(parts))(*parts),
    ]
    plan = Plan(
        number=number,
        h=h.address,
        name=text.name.encode(),
        device=device.name.encode(),
        context=chosen.context,
        calls=ctypes.pointer(calls),
        sizes=arrays[0],
        labels=arrays[1],
        functions=arrays[3],
        reasons=arrays[2],
        **beside,
        ordinal=chosen.ordinal,
        is_double=int(device.dtype.itemsize == 8),
        arrays=len(sizes),
        parts=len(parts),
        checks=int(device.checks),
    )
    return plan, [calls, *arrays]


def _sizes(text: FunctionText) -> list[int]:
    """Return how many numbers of a state each array has, of those that are read and then of those that are written."""
    return [prod(shape) for which in ("reads", "writes") for shape in text.shapes(which).values()]
