"""Checks of a whole Robot that readers of descriptions make piece by piece: for one that comes from elsewhere.

``robot.model`` refuses what needs the model (names of identifiers, forces that go together, loops, springs).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NoReturn

from ..errors import DescriptionError
from ..names import show
from .bounds import limits_conflict
from .geometry import Matrix, Placement
from .joint_types import OWN_COORDINATES
from .parameter_names import least_of
from .value import COORDINATES, Joint, Robot, sensor_conflict

_TURNED = 1e-6  # that a rotation's R R^T may be off the identity: some decimals of a text


def check_values(robot: Robot) -> None:
    """Refuse duplicate names, joints of no type, matrices that are no rotations, numbers out of their range.

    Raises:
        DescriptionError: with the place, what came and what is allowed.
    """
    kinds = ("links", "joints", "frames", "loops", "couplings", "beams")
    groups = [[(kind, item.name) for item in getattr(robot, kind)] for kind in kinds]
    for group in (*groups, [(element.TABLE, element.name) for element in robot.link_elements]):
        seen = set[str]()
        for kind, name in group:
            if name in seen or (kind == "links" and name == robot.base):
                _fail(robot, kind, f"the name {show(name)} is there twice; allowed: unique names")
            seen.add(name)
    for joint in robot.joints:
        _check_joint(robot, joint)
    for loop in robot.loops:
        if len(loop.offset) != len(COORDINATES):
            _fail(robot, f"loops.{loop.name}.offset", f"got {len(loop.offset)} numbers; allowed: {len(COORDINATES)}")
    for beam in robot.beams:
        conflict = beam.conflict()
        if conflict is not None:
            _fail(robot, ".".join(filter(None, ("beams", beam.name, conflict[0]))), conflict[1])
    for link in robot.links:
        for part, made in (("modes", link.modes), ("beam", link.beam)):
            conflict = None if made is None else made.conflict()
            if conflict is not None:
                _fail(robot, ".".join(filter(None, ("links", link.name, part, conflict[0]))), conflict[1])
    for sensor in robot.sensors:
        wrong = sensor_conflict(robot, sensor)
        if wrong is not None:
            _fail(robot, "sensors", wrong)
    for where, rotation in _rotations(robot):
        if not _turns(rotation):
            _fail(robot, where, "the axes are no rotation; allowed: orthogonal axes of length 1, right-handed")
    for name, value in robot.numbers():
        least = least_of(name)
        if value is not None and least is not None and value < least:
            _fail(robot, name, f"got {show(value)}; allowed: a number that is at least {least:g}")


def _check_joint(robot: Robot, joint: Joint) -> None:
    where = f"joints.{joint.name}"
    if joint.type not in OWN_COORDINATES:
        _fail(robot, f"{where}.type", f"got {show(joint.type)}; allowed: {', '.join(OWN_COORDINATES)}")
    if len(joint.offset) != len(COORDINATES):
        _fail(robot, f"{where}.offset", f"got {len(joint.offset)} numbers; allowed: {len(COORDINATES)}")
    if joint.limits is not None and not joint.principal:
        _fail(robot, f"{where}.limits", f"a {joint.type} joint has no principal coordinate; allowed: none")
    for name in joint.all_coordinates:
        conflict = limits_conflict(joint.limits_of(name))
        if conflict is not None:
            _fail(robot, f"{where}.{name}.{conflict[0]}", conflict[1])


def _rotations(robot: Robot) -> Iterator[tuple[str, Matrix]]:
    for joint in robot.joints:
        yield f"joints.{joint.name}.placement", joint.placement.rotation
        yield f"joints.{joint.name}.axis_turn", joint.axis_turn
    for frame in robot.frames:
        yield f"frames.{frame.name}.placement", frame.placement.rotation
    for beam in robot.beams:
        yield f"beams.{beam.name}.placement", beam.placement.rotation
    for loop in robot.loops:
        for place, placement in enumerate(loop.placements):
            yield f"loops.{loop.name}.placements[{place}]", placement.rotation
    for element in robot.link_elements:
        for key, end in element.ends().items():
            if isinstance(end, Placement):
                yield f"{element.prefix}.{key}", end.rotation


def _turns(rotation: Matrix) -> bool:
    import numpy as np

    R = np.array(rotation)
    return bool(np.abs(R @ R.T - np.eye(3)).max() <= _TURNED and np.linalg.det(R) > 0.0)


def _fail(robot: Robot, where: str, message: str) -> NoReturn:
    raise DescriptionError(message, where=where, source=robot.source or robot.name)
