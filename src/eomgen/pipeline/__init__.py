"""Robot -> Kernel: stages, the cache of sources and packages, loading, costs.

Uses runtime, robot, description and codegen (joint, kernels, c, samples, package).
"""

from .stages import KERNEL_NAMES, Options, build, generate, make_source

__all__ = ["KERNEL_NAMES", "Options", "build", "generate", "make_source"]
