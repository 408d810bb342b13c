"""Hash of the files that shape the generated C: the generator's own, its templates, and all of eomgen that it imports.

It is part of the key of every source in the cache, so that changed code never serves an old entry.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOMS = ("eomgen.codegen", "eomgen.templates")
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([.\w]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n#]*)|import[ \t]+([\w., \t]+))", re.M
)


@cache
def generator_hash() -> str:
    """SHA-256 of the names and contents of ``generator_files``, hexadecimal."""
    digest = hashlib.sha256()
    for name, path in generator_files().items():
        data = path.read_bytes()
        digest.update(f"{name}:{len(data)}:".encode() + data)
    return digest.hexdigest()


def generator_files() -> dict[str, Path]:
    """Path of every file that shapes the generated C, by its name inside eomgen ("codegen/program/ir.py"), sorted."""
    found: dict[str, Path] = {}
    modules: list[str] = []
    for room in ROOMS:
        folder = _folder(room)
        for path in folder.rglob("*"):
            if path.suffix in (".py", ".jinja"):
                inner = path.relative_to(folder)
                found[Path(room.removeprefix("eomgen."), inner).as_posix()] = path
                if path.suffix == ".py":
                    modules.append(".".join((room, *inner.with_suffix("").parts)).removesuffix(".__init__"))
    seen = set(modules)
    while modules:
        for name in _imported(modules.pop()):
            module = None if name in seen else _file(name)
            seen.add(name)
            if module is not None:
                modules.append(name)
                found[module.relative_to(_folder("eomgen")).as_posix()] = module
    return dict(sorted(found.items()))


def _imported(module: str) -> Iterator[str]:
    """Full names of what may be a module of eomgen among the imports of one, and the packages around them."""
    path = _file(module)
    assert path is not None, module
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for origin, names, plain in _IMPORT.findall(path.read_text(encoding="utf-8")):
        targets = [word.split()[0] for word in plain.split(",") if word.strip()]
        if origin:
            dots = len(origin) - len(origin.lstrip("."))
            above = package.split(".")[: len(package.split(".")) - dots + 1]
            base = ".".join(filter(None, (*above, origin.lstrip(".")))) if dots else origin
            words = re.findall(r"\w+", re.sub(r"#[^\n]*|\bas\s+\w+", "", names))
            targets = [base, *(f"{base}.{word}" for word in words)]
        for target in targets:
            parts = target.split(".")
            if parts[0] == "eomgen":  # without the facade, which imports nothing before it is asked
                yield from (".".join(parts[:end]) for end in range(2, len(parts) + 1))


@cache
def _folder(package: str) -> Path:
    """Folder of a package of eomgen, wherever it is installed from."""
    spec = importlib.util.find_spec(package)
    assert spec is not None, package
    return Path(next(iter(spec.submodule_search_locations or ())))


@cache
def _file(module: str) -> Path | None:
    """File of a module or package of eomgen, None where there is none of that name."""
    room = next((room for room in ROOMS if module == room or module.startswith(room + ".")), "eomgen")
    base = _folder(room).joinpath(*module.removeprefix(room).strip(".").split("."))
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.is_file()), None)
