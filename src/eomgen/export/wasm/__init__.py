"""Kernels as WebAssembly: the C of a robot's kernel for browsers and other hosts, and an ES module that calls it.

Uses what export uses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazily import attributes

if TYPE_CHECKING:
    from .loads import plain_loads
    from .pack import export_wasm

__all__ = ["export_wasm", "plain_loads"]

_MODULES = {"export_wasm": "pack", "plain_loads": "loads"}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
