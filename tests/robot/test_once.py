"""Models and rigid robots are worked out once for each robot."""

from __future__ import annotations

from dataclasses import replace

import pytest

import eomgen
from eomgen.errors import DescriptionError
from eomgen.once import KEPT, kept
from eomgen.robot import build_model


def test_a_robot_has_one_model() -> None:
    """An equal robot has its own: its numbers may have other signs of zero."""
    robot = eomgen.load_robot("puma560_elastic")
    assert build_model(robot) is build_model(robot)
    assert build_model(robot, with_followers=True) is not build_model(robot)
    assert robot.rigid() is robot.rigid()
    assert build_model(robot.rigid()) is build_model(robot.rigid())
    other = replace(robot)
    assert other == robot
    assert build_model(other).robot is other


def test_errors_are_raised_each_time() -> None:
    robot = replace(eomgen.load_robot("one_link"), name="no name")
    for _ in range(2):
        with pytest.raises(DescriptionError, match="no name"):
            build_model(robot)


def test_what_is_kept_is_bounded() -> None:
    calls: list[object] = []
    function = kept(lambda owner: calls.append(owner))
    owners = [object() for _ in range(KEPT + 1)]
    for owner in (*owners, *owners[1:], owners[0]):
        function(owner)
    assert calls == [*owners, owners[0]]
