"""How large deviations are: what tolerances refer to."""

from __future__ import annotations

import numpy as np

from ..arrays import Array

REFERENCE_ACCELERATION = 10.0  # m/s^2, rad/s^2: about 1 g; what it does to a spring is the size of its deviation


def deviation_sizes(stiffness: Array, inertia: Array) -> tuple[Array, Array]:
    """Sizes of coordinates and rates, (n,) each; m, rad, s.

    A coordinate with stiffness k and inertia m has w^2 = k / m; at 10 m/s^2 or rad/s^2 it gives way by 10 / w^2, often
    micrometres, and swings with rates of 10 / w.  Without a spring, or with a soft one, the size is 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        period = np.where((stiffness > 0.0) & (inertia > 0.0), np.sqrt(inertia / stiffness), np.inf)
    return np.minimum(1.0, REFERENCE_ACCELERATION * period**2), np.minimum(1.0, REFERENCE_ACCELERATION * period)
