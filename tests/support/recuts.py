"""The same mechanism by another spanning tree: a cut joint is kept, and a joint of its loop is cut instead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, Loop, Placement, Robot
from tests.support.random_robots import Array

PLAIN = (("gamma",), ("z",))  # coordinates of joints that may be turned round: the inverse is of the same kind


@dataclass(frozen=True)
class Recut:
    """The other description; ``signs`` has its coordinates that the first one has, and how they count there.

    kept: name of the coordinate of the joint that was cut.  sense: of its angle beside that in the cut.
    cut: name of the coordinate that is cut now.
    """

    robot: Robot
    signs: Mapping[str, float]
    kept: str
    sense: float
    cut: str

    def spread(self, names: Sequence[str], values: Array, kept: float) -> Array:
        """Values of the first description's coordinates, (n,), by names, as those of the other one."""
        given = dict(zip(names, values, strict=True))
        order = build_model(self.robot).coordinates
        return np.array([kept if name == self.kept else self.signs[name] * given[name] for name in order])


def recuts(robot: Robot) -> Iterator[Recut]:
    """All other cuts of one joint."""
    parents = {joint.child: joint for joint in robot.joints}
    for loop in robot.loops:
        if loop.type != "revolute":
            continue
        for near, far in (loop.links, loop.links[::-1]):
            up = list(_upwards(parents, far))
            stop = {joint.name for joint in _upwards(parents, near)}
            for place, joint in enumerate(up):
                if joint.name in stop or not all(map(_may_turn, up[:place])):
                    break
                if tuple(joint.coordinates) == ("gamma",) and _is_bare(joint):
                    yield _recut(robot, loop, near, far, joint, up[:place])


def _upwards(parents: Mapping[str, Joint], link: str) -> Iterator[Joint]:
    while link in parents:
        yield parents[link]
        link = parents[link].parent


def _may_turn(joint: Joint) -> bool:
    """Whether the joint is one of the same kind when it is seen from its child."""
    if joint.motor is not None or any(joint.offset):
        return False
    kinds = tuple(joint.coordinates)
    symmetric = all(c == Coordinate(c.stiffness, c.damping, c.armature) for c in joint.coordinates.values())
    return not kinds or (kinds in PLAIN and symmetric)


def _is_bare(joint: Joint) -> bool:
    """Whether nothing but its axis would be lost with the joint."""
    return joint.motor is None and not any(joint.offset) and all(c == Coordinate() for c in joint.coordinates.values())


def _recut(robot: Robot, loop: Loop, near: str, far: str, cut: Joint, turned: list[Joint]) -> Recut:
    first, second = loop.placements if near == loop.links[0] else loop.placements[::-1]
    names = {joint.name for joint in turned}
    joints = [joint for joint in robot.joints if joint.name not in names | {cut.name}]
    links = list(robot.links)
    kept = Joint(loop.name, near, far, "revolute", first, coordinates={"gamma": Coordinate()})
    for joint, parent, child, behind in (
        (kept, near, far, second),
        *((replace(j, placement=Placement()), j.child, j.parent, j.placement) for j in turned),
    ):
        if not joint.coordinates:
            joints.append(replace(joint, parent=parent, child=child, placement=inverse(behind)))
            continue
        flange = f"flange_{joint.name}"
        links.append(Link(flange, 0.0, (0.0, 0.0, 0.0), (0.0,) * 6))
        joints.append(replace(joint, parent=parent, child=flange))
        joints.append(Joint(f"weld_{joint.name}", flange, child, "fixed", inverse(behind)))
    turn = np.eye(4)
    turn[:3, :3] = cut.axis_turn
    ends = (placed(pose(cut.placement) @ turn), placed(turn))
    other = Loop(cut.name, (cut.parent, cut.child), "revolute", ends)
    signs = {
        f"{joint.name}.{key}": -1.0 if joint.name in names else 1.0
        for joint in robot.joints
        if joint.name != cut.name
        for key in joint.all_coordinates
    }
    changed = replace(
        robot,
        name=f"{robot.name}_recut",
        links=tuple(links),
        joints=tuple(_depth_first(robot.base, joints)),
        loops=tuple(other if one.name == loop.name else one for one in robot.loops),
    )
    sense = 1.0 if near == loop.links[0] else -1.0
    return Recut(changed, signs, f"{loop.name}.gamma", sense, f"{cut.name}.gamma")


def _depth_first(link: str, joints: list[Joint]) -> Iterator[Joint]:
    for joint in joints:
        if joint.parent == link:
            yield joint
            yield from _depth_first(joint.child, joints)


def pose(placement: Placement) -> Array:
    """A placement as a homogeneous matrix, (4, 4)."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = placement.rotation, placement.xyz
    return result


def placed(X: Array) -> Placement:
    """A homogeneous matrix, (4, 4), as a placement."""
    rotation = tuple(tuple(float(x) for x in row) for row in X[:3, :3])
    return Placement(tuple(float(x) for x in X[:3, 3]), rotation)  # type: ignore[arg-type]


def inverse(placement: Placement) -> Placement:
    """The pose of the first frame in the placed one."""
    return placed(np.linalg.inv(pose(placement)))
