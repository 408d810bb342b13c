"""All functions of a kernel's C with the methods that call them."""

from __future__ import annotations

from .bound import BoundFunctions
from .kernel_methods import KernelFunctions, KernelMethods


class Functions(KernelMethods, KernelFunctions):
    """All functions of a kernel's C, one method each; ``Kernel`` has those of whole robots itself.

    Beside them there are functions of single parts (``spring_forces``, ``element_forces``, ``cut_forces``,
    ``coupling_forces``, ``drive_forces``, ``external_force``), of the constraint of loops (``constraint``,
    ``constraint_jacobian``, ``constraint_bias``, ``cut_poses``), of sensors and all frames at once (``measurement``,
    ``imu``, ``frame_velocities``, ``frame_accelerations``), ``regressor``, ``generalized_momentum`` and
    ``euler_cosines``.
    """

    def __init__(self, bound: BoundFunctions) -> None:
        """Take a kernel's functions."""
        self._bound = bound

    @property
    def is_direct(self) -> bool:
        """True if an extension module takes plain calls: arrays of the kernel's dtype and of exactly its shapes.

        They go to the C without checks in Python.  All others, and all errors, are those of the calls in Python, so
        that nothing but their time depends on it.  It is False where Python's or NumPy's headers were missing.
        """
        return self._bound.is_direct
