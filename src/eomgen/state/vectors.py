"""Vectors over a kernel's coordinates and how they are checked; types of functions that give drives and wrenches."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Mask
from ..errors import ArrayError, InputError, UnknownNameError, check_kind
from ..names import are_names, nearest_or_all, show
from ..runtime.arrays import numbers_in
from ..runtime.by_name import WrenchLike
from ..runtime.kernel import Kernel

DriveFunction = Callable[[float, Array, Array], ArrayLike]  # (t, q, v) -> u, (n,), N or N m
WrenchFunction = Callable[[float, Array, Array], WrenchLike]  # (t, q, v) -> (links, 6), or by frame and link
StatesLike = Mapping[str, float] | ArrayLike  # of laws, (memory,), or by their names
MotionFunction = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike]]  # t -> q, v, a of prescribed coordinates

Q_STEP, V_STEP = 1e-7, 1e-6  # finite differences: small beside 1 rad, 1e9 times the round-off of a force


def prescribed_mask(kernel: Kernel) -> Mask:
    """Return the mask of prescribed coordinates, (n,)."""
    return np.array([name in kernel.prescribed for name in kernel.velocities])


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


def memory_vector(kernel: Kernel, z: StatesLike | None) -> Array:
    """Return states of laws, (memory,), m or rad: zeros where nothing is said, or by names, those left out 0.

    Raises:
        InputError: no law of the robot has a state.
        UnknownNameError: a name is none of ``kernel.memory``.
        ArrayError: another shape, or numbers that are not finite.
    """
    if z is None:
        return np.zeros(len(kernel.memory))
    if not kernel.memory:
        raise InputError(f"z: no law of {kernel.name} has a state; allowed: a call without z")
    if not isinstance(z, Mapping):
        return state_vector("z", z, kernel.memory)
    for name in z:
        if name not in kernel.memory:
            raise UnknownNameError(f"z: {show(str(name))} is unknown{nearest_or_all(str(name), kernel.memory)}")
    return state_vector("z", [z.get(name, 0.0) for name in kernel.memory], kernel.memory)


def whole_vector(kernel: Kernel, label: str, value: ArrayLike) -> tuple[Array, int]:
    """Return a vector over coordinates and, behind them, states of laws, and how many numbers it was given with.

    Args:
        kernel: n of whose ``velocities`` are coordinates.
        label: begins what errors say.
        value: (n,), behind which zeros stand then, or (kernel.n,).

    Raises:
        ArrayError: it is none of both.
    """
    n = len(kernel.coordinates)
    names = kernel.velocities if np.shape(value) == (kernel.n,) else kernel.coordinates
    whole = np.zeros(kernel.n)
    whole[: len(names)] = state_vector(label, value, names)
    return whole, n if kernel.n == n else len(names)


def at_rest_with(kernel: Kernel, z: Array) -> Array:
    """Return velocities of a robot at rest whose laws have states z, (memory,): (kernel.n,), zeros, then z."""
    return np.concatenate([np.zeros(len(kernel.coordinates)), z])
