"""All functions of a kernel's C with the methods that call them."""

from __future__ import annotations

from typing import Any

from ..errors import InputError
from ..runtime.calls import Calls
from ..runtime.compiled_kernel import CompiledKernel
from ..runtime.direct import BoundFunctions
from .declared_methods import DECLARED, DeclaredFunctions
from .kernel_methods import KernelFunctions, KernelMethods


class Functions(KernelMethods, KernelFunctions):
    """All functions of a kernel's C, one method each; ``Kernel`` has those of whole robots itself.

    Beside them there are functions of single parts (``spring_forces``, ``element_forces``, ``cut_forces``,
    ``coupling_forces``, ``drive_forces``, ``external_force``), of the constraint of loops (``constraint``,
    ``constraint_jacobian``, ``constraint_bias``, ``cut_poses``), of sensors and all frames at once (``measurement``,
    ``imu``, ``frame_velocities``, ``frame_accelerations``), ``regressor``, ``generalized_momentum`` and
    ``euler_cosines``.

    Attributes:
        is_direct: True if an extension module takes plain calls: arrays of the kernel's dtype and of exactly its
            shapes.  They go to the C without checks in Python.  All others, and all errors, are those of the calls in
            Python, so that nothing but their time depends on it.  It is False where Python's or NumPy's headers were
            missing.
    """

    def __init__(self, bound: BoundFunctions) -> None:
        """Take a kernel's functions."""
        self._bound = bound

    @property
    def is_direct(self) -> bool:
        """Whether plain calls go through an extension module."""
        return self._bound.is_direct


class KernelWithMethods(KernelMethods, CompiledKernel):
    """Compiled functions with the methods of kernels that call them; attributes as of ``Kernel``."""

    _kind_of_bound = DeclaredFunctions

    def _take_calls(self, calls: Calls) -> None:
        for name in vars(self).keys() & DECLARED.keys():  # functions of other calls
            del vars(self)[name]
        super()._take_calls(calls)
        self.functions = Functions(self._bound)

    def device(self, where: Any = "cuda", *, contract: bool = False) -> Any:
        """Return methods of the same names on arrays that lie on a device of CUDA; see ``eomgen.device.face.Device``.

        Parameters are those of this kernel, also when they change.

        Args:
            where: "cuda", with the number of a device such as "cuda:1".
            contract: let products and sums be one operation: faster, with other last bits than on processors.

        Raises:
            InputError: there is no such device, no driver or no compiler for it; or the kernel is of a generated
                package, which has no text for devices.
        """
        if self._opener is None:
            raise InputError(
                f"device: {self.name} is a kernel of a package, which has no text for devices; allowed: kernels of"
                " eomgen.build, and what eomgen.export_simt writes"
            )
        return self._opener(self, where, contract=contract)
