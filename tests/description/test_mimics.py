"""Joints of URDFs that follow others, as couplings."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from eomgen.description.load import robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.value import Coupling

pytestmark = pytest.mark.quick

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
    with pytest.raises(DescriptionError, match=r"hand\.urdf:3:\d+: .*" + message):
        robot_from_urdf(urdf(right=mimic), source="hand.urdf")


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
    assert coupling.law is not None
    assert coupling.law.stiffness == 1e5
    more = '[[couplings]]\nname = "more"\nof = "right.z"\nto = {}\n'
    with pytest.raises(DescriptionError, match=r"couplings\.more: right\.z follows from the coupling right"):
        robot_from_toml('urdf = "hand.urdf"\n' + more, folder=tmp_path)
