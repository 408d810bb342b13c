"""eomgen new, eomgen check and eomgen schema."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.authoring.check import check_file
from eomgen.authoring.new import write_new_file
from eomgen.authoring.schema_files import schema_path
from eomgen.authoring.schemas import schema_text
from eomgen.cli import entry as cli
from eomgen.description.builtin import builtin_robots
from eomgen.errors import InputError, ReachError
from eomgen.motion.ends import point_of
from eomgen.motion.poses import inverse_kinematics
from eomgen.robot.model import program_coordinates
from eomgen.scenario.load import scenario_from_toml
from tests.support.bad_files import PLAN, SCENARIO
from tests.support.description_samples import ARM, URDF

pytestmark = pytest.mark.usefixtures("unoptimised")

BAD = (
    ARM.replace("mass = 3.0", "mass = -3.0")
    .replace("stiffness = 1e6", 'stifness = 1e6, clearance = "a"')
    .replace('parent = "link1"\n', "")
    .replace("xyz = [0.0, 0.0, 0.1]", "xyz = [0.0, 0.1]")
    .replace("gravity =", "# \N{SNOWMAN}\n'gra vity' =")
)


def test_a_new_robot_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """It and its scenario load, generate and run as they are written."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "my_arm"]) == 0
    assert cli.main(["new", "move", "--scenario", "-o", "s.toml"]) == 0
    assert capsys.readouterr().out == "wrote my_arm.toml\nwrote s.toml\n"
    robot = eomgen.load_robot("my_arm.toml")
    assert robot.name == "my_arm"
    assert list(robot.joints[0].coordinates) == ["x", "y", "beta", "gamma"]
    first = Path("my_arm.toml").read_text(encoding="ascii").splitlines()[0]
    assert first == "#:schema ./robot.schema.json"
    for kind in ("robot", "scenario"):
        assert Path(f"{kind}.schema.json").read_bytes() == schema_path(kind).read_bytes()
    assert cli.main(["check", "my_arm.toml", "s.toml"]) == 0
    printed = capsys.readouterr().out
    assert printed == "my_arm.toml: ok: 1 links, 4 coordinates\ns.toml: ok: 1 s, 0 wrenches, 0 payloads\n"
    assert cli.main(["generate", "my_arm.toml", "-o", "out", "--kernels", "mass_matrix"]) == 0
    assert cli.main(["simulate", "my_arm.toml", "--scenario", "s.toml", "-o", "out", "--no-plots"]) == 0
    result = eomgen.load_result("out/trajectory.npz")
    assert result.series("joint1.gamma").values[-1] == pytest.approx(0.8, abs=1e-3)
    assert abs(result.balance.relative_residue) < 1e-4


@pytest.mark.parametrize("name", builtin_robots())
def test_a_scenario_for_a_robot_has_its_names(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A goal of the first coordinate that is driven, within its limits; nothing of a motion where none is."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", name, "--scenario"]) == 0
    assert capsys.readouterr().out == f"wrote {name}_scenario.toml\n"
    text = Path(f"{name}_scenario.toml").read_text(encoding="ascii")
    robot, scenario = eomgen.load_robot(name), scenario_from_toml(text)
    assert f'# link = "{robot.links[0].name}"' in text
    driven = program_coordinates(robot)[:1]
    assert (scenario.motion is not None) == (scenario.control is not None) == bool(driven)
    if scenario.motion is not None:
        ((key, goal),) = scenario.motion.values["goal"].items()
        assert key in (driven[0], driven[0].partition(".")[0])
        low, high = robot.limits_of(driven[0]).range
        assert low <= goal <= high
    with pytest.raises(InputError, match="is there already"):
        write_new_file(name, kind="scenario")


def test_a_schema_of_another_version_is_replaced_and_a_file_that_is_none_stays(tmp_path: Path) -> None:
    beside, text = tmp_path / "robot.schema.json", schema_path("robot").read_text(encoding="ascii")
    beside.write_text(json.dumps({"title": json.loads(text)["title"]}), encoding="ascii")
    write_new_file("first", tmp_path / "first.toml")
    assert beside.read_text(encoding="ascii") == text
    for other in ("[]", "{", '{"title": 3}', "[" * 100_000):
        beside.write_text(other, encoding="ascii")
        with pytest.raises(InputError, match=r"robot\.schema\.json' there is no schema of a robot"):
            write_new_file("second", tmp_path / "second.toml")
        assert beside.read_text(encoding="ascii") == other
        assert not (tmp_path / "second.toml").exists()
    beside.unlink()
    os.mkfifo(beside)  # nothing is waited for
    with pytest.raises(InputError, match=r"robot\.schema\.json' there is no schema of a robot"):
        write_new_file("second", tmp_path / "second.toml")


def taken_up(text: str, *keys: str) -> str:
    """The text of a new file with the lines of these keys that it offers in comments, in the place of its own."""
    lines = text.splitlines()
    for key in keys:
        (offered,) = (i for i, line in enumerate(lines) if line.startswith(f"# {key} = "))
        own = [i for i, line in enumerate(lines) if line.startswith(f"{key} = ")]
        lines[offered] = lines[offered].removeprefix("# ")
        lines = [line for i, line in enumerate(lines) if i not in own]
    return "\n".join(lines)


def test_what_a_new_robot_offers(tmp_path: Path) -> None:
    """Stops, friction under load and a journal, in comments: each is taken up as it stands."""
    write_new_file("my_arm", tmp_path / "my_arm.toml")
    text = (tmp_path / "my_arm.toml").read_text(encoding="ascii")
    offered = [line.split()[1] for line in text.splitlines() if line.startswith("# ") and " = " in line[:12]]
    assert offered == ["stops", "gamma", "x", "y", "radial"]
    for keys in (["stops"], ["gamma"], ["x", "y", "radial"], ["stops", "x", "y", "radial"], ["stops", "gamma"]):
        path = tmp_path / f"{'_'.join(keys)}.toml"
        path.write_text(taken_up(text, *keys), encoding="ascii")
        checked = check_file(path)
        assert (checked.errors, checked.notes) == ((), ())
        (joint,) = eomgen.load_robot(path).joints
        gamma = joint.coordinates["gamma"]
        assert ("stops.stiffness" in gamma.further) == ("stops" in keys)
        assert (gamma.friction is not None and gamma.friction.coefficient > 0.0) == ("gamma" in keys)
        assert (joint.radial is not None) == ("radial" in keys)
        assert (joint.coordinates["x"].stiffness is None) == ("x" in keys)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["there"], "new: 'there.toml' is there already; allowed: a file that is not"),
        (["My-Arm"], "new: got the name 'My-Arm'; allowed: a lower-case letter"),
        (["../arm"], "new: got the name '../arm'; allowed: a lower-case letter"),
        (["arm\n"], "new: got the name 'arm\\n'; allowed: a lower-case letter"),
        (["arm", "-o", "arm.txt"], "new: got the file 'arm.txt'; allowed: a path that ends in .toml"),
        (["arm", "-o", "no/arm.toml"], "'no/arm.toml' cannot be written: No such file or directory; allowed: a file"),
    ],
)
def test_what_new_refuses(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.toml").write_text("mine")
    assert cli.main(["new", *arguments]) == 1
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there.toml"]
    assert Path("there.toml").read_text() == "mine"


def test_all_errors_are_said_in_their_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text(BAD, encoding="utf-8")
    assert cli.main(["check", "bad.toml"]) == 1
    printed = capsys.readouterr()
    assert printed.err == "eomgen: check: 1 of 1 files cannot be used; allowed: what is said of each\n"
    found = [line.split(": ")[:3] for line in printed.out.splitlines()]
    assert [(place, *what[:1]) for place, *what in found] == [
        ("bad.toml:4:1", "unknown key 'gra vity'; did you mean 'gravity'? (allowed"),
        ("bad.toml:9:8", "links.link1.mass"),
        ("bad.toml:24:7", "joints.joint1.x"),
        ("bad.toml:24:35", "joints.joint1.x.clearance"),
        ("bad.toml:28:3", "joints.joint2"),
        ("bad.toml:37:21", "frames.tcp.placement.xyz"),
    ]
    assert cli.main(["check", "--json", "bad.toml"]) == 1
    (facts,) = json.loads(capsys.readouterr().out)
    assert [(error["line"], error["column"]) for error in facts["errors"]] == [
        (4, 1),
        (9, 8),
        (24, 7),
        (24, 35),
        (28, 3),
        (37, 21),
    ]
    assert facts["errors"][1] == {
        "file": "bad.toml",
        "line": 9,
        "column": 8,
        "place": "links.link1.mass",
        "message": "got -3.0; allowed: a number that is at least 0",
    }


def test_check_reads_every_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    texts = {
        "arm.toml": ARM,
        "arm.urdf": URDF,
        "s.toml": SCENARIO,
        "p.toml": PLAN,
        "tree.toml": ARM.replace('child = "link2"', 'child = "link1"'),
        "bad.urdf": URDF.replace('value="2.0"', 'value="-2.0"'),
        "none.toml": "",
        "refined.toml": 'urdf = "arm.urdf"\n[[joints]]\nname = "elbow"\nx = { stiffness = 1e5 }\n',
    }
    for name, text in texts.items():
        Path(name).write_text(text, encoding="utf-8")
    assert cli.main(["check", *texts, "missing.toml", "arm.txt"]) == 1
    printed = capsys.readouterr()
    assert "5 of 10 files" in printed.err
    lines = printed.out.splitlines()
    assert lines[:2] == ["arm.toml: ok: 2 links, 3 coordinates", "arm.urdf: ok: 2 links, 2 coordinates"]
    rest = [line for line in lines[2:] if "note" not in line]
    starts = [
        "s.toml: ok: 1 s",
        "p.toml: ok: 1 samples, 1 numbers varied",
        "tree.toml:30:9: joints.joint2.child: link 'link1' is already the child",
        "bad.urdf:7:7: link 'upper', <inertial>, <mass>: value is -2",
        "none.toml:1:1: the key 'name' is missing",
        "refined.toml: ok: 2 links, 3 coordinates",
        "missing.toml: there is no such file",
        "arm.txt: cannot be checked; allowed: a path that ends in .toml, .urdf, .xml",
    ]
    assert len(rest) == len(starts)
    for line, start in zip(rest, starts, strict=True):
        assert line.startswith(start)


def test_many_errors_end(tmp_path: Path) -> None:
    path = tmp_path / "many.toml"
    path.write_text('name = "r"\n' + "".join(f"k{i} = 1\n" for i in range(2000)) + "[[links]]\n" * 300)
    assert len(check_file(path).errors) == 50


def test_the_schema_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["schema", "scenario"]) == 0
    assert capsys.readouterr().out == schema_text("scenario")
    assert cli.main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["properties"]["gravity"]["description"].endswith("[m/s^2]")
    with pytest.raises(SystemExit):
        cli.main(["schema", "urdf"])
    assert "invalid choice: 'urdf'" in capsys.readouterr().err
    with pytest.raises(eomgen.InputError, match="there is no format 'urdf'; allowed: robot, scenario, plan"):
        schema_text("urdf")


ODD = """
name = "arm"
home = { j1.gamma = 90.0 }

[[links]]
name = "upper"
mass = 2.0
com = [120.0, 0.0, 0.0]
inertia = { xx = 0.1, yy = 0.1, zz = 0.1 }

[[links]]
name = "fore"
mass = 2.0

[[joints]]
name = "j1"
parent = "base"
child = "upper"
type = "revolute"
placement = { xyz = [0.0, 0.0, 500.0], rpy = [90.0, 0.0, 0.0] }

[[joints]]
name = "j2"
parent = "upper"
child = "fore"
type = "revolute"
dh = { a = 400.0, alpha = -90.0 }

[[springs]]
name = "cable"
links = ["base", "fore"]
points = [[0.0, 0.0, 1.0], [250.0, 0.0, 0.0]]
stiffness = 1e4
"""


def test_lengths_and_angles_of_another_unit_are_asked_about(tmp_path: Path) -> None:
    """Each by its place, in the unit that it may be of; the rest are counted; numbers of usual sizes are not."""
    path = tmp_path / "odd.toml"
    path.write_text(ODD, encoding="utf-8")
    found = check_file(path)
    assert not found.errors
    assert [note for note in found.notes if "is that in" in note or "such sizes" in note] == [
        "home.j1.gamma = 90 m or rad: is that in degrees (1.5708 rad) or millimetres (0.09 m)?",
        "links.upper.com.0 = 120 m: is that in millimetres (0.12 m)?",
        "joints.j1.placement.xyz.2 = 500 m: is that in millimetres (0.5 m)?",
        "joints.j1.placement.rpy.0 = 90 rad: is that in degrees (1.5708 rad)?",
        "joints.j2.dh.a = 400 m: is that in millimetres (0.4 m)?",
        "2 more of such sizes",
    ]
    path.write_text(re.sub(r"(\d)0\.0\b", r"\g<1>.0", ODD).replace("90", "9").replace("50.0", "5.0"), encoding="utf-8")
    small = check_file(path)
    assert not small.errors
    assert not [note for note in small.notes if "is that in" in note]


def test_goals_of_another_unit_are_asked_about(tmp_path: Path) -> None:
    """In a scenario's file, in what a simulation says of its goal, and where limits or reach refuse it."""
    path = tmp_path / "odd_goal.toml"
    path.write_text('duration = 0.1\n[motion]\ntype = "point_to_point"\ngoal = [90.0, 1.0]\n', encoding="utf-8")
    asked = "motion.goal.0 = 90 m or rad: is that in degrees (1.5708 rad) or millimetres (0.09 m)?"
    assert check_file(path).notes == (asked,)
    question = "joint1.gamma = 90 rad: is that in degrees (1.5708 rad)?"
    with pytest.raises(InputError, match=re.escape(question)):
        point_of(eomgen.load_robot("ur5"), ["joint1.gamma"], "goal", [90.0], np.zeros(1))
    robot = eomgen.load_robot("one_link")
    limits = {joint.name: joint.range for joint in robot.joints}
    assert all(np.isinf(ends).all() for ends in limits.values())
    result = eomgen.simulate(robot, duration=0.1, goal=[90.0], rtol=1e-3)
    assert [note for note in result.notes if "is that in" in note] == [f"goal: {question}"]
    usual = eomgen.simulate(robot, duration=0.1, goal=[1.0], rtol=1e-3)
    assert not [note for note in usual.notes if "is that in" in note]
    kernel = eomgen.build(robot, kernels=("kinematics",))
    with pytest.raises(ReachError, match=re.escape("x = 500 m: is that in millimetres (0.5 m)?")):
        inverse_kinematics(kernel, [500.0, 0.0, 0.0])


def test_built_in_files_have_no_odd_sizes() -> None:
    files = [
        *(Path(eomgen.__path__[0]) / "robots").glob("*.toml"),
        *(Path(eomgen.__path__[0]) / "scenarios").glob("*.toml"),
    ]
    assert len(files) > 15
    assert not [note for path in files for note in check_file(path).notes if "is that in" in note]
