"""Calls of compiled kernels with NumPy: all that a generated package carries.

Uses NumPy, cffi's objects, and of eomgen ``errors`` and ``names`` alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .direct import packaged
    from .package_kernel import PackageKernel
    from .raw import Library, OneLibrary, RawFunction, RawKernel

__all__ = ["Library", "OneLibrary", "PackageKernel", "RawFunction", "RawKernel", "packaged"]

_MODULES = {  # imported when one of their names is asked for
    "Library": "raw",
    "OneLibrary": "raw",
    "PackageKernel": "package_kernel",
    "RawFunction": "raw",
    "RawKernel": "raw",
    "packaged": "direct",
}


def _attribute(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    return value


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = _attribute


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
