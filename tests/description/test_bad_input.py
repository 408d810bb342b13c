"""Bad descriptions: one DescriptionError each, that names the thing, the value and what is allowed; nothing else."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from eomgen.description.load import load_robot, robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError
from eomgen.limits import MOST_ENTRIES
from eomgen.robot.value import Robot
from tests.support.bad_robots import NOTHING_MOVES, TOML_CASES, changed
from tests.support.description_samples import ARM, URDF


def refusal(read: Callable[[str], Robot], text: str) -> str:
    """The message with which the text is refused: one printable line of reasonable length."""
    with pytest.raises(DescriptionError) as caught:
        read(text)
    message = str(caught.value)
    assert message.isascii()
    assert message.isprintable()
    assert len(message) < 1000
    assert caught.value.__cause__ is None
    return message


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
        ["'shoulder'", "2 elements <parent> that differ"],
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
    "negative damping": ('damping="0.7"', 'damping="-1"', ["joint 'shoulder', <dynamics>", "-1", "at least 0"]),
    "control character": ('type="revolute"', 'type="&#27;"', ["not well-formed XML"]),
    "text that turns a line": ('type="revolute"', 'type="&lt;\u202eb&gt;"', [r"'<\u202eb>'", "allowed"]),
}


@pytest.mark.parametrize("case", URDF_CASES)
def test_bad_urdf(case: str) -> None:
    old, new, expected = URDF_CASES[case]
    message = refusal(lambda text: robot_from_urdf(text, source="my.urdf", inertia="error"), changed(URDF, old, new))
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
    message = refusal(lambda text: read(text, inertia="error"), changed(sample, *case[:2]))  # type: ignore[call-arg]
    assert re.findall(r"\bline ([0-9]+)", message) == [str(line)]


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
    assert "it is a folder" in refusal(lambda path: load_robot(path), str(tmp_path / "folder.toml"))


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


def test_what_only_the_whole_robot_shows_names_the_urdf_behind_toml(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text('name = "a"\nurdf = "arm.urdf"\n[[joints]]\nname = "elbow"\nx = {}\n')
    (tmp_path / "arm.urdf").write_text(URDF.replace('izz="0.15"', 'izz="9"'))
    message = refusal(lambda path: load_robot(path, inertia="error"), str(tmp_path / "arm.toml"))
    assert message.startswith(f"{tmp_path / 'arm.urdf'}:4:3: links.upper.inertia: no body can have")
    (tmp_path / "arm.toml").write_text('name = "a"\nurdf = "arm.urdf"\n[[links]]\nname = "upper"\n')
    message = refusal(lambda path: load_robot(path, inertia="error"), str(tmp_path / "arm.toml"))
    assert message.startswith(f"{tmp_path / 'arm.toml'}:3:")


@pytest.mark.parametrize("read", [robot_from_urdf, robot_from_toml])
def test_a_robot_that_does_not_move_is_refused_with_its_place(read: Callable[[str], Robot]) -> None:
    fixed = URDF.replace('"revolute"', '"fixed"').replace('"continuous"', '"fixed"')
    arm = ARM.replace('"revolute"', '"fixed"').replace('"prismatic"', '"fixed"').replace("limits = [-1, 2]", "")
    arm = arm.replace("gamma = {", "# ").replace("x = { stiffness", "# ")
    text, line = (fixed, 2) if read is robot_from_urdf else (arm, 17)
    with pytest.raises(DescriptionError, match="no joint has a coordinate") as raised:
        read(text)
    assert raised.value.line == line


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


@pytest.mark.parametrize("name", ["lambda", "class", "import"])
def test_python_keyword_as_robot_name(name: str) -> None:
    with pytest.raises(DescriptionError, match=rf"(?s)name.*{name}.*no Python keyword"):
        robot_from_toml(f'name = "{name}"\n')
