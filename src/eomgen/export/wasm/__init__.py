"""Kernels as WebAssembly: the C of a robot's kernel for browsers and other hosts, and an ES module that calls it.

Uses what export uses.
"""

from typing import TYPE_CHECKING

from ...lazily import lazy_names

if TYPE_CHECKING:
    from .pack import export_wasm as export_wasm
    from .signals import plain_loads as plain_loads
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
