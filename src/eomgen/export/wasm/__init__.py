"""Kernels as WebAssembly: the C of a robot's kernel for browsers and other hosts, and an ES module that calls it.

Uses what export uses.
"""

from ...lazily import imports_when_used

with imports_when_used(globals()):
    from .pack import export_wasm as export_wasm
    from .signals import plain_loads as plain_loads
