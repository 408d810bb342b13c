"""Names of modules that there are already: a generated package of such a name would be imported in their place."""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from pathlib import Path

from ..errors import InputError
from ..files import read_regular

NEEDED = ("numpy", "cffi", "_cffi_backend", "eomgen")  # what a package imports, and what writes it
_MOST = 1 << 26  # bytes of a package's metadata


def check_module_name(name: str) -> str:
    """Refuse a name for a package that could not be imported, or that would break others.

    Args:
        name: of the package.

    Returns:
        A note about a package of that name that is installed and would be hidden, or hide this one; "" where there is
        none.

    Raises:
        InputError: it is the name of a module of Python itself, or of what the package needs.
    """
    if name in NEEDED or name in sys.stdlib_module_names:
        owner = "which the package itself imports" if name in NEEDED else "a module of Python itself"
        raise InputError(f"name: the package would be called {name!r}, {owner}; allowed: another name of the robot")
    spec = PathFinder.find_spec(name)  # of those on sys.path; nothing is imported
    if spec is None or _is_generated(name, spec.origin):
        return ""
    return f"a package {name!r} is installed; where both can be found, import takes the first on sys.path"


def _is_generated(name: str, origin: str | None) -> bool:
    """Whether a module is a package that was generated before."""
    try:
        return origin is not None and b'"generator"' in read_regular(Path(origin).parent / f"{name}.json", _MOST)
    except (OSError, ValueError):
        return False
