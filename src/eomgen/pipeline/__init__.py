"""Robot -> Kernel: stages, the cache of sources and packages, loading, costs.

Uses runtime, robot, loops, description and codegen (joint, kernels, c, derivation, samples, package).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .stages import KERNEL_NAMES, Options, build, generate, make_source

__all__ = ["KERNEL_NAMES", "Options", "build", "generate", "make_source"]


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, dict.fromkeys(__all__, "stages"))  # which the cache alone does not wait for


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
