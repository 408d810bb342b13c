"""Characteristic sizes of deviations, to which tolerances refer."""

from __future__ import annotations

import numpy as np

from ..arrays import Array

REFERENCE_ACCELERATION = 10.0  # m/s^2, rad/s^2: about 1 g; the deflection of a spring under it is the size


def deviation_sizes(stiffness: Array, inertia: Array) -> tuple[Array, Array]:
    """Return sizes of coordinates and velocities, (n,) each; m, rad, s.

    A coordinate with stiffness k and inertia m has w^2 = k / m; at 10 m/s^2 or rad/s^2 it deflects by 10 / w^2, often
    micrometres, and swings with velocities of 10 / w.  Without a spring, or with a soft one, the size is 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        period = np.where((stiffness > 0.0) & (inertia > 0.0), np.sqrt(inertia / stiffness), np.inf)
    return np.minimum(1.0, REFERENCE_ACCELERATION * period**2), np.minimum(1.0, REFERENCE_ACCELERATION * period)
