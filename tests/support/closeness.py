"""How near numbers are."""

from __future__ import annotations

import numpy as np

from tests.support.random_robots import Array


def close(found: Array, expected: Array, tolerance: float = 1e-11) -> bool:
    """Whether no number differs by more than the tolerance, relative to the largest expected one or to 1."""
    return bool(np.max(np.abs(found - expected)) <= tolerance * max(1.0, float(np.max(np.abs(expected)))))


def distance(found: Array, expected: Array) -> float:
    """Return the largest difference, relative to the largest expected number."""
    return float(np.max(np.abs(found - expected)) / max(float(np.max(np.abs(expected))), 1e-300))
