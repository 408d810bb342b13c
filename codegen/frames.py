"""Choose body frames that leave fewer numbers: a frame may move along, and turn about, its own joint's axis.

A shift along z changes nothing for a joint whose only coordinates are z and gamma; a turn about z is a constant added
to gamma, the last rotation of a joint.  Only plain numbers are changed: a placement or an inertia that is a run-time
parameter stays where it is.  Kernels that report in body axes (reactions, poses) use the description's frames.
"""

from __future__ import annotations

import math
from dataclasses import replace

from eomgen.model import Model
from eomgen.robot import IDENTITY

from .bodies import Bound, BoundBody, Pose, PseudoInertia, Scalar, Vec, add, congruence, dot, scale, transpose

AXIS = 2  # the principal axis


def choose_frames(model: Model, bound: Bound) -> Bound:
    """The same robot with body frames shifted and turned where that leaves fewer non-zero numbers."""
    bodies, offsets = list(bound.bodies), list(bound.angle_offsets)
    for k, body in enumerate(model.bodies):
        children = model.children(k)
        if set(body.active) <= {"z", "gamma"} and _plain(bodies, k, children):
            shift = _best_shift(bodies, k, children)
            if shift:
                _move(bodies, k, children, Pose(IDENTITY, (0.0, 0.0, shift)), placed=True)
        if "gamma" in body.active and not children and _is_plain(bodies[k].inertia):
            angle = _turn_onto_x(bodies[k].inertia.first)
            if angle:
                s, c = math.sin(angle), math.cos(angle)
                turn = ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))
                _move(bodies, k, children, Pose(turn, (0.0, 0.0, 0.0)), placed=False)
                first = bodies[k].inertia.first
                inertia = replace(bodies[k].inertia, first=(first[0], 0.0, first[2]))
                bodies[k] = replace(bodies[k], inertia=inertia)
                offsets[body.first + body.active.index("gamma")] = angle
    return replace(bound, bodies=tuple(bodies), angle_offsets=tuple(offsets))


def _move(bodies: list[BoundBody], k: int, children: list[int], by: Pose, *, placed: bool) -> None:
    """Move body k's frame by a pose given in that frame; ``placed``: the joint's placement moves too."""
    back_rotation = transpose(by.rotation)
    back = Pose(back_rotation, scale(-1.0, tuple(dot(row, by.origin) for row in back_rotation)))
    placement = bodies[k].placement @ by if placed else bodies[k].placement
    bodies[k] = BoundBody(placement, congruence(back, bodies[k].inertia))
    for child in children:
        bodies[child] = replace(bodies[child], placement=back @ bodies[child].placement)


def _best_shift(bodies: list[BoundBody], k: int, children: list[int]) -> float:
    """The shift along z that leaves fewest non-zero components in the placements around body k; 0 in doubt."""
    placement = bodies[k].placement
    axis = transpose(placement.rotation)[AXIS]
    origins = [bodies[child].placement.origin for child in children]
    candidates = [0.0, -dot(axis, placement.origin), *(origin[AXIS] for origin in origins)]

    def cost(shift: float) -> int:
        moved = [add(placement.origin, scale(shift, axis))]
        moved += [add(origin, (0.0, 0.0, -shift)) for origin in origins]
        return sum(component != 0.0 for origin in moved for component in origin)

    best: float = min(candidates, key=lambda shift: (cost(shift), shift != 0.0))
    return best


def _turn_onto_x(first: Vec) -> float:
    """Angle that brings a first moment's part across z onto x; 0 where nothing is gained."""
    return math.atan2(first[1], first[0]) if first[0] != 0.0 and first[1] != 0.0 else 0.0


def _plain(bodies: list[BoundBody], k: int, children: list[int]) -> bool:
    poses = [bodies[i].placement for i in (k, *children)]
    numbers: list[Scalar] = [x for pose in poses for row in (*pose.rotation, pose.origin) for x in row]
    return all(isinstance(x, float) for x in numbers) and _is_plain(bodies[k].inertia)


def _is_plain(H: PseudoInertia) -> bool:
    numbers = [*(x for row in H.second for x in row), *H.first, H.mass]
    return all(isinstance(x, float) for x in numbers)
