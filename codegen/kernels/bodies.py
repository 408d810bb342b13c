"""The program of frames, body by body: a frame's pose and Jacobian need the bodies between it and the base alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from eomgen.names import component_name, kind_of
from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.value import ANGULAR, MOTOR

from ..program.ir import Program
from ..program.shares import Goal, Shares, share

POSE, ORIGINS, AXES = "pose", "origins", "axes"  # arrays that shares write: of one frame, of all bodies and coordinates
POSE_SIZE = 12  # numbers of [R | X]


def share_among_bodies(model: Model, program: Program) -> Shares:
    """Split a program among the base, the bodies, and the frames, which hang on their bodies.

    Node 0 is the base, 1 + b the body b, and ``first_frame(model)`` + f the frame f.
    """
    parents = [-1, *(1 + body.parent for body in model.bodies), *(1 + body for body in frame_bodies(model))]
    return share(program, {("out", place): goal for place, goal in _goals(model)}, parents, len(model.frames))


def first_frame(model: Model) -> int:
    """Return the node of the first frame."""
    return 1 + len(model.bodies)


def frame_bodies(model: Model) -> list[int]:
    """Return per frame of the model its body, FIXED_BODY of one that stays where it is."""
    links = {frame.name: frame.link for frame in model.robot.frames}
    return [model.body_of[links.get(name, name)] for name in model.frames]


def jacobian_columns(model: Model, k: Any, frame: int) -> dict[int, list[Any]]:
    """Return columns of a frame's Jacobian that do not vanish, six entries each, by coordinates; in any arithmetic.

    Args:
        k: results of the program of frames, a sequence.
    """
    origins = POSE_SIZE * len(model.frames)
    axes, columns = origins + 3 * len(model.bodies), dict[int, list[Any]]()
    on_bodies = list(enumerate(axes_of(model)))
    body = frame_bodies(model)[frame]
    while body >= 0:
        arm = [k[POSE_SIZE * frame + 3 + 4 * i] - k[origins + 3 * body + i] for i in range(3)]
        for s, axis in on_bodies:
            if axis.body != body:
                continue
            e = [k[axes + 3 * s + i] for i in range(3)]
            column = [*e, 0.0, 0.0, 0.0]
            if axis.is_rotation:
                column = [e[i] * arm[j] - e[j] * arm[i] for i, j in ((1, 2), (2, 0), (0, 1))] + e
            if model.followers:  # whose columns add up, from zeros on
                column = [x + y for x, y in zip(columns.get(axis.column, [0.0] * 6), column, strict=True)]
            columns[axis.column] = column
        body = model.bodies[body].parent
    return columns


@dataclass(frozen=True)
class Axis:
    """An axis along which a coordinate moves a body: the coordinate's name, the body, the column of Jacobians.

    A follower has one for each coordinate that it follows, as long as its share in that one's velocity.  A motor moves
    no body: its body is FIXED_BODY.
    """

    name: str
    body: int
    column: int

    @property
    def is_rotation(self) -> bool:
        """Whether it is the axis of a rotation."""
        return kind_of(self.name) in ANGULAR


def kinematics_size(model: Model) -> int:
    """Return how many numbers the kernel "kinematics" writes: poses of frames, origins of bodies, axes."""
    return 12 * len(model.frames) + 3 * len(model.bodies) + 3 * len(axes_of(model))


def axes_of(model: Model) -> list[Axis]:
    """Return axes of all coordinates in the order of the tree, followers behind the others of their bodies."""
    axes: list[Axis] = []
    places = {name: i for i, name in enumerate(model.coordinates)}
    for k, body in enumerate(model.bodies):
        kinds = model.robot.joint(body.joint).coordinates
        axes += [Axis(model.coordinates[i], k, i) for i in body.indices]
        for name in (component_name(body.joint, kind) for kind in kinds):
            axes += [Axis(name, k, places[leader]) for leader in model.leaders.get(name, ())]
        axes += [Axis(x, FIXED_BODY, places[x]) for x in [component_name(body.joint, MOTOR)] if x in places]
    return axes


def _goals(model: Model) -> Iterator[tuple[int, Goal]]:
    """Return places of the program's outputs, and where they belong; motors turn nothing, and are left out."""
    origins = POSE_SIZE * len(model.frames)
    axes, on_bodies = origins + 3 * len(model.bodies), axes_of(model)
    for frame in range(len(model.frames)):
        for i in range(POSE_SIZE):
            yield POSE_SIZE * frame + i, Goal(first_frame(model) + frame, POSE, i)
    for number in range(len(model.bodies)):
        for i in range(3 * number, 3 * number + 3):
            yield origins + i, Goal(1 + number, ORIGINS, i)
        for s, axis in enumerate(on_bodies):
            if axis.body == number:
                for i in range(3 * s, 3 * s + 3):
                    yield axes + i, Goal(1 + number, AXES, i)
