"""Check that docstrings begin with a verb or a noun; ``make lint`` runs it: python -m tests.support.first_words."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLACES = ("src", "codegen", "templates")
LEANING = re.compile(r"(Of|That|Those|As|What|Where|The same|By how much)\b")  # they lean on what stands before


def leaning(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield line, name and first line of docstrings that begin so, of a module's text."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.AsyncFunctionDef, ast.FunctionDef, ast.ClassDef, ast.Module)):
            said = ast.get_docstring(node) or ""
            if LEANING.match(said):
                yield getattr(node, "lineno", 1), getattr(node, "name", ""), said.splitlines()[0]


def modules() -> Iterable[Path]:
    """All modules of the product, each once; eomgen has links to the folders beside it."""
    return sorted({path.resolve() for place in PLACES for path in (ROOT / place).rglob("*.py")})


def main() -> int:
    """Print the docstrings; 1 if there are any."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {name}: {said}"
        for path in modules()
        for line, name, said in leaning(path.read_text(encoding="utf-8"))
    ]
    print("\n".join(wrong) or f"{len(list(modules()))} modules: docstrings begin with a verb or a noun")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
