"""Derivatives of a frame's pose and Jacobian by the coordinates, from these two alone; on NumPy's arrays or JAX's."""

from __future__ import annotations

from typing import Any

import numpy as np


def pose_derivative(A: Any, J: Any, xp: Any = np) -> Any:
    """Return dA/dq of a frame, (..., 4, 4, n), from its pose (..., 4, 4) and Jacobian (..., 6, n); xp: as NumPy."""
    turns = xp.swapaxes(J[..., 3:, :], -1, -2)  # (..., n, 3)
    columns = xp.swapaxes(A[..., :3, :3], -1, -2)  # (..., 3 columns, 3)
    by_turn = xp.cross(turns[..., None, :, :], columns[..., :, None, :])  # (..., column, n, 3)
    moved = xp.concatenate([by_turn, xp.swapaxes(J[..., :3, :], -1, -2)[..., None, :, :]], axis=-3)
    rows = xp.moveaxis(moved, -1, -3)  # (..., 3, 4, n)
    return xp.concatenate([rows, xp.zeros_like(rows[..., :1, :, :])], axis=-3)


def jacobian_derivative(J: Any, xp: Any = np) -> Any:
    """Return dJ/dq of a frame, (..., 6, n, n), the last axis by q, from J (..., 6, n) alone.

    A coordinate turns and moves the axes of those behind it, and coordinates are in the order of the chain.
    """
    n = J.shape[-1]
    column, by = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    near, far = np.minimum(column, by), np.maximum(column, by)
    moves, turns = (xp.swapaxes(J[..., rows, :], -1, -2) for rows in (slice(0, 3), slice(3, 6)))
    linear = xp.cross(turns[..., near, :], moves[..., far, :])
    angular = xp.cross(turns[..., by, :], turns[..., column, :]) * (by < column)[..., None]
    return xp.moveaxis(xp.concatenate([linear, angular], axis=-1), -1, -3)
