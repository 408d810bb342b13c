"""Homes of the built-in mechanisms close them."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.description.load import builtin_robots
from eomgen.robot.model import build_model
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")
DRIVES = {"delta": 3, "gough": 6}
CLOSED = [name for name in builtin_robots() if build_model(eomgen.load_robot(name)).constraints]


@pytest.mark.parametrize("name", CLOSED)
def test_home_closes(name: str, built: Build) -> None:
    robot = eomgen.load_robot(name)
    model = build_model(robot)
    kernel = built(robot, "constraint")
    q = np.array(model.home)
    assert np.abs(kernel.constraint(q)).max() <= 1e-15
    assert robot.driven is not None
    assert len(model.driven) == DRIVES.get(name, 1)


def test_home_of_an_elastic_mechanism(built: Build) -> None:
    """Nothing is rigid there: at home its cut joints are where their springs are at rest."""
    robot = eomgen.load_robot("hexapod_elastic")
    model = build_model(robot)
    assert (model.constraints, len(model.cut_laws), len(model.driven)) == ((), 36, 6)
    kernel = built(robot, "cut_poses")
    found = kernel.cut_forces(np.array(model.home), np.zeros(model.size)).reshape(6, 6, 2)
    assert np.abs(found[:, :3]).max() <= 1e-7
