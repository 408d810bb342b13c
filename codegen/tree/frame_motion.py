"""Velocities and accelerations of frames, from those of the bodies that carry them, in the base frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eomgen.robot.model import FIXED_BODY, Model

from .bound import Bound
from .frozen_joints import JointGeometry
from .kinematics import body_poses
from .recursion import accelerations, velocities
from .spatial import ZERO, Scalar, add, cross, matvec


def frame_velocities(model: Model, bound: Bound, joints: Sequence[JointGeometry], v: Sequence[Scalar]) -> list[Scalar]:
    """Return per frame the velocity of its origin, m/s, and its angular velocity, rad/s: six numbers, base frame."""
    poses, _ = body_poses(model, joints)
    bodies = [W for _, W in velocities(model, joints, v)]
    values: list[Scalar] = []
    for body, pose in (bound.frames[name] for name in model.frames):
        if body == FIXED_BODY:
            values.extend([0.0] * 6)
            continue
        R, W = poses[body].rotation, bodies[body]
        values.extend(matvec(R, add(W.origin, cross(W.rate, pose.origin))))
        values.extend(matvec(R, W.rate))
    return values


def frame_accelerations(
    model: Model, bound: Bound, joints: Sequence[JointGeometry], v: Sequence[Scalar], a: Sequence[Scalar]
) -> list[Scalar]:
    """Return per frame the acceleration of its origin, m/s^2, and its angular acceleration, rad/s^2: six numbers."""
    poses, _ = body_poses(model, joints)
    bodies = accelerations(model, replace(bound, gravity=ZERO), joints, v, a)
    values: list[Scalar] = []
    for body, pose in (bound.frames[name] for name in model.frames):
        if body == FIXED_BODY:
            values.extend([0.0] * 6)
            continue
        R, K = poses[body].rotation, bodies[body]
        values.extend(matvec(R, add(K.origin, matvec(K.U, pose.origin))))
        values.extend(matvec(R, K.dot))
    return values
