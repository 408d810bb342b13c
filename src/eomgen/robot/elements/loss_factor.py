"""Maxwell branches whose damping is nearly independent of frequency: fitted to a loss factor over a band.

A spring k with branches k_i, c_i has the complex stiffness k + sum of k_i (j w t_i) / (1 + j w t_i), t_i = c_i / k_i;
its loss factor is the ratio of imaginary to real part.  Relaxation frequencies 1 / t_i stand evenly spaced in their
logarithms, from the band's ends or from beyond them; the k_i, none below 0, are those of least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...arrays import Array

SAMPLES = 100  # frequencies of the band
ROUNDS = 6  # of weights by the real part
MARGINS = np.linspace(0.0, 1.0, 11)  # of the distance between neighbours, by which the outermost stand outside


@dataclass(frozen=True)
class FittedBranches:
    """Branches of a spring of stiffness 1: (stiffness, damping in s), and the largest deviation of the loss factor."""

    branches: tuple[tuple[float, float], ...]
    deviation: float


def loss_factors(branches: tuple[tuple[float, float], ...], w: Array) -> Array:
    """Return the loss factor of a spring of stiffness 1 with branches beside it at angular frequencies, rad/s."""
    whole = np.ones(w.shape, complex)
    for k, c in branches:
        whole += k * (1j * w * c) / (k + 1j * w * c)
    return np.asarray(whole.imag / whole.real)


@lru_cache(maxsize=100)
def fitted_branches(loss_factor: float, band_hz: tuple[float, float], count: int) -> FittedBranches:
    """Fit ``count`` branches; those whose stiffness is 0 fall away.

    Args:
        loss_factor: greater than 0.
        band_hz: lower and upper frequency of the band, Hz.
        count: of the branches.
    """
    low, high = (2.0 * np.pi * f for f in band_hz)
    w = np.geomspace(low, high, SAMPLES)
    step = np.log(high / low) / max(count - 1, 1)
    best = None
    for margin in MARGINS if count > 1 else (0.0,):
        ends = (low * np.exp(-margin * step), high * np.exp(margin * step))
        at = np.geomspace(*ends, count) if count > 1 else np.array([np.sqrt(low * high)])
        fit = _fitted(loss_factor, w, at)
        squares = float(np.sum((loss_factors(fit, w) - loss_factor) ** 2))
        if best is None or squares < best[0]:
            best = (squares, fit)
    assert best is not None
    return FittedBranches(best[1], float(np.abs(loss_factors(best[1], w) - loss_factor).max()))


def _fitted(loss_factor: float, w: Array, at: Array) -> tuple[tuple[float, float], ...]:
    """Return branches at relaxation frequencies, rad/s, of least squares of the loss factor."""
    x = w[:, None] / at
    real, imaginary = x**2 / (1.0 + x**2), x / (1.0 + x**2)
    columns, right = imaginary - loss_factor * real, np.full(w.size, loss_factor)
    k = np.zeros(at.size)
    for _ in range(ROUNDS):
        weight = 1.0 / (1.0 + real @ k)
        k = _not_negative(columns * weight[:, None], right * weight)
    return tuple((float(k[i]), float(k[i] / at[i])) for i in np.flatnonzero(k > 0.0))


def _not_negative(A: Array, b: Array) -> Array:
    """Return x >= 0 of least |A x - b|.

    C. L. Lawson, R. J. Hanson, "Solving Least Squares Problems", algorithm NNLS (section 23.3).
    """
    x, free = np.zeros(A.shape[1]), np.zeros(A.shape[1], bool)
    for _ in range(3 * A.shape[1]):
        slope = np.where(free, -np.inf, A.T @ (b - A @ x))
        if slope.max() <= 1e-12 * np.abs(A.T @ b).max():
            break
        free[np.argmax(slope)] = True
        while True:
            best = np.zeros(x.size)
            best[free] = np.linalg.lstsq(A[:, free], b, rcond=None)[0]
            below = free & (best <= 0.0)
            if not below.any():
                break
            reach = (x[below] / (x[below] - best[below])).min()
            x = x + reach * (best - x)
            free &= x > 1e-14 * x.max()
        x = best
    return x
