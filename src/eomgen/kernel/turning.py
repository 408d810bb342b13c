"""Other angles of a rotation: those about axes that are one or two places on, where the described ones are singular.

A joint with 3-DOF rotation has the rotation Rx(alpha) Ry(beta) Rz(gamma) after its translations.  Seen from axes that
are so many places on, y, z and x (1) or z, x and y (2) in the place of x, y and z, the same rotation has other angles,
whose beta is far from +-90 degrees where the first one's is near.  Both have one angular velocity in the body's axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ON, BACK = 1, 2  # places that axes move on by, to the turned ones and from there
ROUND_OFF = float(np.finfo(np.float64).eps)
SINGULAR = 0.5  # of |cos beta|, below which other angles are taken

Places = Sequence[tuple[int, int]]  # of alpha and of x among the coordinates, -1 where x does not move: a joint each


def rotation(angles: Array) -> Array:
    """Return rotation matrices Rx(alpha) Ry(beta) Rz(gamma), (..., 3, 3), of angles (..., 3)."""
    sa, sb, sg = np.moveaxis(np.sin(angles), -1, 0)
    ca, cb, cg = np.moveaxis(np.cos(angles), -1, 0)
    rows = (
        (cb * cg, -cb * sg, sb),
        (ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb),
        (sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def other_angles(places: int, angles: Array, near: Array) -> Array:
    """Return angles of rotations seen from axes so many places on, (T, 3), each next to the one before.

    Args:
        near: the ones before the first, (3,).
    """
    both, chosen = both_ways(rotation(angles), places), np.empty_like(angles)
    for i, ways in enumerate(both):
        ways += 2.0 * np.pi * np.round((near - ways) / (2.0 * np.pi))
        near = chosen[i] = ways[np.abs(near - ways).sum(axis=1).argmin()]
    return chosen


def both_ways(R: Array, places: int) -> Array:
    """Return both solutions for the angles of rotations (T, 3, 3) seen from axes so many places on, (T, 2, 3)."""
    x, y, z = (R[:, (i + places) % 3] for i in range(3))
    alpha = np.arctan2(-y[:, 2], z[:, 2])
    s, c = np.sin(alpha), np.cos(alpha)
    beta = np.arctan2(x[:, 2], c * z[:, 2] - s * y[:, 2])
    gamma = np.arctan2(c * y[:, 0] + s * z[:, 0], c * y[:, 1] + s * z[:, 1])
    both = [[alpha, beta, gamma], [alpha + np.pi, np.pi - beta, gamma + np.pi]]
    return np.moveaxis(np.array(both), -1, 0)


def body_rates(angles: Array, rates: Array) -> Array:
    """Return the angular velocity in the body's axes, (..., 3), of angles and their rates."""
    a, b, g = np.moveaxis(rates, -1, 0)
    cb, sg, cg = np.cos(angles[..., 1]), np.sin(angles[..., 2]), np.cos(angles[..., 2])
    return np.stack([cb * cg * a + sg * b, cg * b - cb * sg * a, np.sin(angles[..., 1]) * a + g], axis=-1)


def angle_rates(angles: Array, spin: Array) -> Array:
    """Return rates of angles, (..., 3), of an angular velocity in the body's axes."""
    x, y, z = np.moveaxis(spin, -1, 0)
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    first = (c * x - s * y) / away_from_zero(np.cos(angles[..., 1]))
    return np.stack([first, s * x + c * y, z - np.sin(angles[..., 1]) * first], axis=-1)


def seen(states: Array, joints: Places, places: int, near: Array) -> Array:
    """Express states with the axes of joints so many places on; angles next to those of the state before.

    Args:
        states: q and v, (T, 2n).
        near: q before the first, (n,).
    """
    n, turned = near.size, np.array(states)
    for first, origin in joints:
        angles, rates = slice(first, first + 3), slice(n + first, n + first + 3)
        turned[:, angles] = other_angles(places, states[:, angles], near[angles])
        turned[:, rates] = angle_rates(turned[:, angles], body_rates(states[:, angles], states[:, rates]))
        for begin in () if origin < 0 else (origin, n + origin):
            turned[:, begin : begin + 3] = np.roll(states[:, begin : begin + 3], -places, axis=-1)
    return turned


def singular_joints(q: Array, joints: Mapping[str, tuple[int, int]]) -> frozenset[str]:
    """Return names of the joints whose angles are nearly singular in a state, (n,)."""
    return frozenset(name for name, (first, _) in joints.items() if abs(np.cos(q[first + 1])) < SINGULAR)


def away_from_zero(x: Array) -> Array:
    """Return divisors: numbers of the size of round-off are replaced by round-off."""
    return np.where(np.abs(x) < ROUND_OFF, ROUND_OFF, x)
