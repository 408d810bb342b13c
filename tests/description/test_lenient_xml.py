"""XML that is not quite right: where its meaning is plain it is read, with a note that says where."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from eomgen.description.load import robot_from_mjcf, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.robot.value import Robot
from tests.support.bad_files import changed
from tests.support.description_samples import MJCF, URDF
from tests.support.optional import needs

pytestmark = pytest.mark.quick

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
    with pytest.raises(DescriptionError) as caught:
        robot_from_urdf(wrong, source="r.urdf")
    line = next(k for k, line in enumerate(wrong.splitlines(), 1) if re.search(r'<inertia ixx="1"', line))
    column = wrong.splitlines()[line - 1].index("<inertia ") + 1
    assert str(caught.value).startswith(f"r.urdf:{line}:{column}: link 'lower', <inertial>, <inertia>: ")


@pytest.mark.parametrize(("read", "sample"), [(robot_from_urdf, URDF), (robot_from_mjcf, MJCF)])
def test_a_default_namespace_changes_nothing(read: Callable[[str], Robot], sample: str) -> None:
    tag = "<robot" if "<robot" in sample else "<mujoco"
    robot = read(changed(sample, f"{tag} ", f'{tag} xmlns="http://drake.mit.edu" xmlns:a="b" '))
    assert (robot.links, robot.joints) == (read(sample).links, read(sample).joints)


def test_a_declared_prefix_is_no_mistake() -> None:
    text = changed(URDF, "</robot>", f"<x xmlns:gazebo='a' xmlns:g='b' xml:lang='c'>{PREFIXED}</x></robot>")
    assert robot_from_urdf(text).notes == robot_from_urdf(URDF).notes
    text = changed(URDF, "</robot>", f"<x xmlns:gazebo='a'/>{PREFIXED}</robot>")  # declared elsewhere
    assert "'gazebo'" in "".join(robot_from_urdf(text).notes)


def test_mjcf_behind_blank_lines() -> None:
    robot = robot_from_mjcf("\n\n" + MJCF, source="m.xml")
    assert robot.links == robot_from_mjcf(MJCF).links
    assert robot.notes[0].startswith("m.xml:3:1: the declaration")


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
    with pytest.raises(DescriptionError, match=reason):
        robot_from_urdf(changed(URDF, old, new))


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
