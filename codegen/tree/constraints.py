"""Constraints of cut joints: g(q), its Jacobian J = dg/dq, and J_dot v, in closed form.

The two sides of a loop are followed from the last body that carries both, in its axes: what moves that body moves both
sides alike and does not appear.  Frame a is on the loop's first link, frame b on the second; a component is a
coordinate of p, the origin of b seen from a, or a sum of products of axes of a and b (``eomgen.robot.cuts``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from eomgen.robot.joint_types import Component, rigid_components
from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.value import ANGULAR

from .frozen_joints import PosedTree
from .kinematics import BASE_POSE, through_joint
from .recursion import Wrench
from .spatial import (
    ZERO,
    Pose,
    Scalar,
    Vec,
    about,
    add,
    cross,
    dot,
    is_zero,
    mat3,
    matmul,
    matvec,
    scale,
    subtract,
    transpose,
)

Turn = Callable[[Scalar], tuple[Scalar, Scalar]]


@dataclass(frozen=True)
class Direction:
    """A direction of motion of frame b against frame a, in the common body's axes: of its origin, or a turn."""

    vector: Vec
    is_rotation: bool

    def wrench(self, force: Scalar) -> Wrench:
        """Return a force along it, or a moment about it."""
        vector = scale(force, self.vector)
        return Wrench(ZERO, vector) if self.is_rotation else Wrench(vector, ZERO)


@dataclass(frozen=True)
class Motion:
    """Angular velocity and acceleration of a body, velocity and acceleration of a point on it; q_ddot = 0."""

    rate: Vec = ZERO
    dot: Vec = ZERO
    velocity: Vec = ZERO
    acceleration: Vec = ZERO

    def at(self, arm: Vec) -> Motion:
        """Return the motion of another point of the body, that far away."""
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

    def __init__(self, tree: PosedTree, top: int, cut: tuple[int, Pose]) -> None:
        self.joints, (body, placed) = tree.joints, cut
        ancestors = list(tree.model.ancestors(body))
        self.path = ancestors[: ancestors.index(top) if top != FIXED_BODY else None][::-1]
        self.poses: list[Pose] = []
        self.axes: dict[int, Vec] = {}
        pose = BASE_POSE
        for k in self.path:
            pose, axes = through_joint(pose, self.joints[k])
            self.poses.append(pose)
            self.axes.update(axes)
        self.pose = pose @ placed

    def columns(self, point: Vec) -> Iterator[Column]:
        """Return the coordinates that move this side, with their moment arms to the point."""
        for k, pose in zip(self.path, self.poses, strict=True):
            arm = subtract(point, pose.origin)
            for index, _ in self.joints[k].translations:
                yield Column(index, False, self.axes[index], arm)
            for turn in self.joints[k].rotations:
                yield Column(turn.index, True, self.axes[turn.index], arm)

    def motion(self, v: Sequence[Scalar]) -> Motion:
        """Return the motion of the cut frame's origin at the rates v, without accelerations of coordinates."""
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


class FramePair:
    """Frames a and b on two bodies, and b as seen from a: ``distance`` and axes, in the common body's axes."""

    def __init__(self, tree: PosedTree, ends: tuple[tuple[int, Pose], tuple[int, Pose]], where: str) -> None:
        """Follow both frames from the last body that carries both.

        Args:
            ends: per frame its body, and its pose there.
            where: names them in messages: "loops.pin".
        """
        self.where, self.source = where, tree.model.robot.source or tree.model.name
        top = common_body(tree.model, ends[0][0], ends[1][0])
        self.a, self.b = (Side(tree, top, end) for end in ends)
        self.distance = subtract(self.b.pose.origin, self.a.pose.origin)
        self.axes_a, self.axes_b = transpose(self.a.pose.rotation), transpose(self.b.pose.rotation)

    def pose(self) -> Pose:
        """Return frame b as seen from frame a."""
        R = mat3([dot(e, f) for f in self.axes_b] for e in self.axes_a)
        return Pose(R, matvec(self.axes_a, self.distance))

    def jacobian_rows(self, directions: Sequence[Direction]) -> list[dict[int, Scalar]]:
        """Differentiate how far b comes along directions, as seen from a, by the coordinates."""
        rows: list[dict[int, Scalar]] = [{} for _ in directions]
        for side, sign in ((self.a, -1.0), (self.b, 1.0)):
            for column in side.columns(self.b.pose.origin):
                slide = cross(column.axis, column.arm) if column.is_rotation else column.axis
                for row, direction in zip(rows, directions, strict=True):
                    if not direction.is_rotation:
                        row[column.index] = sign * dot(direction.vector, slide)
                    elif column.is_rotation:
                        row[column.index] = sign * dot(direction.vector, column.axis)
        return rows

    def wrenches(self, force: Vec, moment: Vec) -> Iterator[tuple[int, Wrench]]:
        """Return wrenches of joints on both sides' bodies that hold a wrench on b at its origin, the opposite on a.

        At each body's origin in its axes; the argument is in the common body's axes.
        """
        for side, sign in ((self.a, 1.0), (self.b, -1.0)):
            f, n = scale(sign, force), scale(sign, moment)
            for k, pose in zip(side.path, side.poses, strict=True):
                back = transpose(pose.rotation)
                arm = subtract(self.b.pose.origin, pose.origin)
                yield k, Wrench(matvec(back, f), matvec(back, add(n, cross(arm, f))))


class Closure(FramePair):
    """The two sides of a loop: the frames of its cut joint."""

    def __init__(self, tree: PosedTree, number: int, sincos: Turn) -> None:
        """Follow both sides of the loop of that number."""
        loop, offset = tree.model.robot.loops[number], tree.bound.cut_offsets[number]
        self.number, self.name = number, loop.name
        super().__init__(tree, tree.bound.cuts[number], f"loops.{self.name}")
        self.parts: tuple[Component, ...] = rigid_components(loop)
        self.shift: Vec = (offset[0], offset[1], offset[2])
        self._compare_axes(offset[3:], sincos)

    def values(self) -> list[Scalar]:
        """Return the components of g: m, and sines of angles."""
        away = [
            self._of(component, self.distance, lambda i, j: dot(self.rows_a[i], self.rows_b[j]))
            for component in self.parts
        ]
        return [value - self._kept(component) for value, component in zip(away, self.parts, strict=True)]

    def _compare_axes(self, offset: Sequence[Scalar], sincos: Turn) -> None:
        """Turn the axes of both frames, as rows compare them, by what rigid angles keep to.

        Where all angles are rigid, the whole offset turns those of a.  Otherwise alpha turns a about x, gamma b back
        about z, and beta is taken off its row, sin(beta): each is exact whatever the other angles are.
        """
        rigid = {component.name for component in self.parts if component.axis is None}
        R, S = self.a.pose.rotation, self.b.pose.rotation
        self.sine: Scalar = 0.0
        for axis, (name, angle) in enumerate(zip(ANGULAR, offset, strict=True)):
            if name not in rigid or is_zero(angle):
                continue
            sine, cosine = sincos(angle)
            if len(rigid) == len(ANGULAR) or axis == 0:
                R = matmul(R, about(axis, sine, cosine))
            elif axis == 1:
                self.sine = sine
            else:
                S = matmul(S, transpose(about(axis, sine, cosine)))
        self.rows_a, self.rows_b = transpose(R), transpose(S)

    def _kept(self, component: Component) -> Scalar:
        """Return the offset that a component keeps to."""
        if component.axis is not None:
            return self.shift[component.axis]
        return self.sine if component.name == "beta" else 0.0

    def jacobian(self) -> list[dict[int, Scalar]]:
        """Return rows of J by coordinate; those that move a move b the other way, as seen from a."""
        return self.jacobian_rows([self.direction(component) for component in self.parts])

    def direction(self, component: Component) -> Direction:
        """Return the direction that a component is a coordinate along."""
        if component.axis is not None:
            return Direction(self.axes_a[component.axis], is_rotation=False)
        return Direction(self._moment(component), is_rotation=True)

    def bias(self, v: Sequence[Scalar]) -> list[Scalar]:
        """Return J_dot v: second derivatives of the components at q_ddot = 0."""
        a, b = self.a.motion(v), self.b.motion(v)
        w = a.rate
        speed = subtract(b.velocity, a.velocity)
        inner = subtract(cross(w, self.distance), scale(2.0, speed))
        slide = add(subtract(b.acceleration, a.acceleration), subtract(cross(w, inner), cross(a.dot, self.distance)))
        turn = subtract(b.rate, w)  # of b against a, and its derivative as seen from a
        dot_turn = subtract(subtract(b.dot, a.dot), cross(w, turn))
        bend = [add(cross(dot_turn, f), cross(turn, cross(turn, f))) for f in self.rows_b]
        return [self._of(component, slide, lambda i, j: dot(self.rows_a[i], bend[j])) for component in self.parts]

    def seen_from_b(self, wrench: Wrench) -> Wrench:
        """Return a wrench of the common body's axes in those of frame b."""
        return Wrench(matvec(self.axes_b, wrench.force), matvec(self.axes_b, wrench.moment))

    def _of(self, component: Component, vector: Vec, product: Any) -> Scalar:
        """Return a vector's entry along the component's axis, or its sum of products of axes."""
        if component.axis is not None:
            return dot(self.axes_a[component.axis], vector)
        total: Scalar = 0.0
        for factor, i, j in component.products:
            total = total + factor * product(i, j)
        return total

    def _moment(self, component: Component) -> Vec:
        """Return the factor of b's angular velocity against a: e_i . (w x f_j) = w . (f_j x e_i)."""
        total = ZERO
        for factor, i, j in component.products:
            total = add(total, scale(factor, cross(self.rows_b[j], self.rows_a[i])))
        return total


def closures(tree: PosedTree, sincos: Turn) -> Iterator[Closure]:
    """Follow the robot's loops, each with a comment in front of its values."""
    for number, loop in enumerate(tree.model.robot.loops):
        tree.note(f"{loop.name}: {loop.type} joint between {loop.links[0]} and {loop.links[1]}")
        yield Closure(tree, number, sincos)


def common_body(model: Model, a: int, b: int) -> int:
    """Return the last body that carries bodies a and b, or FIXED_BODY."""
    behind = set(model.ancestors(a))
    return next((k for k in model.ancestors(b) if k in behind), FIXED_BODY)
