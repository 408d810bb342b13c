"""Lists of what is public: names by package, and the arguments that users may write by keyword."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from typing import Any

from eomgen.cli.entry import COMMANDS

SUBPACKAGES = (
    *(
        "analysis",
        "authoring",
        "control",
        "description",
        "export",
        "identification",
        "integration",
        "loops",
        "motion",
        "pictures",
    ),
    *("robot", "scenario", "simulation", "state", "sweep", "adapters.casadi", "adapters.jax", "adapters.torch"),
)
PACKAGES = ("eomgen", *(f"eomgen.{name}" for name in SUBPACKAGES))
MADE_BY_EOMGEN = ("eomgen.Kernel",)  # whose constructors are no part of what stays


def names() -> str:
    """Return a table of the public names by package, and the commands."""
    rows = [f"| `{package}` | {', '.join(f'`{x}`' for x in public_names(package))} |" for package in PACKAGES]
    commands = ", ".join(f"`{command.name}`" for command in COMMANDS)
    return "\n".join(["| package | names |", "|---|---|", *rows, f"| command line | {commands} |"])


def called() -> Iterator[tuple[str, Any]]:
    """Yield name and function of all that users call, classes and methods, too; each in its first package."""
    seen = set[tuple[int, str]]()
    for package in PACKAGES:
        for name in public_names(package):
            label = f"{package}.{name}"
            value = function_of(label)
            for key, function in {label: value, **_methods(label, value)}.items():
                which = id(function), key.rpartition(".")[2]
                if callable(function) and _is_ours(function) and which not in seen:
                    seen.add(which)
                    if key not in MADE_BY_EOMGEN:
                        yield key, function


def public_names(package: str) -> list[str]:
    """Return the public names of a package, sorted."""
    return sorted(importlib.import_module(package).__all__)


def function_of(label: str) -> Any:
    """Return what a label, ``eomgen.Kernel.assemble``, stands for; None where there is no such thing."""
    package = max((x for x in PACKAGES if label.startswith(f"{x}.")), key=len)
    value: Any = importlib.import_module(package)
    for name in label.removeprefix(f"{package}.").split("."):
        value = getattr(value, name, None)
    return value


def keywords(function: Any) -> list[str]:
    """Return the names of a function's arguments, without those of a method's object."""
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    parameters = inspect.signature(function).parameters.items()
    return [name for name, x in parameters if name not in ("self", "cls") and x.kind not in variable]


def _methods(label: str, value: Any) -> dict[str, Any]:
    """Return the public methods of a class by their labels, inherited ones, too; none of what is no class."""
    methods = {}
    for key in dir(value) if isinstance(value, type) else ():
        method = inspect.getattr_static(value, key)
        method = getattr(method, "__func__", method)  # of a class, or static
        if not key.startswith("_") and inspect.isfunction(method):
            methods[f"{label}.{key}"] = method
    return methods


def _is_ours(function: Any) -> bool:
    """Return whether eomgen defines a function, or a class that is no error."""
    ours = str(getattr(function, "__module__", "")).startswith("eomgen")
    return ours and not (isinstance(function, type) and issubclass(function, Exception))
