"""The calibrated robot, as a value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...arrays import Array
from ...kernel.inverse_kinematics.rotations import rpy_of
from ...names import component_name, parameter_name
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS, JointStiffness
from ...robot.elements.matrices import PAIRS, entry_name, matrix_conflict
from ...robot.elements.matrices import matrix_of as rows_of
from ...robot.value import COORDINATES, MOTOR, Coordinate, Frame, Joint, Loop, Motor, Placement, Robot
from ..geometry.error_model import FRAMES, JOINTS, LOOPS, SECOND, TILT
from ..geometry.rotations import pose_from, pose_of
from ..geometry.stations import Chain, matrix_of

ENTRIES = tuple(entry_name(*pair) for pair in PAIRS)
OF_LINK = "_calibrated"  # behind the name of a link whose frame was measured: its placement is a new frame


def calibrated_robot(robot: Robot, chain: Chain, links: Mapping[str, str], values: Mapping[str, float]) -> Robot:
    """Return the robot with offsets, stiffness and placements of measured frames, by the names of parameters.

    links: of every measured frame, the link that it is on.
    """
    joints = tuple(_joint(joint, values) for joint in robot.joints)
    frames = {frame.name: frame for frame in robot.frames}
    taken = {robot.base, *(link.name for link in robot.links)}
    for name, link, pose in placements(links, values):
        new = name + OF_LINK if name in taken else name
        placement = placement_of(pose)
        frames[new] = replace(frames[new], placement=placement) if new in frames else Frame(new, link, placement)
    loops = tuple(_loop(loop, values) for loop in robot.loops)
    return replace(robot, joints=joints, frames=tuple(frames.values()), loops=loops)


def six_of(values: Mapping[str, float], *name: str) -> list[float | None]:
    """Return values of the six components of a name, such as ("joints", "joint1", "offset").

    None for those that were not fitted.
    """
    return [values.get(parameter_name(*name, kind)) for kind in COORDINATES]


def placements(links: Mapping[str, str], values: Mapping[str, float]) -> Iterator[tuple[str, str, Array]]:
    """Yield name, link and pose on it, (4, 4), of every measured frame with a calibrated placement."""
    for name, link in links.items():
        pose = six_of(values, FRAMES, name)
        if None not in pose:
            yield name, link, _pose(pose)


def offset_of(joint: Joint | Loop, values: Mapping[str, float]) -> dict[str, float]:
    """Return offsets of a joint, or of a loop joint, by its coordinates, m and rad: those that were fitted."""
    offset = six_of(values, JOINTS if isinstance(joint, Joint) else LOOPS, joint.name, "offset")
    return {kind: value for kind, value in zip(COORDINATES, offset, strict=True) if value is not None}


def tilt_of(joint: Joint, values: Mapping[str, float]) -> Array | None:
    """Return the rotation of a joint's first axis about its x, y and z as a pose, (4, 4).

    None where it was not fitted.
    """
    tilt = six_of(values, JOINTS, joint.name, TILT)
    return None if tilt == [None] * 6 else _pose(tilt)


def second_of(loop: Loop, values: Mapping[str, float]) -> Array | None:
    """Return the pose of a loop joint's frame on its second link, (4, 4), calibrated.

    None where nothing of it was fitted.
    """
    change = six_of(values, LOOPS, loop.name, SECOND)
    return np.asarray(matrix_of(loop.placements[1]) @ _pose(change)) if any(change) else None


def _pose(six: Sequence[float | None]) -> Array:
    return pose_from(np.array([value or 0.0 for value in six]))


def owner_of(joint: Joint | Loop) -> str:
    """Return with what names of a joint's parameters begin: "joints", or "loops" of a loop joint."""
    return JOINTS if isinstance(joint, Joint) else LOOPS


def motor_of(joint: Joint | Loop) -> Motor | None:
    """Return the motor of a joint; None where it has none, as a loop joint."""
    return joint.motor if isinstance(joint, Joint) else None


def stiffness_of(joint: Joint | Loop, values: Mapping[str, float]) -> dict[str, float]:
    """Return stiffness by coordinate, or "motor" for the transmission's, N/m and N m/rad: fitted and greater than 0.

    That of coordinates whose stiffness is described: elsewhere, at a driven coordinate say, it would be another spring.
    """
    described = [kind for kind, coordinate in joint.coordinates.items() if coordinate.stiffness is not None]
    described += [MOTOR] if motor_of(joint) is not None else []
    owner = owner_of(joint)
    keys = {kind: component_name(parameter_name(owner, joint.name, kind), "stiffness") for kind in described}
    return {kind: values[key] for kind, key in keys.items() if values.get(key, -1.0) > 0.0 and np.isfinite(values[key])}


def is_said(robot: Robot, values: Mapping[str, float], name: str) -> bool:
    """Return whether a description has a parameter's value: not the base's placement, or a term of a drive."""
    parts = name.split(".")
    if parts[0] not in (JOINTS, LOOPS):
        return parts[0] == FRAMES
    joint = robot.joint(parts[1]) if parts[0] == JOINTS else next(x for x in robot.loops if x.name == parts[1])
    if parts[2] == JOINT_STIFFNESS:
        return matrix_of_joint(joint, values) is not None
    return parts[2] in ("offset", TILT, SECOND) or (
        parts[-1] == "stiffness" and parts[2] in stiffness_of(joint, values)
    )


def matrix_of_joint(joint: Joint | Loop, values: Mapping[str, float]) -> JointStiffness | None:
    """Return the stiffness matrix of a joint with fitted entries, into which the tables of their coordinates go.

    None where none was fitted, or where no description can say it: coordinates that it does not have, tables whose
    stiffness is no linear spring, a matrix that is not positive semidefinite.
    """
    fitted = fitted_entries(joint, values)
    ends = {name for key in fitted for name in key.split(".")}
    names = [name for name in COORDINATES if name in joint.coordinates]
    if not fitted or not ends.issubset(names) or not all(np.isfinite(x) for x in fitted.values()):
        return None
    if isinstance(joint, Joint) and joint.motor is not None and joint.principal in ends:
        return None  # its transmission's stiffness is in the entry
    if any(joint.coordinates[name].law().keys() & {"clearance", "stiffness_negative"} for name in ends):
        return None
    old = joint.stiffness or JointStiffness()
    own = {entry_name(name, name): joint.coordinates[name].stiffness or 0.0 for name in ends}
    whole = {key: old.entries.get(key, 0.0) + stiffness for key, stiffness in own.items()}  # where they stay
    made = replace(old, entries={**old.entries, **whole, **fitted})
    return None if matrix_conflict(rows_of(made.entries, names), names) else made


def fitted_entries(joint: Joint | Loop, values: Mapping[str, float]) -> dict[str, float]:
    """Return the fitted entries of a joint's stiffness matrix, by their names, "x.beta"."""
    pairs = {key: values.get(parameter_name(owner_of(joint), joint.name, JOINT_STIFFNESS, key)) for key in ENTRIES}
    return {key: value for key, value in pairs.items() if value is not None}


def taken_in(joint: Joint | Loop, matrix: JointStiffness | None, values: Mapping[str, float]) -> list[str]:
    """Return the coordinates whose tables' stiffness has gone into the joint's matrix."""
    ends = {name for key in fitted_entries(joint, values) for name in key.split(".")} if matrix is not None else ()
    return [name for name in ends if joint.coordinates[name].stiffness is not None]


def placement_of(pose: Array) -> Placement:
    """Return a pose, (4, 4), as a placement with roll, pitch and yaw."""
    x, y, z = (float(value) for value in pose[:3, 3])
    roll, pitch, yaw = (float(value) for value in rpy_of(pose[:3, :3]))
    return Placement.from_rpy((x, y, z), (roll, pitch, yaw))


def _loop(loop: Loop, values: Mapping[str, float]) -> Loop:
    fitted = offset_of(loop, values)
    offset = tuple(fitted.get(k, old) for k, old in zip(COORDINATES, loop.offset, strict=True))
    second = second_of(loop, values)
    placed = loop.placements if second is None else (loop.placements[0], placement_of(second))
    coordinates, stiffness = _springs(loop, values)
    return replace(loop, offset=offset, placements=placed, coordinates=coordinates, stiffness=stiffness)


def _springs(joint: Joint | Loop, values: Mapping[str, float]) -> tuple[dict[str, Coordinate], JointStiffness | None]:
    """Return a joint's coordinates and its stiffness matrix with what was fitted."""
    coordinates = dict(joint.coordinates)
    for kind, value in stiffness_of(joint, values).items():
        if kind != MOTOR:
            coordinates[kind] = replace(coordinates[kind], stiffness=value)
    matrix = matrix_of_joint(joint, values)
    for kind in taken_in(joint, matrix, values):
        coordinates[kind] = replace(coordinates[kind], stiffness=None)
    return coordinates, joint.stiffness if matrix is None else matrix


def _joint(joint: Joint, values: Mapping[str, float]) -> Joint:
    fitted, tilt = offset_of(joint, values), tilt_of(joint, values)
    placement = joint.placement if tilt is None else placement_of(_tilted(joint, tilt))
    offset = tuple(fitted.get(kind, before) for kind, before in zip(COORDINATES, joint.offset, strict=True))
    (coordinates, stiffness), motor = _springs(joint, values), joint.motor
    value = stiffness_of(joint, values).get(MOTOR)
    if value is not None and motor is not None:
        motor = replace(motor, transmission=replace(motor.transmission, stiffness=value))
    made = replace(joint, offset=offset, coordinates=coordinates, motor=motor, placement=placement)
    return replace(made, stiffness=stiffness)


def _tilted(joint: Joint, tilt: Array) -> Array:
    """Return the placement of a joint whose first axis is tilted about its x, y and z, (4, 4)."""
    turn = pose_of(joint.axis_turn)
    return np.asarray(matrix_of(joint.placement) @ turn @ tilt @ turn.T)
