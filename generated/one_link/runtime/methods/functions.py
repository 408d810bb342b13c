"""All functions of a kernel's C with the methods that call them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import joint_lead
from ..calls import Calls
from ..raw import Array, name_of
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

    def __init__(self, bound: BoundFunctions, calls: Calls) -> None:
        """Take a kernel's functions and its calls."""
        self._bound, self._calls = bound, calls

    @property
    def is_direct(self) -> bool:
        """True if an extension module takes plain calls: arrays of the kernel's dtype and of exactly its shapes.

        They go to the C without checks in Python.  All others, and all errors, are those of the calls in Python, so
        that nothing but their time depends on it.  It is False where Python's or NumPy's headers were missing.
        """
        return self._bound.is_direct

    def drive_forces(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, z: ArrayLike | None = None, *, out: Array | None = None
    ) -> Array:
        """Return the forces of all drives on coordinates, (n,), N or N m, where u means what ``inputs`` says.

        Args:
            q, v, u: (n,).
            z: internal states, (m,).
            out: array to write to.
        """
        calls = self._calls
        if calls.arrays.has_drives:
            return self._bound[name_of(self.drive_forces)](q, v, u, z, out)
        lead: tuple[int, ...] = ()
        for label, value, states in (("q", q, None), ("v", v, z), ("u", u, None)):
            joined = calls.join(label, value, states)
            array, own = calls.augmented.array(label, joined, (calls.augmented.n,))
            lead = joint_lead(label, own, lead)
        forces = calls.split(np.array(np.broadcast_to(array, (*lead, calls.augmented.n))), "vector")
        return calls.arrays.written(forces, out)
