"""Rotations of many poses at once: from what files hold of them, their rotation vectors, their mean."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...kernel.inverse_kinematics.rotations import vector_of
from ...motion.turns import rotation_of

_SMALL = 1e-7  # sine of an angle below which it is the angle
_SERIES = 1e-4  # sine of an angle below which a series takes the place of a quotient
_NEARLY_HALF = -0.99  # cosine from which on the axis is read off the symmetric matrix


def about_axis(axis: int, angle: Array) -> Array:
    """Return rotations about x, y or z (0, 1, 2) by angles (...), rad: (..., 3, 3)."""
    turned = np.zeros((*angle.shape, 3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angle), np.sin(angle)
    turned[..., axis, axis] = 1.0
    turned[..., first, first] = turned[..., second, second] = cosine
    turned[..., first, second], turned[..., second, first] = -sine, sine
    return turned


def from_rpy(angles: Array) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), (N, 3, 3), of roll, pitch and yaw, (N, 3), rad."""
    roll, pitch, yaw = angles.T
    return np.asarray(about_axis(2, yaw) @ about_axis(1, pitch) @ about_axis(0, roll))


def from_quaternions(values: Array) -> Array:
    """Return rotations, (N, 3, 3), of quaternions w, x, y, z, (N, 4), of any length but 0."""
    unit = values / np.linalg.norm(values, axis=1, keepdims=True)
    unit = np.where(unit[:, :1] < 0.0, -unit, unit)
    sine = np.linalg.norm(unit[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, unit[:, :1])
    return rotation_of(np.where(sine > _SMALL, angle / np.maximum(sine, _SMALL), 2.0) * unit[:, 1:])


def vectors_of(rotations: Array) -> Array:
    """Return the rotation vectors, (..., 3), rad, of rotations, (..., 3, 3); lengths from 0 to pi."""
    flat = rotations.reshape(-1, 3, 3)
    skew = [flat[:, 2, 1] - flat[:, 1, 2], flat[:, 0, 2] - flat[:, 2, 0], flat[:, 1, 0] - flat[:, 0, 1]]
    axis = 0.5 * np.stack(skew, axis=1)
    sine, cosine = np.linalg.norm(axis, axis=1), 0.5 * (np.trace(flat, axis1=1, axis2=2) - 1.0)
    small = sine <= _SERIES
    factor = np.where(small, 1.0 + sine**2 / 6.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))
    vectors = factor[:, np.newaxis] * axis
    for i in np.flatnonzero(cosine <= _NEARLY_HALF).tolist():
        vectors[i] = vector_of(flat[i])
    return np.asarray(vectors.reshape(rotations.shape[:-1]))


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation, (3, 3), nearest to a matrix by the sum of squares."""
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def coordinates_of(pose: Array) -> Array:
    """Return x, y, z (m) and alpha, beta, gamma (rad), (6,), of a pose T(x, y, z) Rx Ry Rz, (4, 4)."""
    R = pose[:3, :3]
    beta = np.arctan2(R[0, 2], np.hypot(R[0, 0], R[0, 1]))
    if np.hypot(R[0, 0], R[0, 1]) > 1e-9:
        alpha, gamma = np.arctan2(-R[1, 2], R[2, 2]), np.arctan2(-R[0, 1], R[0, 0])
    else:
        alpha, gamma = np.arctan2(R[2, 1], R[1, 1]), 0.0
    return np.array([*pose[:3, 3], alpha, beta, gamma])


def pose_from(values: Array) -> Array:
    """Return T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma), (4, 4), of its six coordinates, (6,), m and rad: eq. (3)."""
    angles = np.asarray(values[3:], dtype=np.float64)
    return pose_of(about_axis(0, angles[0]) @ about_axis(1, angles[1]) @ about_axis(2, angles[2]), values[:3])


def pose_of(rotation: ArrayLike, position: ArrayLike = 0.0) -> Array:
    """Return the pose, (4, 4), of a rotation, (3, 3), and a position, (3,), m."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def _sequences() -> Iterator[tuple[str, Callable[[Array], Array]]]:
    """Yield readings of three angles about axes, one after the other: turned with the frame (intrinsic), or fixed."""
    for axes in product(range(3), repeat=3):
        if axes[1] in (axes[0], axes[2]):
            continue
        name = ", ".join("xyz"[i] for i in axes)
        yield (
            "rpy, yaw first" if name == "z, y, x" else f"intrinsic {name}",
            partial(_about_axes, axes=axes, order=(0, 1, 2)),
        )
        if name != "x, y, z":  # that is rpy
            yield f"fixed {name}", partial(_about_axes, axes=axes, order=(2, 1, 0))


def _about_axes(angles: Array, axes: Sequence[int], order: Sequence[int]) -> Array:
    first, second, third = (about_axis(axes[i], angles[:, i]) for i in order)
    return np.asarray(first @ second @ third)


READINGS: Mapping[str, Callable[[Array], Array]] = {  # of three numbers, by what they might be
    "rotvector": rotation_of,
    "rpy": from_rpy,
    **dict(_sequences()),
}
FOUR: Mapping[str, Callable[[Array], Array]] = {  # of four
    "quaternion": from_quaternions,
    "quaternion with w last": lambda values: from_quaternions(values[:, [3, 0, 1, 2]]),
}
