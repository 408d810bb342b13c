"""How large deviations are: what tolerances refer to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..arrays import Array
from .laws import stiffness_of

REFERENCE_ACCELERATION = 10.0  # m/s^2, rad/s^2: about 1 g; what it does to a spring is the size of its deviation


def table_stiffnesses(
    numbers: Mapping[str, Mapping[str, float]], coordinates: Sequence[str], knots: Mapping[str, Sequence[float]]
) -> Array:
    """Give the stiffness of every coordinate's own table, (n,), N/m or N m/rad; of a motor's its transmission's.

    Args:
        numbers: of the coordinates' forces, by coordinate and by their names in the table of laws.
        coordinates: names, such as "elbow.alpha".
        knots: deviations of measured curves, by coordinate.
    """
    return np.array([stiffness_of(numbers.get(name, {}), knots.get(name, ())) for name in coordinates])


def deviation_sizes(stiffness: Array, inertia: Array) -> tuple[Array, Array]:
    """Sizes of coordinates and rates, (n,) each; m, rad, s.

    A coordinate with stiffness k and inertia m has w^2 = k / m; at 10 m/s^2 or rad/s^2 it gives way by 10 / w^2, often
    micrometres, and swings with rates of 10 / w.  Without a spring, or with a soft one, the size is 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        period = np.where((stiffness > 0.0) & (inertia > 0.0), np.sqrt(inertia / stiffness), np.inf)
    return np.minimum(1.0, REFERENCE_ACCELERATION * period**2), np.minimum(1.0, REFERENCE_ACCELERATION * period)
