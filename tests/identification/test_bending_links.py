"""Links that bend, where errors of poses are modelled: refused by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.identification import calibrate, poses, poses_from_columns
from eomgen.robot.value import Robot

ROWS = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 5))
MEASURED = dict(zip(("shoulder.gamma", "elbow.gamma", "tcp.x", "tcp.y", "tcp.z"), ROWS.T, strict=True))


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: calibrate(robot, poses_from_columns(MEASURED, [*MEASURED][:2], ["tcp"]), force=True),
        lambda robot: poses(robot, count=10, candidates=50, ranges=dict.fromkeys([*MEASURED][:2], (-1.0, 1.0))),
    ],
    ids=["calibrate", "poses"],
)
def test_errors_of_poses(ask: Callable[[Robot], Any]) -> None:
    """The most informative poses and calibrations; of the rigid robot they are known."""
    robot = eomgen.load_robot("flexible_arm")
    with pytest.raises(eomgen.InputError, match=r"links\.upper\.modes: .*rigid links alone; allowed: .*rigid\(\)"):
        ask(robot)
    assert ask(robot.rigid())
