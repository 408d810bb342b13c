"""Robots that a file of eomgen's keeps as a record, with the checks of descriptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import DescriptionError
from ..robot.checks import check_values
from ..robot.model import build_model
from ..robot.parameter_names import expand_tunable
from ..robot.record import robot_of
from ..robot.value import Robot
from .draft import Draft, ordered_joints


def robot_from_record(record: Mapping[str, Any], source: str) -> Robot:
    """Return the robot of a record by ``robot.record.record_of``; ``source`` names the file in messages.

    Inertias are taken as they are: the policy was applied when the description was read.

    Raises:
        InputError: it is no such record.
        DescriptionError: it is a robot that no description could be: a link without its joint, a negative mass ...
    """
    robot = robot_of(record)
    try:
        _check(robot)
    except DescriptionError as error:
        error.source = source
        raise
    return robot


def _check(robot: Robot) -> None:
    check_values(robot)
    draft = Draft(
        robot.source,
        robot.name,
        robot.base,
        links={link.name: link for link in robot.links},
        joints={joint.name: joint for joint in robot.joints},
        frames={frame.name: frame for frame in robot.frames},
        loops={loop.name: loop for loop in robot.loops},
        couplings={coupling.name: coupling for coupling in robot.couplings},
        elements={element.name: element for element in robot.link_elements},
    )
    ordered_joints(draft)
    reached = {robot.base}
    for joint in robot.joints:
        if joint.parent not in reached:
            draft.fail(f"joints.{joint.name}", "it comes before the joint of its parent; allowed: from the base on")
        reached.add(joint.child)
    draft.check_ends()
    build_model(robot)
    expand_tunable(robot, robot.tunable)
