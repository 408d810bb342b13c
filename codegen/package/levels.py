"""x86-64 levels (SIMD instruction sets) that packages are compiled for: their flags, and where there is a choice.

gcc from 12 on takes products beside sums and differences for one fused operation where the processor has it for vectors
of that size, whatever ``-ffp-contract=off`` says.  So without contraction a level names the instructions that it needs
and no fused ones: with AVX-512, which has them in its very first set, only what is written as a wide vector is one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from eomgen.errors import BuildError
from eomgen.names import show
from eomgen.runtime.levels import BASE, best_level, check_level, machine_levels

from .running import Compiler

_FLAGS: Mapping[str, tuple[str, ...]] = {
    BASE: (),
    "v3": ("-mavx2",),
    "v4": ("-mavx2", "-mavx512f", "-mavx512bw", "-mavx512cd", "-mavx512dq"),
}
_FUSED: Mapping[str, tuple[str, ...]] = {BASE: (), "v3": ("-mfma",), "v4": ("-mfma", "-mavx512vl")}
_NARROW = "-mprefer-vector-width=256"  # for what gcc finds to do side by side; vectors of the C are as wide as they are
_CHOOSING = ("-m", "--machine", "-target", "--target", "-arch")  # what flags begin with that choose a processor
_TUNING = ("-march", "-mcpu", "-mfma", "-mavx512vl", "--machine")  # and that may bring fused multiply-adds
_OURS = ("-m", "-mcpu=baseline")  # words of "python -m ziglang cc", and what zig is told by us
_GCC, _CLANG = "Free Software Foundation", "clang"  # in what they say of their version
_FIRST_GCC = {"v4": 8}  # that knows the flags


def possible_levels(compiler: Compiler, flags: Sequence[str] = ()) -> tuple[str, ...]:
    """List levels that a compiler makes code for; the base alone where its command or flags choose a processor."""
    words = (*compiler.command[1:], *compiler.flags, *flags)
    chosen = any(word.startswith(_CHOOSING) and word not in _OURS for word in words)
    if chosen or not (_GCC in compiler.version or _CLANG in compiler.version):
        return (BASE,)
    gcc = _gcc(compiler)
    return tuple(level for level in machine_levels() if gcc is None or gcc >= _FIRST_GCC.get(level, 0))


def level_flags(level: str, compiler: Compiler, *, fused: bool) -> tuple[str, ...]:
    """Return flags of a level; ``fused``: with fused multiply-adds, where the level has them."""
    narrow = (_NARROW,) if level == "v4" and _gcc(compiler) is not None else ()
    return (*_FLAGS[level], *(_FUSED[level] if fused else narrow))


def fuses_unasked(flags: Sequence[str]) -> bool:
    """Whether flags choose a processor for which gcc may fuse products with sums, though it must not contract."""
    return any(word.startswith(_TUNING) for word in flags) or (
        any(word.startswith("-mavx512") for word in flags) and _NARROW not in flags
    )


def _gcc(compiler: Compiler) -> int | None:
    """Return the first number of gcc's version, None for other compilers."""
    if _GCC not in compiler.version:
        return None
    match = re.search(r"\) (\d+)\.", compiler.version.partition("\n")[0])
    return int(match[1]) if match else 0


def chosen_level(asked: str, compiler: Compiler, flags: Sequence[str] = ()) -> str:
    """Choose the level to compile for here: the one that was asked for, or the best one that runs here.

    Raises:
        InputError: the level, or $EOMGEN_LEVEL, is none that this processor runs.
        BuildError: the level is none that the compiler makes code for.
    """
    possible = possible_levels(compiler, flags)
    if not asked:
        return best_level(possible)
    check_level(asked, "level")
    check_possible(asked, possible)
    return asked


def check_possible(level: str, possible: Sequence[str]) -> None:
    """Refuse a level that the compiler does not make code for."""
    if level not in possible:
        raise BuildError(
            f"level: {show(level)} is not what the compiler makes code for with these flags; allowed:"
            f" {', '.join(possible)}"
        )
