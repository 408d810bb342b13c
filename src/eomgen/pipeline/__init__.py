"""Robot -> Kernel: stages, the cache of sources and packages, loading, costs.

Uses runtime, robot, loops, description and codegen (joint, kernels, c, samples, package).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .stages import KERNEL_NAMES as KERNEL_NAMES
    from .stages import Options as Options
    from .stages import build as build
    from .stages import generate as generate
    from .stages import make_source as make_source
else:  # or type checkers would take every name to be there; the cache alone does not wait for stages
    __getattr__, __dir__, __all__ = attributes(__name__, "stages: KERNEL_NAMES Options build generate make_source")
