"""Options of a build: which kernels, in which precision, and how they are compiled."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..codegen.kernels.signatures import DTYPES, KERNELS, OWN_KERNELS
from ..errors import InputError
from ..names import show, word_in
from ..runtime.levels import LEVELS

KERNEL_NAMES = tuple(KERNELS.compiled)
OWNERS = {name: name for name in KERNELS.compiled} | {  # the kernel that a name stands for
    function: kernel for kernel, signature in KERNELS.items() for function in signature.functions
}
_NAMED = tuple(name for name, kernel in OWNERS.items() if kernel in OWN_KERNELS)


@dataclass(frozen=True)
class Options:
    """Options of a build: which kernels are generated, and how they are compiled.

    kernels: names of KERNEL_NAMES, all but derivatives if empty; those of springs between points come with any.  A
        function that belongs to a kernel of another name stands for it: frame_pose and frame_jacobian for "kinematics".
    dtype: "float64" or "float32".
    native: compile for this processor alone, with fused multiply-add, which changes the last bits.
    level: instructions that may be used, on x86-64: "v1" (SSE2, any processor), "v3" (AVX2) or "v4" (AVX-512).  Without
        one ``build`` takes the best that runs here, up to the environment's EOMGEN_LEVEL, and ``generate`` takes all,
        of which the best is chosen where the package is loaded.  All give the same bits.
    flags: further compiler flags, behind those of $CFLAGS; none that give up IEEE arithmetic.
    batches: with functions for several states in one call; Python's kernels need them.
    quick: compile in two thirds of the time, for calls from Python; code that stores much, such as a mass matrix, may
        be slower by half.
    """

    kernels: tuple[str, ...] = ()
    dtype: str = "float64"
    native: bool = False
    flags: tuple[str, ...] = ()
    batches: bool = True
    level: str = ""
    quick: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.kernels, str) or not isinstance(self.kernels, Iterable):
            such = (
                f"({self.kernels!r},)" if isinstance(self.kernels, str) and self.kernels else 'such as ("mass_matrix",)'
            )
            raise InputError(f"kernels: {show(self.kernels)}; allowed: a sequence of names, {such}, or for build 'all'")
        names = tuple(self.kernels)
        for name in names:
            if not isinstance(name, str) or name not in OWNERS:
                known = f"{', '.join(_NAMED)}, and their derivatives, such as energy_adjoint"
                raise InputError(f"kernels: {show(name)} is unknown; allowed: {known}")
        object.__setattr__(self, "kernels", tuple(dict.fromkeys(OWNERS[name] for name in names)))
        word_in("dtype", self.dtype, DTYPES)
        if not isinstance(self.level, str) or self.level not in ("", *LEVELS):
            raise InputError(f"level: {show(self.level)} is unknown; allowed: {', '.join(LEVELS)}")
        if self.level and self.native:
            raise InputError(f"level: {show(self.level)} beside native; allowed: one of them")
