"""eomgen can be imported on every system, and compilers for all of them take what it generates."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from eomgen.description.builtin import builtin_robots
from eomgen.pipeline.generating import package_options
from eomgen.pipeline.stages import make_source
from tests.support.c_project import WARNINGS, need, write_source
from tests.support.optional import needs
from tests.support.soak import soaked

ROOT = Path(__file__).parents[2]
POSIX_ONLY = {
    *("crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource", "spwd", "syslog"),
    *("termios", "tty"),
}
TARGETS = {  # compilers and what they compile for
    "gcc": ("gcc",),
    "clang": ("clang",),
    "zig": (sys.executable, "-m", "ziglang", "cc"),
    "windows": (sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"),
    "macos": (sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-macos"),
}
QUICK = {("one_link", target) for target in TARGETS} | {("four_bar", "windows"), ("four_bar", "macos")}


def imported(body: list[ast.stmt]) -> Iterator[str]:
    """Names of packages that statements import when a module is imported: not those within functions."""
    for statement in body:
        if isinstance(statement, ast.Import):
            yield from (name.name.partition(".")[0] for name in statement.names)
        elif isinstance(statement, ast.ImportFrom) and not statement.level:
            yield (statement.module or "").partition(".")[0]
        elif not isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef)):
            for field in ("body", "orelse", "finalbody"):
                yield from imported(getattr(statement, field, []))
            for handler in getattr(statement, "handlers", []):
                yield from imported(handler.body)


@pytest.mark.quick
def test_no_module_needs_posix_to_be_imported() -> None:
    found: dict[str, set[str]] = {}
    for path in (*(ROOT / "src").rglob("*.py"), *(ROOT / "codegen").rglob("*.py")):
        found[path.relative_to(ROOT).as_posix()] = {*imported(ast.parse(path.read_text(encoding="utf-8")).body)}
    assert len(found) > 500
    assert "numpy" in found["src/eomgen/runtime/raw.py"]
    assert {place: names & POSIX_ONLY for place, names in found.items() if names & POSIX_ONLY} == {}


@pytest.mark.quick
def test_imports_are_found_wherever_they_stand() -> None:
    text = "try:\n  import fcntl\nexcept ImportError:\n  from pwd import x\nif True:\n  pass\nelse:\n  import tty.a\n"
    assert [*imported(ast.parse(f"{text}def f():\n    import grp\n").body)] == ["fcntl", "pwd", "tty"]


@pytest.mark.parametrize(
    ("robot", "target"), soaked([(robot, target) for robot in builtin_robots() for target in TARGETS], QUICK)
)
def test_compilers_for_all_systems_take_packages(robot: str, target: str, tmp_path: Path) -> None:
    command = TARGETS[target]
    if "ziglang" in command:
        needs("ziglang", extra="compiler")
    else:
        need(command[0])
    source = make_source(robot, package_options(robot))
    write_source(source, tmp_path)
    assert [*source.codes] == [f"{source.name}.c", f"{source.name}_batch.c"]
    for code in source.codes:
        words = [*command, "-std=c99", *WARNINGS, "-O0", "-c", code, "-o", "code.o"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[:4000]
