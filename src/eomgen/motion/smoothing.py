"""Velocities and accelerations of sampled coordinates."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..arrays import Array
from ..errors import InputError

ROWS = 4096  # windows that are solved at a time
STENCIL = 4  # half width of the differences
SLOPES = (0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280)  # central differences of eighth order, from the middle on
CURVES = (-205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560)
DIFFERENCE = 6  # order of the differences that show the noise


def local_polynomials(t: Array, x: Array, window: int, degree: int) -> tuple[Array, Array, Array]:
    """Return values, first and second derivatives of least-squares polynomials through a sliding window.

    Savitzky-Golay filter (Analytical Chemistry 36, 1964), for times at any distance; at the ends the first and
    last window are read off their middle.

    Args:
        t: times, (T,), s, increasing.
        x: samples, (T, k).
        window: samples in a window, odd, at most T.
        degree: of the polynomials, at least 2, less than the window.

    Raises:
        InputError: a window or degree that is not allowed.
    """
    if window % 2 == 0 or not degree < window <= len(t):
        raise InputError(f"window: {window} samples; allowed: an odd number from {degree + 1} to {len(t)}")
    if degree < 2:
        raise InputError(f"degree: {degree}; allowed: at least 2")
    coefficients = np.empty((3, *x.shape))
    starts = np.clip(np.arange(len(t)) - window // 2, 0, len(t) - window)
    times, samples = sliding_window_view(t, window), sliding_window_view(x, window, axis=0)
    for first in range(0, len(t), ROWS):
        rows = slice(first, first + ROWS)
        at = times[starts[rows]] - t[rows, np.newaxis]
        size = np.abs(at).max(axis=1)[:, np.newaxis]
        powers = (at / size)[..., np.newaxis] ** np.arange(degree + 1)
        weights = np.linalg.pinv(powers)[:, :3]
        coefficients[:, rows] = np.einsum("tpm,tkm->ptk", weights, samples[starts[rows]])
        coefficients[1, rows] /= size
        coefficients[2, rows] *= 2.0 / size**2
    return coefficients[0], coefficients[1], coefficients[2]


class Differentiator:
    """A bell (1 - s^2)^6, |s| <= 1, and central differences of eighth order of what it returns.

    The same bell stands in front of every derivative, so that a linear differential equation between smooth samples
    holds between the filtered samples as well, whatever the bell takes away.  weights: (3, 2 half + 1), by order.

    Args:
        half: half width of the bell and the differences together, samples, more than STENCIL.
        step: distance of the samples, s.
    """

    def __init__(self, half: int, step: float) -> None:
        self.half = half
        smooth = bell(half - STENCIL)
        stencils = (np.eye(2 * STENCIL + 1)[STENCIL], _mirrored(SLOPES, -1.0) / step, _mirrored(CURVES, 1.0) / step**2)
        self.weights = np.stack([np.convolve(smooth, stencil) for stencil in stencils])

    def __call__(self, x: Array, order: int = 0) -> Array:
        """Return the derivative of that order of the filtered samples, (T - 2 half, k)."""
        return filtered(x, self.weights[order])


def bell(half: int) -> Array:
    """Return weights (1 - s^2)^6 with sum 1, (2 half + 1,), none of them zero."""
    weights: Array = (1.0 - (np.arange(-half, half + 1) / (half + 1)) ** 2) ** 6
    weights /= weights.sum()
    return weights


def filtered(x: Array, weights: Array) -> Array:
    """Return columns convolved with the weights, where all of these have samples: (T - len(weights) + 1, k)."""
    return np.stack([np.convolve(column, weights, "valid") for column in x.T], axis=1)


def _mirrored(right: tuple[float, ...], sign: float) -> Array:
    """Return a stencil from its middle and right half, in the order in which a convolution takes it."""
    middle, *rest = right
    return np.array([*rest[::-1], middle, *(sign * value for value in rest)])


def noise_deviation(x: Array) -> Array:
    """Return the standard deviation of white noise on smooth samples, (k,).

    It is estimated from their sixth differences, by the median.
    """
    differences = np.diff(x, DIFFERENCE, axis=0)
    binomials = np.poly1d([1.0, -1.0]) ** DIFFERENCE
    spread: Array = np.median(np.abs(differences), axis=0) / 0.6744897501960817  # of a normal distribution
    return spread / float(np.sqrt((binomials.coeffs**2).sum()))
