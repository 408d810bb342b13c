"""Kernels with all methods: derivatives, adaptive integration, inverse kinematics, loops and views by name.

Uses runtime, and of eomgen errors and names.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .complete import Kernel as Kernel
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
