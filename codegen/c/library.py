"""The C library that robots' code includes: its files, and its types as cffi reads them."""

from __future__ import annotations

import importlib.resources
import re
from collections.abc import Iterable
from functools import cache

FOLDER = "clib"  # of eomgen, and beside a robot's file
LINKED = "EOM_LINKED"  # macro of robots' files that are linked with the library's objects
_TYPES = ("eom.h", "eom_types.h")


@cache
def library_files() -> dict[str, str]:
    """Read the library's files, by their places beside a robot's file ("clib/eom.h"), sorted."""
    folder = importlib.resources.files("eomgen").joinpath(FOLDER)
    names = sorted(path.name for path in folder.iterdir() if path.name.endswith((".c", ".h")))
    return {f"{FOLDER}/{name}": folder.joinpath(name).read_text(encoding="ascii") for name in names}


@cache
def public_headers() -> tuple[str, ...]:
    """List eom.h and what it includes: all that a robot's header needs of the library."""
    files, wanted = library_files(), [f"{FOLDER}/eom.h"]
    for place in wanted:
        included = re.findall(r'^#include "(.+)"$', files[place], flags=re.MULTILINE)
        wanted += [f"{FOLDER}/{name}" for name in dict.fromkeys(included) if f"{FOLDER}/{name}" not in wanted]
    return tuple(wanted)


@cache
def library_types(dtype: str) -> str:
    """Declare the library's types in one precision, "float64" or "float32", without preprocessor and comments."""
    return _declared(dtype, _TYPES)


def _plain(name: str) -> str:
    """Return a file without comments and what is for C++, continued lines joined."""
    text = re.sub(r"#ifdef __cplusplus\n.*?#endif\n", "", library_files()[f"{FOLDER}/{name}"], flags=re.DOTALL)
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).replace("\\\n", "")


def _declared(dtype: str, names: Iterable[str]) -> str:
    """Return declarations of headers in one precision."""
    text = "\n".join(map(_plain, names))
    prefix, scalar = ("eomf", "float") if dtype == "float32" else ("eom", "double")
    text = re.sub(r"\bEOM\((\w+)\)", rf"{prefix}_\1", text).replace("EOM_SCALAR", scalar)
    lines = (line.rstrip() for line in text.splitlines() if not line.startswith("#"))
    return "\n".join(line for line in lines if line) + "\n"
