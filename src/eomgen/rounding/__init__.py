"""Proved bounds of rounding errors of kernels over ranges of inputs and parameters.

Uses robot, description and codegen (program, kernels, samples).
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .bounds import rounding_bound as rounding_bound
    from .bounds import rounding_bounds as rounding_bounds
    from .result import RoundingBound as RoundingBound
    from .result import RoundingBounds as RoundingBounds
