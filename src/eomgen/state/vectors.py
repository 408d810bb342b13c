"""Vectors of a state, what drives and motions over time look like, and numbers that all who solve for a state share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError
from ..runtime.kernel import Kernel

Array = NDArray[np.float64]

RANK = 1e-7  # singular values below this part of the greatest one belong to redundant constraints
Q_STEP, V_STEP = 1e-7, 1e-6  # finite differences: small beside 1 rad, 1e9 times the round-off of a force

# Functions of time (s) and state (n,): drives, (n,); wrenches, (links, 6); and what prescribed coordinates do, by time
# alone: positions, rates and accelerations, (m,) each.
DriveFunction = Callable[[float, Array, Array], ArrayLike]
WrenchFunction = Callable[[float, Array, Array], ArrayLike]
MotionFunction = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike]]


def prescribed_mask(kernel: Kernel) -> NDArray[np.bool_]:
    """Which coordinates are prescribed, (n,)."""
    return np.array([name in kernel.prescribed for name in kernel.coordinates])


def state_vector(label: str, value: ArrayLike, coordinates: tuple[str, ...]) -> Array:
    """The value as a vector of one finite number per coordinate, a copy.

    Raises:
        ArrayError: it is none; the message begins with the label.
    """
    n = len(coordinates)
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArrayError(f"{label}: expected {n} numbers, got {type(value).__name__} ({error})") from None
    if array.shape != (n,):
        raise ArrayError(f"{label}: expected float64 of shape ({n},), got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        name = coordinates[bad[0]]
        raise ArrayError(f"{label}: {name} is {array[bad[0]]}; numbers must be finite", name)
    return array
