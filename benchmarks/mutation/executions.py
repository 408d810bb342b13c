"""Which tests execute which function, and how long they take: from coverage.py's contexts and JUnit's times."""

from __future__ import annotations

import ast
import gzip
import json
import re
import sqlite3
import statistics
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from .functions import Function, definitions, own_nodes

PHASE = re.compile(r"( \((setup|call|teardown)\)|\|(setup|run|teardown))+$")  # of pytest's variable, of pytest-cov


class Executions:
    """Tests with their seconds, and per function the set of those that execute it, as bits of a number."""

    def __init__(self, tests: Sequence[tuple[str, float]], functions: dict[str, int]) -> None:
        self.tests, self.functions = tests, functions

    def of(self, function: Function) -> list[tuple[str, float]]:
        """Return the tests that execute a function; where none is known, those in the folder named like its package."""
        bits = self.functions.get(function.key, 0)
        if bits:
            return [test for i, test in enumerate(self.tests) if bits >> i & 1]
        folder = f"tests/{function.package}/"
        return [test for test in self.tests if test[0].startswith(folder)]

    def ranked(self, function: Function, tree: Path) -> list[tuple[str, float]]:
        """Return tests of a function: those that execute it, then those that may use what others let it compute.

        The latter are in the same modules, whose fixtures one test alone executes; of the generator, whose kernels come
        from a cache, also in modules that contain its name, or in the folder named like its package.  Of both one case
        of each test comes before others; of these those of the package or of such modules; then cheap ones.
        """
        near, own = f"tests/{function.package}/", {test for test, _ in self.of(function)}
        named = self._naming(function, tree)
        beside = {test.partition("::")[0] for test in own} | named
        place: dict[tuple[str, float], tuple[bool, int, bool, float]] = {}
        seen = dict[str, int]()
        for test, seconds in sorted(self.tests, key=lambda x: x[1]):
            module, name = test.partition("::")[0], test.partition("[")[0]
            if test in own or module in beside or (function.file.startswith("codegen/") and test.startswith(near)):
                seen[name] = seen.get(name, -1) + 1
                is_near = module in named or test.startswith(near)
                place[test, seconds] = test not in own, seen[name], not is_near, seconds
        return sorted(place, key=place.__getitem__)

    def _naming(self, function: Function, tree: Path) -> set[str]:
        """Return modules of tests that contain the name of a function of the generator."""
        if not function.file.startswith("codegen/"):
            return set()
        word = re.compile(rf"\b{re.escape(function.name.rpartition('.')[2].strip('_'))}\b")
        modules = {test.partition("::")[0] for test, _ in self.tests}
        return {x for x in modules if (tree / x).exists() and word.search((tree / x).read_text(encoding="utf-8"))}

    def write(self, path: Path) -> None:
        """Write a compressed file."""
        data = {"tests": self.tests, "functions": {key: hex(bits) for key, bits in self.functions.items()}}
        with gzip.open(path, "wt", encoding="utf-8") as file:
            json.dump(data, file)


def read_executions(path: Path) -> Executions:
    """Read what ``Executions.write`` has written."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        data = json.load(file)
    return Executions([(x, y) for x, y in data["tests"]], {key: int(b, 16) for key, b in data["functions"].items()})


def read_coverage(data: Path, times: Path, tree: Path) -> Executions:
    """Read coverage.py's file of a run whose contexts are tests, and pytest's JUnit file of the same run."""
    seconds = _seconds(times)
    usual = statistics.median(seconds.values()) if seconds else 1.0
    with sqlite3.connect(f"file:{data}?mode=ro", uri=True) as database:
        names = {i: PHASE.sub("", name) for i, name in database.execute("SELECT id, context FROM context")}
        tests = sorted({name for name in names.values() if "::" in name})
        index = {test: i for i, test in enumerate(tests)}
        bit = {i: 1 << index[name] for i, name in names.items() if name in index}
        functions: dict[str, int] = {}
        for file_id, path in database.execute("SELECT id, path FROM file").fetchall():
            if (file := _file(path)) is None or not (tree / file).exists():
                continue
            masks = _masks(tree / file)
            found = dict.fromkeys(masks, 0)
            rows = database.execute("SELECT context_id, numbits FROM line_bits WHERE file_id = ?", (file_id,))
            for context, numbits in rows:
                if context in bit:
                    lines = int.from_bytes(numbits, "little")
                    for name, mask in masks.items():
                        if lines & mask:
                            found[name] |= bit[context]
            for name, bits in found.items():
                if bits:
                    key = f"{file}::{name}"
                    functions[key] = functions.get(key, 0) | bits
    return Executions([(test, seconds.get(_junit_name(test), usual)) for test in tests], functions)


def _file(path: str) -> str | None:
    found = re.search(r"(?:/|^)(?:src/eomgen/)?(codegen/.*)$|(?:/|^)(src/eomgen/.*)$", path)
    return (found[1] or found[2]) if found else None


def _masks(path: Path) -> dict[str, int]:
    """Per function of a file its lines, as bits, without those that are executed at import."""
    masks = {}
    for name, node in definitions(ast.parse(path.read_text(encoding="utf-8"))):
        body = {x.lineno for x in own_nodes(node) if hasattr(x, "lineno")} - {node.lineno}
        masks[name] = sum(1 << line for line in body)
    return masks


def _seconds(times: Path) -> dict[tuple[str, str], float]:
    found: dict[tuple[str, str], float] = {}
    for case in ElementTree.parse(times).iter("testcase") if times.exists() else ():
        key = case.get("classname", ""), case.get("name", "")
        found[key] = found.get(key, 0.0) + float(case.get("time", 0.0))
    return found


def _junit_name(test: str) -> tuple[str, str]:
    head, bracket, case = test.partition("[")
    file, *names = head.split("::")
    return ".".join([file.removesuffix(".py").replace("/", "."), *names[:-1]]), names[-1] + bracket + case
