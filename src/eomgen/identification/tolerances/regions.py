"""Regions that hold a vector with a probability: radii of spheres of normal vectors whose variances are unequal."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ...optional import optional_import

_NODES = 32  # directions in a quarter of the plane
_ROUND = 1e-6  # a r below which D(a r) / a is r
_STEPS = 60
_FLAT = 1e-12  # of the greatest variance: none
_TERMS = 256  # of a Fourier series; one uniform number beside a small normal one is off by 8e-4 at most
_TAIL = 9.0  # standard deviations within which a normal number stays
_HALVINGS = 40
_CHUNK = 1000  # poses at once


def radii(covariance: Array, probability: float) -> Array:
    """Return the radius of the sphere that holds a normal vector of mean 0 with that probability, (N,), of (N, 3, 3).

    It is the quantile of the root of l1 z1^2 + l2 z2^2 + l3 z3^2 where l are the eigenvalues and z normal.
    """
    variances = np.maximum(np.linalg.eigvalsh(covariance), 0.0)[:, ::-1]
    radii = np.zeros(len(variances))
    there = np.flatnonzero(variances[:, 0] > 0.0)
    for first in range(0, len(there), _CHUNK):
        chunk = there[first : first + _CHUNK]
        largest = variances[chunk, 0]
        radii[chunk] = np.sqrt(largest) * _quantiles(variances[chunk, 1:] / largest[:, np.newaxis], probability)
    return radii


def quantile_of_normal(probability: float) -> float:
    """Return standard deviations in half an interval that holds a normal number with that probability."""
    with optional_import("SciPy", "regions need"):
        from scipy.special import ndtri
    return float(ndtri(0.5 + 0.5 * probability))


def worst_deviations(covariance: Array) -> Array:
    """Return the standard deviation along the direction in which it is greatest, (N,), of (N, 3, 3)."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))


def worst_directions(covariance: Array) -> Array:
    """Return the unit vectors along which the standard deviation is greatest, (N, 3), of (N, 3, 3)."""
    return np.asarray(np.linalg.eigh(covariance)[1][..., -1])


def mixed_quantiles(deviation: Array, amplitudes: Array, probability: float) -> Array:
    """Return half an interval that holds a sum of a normal number and of uniform ones with that probability, (N,).

    By the characteristic function, exp(-(w s)^2 / 2) times all sin(w a_k) / (w a_k): where the sum stays within L, its
    distribution is the Fourier series P(|x| < r) = r / L + sum of 2 / (pi m) f(pi m / L) sin(pi m r / L).

    Args:
        deviation: of the normal number, (N,).
        amplitudes: half widths of the uniform numbers, (N, K).
        probability: between 0 and 1.
    """
    quantiles = np.empty(len(deviation))
    for first in range(0, len(deviation), _CHUNK):
        chunk = slice(first, first + _CHUNK)
        quantiles[chunk] = _mixed(deviation[chunk], np.abs(amplitudes[chunk]), probability)
    return quantiles


def _mixed(deviation: Array, amplitudes: Array, probability: float) -> Array:
    reach = amplitudes.sum(axis=1) + _TAIL * deviation
    L = np.where(reach > 0.0, reach, 1.0)[:, np.newaxis]
    m = np.arange(1.0, _TERMS + 1.0)
    w = np.pi * m / L
    f = np.exp(-0.5 * (w * deviation[:, np.newaxis]) ** 2)
    for a in amplitudes.T:
        f *= np.sinc(w * a[:, np.newaxis] / np.pi)
    f *= 2.0 / (np.pi * m)
    low, high = np.zeros(len(L)), reach.copy()
    for _ in range(_HALVINGS):
        r = 0.5 * (low + high)
        below = r / L[:, 0] + (f * np.sin(w * r[:, np.newaxis])).sum(axis=1) < probability
        low, high = np.where(below, r, low), np.where(below, high, r)
    return np.asarray(0.5 * (low + high))


def ellipsoids(covariance: Array, probability: float) -> tuple[Array, Array]:
    """Return half axes, (N, 3), and their directions in columns of rotations, (N, 3, 3), of (N, 3, 3).

    The ellipsoids hold a normal vector of mean 0 with that probability; they are flat where it cannot go.
    """
    with optional_import("SciPy", "regions need"):
        from scipy.special import chdtri
    variances, axes = np.linalg.eigh(covariance)
    axes[..., 0] *= np.where(np.linalg.det(axes) < 0.0, -1.0, 1.0)[..., np.newaxis]
    is_moved = variances > _FLAT * variances[..., -1:]
    many = is_moved.sum(axis=-1, keepdims=True)
    size = np.where(many > 0, chdtri(np.maximum(many, 1.0), 1.0 - probability), 0.0)
    return np.sqrt(size * np.where(is_moved, variances, 0.0)), axes


def _quantiles(ratios: Array, probability: float) -> Array:
    """Return quantiles of the root where the greatest variance is 1 and the others are ``ratios``, (N, 2).

    They are found by Newton's method, kept between bounds.
    """
    with optional_import("SciPy", "regions need"):
        from scipy.special import chdtri
    low = np.full(len(ratios), np.sqrt(chdtri(1.0, 1.0 - probability)))
    high = np.full(len(ratios), np.sqrt(chdtri(3.0, 1.0 - probability)))
    slopes = _slopes(ratios)
    r = 0.5 * (low + high)
    for _ in range(_STEPS):
        reached, density = _probabilities(r, slopes)
        below = reached < probability
        low, high = np.where(below, r, low), np.where(below, high, r)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (probability - reached) / density
        trial = r + step
        is_inside = (trial >= low) & (trial <= high)
        r = np.where(is_inside, trial, 0.5 * (low + high))
        if bool(np.all(is_inside & (np.abs(step) < 1e-12 * r))):
            break
    return np.asarray(r)


def _slopes(ratios: Array) -> Array:
    """Return a^2 = (1 / g - 1) / 2 of the variances g along directions between the two smaller axes, (N, nodes)."""
    squares = np.cos(0.5 * np.pi * (np.arange(_NODES) + 0.5) / _NODES) ** 2
    g = ratios[:, :1] * squares + ratios[:, 1:] * (1.0 - squares)
    return np.asarray(0.5 * (1.0 / np.maximum(g, 1e-300) - 1.0))


def _probabilities(r: Array, slopes: Array) -> tuple[Array, Array]:
    """Return the probability that the root is below r, and its density, (N,).

    Along a direction between the two smaller axes their share is g times a chi-square number of two degrees of freedom,
    so that with z1 the probability is erf(r / sqrt 2) - sqrt(2 / pi) exp(-r^2 / 2) D(a r) / a with Dawson's D; the mean
    over directions, which is periodic, converges fast by even steps.
    """
    with optional_import("SciPy", "regions need"):
        from scipy.special import dawsn, erf
    r = r[:, np.newaxis]
    a = np.sqrt(np.maximum(slopes, 0.0))
    is_round = a * r < _ROUND
    # D(a r) / a tends to r; where g vanishes a is infinite and ``between`` vanishes
    between = np.where(is_round, r, dawsn(a * r) / np.where(is_round, 1.0, a))
    bell = np.sqrt(2.0 / np.pi) * np.exp(-0.5 * r * r)
    # between (1 + 2 a^2) r as what is left of 1 + r between - D', D' = 1 - 2 a r D
    density = bell * r * between * (1.0 + 2.0 * slopes)
    return (erf(r / np.sqrt(2.0)) - bell * between).mean(axis=1), density.mean(axis=1)
