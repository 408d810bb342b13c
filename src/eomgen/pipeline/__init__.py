"""Robot -> Kernel: the functions of a build, the cache, loading, costs.

Uses runtime, robot, loops, description and codegen (joint, kernels, c, derivation, package); ``kernel.device``
uses device.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .building import build as build
    from .generating import generate as generate
    from .options import KERNEL_NAMES as KERNEL_NAMES
    from .options import Options as Options
    from .stages import make_source as make_source
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
