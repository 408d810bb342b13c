"""The extension module that calls from Python go through: compiled once for all robots.

It needs CPython's headers and NumPy's; where they are not, kernels are called through cffi alone.
"""

from __future__ import annotations

import importlib.resources
import sys
import sysconfig
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import numpy as np

from eomgen.runtime.direct import NAME

from .compile import key_of, link_shared, toolchain
from .running import Compiler, run_all

FLAGS = ("-O2", "-DNDEBUG", "-Wall", "-Wextra", "-Wconversion")
FILE, HEADERS = "direct.c", ("direct_types.h", "direct_calls.h", "direct_numbers.h", "direct_data.h")


def extension_key(compiler: Compiler) -> str | None:
    """Hash of all that the module depends on, NumPy's version among it; None where it cannot be compiled."""
    if _headers() is None:
        return None
    source = Path(__file__).read_text(encoding="utf-8")
    return key_of({**toolchain(compiler, FLAGS), "numpy": np.__version__, **_sources(), "maker": source})


def write_extension(compiler: Compiler, folder: Path) -> None:
    """Write the module and its sources into an empty folder.

    Raises:
        BuildError: there are no headers, or the compiler failed; the message holds its command and what it said.
    """
    headers = _headers() or ()
    code, made = folder / FILE, folder / "direct.o"
    for name, text in _sources().items():
        (folder / name).write_text(text, encoding="ascii")
    include = [word for path in headers for word in ("-isystem", path)]
    run_all([[*compiler.command, "-c", "-fPIC", *FLAGS, *compiler.flags, *include, str(code), "-o", str(made)]])
    link_shared(compiler, [made], folder / f"{NAME}{EXTENSION_SUFFIXES[0]}")
    made.unlink()


def _headers() -> tuple[str, str] | None:
    """Return folders of Python.h and of NumPy's headers, or None if one is missing, or Python is not CPython."""
    python, numpy = sysconfig.get_path("include"), np.get_include()
    there = Path(python or "", "Python.h").is_file() and Path(numpy, "numpy", "ndarrayobject.h").is_file()
    return (python, numpy) if there and sys.implementation.name == "cpython" else None


def _sources() -> dict[str, str]:
    """Return the module's files, by name."""
    folder = importlib.resources.files("eomgen.runtime")
    return {name: (folder / name).read_text(encoding="ascii") for name in (FILE, *HEADERS)}
