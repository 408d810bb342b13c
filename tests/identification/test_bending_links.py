"""Links that bend, where errors of poses are modelled: refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.identification import calibrate, fit, poses, poses_from_columns, tolerance
from eomgen.robot.value import Robot

ROWS = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 5))
MEASURED = dict(zip(("shoulder.gamma", "elbow.gamma", "tcp.x", "tcp.y", "tcp.z"), ROWS.T, strict=True))
TABLE = {"joints.elbow.offset.gamma": {"deviation": 1e-4}}


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: calibrate(robot, poses_from_columns(MEASURED, [*MEASURED][:2], ["tcp"]), force=True),
        lambda robot: poses(robot, count=10, candidates=50, ranges=dict.fromkeys([*MEASURED][:2], (-1.0, 1.0))),
        lambda robot: tolerance(robot, TABLE),
    ],
    ids=["calibrate", "poses", "tolerance"],
)
def test_errors_of_poses(ask: Callable[[Robot], Any]) -> None:
    """Tolerances, the most informative poses and calibrations; of the rigid robot they are known."""
    robot = eomgen.load_robot("flexible_arm")
    with pytest.raises(eomgen.InputError, match=r"links\.upper\.modes: .*rigid links alone; allowed: .*rigid\(\)"):
        ask(robot)
    assert ask(robot.rigid())


def test_modes_are_not_fitted(tmp_path: Path) -> None:
    """Said of each, by default and where it is asked for."""
    robot = eomgen.load_robot("flexible_arm")
    motion = eomgen.simulate(robot, duration=0.05, rtol=1e-4).save(tmp_path / "motion.npz")
    for asked in ((), ("forearm.mode1",)):
        found = fit(robot, motion, coordinates=asked)
        assert not found.fitted
        names = asked or robot.modal_coordinates
        assert list(found.warnings) == [
            f"{name} is a mode of a link that bends, whose stiffness and damping are not fitted" for name in names
        ]
