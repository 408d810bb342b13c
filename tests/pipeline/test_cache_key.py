"""Keys of the cache: whatever a kernel depends on changes them, and a changed one is never served by an old entry."""

from __future__ import annotations

import ast
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import eomgen
from eomgen.codegen.c.source import Source
from eomgen.codegen.package import compile as compiling
from eomgen.pipeline import cache
from eomgen.pipeline.generator_files import generator_files
from eomgen.pipeline.stages import _cached_package, load_kernel
from tests.support.quick_builds import QUICK, Q

EOMGEN = Path(eomgen.__path__[0])


def imported(path: Path) -> set[str]:
    """Full names that a module of eomgen imports at its top or anywhere inside, by its syntax tree."""
    parts = list(path.relative_to(EOMGEN).with_suffix("").parts)
    package = ["eomgen", *parts[:-1]]
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            found |= {name, *(f"{name}.{alias.name}" for alias in node.names)}
    return found


def test_the_hash_of_the_generator_covers_what_it_imports() -> None:
    """All files of the generator, and every module of eomgen that they import, found here by their syntax trees."""
    files = generator_files()
    own = [path for room in ("codegen", "templates") for path in (EOMGEN / room).rglob("*")]
    found = {path.relative_to(EOMGEN).as_posix() for path in own if path.suffix in (".py", ".jinja")}
    assert len(found) > 60
    todo = [EOMGEN / name for name in found if name.endswith(".py")]
    while todo:
        for name in imported(todo.pop()):
            inner = Path(*name.split(".")[1:]) if name.startswith("eomgen.") else None
            for path in () if inner is None else (EOMGEN / inner.with_suffix(".py"), EOMGEN / inner / "__init__.py"):
                if path.is_file() and path.relative_to(EOMGEN).as_posix() not in found:
                    found.add(path.relative_to(EOMGEN).as_posix())
                    todo.append(path)
    assert found - set(files) == set()
    assert {"errors.py", "names.py"} < set(files)
    assert all(path.is_file() for path in files.values())


@pytest.mark.parametrize("deep", ["codegen/inner/deep.py", "templates/inner/deep.jinja", "codegen/__init__.py"])
def test_a_change_of_any_file_changes_the_hash(deep: str, tmp_path: Path) -> None:
    """In a copy of the package: a file in a folder inside the generator counts as every other."""
    shutil.copytree(EOMGEN, tmp_path / "eomgen", ignore=shutil.ignore_patterns("__pycache__"))
    target = tmp_path / "eomgen" / deep
    target.parent.mkdir(exist_ok=True)
    code = "from eomgen.pipeline.generator_files import generator_hash; print(generator_hash())"
    hashes = set()
    for text in ("", "# one\n", "# two\n"):
        target.write_text(text)
        where = {**os.environ, "PYTHONPATH": str(tmp_path)}
        run = subprocess.run([sys.executable, "-c", code], env=where, capture_output=True, text=True, check=True)
        hashes.add(run.stdout)
    assert len(hashes) == 3


def altered(text: str, rng: random.Random) -> str:
    """One character replaced, left out or put in."""
    at, new = rng.randrange(len(text)), rng.choice("abcxyz0123456789 .+-*/;")
    return rng.choice([text[:at] + new + text[at + 1 :], text[:at] + text[at + 1 :], text[:at] + new + text[at:]])


COMPILER = compiling.Compiler(("cc", "-m64"), "cc (Debian 12.2.0-14) 12.2.0")
FLAGS = ("-O2", "-march=native")
INTERFACE = compiling.interface()
KEY_OF: dict[str, Callable[[pytest.MonkeyPatch, Source, str], str]] = {
    **{
        name: lambda _, source, text, name=name: compiling.build_key(replace(source, **{name: text}), COMPILER, FLAGS)
        for name in ("header", "code", "cdef", "meta")
    },
    "flags": lambda _, source, text: compiling.build_key(source, COMPILER, (*FLAGS, *text.split(" "))),
    "command": lambda _, source, text: compiling.build_key(
        source, replace(COMPILER, command=tuple(text.split(" "))), FLAGS
    ),
    "version": lambda _, source, text: compiling.build_key(source, replace(COMPILER, version=text), FLAGS),
    **{
        name: lambda patch, source, text, name=name: (
            patch.setattr(compiling, "interface", lambda: {**INTERFACE, name: text}),
            compiling.build_key(source, COMPILER, FLAGS),
        )[1]
        for name in INTERFACE
    },
    "processor": lambda patch, source, text: (
        patch.setattr(compiling, "processor", lambda: text),
        compiling.build_key(source, COMPILER, FLAGS),
    )[1],
    "eomgen": lambda patch, source, text: (
        patch.setattr(compiling, "__version__", text),
        compiling.build_key(source, COMPILER, FLAGS),
    )[1],
    "cffi": lambda patch, source, text: (
        patch.setattr(compiling.cffi, "__version__", text),
        compiling.build_key(source, COMPILER, FLAGS),
    )[1],
}


@pytest.mark.parametrize("component", KEY_OF)
def test_the_key_covers(component: str, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred random changes of each thing that a package depends on: a hundred and one keys."""
    rng = random.Random(component)
    source = one_link_source()
    start = {
        **vars(source),
        **INTERFACE,
        "flags": "-DA=1 -DB=2",
        "command": "cc -m64",
        "version": COMPILER.version,
        "processor": compiling.processor(),
        "eomgen": eomgen.__version__,
        "cffi": compiling.cffi.__version__,
    }[component]
    texts = {start}
    while len(texts) < 101:
        texts.add(altered(rng.choice(sorted(texts)) if len(start) < 40 else start, rng) or "0")
    keys = {}
    for text in sorted(texts):
        with pytest.MonkeyPatch.context() as patch:
            keys[text] = KEY_OF[component](patch, source, text)
    assert len(set(keys.values())) == 101
    assert KEY_OF[component](monkeypatch, source, start) == keys[start]


def one_link_source() -> Source:
    entry = _cached_package(eomgen.load_robot("one_link"), QUICK, lambda _: None)
    assert entry.kind == "packages"
    (folder,) = (cache.cache_folder() / "sources").iterdir()
    return Source(**json.loads((folder / "source.json").read_text(encoding="ascii")))


@pytest.mark.parametrize("file", [*compiling.carried_files(), "compile.py", "package.py.jinja"])
def test_the_key_covers_what_is_packed(
    file: str, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also what is copied into a package, and how it is put together."""
    rng, source, keys = random.Random(file), one_link_source(), set[str]()
    if file == "compile.py":
        text, other = Path(compiling.__file__).read_text(), tmp_path / file
        monkeypatch.setattr(compiling, "__file__", str(other))
    elif file == "package.py.jinja":
        text, other = compiling._template().read_text(), tmp_path / file
        monkeypatch.setattr(compiling, "_template", lambda: other)
    else:
        carried = compiling.carried_files()
        text, other = carried[file].read_text(), tmp_path / "carried.py"
        monkeypatch.setattr(compiling, "carried_files", lambda: {**carried, file: other})
    texts = {text}
    while len(texts) < 101:
        texts.add(altered(text, rng))
    for changed in sorted(texts):
        other.write_text(changed)
        keys.add(compiling.build_key(source, COMPILER, FLAGS))
    assert len(keys) == 101


def test_flags_and_command_are_kept_apart(empty_cache: Path) -> None:
    source = one_link_source()
    one = compiling.build_key(source, compiling.Compiler(("ccache", "cc"), "1"), ("-O2",))
    other = compiling.build_key(source, compiling.Compiler(("cc",), "1"), ("-O2", "ccache"))
    assert one != other


def test_only_code_for_this_processor_depends_on_it(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = one_link_source()
    monkeypatch.setattr(compiling, "processor", lambda: "another one")
    changed = [compiling.build_key(source, COMPILER, flags) for flags in ((), ("-march=native",), ("-mcpu=native",))]
    monkeypatch.undo()
    now = [compiling.build_key(source, COMPILER, flags) for flags in ((), ("-march=native",), ("-mcpu=native",))]
    assert [a == b for a, b in zip(changed, now, strict=True)] == [True, False, False]


def test_another_source_gives_another_kernel(empty_cache: Path) -> None:
    """In one process and in the same cache: what was compiled last is what runs, and the old one stays what it was."""
    compiler, sources = compiling.find_compiler(), [one_link_source()]
    code = sources[0].code
    assert code.count("0.3333333333333333") > 0
    sources += [replace(sources[0], code=code.replace("0.3333333333333333", f"{number}.25")) for number in range(1, 4)]
    kernels = []
    for source in sources:
        key = compiling.build_key(source, compiler, ("-O0",))
        package = cache.entry(
            "packages", key, lambda folder, s=source: compiling.write_package(s, compiler, ("-O0",), folder)
        )
        kernels.append(load_kernel(package, "one_link"))
    assert [kernel.mass_matrix(Q)[1, 1] for kernel in kernels] == [1.0 / 3.0, 1.25, 2.25, 3.25]
