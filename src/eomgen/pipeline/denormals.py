"""Sampling and testing of kernels where arithmetic keeps denormal numbers, which some threads round to zero.

JAX's callbacks run in such threads, and ``torch.set_flush_denormal`` makes one of the caller's.  A thread inherits this
from the one that starts it, so one is started early and kept.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from ..errors import BuildError

Result = TypeVar("Result")

_SMALLEST = np.array([5e-324])
_lock = threading.Lock()
_kept: list[ThreadPoolExecutor] = []  # one at most
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_kept.clear)  # a child has no threads of its parent


def prepare() -> None:
    """Start the thread that ``with_denormals`` falls back on, if this one keeps denormal numbers."""
    with _lock:
        if not _kept and keeps_denormals():
            _kept.append(ThreadPoolExecutor(1, "eomgen denormals"))
            _kept[0].submit(keeps_denormals)


def keeps_denormals() -> bool:
    """Tell whether arithmetic in this thread keeps denormal numbers."""
    return bool((_SMALLEST * 1.0)[0] > 0.0)


def with_denormals(work: Callable[[], Result]) -> Result:
    """Do the work in this thread, or in the one of ``prepare`` if this one rounds denormal numbers to zero.

    Raises:
        BuildError: this thread does, and no other was prepared.
    """
    if keeps_denormals():
        return work()
    if not _kept:
        raise BuildError(
            "kernels cannot be tried here: arithmetic in this thread rounds denormal numbers to zero (as after"
            " torch.set_flush_denormal); build the kernel before that, or in another process"
        )
    return _kept[0].submit(work).result()
