"""Equations of motion of the robot one_link, compiled; written by eomgen 0.1.0.

    import one_link
    one_link.mass_matrix(q)             # the functions of one_link.kernel
    one_link.kernel.coordinates         # the order of q
    other = one_link.load()             # a kernel with parameters of its own

Needs NumPy and cffi.
"""

import json as _json
from pathlib import Path as _Path
from typing import Any as _Any

from ._one_link import ffi as _ffi, lib as _lib
from .runtime import Kernel, OneLibrary


def _read(name: str) -> str:
    return _Path(__file__).with_name(name).read_text(encoding="ascii")


_META = _json.loads(_read("one_link.json"))


def load() -> Kernel:
    """A kernel with parameters of its own, at the description's values."""
    return Kernel(OneLibrary(_ffi, _lib, _META, _read), (load, ()))


kernel = load()


def __getattr__(name: str) -> _Any:
    if name.startswith("_"):
        raise AttributeError(name)
    return getattr(kernel, name)
