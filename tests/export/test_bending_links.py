"""Links that bend where others know none: refused by name, or said."""

from __future__ import annotations

from pathlib import Path

import pytest

import eomgen
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.export import export_mjcf
from eomgen.robot.model import build_model
from tests.support.bending_robots import bent
from tests.support.random_robots import random_robot


@pytest.mark.parametrize("approximate", [False, True])
def test_models_of_mujoco(tmp_path: Path, approximate: bool) -> None:
    """Without its modes the nodes of a link would move freely, so that nothing approximates it."""
    robot = bent(random_robot(1, (2, 2)), 1, (2,)).robot
    with pytest.raises(eomgen.InputError, match=r"links\.link1\.modes: no link of MuJoCo bends; allowed: .*beams"):
        export_mjcf(robot, tmp_path / "arm.xml", approximate=approximate)
    assert not list(tmp_path.iterdir())


def test_algorithms_of_the_textbook() -> None:
    model = build_model(bent(random_robot(1, (2, 2)), 1, (2,)).robot)
    assert "no links that bend (link1.mode1, " in unknown_to_textbook(model.tree)
