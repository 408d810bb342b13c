"""Arrays of other libraries on a device of CUDA: where they lie, on which streams, and new ones for results."""

from __future__ import annotations

import operator
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ArrayError, InputError
from ..names import show
from .dlpack import CPU, CUDA, Lent, read_capsule

IMMUTABLE = ("jax", "jaxlib")
DEFAULT = 1  # the default stream, as the array interface and DLPack count
REFUSALS = (BufferError, RuntimeError, TypeError, ValueError)  # of libraries that do not lend an array
ALLOWED = "arrays on the device with __cuda_array_interface__ or DLPack, such as those of CuPy, PyTorch and JAX"


@dataclass(frozen=True)
class View:
    """An array on a device, in C's order.

    place: its address.  owner: what holds on to the memory.  stream: of its library, on which its numbers are made;
    None where there is nothing to wait for.
    """

    place: int
    shape: tuple[int, ...]
    owner: Any
    stream: int | None = None


def library_of(x: Any) -> str:
    """Return the name of the library that an array is of: "torch", "cupy", "jax"."""
    return type(x).__module__.partition(".")[0]


def view_of(label: str, x: Any, dtype: np.dtype[Any], ordinal: int, stream: int, is_written: bool) -> View:
    """Return where an array lies.

    Args:
        label: its name in messages.
        ordinal: number of the device.
        stream: on which it will be read or written.
        is_written: whether it is written to.

    Raises:
        ArrayError: no array on this device, of another dtype, not in C's order, or one that may not be written.
    """
    if is_written and library_of(x) in IMMUTABLE:
        raise ArrayError(f"{label}: arrays of JAX cannot be written; allowed: no out, or an array of another library")
    said = _by_interface(label, x, is_written)
    lent, made_on = (_by_dlpack(label, x, ordinal, stream), None) if said is None else said
    if lent.typestr != dtype.str:
        raise ArrayError(f"{label}: dtype {_dtype_name(lent.typestr)}; allowed: {dtype}")
    if lent.strides is not None and not _is_in_order(lent.shape, lent.strides, dtype.itemsize):
        raise ArrayError(f"{label}: strides {lent.strides} of shape {lent.shape}; allowed: an array in C's order")
    return View(lent.address, lent.shape, (x, lent.capsule), made_on)


def _by_interface(label: str, x: Any, is_written: bool) -> tuple[Lent, int | None] | None:
    """Return what the CUDA array interface says, and its stream; None where there is none."""
    try:
        said = x.__cuda_array_interface__
    except AttributeError:
        return None
    except REFUSALS as error:  # a RuntimeError of PyTorch's arrays that ask for gradients
        raise ArrayError(f"{label}: {error}") from error
    address, is_fixed = said["data"]
    if is_written and is_fixed:
        raise ArrayError(f"{label}: the array may not be written; allowed: a writable one")
    if said.get("mask") is not None:
        raise ArrayError(f"{label}: the array is masked; allowed: all numbers")
    strides, shape = said.get("strides"), tuple(said["shape"])
    if library_of(x) in IMMUTABLE:
        x.block_until_ready()
    typestr = said["typestr"].replace("=", "<")
    lent = Lent(int(address), 0, 0, typestr, shape, None if strides is None else tuple(strides), None)
    return lent, said.get("stream")


def _by_dlpack(label: str, x: Any, ordinal: int, stream: int) -> Lent:
    """Return what a capsule says, whose numbers are there for what comes next on the stream."""
    if isinstance(x, np.ndarray) or not hasattr(x, "__dlpack__") or not hasattr(x, "__dlpack_device__"):
        raise ArrayError(f"{label}: got {_said(x)}, which lies on the processor; allowed: {ALLOWED}, or device.put")
    kind, number = (int(word) for word in x.__dlpack_device__())
    if kind != CUDA:
        where = "on the processor" if kind == CPU else f"on a device of DLPack's type {kind}"
        raise ArrayError(f"{label}: {_said(x)} lies {where}; allowed: {ALLOWED}")
    refuse_elsewhere(label, number, ordinal)
    try:
        capsule = x.__dlpack__(stream=stream or DEFAULT)
    except REFUSALS as error:  # a BufferError by the standard of arrays
        raise ArrayError(f"{label}: {_said(x)} gives no DLPack: {error}") from error
    return read_capsule(capsule)


def refuse_elsewhere(label: str, number: int, ordinal: int) -> None:
    """Raise ArrayError where an array lies on another device than that of a number."""
    if number != ordinal:
        raise ArrayError(f"{label}: the array lies on cuda:{number}; allowed: cuda:{ordinal}")


def _is_in_order(shape: Sequence[int], strides: Sequence[int], size: int) -> bool:
    """Whether strides are those of C's order; of axes of one number any are."""
    expected = size
    if 0 in shape:
        return True
    for length, stride in zip(reversed(shape), reversed(strides), strict=True):
        if length != 1 and stride != expected:
            return False
        expected *= length
    return True


def _dtype_name(typestr: str) -> str:
    try:
        return str(np.dtype(typestr))
    except TypeError:
        return show(typestr)


def _said(x: Any) -> str:
    kind = type(x)
    return f"{kind.__module__}.{kind.__qualname__}"


def handle_of(stream: Any) -> int:
    """Return a stream's address: of a number, or an object of CuPy, PyTorch, Numba or with ``__cuda_stream__``.

    Raises:
        InputError: it is none of these.
    """
    if hasattr(stream, "__cuda_stream__"):
        given = stream.__cuda_stream__
        return int((given() if callable(given) else given)[1])
    for name in ("cuda_stream", "ptr", "handle"):
        if hasattr(stream, name):
            stream = getattr(stream, name)
            break
    stream = getattr(stream, "value", stream) or 0
    try:
        number = -1 if isinstance(stream, bool) else operator.index(stream)
    except TypeError:
        number = -1
    if number < 0:
        raise InputError(f"stream: {show(stream)}; allowed: a stream of CuPy, PyTorch or Numba, or its address")
    return number


def current_stream(library: str, ordinal: int) -> int:
    """Return the stream that a library works on now; 0, the default one, of libraries that do not say."""
    module = sys.modules.get(library)
    if library == "torch" and module is not None and module.cuda.is_initialized():  # as it is where a tensor lies there
        return int(module.cuda.current_stream(ordinal).cuda_stream)
    if library == "cupy" and module is not None:
        with module.cuda.Device(ordinal):
            return int(module.cuda.get_current_stream().ptr)
    return 0


def new_array(library: str, shape: tuple[int, ...], dtype: np.dtype[Any], ordinal: int) -> Any:
    """Return an array of a library that gives memory on its current stream; None of one that does not."""
    module = sys.modules.get(library)
    if library == "torch" and module is not None:
        return module.empty(shape, dtype=getattr(module, dtype.name), device=f"cuda:{ordinal}")
    if library == "cupy" and module is not None:
        with module.cuda.Device(ordinal):
            return module.empty(shape, dtype)
    return None


def handed_over(library: str, array: Any) -> Any:
    """Return eomgen's own array as one of a library that takes such arrays; itself for others."""
    if library in IMMUTABLE:
        from jax.dlpack import from_dlpack

        return from_dlpack(array)
    if library == "numba":
        from numba import cuda

        return cuda.as_cuda_array(array)
    return array
