"""Descriptions of joints that slide along beams, and of nodes along these."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

from eomgen import Robot
from eomgen.description.load import robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of

pytestmark = pytest.mark.quick

CRANE = """
name = "crane"
[[links]]
name = "bridge"
[links.beam]
axis = "{axis}"
length = 4.0
E = 7e10
G = 2.6e10
density = 2700
section = {{ tube = [0.1, 0.09] }}
modes = {{ y = 3, z = 2 }}
nodes = {{ quarter = 1.0, middle = 2.0 }}
[[links]]
name = "trolley"
mass = 5.0
[[joints]]
name = "rail"
parent = "base"
child = "bridge"
type = "prismatic"
[[joints]]
name = "cross"
parent = "bridge"
along = "beam"
child = "trolley"
type = "prismatic"
z = {{ damping = 2.0 }}
[[frames]]
name = "mid"
link = "bridge"
node = "middle"
"""


def crane(axis: str = "x") -> Robot:
    return robot_from_toml(CRANE.format(axis=axis))


def test_a_joint_along_a_beam_is_two() -> None:
    """It slides along the straight axis, and stands where the beam is deflected to; limits are the beam's ends."""
    robot = crane()
    slides, place = robot.joint("cross"), robot.joint("bridge_cross")
    assert (slides.parent, slides.child, slides.type) == ("bridge", "bridge_cross", "prismatic")
    assert (place.parent, place.child, place.type) == ("bridge_cross", "trolley", "fixed")
    assert slides.limits == (0.0, 4.0)
    assert slides.coordinates["z"].damping == 2.0
    assert list(place.coordinates) == ["x", "y", "z", "beta", "gamma"]
    assert robot.nodes == {"bridge_tip": "bridge", "bridge_quarter": "bridge", "bridge_middle": "bridge"} | {
        "bridge_cross": "bridge"
    }
    model = build_model(robot)
    assert model.coordinates == ("rail.z", *(f"bridge.mode{k}" for k in range(1, 6)), "cross.z")
    assert model.leaders["bridge_cross.y"] == ("bridge.mode1", "bridge.mode2", "bridge.mode3", "cross.z")
    assert robot.frames[0].link == "bridge_middle"


@pytest.mark.parametrize("axis", ["x", "-y", "z"])
def test_where_a_joint_along_a_beam_is_at_a_node_they_move_alike(axis: str) -> None:
    robot = crane(axis)
    values = {f"bridge.mode{k}": 0.01 * k for k in range(1, 6)} | {"cross.z": 1.0}
    found = {name: coupling.value(lambda name: values.get(name, 0.0)) for name, coupling in robot.followers.items()}
    for kind in robot.joint("bridge_cross").coordinates:
        assert found[f"bridge_cross.{kind}"] == pytest.approx(found[f"bridge_quarter.{kind}"], rel=1e-11, abs=1e-15)
    turned = np.array(robot.joint("cross").placement.rotation) @ np.array(
        robot.joint("bridge_cross").placement.rotation
    )
    assert turned.tolist() == np.eye(3).tolist()
    along = np.array(robot.joint("cross").placement.rotation)[:, 2]
    assert along.tolist() == (np.array(robot.joint("bridge_quarter").placement.xyz)).tolist()


def test_changes_and_records() -> None:
    """Shapes follow numbers of the beam; through JSON and pickle nothing changes."""
    robot = crane()
    longer = robot.with_value("links.bridge.beam.length", 5.0)
    assert longer == robot_from_toml(CRANE.format(axis="x").replace("length = 4.0", "length = 5.0"))
    assert longer.joint("cross").limits == (0.0, 5.0)
    planar = robot.with_value("links.bridge.beam.modes.z", 0)
    assert list(planar.joint("bridge_cross").coordinates) == ["x", "y", "gamma"]
    assert planar.with_value("links.bridge.beam.modes.z", 2) == robot
    moved = robot.with_value("links.bridge.beam.nodes.middle", 2.5)
    assert moved.joint("bridge_middle").placement.xyz == (2.5, 0.0, 0.0)
    with pytest.raises(
        DescriptionError, match=r"beam\.nodes: its nodes would be 'tip', 'other'; allowed: .* 'quarter'"
    ):
        robot.with_value("links.bridge.beam.nodes", {"other": 1.0})
    with pytest.raises(DescriptionError, match=r"there is no 'quart' in links\.bridge\.beam\.nodes"):
        robot.with_value("links.bridge.beam.nodes.quart", 1.0)
    record = json.loads(json.dumps(record_of(robot)))
    assert robot_from_record(record, "") == robot
    assert pickle.loads(pickle.dumps(robot)) == robot


def test_rigid_robots_slide_along_straight_links() -> None:
    assert build_model(crane().rigid()).coordinates == ("rail.z", "cross.z")
