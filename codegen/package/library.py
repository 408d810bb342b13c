"""The C library's objects: compiled once for all robots, for a compiler, its flags and a dtype."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..c.library import FOLDER, PARTS, library_files
from .compile import OPTIMISED, QUICK, WARNINGS, Compiler, key_of, run_all, toolchain

OBJECT = "library.o"
HIDDEN = "-fvisibility=hidden"  # each shared library calls the objects that it was linked with


def library_flags(flags: Sequence[str]) -> tuple[str, ...]:
    """Flags of the library beside a kernel that has these: the same, though the kernel may be compiled quickly."""
    first = (OPTIMISED,) if flags[:1] == (QUICK,) else flags[:1]
    return (*WARNINGS, *first, *flags[1:], HIDDEN)


def library_key(compiler: Compiler, flags: Sequence[str], dtype: str, part: str, *, tried: bool) -> str:
    """Hash of all that a part of the library depends on; another one where nobody could try what was compiled."""
    own: dict[str, Any] = {
        "part": [part, *PARTS[part], dtype, tried],
        "files": library_files(),
        "own": Path(__file__).read_text(encoding="utf-8"),
    }
    return key_of({**toolchain(compiler, library_flags(flags)), **own})


def write_library(compiler: Compiler, flags: Sequence[str], dtype: str, part: str, folder: Path) -> None:
    """Write a part of the library, compiled, and beside it its sources into an empty folder.

    Raises:
        BuildError: the compiler failed; the message holds its command and what it said.
    """
    (folder / FOLDER).mkdir()
    for name, text in library_files().items():
        (folder / name).write_text(text, encoding="ascii")
    run_all([library_command(compiler, flags, dtype, part, folder)])


def precision_flags(dtype: str) -> tuple[str, ...]:
    """Flags by which the library is of single precision."""
    return ("-DEOM_SINGLE",) if dtype == "float32" else ()


def library_command(compiler: Compiler, flags: Sequence[str], dtype: str, part: str, folder: Path) -> list[str]:
    """Give the command that compiles a part of the library in a folder."""
    file, macro = PARTS[part]
    chosen = (f"-D{macro}", *precision_flags(dtype))
    code, target = str(folder / FOLDER / file), str(folder / OBJECT)
    return [*compiler.command, "-c", "-fPIC", *library_flags(flags), *chosen, code, "-o", target]
