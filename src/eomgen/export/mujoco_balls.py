"""Balls of MuJoCo: angles of joints that are damped alike in all directions, which the damping of hinges is not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..names import component_name
from ..robot.elements.joint_damping import JOINT_DAMPING, lag_of
from ..robot.elements.matrices import entry_name
from ..robot.value import ANGULAR, COORDINATES, Coordinate, Joint, Robot
from ..state.turning import quaternions


def balls(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Return coordinates that become one MuJoCo joint, by joint: three angles a ball, all six a free joint.

    Nothing else may act on these angles: their position is a quaternion there.
    """
    coupled = {name for coupling in robot.couplings for name in (coupling.of, *coupling.to)}
    joints: dict[str, tuple[str, ...]] = {}
    for joint in robot.joints:
        if joint.stiffness is None and not _on_hinges(joint) and _is_bare(joint, ANGULAR, coupled):
            floats = joint.parent == robot.base and not (robot.loops or robot.couplings)
            alike = joint.damping is not None and joint.damping.linear == joint.damping.angular
            whole = floats and alike and _is_bare(joint, COORDINATES, coupled)
            joints[joint.name] = COORDINATES if whole else ANGULAR
    return joints


def hinge_damping(joint: Joint, name: str) -> float:
    """Return the damping that a joint's as a whole adds to that of a slide or hinge; of a matrix its diagonal."""
    if joint.damping is None:
        return 0.0
    isotropic = (joint.damping.angular if name in ANGULAR else joint.damping.linear) or 0.0
    entry, stiffness = entry_name(name, name), joint.stiffness.entries if joint.stiffness else {}
    lag: float = lag_of(joint.damping.law())
    return isotropic + joint.damping.entries.get(entry, 0.0) + lag * stiffness.get(entry, 0.0)


def damped_otherwise(robot: Robot) -> Iterator[str]:
    """Yield notes on joints' damping that is neither a ball's nor that of hinges."""
    made = balls(robot)
    for joint in robot.joints:
        if joint.name not in made and not _on_hinges(joint):
            yield f"joints.{joint.name}.{JOINT_DAMPING}.angular: on each angle by itself"


def positions(robot: Robot, q: Sequence[float]) -> list[float]:
    """Convert coordinates, (n,), to MuJoCo's positions: a ball's is a quaternion."""
    made, rest, positions = balls(robot), list(q), list[float]()
    for joint in robot.joints:
        names = tuple(joint.all_coordinates)
        coordinates, rest = dict(zip(names, rest, strict=False)), rest[len(names) :]
        if joint.name in made:
            (turn,) = quaternions(np.array([[coordinates.pop(name) for name in ANGULAR]]))
            turned = [turn[0], *(np.array(joint.axis_turn) @ turn[1:])]
            positions += [*coordinates.values(), *(float(x) for x in turned)]
        else:
            positions += coordinates.values()
    return positions


def ball_values(joint: Joint) -> Mapping[str, str]:
    """Return attributes of the joint that stands for three angles, or for all six coordinates."""
    damping = joint.damping.angular if joint.damping else 0.0
    return {"name": joint.name, "damping": repr(damping)}


def _on_hinges(joint: Joint) -> bool:
    """Whether damping of a joint's turning is that of its angles by themselves: none goes round another's axis."""
    if joint.damping is None or not joint.damping.angular or not {"alpha", "gamma"} <= joint.coordinates.keys():
        return True
    return "beta" not in joint.coordinates and not joint.offset[COORDINATES.index("beta")]


def _is_bare(joint: Joint, names: Sequence[str], coupled: set[str]) -> bool:
    """Whether all these coordinates move, and nothing else acts on them or is added to them."""
    plain = Coordinate()
    bare = all(joint.coordinates.get(name) == plain for name in names)
    offsets = zip(COORDINATES, joint.offset, strict=True)
    apart = not any(component_name(joint.name, name) in coupled for name in names)
    return bare and apart and not any(offset for name, offset in offsets if name in names)
