"""Choose body frames that leave fewer numbers: a frame may move along, and turn about, its joint's axis.

A shift along z changes nothing for a joint whose only coordinates are z and gamma.  A turn about z is a constant added
to gamma, the last rotation of a joint: behind gamma it turns the body's frame (a leaf's first moment comes to lie along
x, a child's axis into the y-z plane), in front of it the joint's frame, which takes the last of the angles
Rz(a) Rx(b) Rz(c) out of a placement.  Placements that are run-time parameters stay as they are; an inertia that is one
moves along, which costs the setup alone.  Kernels that report in body axes (reactions, poses) use the description's
frames.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import Model

from .bound import Bound, BoundBody, BoundElement, Cuts
from .spatial import ZERO, Mat, Pose, Scalar, about, add, congruence, dot, mat3, matmul, matvec, scale, transpose
from .traced import Traced

AXIS = 2  # the principal axis
ROUND_OFF = 2e-15  # entries of a turned placement that miss 0, 1 or -1 by less are meant to be these
VECTORS = 5  # so many are turned by a placement, so many products go with a component of an offset


def choose_frames(model: Model, bound: Bound) -> Bound:
    """Shift and turn body frames where that leaves fewer non-zero numbers."""
    bodies, offsets, elements, cuts = list(bound.bodies), list(bound.angle_offsets), bound.elements, bound.cuts
    for k, body in enumerate(model.bodies):
        if bodies[k].modal is not None:  # whose constants are those of its frame
            continue
        children = model.children(k)
        plain = _plain(bodies, [k]) and set(body.active) <= {"z", "gamma"}
        if plain and "gamma" in body.active:
            angle = _last_angle(bodies[k].placement.rotation)
            if angle:
                bodies[k] = replace(bodies[k], placement=_turned(bodies[k].placement, -angle))
                angle = Traced(angle, f"joints.{body.joint}.placement, angle c of Rz(a) Rx(b) Rz(c)")
                offsets[body.indices[-1]] += angle
        if not _plain(bodies, children):
            continue
        if plain:
            shift = _best_shift(bodies, k, children)
            if shift:
                by = Pose(IDENTITY, (0.0, 0.0, shift))
                _move(bodies, k, children, by, placed=True)
                elements, cuts = _elements_moved(elements, k, by), _cuts_moved(cuts, k, by)
        if "gamma" in body.active:
            angle = _best_turn(bodies, children) if children else _turn_onto_x(bound, bodies, k)
            if angle:
                by = Pose(_about_z(angle), ZERO)
                _move(bodies, k, children, by, placed=False)
                elements, cuts = _elements_moved(elements, k, by), _cuts_moved(cuts, k, by)
                angle = Traced(angle, f"frame of {body.joint}, angle about z that leaves fewest terms")
                offsets[body.indices[-1]] += angle
                if not children:
                    x, _, z = bodies[k].inertia.first
                    bodies[k] = replace(bodies[k], inertia=replace(bodies[k].inertia, first=(x, 0.0, z)))
    return replace(bound, bodies=tuple(bodies), angle_offsets=tuple(offsets), elements=elements, cuts=cuts)


def _about_z(angle: float) -> Mat:
    return about(AXIS, math.sin(angle), math.cos(angle))


def _clean(x: float) -> float:
    """Return the number, or 0, 1 or -1 where it is that but for round-off."""
    nearest = float(round(x))
    return nearest if abs(x - nearest) < ROUND_OFF and abs(nearest) <= 1.0 else x


def _turned(pose: Pose, angle: float) -> Pose:
    """Turn a pose's frame about its z."""
    turned = (pose @ Pose(_about_z(angle), ZERO)).rotation
    return Pose(mat3(map(_clean, row) for row in turned), pose.origin)


def _move(bodies: list[BoundBody], k: int, children: Sequence[int], by: Pose, *, placed: bool) -> None:
    """Move body k's frame by ``pose``, in its axes; ``placed``: the joint's placement moves too."""
    back = _back(by)
    placement = bodies[k].placement @ by if placed else bodies[k].placement
    bodies[k] = replace(bodies[k], placement=placement, inertia=congruence(back, bodies[k].inertia))
    for child in children:
        moved = back @ bodies[child].placement
        if not placed:
            *across, z = moved.origin
            size = ROUND_OFF * math.hypot(*across)
            x, y = (0.0 if abs(component) <= size else component for component in across)
            moved = Pose(_turned(moved, 0.0).rotation, (x, y, z))
        bodies[child] = replace(bodies[child], placement=moved)


def _back(by: Pose) -> Pose:
    """Invert a pose."""
    back = transpose(by.rotation)
    return Pose(back, scale(-1.0, matvec(back, by.origin)))


def _elements_moved(
    elements: Mapping[str, tuple[BoundElement, ...]], k: int, by: Pose
) -> dict[str, tuple[BoundElement, ...]]:
    """Return the force elements with their ends on body k as seen from its moved frame."""
    back = transpose(by.rotation)

    def seen(end: tuple[int, Pose]) -> tuple[int, Pose]:
        if end[0] != k:
            return end
        origin = matvec(back, add(end[1].origin, scale(-1.0, by.origin)))
        turned = _cleaned(Pose(matmul(back, end[1].rotation), ZERO)).rotation
        return k, Pose(turned, origin)

    return {
        table: tuple(replace(x, ends=(seen(x.ends[0]), seen(x.ends[1]))) for x in bound)
        for table, bound in elements.items()
    }


def _cuts_moved(cuts: Cuts, k: int, by: Pose) -> Cuts:
    """Return the loops' cut frames with those on body k as seen from its moved frame."""

    def seen(side: tuple[int, Pose]) -> tuple[int, Pose]:
        return (k, _cleaned(_back(by) @ side[1])) if side[0] == k else side

    return tuple((seen(a), seen(b)) for a, b in cuts)


def _cleaned(pose: Pose) -> Pose:
    """Remove round-off from entries of a pose that are meant to be 0, 1 or -1, where it is one of numbers."""
    if not all(isinstance(x, float) for row in (*pose.rotation, pose.origin) for x in row):
        return pose
    size = ROUND_OFF * math.hypot(*pose.origin)
    x, y, z = (0.0 if abs(component) <= size else component for component in pose.origin)
    return Pose(_turned(pose, 0.0).rotation, (x, y, z))


def _best_shift(bodies: list[BoundBody], k: int, children: Sequence[int]) -> float:
    """Return the shift along z that leaves fewest non-zero components in placements around body k; 0 in doubt."""
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


def _last_angle(R: Mat) -> float:
    """Return c of R = Rz(a) Rx(b) Rz(c), less right angles, which cost nothing; 0 where nothing is gained."""
    c = math.atan2(R[2][0], R[2][1]) if R[2][0] or R[2][1] else math.atan2(R[1][0], R[0][0])
    c -= round(c / (math.pi / 2)) * (math.pi / 2)
    turned = _turned(Pose(R, ZERO), -c).rotation
    return c if _entries(turned) < _entries(R) else 0.0


def _entries(R: Mat) -> int:
    """Count entries that cost a product."""
    return sum(x not in (-1.0, 0.0, 1.0) for row in R for x in row)


def _best_turn(bodies: list[BoundBody], children: Sequence[int]) -> float:
    """Return the turn that brings a child's axis into the y-z plane, or its origin onto x, for fewer products."""
    poses = [bodies[child].placement for child in children]
    candidates = [0.0]
    for pose in poses:
        x, y = pose.rotation[0][AXIS], pose.rotation[1][AXIS]
        if x and y:
            candidates.append(math.atan2(x, -y))
        if pose.origin[0] and pose.origin[1]:
            candidates.append(math.atan2(pose.origin[1], pose.origin[0]))

    def cost(angle: float) -> float:
        back, total = _about_z(-angle), 0.5 * (angle != 0.0)
        for pose in poses:
            R = _turned(Pose(back, ZERO) @ pose, 0.0).rotation
            R = _turned(Pose(R, ZERO), -_last_angle(R)).rotation
            x, y, _ = (dot(row, pose.origin) for row in back)
            size = ROUND_OFF * math.hypot(x, y)
            total += VECTORS * (_entries(R) + (abs(x) > size) + (abs(y) > size))
        return total

    return min(candidates, key=cost)


def _turn_onto_x(bound: Bound, bodies: list[BoundBody], k: int) -> float:
    """Return the angle that brings a first moment across z onto x; 0 where nothing is gained, or masses decide."""
    first = bodies[k].inertia.first
    if not all(isinstance(x, float) for x in first):
        coms = [com for body, com in bound.coms.values() if body == k]
        first = coms[0] if len(coms) == 1 else ZERO
    x, y, _ = first
    plain = isinstance(x, float) and isinstance(y, float)
    return math.atan2(y, x) if plain and x != 0.0 and y != 0.0 else 0.0


def _plain(bodies: list[BoundBody], chosen: Sequence[int]) -> bool:
    """Whether placements are numbers."""
    poses = [bodies[i].placement for i in chosen]
    numbers: list[Scalar] = [x for pose in poses for row in (*pose.rotation, pose.origin) for x in row]
    return all(isinstance(x, float) for x in numbers)
