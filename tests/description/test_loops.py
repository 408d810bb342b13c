"""Reading of [[loops]]: forces and offsets of cut joints, and what of them is a parameter."""

from __future__ import annotations

from pathlib import Path

import pytest

from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Robot

pytestmark = pytest.mark.quick

HEAD = """
name = "window"
tunable = {tunable}
[[links]]
name = "crank"
mass = 1.0
[[links]]
name = "rocker"
mass = 1.0
[[joints]]
name = "turn"
parent = "base"
child = "crank"
type = "revolute"
[[joints]]
name = "swing"
parent = "base"
child = "rocker"
type = "revolute"
[[loops]]
name = "pin"
links = ["crank", "rocker"]
type = "revolute"
placements = [{{ xyz = [1.0, 0.0, 0.0], rpy = [0.0, 0.1, 0.0] }}, {{}}]
"""


def read(keys: str, tunable: str = "[]", folder: Path | None = None) -> Robot:
    return robot_from_toml(HEAD.format(tunable=tunable) + keys, folder=folder)


def test_every_key_of_a_coordinate(tmp_path: Path) -> None:
    (tmp_path / "measured.csv").write_text("x,force\n-1,-5\n1,7\n")
    robot = read(
        """
        x = { stiffness = 1e7, damping = 2e3, stiffness_negative = 2e7, cubic = 3.0, clearance = 2e-5, preload = 4.0 }
        y = { curve = "measured.csv" }
        z = { exponential = { force = 1.0, scale = 0.1 } }
        gamma = { friction = { coulomb = 1.0 } }
        alpha = {}
        offset = { y = 1e-4, gamma = -0.1 }
        """,
        folder=tmp_path,
    )
    (loop,) = robot.loops
    assert tuple(loop.coordinates) == ("x", "y", "z", "alpha", "gamma")
    assert loop.coordinates["x"].clearance == 2e-5
    assert loop.coordinates["y"].curve == ((-1.0, -5.0), (1.0, 7.0))
    assert loop.coordinates["alpha"] == Coordinate()
    assert loop.offset == (None, 1e-4, None, None, None, -0.1)
    assert build_model(robot).constraints == ("pin.beta",)


def test_parameters_by_name() -> None:
    names = '["loops.pin.placements.0.xyz.0", "loops.*.placements.*.rpy", "loops.pin.z.stiffness"]'
    robot = read("z = { damping = 1.0 }\noffset = { x = 0.5 }", names)
    known = {name: value for name, value in build_model(robot).parameters.items() if name.startswith("loops.")}
    assert known == {
        "loops.pin.z.stiffness": 0.0,
        "loops.pin.z.damping": 1.0,
        "loops.pin.offset.x": 0.5,
        "loops.pin.placements.0.xyz.0": 1.0,
        "loops.pin.placements.0.rpy.0": 0.0,
        "loops.pin.placements.0.rpy.1": 0.1,
        "loops.pin.placements.0.rpy.2": 0.0,
    }
    with pytest.raises(DescriptionError, match=r"loops\.pin\.z\.mass.*no parameter has this name.*loops\.LOOP"):
        read("z = {}", '["loops.pin.z.mass"]')


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("x = { armature = 1.0 }", r"loops\.pin\.x: unknown key 'armature' \(allowed: stiffness, damping, preload"),
        ('x = { role = "prescribed" }', r"loops\.pin\.x: unknown key 'role' \(allowed: stiffness"),
        ('prescribed = ["x"]', r"loops\.pin: unknown key 'prescribed' \(allowed: name, links, nodes, type"),
        ("limits = [0.0, 1.0]", r"loops\.pin: unknown key 'limits' \(allowed: "),
        ("x = { clearance = 0.1 }", r"loops\.pin\.x\.clearance: there is no stiffness at the end of it; allowed: "),
        ("x = { stiffness = -1.0 }", r"loops\.pin\.x\.stiffness: got -1\.0; allowed: a number that is at least 0"),
        ("x = 3.0", r"loops\.pin\.x: got 3\.0; allowed: a table with the keys"),
        ('x = { curve = "a.csv" }', r"loops\.pin\.x\.curve: got 'a\.csv'; allowed: the path of a \.csv file"),
        ("delta = {}", r"loops\.pin: unknown key 'delta'"),
        ("offset = { x = nan }", r"loops\.pin\.offset\.x: got nan; allowed: a finite number"),
    ],
)
def test_bad_keys(keys: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        read(keys)
