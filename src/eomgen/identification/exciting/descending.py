"""The least value of a smooth function of a few hundred numbers: BFGS with a line search for weak Wolfe conditions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...arrays import Array

Function = Callable[[Array], tuple[float, Array]]  # its value and gradient

DECREASE, CURVATURE = 1e-4, 0.9  # of Wolfe's conditions
HALVINGS = 40  # of a step
SMALL = 1e-7  # a step that wins less, relative to the value or 1, is the last one


def descended(function: Function, z: Array, steps: int) -> tuple[Array, bool]:
    """Return numbers near a local minimum of a function, (n,), and whether the search ended there.

    It takes so many steps at most, and values never rise.  Source of the line search: A. S. Lewis, M. L. Overton,
    "Nonsmooth optimization via quasi-Newton methods", Mathematical Programming 141 (2013).
    """
    value, gradient = function(z)
    H = np.eye(z.size) / max(float(np.linalg.norm(gradient)), 1e-12)
    for number in range(steps):
        direction = -(H @ gradient)
        if not direction @ gradient < 0.0:
            return z, True
        step = _along(function, z, value, gradient, direction)
        if step is None:
            return z, True
        x, less, slope = step
        s, y = x - z, slope - gradient
        won, curved = value - less, float(s @ y)
        z, value, gradient = x, less, slope
        if won <= SMALL * max(1.0, abs(value)):
            return z, True
        if curved > 0.0:
            if not number:
                H = np.eye(z.size) * (curved / float(y @ y))
            Hy = H @ y
            H += np.outer(s, s) * ((curved + y @ Hy) / curved**2) - (np.outer(Hy, s) + np.outer(s, Hy)) / curved
    return z, False


def _along(
    function: Function, z: Array, value: float, gradient: Array, direction: Array
) -> tuple[Array, float, Array] | None:
    """Return numbers along a direction with their value and gradient; None where none is less."""
    slope, low, high, t = float(gradient @ direction), 0.0, np.inf, 1.0
    best = None
    for _ in range(HALVINGS):
        x = z + t * direction
        here, there = function(x)
        if not here <= value + DECREASE * t * slope:
            high = t
        else:
            best = x, here, there
            if there @ direction >= CURVATURE * slope:
                break
            low = t
        t = (low + high) / 2.0 if np.isfinite(high) else 2.0 * t
    return best
