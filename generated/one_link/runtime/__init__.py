"""The NumPy face of compiled kernels: all that a generated package carries.

Uses NumPy, cffi's objects, and of eomgen ``errors`` and ``names`` alone.
"""

from .kernel import Kernel
from .raw import RawFunction, RawKernel

__all__ = ["Kernel", "RawFunction", "RawKernel"]
