"""Proved bounds of rounding errors of kernels over ranges of inputs and parameters; what single precision costs.

Uses robot, description and codegen (program, kernels).
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .advice import float32_advice as float32_advice
    from .advice_result import Float32Advice as Float32Advice
    from .advice_result import Float32Errors as Float32Errors
    from .bounds import rounding_bound as rounding_bound
    from .bounds import rounding_bounds as rounding_bounds
    from .result import RoundingBound as RoundingBound
    from .result import RoundingBounds as RoundingBounds
