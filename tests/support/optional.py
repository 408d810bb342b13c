"""Optional libraries of tests: a test that needs one skips without it and names the extra that installs it."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

EXTRA = "test-all"


def needs(*modules: str, extra: str | None = EXTRA) -> Any:
    """Import optional modules, or skip the test, the fixture or (at module level) the test module.

    Args:
        modules: Full names of modules, such as "pinocchio" or "jax.numpy".
        extra: The extra of pyproject.toml that installs them; None for modules that no extra has.

    Returns:
        The first module.

    Raises:
        pytest.skip.Exception: A module is missing; the reason names it and the extra.
    """
    found = []
    for module in modules:
        if not installed(module):
            what = module.partition(".")[0] if extra is None else f"'eomgen[{extra}]'"
            pytest.skip(f"{module} is not installed: pip install {what}", allow_module_level=True)
        found.append(importlib.import_module(module))
    return found[0]


def installed(module: str) -> bool:
    """Return whether a module can be imported, without importing it."""
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # of the package around it
        return False


def module_of(path: Path, name: str | None = None) -> ModuleType:
    """Import a file of Python, under the file's name or another one."""
    spec = importlib.util.spec_from_file_location(name or path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class OptionalModule:
    """A module that is imported at its first use, which skips the test that uses it where the module is missing."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(needs(self._name), attribute)
