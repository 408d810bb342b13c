"""The C library's objects: compiled once for all robots, for a compiler, its flags and a dtype."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..c.library import FOLDER, library_files
from .compile import OPTIMISED, QUICK, WARNINGS, key_of, toolchain
from .running import Compiler, run_all

OBJECT = "library.o"
HIDDEN = "-fvisibility=hidden"  # each shared library calls the objects that it was linked with

# File of each object of the library; steps of fixed length, which are short, are compiled with a robot's equations.
PARTS: Mapping[str, str] = {"adaptive": "integrate.c", "adaptive_lanes": "integrate_lanes.c"}


def library_flags(flags: Sequence[str]) -> tuple[str, ...]:
    """Return flags of the library beside a kernel with these: the same, though the kernel may be compiled quickly."""
    first = (OPTIMISED,) if flags[:1] == (QUICK,) else flags[:1]
    return (*WARNINGS, *first, *flags[1:], HIDDEN)


def library_key(compiler: Compiler, flags: Sequence[str], dtype: str, name: str) -> str:
    """Hash all that an object of the library depends on."""
    inputs: dict[str, Any] = {
        "object": [name, PARTS[name], dtype],
        "files": library_files(),
        "maker": Path(__file__).read_text(encoding="utf-8"),
    }
    return key_of({**toolchain(compiler, library_flags(flags)), **inputs})


def write_library(compiler: Compiler, flags: Sequence[str], dtype: str, name: str, folder: Path) -> None:
    """Write an object of the library, compiled, and beside it its sources into an empty folder.

    Raises:
        BuildError: the compiler failed; the message holds its command and what it said.
    """
    (folder / FOLDER).mkdir()
    for file, text in library_files().items():
        (folder / file).write_text(text, encoding="ascii")
    run_all([library_command(compiler, flags, dtype, name, folder)])


def precision_flags(dtype: str) -> tuple[str, ...]:
    """Return flags by which the library is of single precision."""
    return ("-DEOM_SINGLE",) if dtype == "float32" else ()


def library_command(compiler: Compiler, flags: Sequence[str], dtype: str, name: str, folder: Path) -> list[str]:
    """Return the command that compiles an object of the library in a folder."""
    chosen = ("-DEOM_ADAPTIVE_ONLY", *precision_flags(dtype))
    code, target = str(folder / FOLDER / PARTS[name]), str(folder / OBJECT)
    return [*compiler.command, "-c", "-fPIC", *library_flags(flags), *chosen, code, "-o", target]
