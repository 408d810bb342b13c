"""From the bytes of a compiled package to a loaded module.

The dynamic linker opens files by name.  It gets a copy, which nobody else knows and which is gone as
soon as it is loaded: so the code that runs is that whose hash was checked, and stays so, whatever happens to the cache.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from typing import Any

from ..errors import BuildError
from ..runtime.raw import Libraries
from . import cache as store

_guard = threading.Lock()


def load_module(package: store.Entry, name: str) -> Any:
    """Load the module with ``ffi`` and ``lib`` of a compiled package of the cache, once in a process.

    Raises:
        BuildError: it does not load.
    """
    here = _place(package, name)
    with _guard:
        if here not in sys.modules:
            sys.modules[here] = _load(package, name, here)
        return sys.modules[here]


@contextmanager
def tried_module(package: store.Entry, name: str) -> Iterator[Callable[[], Any]]:
    """Give a function that loads the module of a package that was just made, even if one of the same key is loaded.

    Where the block ends without an exception, ``load_module`` gives that module, if it has none of the package yet.
    The function raises BuildError where the module does not load.
    """
    here, loaded = f"_eomgen_fresh_{package.key}._{name}", list[Any]()

    def load() -> Any:
        with _guard:
            try:
                loaded.append(_load(package, name, here))
            finally:
                sys.modules.pop(here, None)
        return loaded[0]

    yield load
    with _guard:
        sys.modules.setdefault(_place(package, name), loaded[0])


def one_library(package: store.Entry, name: str) -> Libraries:
    """Return the library of a package in the cache, whose texts are read while they are there; ``name`` is the robot's.

    Raises:
        BuildError: it does not load.
    """

    def read(file: str) -> str:
        entry = store.find(package.kind, package.key)
        if entry is None:
            raise FileNotFoundError(file)
        return entry.files[file].decode("ascii")

    return Libraries(*loaded(package, name), read)


def loaded(package: store.Entry, name: str) -> tuple[Any, Any, dict[str, Any]]:
    """Return cffi's objects of a package's module, and its metadata."""
    module = load_module(package, name)
    return module.ffi, module.lib, json.loads(package.files[f"{name}.json"])


def _place(package: store.Entry, name: str) -> str:
    """Name among loaded modules."""
    return f"_eomgen_{package.key}._{name}"


def _load(package: store.Entry, name: str, here: str) -> Any:
    try:
        return _load_abi(package, name) if f"_{name}_types.py" in package.files else _load_api(package, here)
    except (ImportError, OSError) as error:
        raise BuildError(f"the compiled module in {package.folder} does not load: {error}") from None


def _load_api(package: store.Entry, here: str) -> Any:
    """Load a package of cffi's API mode: an extension module."""
    stem = here.rpartition(".")[2]
    file = _library(package, f"{stem}.")

    def load(path: str) -> Any:
        loader = ExtensionFileLoader(here, path)
        spec = importlib.util.spec_from_file_location(here, path, loader=loader)
        if spec is None:
            raise ImportError(f"{file} is no extension module")
        module = importlib.util.module_from_spec(spec)
        loader.exec_module(module)
        return module

    return linked(package, file, load)


def _load_abi(package: store.Entry, name: str) -> Any:
    """Load a package of cffi's ABI mode: declarations in Python, and a plain shared library."""
    from types import ModuleType

    file = f"_{name}_types.py"
    module = ModuleType(f"_{name}")
    exec(compile(package.files[file], file, "exec"), module.__dict__)  # its hash was checked as that of any binary
    module.lib = linked(package, _library(package, "lib"), module.ffi.dlopen)  # type: ignore[attr-defined]
    return module


def _library(package: store.Entry, beginning: str) -> str:
    """Return the name of a package's shared library; ImportError where it has none."""
    for name in package.files:
        if name.startswith(beginning) and name.endswith((".so", ".pyd")):
            return name
    raise ImportError(f"none of its files is a library {beginning}*")


def linked(package: store.Entry, file: str, load: Callable[[str], Any]) -> Any:
    """Load a copy of a file by ``load(path)``; the file itself if no copy can be had, or where files in use stay.

    ImportError and OSError of ``load`` say that it cannot be had there.
    """
    root = store.cache_folder()
    for place in (str(root), None) if os.name == "posix" else ():  # libraries can be loaded from where the cache is
        try:
            with _copy(package.files[file], file, place) as path:
                return load(path)
        except (ImportError, OSError):  # no room, nothing may be written or run there
            continue
    return load(str(package.folder / file))


@contextmanager
def _copy(data: bytes, name: str, place: str | None) -> Iterator[str]:
    with tempfile.TemporaryDirectory(prefix="loading-", dir=place, ignore_cleanup_errors=True) as folder:
        path = Path(folder, name)
        path.write_bytes(data)
        yield str(path)
