"""Inertias that no body can have: whose they are, how much is round-off, and what each policy does about them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from eomgen.authoring.check import check_file
from eomgen.cli import entry as cli
from eomgen.description.load import load_robot, robot_from_mjcf, robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError, EomgenWarning
from eomgen.robot.value import Robot
from tests.support.bad_files import changed
from tests.support.description_samples import ARM, MJCF, URDF
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

STRANGE = changed(URDF, 'izz="0.15"', 'izz="0.9"')  # of the link upper, line 4
STRANGE_TOML = changed(ARM, "{ xx = 0.1, yy = 0.2, zz = 0.2 }", "{ xx = 0.1, yy = 0.2, zz = 0.5 }")
STRANGE_MJCF = changed(MJCF, "0.02 0.03 0.02", "0.02 0.03 0.2")  # of the body shin, line 23
LIGHTLY = "ignore::eomgen.errors.EomgenWarning"


@pytest.mark.parametrize(
    ("read", "text", "place", "link"),
    [(robot_from_urdf, STRANGE, "r.x:4:3", "upper"), (robot_from_mjcf, STRANGE_MJCF, "r.x:23:11", "shin")],
    ids=["URDF", "MJCF"],
)
def test_what_others_wrote_is_taken_with_a_note_that_says_where(read, text: str, place: str, link: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.warns(EomgenWarning, match=re.escape(f"{place}: link {link}: no body can have")):
        robot: Robot = read(text, source="r.x")
    (note,) = [note for note in robot.notes if "no body" in note]
    assert note.startswith(f"{place}: link {link}: no body can have")
    assert note.endswith("taken as it is")
    with pytest.warns(EomgenWarning):
        assert robot.links == read(text, inertia="warn").links
    refused(DescriptionError, f"links.{link}.inertia", read, text, inertia="error")


def test_toml_is_refused_by_default() -> None:
    with pytest.raises(DescriptionError, match=r"my\.toml:10:11: links\.link1\.inertia: no body can have"):
        robot_from_toml(STRANGE_TOML, source="my.toml")


def refined(folder: Path, toml: str = "", urdf: str = STRANGE) -> Path:
    (folder / "arm.urdf").write_text(urdf)
    path = folder / "arm.toml"
    path.write_text('urdf = "arm.urdf"\n' + toml)
    return path


@pytest.mark.filterwarnings(LIGHTLY)
def test_a_toml_file_refuses_its_own_inertias_and_takes_those_of_its_urdf(tmp_path: Path) -> None:
    link = '[[links]]\nname = "{}"\ninertia = {{ xx = 1, yy = 1, zz = 3 }}\n'
    robot = load_robot(refined(tmp_path, '[[links]]\nname = "upper"\nmass = 3\n'))
    assert [note.startswith(f"{tmp_path / 'arm.urdf'}:4:3: link upper: no body") for note in robot.notes] == [
        False,
        True,
    ]
    with pytest.raises(DescriptionError, match=r"arm\.toml:4:11: links\.lower\.inertia"):
        load_robot(refined(tmp_path, link.format("lower")))
    with pytest.raises(DescriptionError, match=r"links\.upper\.inertia"):  # the file's word is on all of its links
        load_robot(refined(tmp_path, 'inertia = "error"\n'))
    robot = load_robot(refined(tmp_path, 'inertia = "project"\n' + link.format("lower")))
    assert len([note for note in robot.notes if "projected to" in note]) == 2
    with pytest.raises(DescriptionError, match=r"links\.upper\.inertia"):  # and the keyword's is above it
        load_robot(refined(tmp_path, 'inertia = "warn"\n'), inertia="error")


def test_the_ground_has_no_inertia_to_judge() -> None:
    """A root link that stands still, as ANYmal's or Go1's; where a joint carries it, it is a body like others."""
    ground = (
        '<link name="ground"><inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )
    text = re.sub(r'<link name="ground".*?(/>|</link>)', ground, URDF, count=1)
    assert robot_from_urdf(text, inertia="error").links == robot_from_urdf(URDF).links
    carried = text.replace(
        "</robot>",
        '<link name="world"/><joint name="float" type="floating"><parent link="world"/><child link="ground"/></joint>'
        "</robot>",
    )
    refused(DescriptionError, r"links\.ground\.inertia", robot_from_urdf, carried, inertia="error")


HEAD = """<robot name="head"><link name="neck"/>
<link name="face"><inertial><origin xyz="{com}"/><mass value="1.33687"/>
<inertia ixx="0" iyy="0" izz="{izz}" ixy="0" ixz="{ixz}" iyz="0"/></inertial></link>
<joint name="nod" type="revolute"><parent link="neck"/><child link="face"/></joint>
<link name="eye"/>
<joint name="turn" type="revolute"><origin xyz="{eye}"/><parent link="face"/><child link="eye"/></joint></robot>"""


@pytest.mark.parametrize(
    ("com", "eye"), [("0.0185 -0.1108 6.78454e-18", "0 0 0"), ("0 0 0", "0 0 0.1")], ids=["by its com", "by its joints"]
)
def test_round_off_is_measured_against_mass_and_size(com: str, eye: str) -> None:
    """iCub's head weighs 1.3 kg, has its centre of mass 0.1 m away, and no moment of inertia but a product of 2e-35."""
    still = HEAD.format(com=com, eye=eye, izz="0", ixz="2.40741e-35")
    assert robot_from_urdf(still, inertia="error").notes == ()
    with pytest.raises(DescriptionError, match=r"links\.face\.inertia"):
        robot_from_urdf(HEAD.format(com=com, eye=eye, izz="1e-6", ixz="0"), inertia="error")
    with pytest.raises(DescriptionError, match=r"links\.face\.inertia"):  # of a link without a size
        robot_from_urdf(HEAD.format(com="0 0 0", eye="0 0 0", izz="0", ixz="2.40741e-35"), inertia="error")


def test_a_light_links_inertia_is_measured_against_itself() -> None:
    text = HEAD.replace("1.33687", "1e-6").format(com="0 0 0.01", eye="0 0 0", izz="2e-8", ixz="0")
    refused(DescriptionError, r"links\.face\.inertia", robot_from_urdf, text, inertia="error")


def test_check_follows_the_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.urdf").write_text(STRANGE)
    Path("a.toml").write_text(STRANGE_TOML)

    def check(*arguments: str) -> tuple[bool, list[str]]:
        status = cli.main(["check", *arguments])
        return status == 0, capsys.readouterr().out.splitlines()

    good, lines = check("a.urdf")
    assert good
    assert lines[0] == "a.urdf: ok: 2 links, 2 coordinates"
    assert [line for line in lines if line.startswith("a.urdf:4:3: note: link upper: no body can have")] == [lines[-1]]
    good, lines = check("a.urdf", "--inertia", "error")
    assert not good
    assert lines[0].startswith("a.urdf:4:3: links.upper.inertia: no body can have")
    good, lines = check("a.toml")
    assert not good
    assert lines[0].startswith("a.toml:10:11: links.link1.inertia")
    for policy, end in (("warn", "taken as it is"), ("project", "[xx yy zz xy xz yz]")):
        good, lines = check("a.toml", "a.urdf", "--inertia", policy, "--json")
        assert good
        for found in json.loads("".join(lines)):
            assert found["ok"]
            assert [note for note in found["notes"] if note.endswith(end)]


@pytest.mark.filterwarnings(LIGHTLY)
def test_check_from_python(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_text(STRANGE)
    assert check_file(path).errors == ()
    assert len(check_file(path, inertia="error").errors) == 1
    (error,) = check_file(path, inertia="off").errors
    assert "error, warn, project" in str(error)
