"""Whether a compiler keeps IEEE arithmetic, asked with a few lines of C, before units and functions are compiled."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import eomgen
from eomgen.codegen.package.compile import FLAGS, NATIVE, Compiler
from eomgen.codegen.package.probe import check_compiler
from eomgen.errors import BuildError
from tests.support.quick_builds import script

CC = shutil.which("cc") or shutil.which("gcc") or "cc"


def adding(folder: Path, flags: str) -> str:
    return script(folder / "adding", f'exec {CC} "$@" {flags}')


@pytest.mark.parametrize("flags", [FLAGS, (*FLAGS, *NATIVE), (*FLAGS, "-O0"), (*FLAGS, "-O3", "-march=native")])
def test_a_compiler_as_it_should_be(flags: tuple[str, ...]) -> None:
    check_compiler(Compiler((CC,), "1"), flags)


@pytest.mark.parametrize(
    ("flag", "what"),
    [
        ("-ffast-math", "a "),
        ("-fsingle-precision-constant", "a constant"),
        ("-freciprocal-math", "a quotient"),
        ("-fassociative-math -fno-signed-zeros -fno-trapping-math", "a sum"),
        ("-fno-signed-zeros", "a zero's sign"),
        ("-ffinite-math-only", "a comparison"),
    ],
)
def test_a_compiler_that_is_told_otherwise(flag: str, what: str, tmp_path: Path) -> None:
    command = adding(tmp_path, flag)
    with pytest.raises(BuildError) as error:
        check_compiler(Compiler((command,), "1"), FLAGS)
    assert str(error.value).startswith(f"the compiler does not keep IEEE arithmetic: {what}")
    assert f"\n  {command} -c -fPIC -O2 " in str(error.value)
    assert 5e-324 * 1.0 != 0.0


def test_a_library_that_does_not_load(tmp_path: Path) -> None:
    broken = 'while [ "$1" != -o ]; do shift; done; echo broken > "$2"; exit 0'
    command = script(tmp_path / "breaking", f'case "$*" in *-shared*) {broken};; esac; exec {CC} "$@"')
    with pytest.raises(BuildError, match="does not load"):
        check_compiler(Compiler((command,), "1"), FLAGS)


def test_a_unit_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = 'case "$*" in *probe*|*FMI3*) set -- "$@" -fsingle-precision-constant;; esac'
    monkeypatch.setenv("CC", script(tmp_path / "adding", f'{own}; exec {CC} "$@"'))
    with pytest.raises(BuildError, match="the compiler does not keep IEEE arithmetic: a constant"):
        eomgen.export_fmu("one_link", tmp_path / "unit.fmu")
    assert not (tmp_path / "unit.fmu").exists()
