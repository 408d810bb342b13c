"""Beams in descriptions, and joints that slide along them: what is read, what becomes of them, what is refused."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import Robot
from eomgen.authoring.check import check_file
from eomgen.description.load import robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError, InputError
from eomgen.identification.dynamics.as_toml import write_toml
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot import Beam
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash
from eomgen.robot.value import COORDINATES, Placement
from tests.support.beams import SIZES, STEEL, cantilever, toml
from tests.support.description_samples import URDF
from tests.support.refusals import refused

pytestmark = pytest.mark.quick
EXAMPLE = Path(__file__).parents[2] / "examples" / "flexible_boom.toml"
SECTION: dict[str, Any] = {**dict.fromkeys(SIZES), "section": {"tube": [0.06, 0.05]}}


def test_the_example_is_read() -> None:
    """A chain of links that fixed joints end, in the order of the tree; all of it named after the beam."""
    robot = eomgen.load_robot(EXAMPLE)
    names = [f"boom{k}" for k in range(7)]
    assert [joint.name for joint in robot.joints] == ["slew", *names, "boom_tip", "wrist"]
    assert [link.name for link in robot.links] == ["turntable", *names, "head", "gripper"]
    assert build_model(robot).coordinates == (
        "slew.gamma",
        *(f"{name}.{key}" for name in names[1:] for key in COORDINATES),
        "wrist.gamma",
    )
    assert robot.rigid().beams == ()
    assert build_model(robot.rigid()).coordinates == ("slew.gamma", "wrist.gamma")
    checked = check_file(EXAMPLE)
    assert (checked.errors, checked.notes) == ((), ())
    assert checked.summary == {"links": 10, "coordinates": 38}
    (beam,) = robot.beams
    assert beam.mass == pytest.approx(2700.0 * math.pi / 4 * (0.06**2 - 0.05**2) * 2.0)


def test_stiffness_and_damping_of_a_segment() -> None:
    """The formulas of the middle of a segment; damping proportional to each."""
    E, G, l = STEEL["E"], STEEL["G"], 1.3 / 4  # noqa: E741
    py, pz = (12 * E * I / (G * 2e-3 * k * l**2) for I, k in ((3e-7, 0.8), (4e-7, 0.6)))  # noqa: E741
    stiffness = {
        "x": E * 2e-3 / l,
        "y": 12 * E * 3e-7 / (l**3 * (1 + py)),
        "z": 12 * E * 4e-7 / (l**3 * (1 + pz)),
        "alpha": G * 5e-7 / l,
        "beta": E * 4e-7 / l,
        "gamma": E * 3e-7 / l,
    }
    w = 2 * math.pi * 40.0
    for damping, factors in (
        (None, [0.0] * 6),
        ({"ratio": 0.02, "at_hz": 40.0}, [2 * 0.02 / w] * 6),
        ({"loss_factor": 0.02, "at_hz": 40.0}, [0.02 / w] * 6),
        (1e-4, [1e-4] * 6),
        (0, [0.0] * 6),
        ([1e-4, 0, 0, 2e-4, 3e-4, 4e-4], [1e-4, 0, 0, 2e-4, 3e-4, 4e-4]),
    ):
        robot = cantilever(segments=4, damping=damping)
        for name in ("boom1", "boom4"):
            for (key, wanted), factor in zip(stiffness.items(), factors, strict=True):
                coordinate = robot.joint(name).coordinates[key]
                assert coordinate.stiffness == pytest.approx(wanted, rel=1e-13)
                assert (coordinate.damping or 0.0) == pytest.approx(factor * wanted, rel=1e-13)
                assert (coordinate.damping is None) == (factor == 0.0)


def test_numbers_beside_a_section_stand_in_the_place_of_its_own() -> None:
    """Also shear coefficients, which then need no Poisson's ratio."""
    plain = cantilever(**SECTION).beams[0]
    J, nu = math.pi / 32 * (0.06**4 - 0.05**4), STEEL["E"] / (2 * STEEL["G"]) - 1
    square = (1 + (5 / 6) ** 2) ** 2
    shear = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * (5 / 6) ** 2)
    assert (plain.J, *plain.shear) == pytest.approx((J, shear, shear))
    changed = cantilever(**{**SECTION, "J": 1e-6, "shear": [0.4, 0.3], "G": 1e9}).beams[0]
    assert (changed.A, changed.Iy, changed.Iz) == (plain.A, plain.Iy, plain.Iz)
    assert (changed.J, changed.shear, changed.G) == (1e-6, (0.4, 0.3), 1e9)


def test_rigid_coordinates_are_none() -> None:
    robot = cantilever(segments=3, rigid=["x", "alpha"])
    assert list(robot.joint("boom2").coordinates) == ["y", "z", "beta", "gamma"]
    assert build_model(robot).size == 12


def test_beams_follow_each_other_and_carry_joints_where_a_node_is() -> None:
    """A beam on another one's tip, a frame and a link at an inner node; tunable numbers of a segment."""
    more = """
tunable = ["links.boom1.mass"]
[[links]]
name = "tool"
mass = 1.0
[[links]]
name = "bob"
mass = 0.5
[[joints]]
name = "hinge"
parent = "boom1"
child = "bob"
type = "revolute"
[[beams]]
name = "jib"
parent = "head"
child = "tool"
length = 0.4
segments = 1
E = 7e10
G = 2.6e10
density = 2700
section = { rod = 0.02 }
"""
    top, _, rest = more.partition("[[links]]")
    robot = robot_from_toml(top + toml({}, 1.0, "[[links]]" + rest))
    assert [joint.name for joint in robot.joints] == [
        *("boom0", "boom1", "hinge", "boom2", "boom_tip", "jib0", "jib1", "jib_tip")
    ]
    assert build_model(robot).parameters["links.boom1.mass"] == robot.link("boom1").mass
    assert "joints.boom1.beta.stiffness" in build_model(robot).parameters


def test_a_beam_behind_a_urdf(tmp_path: Path) -> None:
    """'base' is its root link; a beam's child is a link that the TOML adds."""
    (tmp_path / "arm.urdf").write_text(URDF, encoding="ascii")
    beam = toml({"parent": "lower"}).replace('name = "crane"', 'urdf = "arm.urdf"')
    (tmp_path / "arm.toml").write_text(beam, encoding="ascii")
    robot = eomgen.load_robot(tmp_path / "arm.toml")
    assert robot.joints[-1].child == "head"
    for parent in ("base", "ground"):
        (tmp_path / "arm.toml").write_text(beam.replace('parent = "lower"', f'parent = "{parent}"'), encoding="ascii")
        robot = eomgen.load_robot(tmp_path / "arm.toml")
        assert robot.joint("boom0").parent == robot.base == "ground"
        assert robot.with_value("beams.boom.segments", 3).joint("boom0").parent == "ground"
    (tmp_path / "arm.toml").write_text(beam.replace('"lower"', '"lowr"'), encoding="ascii")
    with pytest.raises(DescriptionError, match=r"arm\.toml:[0-9]+:[0-9]+: beams\.boom\.parent: .*'lowr'.*'lower'"):
        eomgen.load_robot(tmp_path / "arm.toml")


def test_more_links_than_there_may_be() -> None:
    """Those of beams count."""
    beams = []
    for k in range(50):
        parent = "base" if not k else f"head{k - 1}"
        keys = toml({"name": f"b{k}_", "parent": parent, "child": f"head{k}", "segments": 100})
        beams.append(keys.replace('name = "crane"', "").replace('name = "head"', f'name = "head{k}"'))
    text = 'name = "crane"\n' + "".join(beams)
    with pytest.raises(DescriptionError, match=r"beams\.b49_\.segments: got 100, and .* 5100; allowed: up to 5000"):
        robot_from_toml(text)


def test_a_beams_numbers_are_changed() -> None:
    """Its links and joints follow, those of others stay, as if the description had them so."""
    more = (
        '[[links]]\nname = "bob"\nmass = 1\n[[joints]]\nname = "first"\nparent = "base"\nchild = "bob"\ntype = "free"\n'
    )
    robot = robot_from_toml(toml({}, 2.0, more))
    changes: tuple[tuple[str, Any, dict[str, Any] | None], ...] = (
        ("beams.boom.length", 2.5, {"length": 2.5}),
        ("beams.boom.segments", 5, {"segments": 5}),
        ("beams.boom.Iy", 1e-6, {"Iy": 1e-6}),
        ("beams.boom.shear", [0.5, 0.4], {"shear": [0.5, 0.4]}),
        ("beams.boom.shear.y", 0.6, None),
        ("beams.boom.axis", "-z", {"axis": "-z"}),
        ("beams.boom.damping.gamma", 1e-4, {"damping": [0, 0, 0, 0, 0, 1e-4]}),
        ("beams.boom.rigid", ["x"], {"rigid": ["x"]}),
        ("beams.boom.placement.rpy", [0.1, 0.2, 0.3], {"placement": {"rpy": [0.1, 0.2, 0.3]}}),
        ("beams.boom.name", "jib", {"name": "jib"}),
    )
    for path, value, keys in changes:
        if keys is None:
            refused(DescriptionError, r"beams\.boom\.shear", robot.with_value, path, value)
            continue
        changed = robot.with_value(path, value)
        assert record_of(changed) == record_of(robot_from_toml(toml(keys, 2.0, more))), path
    assert robot.with_value("links.boom1.mass", 1.0).beams == robot.beams
    moved = robot.with_values({"joints.boom1.x.stiffness": 7.0, "beams.boom.E": 7e10})
    assert moved == robot.with_value("beams.boom.E", 7e10)
    assert moved.joint("boom2").coordinates["x"].stiffness == pytest.approx(7e10 * 2e-3 / 0.65)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("beams.boom.E", -1.0, r"beams\.boom\.E: got -1\.0; allowed: a number greater than 0"),
        ("beams.boom.segments", 0, r"beams\.boom\.segments: got 0; allowed: a whole number from 1 to 100"),
        ("beams.boom.segments", 2.5, "segments: got 2.5; allowed: a value of type int"),
        ("beams.boom.axis", "w", "beams.boom.axis: got 'w'; allowed: x, y, z, -x"),
        ("beams.boom.rigid", ["x", "x"], "each once, not all"),
        ("beams.boom.damping", [1.0], "six numbers that are at least 0"),
        ("beams.boom.child", "nobody", "there is no link 'nobody'"),
        ("beams.boom.chld", 1, "there is no 'chld' in beams.boom; did you mean 'child'"),
        ("beams.bom.E", 1, "there is no 'bom' in beams; did you mean 'boom'"),
        ("beams.boom.length", 1e-24, "its segments have the stiffness x"),
        ("beams.boom.name", "a" * 127, "at most 124 characters"),
        ("beams.boom.placement.rotation", [[1, 0, 0]] * 3, "no rotation"),
    ],
)
def test_numbers_that_no_beam_has_are_refused(path: str, value: object, said: str) -> None:
    with pytest.raises(DescriptionError, match=said):
        cantilever().with_value(path, value)


def test_fewer_segments_than_something_names() -> None:
    robot = robot_from_toml('tunable = ["links.boom2.mass"]\n' + toml({}, 1.0))
    refused(DescriptionError, r"tunable: 'links\.boom2\.mass'", robot.with_value, "beams.boom.segments", 1)


def test_links_and_joints_keep_their_names() -> None:
    """More segments than there are names for."""
    more = '[[links]]\nname = "boom3"\nmass = 1\n[[joints]]\nname = "boom4"\nparent = "base"\nchild = "boom3"\n'
    robot = robot_from_toml(toml({}, 1.0, more + 'type = "revolute"\n'))
    with pytest.raises(DescriptionError, match=r"with_value: .* have the names 'boom3', 'boom4'; allowed"):
        robot.with_value("beams.boom.segments", 4)
    assert robot.with_value("beams.boom.segments", 1).link("boom3").mass == 1.0


def test_records_of_robots_with_beams() -> None:
    """And robots without have none of them: their hashes stay."""
    robot = cantilever(segments=3, axis="-y", placement={"xyz": [1.0, 2.0, 3.0]}, damping=1e-4, rigid=["x"])
    assert robot_from_record(json.loads(json.dumps(record_of(robot))), "r") == robot
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert robot_hash(robot) != robot_hash(cantilever(segments=3))
    assert "beams" not in record_of(eomgen.load_robot("ur5"))
    record = json.loads(json.dumps(record_of(robot)))
    record["beams"][0]["E"] = -1.0
    refused(DescriptionError, r"beams\.boom\.E", robot_from_record, record, "r")


def test_a_link_of_a_beam_has_no_place_in_a_description(tmp_path: Path) -> None:
    robot = eomgen.load_robot(EXAMPLE)
    with pytest.raises(InputError, match=r"flexible_boom: boom1 is not written in .*flexible_boom\.toml"):
        write_toml(robot, {"boom1.mass": 1.0}, [], tmp_path / "identified.toml")
    assert not (tmp_path / "identified.toml").exists()


def test_info_says_what_a_beam_is() -> None:
    robot = cantilever(segments=3, rigid=["x"])
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    (line,) = [line for line in info.lines() if line.startswith("beam ")]
    assert line == (
        "beam boom from base to head, 1.3 m along x: links boom0 to boom3, 3 x 5 coordinates, 20.28 kg;"
        " EA 4.2e+08, GJ 40000, EIy 84000, EIz 63000 (N, N m^2), shear 0.8, 0.6"
    )
    (facts,) = json.loads(json.dumps(info.as_dict()))["beams"]
    assert facts["links"] == ["boom0", "boom1", "boom2", "boom3"]
    assert facts["joints"][-1] == "boom_tip"
    assert (facts["mass"], facts["rigid"]) == (pytest.approx(20.28), ["x"])
    assert "beams" not in RobotInfo(build_model(eomgen.load_robot("one_link")), {}, (), {}, {}).as_dict()


def test_a_beam_in_python() -> None:
    """Links and joints of a value, for robots that are made in Python."""
    E, G, density = STEEL.values()
    beam = Beam("boom", "base", "head", 1.3, 2, E, G, 2.0e-3, 4.0e-7, 3.0e-7, 5.0e-7, (0.8, 0.6), density)
    robot = cantilever()
    assert beam == robot.beams[0]
    assert beam.links() == robot.links[:-1]
    assert beam.joints() == robot.joints
    assert beam.placement == Placement()


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
