"""Constraints of cut joints: g(q), its Jacobian J = dg/dq, and J_dot v, in closed form.

The two sides of a loop are followed from the last body that carries both, in its axes: what moves that body moves both
sides alike and does not appear.  Frame a is on the loop's first link, frame b on the second; a component is a
coordinate of p, the origin of b seen from a, or a sum of products of axes of a and b (``eomgen.robot.cuts``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from eomgen.robot.cuts import Component, rigid_parts
from eomgen.robot.model import FIXED_BODY, Model

from .bound import Bound
from .frozen_joints import JointGeometry
from .kinematics import BASE_POSE, through_joint
from .spatial import Mat, Pose, Scalar, Vec, add, cross, dot, matvec, scale, transpose

ZERO: Vec = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Motion:
    """Angular velocity and acceleration of a body, velocity and acceleration of a point on it; q_ddot = 0."""

    rate: Vec = ZERO
    dot: Vec = ZERO
    velocity: Vec = ZERO
    acceleration: Vec = ZERO

    def at(self, arm: Vec) -> Motion:
        """Motion of another point of the body, that far away."""
        w, d = self.rate, self.dot
        turned = cross(w, arm)
        velocity = add(self.velocity, turned)
        return Motion(w, d, velocity, add(self.acceleration, add(cross(d, arm), cross(w, turned))))


@dataclass(frozen=True)
class Column:
    """A coordinate on one side of a loop: its index in q and unit axis, and the arm from there to the cut frame."""

    index: int
    is_rotation: bool
    axis: Vec
    arm: Vec


class Side:
    """One side of a loop: the cut frame's pose, and what its coordinates do to it, in the common body's axes."""

    def __init__(self, model: Model, joints: Sequence[JointGeometry], top: int, cut: tuple[int, Pose]) -> None:
        self.joints, (body, placed) = joints, cut
        ancestors = list(model.ancestors(body))
        self.path = ancestors[: ancestors.index(top) if top != FIXED_BODY else None][::-1]
        self.poses: list[Pose] = []
        self.axes: dict[int, Vec] = {}
        pose = BASE_POSE
        for k in self.path:
            pose, axes = through_joint(pose, joints[k])
            self.poses.append(pose)
            self.axes.update(axes)
        self.pose = pose @ placed

    def columns(self, point: Vec) -> Iterator[Column]:
        """The coordinates that move this side, with their arms to the point."""
        for k, pose in zip(self.path, self.poses, strict=True):
            arm = subtract(point, pose.origin)
            for index, _ in self.joints[k].translations:
                yield Column(index, False, self.axes[index], arm)
            for turn in self.joints[k].rotations:
                yield Column(turn.index, True, self.axes[turn.index], arm)

    def motion(self, v: Sequence[Scalar]) -> Motion:
        """Motion of the cut frame's origin at the rates v, without accelerations of coordinates."""
        moving, parent = Motion(), BASE_POSE
        for k, pose in zip(self.path, self.poses, strict=True):
            moving = moving.at(subtract(pose.origin, parent.origin))
            w, velocity, acceleration = moving.rate, moving.velocity, moving.acceleration
            for index, _ in self.joints[k].translations:
                slide = scale(v[index], self.axes[index])
                velocity = add(velocity, slide)
                acceleration = add(acceleration, scale(2.0, cross(w, slide)))
            d = moving.dot
            for turn in self.joints[k].rotations:
                spin = scale(v[turn.index], self.axes[turn.index])
                d = add(d, cross(w, spin))
                w = add(w, spin)
            moving, parent = Motion(w, d, velocity, acceleration), pose
        return moving.at(subtract(self.pose.origin, parent.origin))


class Closure:
    """The two sides of a loop, and frame b as seen from a: ``distance`` and axes, in the common body's axes."""

    def __init__(self, model: Model, bound: Bound, joints: Sequence[JointGeometry], number: int) -> None:
        self.parts: tuple[Component, ...] = rigid_parts(model.robot.loops[number])
        cut_a, cut_b = bound.cuts[number]
        top = common_body(model, cut_a[0], cut_b[0])
        self.a, self.b = (Side(model, joints, top, cut) for cut in (cut_a, cut_b))
        self.distance = subtract(self.b.pose.origin, self.a.pose.origin)
        self.axes_a, self.axes_b = transpose(self.a.pose.rotation), transpose(self.b.pose.rotation)

    def values(self) -> list[Scalar]:
        """Components of g: m, and sines of angles."""
        return [self._of(part, self.distance, lambda i, j: dot(self.axes_a[i], self.axes_b[j])) for part in self.parts]

    def pose(self) -> Pose:
        """Frame b seen from frame a."""
        R: Mat = tuple(tuple(dot(e, f) for f in self.axes_b) for e in self.axes_a)  # type: ignore[assignment]
        return Pose(R, matvec(self.axes_a, self.distance))

    def jacobian(self) -> list[dict[int, Scalar]]:
        """Rows of J by coordinate; those that move a move b the other way, as seen from a."""
        rows: list[dict[int, Scalar]] = [{} for _ in self.parts]
        moments = [self._moment(part) for part in self.parts]
        for side, sign in ((self.a, -1.0), (self.b, 1.0)):
            for column in side.columns(self.b.pose.origin):
                slide = cross(column.axis, column.arm) if column.is_rotation else column.axis
                for row, part, moment in zip(rows, self.parts, moments, strict=True):
                    if part.axis is not None:
                        row[column.index] = sign * dot(self.axes_a[part.axis], slide)
                    elif column.is_rotation:
                        row[column.index] = sign * dot(moment, column.axis)
        return rows

    def bias(self, v: Sequence[Scalar]) -> list[Scalar]:
        """J_dot v: second derivatives of the components at q_ddot = 0."""
        a, b = self.a.motion(v), self.b.motion(v)
        w = a.rate
        speed = subtract(b.velocity, a.velocity)
        inner = subtract(cross(w, self.distance), scale(2.0, speed))
        slide = add(subtract(b.acceleration, a.acceleration), subtract(cross(w, inner), cross(a.dot, self.distance)))
        turn = subtract(b.rate, w)  # of b against a, and its derivative as seen from a
        dot_turn = subtract(subtract(b.dot, a.dot), cross(w, turn))
        bend = [add(cross(dot_turn, f), cross(turn, cross(turn, f))) for f in self.axes_b]
        return [self._of(part, slide, lambda i, j: dot(self.axes_a[i], bend[j])) for part in self.parts]

    def _of(self, part: Component, vector: Vec, product: Any) -> Scalar:
        """The component of a vector, or the sum of products of axes, that the part stands for."""
        if part.axis is not None:
            return dot(self.axes_a[part.axis], vector)
        total: Scalar = 0.0
        for factor, i, j in part.products:
            total = total + factor * product(i, j)
        return total

    def _moment(self, part: Component) -> Vec:
        """The factor of b's angular velocity against a: e_i . (w x f_j) = w . (f_j x e_i)."""
        total = ZERO
        for factor, i, j in part.products:
            total = add(total, scale(factor, cross(self.axes_b[j], self.axes_a[i])))
        return total


def closures(model: Model, bound: Bound, joints: Sequence[JointGeometry], note: Any) -> Iterator[Closure]:
    """The robot's loops, each with a comment in front of its values."""
    for number, loop in enumerate(model.robot.loops):
        note(f"{loop.name}: {loop.type} joint between {loop.links[0]} and {loop.links[1]}")
        yield Closure(model, bound, joints, number)


def common_body(model: Model, a: int, b: int) -> int:
    """The last body that carries bodies a and b, or FIXED_BODY."""
    behind = set(model.ancestors(a))
    return next((k for k in model.ancestors(b) if k in behind), FIXED_BODY)


def subtract(a: Vec, b: Vec) -> Vec:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
