"""The compile cache: its keys, what may not get into it, failures of the compiler, and packages on their own."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.codegen.c.library import library_files
from eomgen.codegen.c.source import Source
from eomgen.codegen.package import compile as compiling
from eomgen.description import keys as robot_keys
from eomgen.description.load import robot_from_toml
from eomgen.errors import BuildError, DescriptionError, InputError
from eomgen.pipeline import cache
from eomgen.pipeline.building import load_kernel
from eomgen.pipeline.cache import KINDS, VARIABLE, is_whole
from eomgen.pipeline.generating import generate
from eomgen.pipeline.generator_key import generator_files
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import cache_keys, make_source
from eomgen.runtime.levels import BASE
from eomgen.scenario import keys as scenario_keys
from eomgen.sweep import keys as plan_keys
from release.packages import link_package
from tests.support.builds import Build
from tests.support.quick_builds import (
    BUILD,
    ONE_LEVEL,
    QUICK,
    Q,
    answer,
    as_new_process,
    flip,
    logging_compiler,
    one_link,
    package_of,
    python,
    script,
    truncate,
    without_headers,
)
from tests.support.refusals import refused
from tests.support.soak import soaked

CC = shutil.which("cc") or shutil.which("gcc") or "cc"


def reported() -> str:
    """Return the message of a build of one link that fails."""
    error = refused(BuildError, "", one_link)
    assert isinstance(error, InputError)
    return str(error)


def test_stages_are_skipped_when_their_result_is_there(empty_cache: Path) -> None:
    first: list[str] = []
    expected = one_link(first).mass_matrix(Q)
    assert [step.split()[0] for step in first] == ["deriving", "compiling"]
    again: list[str] = []
    assert np.array_equal(one_link(again).mass_matrix(Q), expected)
    assert again == []
    other_flags: list[str] = []
    one_link(other_flags, Options(("mass_matrix",), flags=("-O1",)))
    assert [step.split()[0] for step in other_flags] == ["compiling"]
    other_source: list[str] = []
    one_link(other_source, Options(("mass_matrix",), dtype="float32", flags=("-O0",)))
    assert [step.split()[0] for step in other_source] == ["deriving", "compiling"]
    native: list[str] = []
    assert np.allclose(one_link(native, Options(("mass_matrix",), native=True)).mass_matrix(Q), expected, rtol=1e-15)
    assert [step.split()[0] for step in native] == ["compiling"]


def test_nothing_but_entries_is_left(empty_cache: Path) -> None:
    one_link()
    assert sorted(path.name for path in empty_cache.iterdir()) == ["derivations", "locks", "packages", "sources"]
    assert empty_cache.stat().st_mode & 0o077 == 0
    (package,) = (empty_cache / "packages").iterdir()
    assert {"one_link.c", "one_link.h", "one_link.json", "__init__.py"} <= {path.name for path in package.iterdir()}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_an_interrupt_ends_compilers_and_leaves_nothing(empty_cache: Path, tmp_path: Path) -> None:
    """Those that the caller waits for and those of threads, with what they have started."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    text = f'[ "$1" = --version ] && exec {CC} --version\n(echo; exec sleep 300) > {pipe}'
    code = f"""
    import signal, sys
    from eomgen.cli.entry import main
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(main(["generate", "one_link", "--kernels", "mass_matrix", "-o", {str(tmp_path)!r}]))
    """
    with open(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as compilers:
        process, started = python(code, CC=script(tmp_path / "slow", text)), 0
        while started < 4 and process.poll() is None:  # two halves, cffi's wrapper; the extension module in a thread
            time.sleep(0.02)
            started += len(compilers.read(100) or b"")
        process.send_signal(signal.SIGINT)
        assert (*process.communicate(), process.returncode) == ("", "eomgen: interrupted\n", 130)
        deadline = time.monotonic() + 20.0
        while compilers.read(100) is None and time.monotonic() < deadline:  # not the end: somebody has the pipe open
            time.sleep(0.02)
        assert compilers.read(100) == b""
    assert [kind for kind, _, _ in cache.contents()] == ["derivations", "sources"]
    assert {path.name for path in empty_cache.iterdir()} <= {*KINDS, "locks"}
    assert not (tmp_path / "one_link").exists()


def test_threads_leave_nothing_where_python_ends(empty_cache: Path) -> None:
    """An entry that a thread makes then is finished; another one is not begun."""
    code = """
    import threading, time
    from eomgen.errors import BuildError
    from eomgen.pipeline import cache

    def make(folder):
        begun.set()
        for number in range(50):
            (folder / str(number)).write_text("1")
            time.sleep(0.01)

    def too_late():
        while threading.main_thread().is_alive():
            time.sleep(0.01)
        try:
            cache.entry("sources", "b", make)
        except BuildError as error:
            print(error, flush=True)

    begun = threading.Event()
    for work in (too_late, lambda: cache.entry("sources", "a", make)):
        threading.Thread(target=work, daemon=True).start()
    begun.wait()
    """
    assert python(code).communicate() == ("Python is exiting; nothing is built any more\n", "")
    assert [key for _, key, _ in cache.contents()] == ["a"]
    assert {path.name for path in empty_cache.iterdir()} == {"sources", "locks"}


@pytest.mark.parametrize("count", soaked([2, 4, 8], [2]))
def test_processes_build_the_same_kernel_at_once(count: int, empty_cache: Path, tmp_path: Path) -> None:
    """All of them get it, and it is compiled once: wrapper, kernel, link; and before it the extension module, link."""
    compiler, log = logging_compiler(tmp_path)
    processes = [python(BUILD, CC=compiler) for _ in range(count)]
    answers = [answer(process) for process in processes]
    assert all(found == answers[0] for found in answers)
    assert answers[0] == one_link().mass_matrix(Q).tolist()
    calls = log.read_text().splitlines()
    assert len([call for call in calls if "direct" in call.rpartition(" -o ")[2]]) == 2
    assert len(calls) == 4 + 2


def nest(path: Path) -> None:
    """JSON 10,000 levels deep."""
    path.write_text('{"a":' * 10_000 + "1" + "}" * 10_000)


def swell(path: Path) -> None:
    path.write_text(f"[{'0,' * (1 << 20)}0]")


DAMAGES = [
    ("packages", "*.so", flip),
    ("packages", "*.so", truncate),
    ("packages", "*.so", Path.unlink),
    ("packages", "one_link.json", flip),
    ("packages", "__init__.py", Path.unlink),
    ("packages", "manifest.json", truncate),
    ("packages", "manifest.json", nest),
    ("sources", "manifest.json", swell),
    ("sources", "source.json", flip),
    ("sources", "manifest.json", Path.unlink),
]


@pytest.mark.parametrize(("kind", "pattern", "damage"), soaked(DAMAGES, DAMAGES[::6]))
def test_damaged_entries_are_made_again(
    kind: str, pattern: str, damage: Any, filled_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = one_link()
    (folder,) = (filled_cache / kind).iterdir()
    (path,) = folder.glob(pattern)
    damage(path)
    assert not is_whole(folder)
    as_new_process(monkeypatch)
    steps: list[str] = []
    assert np.array_equal(one_link(steps).mass_matrix(Q), kernel.mass_matrix(Q))
    assert [step.split()[0] for step in steps] == (["compiling"] if kind == "packages" else ["deriving"])
    assert is_whole(folder)
    assert sorted(path.name for path in filled_cache.iterdir()) == ["derivations", "locks", "packages", "sources"]


def test_a_kernel_outlives_its_cache(filled_cache: Path) -> None:
    kernel = one_link()
    expected = kernel.mass_matrix(Q)
    shutil.rmtree(filled_cache)
    assert np.array_equal(kernel.mass_matrix(Q), expected)
    assert np.array_equal(one_link().mass_matrix(Q), expected)


def test_a_cache_folder_that_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.touch(mode=0o600)
    for folder in (file, file / "below"):
        monkeypatch.setenv(VARIABLE, str(folder))
        message = reported()
        assert f"the cache folder {folder} cannot be written: " in message
        assert f"set {VARIABLE} to another folder" in message


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_cache(empty_cache: Path) -> None:
    empty_cache.mkdir(mode=0o500)
    refused(BuildError, r"cannot be written: Permission denied; make it writable", one_link)


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o777])
def test_a_cache_that_others_may_write_to(mode: int, filled_cache: Path) -> None:
    one_link()
    filled_cache.chmod(mode)
    assert f"may be written by others (mode {mode:o}); run chmod go-w on it" in reported()


def test_no_compiler(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    message = reported()
    assert message.startswith("no C compiler found: $CC is not set, and cc, gcc and clang are not on the path; install")
    assert "apt install gcc" in message


@pytest.mark.parametrize("command", ["false", "/nowhere/cc", "nothing-of-this-name --fast"])
def test_a_compiler_that_does_not_run(command: str, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", command)
    message = reported()
    assert message.startswith(f"the C compiler does not run: {command} --version: ")
    assert "set CC" in message


def test_a_compiler_that_fails(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its command, its status and what it said; and nothing half-made is left."""
    refusing = script(
        tmp_path / "refusing-cc", 'case "$*" in *--version*) echo 1 ;; *) echo no space left; exit 3 ;; esac'
    )
    monkeypatch.setenv("CC", refusing)
    message = reported()
    assert message.startswith(f"the C compiler failed with status 3:\n  {refusing} -c -fPIC")
    assert "\nno space left\n" in message
    assert not list((empty_cache / "packages").iterdir())
    monkeypatch.delenv("CC")
    assert one_link().mass_matrix(Q).shape == (2, 2)


WRONG_COMPILERS = {  # what each does, and what is said of it
    "writes nothing": (":", "the C compiler wrote no object:\n  {} -c -fPIC"),
    "links nothing": (f'case "$*" in *-shared*) ;; *) exec {CC} "$@";; esac', "wrote no library:\n  {} -shared"),
    "says Latin-1": (f"[ $1 = --version ] && exec {CC} $1; printf '\\374'; exit 1", "status 1:\n  {} -c -fPIC"),
    "has a version in Latin-1": ("printf '\\374'; exit 1", "the C compiler does not run: {} --version: "),
}


@pytest.mark.parametrize("does", WRONG_COMPILERS)
def test_what_wrong_compilers_do_is_said(
    does: str, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, said = WRONG_COMPILERS[does]
    command = script(tmp_path / "cc", text)
    monkeypatch.setenv("CC", command)
    refused(BuildError, re.escape(said.format(command)), one_link)


def test_an_unknown_flag(empty_cache: Path) -> None:
    with pytest.raises(BuildError, match=r"(?s)failed with status 1.*--no-such-flag.*check that the compiler works"):
        one_link(options=Options(("mass_matrix",), flags=("--no-such-flag",)))


def test_flags_of_the_environment_come_after_ours(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are split as a shell splits words, and another binary is made for other ones."""
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    steps: list[str] = []
    keys = set()
    for flags, link in (("", ""), ("-O0 -DA='\"a b\"'", ""), ("-O0 -DA='\"a b\"'", "-L'/tmp/a b'"), ("-O1", "")):
        monkeypatch.setenv("CFLAGS", flags)
        monkeypatch.setenv("LDFLAGS", link)
        log.write_text("")
        assert one_link(steps, Options(("mass_matrix",))).mass_matrix(Q).shape == (2, 2)
        keys.add(cache_keys(eomgen.load_robot("one_link"), ("mass_matrix",)))
        *compiled, linked = log.read_text().splitlines()
        for line in compiled:
            assert all(word in line for word in ("-c", *(["-O0", '-DA="a b"'] if "-DA" in flags else [])))
        ours = [line for line in compiled if " -std=c99 " in line]
        assert len(ours) == 2
        assert all(line.index(" -O2 ") < line.index(" -O0 ") for line in ours if "-DA" in flags)
        assert ("-L/tmp/a b" in linked) == bool(link)
    assert [step.split()[0] for step in steps] == ["deriving", *["compiling"] * 4]
    assert len(keys) == 4


@pytest.mark.parametrize(
    ("variable", "flags"),
    [
        ("CFLAGS", "-O2 -ffast-math"),
        ("CFLAGS", "-Ofast"),
        ("CFLAGS", "-funsafe-math-optimizations"),
        ("CFLAGS", "-ffinite-math-only"),
        ("CFLAGS", "-mdaz-ftz"),
        ("CFLAGS", "-ffp-model=fast"),
        ("CFLAGS", "-fdenormal-fp-math=positive-zero"),
        ("LDFLAGS", "-ffast-math"),
        ("CC", "cc -ffast-math"),
    ],
)
def test_unsafe_arithmetic_is_refused(
    variable: str, flags: str, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, flags)
    message = reported()
    assert message.startswith(f"${variable}: {flags.split()[-1]} ")
    assert "denormal" in message
    assert "allowed: " in message
    assert not (empty_cache / "packages").exists()


def test_unsafe_arithmetic_is_refused_in_a_call(empty_cache: Path) -> None:
    with pytest.raises(BuildError, match="flags: -ffast-math changes what the equations compute"):
        one_link(options=Options(("mass_matrix",), flags=("-ffast-math",)))
    assert one_link(options=Options(("mass_matrix",), flags=("-fno-fast-math", "-O0"))).n == 2


@pytest.mark.parametrize("variable", ["CC", "CFLAGS", "LDFLAGS"])
def test_a_quote_that_is_not_closed(variable: str, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable, "-DA='x")
    refused(BuildError, rf"\${variable} is \"-DA='x\": No closing quotation; allowed: words", one_link)


def test_no_key_of_a_file_names_a_compiler_or_a_flag() -> None:
    """Of a description, a scenario or a plan: what is run, and how, is the environment's alone."""
    schemas = [form.json() for form in (robot_keys.ROBOT, scenario_keys.SCENARIO, plan_keys.PLAN)]
    keys = set(re.findall(r'"([a-z_0-9]+)": \{"description"', json.dumps(schemas)))
    assert len(keys) > 90
    assert not [
        key for key in keys if re.search("(?i)flag|compil|^cc$|command|shell|exec|env|library|include|linker", key)
    ]
    for key in ("cc", "cflags", "flags", "compiler"):
        refused(DescriptionError, f"unknown key '{key}'", robot_from_toml, f'name = "arm"\n{key} = "-O3"\n')


@pytest.mark.soak
def test_without_python_headers(empty_cache: Path, monkeypatch: pytest.MonkeyPatch, built: Build) -> None:
    """cffi's ABI mode gives the same numbers, and a package that stands on its own."""
    expected = one_link()
    without_headers(monkeypatch)
    plain = eomgen.build(eomgen.load_robot("one_link"), kernels="all", flags=("-O0",))
    assert len(list((empty_cache / "packages").glob("*/libone_link.so"))) == 1
    assert np.array_equal(plain.mass_matrix(Q), expected.mass_matrix(Q))
    assert plain.forward_dynamics(Q, Q, Q).shape == (2,)
    target = generate(eomgen.load_robot("one_link"), empty_cache / "out", Options(flags=("-O0",), levels=(BASE,)))
    assert (target / "libone_link.so").exists()
    check_alone(target, expected.mass_matrix(Q))


def check_alone(package: Path, expected: np.ndarray) -> None:
    """The package in an interpreter where nothing but NumPy and cffi can be imported of what eomgen needs."""
    code = f"""
        import json, sys
        for name in ("eomgen", "sympy", "jinja2", "filelock", "platformdirs", "rich", "scipy", "setuptools"):
            sys.modules[name] = None
        sys.path.insert(0, {str(package.parent)!r})
        import {package.name} as package
        other = package.load()
        other.parameters["gravity.y"] = 0.0
        try:
            package.mass_matrix([0.0, float("nan")])
        except ValueError as error:
            said = str(error)
        M = package.mass_matrix([0.2, 0.5]).tolist()
        force = other.generalized_force([0.0, 0.5], [0.0, 0.0]).tolist()
        print(json.dumps([M, force, said, list(package.kernel.coordinates), package.kernel.name]))
    """
    M, force, said, coordinates, name = answer(python(code))
    assert np.array_equal(M, expected)
    assert force == [0.0, 0.0]
    assert said == "q: joint1.gamma is nan; numbers must be finite"
    assert coordinates == ["joint1.x", "joint1.gamma"]
    assert name == "one_link"


def test_generated_package_needs_numpy_and_cffi_alone(tmp_path: Path, built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    target = generate(robot, tmp_path / "out", Options(flags=("-O0",), levels=(BASE,)))
    assert target == tmp_path / "out" / "one_link"
    assert not list(target.parent.glob(".making-*"))
    check_alone(target, built(robot).mass_matrix(Q))


def test_generating_again_replaces_and_foreign_folders_stay(tmp_path: Path) -> None:
    robot = eomgen.load_robot("one_link")
    target = generate(robot, tmp_path, ONE_LEVEL)
    (target / "left_over.py").touch()
    assert generate(robot, tmp_path, ONE_LEVEL) == target
    assert not (target / "left_over.py").exists()
    mine = tmp_path / "mine" / "one_link"
    mine.mkdir(parents=True)
    (mine / "thesis.txt").touch()
    (mine / "one_link.json").write_text('{"title": "mine"}')
    with pytest.raises(InputError, match=r"exists and is not a generated package; give another folder with -o"):
        generate(robot, mine.parent, ONE_LEVEL)
    assert (mine / "thesis.txt").exists()
    file = tmp_path / "other" / "one_link"
    file.parent.mkdir()
    file.touch()
    refused(InputError, r"exists and is not a generated package", generate, robot, file.parent, ONE_LEVEL)
    refused(InputError, r"cannot be written: ", generate, robot, file, ONE_LEVEL)


def test_loading_again_does_not_import_sympy(built: Build) -> None:
    """What makes the second start of the 36 coordinates quick."""
    robot = eomgen.load_robot("puma560_elastic")
    options = Options(("mass_matrix", "inverse_dynamics", "forward_dynamics"), flags=("-O0",))
    package_of(robot, options)
    code = f"""
        import json, sys
        import eomgen
        robot = eomgen.load_robot("puma560_elastic")
        kernel = eomgen.build(robot, kernels={options.kernels!r}, flags=("-O0",))
        M = kernel.mass_matrix([0.01] * kernel.n)
        heavy = ("sympy", "scipy", "matplotlib", "setuptools", "pydantic", "rich")
        print(json.dumps([M.shape, [name for name in heavy if name in sys.modules]]))
    """
    assert answer(python(code)) == [[36, 36], []]


def test_command(empty_cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def said(*arguments: str) -> Any:
        assert cli.main(["cache", *arguments, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    nothing = {"folder": str(empty_cache), **dict.fromkeys(KINDS, 0), "bytes": 0}
    assert said() == nothing
    assert said("--clear") == {**nothing, "removed": 0}
    assert not empty_cache.exists()
    kernel = one_link()
    (empty_cache / "making-0-x").mkdir()
    kinds = ("derivations", "sources", "packages")
    files = [path for kind in kinds for path in (empty_cache / kind).rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    assert said() == {**nothing, "derivations": 1, "sources": 1, "packages": 1, "bytes": size}
    assert cli.main(["cache"]) == 0
    assert f"1 derivations, 1 sources, 1 packages, {size / 1e6:.1f} MB" in capsys.readouterr().out
    assert said("--clear") == {**nothing, "removed": 3}
    assert sorted(path.name for path in empty_cache.iterdir()) == ["derivations", "locks", "packages", "sources"]
    assert np.isfinite(kernel.mass_matrix(Q)).all()
    as_new_process(monkeypatch)
    assert np.array_equal(one_link().mass_matrix(Q), kernel.mass_matrix(Q))
    empty_cache.chmod(0o777)
    assert cli.main(["cache", "--clear"]) == 1
    assert "may be written by others" in capsys.readouterr().err


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
    """All files of the generator, and every module of eomgen that they import, found here by their syntax trees.

    Methods that are short for a function of a package above import it when they are called, and no build calls them.
    """
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    rules = tomllib.loads(text)["tool"]["importlinter"]["contracts"]
    above = {x.partition(" -> ")[2] for rule in rules if rule["id"] == "layers" for x in rule["ignore_imports"]}
    files = generator_files()
    own = [path for room in ("codegen", "templates") for path in (package / room).rglob("*")]
    found = {path.relative_to(package).as_posix() for path in own if path.suffix in (".py", ".jinja")}
    assert len(found) > 60
    todo = [name for name in found if name.endswith(".py")]
    while todo:
        file = todo.pop()
        for name in imported(file, package / file) - above:
            inner = name.removeprefix("eomgen.").replace(".", "/") if name.startswith("eomgen.") else None
            for file in () if inner is None else (f"{inner}.py", f"{inner}/__init__.py"):
                if (package / file).is_file() and file not in found:
                    found.add(file)
                    todo.append(file)
    assert found - set(files) == set()
    assert {"errors.py", "names.py"} < set(files)
    assert all(Path(path).is_file() for path in files.values())


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
    """Source, compiler, flags, the machine; the library, what is carried, how it is put together: as the files are."""
    parts = compiling.dependencies(source, COMPILER, FLAGS)
    assert parts["source"] == vars(source)
    assert (parts["command"], parts["compiler"]) == (["cc", "-m64"], COMPILER.version)
    assert (parts["flags"], parts["environment"]) == (["-O2", "-march=native"], [["-DA=1"], ["-L/lib"]])
    assert (parts["eomgen"], parts["cffi"]) == (eomgen.__version__, cffi.__version__)
    assert parts["interface"] == compiling.interface()
    assert {"suffix", "python", "headers", "system", "machine", "library"} == set(parts["interface"])
    assert parts["carried"] == {name: sha256(package / name) for name in compiling.carried_files()}
    assert {"errors.py", "names.py", "runtime/compiled_kernel.py"} < set(parts["carried"])
    assert parts["library"] == {name: sha256(package / name) for name in library_files()}
    assert {"clib/lanes.h", "clib/fixed_steps.h"} < set(parts["library"])
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


posix = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners and modes as POSIX has them")
FOLDERS = ("", "packages", "sources", "locks", "packages/*", "sources/*")


def place(root: Path, name: str) -> Path:
    (found,) = root.glob(name) if "*" in name else [root / name]
    return found


@posix
@pytest.mark.parametrize("name", soaked(FOLDERS, ["", "packages/*"]))
def test_no_folder_of_the_cache_may_be_open_to_others(
    name: str, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = os.umask(0)  # the worst that a user may have
    try:
        one_link()
    finally:
        os.umask(before)
    assert all(path.lstat().st_mode & 0o022 == 0 for path in empty_cache.rglob("*") if path.suffix != ".lock")
    as_new_process(monkeypatch)
    folder = place(empty_cache, name)
    if name == "locks":
        shutil.rmtree(empty_cache / "packages")  # locks are looked at where something is built
    folder.chmod(0o720)
    error = refused(BuildError, "", one_link)
    assert f"the cache folder {folder} may be written by others (mode 720); run chmod go-w on it" in str(error)
    folder.chmod(0o700)
    assert one_link().n == 2


@pytest.mark.parametrize("name", FOLDERS)
def test_links_in_the_cache_are_refused(
    name: str, filled_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one_link()
    as_new_process(monkeypatch)
    folder, elsewhere = place(filled_cache, name), tmp_path / "elsewhere"
    folder.rename(elsewhere)
    folder.symlink_to(elsewhere)
    if name == "locks":
        shutil.rmtree(filled_cache / "packages")
    error = refused(BuildError, "", one_link)
    assert f"the cache folder {folder} is a link to {elsewhere}; remove it, or set {VARIABLE}" in str(error)


def test_links_above_the_cache_are_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A home that is somewhere else in truth."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "home").symlink_to(tmp_path / "disk")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "home" / "cache"))
    assert one_link().n == 2
    assert (tmp_path / "disk" / "cache" / "packages").is_dir()


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("name", FOLDERS)
def test_folders_of_other_users_are_refused(name: str, filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one_link()
    as_new_process(monkeypatch)
    folder = place(filled_cache, name)
    if name == "locks":
        shutil.rmtree(filled_cache / "packages")
    os.chown(folder, 12345, -1)
    refused(BuildError, r"belongs to another user; set EOMGEN_CACHE_DIR to a folder of yours", one_link)


@posix
@pytest.mark.parametrize("name", FOLDERS)
def test_who_is_asked_for_the_owner(name: str, filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same without root: from where another user stands, and the files are not root's."""
    if os.getuid() == 0:
        pytest.skip("root's files are anybody's to use; see test_folders_of_other_users_are_refused")
    one_link()
    as_new_process(monkeypatch)
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    refused(BuildError, r"belongs to another user", one_link)


@posix
@pytest.mark.parametrize("how", soaked(["open", "link", "pipe", "folder"], ["open", "link"]))
def test_files_that_others_may_have_written_are_made_again(
    how: str, filled_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = one_link().mass_matrix(Q)
    as_new_process(monkeypatch)
    (file,) = filled_cache.glob("packages/*/*.so")
    if how == "open":
        file.chmod(0o666)
    else:
        file.rename(tmp_path / "elsewhere.so")
        make: dict[str, Callable[[], None]] = {
            "link": lambda: file.symlink_to(tmp_path / "elsewhere.so"),
            "pipe": lambda: os.mkfifo(file, 0o600),
            "folder": lambda: file.mkdir(mode=0o700),
        }
        make[how]()
    assert not is_whole(file.parent)
    steps: list[str] = []
    assert np.array_equal(one_link(steps).mass_matrix(Q), expected)
    assert [step.split()[0] for step in steps] == ["compiling"]
    assert is_whole(file.parent)


def test_a_manifest_answers_for_itself(filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that lists less, another hash, or what is under another key, is not believed."""
    one_link()
    (package,) = (filled_cache / "packages").iterdir()
    path = package / "manifest.json"
    text = path.read_text()
    assert is_whole(package)
    shorter = json.loads(text)
    del shorter["files"]["one_link.c"]
    other = json.loads(text)
    (package / "one_link.h").write_text("/* other */")
    other["files"]["one_link.h"] = hashlib.sha256(b"/* other */").hexdigest()
    for changed in (shorter, other, {"files": shorter["files"]}, {}, [], None):
        path.write_text(json.dumps(changed))
        assert not is_whole(package)
    path.write_text(text)
    assert not is_whole(package)
    as_new_process(monkeypatch)
    one_link()
    elsewhere = package.with_name("0" * 64)
    shutil.copytree(package, elsewhere)
    assert is_whole(package)
    assert not is_whole(elsewhere)


def test_what_is_loaded_is_what_was_checked(filled_cache: Path) -> None:
    """Neither a file that changes after the check, nor compiled Python beside the files, which nobody checks."""
    robot, options = eomgen.load_robot("one_link"), QUICK
    expected = one_link().mass_matrix(Q)
    for name in [name for name in sys.modules if name.startswith("_eomgen_")]:
        del sys.modules[name]
    package = package_of(robot, options)
    (folder,) = (filled_cache / "packages").iterdir()
    for path in folder.rglob("*"):
        if path.is_file():
            path.write_bytes(b"")
    kernel = load_kernel(package, "one_link")
    assert np.array_equal(kernel.mass_matrix(Q), expected)
    assert not list(filled_cache.glob("packages/*/__pycache__"))
    assert not list(filled_cache.glob("loading-*"))


@pytest.mark.soak
def test_a_binary_that_is_overwritten_while_it_runs(filled_cache: Path) -> None:
    """In place, as a careless copy does it: a mapped file would take the process along."""
    code = f"""
        import json, eomgen
        from pathlib import Path
        kernel = eomgen.build(eomgen.load_robot("one_link"), kernels=("mass_matrix",), flags=("-O0",))
        (file,) = Path({str(filled_cache)!r}).glob("packages/*/*.so")
        with file.open("r+b") as stream:
            stream.truncate(0)
        print(json.dumps(kernel.mass_matrix({Q}).tolist()))
    """
    assert answer(python(code)) == answer(python(BUILD))


def test_where_no_copy_can_be_had_the_file_itself_is_loaded(
    filled_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, or one that nobody may write to, keeps nobody from a kernel that is there."""
    expected = one_link().mass_matrix(Q)
    as_new_process(monkeypatch)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryDirectory", full)
    assert np.array_equal(one_link().mass_matrix(Q), expected)


def test_a_binary_that_does_not_load(filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = package_of(eomgen.load_robot("one_link"), QUICK)
    files = {name: b"no binary" if name.endswith(".so") else data for name, data in package.files.items()}
    with pytest.raises(BuildError, match=r"the compiled module in .*packages.* does not load: "):
        load_kernel(cache.Entry("packages", "0" * 64, files), "one_link")
    files = {name: data for name, data in files.items() if not name.endswith(".so")}
    missing = cache.Entry("packages", "1" * 64, files)
    refused(BuildError, r"does not load: none of its files is a library _one_link\.", load_kernel, missing, "one_link")


def test_what_killed_processes_left_is_removed(filled_cache: Path, tmp_path: Path) -> None:
    """Of the same key at once, of others after a day; nothing that may be in use, nothing else."""
    one_link()
    (package,) = (filled_cache / "packages").iterdir()
    old = time.time() - 100000.0
    for name in (f"making-{package.name}-a", f"damaged-{package.name}-b", "making-1-c", "loading-d", "mine"):
        (filled_cache / name / "build").mkdir(parents=True)
        if name != "making-1-c":
            os.utime(filled_cache / name, (old, old))
    fresh = filled_cache / f"making-{package.name}-e"
    fresh.mkdir()
    shutil.rmtree(package)
    for name in [name for name in sys.modules if name.startswith("_eomgen_")]:
        del sys.modules[name]
    one_link()
    assert sorted(path.name for path in filled_cache.iterdir()) == [
        "derivations",
        "locks",
        "making-1-c",
        "mine",
        "packages",
        "sources",
    ]


def test_a_lock_that_nobody_lets_go_does_not_hold_up_others(
    filled_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that was stopped, not killed: the others wait a while, then build for themselves."""
    from filelock import FileLock

    one_link()
    (package,) = (filled_cache / "packages").iterdir()
    shutil.rmtree(package)
    as_new_process(monkeypatch)
    monkeypatch.setattr(cache, "PATIENCE", 0.1)
    (filled_cache / f"making-{package.name}-of-the-stopped").mkdir()
    with FileLock(str(filled_cache / "locks" / f"{package.name}.lock")):
        assert one_link().n == 2
    assert is_whole(package)
    assert (filled_cache / f"making-{package.name}-of-the-stopped").exists()
