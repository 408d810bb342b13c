"""Arrays between libraries by DLPack: a capsule's tensor is read, and memory is handed on in one."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np

NAME, FLOAT = b"dltensor", 2
CPU, CUDA = 1, 2  # types of devices
CODES = {0: "i", 1: "u", FLOAT: "f", 5: "c", 6: "b"}  # of dtypes, as NumPy's kinds


class Tensor(ctypes.Structure):
    """A DLTensor."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("device_type", ctypes.c_int32),
        ("device_id", ctypes.c_int32),
        ("ndim", ctypes.c_int32),
        ("code", ctypes.c_uint8),
        ("bits", ctypes.c_uint8),
        ("lanes", ctypes.c_uint16),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.POINTER(ctypes.c_int64)),
        ("byte_offset", ctypes.c_uint64),
    )


class Managed(ctypes.Structure):
    """A DLManagedTensor: who takes it out of its capsule calls ``deleter`` once."""


_DELETER = ctypes.CFUNCTYPE(None, ctypes.POINTER(Managed))
Managed._fields_ = (("tensor", Tensor), ("context", ctypes.c_void_p), ("deleter", _DELETER))
_DESTRUCTOR = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_python = ctypes.pythonapi
_get = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)(("PyCapsule_GetPointer", _python))
_is_valid = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p)(("PyCapsule_IsValid", _python))
_new = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)(
    ("PyCapsule_New", _python)
)
_lent: dict[int, tuple[Any, ...]] = {}  # what capsules hold on to, by the addresses of their tensors


@dataclass(frozen=True)
class Lent:
    """An array of another library, as a capsule says it.

    strides: in bytes; None of an array in C's order.
    """

    address: int
    device_type: int
    device_id: int
    typestr: str
    shape: tuple[int, ...]
    strides: tuple[int, ...] | None
    capsule: Any


def read_capsule(capsule: Any) -> Lent:
    """Return what a capsule says, which holds on to the memory as long as it is there itself."""
    pointer = _get(id(capsule), NAME)
    tensor = ctypes.cast(pointer, ctypes.POINTER(Managed)).contents.tensor
    size = tensor.bits // 8
    shape = tuple(tensor.shape[i] for i in range(tensor.ndim))
    strides = tuple(tensor.strides[i] * size for i in range(tensor.ndim)) if tensor.strides else None
    kind = CODES.get(tensor.code, "?") if tensor.lanes == 1 else "?"
    address = (tensor.data or 0) + tensor.byte_offset
    return Lent(address, tensor.device_type, tensor.device_id, f"<{kind}{size}", shape, strides, capsule)


def make_capsule(owner: Any, address: int, shape: Sequence[int], dtype: np.dtype[Any], device: tuple[int, int]) -> Any:
    """Return a capsule of an array in C's order, which holds on to the owner of its memory.

    Args:
        device: its type, CPU or CUDA, and its number.
    """
    count = len(shape)
    lengths = (ctypes.c_int64 * max(count, 1))(*shape)
    strides = (ctypes.c_int64 * max(count, 1))(*[prod(shape[i + 1 :]) for i in range(count)])
    managed = Managed()
    tensor = managed.tensor
    tensor.data, (tensor.device_type, tensor.device_id), tensor.ndim = address, device, count
    tensor.code, tensor.bits, tensor.lanes = FLOAT, dtype.itemsize * 8, 1
    tensor.shape = ctypes.cast(lengths, ctypes.POINTER(ctypes.c_int64))
    tensor.strides = ctypes.cast(strides, ctypes.POINTER(ctypes.c_int64))
    managed.deleter = _delete
    place = ctypes.addressof(managed)
    _lent[place] = owner, managed, lengths, strides
    return _new(place, NAME, ctypes.cast(_drop, ctypes.c_void_p))


def lent_count() -> int:
    """Return how many arrays others hold on to."""
    return len(_lent)


def _forget(managed: Any) -> None:
    _lent.pop(ctypes.addressof(managed.contents), None)


def _dropped(capsule: int) -> None:
    """Let go of a tensor that nobody took out of its capsule."""
    if _is_valid(capsule, NAME):
        _lent.pop(int(_get(capsule, NAME)), None)


_delete: Callable[..., None] = _DELETER(_forget)
_drop = _DESTRUCTOR(_dropped)
