"""Poses of bodies and joints as arrays, without the round-off of right angles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eomgen.robot.geometry import Matrix, Vector, snap
from eomgen.robot.value import Placement

Array = NDArray[np.float64]
_ROUND_OFF = 1e-15  # of a rotation's entries, after a few products of quaternions


@dataclass(frozen=True)
class Pose:
    """Origin (m) and axes (columns) of one frame in another."""

    rotation: Array
    xyz: Array

    def placement(self) -> Placement:
        """Return it as a Placement of a Robot."""
        return Placement(triple(self.xyz), matrix(self.rotation))


def tidy(rotation: Array) -> Array:
    """Return the rotation with round-off about -1, 0 and 1 removed, which prunes the equations."""
    nearest_integer = np.round(rotation)
    return np.where(np.abs(rotation - nearest_integer) < _ROUND_OFF, nearest_integer, rotation) + 0.0


def triple(values: Array) -> Vector:
    """Return three floats, without negative zeros."""
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z


def matrix(values: Array) -> Matrix:
    """Return nine floats as rows."""
    a, b, c = (triple(row) for row in values)
    return a, b, c


def rotation_from_quaternion(quat: Array) -> Array:
    """Return the rotation of a quaternion w, x, y, z that is not 0, (3, 3)."""
    w, x, y, z = quat / math.hypot(*quat)
    return tidy(
        np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )
    )


def about(axis: Array, angle: float) -> Array:
    """Return the rotation by an angle (rad) about a unit vector, (3, 3)."""
    c, s = snap(math.cos(angle)), snap(math.sin(angle))
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)
