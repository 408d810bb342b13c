"""Frames on two links that a loop joint or a bushing joins: coordinates of the one as seen from the other.

They are T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma), eq. (3), less the offset of a loop joint: what its forces act on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...kernel.complete import Kernel
from ...robot.elements import Bushing
from ...robot.value import Placement, Robot


@dataclass(frozen=True)
class FramePair:
    """Two links, the frame on each, and constants that are taken off the six coordinates, m and rad."""

    links: tuple[str, str]
    placements: tuple[Placement, Placement]
    offset: tuple[float, ...] = (0.0,) * 6

    def deviations(self, kernel: Kernel, q: Array) -> tuple[Array, Array]:
        """Return the six coordinates in states q, (T, n): (T, 6), and their derivatives by q, (T, 6, n)."""
        (R_a, p_a, J_a), (R_b, p_b, J_b) = (
            _frame(kernel, q, *end) for end in zip(self.links, self.placements, strict=True)
        )
        back, arm = R_a.swapaxes(1, 2), p_b - p_a
        R = back @ R_b
        angles = np.stack(
            [
                np.arctan2(-R[:, 1, 2], R[:, 2, 2]),
                np.arctan2(R[:, 0, 2], np.hypot(R[:, 0, 0], R[:, 0, 1])),
                np.arctan2(-R[:, 0, 1], R[:, 0, 0]),
            ],
            axis=1,
        )
        s = np.concatenate([np.einsum("tij,tj->ti", back, arm), angles], axis=1) - self.offset
        moved = J_b[:, :3] - J_a[:, :3] - np.cross(J_a[:, 3:], arm[:, :, np.newaxis], axis=1)
        turned = np.linalg.solve(_turns(angles), back @ (J_b[:, 3:] - J_a[:, 3:]))
        return s, np.concatenate([back @ moved, turned], axis=1)


def pairs_of(robot: Robot) -> dict[tuple[str, str], FramePair]:
    """Return those of the loop joints with forces and of the bushings of a robot, by "loops" or "bushings" and name."""
    pairs = dict[tuple[str, str], FramePair]()
    for loop in robot.loops:
        if loop.coordinates:
            offset = tuple(value or 0.0 for value in loop.offset)
            pairs["loops", loop.name] = FramePair(loop.links, loop.placements, offset)
    for bushing in bushings_of(robot):
        pairs["bushings", bushing.name] = FramePair(bushing.links, bushing.placements)
    return pairs


def bushings_of(robot: Robot) -> list[Bushing]:
    """Return the bushings of a robot, in their order."""
    return [element for element in robot.elements if isinstance(element, Bushing)]


def _frame(kernel: Kernel, q: Array, link: str, placement: Placement) -> tuple[Array, Array, Array]:
    """Return the rotation, origin and Jacobian of a frame on a link, (T, 3, 3), (T, 3) and (T, 6, n)."""
    pose, J = np.asarray(kernel.frame_pose(q, link)), np.array(kernel.frame_jacobian(q, link))
    arm = pose[:, :3, :3] @ np.array(placement.xyz)
    J[:, :3] += np.cross(J[:, 3:], arm[:, :, np.newaxis], axis=1)
    return pose[:, :3, :3] @ np.array(placement.rotation), pose[:, :3, 3] + arm, J


def _turns(angles: Array) -> Array:
    """Return the axes of alpha, beta and gamma as columns, (T, 3, 3): of the first angle's frame."""
    sa, ca, sb, cb = np.sin(angles[:, 0]), np.cos(angles[:, 0]), np.sin(angles[:, 1]), np.cos(angles[:, 1])
    one, none = np.ones_like(sa), np.zeros_like(sa)
    rows = [[one, none, sb], [none, ca, -sa * cb], [none, sa, ca * cb]]
    return np.moveaxis(np.array(rows), -1, 0)
