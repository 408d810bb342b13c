"""The program of frames, body by body: a frame's pose and Jacobian need the bodies between it and the base alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from eomgen.robot.model import Model

from ..program.ir import Program
from ..program.shares import Goal, Shares, share

POSE, ORIGINS, AXES = "pose", "origins", "axes"  # arrays that shares write: of one frame, of all bodies and coordinates
POSE_SIZE = 12  # numbers of [R | X]


def share_among_bodies(model: Model, program: Program) -> Shares:
    """Shares of the base, of the bodies, and of the frames, which hang on their bodies.

    Node 0 is the base, 1 + b the body b, and ``first_frame(model)`` + f the frame f.
    """
    parents = [-1, *(1 + body.parent for body in model.bodies), *(1 + body for body in frame_bodies(model))]
    return share(program, {("out", place): goal for place, goal in _goals(model)}, parents, len(model.frames))


def first_frame(model: Model) -> int:
    """The node of the first frame."""
    return 1 + len(model.bodies)


def frame_bodies(model: Model) -> list[int]:
    """Per frame of the model its body, FIXED_BODY of one that stays where it is."""
    links = {frame.name: frame.link for frame in model.robot.frames}
    return [model.body_of[links.get(name, name)] for name in model.frames]


def jacobian_columns(model: Model, k: Any, frame: int) -> dict[int, list[Any]]:
    """Columns of a frame's Jacobian that do not vanish, six entries each, by their coordinates; of any arithmetic.

    Args:
        k: results of the program of frames, a sequence.
        frame: its number.
    """
    origins = POSE_SIZE * len(model.frames)
    axes, found = origins + 3 * len(model.bodies), dict[int, list[Any]]()
    body = frame_bodies(model)[frame]
    while body >= 0:
        here = model.bodies[body]
        arm = [k[POSE_SIZE * frame + 3 + 4 * i] - k[origins + 3 * body + i] for i in range(3)]
        for s in range(here.first, here.first + len(here.active)):
            axis = [k[axes + 3 * s + i] for i in range(3)]
            if model.coordinates[s].endswith((".alpha", ".beta", ".gamma")):
                found[s] = [axis[i] * arm[j] - axis[j] * arm[i] for i, j in ((1, 2), (2, 0), (0, 1))] + axis
            else:
                found[s] = [*axis, 0.0, 0.0, 0.0]
        body = here.parent
    return found


def _goals(model: Model) -> Iterator[tuple[int, Goal]]:
    """Places of the program's outputs, and where they belong; motors turn nothing, and nobody asks for their axes."""
    origins = POSE_SIZE * len(model.frames)
    axes = origins + 3 * len(model.bodies)
    for frame in range(len(model.frames)):
        for i in range(POSE_SIZE):
            yield POSE_SIZE * frame + i, Goal(first_frame(model) + frame, POSE, i)
    for number, body in enumerate(model.bodies):
        for i in range(3 * number, 3 * number + 3):
            yield origins + i, Goal(1 + number, ORIGINS, i)
        for i in range(3 * body.first, 3 * body.first + 3 * len(body.active)):
            yield axes + i, Goal(1 + number, AXES, i)
