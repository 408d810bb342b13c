"""Flags of the environment: what gives up IEEE arithmetic, however it is spelled, and response files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from eomgen.codegen.package.compile import Compiler, compile_flags
from eomgen.codegen.package.environment import check_flags, environment_words
from eomgen.errors import BuildError

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
    with pytest.raises(BuildError) as error:
        check_flags(("-O2", flag), "$CFLAGS")
    assert str(error.value).startswith(f"$CFLAGS: {flag} changes what the equations compute")
    assert "allowed: flags that keep IEEE arithmetic" in str(error.value)


@pytest.mark.parametrize(
    "words", ["-fp-model fast", "--machine recip", "-Xclang -ffast-math", "-mllvm -enable-no-nans-fp-math"]
)
def test_a_flag_in_two_words(words: str) -> None:
    with pytest.raises(BuildError, match=words.split()[1]):
        check_flags(words.split(), "$CC")


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
    with pytest.raises(BuildError, match="flags: -ffast-math changes"):
        compile_flags(Compiler(("cc",), "1"), False, (f"@{outer}",))


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
    with pytest.raises(BuildError, match=r"\$LDFLAGS: '@.*allowed: "):
        environment_words("LDFLAGS")
