"""Springs between points in descriptions: what is read, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import eomgen
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.value import Spring
from tests.support.description_samples import ARM, URDF
from tests.support.pendulums import pendulum

pytestmark = pytest.mark.quick


def test_descriptions_are_read(tmp_path: Path) -> None:
    """Defaults, a curve from a CSV file, the base of a URDF, and names of tunable numbers."""
    text = ARM.replace(
        "[[frames]]",
        """[[springs]]
name = "cable"
links = ["base", "link2"]
points = [[0, 1, 2], [0.5, 0, 0]]
free_length = 2.0
stiffness = 10
tension_only = true
[[springs]]
name = "gas"
links = ["link1", "base"]
curve = "gas.csv"
damping = 3
[[frames]]""",
    ).replace("tunable = [", 'tunable = ["springs.gas.free_length", "springs.*.points.1", ')
    (tmp_path / "gas.csv").write_text("elongation,force\n-0.1,-20\n0.0,5\n0.2,9\n", encoding="ascii")
    (tmp_path / "arm.toml").write_text(text, encoding="ascii")
    robot = eomgen.load_robot(tmp_path / "arm.toml")
    cable, gas = robot.springs
    assert cable == Spring(
        "cable", ("base", "link2"), ((0.0, 1.0, 2.0), (0.5, 0.0, 0.0)), 2.0, 10.0, None, True, 2e-4, None
    )
    assert gas == Spring("gas", ("link1", "base"), damping=3.0, curve=((-0.1, -20.0), (0.0, 5.0), (0.2, 9.0)))
    parameters = build_model(robot).parameters
    assert {name: value for name, value in parameters.items() if name.startswith("springs.")} == {
        "springs.cable.free_length": 2.0,
        "springs.cable.stiffness": 10.0,
        "springs.cable.smoothing": 2e-4,
        "springs.cable.points.1.x": 0.5,
        "springs.cable.points.1.y": 0.0,
        "springs.cable.points.1.z": 0.0,
        "springs.gas.free_length": 0.0,
        "springs.gas.damping": 3.0,
        "springs.gas.curve.0": -20.0,
        "springs.gas.curve.1": 5.0,
        "springs.gas.curve.2": 9.0,
        "springs.gas.points.1.x": 0.0,
        "springs.gas.points.1.y": 0.0,
        "springs.gas.points.1.z": 0.0,
    }
    refined = """urdf = "arm.urdf"
[[springs]]
name = "s"
links = ["base", "lower"]
stiffness = 1
"""
    (tmp_path / "arm.urdf").write_text(URDF, encoding="ascii")
    (tmp_path / "refined.toml").write_text(refined, encoding="ascii")
    assert eomgen.load_robot(tmp_path / "refined.toml").springs[0].links == ("ground", "lower")


def test_robots_made_by_hand_are_checked() -> None:
    base = Spring("s", ("base", "rod"))
    for spring, words in (
        (base, "springs.s: it has no force"),
        (replace(base, links=("base", "rot"), stiffness=1.0), "springs.s.links: got 'rot'; allowed: base, rod"),
        (replace(base, links=("rod", "rod"), stiffness=1.0), "springs.s.links: .*do not move against each other"),
        (replace(base, stiffness=1.0, tension_only=True), "springs.s.tension_only: there is no free_length"),
        (replace(base, name="a b", stiffness=1.0), "springs: got 'a b'"),
    ):
        with pytest.raises(DescriptionError, match=words):
            build_model(pendulum((spring,)))
