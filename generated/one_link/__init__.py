"""Equations of motion of the robot one_link, compiled; written by eomgen 0.1.0.

    import one_link
    one_link.mass_matrix(q)             # the functions of one_link.kernel
    one_link.kernel.coordinates         # the order of q
    other = one_link.load()             # a kernel with separate parameters

Needs NumPy and cffi.
"""

import json as _json
from pathlib import Path as _Path
from typing import Any as _Any

from .runtime.levels import binary_folders as _binary_folders

__path__[:0] = _binary_folders(_Path(__file__).parent, "v1")  # of the best level that runs here

from ._one_link import ffi as _ffi, lib as _lib
from .runtime.compiled_kernel import PackageKernel
from .runtime.direct import packaged
from .runtime.raw import Libraries


def _read(name: str) -> str:
    return _Path(__file__).parent.joinpath(name).read_text(encoding="ascii")


_FACE = packaged()
_META = _json.loads(_read("one_link.json"))


def load() -> PackageKernel:
    """Return a kernel with separate parameters, at the description's values."""
    return PackageKernel(Libraries(_ffi, _lib, _META, _read), (load, ()), _FACE)


kernel = load()


def __getattr__(name: str) -> _Any:
    if name.startswith("_"):
        raise AttributeError(name)
    return getattr(kernel, name)
