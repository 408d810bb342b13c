"""Motors of a kernel and the joints behind them: angles, and what their transmissions act on."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from ..arrays import Array
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel


def shafts(kernel: Kernel) -> dict[str, str]:
    """Return names of the motors by the names of the principal coordinates that they drive."""
    return {principal: motor for motor, principal in kernel.motors.items()}


def acting(kernel: Kernel) -> tuple[str, ...]:
    """Return names of what laws of joints act on: coordinates, internal states, and behind them what follows them."""
    return (*kernel.calls.coordinates, *kernel.follower_names)


def deflections(kernel: Kernel) -> Array:
    """Return the matrix (acting, n) from q to the deflections that laws act on: of coordinates or transmissions.

    Behind them stand followers, which are off by their offsets.
    """
    rows = np.vstack([np.eye(kernel.n), follower_matrix(kernel)[0]])
    for motor, principal in kernel.motors.items():
        m, p = kernel.coordinates.index(motor), kernel.coordinates.index(principal)
        rows[m, m], rows[m, p] = 1.0 / kernel.ratio(motor), -1.0
    return rows


def turn_motors(kernel: Kernel, x: Array, known: Container[str]) -> None:
    """Let motors that are not among ``known`` turn with their joints, in coordinates or rates x, (n,)."""
    for motor, principal in kernel.motors.items():
        if motor not in known:
            x[kernel.coordinates.index(motor)] = kernel.ratio(motor) * x[kernel.coordinates.index(principal)]
