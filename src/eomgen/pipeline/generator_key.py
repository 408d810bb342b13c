"""Hash of the files that shape the generated C, so that changed code never serves an entry of the cache made before."""

from __future__ import annotations

import hashlib
import importlib.util
import os
from collections.abc import Iterator
from functools import cache

# Folders of eomgen with all that the generator imports; modules beside them count too (a test follows the imports).
FOLDERS = ("clib", "codegen", "forms", "kernel", "robot", "runtime", "templates")
ENDINGS = (".py", ".jinja", ".c", ".h")


@cache
def generator_hash() -> str:
    """Return SHA-256 of the names and contents of ``generator_files``, hexadecimal."""
    digest = hashlib.sha256()
    for name, path in generator_files().items():
        with open(path, "rb") as file:
            data = file.read()
        digest.update(f"{name}:{len(data)}:".encode() + data)
    return digest.hexdigest()


def generator_files() -> dict[str, str]:
    """Return paths of the files that shape generated C, by names inside eomgen ("codegen/program/ir.py"), sorted."""
    root = _folder("eomgen")
    own = {name: os.path.join(root, name) for name in os.listdir(root) if name.endswith(ENDINGS)}
    return dict(sorted((own | {name: path for top in FOLDERS for name, path in _files(top)}).items()))


def _files(top: str) -> Iterator[tuple[str, str]]:
    """Name inside eomgen and path of every file in one of its folders."""
    start = _folder(f"eomgen.{top}") if top != "clib" else os.path.join(_folder("eomgen"), top)
    for folder, _, names in os.walk(start):
        inner = top + folder[len(start) :].replace(os.sep, "/")
        yield from ((f"{inner}/{name}", os.path.join(folder, name)) for name in names if name.endswith(ENDINGS))


def _folder(package: str) -> str:
    """Return the folder of a package of eomgen, wherever it is installed from."""
    spec = importlib.util.find_spec(package)
    assert spec is not None, package
    return next(iter(spec.submodule_search_locations or ()))
