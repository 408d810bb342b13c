"""Bad descriptions: one DescriptionError each, that names the thing, the value and what is allowed; nothing else."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eomgen.description.load import load_robot, robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.limits import MOST_ENTRIES
from eomgen.robot.value import Robot
from tests.support.description_samples import ARM, URDF
from tests.support.fuzzing import check_message, check_robot
from tests.support.mutations import as_toml


def refusal(read: Callable[[str], Robot], text: str) -> str:
    """The message with which the text is refused: one printable line of reasonable length."""
    with pytest.raises(DescriptionError) as caught:
        read(text)
    message = str(caught.value)
    assert message.isascii()
    assert message.isprintable()
    assert len(message) < 900
    assert caught.value.__cause__ is None
    return message


def changed(sample: str, old: str, new: str) -> str:
    assert sample.count(old) >= 1, old
    return sample.replace(old, new, 1)


def loop(extra: str, links: str = 'links = ["link2", "base"]', kind: str = 'type = "fixed"') -> tuple[str, str]:
    """What is replaced, and a loop in its place: keys that ``extra`` gives are not given twice."""
    lines = [line for line in (links, kind) if line.split(" ")[0] != extra.split(" ")[0]]
    return "[[frames]]", "\n".join(["[[loops]]", 'name = "loop"', *lines, extra, "[[frames]]"])


def spring(*extra: str, links: str = 'links = ["link2", "base"]') -> tuple[str, str]:
    """What is replaced, and a spring of these lines in its place."""
    return "[[frames]]", "\n".join(["[[springs]]", 'name = "rope"', links, *extra, "[[frames]]"])


# what is replaced, by what, and what the message must say: the place, the value, what is allowed
TOML_CASES = {
    "syntax": ("mass = 3.0", "mass = = 3.0", ["my.toml:8:8: "]),
    "unknown key": (
        "stiffness = 1e6",
        "stiffnes = 1e6",
        ["joints.joint1.x", "'stiffnes'", "mean 'stiffness'", "damping"],
    ),
    "unknown top key": ("gravity =", "gravitiy =", ["'gravitiy'", "mean 'gravity'", "allowed: name"]),
    "unknown coordinate": ("x = { stiff", "delta = { stiff", ["joints.joint1", "'delta'", "allowed", "gamma"]),
    "key with control characters": ("gravity =", '"\\u001b[31m\\n" =', [r"'\x1b[31m\n'", "allowed"]),
    "duplicate key": ("mass = 3.0", "mass = 3.0\nmass = 4.0", ["my.toml:9:"]),
    "string for number": ("mass = 3.0", 'mass = "3.0"', ["links.link1.mass", "'3.0'", "at least 0"]),
    "boolean for number": ("mass = 3.0", "mass = true", ["links.link1.mass", "true", "at least 0"]),
    "number for table": (
        "x = { stiffness = 1e6, damping = 10 }",
        "x = 1e6",
        ["joints.joint1.x", "1000000.0", "a table"],
    ),
    "number for name": ('name = "link1"', "name = 1", ["links[0].name", "1", "a string"]),
    "date for number": ("mass = 3.0", "mass = 1979-05-27", ["links.link1.mass", "1979", "allowed"]),
    "table for array": ("gravity = [0.0, 0.0, -9.81]", "gravity = { z = -9.81 }", ["gravity", "a table", "3 numbers"]),
    "short vector": ("[0.1, 0.0, 0.0]", "[0.1, 0.0]", ["links.link1.com", "[0.1, 0.0]", "an array of 3 numbers"]),
    "text in vector": ("[0.1, 0.0, 0.0]", '[0.1, "a", 0.0]', ["links.link1.com.1", "'a'", "a finite number"]),
    "nested vector": ("[0.1, 0.0, 0.0]", "[[0.1], 0.0, 0.0]", ["links.link1.com.0", "[0.1]", "a finite number"]),
    "table for array of tables": ("[[frames]]", "[frames]", ["frames", "a table", "[[frames]]"]),
    "nan": ("mass = 3.0", "mass = nan", ["links.link1.mass", "nan", "at least 0"]),
    "inf": ("-9.81", "-inf", ["gravity.2", "-inf", "a finite number"]),
    "huge number": ("mass = 3.0", "mass = 1e200", ["links.link1.mass", "1e+200", "1e+30"]),
    "huge integer": ("mass = 3.0", "mass = 0x" + "f" * 9000, ["links.link1.mass", "36000 bits", "1e+30"]),
    "integer of 5000 digits": ("mass = 3.0", "mass = " + "9" * 5000, ["not valid TOML"]),
    "negative mass": ("mass = 3.0", "mass = -3.0", ["links.link1.mass", "-3.0", "at least 0"]),
    "negative stiffness": ("1e6", "-1e6", ["joints.joint1.x.stiffness", "-1000000.0", "at least 0"]),
    "negative damping": ("damping = 10", "damping = -10", ["joints.joint1.x.damping", "-10", "at least 0"]),
    "negative armature": ("0.02", "-0.02", ["joints.joint1.gamma.armature", "-0.02", "at least 0"]),
    "impossible inertia": ("zz = 0.2", "zz = 0.5", ["links.link1.inertia", "-0.1", '"warn"', '"project"', "--inertia"]),
    "indefinite inertia": ("xx = 0.1", "xx = -0.1", ["links.link1.inertia", "(-0.1, 0.2, 0.2", "allowed"]),
    "product of inertia": ("zz = 0.2", "zz = 0.2, xy = 0.3", ["links.link1.inertia", "eigenvalue -", "allowed"]),
    "inertia without zz": (", zz = 0.2", "", ["links.link1.inertia", "'zz'", "missing", "kg m^2"]),
    "mass missing": ("mass = 3.0\n", "", ["links.link1", "'mass'", "missing"]),
    "name missing": ('name = "link1"\n', "", ["links[0]", "'name'", "missing"]),
    "robot name missing": ('name = "arm"\n', "", ["'name'", "missing", "lower-case"]),
    "parent missing": ('parent = "base"\n', "", ["joints.joint1", "'parent'", "missing", "'base'"]),
    "type missing": ('type = "revolute"\n', "", ["joints.joint1", "'type'", "missing", "prismatic"]),
    "unknown type": ('"revolute"', '"revolut"', ["joints.joint1.type", "'revolut'", "mean 'revolute'", "free"]),
    "type of URDF": ('"revolute"', '"continuous"', ["joints.joint1.type", "'continuous'", "mean 'revolute'"]),
    "unsupported type": (
        '"revolute"',
        '"planar"',
        ["joints.joint1.type", "'planar'", "revolute, prismatic, fixed, free"],
    ),
    "unknown parent": (
        'parent = "link1"',
        'parent = "lnk1"',
        ["joints.joint2.parent", "'lnk1'", "mean 'link1'", "base"],
    ),
    "unknown child": ('child = "link2"', 'child = "lnk2"', ["joints.joint2.child", "'lnk2'", "mean 'link2'"]),
    "unknown link of frame": ('link = "link2"', 'link = "hand"', ["frames.tcp.link", "'hand'", "'link1', 'link2'"]),
    "two parents": ('child = "link2"', 'child = "link1"', ["joints.joint2.child", "'link1'", "'joint1'", "one parent"]),
    "cycle": ('parent = "base"', 'parent = "link2"', ["joints.joint", "'joint1', 'joint2'", "cycle", "a tree"]),
    "own parent": ('parent = "link1"', 'parent = "link2"', ["joints.joint2", "'joint2'", "cycle"]),
    "base as child": ('child = "link2"', 'child = "base"', ["joints.joint2.child", "'base'", "a link"]),
    "link without joint": ("[[frames]]", '[[links]]\nname = "far"\nmass = 1\n[[frames]]', ["links.far", "one joint"]),
    "link named base": ('name = "link1"', 'name = "base"', ["links.base.name", "another name"]),
    "duplicate link": ('name = "link2"', 'name = "link1"', ["links.link1", "unique"]),
    "duplicate joint": ('name = "joint2"', 'name = "joint1"', ["joints.joint1", "unique"]),
    "no identifier": ('name = "link1"', 'name = "link 1"', ["links[0].name", "'link 1'", "letter", "'link_1'"]),
    "trailing newline": ('name = "link1"', 'name = "link1\\n"', ["links[0].name", r"'link1\n'", "letter"]),
    "code in a name": ('name = "link1"', 'name = "*/ int x; /*"', ["links[0].name", "'*/ int x; /*'", "letter"]),
    "foreign letters": (
        'name = "joint1"',
        'name = "\N{GREEK SMALL LETTER PHI}"',
        ["joints[0].name", r"'\u03c6'", "letter"],
    ),
    "empty name": ('name = "link1"', 'name = ""', ["links[0].name", "''", "letter"]),
    "long name": ('name = "link1"', f'name = "{"l" * 5000}"', ["links[0].name", "lll...'", "128"]),
    "robot name in capitals": ('name = "arm"', 'name = "Arm"', ["name", "'Arm'", "lower-case", "'arm'"]),
    "robot name with newline": ('name = "arm"', 'name = "arm\\n"', ["name", r"'arm\n'", "lower-case"]),
    "long robot name": ('name = "arm"', f'name = "{"a" * 49}"', ["name", "'aaaa", "48"]),
    "dh and placement": ("dh =", "placement = {}\ndh =", ["joints.joint1", "both dh and placement", "one of them"]),
    "limits reversed": ("limits = [-1, 2]", "limits = [2, -1]", ["joints.joint1.limits", "[2, -1]", "lower <= upper"]),
    "limits of a fixed joint": ('type = "revolute"', 'type = "fixed"', ["joints.joint1.limits", "fixed", "revolute"]),
    "clearance without stiffness": (
        "stiffness = 1e6",
        "clearance = 1e-4",
        ["joints.joint1.x.clearance", "no stiffness", "stiffness > 0"],
    ),
    "key of a loop": (*loop("a = 1"), ["loops.loop", "unknown key 'a'", "placements"]),
    "key of a spring": (*spring("stifness = 1"), ["springs.rope", "'stifness'", "mean 'stiffness'", "tension_only"]),
    "spring without links": (*spring("stiffness = 1", links=""), ["springs.rope", "'links' is missing", "two names"]),
    "spring of three links": (
        *spring("stiffness = 1", links='links = ["base", "link1", "link2"]'),
        ["springs.rope.links", "two names, each 'base' or a link"],
    ),
    "spring of no link": (
        *spring("stiffness = 1", links='links = ["link2", "lnk1"]'),
        ["springs.rope.links.1", "'lnk1'", "mean 'link1'"],
    ),
    "spring of one link": (
        *spring("stiffness = 1", links='links = ["link2", "link2"]'),
        ["springs.rope.links", "both ends are on one link", "two different links"],
    ),
    "spring without force": (*spring("free_length = 1"), ["springs.rope", "no force", "stiffness, damping or curve"]),
    "negative spring": (*spring("stiffness = -1"), ["springs.rope.stiffness", "-1", "at least 0"]),
    "negative length": (
        *spring("stiffness = 1", "free_length = -0.1"),
        ["springs.rope.free_length", "-0.1", "at least 0"],
    ),
    "negative damper": (*spring("damping = -2.0"), ["springs.rope.damping", "-2.0", "at least 0"]),
    "infinite spring": (*spring("stiffness = inf"), ["springs.rope.stiffness", "inf", "at least 0"]),
    "one point": (*spring("stiffness = 1", "points = [[0, 0, 0]]"), ["springs.rope.points", "1 values", "two points"]),
    "flat point": (*spring("stiffness = 1", "points = [[0, 0], [0, 0, 0]]"), ["springs.rope.points.0", "3 numbers"]),
    "point that is none": (
        *spring("stiffness = 1", "points = [[0, 0, nan], [0, 0, 0]]"),
        ["springs.rope.points.0.2", "nan", "finite"],
    ),
    "cable of a word": (
        *spring("stiffness = 1", 'tension_only = "yes"'),
        ["springs.rope.tension_only", "true or false"],
    ),
    "cable of no length": (
        *spring("stiffness = 1", "tension_only = true"),
        ["springs.rope.tension_only", "no free_length and no smoothing"],
    ),
    "smoothing of no cable": (
        *spring("stiffness = 1", "smoothing = 0.1"),
        ["springs.rope.smoothing", "with tension_only = true"],
    ),
    "sharp cable": (
        *spring("stiffness = 1", "tension_only = true", "smoothing = 0"),
        ["springs.rope.smoothing", "at least 1e-12"],
    ),
    "curve and stiffness of a spring": (
        *spring("stiffness = 1", "curve = [[0, 0], [1, 1]]"),
        ["springs.rope.curve", "stiffness is given, too"],
    ),
    "curve of a cable": (
        *spring("tension_only = true", "smoothing = 0.1", "curve = [[0, 0], [1, 1]]"),
        ["springs.rope.curve", "tension_only is given, too"],
    ),
    "curve of a spring that falls back": (
        *spring("curve = [[0, 0], [1, 1], [0.5, 2]]"),
        ["springs.rope.curve", "point 2", "elongation 0.5", "elongations that rise"],
    ),
    "spring twice": (
        *spring("stiffness = 1", "[[springs]]", 'name = "rope"', 'links = ["link1", "base"]', "damping = 1"),
        ["springs.rope", "'rope' is taken"],
    ),
    "name of a spring": (*spring("stiffness = 1", "[[springs]]", 'name = "a b; x"'), ["springs[1].name", "'a b; x'"]),
    "tunable of a spring": (
        "tunable = [",
        'tunable = ["springs.rope.stiffness", ',
        ["tunable", "'springs.rope.stiffness'", "springs.SPRING.points"],
    ),
    "loop of three links": (*loop('links = ["base", "link1", "link2"]'), ["loops.loop.links", "two names"]),
    "loop of a string": (*loop('links = "link1"'), ["loops.loop.links", "strings"]),
    "loop of no link": (*loop('links = ["link2", "lnk1"]'), ["loops.loop.links.1", "'lnk1'", "mean 'link1'"]),
    "loop of one link": (*loop('links = ["link2", "link2"]'), ["loops.loop.links", "to itself", "different"]),
    "loop without links": (*loop('type = "fixed"', links=""), ["loops.loop", "'links' is missing", "two names"]),
    "loop without type": (*loop("", kind=""), ["loops.loop", "'type' is missing", "revolute", "planar"]),
    "type of a loop": (*loop("", kind='type = "hinge"'), ["loops.loop.type", "'hinge'", "mean 'revolute'"]),
    "placements of a loop": (*loop("placements = [{}]"), ["loops.loop.placements", "two tables"]),
    "placement of a loop": (*loop("placements = [{}, {xy = 1}]"), ["loops.loop.placements.1", "'xy'", "xyz, rpy"]),
    "origin of a loop": (*loop("placements = [{}, {xyz = [1]}]"), ["loops.loop.placements.1.xyz", "3 numbers"]),
    "negative clearance": (
        "stiffness = 1e6",
        "stiffness = 1e6, clearance = -1e-4",
        ["joints.joint1.x.clearance", "-0.0001", "at least 0"],
    ),
    "clearance of stiffness zero": (
        "stiffness = 1e6",
        "stiffness = 0, clearance = 1e-4",
        ["joints.joint1.x.clearance", "stiffness > 0"],
    ),
    "sharp clearance": (
        "stiffness = 1e6",
        "stiffness = 1, clearance = 0",
        ["joints.joint1.x.clearance", "no smoothing", "1e-12"],
    ),
    "smoothing zero": (
        "stiffness = 1e6",
        "stiffness = 1, clearance = 1, smoothing = 0",
        ["joints.joint1.x.smoothing", "0", "1e-12"],
    ),
    "smoothing of nothing": (
        "stiffness = 1e6",
        "stiffness = 1, smoothing = 1e-5",
        ["joints.joint1.x.smoothing", "no clearance"],
    ),
    "restitution of nothing": (
        "stiffness = 1e6",
        "restitution_damping = 1.0",
        ["joints.joint1.x.restitution_damping", "no clearance"],
    ),
    "negative restitution damping": (
        "stiffness = 1e6",
        "stiffness = 1, clearance = 1, restitution_damping = -1",
        ["joints.joint1.x.restitution_damping", "-1", "at least 0"],
    ),
    "one side only": (
        "stiffness = 1e6",
        "stiffness_negative = 1e6",
        ["joints.joint1.x.stiffness_negative", "with stiffness"],
    ),
    "falling cubic": ("stiffness = 1e6", "cubic = -1.0", ["joints.joint1.x.cubic", "-1", "at least 0"]),
    "endless preload": ("stiffness = 1e6", "preload = inf", ["joints.joint1.x.preload", "inf", "finite"]),
    "friction as a number": (
        "stiffness = 1e6",
        "friction = 1.0",
        ["joints.joint1.x.friction", "1.0", "a table", "coulomb"],
    ),
    "friction without coulomb": (
        "stiffness = 1e6",
        "friction = { viscous = 1.0 }",
        ["joints.joint1.x.friction", "'coulomb' is missing"],
    ),
    "static without stribeck": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, static = 2.0 }",
        ["joints.joint1.x.friction", "static and stribeck"],
    ),
    "stribeck without static": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, stribeck = 0.1 }",
        ["joints.joint1.x.friction", "static and stribeck"],
    ),
    "static below coulomb": (
        "stiffness = 1e6",
        "friction = { coulomb = 2.0, static = 1.0, stribeck = 0.1 }",
        ["joints.joint1.x.friction.static", "1.0", "at least coulomb, 2.0"],
    ),
    "stribeck zero": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, static = 2.0, stribeck = 0.0 }",
        ["joints.joint1.x.friction.stribeck", "0.0", "1e-12"],
    ),
    "unknown friction": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, statik = 2.0 }",
        ["joints.joint1.x.friction", "'statik'", "mean 'static'"],
    ),
    "curve of one point": ("stiffness = 1e6", "curve = [[0, 0]]", ["joints.joint1.x.curve", "1 points", "2 to 64"]),
    "curve of many points": (
        "stiffness = 1e6",
        f"curve = {[[i, 0] for i in range(65)]}",
        ["joints.joint1.x.curve", "65 points", "2 to 64"],
    ),
    "curve that turns back": (
        "stiffness = 1e6",
        "curve = [[0, 0], [1, 2], [1, 3]]",
        ["joints.joint1.x.curve", "point 2", "1.0 after 1.0", "rise"],
    ),
    "curve of triples": (
        "stiffness = 1e6",
        "curve = [[0, 0, 1], [1, 2, 3]]",
        ["joints.joint1.x.curve.0", "[0, 0, 1]", "2 numbers"],
    ),
    "curve of words": ("stiffness = 1e6", 'curve = [[0, 0], [1, "a"]]', ["joints.joint1.x.curve.1.1", "'a'", "finite"]),
    "curve as a number": ("stiffness = 1e6", "curve = 3", ["joints.joint1.x.curve", "3", "array of arrays"]),
    "curve from nowhere": ("stiffness = 1e6", 'curve = "a.csv"', ["joints.joint1.x.curve", "'a.csv'", "relative"]),
    "curve and stiffness": (
        "stiffness = 1e6",
        "stiffness = 1, curve = [[0, 0], [1, 2]]",
        ["joints.joint1.x.curve", "stiffness is given, too", "instead of"],
    ),
    "curve and friction that is none": (
        "stiffness = 1e6",
        "curve = [[0, 0], [1, 2]], friction = { coulomb = 1, static = 2 }",
        ["joints.joint1.x.friction", "static and stribeck"],
    ),
    "prescribed": ("limits =", 'prescribed = ["w"]\nlimits =', ["joints.joint1.prescribed", "'w'", "x, y, z, alpha"]),
    "role": ("stiffness = 1e6", 'role = "drive"', ["joints.joint1.x.role", "'drive'", "free, locked, prescribed"]),
    "inertia policy": ("tunable =", 'inertia = "ignore"\ntunable =', ["inertia", "'ignore'", "error, warn, project"]),
    "urdf without folder": ("tunable =", 'urdf = "a.urdf"\ntunable =', ["urdf", "'a.urdf'", "relative"]),
    "tunable of no link": ("links.link2.mass", "links.lnk2.mass", ["tunable", "lnk2.mass", "links.link2.mass"]),
    "tunable of no joint": (
        "links.link2.mass",
        "joints.joint3.x.damping",
        ["tunable", "joint3.x", "joints.joint1.x.damping"],
    ),
    "tunable of inactive": ("links.link2.mass", "joints.joint2.x.damping", ["tunable", "joint2.x", "allowed: gravity"]),
    "tunable rpy of dh": ("links.link2.mass", "joints.joint1.placement.rpy", ["tunable", "joint1", "dh does not"]),
    "tunable half wildcard": (
        "links.link2.mass",
        "links.link*.mass",
        ["tunable", "'links.link*.mass'", "any one component"],
    ),
    "tunable number": ('["links.link2.mass"]', "[3]", ["tunable", "[3]", "an array of strings"]),
    "nothing moves": ('"revolute"', '"fixed"', ["joints", "allowed"]),
}
NOTHING_MOVES = re.sub("^(x|gamma|limits) = .*\n", "", ARM, flags=re.MULTILINE).replace('"prismatic"', '"fixed"')


@pytest.mark.parametrize("case", TOML_CASES)
def test_bad_toml(case: str) -> None:
    old, new, expected = TOML_CASES[case]
    text = changed(NOTHING_MOVES if case == "nothing moves" else ARM, old, new)
    message = refusal(lambda text: robot_from_toml(text, source="my.toml"), text)
    assert re.match(r"my\.toml:[0-9]+:[0-9]+: ", message)
    assert re.search("allowed|leave", message)  # what to write instead
    for part in expected:
        assert part in message


URDF_CASES = {
    "not XML": ("<?xml", "hello <?xml", ["not well-formed XML"]),
    "truncated": ("</robot>", "", ["my.urdf:26:1: ", "not well-formed XML"]),
    "doctype": (
        "<robot",
        '<!DOCTYPE robot SYSTEM "http://localhost/x.dtd"><robot',
        ["document type", "plain elements"],
    ),
    "entity": ("<robot", '<!DOCTYPE r [<!ENTITY a "b">]><robot', ["entity", "plain elements"]),
    "unknown entity": ('name="arm"', 'name="&arm;"', ["not well-formed XML"]),
    "no robot name": ('<robot name="arm"', "<robot", ["robot", "name is missing"]),
    "xacro": ("<link", '<x:macro xmlns:x="http://ros.org/wiki/xacro"/><link', ["xacro", "expanded"]),
    "duplicate link": ('<link name="lower"', '<link name="upper"', ["link 'upper'", "unique"]),
    "duplicate joint": ('<joint name="elbow"', '<joint name="shoulder"', ["joint 'shoulder'", "unique"]),
    "link without name": ('<link name="ground"', "<link", ["link number 1", "name is missing"]),
    "unknown type": ('type="revolute"', 'type="planar"', ["joint 'shoulder'", "'planar'", "continuous, prismatic"]),
    "type missing": ('type="revolute"', "", ["joint 'shoulder'", "type is missing", "continuous, prismatic"]),
    "no parent": ('<parent link="ground"/>', "", ["joint 'shoulder'", "<parent"]),
    "no child": ('<child link="upper"/>', "", ["joint 'shoulder'", "<child"]),
    "unknown parent": (
        '<parent link="upper"/>',
        '<parent link="uper"/>',
        ["'elbow', <parent>", "'uper'", "mean 'upper'"],
    ),
    "two parents": (
        '<child link="lower"/>',
        '<child link="upper"/>',
        ["2 links without a parent", "'ground', 'lower'", "one root"],
    ),
    "second parent": (
        "</robot>",
        '<joint name="more" type="fixed"><parent link="ground"/><child link="lower"/></joint></robot>',
        ["joints.more.child", "'lower'", "'elbow'", "one parent"],
    ),
    "parent twice": (
        '<parent link="ground"/>',
        '<parent link="ground"/><parent link="lower"/>',
        ["'shoulder'", "2 elem"],
    ),
    "cycle": ('<parent link="ground"/>', '<parent link="lower"/>', ["cycle"]),
    "cycle of all": (
        "</robot>",
        '<joint name="more" type="fixed"><parent link="lower"/><child link="ground"/></joint></robot>',
        ["robot", "cycle", "one root"],
    ),
    "no axis": (
        '<axis xyz="0 1 0"/>',
        '<axis xyz="0 0 0"/>',
        ["joint 'shoulder', <axis>", "[0.0, 0.0, 0.0]", "direction"],
    ),
    "axis of two": ('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', ["joint 'shoulder', <axis>", "'0 1'", "three numbers"]),
    "nan": ('value="2.0"', 'value="nan"', ["link 'upper', <inertial>, <mass>", "'nan'", "a finite number"]),
    "inf": ('xyz="0 0 0.5"', 'xyz="0 0 inf"', ["joint 'shoulder', <origin>", "'inf'", "a finite number"]),
    "overflow": ('value="2.0"', 'value="1e999"', ["'1e999'", "a finite number"]),
    "5000 digits": ('value="2.0"', f'value="{"9" * 5000}"', ["99...'", "a finite number"]),
    "underscore": ('value="2.0"', 'value="2_0"', ["'2_0'", "a finite number"]),
    "hexadecimal": ('value="2.0"', 'value="0x10"', ["'0x10'", "a finite number"]),
    "other digits": ('value="2.0"', 'value="\N{ARABIC-INDIC DIGIT TWO}"', [r"'\u0662'", "a finite number"]),
    "negative mass": ('value="2.0"', 'value="-2.0"', ["link 'upper', <inertial>, <mass>", "-2", "at least 0"]),
    "mass missing": ('<mass value="2.0"/>', "", ["link 'upper', <inertial>", "no <mass>"]),
    "inertia incomplete": ('iyz="0"', "", ["link 'upper', <inertial>, <inertia>", "iyz is missing", "a finite number"]),
    "impossible inertia": ('izz="0.15"', 'izz="0.9"', ["links.upper.inertia", "eigenvalue -", '"project"']),
    "limits reversed": ('lower="-1"', 'lower="3"', ["joint 'shoulder', <limit>", "3", "lower <= upper"]),
    "negative damping": ('damping="0.7"', 'damping="-1"', ["joint 'shoulder', <dynamics>", "-1", "at least 0"]),
    "control character": ('type="revolute"', 'type="&#27;"', ["not well-formed XML"]),
    "text that turns a line": ('type="revolute"', 'type="&lt;\u202eb&gt;"', [r"'<\u202eb>'", "allowed"]),
}


@pytest.mark.parametrize("case", URDF_CASES)
def test_bad_urdf(case: str) -> None:
    old, new, expected = URDF_CASES[case]
    message = refusal(lambda text: robot_from_urdf(text, source="my.urdf"), changed(URDF, old, new))
    assert re.match(r"my\.urdf:[0-9]+:[0-9]+: ", message)
    assert "allowed" in message
    for part in expected:
        assert part in message


@pytest.mark.parametrize(
    ("read", "sample", "case", "line"),
    [
        (robot_from_toml, ARM, TOML_CASES[name], line)
        for name, line in {
            "negative mass": 8,
            "text in vector": 9,
            "mass missing": 6,
            "unknown friction": 23,
            "unknown key": 23,
            "unknown top key": 3,
            "unknown child": 30,
            "own parent": 27,
            "integer of 5000 digits": 8,
            "tunable of no link": 4,
            "spring of no link": 36,
        }.items()
    ]
    + [
        (robot_from_urdf, URDF, URDF_CASES[name], line)
        for name, line in {
            "truncated": 26,
            "duplicate link": 11,
            "unknown parent": 22,
            "no axis": 17,
            "negative mass": 7,
            "inertia incomplete": 8,
            "impossible inertia": 4,
            "second parent": 25,
            "parent twice": 15,
            "doctype": 2,
        }.items()
    ],
)
def test_lines(read: Callable[[str], Robot], sample: str, case: tuple[str, str, list[str]], line: int) -> None:
    assert re.findall(r"\bline ([0-9]+)", refusal(read, changed(sample, *case[:2]))) == [str(line)]


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9))
    + ']><robot name="&j;"/>'
)


@pytest.mark.parametrize(
    "text",
    [
        BOMB,
        '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]><robot name="&e;"/>',
        '<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1:9/x"> %p;]><robot name="r"/>',
        '<robot name="r" xmlns:xi="http://www.w3.org/2001/XInclude"><xi:include href="/etc/passwd"/></robot>',
        "",
        "\0",
        "<robot",
        '<robot name="r"/>',
        '<sdf version="1.6"/>',
        '<robot name="r"><link name="a"/></robot>',
        "<a>" * 200_000,
        "<a>" * 50_000 + "</a>" * 50_000,
        '<robot name="r">' + "<link>" * 30_000 + "</link>" * 30_000 + "</robot>",
        '<?xml version="1.0" encoding="klingon"?><robot name="r"/>',
        '<robot name="\ud800"/>',
        f'<robot name="r" xmlns:a="{"u" * 50_000}">' + "".join(f"<a:b{k}/>" for k in range(20_000)) + "</robot>",
    ],
    ids=range(16),
)
def test_hostile_xml(text: str) -> None:
    message = refusal(robot_from_urdf, text)
    assert "passwd" not in message
    assert "root:" not in message


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000,
        "a = " + "{a = " * 10_000,
        "a." * 2_000 + "a = 1",
        "a." * 200 + "a = 1",
        "[" + "a . " * 30_000 + "a]",
        ARM.replace("stiffness = 1e6", "curve = [" + "[0, 1], " * 30_000 + "]"),
        "".join(f"[[links]]\nname = '{'a' * 120}{k}'\nmass = 1\n" for k in range(3_000))
        + "[[joints]]\nname = 'j'\nparent = 'base'\ntype = 'free'\nchild = '"
        + "a" * 128
        + "'",
        "a = " + "1" * 100_000 + ".0",
        'name = "r"\n' + "links." * 500 + "a = 1",
        "\0",
        "a = 1\n" * 2,
        "[[links]]\n" * 1000,
        'name = "r"\ngravity = [' + "0, " * 100_000 + "]",
        "",
        'name = "r"',
    ],
    ids=range(15),
)
def test_hostile_toml(text: str) -> None:
    """Some took minutes and gigabytes once: what grows with the square of the text is refused, or done otherwise."""
    refusal(robot_from_toml, text)


def test_as_many_links_as_there_may_be() -> None:
    """A long chain, then a bushy tree, of names that are no identifiers; bad_files.py has what goes beyond."""
    count = MOST_ENTRIES
    parts = ['<robot name="many">', *(f'<link name="l-{k}"/>' for k in range(count))]
    for k in range(1, count):
        parent = k - 1 if k < count // 2 else k // 2
        parts.append(f'<joint name="j-{k}" type="revolute"><parent link="l-{parent}"/><child link="l-{k}"/></joint>')
    text = "\n".join([*parts, "</robot>"])
    robot = robot_from_urdf(text)
    assert len(robot.links) == count - 1


def test_files(tmp_path: Path) -> None:
    cases: dict[str, tuple[bytes | None, list[str]]] = {
        "absent.toml": (None, ["absent.toml", "no such file"]),
        "latin.toml": ('name = "\N{LATIN SMALL LETTER U WITH DIAERESIS}"'.encode("latin-1"), ["byte 8", "UTF-8"]),
        "latin.urdf": (b'<?xml version="1.0" encoding="latin-1"?><robot name="\xfc"/>', ["byte", "UTF-8"]),
        "wide.urdf": (URDF.encode("utf-16"), ["byte 0", "UTF-8"]),
        "arm.xml": (b"<robot/>", ["arm.xml:1:1: robot", "no <link>"]),
        "arm.yaml": (b"name: arm", ["there is no robot", ".toml, .urdf, .xml"]),
        "link.toml": (b'urdf = "nowhere.urdf"', ["nowhere.urdf", "no such file"]),
        "type.toml": (b'urdf = "nowhere.xml"', ["'nowhere.xml'", ".urdf"]),
        "control.toml": (b'urdf = "\\u001b[31m.urdf"', ["x1b[31m", "no such file"]),
        "nul.toml": (b'urdf = "a\\u0000.urdf"', ["x00", "allowed"]),
    }
    for name, (content, expected) in cases.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        message = refusal(lambda path: load_robot(path), str(tmp_path / name))
        for part in expected:
            assert part in message, (name, message)
    (tmp_path / "folder.toml").mkdir()
    assert "no such file" in refusal(lambda path: load_robot(path), str(tmp_path / "folder.toml"))


CSV_CASES = {
    "no file": (None, ["there is no such file", "deviation,force"]),
    "three columns": ("0,1,2\n1,2,3\n", ["joints.joint1.x.curve", "line 1", "'0,1,2'", "deviation,force"]),
    "a word": ("s,F\n0,1\n1,two\n", ["joints.joint1.x.curve", "line 3", "'1,two'"]),
    "two headings": ("s,F\nm,N\n0,1\n", ["line 2", "'m,N'"]),
    "not a number": ("0,nan\n1,1\n", ["joints.joint1.x.curve.0.1", "nan", "finite"]),
    "empty": ("s,F\n", ["joints.joint1.x.curve", "0 points", "2 to 64"]),
    "falling": ("0,1\n-1,2\n", ["joints.joint1.x.curve", "point 1", "-1.0 after 0.0"]),
}


@pytest.mark.parametrize("case", CSV_CASES)
def test_bad_curve_files(case: str, tmp_path: Path) -> None:
    text, words = CSV_CASES[case]
    if text is not None:
        (tmp_path / "spring.csv").write_text(text, encoding="ascii")
    toml = changed(ARM, "stiffness = 1e6", 'curve = "spring.csv"')
    message = refusal(lambda text: robot_from_toml(text, folder=tmp_path), toml)
    for word in words:
        assert word in message


def test_bad_urdf_behind_toml_names_both(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.toml").write_text('name = "a"\nurdf = "arm.urdf"\n[[joints]]\nname = "elbo"\nx = {}\n')
    message = refusal(lambda path: load_robot(path), str(tmp_path / "arm.toml"))
    assert "joints.elbo" in message
    assert "mean 'elbow'" in message
    (tmp_path / "arm.urdf").write_text(URDF.replace('"planar"', "").replace('"continuous"', '"planar"'))
    assert "arm.urdf:21:3: joint 'elbow'" in refusal(lambda path: load_robot(path), str(tmp_path / "arm.toml"))


@pytest.mark.parametrize(
    ("source", "expected"),
    [("puma56", "mean 'puma560'"), ("", "one_link"), ("no\nsuch", "'no\\nsuch'"), ("ur5.TOML", "allowed")],
)
def test_unknown_robot(source: str, expected: str) -> None:
    assert expected in refusal(load_robot, source)


@pytest.mark.parametrize("source", [None, 3, b"ur5", ["ur5"]])
def test_source_of_wrong_type(source: object) -> None:
    with pytest.raises(DescriptionError, match="a name or a path"):
        load_robot(source)  # type: ignore[arg-type]


def test_bad_policy_keyword() -> None:
    with pytest.raises(DescriptionError, match=r"'off'.*error, warn, project"):
        load_robot("ur5", inertia="off")


FUZZ = settings(max_examples=300, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
KEYS = [
    "x",
    "curve",
    "friction",
    "clearance",
    "name",
    "gravity",
    "urdf",
    "inertia",
    "tunable",
    "links",
    "joints",
    "frames",
    "loops",
    "springs",
    "points",
    "tension_only",
    "free_length",
    "mass",
    "com",
    "parent",
    "child",
    "type",
    "dh",
    "placement",
    "x",
    "gamma",
    "limits",
    "prescribed",
    "placements",
    "xyz",
    "rpy",
    "xx",
    "stiffness",
    "a",
]
SCALARS = st.one_of(
    st.none().map(lambda _: "base"),
    st.sampled_from(
        ["arm", "link1", "joint1", "revolute", "fixed", "free", "project", "links.*.mass", "*", "a.urdf", ""]
    ),
    st.text(max_size=8),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.booleans(),
)
TABLES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=4), inner, max_size=6)
    ),
    max_leaves=25,
)


def outcome(read: Callable[[str], Robot], text: str) -> Robot | DescriptionError:
    """What comes of the text; any other exception is an error of this test."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return read(text)
        except DescriptionError as error:
            return error


def harmless(read: Callable[[str], Robot], text: str) -> None:
    """A Robot with clean names and finite numbers, or a DescriptionError in printable ASCII."""
    robot = outcome(read, text)
    if isinstance(robot, DescriptionError):
        check_message(robot)
    else:
        check_robot(robot)


def any_table(top: dict[str, object]) -> None:
    harmless(robot_from_toml, "\n".join(f"{key} = {as_toml(value)}" for key, value in top.items()))


def any_value(table: str, key: str, value: object) -> None:
    closed = ARM.replace(*loop("placements = [{}, {}]"))
    closed = closed.replace(*spring("stiffness = 1", "free_length = 0.1", "points = [[0, 0, 1], [1, 0, 0]]"))
    given = f"[[{table}]]\n{json.dumps(key)} = {as_toml(value)}\n"
    harmless(robot_from_toml, closed.replace(f"[[{table}]]\n", given, 1))
    line = re.compile(f"^{key} = .*$", re.MULTILINE)
    harmless(robot_from_toml, line.sub(lambda _: f"{key} = {as_toml(value)}", closed, count=1))


TOPS = st.dictionaries(st.sampled_from(KEYS), TABLES, max_size=6)
ENTRIES = (st.sampled_from(["links", "joints", "frames", "loops", "springs"]), st.sampled_from(KEYS), TABLES)
test_any_toml_table_is_harmless = FUZZ(given(TOPS)(any_table))
test_any_value_in_a_good_toml_is_harmless = FUZZ(given(*ENTRIES)(any_value))


@pytest.mark.soak
@settings(FUZZ, max_examples=2_000)
@given(TOPS)
def test_more_tables_are_harmless(top: dict[str, object]) -> None:
    any_table(top)


@pytest.mark.soak
@settings(FUZZ, max_examples=2_000)
@given(*ENTRIES)
def test_more_values_in_a_good_toml_are_harmless(table: str, key: str, value: object) -> None:
    any_value(table, key, value)


PIECES = [
    '"',
    "<",
    ">",
    "/>",
    "&amp;",
    "=",
    "{",
    "}",
    "[",
    "]",
    "\n",
    "nan",
    "-",
    "1e400",
    "-1",
    "0",
    "<link/>",
    "link1",
    '<joint name="j" type="fixed">',
    "upper",
    "base",
    "\0",
    "\N{SNOWMAN}",
    "]]>",
    "<!--",
    "'''",
    "x = ",
    "free",
]
EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(PIECES) | st.text(max_size=3)),
    min_size=1,
    max_size=4,
)


def edited(text: str, edits: list[tuple[float, int, str]]) -> str:
    for where, length, piece in edits:
        at = int(where * len(text))
        text = text[:at] + piece + text[at + length :]
    return text


@FUZZ
@given(EDITS)
def test_mutated_urdf_is_harmless(edits: list[tuple[float, int, str]]) -> None:
    harmless(lambda text: robot_from_urdf(text, inertia="project"), edited(URDF, edits))


@FUZZ
@given(EDITS)
def test_mutated_toml_is_harmless(edits: list[tuple[float, int, str]]) -> None:
    harmless(lambda text: robot_from_toml(text, inertia="project"), edited(ARM, edits))


NUMBERS = st.sampled_from(["0", "-0", "1e-320", "1e30", "-1e30", "1e-30", "3.14", "1.5707963267948966", "-2", "1e31"])


@FUZZ
@given(st.lists(NUMBERS, min_size=22, max_size=22))
def test_extreme_numbers_in_urdf_are_harmless(numbers: list[str]) -> None:
    values = iter(numbers)
    text = re.sub(r'(?<=[" ])-?[0-9.]+(?=[" ])', lambda found: next(values, "1"), URDF.split("?>")[1])
    harmless(lambda text: robot_from_urdf(text, inertia="project", urdf_damping=True), text)


@pytest.mark.parametrize("name", ["lambda", "class", "import"])
def test_python_keyword_as_robot_name(name: str) -> None:
    with pytest.raises(DescriptionError, match=rf"(?s)name.*{name}.*no Python keyword"):
        robot_from_toml(f'name = "{name}"\n')
