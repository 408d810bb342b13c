"""Table of the packages, from the contracts in pyproject.toml and the docstrings of the packages."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
FOLDERS = {"eomgen.codegen": "codegen", "eomgen.templates": "templates", "eomgen": "src/eomgen"}


def table() -> str:
    """Table of all packages by layers, the highest first; layers of modules alone at the bottom are one row."""
    layers = [layer.split(" | ") for layer in contracts()["layers"]["layers"]]
    inner = contracts()["generator"]["layers"]
    modules = 0
    while not any(file_of(f"eomgen.{name}").name == "__init__.py" for name in layers[-1 - modules]):
        modules += 1
    rows = ["| layer | package | purpose |", "|---:|---|---|"]
    for number, names in zip(range(len(layers), modules, -1), layers, strict=False):
        for name in names:
            rows.append(row(str(number), name))
            if name == "codegen":
                rows += [row(f"{number}.{len(inner) - i}", f"codegen.{one}") for i, one in enumerate(inner)]
    lowest = [f"`{name}`" for names in layers[len(layers) - modules :] for name in names if name[0] != "_"]
    rows.append(f"| 1 to {modules} | modules | {', '.join(lowest)} |")
    return "\n".join(rows)


def row(layer: str, name: str) -> str:
    """Return a row of the table: the purpose is the first sentence of the package's docstring."""
    text = " ".join((ast.get_docstring(ast.parse(file_of(f"eomgen.{name}").read_text(encoding="utf-8"))) or "").split())
    purpose = re.split(r"\.(?: (?=[A-Z])|$)", text)[0]
    return f"| {layer} | `{name}` | {_cell(purpose)} |"


def rules() -> str:
    """List of the names of all contracts."""
    return "\n".join(f"- {found['name']}." for found in contracts().values())


def contracts() -> dict[str, dict[str, Any]]:
    """The contracts of import-linter by their ids."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    return {found["id"]: found for found in settings["contracts"]}


def file_of(name: str) -> Path:
    """File of a package's ``__init__``, or of a module."""
    package = next(package for package in FOLDERS if f"{name}.".startswith(f"{package}."))
    base = ROOT.joinpath(FOLDERS[package], *name.removeprefix(package).strip(".").split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


def _cell(text: str) -> str:
    return re.sub(r"``([^`]*)``", r"`\1`", text).replace("|", r"\|").replace("<", "&lt;")
