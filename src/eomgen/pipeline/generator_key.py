"""Hash of the files that shape the generated C: the generator's, its templates, and all of eomgen that it imports.

It enters the key of every source in the cache, so that changed code never serves an old entry.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOMS = ("eomgen.codegen", "eomgen.templates")
LIBRARY = "clib"  # folder of the C library that generated C includes
_INSIDE = tuple(f"{room}." for room in ROOMS)
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([.\w]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n#]*)|import[ \t]+([\w., \t]+))", re.M
)


@cache
def generator_hash() -> str:
    """Return SHA-256 of the names and contents of ``generator_files``, hexadecimal."""
    digest = hashlib.sha256()
    for name, (_, data) in sorted(_contents().items()):
        digest.update(f"{name}:{len(data)}:".encode() + data)
    return digest.hexdigest()


@cache
def room_hash(package: str) -> str:
    """Return SHA-256 of the names and contents of a package's files, hexadecimal: of one that shapes some C alone."""
    digest = hashlib.sha256()
    for name, path in sorted(_files(package)):
        data = _read(path)
        digest.update(f"{name}:{len(data)}:".encode() + data)
    return digest.hexdigest()


def generator_files() -> dict[str, Path]:
    """Return paths of the files that shape generated C, by names inside eomgen ("codegen/program/ir.py"), sorted."""
    return {name: Path(path) for name, (path, _) in sorted(_contents().items())}


def _contents() -> dict[str, tuple[str, bytes]]:
    """Return the path and bytes of every file that shapes the generated C, by its name inside eomgen."""
    contents: dict[str, tuple[str, bytes]] = {}
    waiting: list[tuple[str, str]] = []  # modules whose imports are not looked at yet, with the names of their files
    for room in ROOMS:
        for name, path in _files(room):
            contents[name] = path, _read(path)
            if name.endswith(".py"):
                waiting.append((f"eomgen/{name}".removesuffix(".py").removesuffix("/__init__").replace("/", "."), name))
    for name in sorted(_listing(LIBRARY)):
        contents[f"{LIBRARY}/{name}"] = _path(f"{LIBRARY}/{name}"), _read(_path(f"{LIBRARY}/{name}"))
    seen = {module for module, _ in waiting}
    while waiting:
        module, file = waiting.pop()
        for target in _imported(module, file, contents[file][1]):
            if target not in seen:
                seen.add(target)
                name = "" if target.startswith(_INSIDE) else _file(target)
                if name:
                    contents[name] = _path(name), _read(_path(name))
                    waiting.append((target, name))
    return contents


def _files(package: str) -> Iterator[tuple[str, str]]:
    """Name inside eomgen and path of every file of Python and every template in a package's folder."""
    top = _folder(package)
    for folder, _, names in os.walk(top):
        inner = package.replace(".", "/").removeprefix("eomgen/") + folder[len(top) :].replace(os.sep, "/")
        for name in names:
            if name.endswith((".py", ".jinja")):
                yield f"{inner}/{name}", os.path.join(folder, name)


def _imported(module: str, name: str, data: bytes) -> Iterator[str]:
    """Yield the full names of what may be a module of eomgen among the imports of one, and the packages around them."""
    package = module if name.endswith("__init__.py") else module.rpartition(".")[0]
    for origin, names, plain in _IMPORT.findall(data.decode("utf-8")):
        bases = [origin] if origin else [word.split()[0] for word in plain.split(",") if word.strip()]
        if origin.startswith("."):
            dots = len(origin) - len(origin.lstrip("."))
            above = package.split(".")[: len(package.split(".")) - dots + 1]
            bases = [".".join(filter(None, (*above, origin.lstrip("."))))]
        for base in bases:
            parts = base.split(".")
            if parts[0] == "eomgen":  # without the facade, which imports nothing before it is asked
                yield from (".".join(parts[:end]) for end in range(2, len(parts) + 1))
                for word in re.findall(r"\w+", re.sub(r"#[^\n]*|\bas\s+\w+", "", names)):
                    yield f"{base}.{word}"


def _file(module: str) -> str:
    """Name inside eomgen of the file of one of its modules or packages; "" where there is none of that name."""
    *folder, last = module.split(".")[1:]
    inside = "/".join(folder)
    if f"{last}.py" in _listing(inside):
        return "/".join((*folder, f"{last}.py"))
    if last in _listing(inside) and "__init__.py" in _listing("/".join((*folder, last))):
        return "/".join((*folder, last, "__init__.py"))
    return ""


@cache
def _listing(folder: str) -> frozenset[str]:
    """Return names of what is in a folder of eomgen; none of what is no folder."""
    try:
        return frozenset(os.listdir(_path(folder)))
    except OSError:
        return frozenset()


def _path(name: str) -> str:
    """Return the path of a file or folder of eomgen, outside of ROOMS."""
    return os.path.join(_folder("eomgen"), *name.split("/"))


def _read(path: str) -> bytes:
    with open(path, "rb") as file:
        return file.read()


@cache
def _folder(package: str) -> str:
    """Return the folder of a package of eomgen, wherever it is installed from."""
    spec = importlib.util.find_spec(package)
    assert spec is not None, package
    return next(iter(spec.submodule_search_locations or ()))
