"""Functions of every package whose values are made wrong: how they are chosen, listed, found again and mutated."""

from __future__ import annotations

import ast
import json
import random
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from .wrong import CONTROL, KINDS, PROCEDURE

HERE = Path(__file__).parent
LIST = HERE / "functions.json"
TOTAL, LEAST, SEED = 400, 10, 61
ROOTS = (("src/eomgen", "eomgen"), ("codegen", "codegen"))
LEFT_OUT = ("abstractmethod", "overload", "contextmanager", "asynccontextmanager")


@dataclass(frozen=True, order=True)
class Function:
    """A function, its file from the root, its name there, and the kind of its wrong value."""

    file: str
    name: str
    kind: str = ""

    @property
    def key(self) -> str:
        """Return file and name as one text."""
        return f"{self.file}::{self.name}"

    @property
    def package(self) -> str:
        """Return the folder of eomgen or codegen that it is in; of modules beside them the name of the root."""
        root, name = next((root, name) for root, name in ROOTS if self.file.startswith(f"{root}/"))
        inside = self.file.removeprefix(f"{root}/").split("/")
        return name if len(inside) == 1 else f"{name}/{inside[0]}" if name == "codegen" else inside[0]

    @property
    def pick(self) -> int:
        """Return a number that chooses fields and entries."""
        return zlib.crc32(self.name.encode())


def definitions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield functions of a module and methods of its classes, with qualified names."""
    waiting: list[tuple[str, Sequence[ast.stmt]]] = [("", tree.body)]
    while waiting:
        before, body = waiting.pop()
        for node in body:
            if isinstance(node, ast.FunctionDef):
                yield before + node.name, node
            elif isinstance(node, ast.ClassDef) and not any("Protocol" in ast.unparse(base) for base in node.bases):
                waiting.append((f"{before}{node.name}.", node.body))


def own_nodes(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Yield the nodes of a function's body that are in no function inside it."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            waiting.extend(ast.iter_child_nodes(node))


def _is_eligible(name: str, node: ast.FunctionDef) -> bool:
    if name.rpartition(".")[2].startswith("__"):
        return False
    if any(ast.unparse(d).split("(")[0].rpartition(".")[2] in LEFT_OUT for d in node.decorator_list):
        return False
    body = [x for x in node.body if not (isinstance(x, ast.Expr) and isinstance(x.value, ast.Constant))]
    return not all(isinstance(x, ast.Raise | ast.Pass) for x in body)


def _is_procedure(node: ast.FunctionDef) -> bool:
    return not any(
        isinstance(x, ast.Yield | ast.YieldFrom) or (isinstance(x, ast.Return) and x.value is not None)
        for x in own_nodes(node)
    )


def eligible(tree: Path) -> list[Function]:
    """Return every function of a checkout that a wrong value can be made of, of kind "procedure" or none."""
    found = {}
    for root, _ in ROOTS:
        for path in sorted((tree / root).rglob("*.py")):
            file = path.relative_to(tree).as_posix()
            if not file.startswith("src/eomgen/codegen/"):  # a link
                for name, node in definitions(ast.parse(path.read_text(encoding="utf-8"))):
                    function = Function(file, name, PROCEDURE if _is_procedure(node) else "")
                    found[function.key] = function if _is_eligible(name, node) else None  # of two the last one counts
    return [function for function in found.values() if function is not None]


def choose(functions: Sequence[Function], total: int = TOTAL, least: int = LEAST, seed: int = SEED) -> list[Function]:
    """Return functions of all packages, at least ``least`` of each that has so many, the others by its size."""
    rng = random.Random(seed)
    order = rng.sample(sorted(functions), len(functions))
    groups: dict[str, list[Function]] = {}
    for function in order:
        groups.setdefault(function.package, []).append(function)
    count = {package: min(least, len(group)) for package, group in groups.items()}
    while sum(count.values()) < min(total, len(functions)):  # where the share is the smallest
        open_ = [package for package, group in groups.items() if count[package] < len(group)]
        count[min(open_, key=lambda package: (count[package] / len(groups[package]), package))] += 1
    chosen = [function for package, group in groups.items() for function in group[: count[package]]]
    return sorted(replace(f, kind=f.kind or rng.choice(KINDS)) for f in sorted(chosen))


def renewed(listed: Sequence[Function], functions: Sequence[Function], seed: int = SEED) -> list[Function]:
    """Return the list with functions where they are now; random ones of the package take the place of those gone."""
    found, gone = located(listed, functions)
    rng = random.Random(seed)
    for old in gone:
        taken = {function.key for function in found}
        rest = sorted(f for f in functions if f.package == old.package and f.key not in taken)
        if rest:
            new = rng.choice(rest)
            found.append(replace(new, kind=new.kind or rng.choice(KINDS)))
    return sorted(found)


def located(listed: Sequence[Function], functions: Sequence[Function]) -> tuple[list[Function], list[Function]]:
    """Return the functions of a list as they are now, in another file if one alone has their name; and those gone."""
    here = {function.key: function for function in functions}
    by_name: dict[str, list[Function]] = {}
    for function in functions:
        by_name.setdefault(function.name, []).append(function)
    found, gone = [], []
    for old in listed:
        others = [here[old.key]] if old.key in here else by_name.get(old.name, [])
        if len(others) == 1:
            now = others[0].kind or (old.kind if old.kind != PROCEDURE else KINDS[old.pick % len(KINDS)])
            found.append(replace(others[0], kind=now))
        else:
            gone.append(old)
    return found, gone


def read_list(path: Path = LIST) -> list[Function]:
    """Return the functions of a list."""
    return [Function(**entry) for entry in json.loads(path.read_text(encoding="ascii"))]


def write_list(functions: Sequence[Function], path: Path = LIST) -> None:
    """Write a list, a line per function."""
    path.write_text("[\n" + ",\n".join(json.dumps(asdict(f)) for f in functions) + "\n]\n", encoding="ascii")


def mutated_text(source: str, functions: Sequence[Function], log: str = "", control: bool = False) -> str:
    """Return a file's text in which functions return wrong values, or right ones through the same decorator."""
    tree = ast.parse(source)
    lines = source.splitlines(keepends=True)
    nodes = dict(definitions(tree))
    inserted: list[tuple[int, str]] = []
    for f in functions:
        kind = CONTROL if control else f.kind
        node = nodes[f.name]
        inserted.append((node.lineno, f"{' ' * node.col_offset}@_wrong({kind!r}, {f.pick}, {log!r})\n"))
    header = [node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module == "__future__"]
    if not header and ast.get_docstring(tree) is not None:
        header = tree.body[:1]  # type: ignore[assignment]
    after = (header[-1].end_lineno or 0) if header else 0
    text = (HERE / "wrong.py").read_text(encoding="ascii")
    inside = "".join(f"    {line}" if line.strip() else line for line in text.splitlines(keepends=True))
    inserted.append((after + 1, f"def _wrong():\n{inside}    return wrong\n_wrong = _wrong()\n"))
    for line, new in sorted(inserted, reverse=True):
        lines.insert(line - 1, new)
    return "".join(lines)
