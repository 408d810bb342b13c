"""Flags of levels: what the compiler makes of them, and where flags of the user's decide instead."""

from __future__ import annotations

import subprocess
import sys

import pytest

from eomgen.codegen.package.compile import Compiler, compile_flags, find_compiler, fuses
from eomgen.codegen.package.levels import check_possible, chosen_level, fuses_unasked, level_flags, possible_levels
from eomgen.errors import BuildError, InputError
from eomgen.runtime.levels import LEVELS
from tests.support.processors import needs_levels, pretend

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
    with pytest.raises(BuildError, match="level: 'v4'"):
        check_possible("v4", ("v1", "v3"))
