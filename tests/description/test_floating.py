"""URDFs whose roots float, against Pinocchio's free flyer, and XML that is not quite right."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomgen.authoring.check import check_file
from eomgen.cli import entry
from eomgen.description.load import load_robot, robot_from_mjcf, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Robot
from tests.support.bad_files import changed
from tests.support.builds import Build
from tests.support.description_samples import MJCF, URDF
from tests.support.joint_table import joint_table
from tests.support.optional import OptionalModule, needs
from tests.support.random_robots import Array
from tests.support.refusals import refused
from tests.support.text_files import text_file

pytestmark = pytest.mark.quick
pin = OptionalModule("pinocchio")
BODY = """<link name="ground"><inertial>
  <origin xyz="0.05 -0.02 0.1" rpy="0.2 0.1 -0.3"/><mass value="4.0"/>
  <inertia ixx="0.2" iyy="0.3" izz="0.25" ixy="0.02" ixz="-0.01" iyz="0.03"/>
</inertial></link>"""
HEAVY = URDF.replace('<link name="ground"/>', BODY)
TOML = f"""
name = "arm"
urdf = "arm.urdf"
{joint_table("floating_base", "base", "ground", "free")}
"""


def rotation(angles: Array) -> Array:
    """Rx Ry Rz."""
    return np.asarray(np.linalg.multi_dot([pin.utils.rotate(axis, x) for axis, x in zip("xyz", angles, strict=True)]))


def flyer_rates(q: Array, v: Array) -> Array:
    """Pinocchio's rates: velocity and angular velocity of the root in its own axes, then those of joints."""
    first, second = (pin.utils.rotate(axis, x) for axis, x in zip("xy", q[3:5], strict=True))
    axes = np.column_stack([np.eye(3)[0], first[:, 1], (first @ second)[:, 2]])
    R = rotation(q[3:6])
    return np.concatenate([R.T @ v[:3], R.T @ axes @ v[3:6], v[6:]])


def test_accelerations_and_energies_are_those_of_a_free_flyer(built: Build) -> None:
    robot = robot_from_urdf(HEAVY, floating_base=True)
    kernel = built(robot, "forward_dynamics", "energy", "kinematics")
    model = pin.buildModelFromXML(HEAVY, pin.JointModelFreeFlyer())
    data = model.createData()
    assert [name.partition(".")[0] for name in kernel.coordinates[6:]] == list(model.names)[2:]
    rng = np.random.default_rng(4)
    start = None
    for _ in range(4):
        q, v = rng.uniform(-1.0, 1.0, (2, 8))
        drives = np.concatenate([np.zeros(6), rng.uniform(-5.0, 5.0, 2)])
        whole = pin.neutral(model)
        whole[:3], whole[3:7] = q[:3], pin.Quaternion(rotation(q[3:6])).coeffs()
        whole[7] = q[6]
        whole[8:10] = np.cos(q[7]), np.sin(q[7])
        rates = flyer_rates(q, v)
        a = kernel.forward_dynamics(q, v, drives)
        h = 1e-5
        ours = (flyer_rates(q + h * v, v + h * a) - flyer_rates(q - h * v, v - h * a)) / (2.0 * h)
        np.testing.assert_allclose(ours, pin.aba(model, data, whole, rates, drives), rtol=1e-7, atol=1e-7)
        energy = np.array(
            [pin.computeKineticEnergy(model, data, whole, rates), pin.computePotentialEnergy(model, data, whole)]
        )
        found = kernel.energy(q, v)
        start = found - energy if start is None else start
        np.testing.assert_allclose(found - energy, [0.0, start[1]], atol=1e-11)  # zero of the weight is elsewhere


def test_the_toml_says_the_same(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(HEAVY)
    (tmp_path / "arm.toml").write_text(TOML)
    floats, said = load_robot(tmp_path / "arm.urdf", floating_base=True), load_robot(tmp_path / "arm.toml")
    assert replace(floats, source="", notes=()) == replace(said, source="", notes=())
    assert floats.notes[-1] == ("link 'ground' floats: floating_base.x to floating_base.gamma are its coordinates")
    model = build_model(floats)
    assert model.coordinates[:6] == tuple(f"floating_base.{name}" for name in COORDINATES)
    assert [model.coordinates[i] for i in model.driven] == ["elbow.gamma", "shoulder.gamma"][::-1]
    (tmp_path / "home.toml").write_text('urdf = "arm.urdf"\nhome = { "floating_base.z" = 1.0 }\n')
    assert load_robot(tmp_path / "home.toml", floating_base=True).home == {"floating_base.z": 1.0}


def test_names_that_are_taken() -> None:
    text = HEAVY.replace('"ground"', '"base"').replace('"shoulder"', '"floating_base"')
    robot = robot_from_urdf(text, floating_base=True)
    assert (robot.base, robot.joints[0].name, robot.joints[0].child) == ("world", "floating_base_2", "base")
    text = text.replace('"upper"', '"world"').replace('"lower"', '"ground"')
    assert robot_from_urdf(text, floating_base=True).base == "ground_2"


def test_a_body_alone_floats() -> None:
    """A URDF in which nothing else moves."""
    text = f"<robot name='stone'>{BODY}</robot>"
    refused(DescriptionError, r"nothing moves; .*, or --floating-base \(floating_base=True\)", robot_from_urdf, text)
    assert build_model(robot_from_urdf(text, floating_base=True)).size == 6


def test_checks_of_bodies_that_float(tmp_path: Path) -> None:
    path = text_file(tmp_path / "stone.urdf", f"<robot name='stone'>{BODY}</robot>")
    assert "or --floating-base" in str(check_file(path).errors[0])
    found = check_file(path, floating_base=True)
    assert not found.errors
    assert found.summary["coordinates"] == 6
    assert entry.main(["check", str(path), "--floating-base"]) == 0


def test_what_cannot_float(tmp_path: Path) -> None:
    with pytest.raises(
        DescriptionError, match=r"floating_base: there is no root link .*; allowed: a joint of the type"
    ):
        load_robot("one_link", floating_base=True)
    (tmp_path / "arm.urdf").write_text(HEAVY)
    (tmp_path / "arm.toml").write_text(TOML)
    with pytest.raises(DescriptionError, match=r"without it, as the joint 'floating_base' carries the root link"):
        load_robot(tmp_path / "arm.toml", floating_base=True)


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert entry.main(["info", str(text_file(tmp_path / "arm.urdf", HEAVY)), "--floating-base", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["coordinates"]) == 8


DECLARATION = '<?xml version="1.0"?>'
PREFIXED = '<gazebo:plugin file="a"><g:b/></gazebo:plugin>'
CASES = {  # text of a place, what stands there instead, place of the note, words of the note
    "undeclared prefixes": ("</robot>", f"  {PREFIXED}</robot>", "25:3", ["prefix", "'gazebo', 'g'"]),
    "undeclared prefix of an attribute": ('<link name="lower"', '<link sim:id="1" name="lower"', "11:3", ["'sim'"]),
    "blank lines first": (DECLARATION, f"\n \n{DECLARATION}", "3:1", ["declaration", "beginning"]),
    "comment first": (DECLARATION, f"<!-- a -> b -->\n<!-- b --> {DECLARATION}", "2:12", ["declaration"]),
    "two declarations": (DECLARATION, f"{DECLARATION}\n{DECLARATION}", "2:1", ["declaration"]),
    "declaration of lines": (DECLARATION, "\n<?xml\n  version='1.0'\n?>", "2:1", ["declaration"]),
    "the axis twice": ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/>\n<axis xyz=" 0  1 0"/>', "18:1", ["say the same"]),
    "two axes": ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><axis xyz="1 0 0"/>', "17:24", ["2 elements", "first"]),
    "the parent twice": ('<parent link="ground"/>', '<parent link="ground"/>' * 2, "15:28", ["<parent>", "the same"]),
    "limits reversed": ('lower="-1" upper="2"', 'lower="2" upper="-1"', "18:5", ["lower is 2", "upper is -1"]),
}
OF_JOINTS = {"the axis twice", "two axes", "the parent twice", "limits reversed"}


@pytest.mark.parametrize("case", CASES)
def test_a_plain_meaning_is_read_with_a_note(case: str) -> None:
    old, new, place, words = CASES[case]
    plain, robot = robot_from_urdf(URDF), robot_from_urdf(changed(URDF, old, new), source="r.urdf")
    assert (robot.joints, robot.links) == (plain.joints, plain.links)
    (note,) = set(robot.notes) - set(plain.notes)
    assert note.startswith(f"r.urdf:{place}: ")
    assert note.isascii()
    for word in words:
        assert word in note
    assert ("joint 'shoulder'" in note) == (case in OF_JOINTS)


def test_the_first_of_two_axes_is_pinocchios() -> None:
    pin = needs("pinocchio")
    text = changed(URDF, '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><axis xyz="1 0 0"/>')
    model = pin.buildModelFromXML(text)
    data = model.createData()
    pin.forwardKinematics(model, data, np.array([0.3, 1.0, 0.0]))
    turned = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])
    yaw = np.array([[np.cos(0.1), -np.sin(0.1), 0], [np.sin(0.1), np.cos(0.1), 0], [0, 0, 1]])
    assert np.allclose(data.oMi[1].rotation, yaw @ turned, atol=1e-15)
    assert robot_from_urdf(text).joints[0].axis_turn == robot_from_urdf(URDF).joints[0].axis_turn


@pytest.mark.parametrize("case", sorted(set(CASES) - OF_JOINTS))
def test_places_of_other_mistakes_stay_right(case: str) -> None:
    """What is mended keeps its lines and columns: the message is that of the same file without the first mistake."""
    text = changed(URDF, *CASES[case][:2])
    wrong = changed(text, 'iyz="0"/></inertial>\n  </link>\n  <joint', "/></inertial>\n  </link>\n  <joint")
    caught = refused(DescriptionError, "", robot_from_urdf, wrong, source="r.urdf")
    line = next(k for k, line in enumerate(wrong.splitlines(), 1) if re.search(r'<inertia ixx="1"', line))
    column = wrong.splitlines()[line - 1].index("<inertia ") + 1
    assert str(caught).startswith(f"r.urdf:{line}:{column}: link 'lower', <inertial>, <inertia>: ")


@pytest.mark.parametrize(("read", "sample"), [(robot_from_urdf, URDF), (robot_from_mjcf, MJCF)])
def test_a_default_namespace_changes_nothing(read: Callable[[str], Robot], sample: str) -> None:
    if sample == MJCF:
        needs("mujoco")
    tag = "<robot" if "<robot" in sample else "<mujoco"
    robot = read(changed(sample, f"{tag} ", f'{tag} xmlns="http://drake.mit.edu" xmlns:a="b" '))
    assert (robot.links, robot.joints) == (read(sample).links, read(sample).joints)


def test_a_declared_prefix_is_no_mistake() -> None:
    text = changed(URDF, "</robot>", f"<x xmlns:gazebo='a' xmlns:g='b' xml:lang='c'>{PREFIXED}</x></robot>")
    assert robot_from_urdf(text).notes == robot_from_urdf(URDF).notes
    text = changed(URDF, "</robot>", f"<x xmlns:gazebo='a'/>{PREFIXED}</robot>")  # declared elsewhere
    assert "'gazebo'" in "".join(robot_from_urdf(text).notes)


def test_mjcf_does_not_float() -> None:
    needs("mujoco")
    refused(DescriptionError, r"in MJCF a <freejoint/>", robot_from_mjcf, MJCF, floating_base=True)


def test_mjcf_behind_blank_lines() -> None:
    needs("mujoco")
    assert robot_from_mjcf("\n\n" + MJCF, source="m.xml").links == robot_from_mjcf(MJCF).links


REFUSED = {
    "text in front": ("<?xml", "robot: <?xml", "syntax error"),
    "elements in front": ("<?xml", "<a/><?xml", "not"),
    "two parents": ('<parent link="ground"/>', '<parent link="ground"/><parent link="lower"/>', "that differ"),
    "two masses": ('<mass value="2.0"/>', '<mass value="2.0"/><mass value="3.0"/>', "that differ"),
    "xacro without a declaration": ("</robot>", "<xacro:include/></robot>", "xacro macro"),
    "prefix that is no name": ("</robot>", "<a:b c=1/></robot>", "not well-formed"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_plain_is_refused(case: str) -> None:
    old, new, reason = REFUSED[case]
    refused(DescriptionError, reason, robot_from_urdf, changed(URDF, old, new))


def test_many_mistakes_are_found_in_one_pass() -> None:
    """Thousands of notes with places: each is right, and finding them does not grow with the square of the file."""
    count = 4000
    parts = ['<robot name="many">', *(f'<link name="l{k}"/>' for k in range(count))]
    ends = '<parent link="l{}"/><child link="l{}"/><limit lower="1" upper="-1"/>'
    parts += [f'<joint name="j{k}" type="revolute">{ends.format(k - 1, k)}</joint>' for k in range(1, count)]
    text = "\n".join([*parts, "</robot>"])
    notes = robot_from_urdf(text, source="r").notes
    assert len(notes) == count - 1
    line = count + 8
    column = text.splitlines()[line - 1].index("<limit") + 1
    assert [note for note in notes if note.startswith(f"r:{line}:{column}: joint 'j7', <limit>: ")]
