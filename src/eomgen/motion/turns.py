"""Rotations as rotation vectors, and motions of a frame's axes from one orientation to the next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError
from ..names import show
from ..state.vectors import as_floats
from .splines import Spline

TURNS = 1e-6  # that a rotation's R R^T may be off the identity: some decimals of a text
_SMALL = 1e-4  # rad, below which series take the place of quotients
_NEARLY_HALF = -0.99  # cosine of an angle from which on the axis is read off the symmetric matrix


def rotation_of(vectors: ArrayLike) -> Array:
    """Return rotations, (..., 3, 3), about rotation vectors, (..., 3), rad: Rodrigues' formula."""
    vectors = np.asarray(vectors, dtype=np.float64)
    angle = np.linalg.norm(vectors, axis=-1)[..., np.newaxis, np.newaxis]
    safe = np.where(angle > _SMALL, angle, 1.0)
    by_sine = np.where(angle > _SMALL, np.sin(safe) / safe, 1.0 - angle**2 / 6.0)
    by_cosine = np.where(angle > _SMALL, (1.0 - np.cos(safe)) / safe**2, 0.5 - angle**2 / 24.0)
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape[:-1], 3, 3)
    return np.asarray(np.eye(3) + by_sine * skew + by_cosine * (skew @ skew))


def vector_of(rotation: Array) -> Array:
    """Return the rotation vector, (3,), rad, of one rotation, (3, 3): its length is the angle, from 0 to pi."""
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
    """Return roll, pitch and yaw, (3,), rad, of a rotation Rz(yaw) Ry(pitch) Rx(roll).

    Yaw is 0 where pitch is +-pi/2.
    """
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], across)
    if across > 1e-9:
        return np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
    return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])


def spherical(first: Array, last: Array, parts: Array) -> Array:
    """Return rotations, (P, 3, 3), at parts (P,) of the least turn from one to another.

    About one axis, at an even rate.
    """
    return np.asarray(first @ rotation_of(parts[:, np.newaxis] * vector_of(first.T @ last)))


def spherical_spline(knots: Array, rotations: Array, t: Array) -> Array:
    """Return rotations, (T, 3, 3), at times t through those at the knots; at rest at both ends.

    R(t) = R_0 exp(w_1(t) f_1) exp(w_2(t) f_2) ..., f_i the rotation vector from R_(i-1) to R_i, and w_i the spline that
    is 0 at the knots before i and 1 at i and after it: the cumulative form of Kim, Kim and Shin (SIGGRAPH 1995) with
    splines that interpolate.  So angular velocity and acceleration are continuous, about one axis angles are the
    spline of the angles, and two rotations are a spherical interpolation.

    Args:
        knots: times, (K,), s, rising.
        rotations: (K, 3, 3).
        t: (T,), s.

    Raises:
        InputError: SciPy is not installed.
    """
    steps = np.tril(np.ones((knots.size, knots.size)))[:, 1:]
    weights = Spline(knots, steps, at_rest=True).at(t)[0]
    rotation = np.broadcast_to(rotations[0], (t.size, 3, 3))
    for i in range(1, knots.size):
        rotation = rotation @ rotation_of(weights[:, i - 1, np.newaxis] * vector_of(rotations[i - 1].T @ rotations[i]))
    return rotation


def rotation_matrices(label: str, value: ArrayLike, lead: Sequence[int] = ()) -> Array:
    """Return rotations, (*lead, 3, 3), rid of what decimals left out.

    Raises:
        ArrayError: another shape, or axes that are not orthogonal, of length 1 and right-handed.
    """
    matrices = as_floats(value)
    if matrices.shape != (*lead, 3, 3) or not np.isfinite(matrices).all():
        wanted = ", ".join(map(str, (*lead, 3, 3)))
        raise ArrayError(f"{label}: got {show(type(value).__name__)}; allowed: rotations, finite numbers ({wanted})")
    off = np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    wrong = np.argwhere((off > TURNS) | (np.linalg.det(matrices) < 0.0))
    if len(wrong):
        place = str(wrong[0].tolist()) if lead else ""
        raise ArrayError(f"{label}{place}: is no rotation; allowed: orthogonal axes of length 1, right-handed")
    U, _, Vt = np.linalg.svd(matrices)
    return np.asarray(U @ Vt)
