"""Keys of the cache: whatever a kernel depends on changes them, and a changed one is never served by an old entry."""

from __future__ import annotations

import ast
import hashlib
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cffi
import pytest

import eomgen
from eomgen.codegen.c.source import Source
from eomgen.codegen.package import compile as compiling
from eomgen.pipeline import cache
from eomgen.pipeline.generator_key import generator_files
from eomgen.pipeline.stages import load_kernel, make_source
from release.packages import link_package
from tests.support.quick_builds import QUICK, Q


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as one folder."""
    return link_package(tmp_path_factory.mktemp("links")) / "eomgen"


def imported(name: str, path: Path) -> set[str]:
    """Full names that a module of eomgen imports at its top or anywhere inside, by its syntax tree."""
    package = ["eomgen", *name.split("/")[:-1]]
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            found |= {name, *(f"{name}.{alias.name}" for alias in node.names)}
    return found


def test_the_hash_of_the_generator_covers_what_it_imports(package: Path) -> None:
    """All files of the generator, and every module of eomgen that they import, found here by their syntax trees."""
    files = generator_files()
    own = [path for room in ("codegen", "templates") for path in (package / room).rglob("*")]
    found = {path.relative_to(package).as_posix() for path in own if path.suffix in (".py", ".jinja")}
    assert len(found) > 60
    todo = [name for name in found if name.endswith(".py")]
    while todo:
        file = todo.pop()
        for name in imported(file, package / file):
            inner = name.removeprefix("eomgen.").replace(".", "/") if name.startswith("eomgen.") else None
            for file in () if inner is None else (f"{inner}.py", f"{inner}/__init__.py"):
                if (package / file).is_file() and file not in found:
                    found.add(file)
                    todo.append(file)
    assert found - set(files) == set()
    assert {"errors.py", "names.py"} < set(files)
    assert all(path.is_file() for path in files.values())


@pytest.mark.parametrize("deep", ["codegen/inner/deep.py", "templates/inner/deep.jinja", "codegen/__init__.py"])
def test_a_change_of_any_file_changes_the_hash(deep: str, package: Path, tmp_path: Path) -> None:
    """In a copy of the package: a file in a folder inside the generator counts as every other."""
    shutil.copytree(package, tmp_path / "eomgen", ignore=shutil.ignore_patterns("__pycache__"))
    target = tmp_path / "eomgen" / deep
    target.parent.mkdir(exist_ok=True)
    code = "from eomgen.pipeline.generator_key import generator_hash; print(generator_hash())"
    hashes = set()
    for text in ("", "# one\n", "# two\n"):
        target.write_text(text)
        where = {**os.environ, "PYTHONPATH": str(tmp_path)}
        run = subprocess.run([sys.executable, "-c", code], env=where, capture_output=True, text=True, check=True)
        hashes.add(run.stdout)
    assert len(hashes) == 3


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def altered(text: str, rng: random.Random) -> str:
    """One character replaced, left out or put in."""
    at, new = rng.randrange(max(len(text), 1)), rng.choice("abcxyz0123456789 .+-*/;")
    return rng.choice([text[:at] + new + text[at + 1 :], text[:at] + text[at + 1 :], text[:at] + new + text[at:]])


COMPILER = compiling.Compiler(("cc", "-m64"), "cc (Debian 12.2.0-14) 12.2.0", ("-DA=1",), ("-L/lib",))
FLAGS = ("-O2", "-march=native")


@pytest.fixture(scope="module")
def source() -> Source:
    return make_source(eomgen.load_robot("one_link"), QUICK)


def places_in(parts: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Ways to all texts and lists among the parts of a key."""
    if isinstance(parts, str | list):
        yield way
    for key, part in parts.items() if isinstance(parts, dict) else enumerate(parts) if isinstance(parts, list) else ():
        yield from places_in(part, (*way, key))


@pytest.mark.parametrize("changes", [8, pytest.param(100, marks=pytest.mark.soak)])
def test_the_key_covers_every_part(changes: int, source: Source) -> None:
    """Random changes of each text that a package depends on: as many keys, and that of none; lists likewise."""
    parts, rng = compiling.dependencies(source, COMPILER, FLAGS), random.Random(1)
    assert compiling.build_key(source, COMPILER, FLAGS) == compiling.key_of(parts)
    keys, count = {compiling.key_of(parts)}, 0
    for *way, last in places_in(parts):
        owner = parts
        for key in way:
            owner = owner[key]
        start = owner[last]
        texts = {start} if isinstance(start, str) else set()
        while isinstance(start, str) and len(texts) < changes + 1:
            texts.add(altered(rng.choice(sorted(texts)) if len(start) < 40 else start, rng))
        for changed in texts - {start} if texts else ([*start, "x"], ["x", *start]):
            owner[last] = changed
            keys.add(compiling.key_of(parts))
            count += 1
        owner[last] = start
    assert len(keys) == count + 1
    assert count > 30 * changes


def test_the_parts_are_all_that_a_package_depends_on(source: Source, package: Path) -> None:
    """Source, compiler, flags, the machine; what is carried and how it is put together, as the files are."""
    parts = compiling.dependencies(source, COMPILER, FLAGS)
    assert parts["source"] == vars(source)
    assert (parts["command"], parts["compiler"]) == (["cc", "-m64"], COMPILER.version)
    assert (parts["flags"], parts["environment"]) == (["-O2", "-march=native"], [["-DA=1"], ["-L/lib"]])
    assert (parts["eomgen"], parts["cffi"]) == (eomgen.__version__, cffi.__version__)
    assert parts["interface"] == compiling.interface()
    assert {"suffix", "python", "headers", "system", "machine", "library"} == set(parts["interface"])
    assert parts["carried"] == {name: sha256(package / name) for name in compiling.carried_files()}
    assert {"errors.py", "names.py", "runtime/kernel.py"} < set(parts["carried"])
    made = {name: Path(compiling.__file__).with_name(name) for name in ("compile.py", "library.py")}
    made[compiling.PACKAGE] = package / "templates" / compiling.PACKAGE
    assert parts["package"] == {name: sha256(path) for name, path in made.items()}


def test_flags_and_command_are_kept_apart(source: Source) -> None:
    one = compiling.build_key(source, compiling.Compiler(("ccache", "cc"), "1"), ("-O2",))
    other = compiling.build_key(source, compiling.Compiler(("cc",), "1"), ("-O2", "ccache"))
    assert one != other


@pytest.mark.parametrize(("flag", "tuned"), [("-O2", False), ("-march=native", True), ("-mcpu=native", True)])
def test_only_code_for_this_processor_depends_on_it(flag: str, tuned: bool) -> None:
    assert compiling.processor()
    assert compiling.toolchain(COMPILER, (flag,))["processor"] == (compiling.processor() if tuned else "")


def test_another_source_gives_another_kernel(source: Source, empty_cache: Path) -> None:
    """In one process and in the same cache: what was compiled last is what runs, and the old one stays what it was."""
    compiler = compiling.find_compiler()
    assert source.code.count("0.3333333333333333") > 0
    sources = [source, replace(source, code=source.code.replace("0.3333333333333333", "1.25"))]
    kernels = []
    for changed in sources:
        key = compiling.build_key(changed, compiler, ("-O0",))
        package = cache.entry(
            "packages", key, lambda folder, s=changed: compiling.write_package(s, compiler, ("-O0",), folder)
        )
        kernels.append(load_kernel(package, "one_link"))
    assert [kernel.mass_matrix(Q)[1, 1] for kernel in kernels] == [1.0 / 3.0, 1.25]
