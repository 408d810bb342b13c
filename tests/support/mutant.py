"""Changes of files, and the generator with one of its modules changed: what mutation testing runs its checks on."""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.abc import InspectLoader, MetaPathFinder
from pathlib import Path
from types import ModuleType

import eomgen.codegen

PACKAGE = "eomgen.codegen"
FOLDER = Path(eomgen.codegen.__path__[0])


@dataclass(frozen=True)
class Mutant:
    """A change of a file: its bytes ``start`` to ``end`` become ``text``, in a line of a function."""

    module: str
    line: int
    function: str
    start: int
    end: int
    text: str

    def place(self) -> tuple[int, int, str]:
        """Return the key by which mutants of a module are ordered."""
        return self.start, self.end, self.text

    def applied(self, source: str) -> str:
        """Return the module's text with the change."""
        raw = source.encode()
        return (raw[: self.start] + self.text.encode() + raw[self.end :]).decode()

    def change(self, source: str) -> str:
        """Return the lines that it touches, before and after."""
        raw = source.encode()
        first, last = raw.rfind(b"\n", 0, self.start) + 1, raw.find(b"\n", self.end)
        after = raw[first : self.start] + self.text.encode() + raw[self.end : last]
        old, new = (" ".join(text.decode().split()) for text in (raw[first:last], after))
        return f"{old} -> {new}"

    @classmethod
    def replacing(cls, module: str, source: str, old: str, new: str, begin: int = 0) -> Mutant:
        """Return the mutant with another text instead of one that the module has from ``begin`` on."""
        assert old in source[begin:], f"{module}: the code has changed: change the list of mutants too: {old}"
        start = len(source[: source.index(old, begin)].encode())
        return cls(module, source.count("\n", 0, start) + 1, "", start, start + len(old.encode()), new)


@cache
def modules() -> dict[str, Path]:
    """Where every module of the generator lies, by its name inside the generator ("tree.bound"); packages are none."""
    files = files_of(FOLDER, PACKAGE)
    return {name.removeprefix(f"{PACKAGE}."): path for name, path in files.items() if path.name != "__init__.py"}


def full_name(module: str) -> str:
    """The name that Python imports a module of the generator by."""
    if module not in modules():
        raise ValueError(f"no module of the generator: {module!r}")
    return f"{PACKAGE}.{module}"


def source_of(module: str) -> str:
    """The text of a module of the generator."""
    full_name(module)
    return modules()[module].read_text(encoding="utf-8")


def files_of(folder: Path, package: str) -> dict[str, Path]:
    """Files of a package in a folder, those of packages inside it too, by full name."""
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        if path.is_file():
            found[".".join((package, *(parts[:-1] if parts[-1] == "__init__" else parts)))] = path
    return found


def imports_of(folder: Path, package: str) -> dict[str, set[str]]:
    """Per module and package in a folder those of them that it imports, packages around them included: full names."""
    files = files_of(folder, package)
    found: dict[str, set[str]] = {}
    for name, path in files.items():
        around = name if path.name == "__init__.py" else name.rpartition(".")[0]
        words = [word.split(".") for word in (name, *_words(ast.parse(path.read_text(encoding="utf-8")), around))]
        used = {".".join(parts[:end]) for parts in words for end in range(1, len(parts) + 1)}
        found[name] = used & files.keys() - {name}
    return found


def _words(tree: ast.Module, package: str) -> Iterator[str]:
    """Full names of all that the imports of a text name, modules or not; ``package`` is the one that it is in."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            yield from (base, *(f"{base}.{alias.name}" for alias in node.names))


_imports = cache(imports_of)


def dependents(module: str) -> set[str]:
    """The module and all of the generator that import it, over however many others."""
    return {name.removeprefix(f"{PACKAGE}.") for name in _importers(full_name(module))}


def _importers(name: str) -> set[str]:
    """The same by full names."""
    found, waiting = {name}, [name]
    while waiting:
        of = waiting.pop()
        fresh = {other for other, used in _imports(FOLDER, PACKAGE).items() if of in used} - found
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
    gone = _importers(full_name(module))
    before = {name: sys.modules.pop(name) for name in gone if name in sys.modules}
    finder = _Finder(full_name(module), text)

    def forget() -> None:
        for name in gone:
            sys.modules.pop(name, None)
        for name in gone:
            parent, _, last = name.rpartition(".")
            if parent in sys.modules:
                vars(sys.modules[parent]).pop(last, None)

    forget()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        forget()
        sys.modules.update(before)
        for name, loaded in before.items():
            parent, _, last = name.rpartition(".")
            if parent not in gone:  # a package that is back has kept what it held
                setattr(sys.modules[parent], last, loaded)
