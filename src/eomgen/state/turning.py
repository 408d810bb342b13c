"""Other angles of a rotation: those about axes that are one or two places on, where a joint's own are singular.

A joint that turns freely has the rotation Rx(alpha) Ry(beta) Rz(gamma) after its translations.  Seen from axes that
are so many places on, y, z and x (1) or z, x and y (2) in the place of x, y and z, the same rotation has other angles,
whose beta is far from +-90 degrees where the first one's is near.  Both have one angular velocity in the body's axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..names import component_name
from ..robot.coordinates import QUATERNION, index_of, rotating_joints
from ..robot.value import ANGULAR

Array = NDArray[np.float64]

ON, BACK = 1, 2  # places that axes move on by, to the turned ones and from there
ROUND_OFF = float(np.finfo(np.float64).eps)
SINGULAR = 0.5  # of |cos beta|, below which other angles are taken

Places = Iterable[tuple[int, int]]  # of alpha and of x among the coordinates, -1 where x does not move: a joint each


def rotation(angles: Array) -> Array:
    """Rx(alpha) Ry(beta) Rz(gamma), (..., 3, 3), of angles (..., 3)."""
    sa, sb, sg = np.moveaxis(np.sin(angles), -1, 0)
    ca, cb, cg = np.moveaxis(np.cos(angles), -1, 0)
    rows = (
        (cb * cg, -cb * sg, sb),
        (ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb),
        (sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions(angles: Array) -> Array:
    """Unit quaternions (w, x, y, z) of Rx(alpha) Ry(beta) Rz(gamma), (T, 4), of angles (T, 3); w is >= 0 at first.

    Of both signs that mean one rotation each has the one that is nearer to the quaternion before it.
    """
    (sa, sb, sg), (ca, cb, cg) = np.sin(0.5 * angles).T, np.cos(0.5 * angles).T
    found = np.stack(
        [
            ca * cb * cg - sa * sb * sg,
            sa * cb * cg + ca * sb * sg,
            ca * sb * cg - sa * cb * sg,
            ca * cb * sg + sa * sb * cg,
        ],
        axis=-1,
    )
    turns = np.einsum("ti,ti->t", found[1:], found[:-1]) < 0.0
    signs = np.cumprod(
        np.concatenate([[-1.0 if len(found) and found[0, 0] < 0.0 else 1.0], np.where(turns, -1.0, 1.0)])
    )
    return np.asarray(found * signs[: len(found), np.newaxis])


def joint_quaternions(coordinates: Sequence[str], q: Array) -> dict[str, Array]:
    """Quaternions (w, x, y, z) over time, (T, 4), by the names of the joints that have alpha, beta and gamma.

    Each follows on the one before it without a jump of sign, as ``quaternions`` says.

    Args:
        coordinates: names, n of them.
        q: (T, n).
    """
    return {
        joint: quaternions(q[:, index_of(coordinates, [component_name(joint, angle) for angle in ANGULAR])])
        for joint in rotating_joints(coordinates)
    }


def quaternion_columns(coordinates: Sequence[str], q: Array) -> dict[str, Array]:
    """The components of ``joint_quaternions`` over time, (T,), by name: joint.qw, joint.qx, joint.qy, joint.qz."""
    found = joint_quaternions(coordinates, q)
    return {
        component_name(joint, name): column
        for joint, values in found.items()
        for name, column in zip(QUATERNION, values.T, strict=True)
    }


def other_angles(places: int, angles: Array, near: Array) -> Array:
    """The angles of the same rotations seen from axes so many places on, (T, 3), each next to the ones before it.

    Args:
        places: 1 or 2.
        angles: (T, 3).
        near: the ones before the first, (3,).
    """
    both, found = _both_ways(rotation(angles), places), np.empty_like(angles)
    for i, ways in enumerate(both):
        ways += 2.0 * np.pi * np.round((near - ways) / (2.0 * np.pi))
        near = found[i] = ways[np.abs(near - ways).sum(axis=1).argmin()]
    return found


def nearest_angles(quaternion: Array, near: Array) -> Array:
    """Angles of rotations, (T, 3), each next to the given ones.

    Args:
        quaternion: (w, x, y, z), (T, 4), of any length but 0.
        near: (T, 3).
    """
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    ways = _both_ways(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2), 0)
    ways += 2.0 * np.pi * np.round((near[:, np.newaxis] - ways) / (2.0 * np.pi))
    chosen = np.abs(near[:, np.newaxis] - ways).sum(axis=2).argmin(axis=1)
    return np.asarray(ways[np.arange(len(ways)), chosen])


def _both_ways(R: Array, places: int) -> Array:
    """Both triples of angles of rotations (T, 3, 3) seen from axes so many places on, (T, 2, 3)."""
    x, y, z = (R[:, (i + places) % 3] for i in range(3))
    alpha = np.arctan2(-y[:, 2], z[:, 2])
    s, c = np.sin(alpha), np.cos(alpha)
    beta = np.arctan2(x[:, 2], c * z[:, 2] - s * y[:, 2])
    gamma = np.arctan2(c * y[:, 0] + s * z[:, 0], c * y[:, 1] + s * z[:, 1])
    both = [[alpha, beta, gamma], [alpha + np.pi, np.pi - beta, gamma + np.pi]]
    return np.moveaxis(np.array(both), -1, 0)


def body_rates(angles: Array, rates: Array) -> Array:
    """Angular velocity in the body's axes, (..., 3), of angles and their rates."""
    a, b, g = np.moveaxis(rates, -1, 0)
    cb, sg, cg = np.cos(angles[..., 1]), np.sin(angles[..., 2]), np.cos(angles[..., 2])
    return np.stack([cb * cg * a + sg * b, cg * b - cb * sg * a, np.sin(angles[..., 1]) * a + g], axis=-1)


def angle_rates(angles: Array, spin: Array) -> Array:
    """Rates of angles, (..., 3), of an angular velocity in the body's axes."""
    x, y, z = np.moveaxis(spin, -1, 0)
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    first = (c * x - s * y) / _away_from_zero(np.cos(angles[..., 1]))
    return np.stack([first, s * x + c * y, z - np.sin(angles[..., 1]) * first], axis=-1)


def angle_accelerations(angles: Array, rates: Array, slope: Array) -> Array:
    """Accelerations of angles, (..., 3), where an angular velocity in the body's axes changes by ``slope``."""
    (a, b, g), (x, y, z) = np.moveaxis(rates, -1, 0), np.moveaxis(slope, -1, 0)
    sb, cb = np.sin(angles[..., 1]), np.cos(angles[..., 1])
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    first = (c * x - s * y - g * b + a * b * sb) / _away_from_zero(cb)
    return np.stack([first, s * x + c * y + g * a * cb, z - sb * first - cb * a * b], axis=-1)


def other_rates(angles: Array, other: Array, rates: Array) -> Array:
    """Rates of the other angles of the same rotations, (..., 3).

    Args:
        angles, other: of the same rotations, (..., 3).
        rates: of ``angles``, (..., 3).
    """
    return angle_rates(other, body_rates(angles, rates))


def other_forces(angles: Array, other: Array, forces: Array) -> Array:
    """Forces on the other angles of the same rotations, of the same power, (..., 3); arguments as of the rates."""
    a, b, g = np.moveaxis(forces, -1, 0)
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    across = (a - np.sin(angles[..., 1]) * g) / _away_from_zero(np.cos(angles[..., 1]))
    x, y = c * across + s * b, c * b - s * across
    sg, cg = np.sin(other[..., 2]), np.cos(other[..., 2])
    first = np.cos(other[..., 1]) * (cg * x - sg * y) + np.sin(other[..., 1]) * g
    return np.stack([first, sg * x + cg * y, g], axis=-1)


def seen(states: Array, joints: Places, places: int, near: Array) -> Array:
    """States with the axes of joints so many places on; angles next to those of the state before.

    Args:
        states: q and v, (T, 2n).
        joints: which.
        places: ON or BACK.
        near: q before the first, (n,).
    """
    n, found = near.size, np.array(states)
    for first, origin in joints:
        angles, rates = slice(first, first + 3), slice(n + first, n + first + 3)
        found[:, angles] = other_angles(places, states[:, angles], near[angles])
        found[:, rates] = other_rates(states[:, angles], found[:, angles], states[:, rates])
        for begin in () if origin < 0 else (origin, n + origin):
            found[:, begin : begin + 3] = np.roll(states[:, begin : begin + 3], -places, axis=-1)
    return found


def singular_joints(q: Array, joints: Mapping[str, tuple[int, int]]) -> frozenset[str]:
    """Names of the joints whose angles are nearly singular in a state, (n,)."""
    return frozenset(name for name, (first, _) in joints.items() if abs(np.cos(q[first + 1])) < SINGULAR)


def extrapolated(coarse: Array, fine: Array, joints: Mapping[str, tuple[int, int]]) -> Array:
    """2 fine - coarse of one state by two ways, q and v, (2n,) each, in angles that are not singular there."""
    near = fine[: fine.size // 2]
    turned = [joints[name] for name in singular_joints(near, joints)]
    if not turned:
        return np.asarray(2.0 * fine - coarse)
    ends = seen(np.stack([fine, coarse]), turned, ON, np.zeros_like(near))
    return np.asarray(seen((2.0 * ends[0] - ends[1])[np.newaxis], turned, BACK, near)[0])


def _away_from_zero(x: Array) -> Array:
    return np.where(np.abs(x) < ROUND_OFF, ROUND_OFF, x)
