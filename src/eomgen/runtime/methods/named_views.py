"""What kernels have by name: blocks of matrices, inertial parameters, gears, followers.

A generated package carries a copy of this file.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError, UnknownNameError
from ...names import show
from ..arrays import joint_lead
from ..by_name import Blocks, make_blocks
from .compiled_code import CompiledCode

Array = NDArray[Any]


class NamedViews(CompiledCode):
    """Parts of a kernel's results and parameters by their names."""

    def blocks(self, q: ArrayLike) -> Blocks:
        """M and C of eqs. (10)-(12) by names, for one state or a batch; needs mass_matrix and christoffel.

        ``blocks.mass["joint1", "joint2"]`` is a joint's block, ``blocks.christoffel["joint1.x", "joint2.gamma",
        "joint2.gamma"]`` an entry; blocks that vanish identically are absent.  ``blocks.row`` and ``blocks.matrix``
        are the paper's M_i^sv and C_i^svw over all joints.
        """
        mass, christoffel = (self.calls.run(name, None, (q,)) for name in ("mass_matrix", "christoffel"))
        survivors = self.raw.libraries.about("christoffel")["survivors"]
        return make_blocks(mass, christoffel, survivors, self.coordinates)

    @property
    def regressor_names(self) -> tuple[str, ...]:
        """Names of the inertial parameters theta, the columns of ``regressor``.

        "link1.m" ... "link1.izz" of each link, "joint1.gamma.armature" and "joint1.motor.inertia" of coordinates.

        Raises:
            UnknownNameError: the kernel was built without the regressor.
        """
        if "regressor" not in self.raw.functions:
            raise self.raw.missing("regressor")
        return tuple(self.raw.libraries.meta["regressor"])

    @property
    def regressor_values(self) -> Array:
        """Inertial parameters theta of the description, (parameters,), kg, kg m, kg m^2; armatures as they are now.

        ``regressor(q, v, a) @ regressor_values`` is inverse dynamics without springs and dampers, loops cut.

        Raises:
            UnknownNameError: the kernel was built without the regressor.
            InputError: a run-time parameter of links was changed since.
        """
        names, meta = self.regressor_names, self.raw.libraries.meta
        found = self.raw.libraries.about("regressor")["inertial"]
        for name in found["come_from"]:
            if self.parameters[name] != meta["parameters"][name]:
                raise InputError(
                    f"regressor_values: {name} is {self.parameters[name]!r} now; allowed: the description's"
                    f" {meta['parameters'][name]!r}"
                )
        own = zip(names, found["values"], strict=True)
        return np.array([self.parameters.get(f"joints.{name}", value) for name, value in own], self.dtype)

    def ratio(self, motor: str) -> float:
        """Ratio of the gear behind a motor's coordinate ("joint1.motor") as the kernel has it now, 1 or rad/m.

        Raises:
            UnknownNameError: no motor of that name.
        """
        if not isinstance(motor, str) or motor not in self._ratios:
            raise UnknownNameError(f"motor: {show(motor)} is unknown; known: {', '.join(self._ratios)}")
        return float(self.parameters.get(f"joints.{motor}.ratio", self._ratios[motor]))

    def followers(self, q: ArrayLike, v: ArrayLike | None = None) -> dict[str, tuple[Array, Array]]:
        """Positions and velocities of what follows coordinates in rigid couplings, by name; m or rad, and per second.

        Args:
            q: (n,).
            v: (n,); zero if it is not given.

        Returns:
            Per follower a pair of numbers, or of arrays with the leading axes of q and v.
        """
        here, lead = self.calls.array("q", q, self.raw.shapes["q"])
        rates = np.zeros_like(here) if v is None else self.calls.array("v", v, self.raw.shapes["v"])[0]
        joint_lead("v", rates.shape[:-1], lead)
        matrix, offsets = self.follower_matrix()
        pairs = zip(self._followers, matrix.astype(self.dtype), offsets.astype(self.dtype), strict=True)
        return {name: (here @ row + offset, rates @ row + 0 * here[..., 0]) for name, row, offset in pairs}

    def follower_matrix(self) -> tuple[Array, Array]:
        """Matrix (followers, n) and offsets (followers,) that make positions of followers of q, with today's ratios.

        The rows are in the order of ``follower_names``, in the follower's unit per the coordinate's.
        """
        rows, offsets = dict[str, Array](), dict[str, float]()
        for name, coupling in self._followers.items():
            prefix, row = f"couplings.{coupling['coupling']}", np.zeros(self.n)
            offset = self.parameters.get(f"{prefix}.offset", coupling["offset"])
            for other, described in coupling["to"].items():
                ratio = self.parameters.get(f"{prefix}.ratio.{other}", described)
                if other in rows:
                    row, offset = row + ratio * rows[other], offset + ratio * offsets[other]
                else:
                    row[self.coordinates.index(other)] += ratio
            rows[name], offsets[name] = row, offset
        return np.array([*rows.values()]).reshape(-1, self.n), np.array([*offsets.values()])
