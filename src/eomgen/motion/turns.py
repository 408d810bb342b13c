"""Rotations about rotation vectors, and motions of a frame's axes from one orientation to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..kernel.inverse_kinematics.rotations import vector_of
from .point_to_point import QUINTIC
from .splines import Spline

_SMALL = 1e-4  # rad, below which series take the place of quotients


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


def spherical(first: Array, last: Array, parts: Array) -> Array:
    """Return rotations, (P, 3, 3), at parts (P,) of the least rotation from one to another.

    It is about one axis, at a constant rate.
    """
    return np.asarray(first @ rotation_of(parts[:, np.newaxis] * vector_of(first.T @ last)))


def spherical_spline(knots: Array, rotations: Array, t: Array, smooth: int = QUINTIC) -> Array:
    """Return rotations, (T, 3, 3), at times t through those at the knots; at rest at both ends.

    R(t) = R_0 exp(w_1(t) f_1) exp(w_2(t) f_2) ..., f_i the rotation vector from R_(i-1) to R_i, and w_i the spline that
    is 0 at the knots before i and 1 at i and after it: the cumulative form of Kim, Kim and Shin (SIGGRAPH 1995) with
    splines that interpolate.  So angular velocity and acceleration are continuous, about one axis angles are the
    spline of the angles, and two rotations are a spherical interpolation.

    Args:
        knots: times, (K,), s, rising.
        rotations: (K, 3, 3).
        t: (T,), s.
        smooth: of the splines, see ``Spline``.

    Raises:
        InputError: SciPy is not installed.
    """
    steps = np.tril(np.ones((knots.size, knots.size)))[:, 1:]
    weights = Spline(knots, steps, at_rest=True, smooth=smooth).at(t)[0]
    rotation = np.broadcast_to(rotations[0], (t.size, 3, 3))
    for i in range(1, knots.size):
        rotation = rotation @ rotation_of(weights[:, i - 1, np.newaxis] * vector_of(rotations[i - 1].T @ rotations[i]))
    return rotation
