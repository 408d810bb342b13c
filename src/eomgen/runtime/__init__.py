"""The NumPy face of compiled kernels: all that a generated package carries.

Uses NumPy, cffi's objects, and of eomgen ``errors`` and ``names`` alone.
"""

from .kernel import Kernel
from .raw import Library, OneLibrary, RawFunction, RawKernel

__all__ = ["Kernel", "Library", "OneLibrary", "RawFunction", "RawKernel"]
