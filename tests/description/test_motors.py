"""Descriptions of motors, springs between points, loop joints, and joints of URDFs that follow others."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from pathlib import Path

import pytest

import eomgen
from eomgen.description.load import robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Coupling, Friction, Motor, Robot, Spring
from tests.support.description_samples import ARM, URDF
from tests.support.joint_table import joint_table, link_table, loop_table
from tests.support.pendulums import MOTOR, described, pendulum
from tests.support.refusals import refused
from tests.support.text_files import text_file

pytestmark = pytest.mark.quick


def test_a_description() -> None:
    robot = described(
        "motor = { inertia = 1e-4, ratio = -100, stiffness = 2e4, cubic = 3.0, clearance = 1e-3, damping = 10,"
        " friction = { coulomb = 0.1, viscous = 0.2 } }",
        more='x = { stiffness = 1e5 }\nprescribed = ["motor"]',
        tunable='["joints.joint1.motor.ratio"]',
    )
    motor = robot.joints[0].motor
    spring = Coordinate(2e4, 10.0, cubic=3.0, clearance=1e-3)
    assert motor == Motor(1e-4, -100.0, spring, Friction(0.1, viscous=0.2), True)
    assert list(robot.joints[0].coordinates) == ["x", "gamma"]
    model = build_model(robot)
    assert model.coordinates == ("joint1.x", "joint1.gamma", "joint1.motor")
    values = {
        "ratio": -100.0,
        "stiffness": 2e4,
        "damping": 10.0,
        "cubic": 3.0,
        "clearance": 1e-3,
        "smoothing": 5e-5,
        "friction.coulomb": 0.1,
        "friction.viscous": 0.2,
        "friction.smoothing": 4e-8,
    }
    own = {name[20:]: value for name, value in model.parameters.items() if name.startswith("joints.joint1.motor.")}
    assert own == values
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert described(MOTOR[:-2] + ', role = "prescribed" }').joints[0].motor.prescribed  # type: ignore[union-attr]
    rigid = robot.rigid()
    assert rigid.tunable == ()
    assert rigid.joints[0].coordinates["gamma"] == Coordinate(armature=1.0, prescribed=True)


MORE = "..."


@pytest.mark.parametrize(
    ("old", "new", "more", "message"),
    [
        ("1e-4", "0", "", r"motor\.inertia: got 0; allowed: .*greater than 0"),
        ("1e-4", "-1e-4", "", r"motor\.inertia: got -0\.0001; allowed"),
        ("100", "0", "", r"motor\.ratio: got 0\.0; allowed: .*not 0"),
        ("100", "inf", "", r"motor\.ratio: got inf; allowed"),
        ("ratio = 100,", "", "", r"motor: the key 'ratio' is missing"),
        ("inertia = 1e-4,", "", "", r"motor: the key 'inertia' is missing"),
        (", stiffness = 2e4", "", "", r"motor\.stiffness: there is no spring .*one of stiffness, .*curve"),
        (MORE, ", armature = 1.0", "", r"motor: unknown key 'armature'"),
        (MORE, ", backlash = 1.0", "", r"motor: unknown key 'backlash'"),
        (MORE, ', role = "locked"', "", r"motor\.role: .*leave its table out"),
        (MORE, ", restitution_damping = 1.0", "", r"motor\.restitution_damping: there is no clearance"),
        (MORE, ", curve = [[0, 0], [1, 1]]", "", r"motor\.curve: stiffness is set, too"),
        (MORE, ", friction = { static = 1.0 }", "", r"motor\.friction: the key 'coulomb' is missing"),
        (MORE, ", friction = { coulomb = 1, static = 2 }", "", r"motor\.friction: .*belong together"),
        (MOTOR, "motor = 3", "", r"motor: got 3; allowed: a table"),
        (MORE, "", 'gamma = { role = "locked" }', r"motor: gamma is locked"),
        (MORE, ', role = "free"', 'prescribed = ["motor"]', r"prescribed: motor is prescribed here and free"),
        (MOTOR, "", 'prescribed = ["motor"]', r"prescribed: got 'motor'"),
    ],
)
def test_what_is_refused(old: str, new: str, more: str, message: str) -> None:
    """MORE: what a motor's table has behind its keys."""
    motor = MOTOR.replace(" }", f"{new} }}") if old == MORE else MOTOR.replace(old, new)
    refused(DescriptionError, r"joints\.joint1\." + message, described, motor, more=more)


@pytest.mark.parametrize("kind", ["fixed", "free"])
def test_joints_without_a_principal_coordinate(kind: str) -> None:
    with pytest.raises(DescriptionError, match=rf"joints\.joint1\.motor: a {kind} joint has no principal coordinate"):
        described(MOTOR, kind, "x = {}" if kind == "fixed" else "")


def test_a_robot_that_no_reader_has_seen() -> None:
    robot = described(MOTOR)
    for wrong, message in (
        (Motor(-1.0, 2.0, Coordinate(1.0)), "inertia: got -1.0"),
        (Motor(1.0, float("nan"), Coordinate(1.0)), "ratio: got nan"),
        (Motor(1.0, 2.0, Coordinate()), "no spring"),
        (Motor(1.0, 2.0, Coordinate(1.0, prescribed=True)), "role belong"),
    ):
        refused(DescriptionError, message, build_model, replace(robot, joints=(replace(robot.joints[0], motor=wrong),)))


def test_descriptions_without_motors_read_as_before() -> None:
    assert all(joint.motor is None for joint in robot_from_toml(ARM).joints)


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
    robot = eomgen.load_robot(text_file(tmp_path / "arm.toml", text))
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
    assert eomgen.load_robot(text_file(tmp_path / "refined.toml", refined)).springs[0].links == ("ground", "lower")


def test_robots_made_by_hand_are_checked() -> None:
    base = Spring("s", ("base", "rod"))
    for spring, words in (
        (base, "springs.s: it has no force"),
        (replace(base, links=("base", "rot"), stiffness=1.0), "springs.s.links: got 'rot'; allowed: base, rod"),
        (replace(base, links=("rod", "rod"), stiffness=1.0), "springs.s.links: .*do not move against each other"),
        (replace(base, stiffness=1.0, tension_only=True), "springs.s.tension_only: there is no free_length"),
        (replace(base, name="a b", stiffness=1.0), "springs: got 'a b'"),
    ):
        refused(DescriptionError, words, build_model, pendulum((spring,)))


JOINT = '<joint name="{name}" type="{kind}"><parent link="hand"/><child link="{name}_link"/>{mimic}</joint>'
FINGERS = {"left": "prismatic", "right": "prismatic", "1 turn": "revolute", "rigid": "fixed", "loose": "floating"}


def urdf(kinds: dict[str, str] = FINGERS, **mimics: str) -> str:
    """A hand with fingers, some of which follow another one."""
    links = "".join(f'<link name="{name}_link"/>' for name in kinds)
    joints = "".join(
        JOINT.format(name=name, kind=kind, mimic=mimics.get(name.replace(" ", "_"), "")) for name, kind in kinds.items()
    )
    return f'<robot name="hand">\n<link name="hand"/>{links}\n{joints}</robot>'


def test_mimics_are_couplings() -> None:
    robot = robot_from_urdf(
        urdf(
            right='<mimic joint="left"/>',
            left='<mimic joint="1 turn" multiplier="-0.5" offset="0.1"/>',
            rigid='<mimic joint="left"/>',
        )
    )
    assert robot.couplings == (
        Coupling("left", "left.z", {"_1_turn.gamma": -0.5}, 0.1),
        Coupling("right", "right.z", {"left.z": 1.0}),
    )
    assert "mimic joints are coupled rigidly to those they follow: 'left', 'right'" in robot.notes
    assert "<mimic> is left out of joints without a coordinate: 'rigid'" in robot.notes
    model = build_model(robot)
    assert model.constraints == ()
    assert model.coordinates[0] == "_1_turn.gamma"
    assert not {"left.z", "right.z"} & set(model.coordinates)
    assert list(model.followers) == ["left.z", "right.z"]
    assert [model.coordinates[i] for i in model.driven] == ["_1_turn.gamma"]


@pytest.mark.parametrize(
    ("mimic", "message"),
    [
        ('<mimic joint="left" multiplier="x"/>', r"<mimic>: multiplier is 'x'; allowed: a finite number"),
        ('<mimic joint="left" offset="1e999"/>', r"<mimic>: offset is '1e999'; allowed: a finite number"),
        ('<mimic joint="right"/>', r"couplings\.right\.to: 'right\.z' is coupled to itself; allowed: "),
    ],
)
def test_bad_mimics(mimic: str, message: str) -> None:
    refused(DescriptionError, r"hand\.urdf:3:\d+: .*" + message, robot_from_urdf, urdf(right=mimic), source="hand.urdf")


@pytest.mark.parametrize(
    ("mimic", "note"),
    [
        ('<mimic joint="lefd"/>', "the joint 'lefd' is not there; did you mean 'left'?; it is read as independent"),
        ("<mimic/>", "the joint '' is not there; it is read as independent"),
        ('<mimic joint="rigid"/>', "the joint 'rigid' has no coordinate to follow; it is read as independent"),
        ('<mimic joint="loose"/>', "the joint 'loose' has no coordinate to follow; it is read as independent"),
    ],
)
def test_mimics_of_nothing_are_noted(mimic: str, note: str) -> None:
    """Published URDFs have them; other readers leave them out without a word."""
    robot = robot_from_urdf(urdf(right=mimic), source="hand.urdf")
    assert robot.couplings == ()
    (found,) = [text for text in robot.notes if "mimic" in text]
    assert re.fullmatch(r"hand\.urdf:3:\d+: joint 'right', <mimic>: " + re.escape(note), found)


def test_mimics_in_a_circle() -> None:
    text = urdf(right='<mimic joint="left"/>', left='<mimic joint="right"/>')
    with pytest.raises(DescriptionError, match=r"couplings\.right: it goes round in a circle: left -> right -> left"):
        robot_from_urdf(text)
    assert robot_from_urdf(text, urdf_mimic=False).couplings == ()


def test_entries_of_toml_refine_mimics(tmp_path: Path) -> None:
    (tmp_path / "hand.urdf").write_text(urdf(right='<mimic joint="left"/>'))
    entry = '[[couplings]]\nname = "right"\nof = "right.z"\nto = { "left.z" = 1.0 }\nstiffness = 1e5\n'
    robot = robot_from_toml('urdf = "hand.urdf"\n' + entry, folder=tmp_path)
    (coupling,) = robot.couplings
    assert coupling.law.stiffness == 1e5
    more = '[[couplings]]\nname = "more"\nof = "right.z"\nto = {}\n'
    with pytest.raises(DescriptionError, match=r"couplings\.more: right\.z follows from the coupling right"):
        robot_from_toml('urdf = "hand.urdf"\n' + more, folder=tmp_path)


def read(keys: str, tunable: str = "[]", folder: Path | None = None) -> Robot:
    head = f"""
name = "window"
tunable = {tunable}
{link_table("crank", 1.0)}
{link_table("rocker", 1.0)}
{joint_table("turn", "base", "crank", "revolute")}
{joint_table("swing", "base", "rocker", "revolute")}
{loop_table("pin", "crank", "rocker", "revolute")}
placements = [{{ xyz = [1.0, 0.0, 0.0], rpy = [0.0, 0.1, 0.0] }}, {{}}]
"""
    return robot_from_toml(head + keys, folder=folder)


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
    refused(DescriptionError, message, read, keys)
