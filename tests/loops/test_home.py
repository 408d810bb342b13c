"""Homes of the built-in mechanisms close them."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.description.load import builtin_robots
from eomgen.robot.model import build_model
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")
CLOSED = [name for name in builtin_robots() if eomgen.load_robot(name).loops]


@pytest.mark.parametrize("name", CLOSED)
def test_home_closes(name: str, built: Build) -> None:
    robot = eomgen.load_robot(name)
    model = build_model(robot)
    kernel = built(robot, "constraint")
    q = np.array(model.home)
    assert np.abs(kernel.constraint(q)).max() <= 1e-15
    assert robot.driven is not None
    assert len(model.driven) == {"gough": 6}.get(name, 1)
