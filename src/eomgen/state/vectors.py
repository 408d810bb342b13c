"""Vectors over a kernel's coordinates and how they are checked; types of functions that give drives and wrenches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Mask
from ..errors import ArrayError
from ..identifiers import are_names, check_kind
from ..kernel.complete import Kernel
from ..runtime.arrays import numbers_in
from ..runtime.bound import WrenchLike

DriveFunction = Callable[[float, Array, Array], ArrayLike]  # (t, q, v) -> u, (n,), N or N m
WrenchFunction = Callable[[float, Array, Array], WrenchLike]  # (t, q, v) -> (links, 6), or by frame and link
MotionFunction = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike]]  # t -> q, v, a of prescribed coordinates

Q_STEP, V_STEP = 1e-7, 1e-6  # finite differences: small beside 1 rad, 1e9 times the round-off of a force


def prescribed_mask(kernel: Kernel) -> Mask:
    """Return the mask of prescribed coordinates, (n,)."""
    return np.array([name in kernel.prescribed for name in kernel.calls.coordinates])


def state_vector(label: str, value: ArrayLike, coordinates: tuple[str, ...]) -> Array:
    """Return the value as a vector of one finite number per coordinate, a copy.

    Raises:
        ArrayError: it is none; the message begins with the label.
    """
    check_kind("coordinates", coordinates, are_names(coordinates), "a sequence of names")
    n = len(coordinates)
    array = numbers_in(label, value, f"{n} finite numbers, one per coordinate", finite=False)
    if array.shape != (n,):
        raise ArrayError(f"{label}: expected float64 of shape ({n},), got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        name = coordinates[bad[0]]
        raise ArrayError(f"{label}: {name} is {array[bad[0]]}; numbers must be finite", name)
    return array
