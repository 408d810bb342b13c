"""Tables of the rooms, from the contracts in pyproject.toml and the first lines of their folders."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
FOLDERS = {"eomgen.codegen": "codegen", "eomgen.templates": "templates", "eomgen": "src/eomgen"}


def floors(contract: str) -> str:
    """Table of the layers of a contract, the top floor first: each room, its purpose, what it uses."""
    found = contracts()[contract]
    (container,) = found["containers"]
    rows = ["| floor | room | what it is for | uses |", "|---:|---|---|---|"]
    for number, layer in zip(range(len(found["layers"]), 0, -1), found["layers"], strict=True):
        for index, room in enumerate(layer.split(" | ")):
            purpose, uses = about(file_of(f"{container}.{room}"))
            rows.append(f"| {'' if index else number} | `{room}` | {_cell(purpose)} | {_cell(uses)} |")
    return "\n".join(rows)


def rules() -> str:
    """List of the names of all contracts."""
    return "\n".join(f"- {found['name']}." for found in contracts().values())


def contracts() -> dict[str, dict[str, Any]]:
    """The contracts of import-linter by their ids."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    return {found["id"]: found for found in settings["contracts"]}


def file_of(name: str) -> Path:
    """File of a room's ``__init__``, or of a module of the root."""
    package = next(package for package in FOLDERS if f"{name}.".startswith(f"{package}."))
    base = ROOT.joinpath(FOLDERS[package], *name.removeprefix(package).strip(".").split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


def about(path: Path) -> tuple[str, str]:
    """Purpose and uses of a room, as its docstring has them: a first line, and a sentence that begins with "Uses"."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    purpose, _, uses = text.partition("Uses ")
    return (" ".join(purpose.split()) if uses else text.splitlines()[0]), " ".join(uses.split()).rstrip(".")


def _cell(text: str) -> str:
    return re.sub(r"``([^`]*)``", r"`\1`", text).replace("|", r"\|").replace("<", "&lt;")
