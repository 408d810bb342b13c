"""Robot -> Kernel: stages, the cache of sources and packages, loading, costs.

Uses runtime, robot, loops, description and codegen (joint, kernels, c, derivation, samples, package).
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .building import build as build
    from .generating import generate as generate
    from .options import KERNEL_NAMES as KERNEL_NAMES
    from .options import Options as Options
    from .stages import make_source as make_source
