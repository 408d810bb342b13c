"""Methods of kernels by their names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from eomgen import Kernel


def method_of(kernel: Kernel, name: str) -> Callable[..., Any]:
    """Return the kernel's method of that name, or that of its ``functions``."""
    method: Callable[..., Any] = getattr(kernel if hasattr(Kernel, name) else kernel.functions, name)
    return method
