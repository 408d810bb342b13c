"""The generator with one of its modules changed: what mutation testing runs its checks on."""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.abc import InspectLoader, MetaPathFinder
from pathlib import Path
from types import ModuleType

import eomgen.codegen

PACKAGE = "eomgen.codegen"
FOLDER = Path(eomgen.codegen.__path__[0])


def source_of(module: str) -> str:
    """The text of a module of the generator."""
    return (FOLDER / f"{module}.py").read_text(encoding="utf-8")


@cache
def _imports() -> dict[str, set[str]]:
    """Per module of the generator those that it imports."""
    found: dict[str, set[str]] = {}
    for path in FOLDER.glob("*.py"):
        used = found[path.stem] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == 1:
                used |= {node.module} if node.module else {alias.name for alias in node.names}
    return found


def dependents(module: str) -> set[str]:
    """The module and all that import it, over however many others."""
    found, waiting = {module}, [module]
    while waiting:
        of = waiting.pop()
        fresh = {name for name, used in _imports().items() if of in used} - found
        found |= fresh
        waiting.extend(fresh)
    return found


class _Loader(InspectLoader):
    def __init__(self, text: str) -> None:
        self.text = text

    def get_source(self, fullname: str) -> str:
        return self.text


class _Finder(MetaPathFinder):
    def __init__(self, name: str, text: str) -> None:
        self.name, self.loader = name, _Loader(text)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        return importlib.util.spec_from_loader(fullname, self.loader) if fullname == self.name else None


@contextmanager
def mutated(module: str, text: str) -> Iterator[None]:
    """Inside, the module has another text, and it and all that import it are imported anew; then all is as it was."""
    gone = [f"{PACKAGE}.{name}" for name in dependents(module)]
    package = sys.modules[PACKAGE]
    before = {name: sys.modules.pop(name) for name in gone if name in sys.modules}
    finder = _Finder(f"{PACKAGE}.{module}", text)

    def forget() -> None:
        for name in gone:
            sys.modules.pop(name, None)
            vars(package).pop(name.rpartition(".")[2], None)

    forget()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        forget()
        sys.modules.update(before)
        vars(package).update({name.rpartition(".")[2]: loaded for name, loaded in before.items()})
