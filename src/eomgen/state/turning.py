"""Rotations of joints as quaternions, and forces and states in other angles than those of the description."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..runtime.turning import BACK, ON, away_from_zero, seen, singular_joints

Array = NDArray[np.float64]


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


def other_forces(angles: Array, other: Array, forces: Array) -> Array:
    """Forces on the other angles of the same rotations, of the same power, (..., 3); arguments as of the rates."""
    a, b, g = np.moveaxis(forces, -1, 0)
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    across = (a - np.sin(angles[..., 1]) * g) / away_from_zero(np.cos(angles[..., 1]))
    x, y = c * across + s * b, c * b - s * across
    sg, cg = np.sin(other[..., 2]), np.cos(other[..., 2])
    first = np.cos(other[..., 1]) * (cg * x - sg * y) + np.sin(other[..., 1]) * g
    return np.stack([first, sg * x + cg * y, g], axis=-1)


def extrapolated(coarse: Array, fine: Array, joints: Mapping[str, tuple[int, int]]) -> Array:
    """2 fine - coarse of one state by two ways, q and v, (2n,) each, in angles that are not singular there."""
    near = fine[: fine.size // 2]
    turned = [joints[name] for name in singular_joints(near, joints)]
    if not turned:
        return np.asarray(2.0 * fine - coarse)
    ends = seen(np.stack([fine, coarse]), turned, ON, np.zeros_like(near))
    return np.asarray(seen((2.0 * ends[0] - ends[1])[np.newaxis], turned, BACK, near)[0])
