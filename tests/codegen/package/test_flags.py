"""Flags and compilers: what gives up IEEE arithmetic, response files, levels, and a probe of a few lines of C."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import eomgen
from eomgen.codegen.package.compile import FLAGS, NATIVE, compile_flags, find_compiler, fuses
from eomgen.codegen.package.environment import check_flags, environment_words
from eomgen.codegen.package.levels import check_possible, chosen_level, fuses_unasked, level_flags, possible_levels
from eomgen.codegen.package.probe import check_compiler
from eomgen.codegen.package.running import Compiler
from eomgen.errors import BuildError, InputError
from eomgen.runtime.levels import LEVELS
from tests.support.processors import needs_levels, pretend
from tests.support.quick_builds import script
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

UNSAFE = (
    "-Ofast --optimize=fast -ffast-math --fast-math -funsafe-math-optimizations -ffinite-math-only -fassociative-math"
    " -freciprocal-math --reciprocal-math -fno-signed-zeros --no-signed-zeros -fsingle-precision-constant"
    " -fcx-limited-range -fno-honor-nans -fno-honor-infinities -fapprox-func -fdenormal-fp-math=positive-zero"
    " -fdenormal-fp-math-f32=preserve-sign,preserve-sign -ffp-model=fast -ffp-model=aggressive -fp-model=fast"
    " -ffp-eval-method=extended -fexcess-precision=fast -mdaz-ftz --machine=daz-ftz --machine-daz-ftz -mrecip"
    " -mrecip=all -mfpmath=387 -mfpmath=sse,387 -mno-ieee-fp -mpc32 -mpc64 -mlow-precision-sqrt -ftz -fast"
    " -no-prec-div -cl-fast-relaxed-math -Wp,-fsingle-precision-constant -menable-no-nans"
)
SAFE = (
    "-O3 -O0 -Os --optimize=3 -g -march=native -mfma -mfpmath=sse -ffp-contract=fast -fno-fast-math"
    " -fno-unsafe-math-optimizations -fno-finite-math-only -fno-associative-math -fsigned-zeros -fno-math-errno"
    " -fno-trapping-math -frounding-math -ffloat-store -fexcess-precision=standard -ffp-model=precise -fp-model=strict"
    " -fdenormal-fp-math=ieee -mrecip=none -flto --std=c99 -Wp,-D_FORTIFY_SOURCE=2 -Wl,-z,now -DA=-ffast-math -fPIC"
)


@pytest.mark.parametrize("flag", UNSAFE.split())
def test_a_flag_that_changes_results(flag: str) -> None:
    error = refused(BuildError, "", check_flags, ("-O2", flag), "$CFLAGS")
    assert str(error).startswith(f"$CFLAGS: {flag} changes what the equations compute")
    assert "allowed: flags that keep IEEE arithmetic" in str(error)


@pytest.mark.parametrize(
    "words", ["-fp-model fast", "--machine recip", "-Xclang -ffast-math", "-mllvm -enable-no-nans-fp-math"]
)
def test_a_flag_in_two_words(words: str) -> None:
    refused(BuildError, words.split()[1], check_flags, words.split(), "$CC")


def test_flags_that_keep_arithmetic() -> None:
    check_flags((*SAFE.split(), "-fp-model", "precise"), "$CFLAGS")


def test_response_files_are_part_of_the_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In their order, nested, quoted as a shell quotes; what is used is what was read, not the file."""
    inner, outer = tmp_path / "in ner", tmp_path / "outer"
    inner.write_text("-DA='x y'\n\t-g\n", encoding="ascii")
    outer.write_text(f"-O1 '@{inner}'", encoding="ascii")
    monkeypatch.setenv("CFLAGS", f"-Wall @{outer} -O3")
    words = ("-Wall", "-O1", "-DA=x y", "-g", "-O3")
    assert environment_words("CFLAGS") == words
    compiler = Compiler(("cc",), "1")
    assert compile_flags(compiler, False, ("-Wall", f"@{outer}"))[-4:] == words[:-1]


def test_an_unsafe_flag_in_a_response_file(tmp_path: Path) -> None:
    inner, outer = tmp_path / "inner", tmp_path / "outer"
    inner.write_text("-O2 -ffast-math", encoding="ascii")
    outer.write_text(f"@{inner}", encoding="ascii")
    refused(BuildError, "flags: -ffast-math changes", compile_flags, Compiler(("cc",), "1"), False, (f"@{outer}",))


@pytest.mark.parametrize("kind", ["missing", "folder", "fifo", "endless", "itself", "quote", "nul", "large"])
def test_a_response_file_that_cannot_be_read(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "words"
    if kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    elif kind == "endless":
        path = Path("/dev/zero")
    elif kind != "missing":
        text = {"itself": f"@{path} @{path}", "quote": "-DA='", "nul": "-g\0", "large": "-g " * 400_000}[kind]
        path.write_text(text, encoding="ascii")
    monkeypatch.setenv("LDFLAGS", f"@{path}")
    refused(BuildError, r"\$LDFLAGS: '@.*allowed: ", environment_words, "LDFLAGS")


GCC = Compiler(("cc",), "cc (Debian) 12.2.0\nCopyright (C) 2022 Free Software Foundation, Inc.")
CLANG = Compiler((sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"), "clang version 19.1.7")
WIDEST = {"v1": "__SSE2__", "v3": "__AVX2__", "v4": "__AVX512F__"}  # what clib/lanes.h looks at


@needs_levels
@pytest.mark.parametrize("level", LEVELS)
def test_a_level_has_its_instructions_and_no_others(level: str) -> None:
    compiler = find_compiler()
    flags = compile_flags(compiler, False, (), level)
    command = [*compiler.command, *flags, "-dM", "-E", "-x", "c", "/dev/null"]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert [macro in found for macro in WIDEST.values()] == [x <= level for x in WIDEST]
    assert "__FMA__" not in found
    assert not fuses(flags)


@needs_levels
@pytest.mark.parametrize("compiler", [GCC, CLANG], ids=["gcc", "zig"])
def test_compilers_that_have_levels(compiler: Compiler) -> None:
    assert possible_levels(compiler, ("-O3", "-g", "-ffp-contract=fast")) == LEVELS
    assert possible_levels(Compiler(("gcc",), GCC.version.replace("12.2", "7.5"))) == ("v1", "v3")


FORMS = """
void f(double *restrict o, const double *a, const double *b, const double *c)
{
    for (int i = 0; i < 16; i += 2) { o[i] = a[i]*b[i] - c[i]; o[i + 1] = a[i + 1]*b[i + 1] + c[i + 1]; }
    o[16] = a[16]*b[16] - c[16];
    o[17] = a[17]*b[17] + c[17];
}
"""


@needs_levels
@pytest.mark.parametrize("level", LEVELS)
def test_nothing_is_fused_unasked(level: str) -> None:
    """Not by gcc's vectorizer either, which takes products beside sums and differences for one operation."""
    compiler = find_compiler()
    for optimised in ("-O2", "-O3"):
        for further, fused in ((), False), (("-ffp-contract=fast",), level != "v1"):
            flags = compile_flags(compiler, False, (optimised, *further), level)
            command = [*compiler.command, *flags, "-S", "-x", "c", "-", "-o", "-"]
            found = subprocess.run(command, input=FORMS, capture_output=True, text=True, check=True).stdout
            assert ("vfm" in found) == fused, flags
            assert fuses(flags) == bool(further)


@pytest.mark.parametrize("flags", ["-march=haswell", "-mavx2 -mfma", "-mcpu=native", "-mavx512f"])
def test_flags_with_which_gcc_fuses_unasked(flags: str) -> None:
    assert fuses_unasked(flags.split())
    assert not fuses_unasked(level_flags("v4", GCC, fused=False))


@pytest.mark.parametrize(
    ("command", "version", "cflags", "flags"),
    [
        ("cc", GCC.version, "-march=haswell", ""),
        ("cc", GCC.version, "", "-mavx2"),
        ("cc", GCC.version, "", "--machine=avx"),
        ("cc -m32", GCC.version, "", ""),
        ("zig cc -target aarch64-linux-gnu", CLANG.version, "", ""),
        ("tcc", "tcc version 0.9.28", "", ""),
    ],
)
def test_flags_that_choose_a_processor_leave_no_levels(command: str, version: str, cflags: str, flags: str) -> None:
    compiler = Compiler(tuple(command.split()), version, tuple(cflags.split()))
    assert possible_levels(compiler, flags.split()) == ("v1",)
    assert chosen_level("", compiler, flags.split()) == "v1"


@needs_levels
def test_the_level_that_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, "avx2")
    assert [chosen_level(asked, GCC) for asked in ("", "v1", "v3")] == ["v3", "v1", "v3"]
    with pytest.raises(InputError, match=r"level: 'v4' is beyond this processor, which lacks avx512f.*allowed: v1, v3"):
        chosen_level("v4", GCC)
    with pytest.raises(BuildError, match=r"level: 'v3' is not what .* with these flags; allowed: v1$"):
        chosen_level("v3", GCC, ("-march=haswell",))
    refused(BuildError, "level: 'v4'", check_possible, "v4", ("v1", "v3"))


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
    error = refused(BuildError, "", check_compiler, Compiler((command,), "1"), FLAGS)
    assert str(error).startswith(f"the compiler does not keep IEEE arithmetic: {what}")
    assert f"\n  {command} -c -fPIC -O2 " in str(error)
    assert 5e-324 * 1.0 != 0.0


def test_a_library_that_does_not_load(tmp_path: Path) -> None:
    broken = 'while [ "$1" != -o ]; do shift; done; echo broken > "$2"; exit 0'
    command = script(tmp_path / "breaking", f'case "$*" in *-shared*) {broken};; esac; exec {CC} "$@"')
    refused(BuildError, "does not load", check_compiler, Compiler((command,), "1"), FLAGS)


def test_a_unit_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = 'case "$*" in *probe*|*FMI3*) set -- "$@" -fsingle-precision-constant;; esac'
    monkeypatch.setenv("CC", script(tmp_path / "adding", f'{own}; exec {CC} "$@"'))
    with pytest.raises(BuildError, match="the compiler does not keep IEEE arithmetic: a constant"):
        eomgen.export_fmu("one_link", tmp_path / "unit.fmu")
    assert not (tmp_path / "unit.fmu").exists()


def test_a_compiler_that_changes_is_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "cc"
    monkeypatch.setenv("CC", str(compiler))
    for version in ("one", "two two"):
        compiler.write_text(f"#!/bin/sh\necho {version}\n", encoding="ascii")
        compiler.chmod(0o755)
        assert find_compiler().version == version
