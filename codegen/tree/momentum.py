"""Center of mass and momentum of the moving links in the base frame.

Links that are fixed to the base do not count, nor do motors' rotors, of whose axes a description says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.errors import InputError

from .frozen_joints import PosedTree
from .kinematics import body_poses
from .modal import NOTHING
from .recursion import rotational_inertia, velocities
from .spatial import ZERO, Scalar, Vec, add, cross, is_zero, matvec, scale


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
