"""Rotation matrices on their way to rotation vectors and to roll, pitch and yaw, and checks of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import ArrayError
from ...runtime.arrays import numbers_in

Array = NDArray[np.float64]

ORTHOGONAL = 1e-6  # that a rotation's R R^T may be off the identity: some decimals of a text
_SMALL = 1e-4  # rad, below which series take the place of quotients
_NEARLY_HALF = -0.99  # cosine of an angle from which on the axis is read off the symmetric part


def vector_of(rotation: Array) -> Array:
    """Return the rotation vector, (3,), rad, of a rotation, (3, 3): its length is the angle, from 0 to pi."""
    a, b, c = rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]
    sine_axis = 0.5 * np.array([a, b, c])
    sine, cosine = float(np.linalg.norm(sine_axis)), 0.5 * (float(np.trace(rotation)) - 1.0)
    if cosine > _NEARLY_HALF:
        factor = np.arctan2(sine, cosine) / sine if sine > _SMALL else 1.0 + sine**2 / 6.0
        return np.asarray(factor * sine_axis)
    squares = 0.5 * (rotation + rotation.T) - cosine * np.eye(3)  # (1 - cosine) axis axis^T
    axis = squares[int(np.diagonal(squares).argmax())]
    axis = axis / np.linalg.norm(axis)
    return np.asarray(np.arctan2(sine, cosine) * (-axis if axis @ sine_axis < 0.0 else axis))


def rpy_of(rotation: Array) -> Array:
    """Return roll, pitch and yaw, (3,), rad, of a rotation Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 at pitch = +-pi/2."""
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], across)
    if across > 1e-9:
        return np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
    return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])


def rotation_matrices(label: str, value: ArrayLike, lead: Sequence[int] = ()) -> Array:
    """Return rotations, (*lead, 3, 3), rid of what decimals left out.

    Raises:
        ArrayError: another shape, or axes that are not orthogonal, of length 1 and right-handed.
    """
    allowed = f"rotations, finite numbers ({', '.join(map(str, (*lead, 3, 3)))})"
    matrices = numbers_in(label, value, allowed)
    if matrices.shape != (*lead, 3, 3):
        raise ArrayError(f"{label}: got shape {matrices.shape}; allowed: {allowed}")
    error = np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    wrong = np.argwhere((error > ORTHOGONAL) | (np.linalg.det(matrices) < 0.0))
    if len(wrong):
        place = str(wrong[0].tolist()) if lead else ""
        raise ArrayError(f"{label}{place}: is no rotation; allowed: orthogonal axes of length 1, right-handed")
    U, _, Vt = np.linalg.svd(matrices)
    return np.asarray(U @ Vt)
