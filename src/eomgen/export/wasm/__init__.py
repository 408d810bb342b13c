"""Kernels as WebAssembly: the C of a robot's kernel for browsers and other hosts, and an ES module that calls it.

Uses what export uses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazily import attributes

if TYPE_CHECKING:
    from .loads import plain_loads as plain_loads
    from .pack import export_wasm as export_wasm
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(__name__, "loads: plain_loads", "pack: export_wasm")
