"""Names whose modules are imported when they are first asked for: of packages, and of rooms above the caller."""

from __future__ import annotations

import builtins
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from threading import Lock
from types import SimpleNamespace
from typing import Any

_ONE_AT_A_TIME = Lock()  # or two threads might put back each other's way of importing


def public_names(package: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Return what ``dir`` of a package shows: these names, and what Python itself puts into packages."""
    return sorted({*names, *(name for name in package if name.startswith("__"))})


@contextmanager
def imports_when_used(package: dict[str, Any]) -> Iterator[None]:
    """Put off what a block imports, ``from .module import name as name``, until a name is asked for.

    The package gets ``__getattr__``, ``__dir__``, which has no other names, and ``__all__``, which has those of them
    that are no modules.

    Args:
        package: its ``globals()``.
    """
    modules: dict[str, str] = {}  # of every name, inside the package; "" of a module

    def note(name: str, *args: Any, **keywords: Any) -> Any:
        if not args or args[0] is not package:  # of another thread
            return ordinary(name, *args, **keywords)
        modules.update(dict.fromkeys(args[2], name))
        return SimpleNamespace(**dict.fromkeys(args[2]))

    def find(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package['__name__']!r} has no attribute {name!r}")
        module = import_module("." + (modules[name] or name), package["__name__"])
        package[name] = getattr(module, name) if modules[name] else module
        return package[name]

    with _ONE_AT_A_TIME:
        ordinary, builtins.__import__ = builtins.__import__, note
        try:
            yield
        finally:
            builtins.__import__ = ordinary
    for name in modules:
        del package[name]
    package["__getattr__"] = find
    package["__dir__"] = lambda: public_names(package, modules)
    package["__all__"] = sorted(name for name, module in modules.items() if module)


def from_above(module: str, name: str) -> Any:
    """Return a name of a module of eomgen by their names, imported now.

    For methods that are short for a function of a room above: of a result that plots itself, a robot that shows itself.
    The rooms below import nothing of it, and work without it.

    Args:
        module: inside eomgen, ".pictures".
        name: in it.
    """
    return getattr(import_module(module, __package__), name)
