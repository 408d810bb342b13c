"""One package out of those that were compiled for several levels of processors."""

from __future__ import annotations

from collections.abc import Mapping

from .cache import Files

_BINARIES = (".so", ".pyd", ".dylib", ".dll")


def with_levels(name: str, base: Files, further: Mapping[str, Files]) -> Files:
    """Files of a package, and in a folder for each further level the binaries that were compiled for it.

    Args:
        name: the robot's.
        base: the package of the lowest level.
        further: packages of the others, from the same source, by level.
    """
    found = dict(base)
    for level, files in further.items():
        found |= {f"{level}/{file}": data for file, data in files.items() if _is_loaded(file, name)}
    return found


def _is_loaded(file: str, name: str) -> bool:
    """Whether a file is a binary of the kernel, or the module that opens one; those of the runtime know no levels."""
    return "/" not in file and (file.endswith(_BINARIES) or file == f"_{name}.py")
