"""Rotations of joints as quaternions; kernels, states and forces in angles that are not singular."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..arrays import Array, Index, Mask
from ..kernel.complete import Kernel
from ..kernel.turning import (
    BACK,
    ON,
    SINGULAR,
    away_from_zero,
    both_ways,
    seen,
)
from ..names import component_name
from ..robot.coordinates import QUATERNION, index_of, rotating_joints
from ..robot.value import ANGULAR


def quaternions(angles: Array) -> Array:
    """Convert angles (T, 3) of Rx(alpha) Ry(beta) Rz(gamma) to quaternions (w, x, y, z), (T, 4); w >= 0 at first.

    Of both signs that mean one rotation each has the one that is nearer to the quaternion before it.
    """
    (sa, sb, sg), (ca, cb, cg) = np.sin(0.5 * angles).T, np.cos(0.5 * angles).T
    unit = np.stack(
        [
            ca * cb * cg - sa * sb * sg,
            sa * cb * cg + ca * sb * sg,
            ca * sb * cg - sa * cb * sg,
            ca * cb * sg + sa * sb * cg,
        ],
        axis=-1,
    )
    turns = np.einsum("ti,ti->t", unit[1:], unit[:-1]) < 0.0
    signs = np.cumprod(np.concatenate([[-1.0 if len(unit) and unit[0, 0] < 0.0 else 1.0], np.where(turns, -1.0, 1.0)]))
    return np.asarray(unit * signs[: len(unit), np.newaxis])


def joint_quaternions(coordinates: Sequence[str], q: Array) -> dict[str, Array]:
    """Return quaternions (w, x, y, z) over time, (T, 4), by joint, of those that have alpha, beta and gamma.

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
    """Return the components of ``joint_quaternions`` over time, (T,), by name: joint.qw, .qx, .qy, .qz."""
    by_joint = joint_quaternions(coordinates, q)
    return {
        component_name(joint, name): column
        for joint, values in by_joint.items()
        for name, column in zip(QUATERNION, values.T, strict=True)
    }


def nearest_angles(quaternion: Array, near: Array) -> Array:
    """Return the angles of rotations, (T, 3), nearest to those of ``near``.

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
    ways = both_ways(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2), 0)
    ways += 2.0 * np.pi * np.round((near[:, np.newaxis] - ways) / (2.0 * np.pi))
    chosen = np.abs(near[:, np.newaxis] - ways).sum(axis=2).argmin(axis=1)
    return np.asarray(ways[np.arange(len(ways)), chosen])


def angle_accelerations(angles: Array, rates: Array, slope: Array) -> Array:
    """Return accelerations of angles, (..., 3), from ``slope``, the derivative of the angular velocity in body axes."""
    (a, b, g), (x, y, z) = np.moveaxis(rates, -1, 0), np.moveaxis(slope, -1, 0)
    sb, cb = np.sin(angles[..., 1]), np.cos(angles[..., 1])
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    first = (c * x - s * y - g * b + a * b * sb) / away_from_zero(cb)
    return np.stack([first, s * x + c * y + g * a * cb, z - sb * first - cb * a * b], axis=-1)


def other_forces(angles: Array, other: Array, forces: Array) -> Array:
    """Return forces of the same power on the other angles of the rotations, (..., 3); arguments as of rates."""
    a, b, g = np.moveaxis(forces, -1, 0)
    s, c = np.sin(angles[..., 2]), np.cos(angles[..., 2])
    across = (a - np.sin(angles[..., 1]) * g) / away_from_zero(np.cos(angles[..., 1]))
    x, y = c * across + s * b, c * b - s * across
    sg, cg = np.sin(other[..., 2]), np.cos(other[..., 2])
    first = np.cos(other[..., 1]) * (cg * x - sg * y) + np.sin(other[..., 1]) * g
    return np.stack([first, sg * x + cg * y, g], axis=-1)


class Turns:
    """A kernel in angles that are not singular, and states and forces in these and in those of the description.

    Attributes:
        kernel: as described.
        joints: places of alpha and of x of those that may be turned, as of ``RawKernel.turning``.
        turned: names of those that are turned.
        here: the kernel of these.
    """

    def __init__(self, kernel: Kernel, held: Mask | None = None) -> None:
        """Begin with the kernel as described.

        Args:
            kernel: whose joints are turned.
            held: coordinates, (n,), whose joints stay as described; None: none of them.
        """
        self.kernel = self.here = kernel
        self.joints = {
            name: (first, origin)
            for name, (first, origin) in kernel.raw.turning.items()
            if held is None or not held[first if origin < 0 else origin : first + 3].any()
        }
        self.turned = frozenset[str]()
        self._kernels = {self.turned: kernel}

    @property
    def places(self) -> list[tuple[int, int]]:
        """Places of alpha and of x of the joints that are turned."""
        return [self.joints[name] for name in self.joints if name in self.turned]

    def take(self, turned: frozenset[str]) -> None:
        """Let these joints be turned from now on."""
        self.turned = turned
        if turned not in self._kernels:
            self._kernels[turned] = self.kernel.replaced()
            self._kernels[turned].parameters.turn(turned)
        self.here = self._kernels[turned]

    def on(self, states: Array) -> Array:
        """Convert described q and v, (T, 2n), behind which more may stand, to the coordinates of ``here``."""
        return seen(states, self.places, ON, np.zeros(self.kernel.n)) if self.turned else states

    def back(self, states: Array, near: Array) -> Array:
        """Convert q and v, (T, 2n), from the coordinates of ``here``; near: described q before the first, (n,)."""
        return seen(states, self.places, BACK, near) if self.turned else states

    def q_on(self, q: Array) -> Array:
        """Convert described q, (n,) or (T, n), to the coordinates of ``here``."""
        return self._alone(q, None)

    def q_back(self, q: Array, near: Array) -> Array:
        """Convert q, (n,) or (T, n), from the coordinates of ``here`` to described ones; near as of ``back``."""
        return self._alone(q, near)

    def _alone(self, q: Array, near: Array | None) -> Array:
        states = np.hstack([np.atleast_2d(q), np.zeros_like(np.atleast_2d(q))])
        turned = self.on(states) if near is None else self.back(states, near)
        return np.ascontiguousarray(turned[:, : self.kernel.n]).reshape(q.shape)

    def forces(self, u: Array, told: Array, q: Array) -> Array:
        """Convert forces to those of the same power on the coordinates of ``here``, (n,) or (T, n).

        Args:
            u: on the described ones.
            told, q: described q, and in the coordinates of ``here``, of the same shape.
        """
        forces = np.array(u)
        for first, origin in self.places:
            angles, along = slice(first, first + 3), slice(origin, origin + 3)
            forces[..., angles] = other_forces(told[..., angles], q[..., angles], u[..., angles])
            if origin >= 0:
                forces[..., along] = np.roll(u[..., along], -ON, axis=-1)
        return forces

    def regular(self, q: Array) -> Iterator[Index]:
        """Yield rows of described states, (T, n), with the same singular angles, which ``here`` then has turned."""
        names, betas = list(self.joints), [first + 1 for first, _ in self.joints.values()]
        if not names:
            yield np.arange(len(q))
            return
        ways, which = np.unique(np.abs(np.cos(q[:, betas])) < SINGULAR, axis=0, return_inverse=True)
        for number, way in enumerate(ways):
            self.take(frozenset(name for name, is_turned in zip(names, way, strict=True) if is_turned))
            yield np.flatnonzero(which.ravel() == number)
