"""Placements of cut joints as run-time parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.robot.parameter_names import expand_tunable
from eomgen.robot.value import Placement
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")
KERNELS = ("constraint", "constraint_jacobian")


def test_placements_of_a_cut_joint_can_be_tuned(built: Build) -> None:
    robot = eomgen.load_robot("four_bar")
    first, second = robot.loops[0].placements
    turned = (Placement.from_rpy((0.3, 0.0, 0.1), (0.1, 0.2, 0.0)), Placement.from_rpy(second.xyz, (0.0, 0.0, 0.0)))
    start = replace(robot, loops=(replace(robot.loops[0], placements=(replace(turned[0], xyz=first.xyz), turned[1])),))
    tuned = replace(start, tunable=expand_tunable(start, ["loops.joint4.placements"]))
    moved = replace(robot, loops=(replace(robot.loops[0], placements=turned),))
    kernel, wanted = built(tuned, *KERNELS), built(moved, *KERNELS)
    q = np.array([0.7, -0.4, 1.2])
    assert np.abs(kernel.constraint(q) - wanted.constraint(q)).max() > 0.05
    kernel.parameters["loops.joint4.placements.0.xyz.0"] = 0.3
    kernel.parameters["loops.joint4.placements.0.xyz.2"] = 0.1
    for name in KERNELS:
        assert getattr(kernel, name)(q) == pytest.approx(getattr(wanted, name)(q), abs=1e-14)
