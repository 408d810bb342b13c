"""The extension module that calls from Python go through: made once, and kept; packages with and without it."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.package import extension
from eomgen.codegen.package.compile import find_compiler
from eomgen.codegen.package.extension import FILE, HEADERS
from eomgen.codegen.package.running import Compiler
from eomgen.pipeline import cache, direct_calls
from eomgen.pipeline.generating import generate
from eomgen.pipeline.library_objects import LibraryObjects
from tests.support.quick_builds import ONE_LEVEL, answer, flip, python, without_headers
from tests.support.refusals import refused

CALLS = """
    import json, sys
    import numpy as np
    sys.path.insert(0, {folder!r})
    import one_link
    kernel, q = one_link.kernel, np.array([0.2, 0.5])
    found = [kernel.mass_matrix(q).tolist() for _ in range(2)]
    print(json.dumps([kernel.functions.is_direct, type(kernel._bound['mass_matrix']).__name__, *found]))
"""
BUILDS = """
    import json, os, sys
    import numpy as np
    import eomgen
    kernel, q = eomgen.build("one_link", kernels=("mass_matrix",), flags=("-O0",)), np.array([0.2, 0.5])
"""


def test_a_package_has_the_module_and_does_without(tmp_path: Path) -> None:
    package = generate("one_link", tmp_path, ONE_LEVEL)
    made = next((package / "runtime").glob("_direct.*"))
    assert not list((package / "runtime").glob("**/*.[ch]"))  # whose C stays with eomgen
    call = CALLS.format(folder=str(tmp_path))
    direct, kind, first, second = answer(python(call))
    assert (direct, kind, first) == (True, "Direct", second)
    made.write_bytes(b"no library")
    assert answer(python(call)) == [False, "CalledInPython", first, first]
    made.unlink()
    assert answer(python(call)) == [False, "CalledInPython", first, first]


@pytest.mark.soak
@pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing forks here")
def test_a_forked_process_calls() -> None:
    code = """
    expected = kernel.mass_matrix(q)
    read, write = os.pipe()
    if os.fork() == 0:
        kernel.parameters["gravity.y"] = -1.0
        os.write(write, kernel.mass_matrix(q).tobytes())
        os._exit(0)
    status = os.wait()[1]
    print(json.dumps([kernel.functions.is_direct, status, os.read(read, 1000) == kernel.mass_matrix(q).tobytes()]))
    """
    assert answer(python(BUILDS + code)) == [True, 0, True]


def test_other_interpreters_of_a_process() -> None:
    """Where NumPy refuses to be imported a second time the module says so; where it does not, the module works."""
    code = """
    try:
        import _interpreters as interpreters
    except ImportError:
        import _xxsubinterpreters as interpreters
    inner = '''
    import os, sys
    sys.path[:] = {path!r}
    try:
        import numpy
    except ImportError:
        found = "no NumPy"
    else:
        import numpy as np
        import eomgen
        kernel = eomgen.build("one_link", kernels=("mass_matrix",), flags=("-O0",))
        kernel.mass_matrix(np.array([0.2, 0.5]))
        found = str(kernel.mass_matrix(np.array([0.2, 0.5])).tolist()) + str(kernel.functions.is_direct)
    os.write({write}, found.encode())
    '''
    read, write = os.pipe()
    expected = str(kernel.mass_matrix(q).tolist()) + "True"
    import textwrap
    try:
        legacy = hasattr(interpreters, "new_config")
        one = interpreters.create("legacy") if legacy else interpreters.create(isolated=False)
        failed = interpreters.run_string(one, textwrap.dedent(inner).format(path=sys.path, write=write))
    except Exception as error:
        failed = str(error)
    found = "failed" if failed else os.read(read, 1000).decode()
    print(json.dumps([found, expected, kernel.mass_matrix(q).shape[0], str(failed)]))
    """
    found, expected, size, failed = answer(python(BUILDS + code))
    assert size == 2  # this interpreter goes on
    assert found in ("no NumPy", expected) or "numpy" in failed.lower(), failed


def test_the_module_is_made_once_and_from_the_same_bytes(empty_cache: Path) -> None:
    compiler = find_compiler()
    first = direct_calls.made_by(compiler)
    assert [kind for kind, _, _ in cache.contents()] == ["extensions"]
    assert set(first.files) == {FILE, *HEADERS, next(name for name in first.files if name.startswith("_direct."))}
    made = empty_cache / "extensions" / first.key
    time = made.stat().st_mtime_ns
    again = direct_calls.made_by(compiler)
    assert (again.files, made.stat().st_mtime_ns) == (first.files, time)
    flip(next(made.glob("_direct.*")))
    third = direct_calls.made_by(compiler)
    assert third.files == first.files  # made anew, the same to the byte


def test_the_key_names_all_that_the_module_depends_on(monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = find_compiler()
    keys = {extension.extension_key(compiler)}
    keys.add(extension.extension_key(Compiler((*compiler.command, "-g"), compiler.version)))
    keys.add(extension.extension_key(Compiler(compiler.command, compiler.version, ("-g",))))
    for target, value in (
        ("numpy.__version__", "9.9.9"),
        ("eomgen.codegen.package.extension._sources", lambda: {FILE: "another"}),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(target, value)
            keys.add(extension.extension_key(compiler))
    assert len(keys) == 5
    assert None not in keys


def test_without_headers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    compiler = find_compiler()
    without_headers(monkeypatch)
    assert direct_calls.made_by(compiler) is None
    assert direct_calls.binary_of(compiler) == {}
    monkeypatch.undo()
    monkeypatch.setattr("numpy.get_include", lambda: str(tmp_path))
    assert direct_calls.made_by(compiler) is None
    monkeypatch.undo()
    monkeypatch.setattr(sys.implementation, "name", "pypy")
    assert direct_calls.made_by(compiler) is None


def test_what_the_module_cannot_be_made_of_is_told(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And kernels are called all the same."""
    monkeypatch.setattr(extension, "_sources", lambda: {FILE: "no C"})
    monkeypatch.setattr(direct_calls, "EXTENSION", direct_calls.Extension())
    told: list[str] = []
    binding = direct_calls.begin()
    direct_calls.settle(told.append)
    assert binding.module is None
    assert len(told) == 1
    assert told[0].startswith("kernels are called through cffi alone: the C compiler failed")
    direct_calls.settle(told.append)
    assert len(told) == 1


def test_exceptions_in_threads_reach_the_caller(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once, whatever they are, and without a second attempt."""
    made: list[object] = []

    def broken(*args: object) -> None:
        made.append(args)
        raise ModuleNotFoundError("No module named 'filelock'")

    monkeypatch.setattr(direct_calls, "EXTENSION", direct_calls.Extension())
    monkeypatch.setattr(direct_calls, "made_by", broken)
    monkeypatch.setattr(LibraryObjects, "_make", broken)
    compiler = find_compiler()
    direct_calls.begin(compiler)
    objects = LibraryObjects(compiler, ("-O0",), "float64", {"singles": ("adaptive",)}).begin().result
    for waiting in (direct_calls.settle, objects):
        refused(ModuleNotFoundError, "filelock", waiting)
    assert len(made) == 2


def test_kernels_do_not_wait_for_the_module(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is built while the module is compiled gets it with its first function."""
    monkeypatch.setattr(direct_calls, "EXTENSION", direct_calls.Extension())
    kernel = eomgen.build("one_link", flags=("-O0",))
    assert not kernel.functions.is_direct
    kernel.mass_matrix([0.2, 0.5])
    assert kernel.functions.is_direct
    assert kernel._bound["mass_matrix"].is_armed is False  # type: ignore[attr-defined]
    kernel.mass_matrix(np.array([0.2, 0.5]))
    assert kernel._bound["mass_matrix"].is_armed  # type: ignore[attr-defined]


def test_the_source_has_no_warnings(tmp_path: Path) -> None:
    compiler = find_compiler()
    strict = Compiler(
        compiler.command, compiler.version, (*compiler.flags, "-Werror", "-Wshadow", "-Wstrict-prototypes")
    )
    extension.write_extension(strict, tmp_path)
    if shutil.which("clang") is not None:
        extension.write_extension(Compiler(("clang",), "", ("-Werror",)), tmp_path)
