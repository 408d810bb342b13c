"""Names that packages import when they are first used (PEP 562), and values that functions keep."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from importlib import import_module
from typing import Any, Generic, TypeVar, cast

KEPT = 16  # objects whose values a function keeps

Owner = TypeVar("Owner")
Function = TypeVar("Function", bound=Callable[..., Any])
_IMPORT = re.compile(r"^    from (\.[\w.]*) import (\w+) as \2$", re.MULTILINE)


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package from its lines ``from .module import x as x``.

    These lines stand under ``if TYPE_CHECKING:``, where type checkers and editors read them, and the call under its
    ``else``. They are read from the package's source, so that each name is written once; the loader gives it, of a
    folder or a zip file.

    Args:
        package: its ``__name__``.

    Raises:
        ImportError: the package has no source with such lines, for instance where only bytecode is installed.
    """
    module = sys.modules[package]
    spec: Any = module.__spec__
    source = spec.loader.get_data(spec.origin).decode("utf-8", "replace").replace("\r\n", "\n")
    origins = {name: origin for origin, name in _IMPORT.findall(source)}
    if not origins:
        raise ImportError(f"{package}: {spec.origin} holds no source; allowed: packages with their .py files")

    def find(name: str) -> Any:
        if name not in origins:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        origin = origins[name]
        value = import_module(f".{name}", package) if origin == "." else getattr(import_module(origin, package), name)
        setattr(module, name, value)
        return value

    def names() -> list[str]:
        return sorted({*origins, *(name for name in vars(module) if name.startswith("__"))})

    return find, names, sorted(name for name, origin in origins.items() if origin != ".")


class _Same(Generic[Owner]):
    """An object as a key that is equal to itself alone: equal numbers may have other signs of zero."""

    def __init__(self, owner: Owner) -> None:
        self.owner = owner

    def __hash__(self) -> int:
        return id(self.owner)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.owner is self.owner


def kept(function: Function) -> Function:
    """Return the function, which keeps what it gives for the last ``KEPT`` objects; errors are raised each time."""

    first = function.__code__.co_varnames[0]

    @lru_cache(maxsize=KEPT)
    def value(same: _Same[Any], *args: Any, **further: Any) -> Any:
        return function(same.owner, *args, **further)

    @wraps(function)
    def once(*args: Any, **further: Any) -> Any:
        owner, rest = (args[0], args[1:]) if args else (further.pop(first), ())
        return value(_Same(owner), *rest, **further)

    return cast(Function, once)
