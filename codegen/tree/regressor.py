"""Inverse dynamics without springs as u = Y(q, v, a) theta: linear in inertial parameters and armatures.

A body's wrench P = K H is linear in H, and a row of eq. (5) reads a wrench off along its coordinate's unit motion:
an axis e and the velocity l of the body's origin per unit rate, both in the link's axes.  So that motion goes out along
the tree once for every body behind its coordinate, and meets ten wrenches there.  Each of these has few entries, which
makes it cheaper than ten wrenches on their way back.  What is behind a coordinate alone has entries in its row.

Of a link that bends the ten are those of H while nothing bends; G_k of its modes is known, and no column's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from eomgen.names import component_name, kind_of
from eomgen.robot.coordinates import coordinate_names
from eomgen.robot.model import FIXED_BODY, Model, with_offset_angles
from eomgen.robot.value import MOTOR

from .bound import bind
from .composite import turned
from .frozen_joints import JointGeometry, PosedTree, unit
from .recursion import Acceleration, accelerations
from .spatial import ZERO, Mat, Scalar, Vec, add, cross, dot, matmul, matvec, transpose

INERTIAL = ("m", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")  # of a link, in the order of columns
Motion = tuple[Vec, Vec]  # per unit rate of a coordinate: angular velocity, velocity of a frame's origin


def regressor_names(model: Model) -> tuple[str, ...]:
    """Name the columns: ten of each body ("link1.m" ... "link1.izz"), then armatures ("joint1.gamma.armature").

    A body has the name of its joint's child link.  Of coordinates those have an armature that a drive moves, motors
    ("joint1.motor.inertia"), and those with one in the description.
    """
    links = [component_name(body.name, key) for body in model.bodies for key in INERTIAL]
    ends = ((name, "inertia" if kind_of(name) == MOTOR else "armature") for name in armatures(model))
    return (*links, *(component_name(name, end) for name, end in ends))


def armatures(model: Model) -> tuple[str, ...]:
    """Name the coordinates, followers too, that have a column for their armature; in the order of the tree."""
    names = {model.coordinates[i] for i in (*model.driven, *model.motors)}
    for name, coordinate in model.robot.coordinates.items():
        if coordinate.armature or f"joints.{name}.armature" in model.parameters:
            names.add(name)
    return tuple(name for name in coordinate_names(model.robot) if name in names)


def described_values(model: Model) -> list[float]:
    """Return theta of the description, in the order of ``regressor_names``; kg, kg m, kg m^2.

    A body's inertia is that about the origin of its frame and along its axes, with all links that are fixed to it.
    """
    whole, _ = with_offset_angles(model)
    bound = bind(whole, lambda _, number: number, lambda x: (math.sin(x), math.cos(x)))
    values: list[float] = []
    for body, numbers in zip(model.bodies, bound.bodies, strict=True):
        H = turned(transpose(bound.frames[body.name][1].rotation), numbers.inertia)
        J = H.second
        moments = (J[1][1] + J[2][2], -J[0][1], -J[0][2], J[0][0] + J[2][2], -J[1][2], J[0][0] + J[1][1])
        values += [x + 0.0 for x in (H.mass, *H.first, *moments)]  # no -0.0
    return [*values, *(bound.armature[whole.coordinates.index(name)] for name in armatures(model))]


def inertial_columns(tree: PosedTree, v: Sequence[Scalar], a: Sequence[Scalar]) -> list[dict[int, list[Scalar]]]:
    """Return per body, by the index of every coordinate in front of it, the ten entries of that row of Y.

    Args:
        bound: with the description's frames.
    """
    motions: list[Mapping[int, Motion]] = []
    columns: list[dict[int, list[Scalar]]] = []
    for k, (body, K) in enumerate(zip(tree.model.bodies, accelerations(tree, v, a), strict=True)):
        tree.note(f"{body.name}: motions of its frame per unit rates, and columns of its inertial parameters")
        motions.append(_through(tree.joints[k], motions[body.parent] if body.parent != FIXED_BODY else {}))
        axes = tree.bound.frames[body.name][1].rotation
        wrenches = _LinkWrenches(K, axes)
        columns.append({index: wrenches.along(motion) for index, motion in motions[k].items()})
    return columns


def _through(joint: JointGeometry, motions: Mapping[int, Motion]) -> dict[int, Motion]:
    """Move motions of the parent's frame to a joint's body frame, in its axes; add those of the joint."""
    back = transpose(joint.turn)
    body_motions = {i: (matvec(back, e), matvec(back, add(x, cross(e, joint.offset)))) for i, (e, x) in motions.items()}
    body_motions |= {index: (ZERO, unit(axis)) for index, axis in joint.translations}
    for turn in joint.rotations:
        back = transpose(turn.matrix)
        body_motions = {i: (matvec(back, e), matvec(back, x)) for i, (e, x) in body_motions.items()}
        body_motions[turn.index] = (unit(turn.axis), ZERO)
    return body_motions


class _LinkWrenches:
    """Wrenches that a link's frame needs where one of the ten inertial parameters is 1 and all others are 0.

    A mass needs the force a.  A first moment along an axis x needs the force U x and the moment x cross a.  An inertia
    needs a moment alone: I w_dot + w cross I w, whose entries are products of rates, or entries of U.
    """

    def __init__(self, K: Acceleration, axes: Mat) -> None:
        """Take K of the body's frame, and the link's axes as columns in the body's."""
        self._back = transpose(axes)
        self.a = matvec(self._back, K.origin)
        self.U = U = matmul(matmul(self._back, K.U), axes)
        w, d = matvec(self._back, K.rate), matvec(self._back, K.dot)
        xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
        self.moments: tuple[Vec, ...] = (
            (d[0], xz, -xy),
            (-U[2][0], U[2][1], U[0][0] - U[1][1]),
            (U[1][0], U[2][2] - U[0][0], -U[1][2]),
            (-yz, d[1], xy),
            (U[1][1] - U[2][2], -U[0][1], U[0][2]),
            (yz, -xz, d[2]),
        )

    def along(self, motion: Motion) -> list[Scalar]:
        """Return the work of the ten wrenches on a motion in the body's axes."""
        e, x = matvec(self._back, motion[0]), matvec(self._back, motion[1])
        first = add(matvec(transpose(self.U), x), cross(self.a, e))
        return [dot(x, self.a), *first, *(dot(e, moment) for moment in self.moments)]
