"""Options of a build: which kernels, in which precision, and how they are compiled."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from ..codegen.kernels.signatures import DTYPES, KERNELS, OWN_KERNELS
from ..errors import InputError
from ..identifiers import word_in
from ..names import show
from ..runtime.levels import BASE, LEVELS

ALL = "all"  # stands for all kernels but derivatives, and for all levels
KERNEL_NAMES = tuple(KERNELS.compiled)
OWNERS = {name: name for name in KERNELS.compiled} | {  # the kernel that a name stands for
    function: kernel for kernel, signature in KERNELS.items() for function in signature.functions
}
_NAMED = tuple(name for name, kernel in OWNERS.items() if kernel in OWN_KERNELS)


@dataclass(frozen=True)
class Options:
    """Options of a build: which kernels are generated, and how they are compiled.

    kernels: names of KERNEL_NAMES, or "all" for all but derivatives; those of springs between points come with any.  A
        function that belongs to a kernel of another name stands for it: frame_pose and frame_jacobian for "kinematics".
        Without names ``generate`` takes those of PACKAGE.
    dtype: "float64" or "float32".
    native: compile for this processor alone, with fused multiply-add, which changes the last bits.
    levels: instructions that may be used, on x86-64: "v1" (SSE2, any processor), "v3" (AVX2) or "v4" (AVX-512).
        Without any ``build`` takes the best that runs here, up to the environment's EOMGEN_LEVEL, and ``generate`` that
        and "v1"; "all" are for packages that travel.  The best of a package is chosen where it is loaded.  All give the
        same bits.
    flags: further compiler flags, behind those of $CFLAGS; none that give up IEEE arithmetic.
    batches: with functions for several states in one call; Python's kernels need them.
    scalar: generate one file of C, without SIMD; its functions for several states call those for one, state by state.
    libm: take sines and cosines of the C library instead of the kernel's polynomials; other last bits.
    quick: compile in two thirds of the time, for calls from Python; code that stores much, such as a mass matrix, may
        be slower by half.
    """

    kernels: tuple[str, ...] = ()
    dtype: str = "float64"
    native: bool = False
    flags: tuple[str, ...] = ()
    batches: bool = True
    scalar: bool = False
    libm: bool = False
    levels: tuple[str, ...] = ()
    quick: bool = False

    def __post_init__(self) -> None:
        known = f"{', '.join(_NAMED)}, their derivatives, such as energy_adjoint, or {ALL}"
        kernels = _names("kernels", self.kernels, {ALL, *OWNERS}, known, _NAMED[0])
        object.__setattr__(self, "kernels", tuple(dict.fromkeys(OWNERS.get(name, name) for name in kernels)))
        word_in("dtype", self.dtype, DTYPES)
        levels = _names("levels", self.levels, {ALL, *LEVELS}, f"{', '.join(LEVELS)}, {ALL}", BASE)
        object.__setattr__(self, "levels", (ALL,) if ALL in levels else tuple(x for x in LEVELS if x in levels))
        if levels and self.native:
            raise InputError(f"levels: {', '.join(self.levels)} beside native; allowed: one of them")


def _names(label: str, given: object, known: Collection[str], allowed: str, example: str) -> tuple[str, ...]:
    """Return names as a tuple; InputError for anything but a sequence of known ones."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        such = f"({given!r},)" if isinstance(given, str) and given else f'such as ("{example}",)'
        raise InputError(f"{label}: {show(given)}; allowed: a sequence of names, {such}")
    names = tuple(given)
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise InputError(f"{label}: {show(name)} is unknown; allowed: {allowed}")
    return names
