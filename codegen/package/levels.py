"""Levels of processors that packages are compiled for: their flags, and where there is a choice of them.

The instructions of a level are named one by one, as every gcc and clang of ten years knows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from eomgen.errors import BuildError
from eomgen.names import show
from eomgen.runtime.levels import BASE, best_level, check_level, machine_levels

_V3 = ("-mavx2", "-mfma")
LEVEL_FLAGS: Mapping[str, tuple[str, ...]] = {
    BASE: (),
    "v3": _V3,
    "v4": (*_V3, "-mavx512f", "-mavx512bw", "-mavx512cd", "-mavx512dq", "-mavx512vl"),
}
_CHOOSING = ("-m", "--machine", "-target", "--target", "-arch")  # what flags begin with that choose a processor
_OURS = ("-m", "-mcpu=baseline")  # words of "python -m ziglang cc", and what zig is told by us
_KNOWN = ("Free Software Foundation", "clang")  # in what gcc and clang say of their version


class Compiling(Protocol):
    """A compiler, as ``Compiler`` has it."""

    @property
    def command(self) -> tuple[str, ...]:
        """Its command."""

    @property
    def version(self) -> str:
        """What it says of its version."""

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of the environment."""


def possible_levels(compiler: Compiling, flags: Sequence[str] = ()) -> tuple[str, ...]:
    """Levels that a compiler makes code for; the base alone where its command or flags choose a processor themselves.

    Args:
        compiler: with the flags of the environment.
        flags: further ones.
    """
    words = (*compiler.command[1:], *compiler.flags, *flags)
    chosen = any(word.startswith(_CHOOSING) and word not in _OURS for word in words)
    if chosen or not any(maker in compiler.version for maker in _KNOWN):
        return (BASE,)
    return machine_levels()


def chosen_level(asked: str, compiler: Compiling, flags: Sequence[str] = ()) -> str:
    """The level to compile for here: the one that was asked for, or the best one that runs here.

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
    """BuildError for a level that the compiler does not make code for."""
    if level not in possible:
        raise BuildError(
            f"level: {show(level)} is not what the compiler makes code for with these flags; allowed:"
            f" {', '.join(possible)}"
        )
