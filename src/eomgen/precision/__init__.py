"""Static bounds of rounding errors over ranges of inputs; errors of single precision.

Uses robot, description and codegen (program, kernels).
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .bounds import rounding_bound as rounding_bound
    from .bounds import rounding_bounds as rounding_bounds
    from .float32 import float32_advice as float32_advice
    from .float32_result import Float32Advice as Float32Advice
    from .float32_result import Float32Errors as Float32Errors
    from .result import RoundingBound as RoundingBound
    from .result import RoundingBounds as RoundingBounds
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
