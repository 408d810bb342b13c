"""Regions that hold a vector with a probability: radii of spheres of normal vectors whose variances are unequal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...optional import optional_import

Array = NDArray[np.float64]

_NODES = 24  # of Gauss and Legendre's rule in each of two directions
_FAR = 6.0  # standard deviations beyond which nothing is left
_HALVINGS = 40
_CHUNK = 1000  # poses at once


def radii(covariance: Array, probability: float) -> Array:
    """Radius of the sphere that holds a normal vector of mean 0 with that probability, (N,), of (N, 3, 3).

    It is the quantile of the root of l1 z1^2 + l2 z2^2 + l3 z3^2 where l are the eigenvalues and z normal.
    """
    variances = np.maximum(np.linalg.eigvalsh(covariance), 0.0)[:, ::-1]
    found = np.zeros(len(variances))
    there = np.flatnonzero(variances[:, 0] > 0.0)
    for first in range(0, len(there), _CHUNK):
        part = there[first : first + _CHUNK]
        largest = variances[part, 0]
        found[part] = np.sqrt(largest) * _quantiles(variances[part, 1:] / largest[:, np.newaxis], probability)
    return found


def quantile_of_normal(probability: float) -> float:
    """Standard deviations in half an interval that holds a normal number with that probability."""
    with optional_import("SciPy", "regions need"):
        from scipy.special import ndtri
    return float(ndtri(0.5 + 0.5 * probability))


def worst_deviations(covariance: Array) -> Array:
    """Standard deviation along the direction in which it is greatest, (N,), of (N, 3, 3)."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))


def _quantiles(ratios: Array, probability: float) -> Array:
    """Quantiles of the root where the greatest variance is 1 and the others are ``ratios``, (N, 2)."""
    with optional_import("SciPy", "regions need"):
        from scipy.special import chdtri
    low = np.full(len(ratios), np.sqrt(chdtri(1.0, 1.0 - probability)))
    high = np.full(len(ratios), np.sqrt(chdtri(3.0, 1.0 - probability)))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = _probabilities(middle, ratios) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
        if (high - low).max() < 1e-9:
            break
    return np.asarray(0.5 * (low + high))


def _probabilities(r: Array, ratios: Array) -> Array:
    """Probability that the root is below r, (N,): the mean over z2 and z3 of that of z1, which is an error function.

    z = a sin(angle) makes the integrand smooth at the edge a of the ellipse.
    """
    with optional_import("SciPy", "regions need"):
        from scipy.special import erf
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    total = np.zeros(len(r))
    w2, rest = _along(r, ratios[:, 0], nodes, weights)
    for k in range(_NODES):
        w3, left = _along(rest[:, k], ratios[:, 1], nodes, weights)
        inner = (w3 * erf(left / np.sqrt(2.0))).sum(axis=1)
        total += w2[:, k] * inner
    return total


def _along(r: Array, ratio: Array, nodes: Array, weights: Array) -> tuple[Array, Array]:
    """Weights of places of a normal number, (N, nodes), and what of the radius is left behind each."""
    edge = r / np.sqrt(np.maximum(ratio, 1e-300))
    angle = np.arcsin(np.minimum(1.0, _FAR / np.maximum(edge, 1e-300)))[:, np.newaxis]
    turned = angle * nodes
    edge = edge[:, np.newaxis]
    z = edge * np.sin(turned)
    weight = weights * angle * edge * np.cos(turned) * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    return weight, r[:, np.newaxis] * np.cos(turned)
