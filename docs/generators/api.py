"""Reference of the Python interface: the facade, then a page per subject with its packages, filled from docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from importlib import import_module

import eomgen

# What stands on which page: packages and modules, of which what ``__all__`` names is shown.
PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "api_robots": ("Robots and their parts", ("eomgen.robot", "eomgen.description")),
    "api_simulation": ("Simulation", ("eomgen.simulation", "eomgen.scenario", "eomgen.integration", "eomgen.motion")),
    "api_runtime": ("Compiled kernels as they are", ("eomgen.runtime.raw",)),
    "api_loops": ("Closed loops", ("eomgen.loops",)),
    "api_analysis": ("Analysis about a state", ("eomgen.analysis",)),
    "api_control": ("Control", ("eomgen.control",)),
    "api_identification": ("Measured motion", ("eomgen.identification",)),
    "api_adapters": (
        "Optimal control and learning",
        ("eomgen.adapters.casadi", "eomgen.adapters.jax", "eomgen.adapters.torch"),
    ),
    "api_sweeps": ("Sweeps", ("eomgen.sweep",)),
    "api_pictures": ("Pictures", ("eomgen.pictures",)),
}
ERRORS = tuple(name for name in eomgen.__all__ if name.startswith("Integration") or name.endswith(("Error", "Warning")))


def main_page() -> str:
    """What ``import eomgen`` gives, kernels first, with links to the other pages."""
    links = [f"- [{title}]({name}.md): {', '.join(f'`{x}`' for x in inner)}" for name, (title, inner) in PAGES.items()]
    functions = [name for name in eomgen.__all__ if inspect.isfunction(getattr(eomgen, name))]
    lines = [
        "# Python interface",
        "",
        "What `import eomgen` gives; written from the docstrings. Arrays are (n,) or (..., n), SI units and radians. "
        "Where a robot is asked for, a `Robot`, the name of a built-in one and the path of a description do alike. "
        "What belongs to a subject is in its package, which needs no import of its own: `eomgen.analysis.modes(...)`.",
        "",
        *links,
        "",
        *_shown("eomgen", ["Kernel"], "inherited_members: true"),
        *_shown("eomgen", functions),
        "## Errors",
        "",
        *_shown("eomgen", ERRORS),
    ]
    return "\n".join(lines)


def pages() -> dict[str, str]:
    """The pages by their names without ending."""
    found = {}
    for name, (title, packages) in PAGES.items():
        lines = [f"# {title}", ""]
        for package in packages:
            lines += [f"## {package}", "", f"{(inspect.getdoc(import_module(package)) or '').splitlines()[0]}", ""]
            lines += _elsewhere(package)
            for where, names in (("eomgen", facade_classes(package)), (package, own(package))):
                lines += _shown(where, names)
        found[name] = "\n".join(lines)
    return found


def facade_classes(package: str) -> list[str]:
    """Classes of a package that the facade has, too: they are called eomgen.NAME."""
    module = import_module(package)
    names = (name for name in module.__all__ if name in eomgen.__all__)
    return [name for name in names if inspect.isclass(getattr(module, name))]


def own(package: str) -> list[str]:
    """What a package has and the facade has not: functions, then classes."""
    module = import_module(package)
    names = [name for name in module.__all__ if name not in eomgen.__all__]
    kinds = (inspect.isfunction, inspect.isclass)
    return [name for kind in kinds for name in names if kind(getattr(module, name))]


def _elsewhere(package: str) -> Iterator[str]:
    """A line about functions of a package that stand on the main page."""
    module = import_module(package)
    names = [name for name in module.__all__ if name in eomgen.__all__ and inspect.isfunction(getattr(module, name))]
    if names:
        yield "On the facade: " + ", ".join(f"[`eomgen.{name}`](api.md#eomgen.{name})" for name in names) + "."
        yield ""


def _shown(where: str, names: list[str] | tuple[str, ...], *options: str) -> list[str]:
    set_ = ["    options:", *(f"      {option}" for option in options)] if options else []
    return [line for name in names for line in (f"::: {where}.{name}", *set_, "")]
