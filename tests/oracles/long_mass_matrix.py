"""Mass matrices of rigid trees by the Jacobians of all links, in 60-digit arithmetic of the description's numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eomgen.robot.value import Robot
from tests.oracles.roundings import mp


def long_pose(rotation: Sequence[Sequence[float]], origin: Sequence[float]) -> Any:
    """Return the 4x4 matrix of a pose."""
    return mp.matrix([[*row, x] for row, x in zip(rotation, origin, strict=True)] + [[0, 0, 0, 1]])


def _cross(a: Any, b: Any) -> Any:
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def exact_mass_matrix(robot: Robot, q: Sequence[Any]) -> Any:
    """Return M by the Jacobians of all links, in long arithmetic."""
    moves = [joint for joint in robot.joints if joint.coordinates]
    poses: dict[str, Any] = {robot.base: mp.eye(4)}
    above: dict[str, tuple[int, ...]] = {robot.base: ()}
    axes: list[tuple[bool, Any, Any]] = []
    for joint in robot.joints:
        pose = poses[joint.parent] * long_pose(joint.placement.rotation, joint.placement.xyz)
        if joint in moves:
            x, turns = q[len(axes)], joint.type == "revolute"
            axes.append((turns, pose[:3, 2], pose[:3, 3]))
            s, c = (mp.sin(x), mp.cos(x)) if turns else (0, 1)
            pose = pose * long_pose([[c, -s, 0], [s, c, 0], [0, 0, 1]], [0, 0, 0 if turns else x])
        poses[joint.child] = pose
        above[joint.child] = (*above[joint.parent], *([len(axes) - 1] if joint in moves else ()))
    M = mp.zeros(len(axes))
    for link in robot.links:
        pose = poses[link.name]
        com, R = pose * mp.matrix([*link.com, 1]), pose[:3, :3]
        xx, yy, zz, xy, xz, yz = link.inertia
        inertia = R * mp.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * R.T
        for i in above[link.name]:
            for j in above[link.name]:
                (v, w), (x, y) = (_of_joint(*axes[k], com) for k in (i, j))
                M[i, j] += link.mass * mp.fdot(v, x) + mp.fdot(w, inertia * y)
    return M


def _of_joint(turns: bool, axis: Any, origin: Any, com: Any) -> tuple[Any, Any]:
    """Return velocity of a point and angular velocity of a unit velocity of a joint."""
    return (_cross(axis, com[:3] - origin), axis) if turns else (axis, mp.zeros(3, 1))
