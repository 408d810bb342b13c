"""Velocities and accelerations of frames, from those of the bodies that carry them, and what IMUs there read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from eomgen.robot.model import FIXED_BODY

from .bound import Bound
from .frozen_joints import PosedTree
from .kinematics import body_poses
from .recursion import Acceleration, accelerations, velocities
from .spatial import ZERO, Pose, Scalar, Vec, add, cross, matvec, scale, transpose


def frame_velocities(tree: PosedTree, v: Sequence[Scalar]) -> list[Scalar]:
    """Return per frame the velocity of its origin, m/s, and its angular velocity, rad/s: six numbers, base frame."""
    poses, _ = body_poses(tree)
    bodies = [W for _, W in velocities(tree, v)]
    return _of_frames(tree, poses, lambda k, arm: (add(bodies[k].origin, cross(bodies[k].rate, arm)), bodies[k].rate))


def frame_accelerations(tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar]) -> list[Scalar]:
    """Return per frame the acceleration of its origin, m/s^2, and its angular acceleration, rad/s^2: six numbers."""
    poses, _ = body_poses(tree)
    bodies = accelerations(replace(tree, bound=replace(tree.bound, gravity=ZERO)), v, a)
    return _of_frames(tree, poses, lambda k, arm: (add(bodies[k].origin, matvec(bodies[k].U, arm)), bodies[k].dot))


def _of_frames(tree: PosedTree, poses: Sequence[Pose], moved: Callable[[int, Vec], tuple[Vec, Vec]]) -> list[Scalar]:
    """Return two vectors per frame in the base's axes, of a body and a point on it in its axes; 0 where none moves."""
    values: list[Scalar] = []
    for body, pose in (tree.bound.frames[name] for name in tree.model.frames):
        if body == FIXED_BODY:
            values += [0.0] * 6
        else:
            values += [x for vector in moved(body, pose.origin) for x in matvec(poses[body].rotation, vector)]
    return values


def imu(tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar]) -> list[Scalar]:
    """Return per frame what an IMU there reads, in the frame's axes: specific force, m/s^2, and angular rate, rad/s."""
    bodies = accelerations(tree, v, a)
    frames = (tree.bound.frames[name] for name in tree.model.frames)
    return [x for frame in frames for vector in imu_at(tree.bound, bodies, *frame) for x in vector]


def imu_at(bound: Bound, bodies: Sequence[Acceleration], body: int, pose: Pose) -> tuple[Vec, Vec]:
    """Return R^T (a - g) and R^T w of a frame in its axes.

    Args:
        bodies: K of every body, with gravity as an acceleration of the base.
        body, pose: that carries the frame, and where it stands there.
    """
    back = transpose(pose.rotation)
    if body == FIXED_BODY:
        return matvec(back, scale(-1.0, bound.gravity)), ZERO
    K = bodies[body]
    return matvec(back, add(K.origin, matvec(K.U, pose.origin))), matvec(back, K.rate)
