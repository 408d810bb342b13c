"""Robot -> Kernel: stages, the cache of sources and packages, loading, costs.

Uses runtime, robot, loops, description, rounding and codegen (joint, kernels, c, derivation, package).
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .stages import KERNEL_NAMES as KERNEL_NAMES
    from .stages import Options as Options
    from .stages import build as build
    from .stages import generate as generate
    from .stages import make_source as make_source
