"""Poses of frames and axes of coordinates in the base, eqs. (1) to (3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import FIXED_BODY, Model

from .bound import Bound
from .frozen_joints import JointGeometry, PosedTree, no_note
from .recursion import NO_WRENCH, Wrench, collect
from .spatial import ZERO, Pose, Scalar, Vec, add, cross, dot, matmul, matvec, transpose, vec3

BASE_POSE = Pose(IDENTITY, ZERO)


def body_poses(tree: PosedTree) -> tuple[list[Pose], list[Vec]]:
    """Return A_0k of every body, and the unit axis of every coordinate, base frame."""
    poses: list[Pose] = []
    axes: list[Vec] = [ZERO] * tree.model.size
    for body, joint in zip(tree.model.bodies, tree.joints, strict=True):
        pose, unit_axes = through_joint(BASE_POSE if body.parent == FIXED_BODY else poses[body.parent], joint)
        poses.append(pose)
        for index, axis in unit_axes.items():
            axes[index] = axis
    return poses, axes


def through_joint(parent: Pose, joint: JointGeometry) -> tuple[Pose, dict[int, Vec]]:
    """Return the pose of the body behind a joint, and its coordinates' unit axes, in the axes of ``parent``."""
    axes: dict[int, Vec] = {}
    origin = add(parent.origin, matvec(parent.rotation, joint.offset))
    rotation = matmul(parent.rotation, joint.turn)
    for index, axis in joint.translations:
        axes[index] = transpose(rotation)[axis]
    for turn in joint.rotations:
        axes[turn.index] = transpose(rotation)[turn.axis]
        rotation = matmul(rotation, turn.matrix)
    return Pose(rotation, origin), axes


def frame_poses(model: Model, bound: Bound, bodies: Sequence[Pose]) -> list[Pose]:
    """Return the poses of all frames of the model in the base frame."""
    return [
        (BASE_POSE if body == FIXED_BODY else bodies[body]) @ pose
        for body, pose in (bound.frames[name] for name in model.frames)
    ]


def external_rows(tree: PosedTree, wrenches: Sequence[Sequence[Scalar]]) -> tuple[list[Scalar], list[Wrench]]:
    """Return generalized forces of a force and a moment at each link's com: eq. (14), its moment term corrected.

    Args:
        wrenches: per link of ``model.links`` six scalars, force (N) and moment (N m), base frame.

    Returns:
        n rows, and per body the load on it and all that hangs on it, at its origin in its axes.
    """
    poses, _ = body_poses(tree)
    at_bodies = [NO_WRENCH] * len(tree.model.bodies)
    for link, wrench in zip(tree.model.links, wrenches, strict=True):
        body, com = tree.bound.coms[link]
        back = transpose(poses[body].rotation)
        force, moment = matvec(back, vec3(wrench[:3])), matvec(back, vec3(wrench[3:]))
        at_bodies[body] = at_bodies[body] + Wrench(force, add(moment, cross(com, force)))
    return collect(replace(tree, note=no_note), at_bodies)


def weight_energy(tree: PosedTree) -> Scalar:
    """Give the energy of gravity, J; zero with every body's mass at the base's origin."""
    poses, _ = body_poses(tree)
    energy: Scalar = -dot(tree.bound.gravity, tree.bound.at_rest)
    for pose, body in zip(poses, tree.bound.bodies, strict=True):
        H = body.inertia
        first = add(matvec(pose.rotation, H.first), tuple(H.mass * x for x in pose.origin))
        for g, moment in zip(tree.bound.gravity, first, strict=True):
            energy = energy - g * moment
    return energy
