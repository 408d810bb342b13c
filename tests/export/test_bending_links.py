"""Links that bend where others know none: refused by name, or said."""

from __future__ import annotations

from pathlib import Path

import pytest

import eomgen
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.cli.entry import main
from eomgen.export import export_mjcf
from eomgen.robot.model import build_model
from tests.support.bending_robots import bent
from tests.support.optional import OptionalModule
from tests.support.random_robots import random_robot

mujoco = OptionalModule("mujoco")


@pytest.mark.parametrize("approximate", [False, True])
def test_models_of_mujoco(tmp_path: Path, approximate: bool) -> None:
    """Without its modes the nodes of a link would move freely, so that nothing approximates it."""
    robot = bent(random_robot(1, (2, 2)), 1, (2,)).robot
    with pytest.raises(eomgen.InputError, match=r"links\.link1\.modes: no link of MuJoCo bends; allowed: .*beams"):
        export_mjcf(robot, tmp_path / "arm.xml", approximate=approximate)
    assert not list(tmp_path.iterdir())


def test_models_of_mujoco_by_segments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From Python and by the flag: bodies, joints and tendons of the chain; rigid links have none."""
    robot = eomgen.load_robot("flexible_arm")
    path = export_mjcf(robot, tmp_path / "arm.xml", step=1e-4, segments=2)
    model = mujoco.MjModel.from_xml_path(str(path))
    names = [model.joint(i).name for i in range(model.njnt)]
    of_segments = [f"{link}{k}.{key}" for link in ("upper", "forearm") for k in (1, 2) for key in ("y", "gamma")]
    assert names == ["shoulder.gamma", *of_segments[:4], "elbow.gamma", *of_segments[4:]]
    assert sum(model.body_mass) == pytest.approx(sum(x.mass for x in robot.links), rel=1e-12)
    words = ["export", "flexible_arm", "--mjcf", "--step", "1e-4", "-o", str(tmp_path / "same.xml"), "--segments"]
    assert main([*words, "2"]) == 0
    assert (tmp_path / "same.xml").read_bytes() == path.read_bytes()
    assert main([*words, "0"]) == 1
    assert "segments: got 0; allowed: a whole number from 1 to 100" in capsys.readouterr().err
    assert main(["export", "one_link", "--mjcf", "--segments", "2", "-o", str(tmp_path)]) == 1
    assert "no link of one_link bends by modes" in capsys.readouterr().err
    assert main(["export", "one_link", "--arrays", "--segments", "2", "-o", str(tmp_path)]) == 1
    assert "--segments: given without its format; allowed: with --mjcf" in capsys.readouterr().err


def test_algorithms_of_the_textbook() -> None:
    model = build_model(bent(random_robot(1, (2, 2)), 1, (2,)).robot)
    assert "no links that bend (link1.mode1, " in unknown_to_textbook(model.tree)
