"""Poses of frames and axes of coordinates in the base, eqs. (1) to (3); center of mass and momentum of the links.

Links that are fixed to the base have no part in the latter, nor have motors' rotors, of whose axes a description says
nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eomgen.errors import InputError
from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import FIXED_BODY, Model

from .bound import Bound
from .frozen_joints import JointGeometry, PosedTree, no_note
from .modal import NOTHING
from .recursion import NO_WRENCH, Wrench, collect, rotational_inertia, velocities
from .spatial import ZERO, Pose, Scalar, Vec, add, cross, dot, is_zero, matmul, matvec, scale, transpose, vec3

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


def center_of_mass(tree: PosedTree) -> Vec:
    """Divide the sum of m c over the bodies, each from the base's origin, by the whole mass.

    Raises:
        InputError: no link that moves has mass.
    """
    poses, _ = body_poses(tree)
    first, mass = ZERO, 0.0
    for pose, body in zip(poses, tree.bound.bodies, strict=True):
        H = body.inertia
        first = add(first, add(matvec(pose.rotation, H.first), scale(H.mass, pose.origin)))
        mass = mass + H.mass
    if is_zero(mass):
        raise InputError(f"center_of_mass: no link of {tree.model.name} that moves has mass; a mass above 0 is needed")
    return scale(1.0 / mass, first)


def total_momentum(tree: PosedTree, v: Sequence[Scalar]) -> tuple[Vec, Vec]:
    """Sum the bodies' linear momenta, kg m/s, and their angular momenta about the base's origin, kg m^2/s."""
    poses, _ = body_poses(tree)
    linear, angular = ZERO, ZERO
    for pose, (_, W), body in zip(poses, velocities(tree, v), tree.bound.bodies, strict=True):
        H, moving = body.inertia, body.bent.sum(v) if body.bent is not None else NOTHING
        body_momentum = matvec(pose.rotation, add(add(scale(H.mass, W.origin), cross(W.rate, H.first)), moving.row))
        spin = add(add(rotational_inertia(H, W.rate), cross(H.first, W.origin)), moving.about())
        spin = matvec(pose.rotation, spin)
        linear = add(linear, body_momentum)
        angular = add(angular, add(spin, cross(pose.origin, body_momentum)))
    return linear, angular
