"""Levels of processors that packages are compiled for: their flags, and where there is a choice of them.

The instructions of a level are named one by one, as every gcc and clang of ten years knows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from eomgen.errors import BuildError
from eomgen.names import show
from eomgen.runtime.levels import BASE, LEVELS, best_level, machine_levels

if TYPE_CHECKING:
    from .compile import Compiler

NATIVE = "native"  # instead of a level: this very processor
_V3 = ("-mavx2", "-mfma")
FLAGS: Mapping[str, tuple[str, ...]] = {
    BASE: (),
    "v3": _V3,
    "v4": (*_V3, "-mavx512f", "-mavx512bw", "-mavx512cd", "-mavx512dq", "-mavx512vl"),
}
_CHOOSING = ("-m", "--machine", "-target", "--target", "-arch")  # what flags begin with that choose a processor
_KNOWN = ("Free Software Foundation", "clang")  # in what gcc and clang say of their version


def possible_levels(compiler: Compiler, flags: Sequence[str] = ()) -> tuple[str, ...]:
    """Levels that a compiler makes code for; the base alone where its command or flags choose a processor themselves.

    Args:
        compiler: with the flags of the environment.
        flags: further ones.
    """
    words = (*compiler.command[1:], *compiler.flags, *flags)
    chosen = any(word.startswith(_CHOOSING) and word != "-mcpu=baseline" for word in words)  # which zig is given by us
    if chosen or not any(maker in compiler.version for maker in _KNOWN):
        return (BASE,)
    return machine_levels()


def chosen_level(asked: str, compiler: Compiler, flags: Sequence[str] = ()) -> str:
    """The level to compile for here: the one that was asked for, or the best one that runs here.

    Raises:
        InputError: $EOMGEN_LEVEL is no level, or one that this processor does not run.
        BuildError: the level is none that the compiler makes code for; or $EOMGEN_LEVEL excludes it.
    """
    possible = possible_levels(compiler, flags)
    if not asked:
        return best_level(possible)
    check_possible(asked, possible)
    return best_level((asked,))


def check_possible(level: str, possible: Sequence[str]) -> None:
    """BuildError for a level that the compiler does not make code for."""
    if level not in possible:
        raise BuildError(
            f"level: {show(level)} is not what the compiler makes code for with these flags; allowed:"
            f" {', '.join(possible)}"
        )
