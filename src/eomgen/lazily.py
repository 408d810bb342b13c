"""Names of packages whose modules are imported when one of their names is first asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

_HIDDEN = {"TYPE_CHECKING", "annotations", "attributes"}  # what packages import for themselves


def attributes(package: str, *modules: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """A package's ``__getattr__``, which finds each name once, its ``__dir__`` and its ``__all__``.

    Args:
        package: its ``__name__``.
        modules: "MODULE: NAME NAME", a module inside the package and its names; "MODULE" is a name itself.
    """
    module_of = {name: module for module, _, names in (x.partition(": ") for x in modules) for name in names.split()}
    own = {module for module in modules if ":" not in module}

    def find(name: str) -> Any:
        if name not in module_of and name not in own:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(f"{package}.{module_of.get(name, name)}")
        value = module if name in own else getattr(module, name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *module_of, *own} - _HIDDEN)

    return find, names, sorted(module_of)
