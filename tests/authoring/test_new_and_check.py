"""eomgen new, eomgen check and eomgen schema: first files of robots, scenarios and studies; missing inertia."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.authoring.check import check_file
from eomgen.authoring.inertia import inertia_notes, mass_matrix
from eomgen.authoring.new import write_new_file
from eomgen.authoring.schema_files import schema_path
from eomgen.authoring.schemas import schema_text
from eomgen.authoring.studies import plan_file_text, tolerances_file_text
from eomgen.description.builtin import builtin_robots
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, ReachError
from eomgen.forms.toml_text import parse_toml
from eomgen.identification import tolerance
from eomgen.identification.tolerances.solve import tolerance_quantities
from eomgen.identification.tolerances.table import read_table
from eomgen.motion.ends import point_of
from eomgen.motion.poses import inverse_kinematics
from eomgen.robot.model import build_model, program_coordinates
from eomgen.robot.parameter_names import expand_tunable
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.sweep import plan_from_toml
from tests.support.bad_files import PLAN, SCENARIO
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.commands import command, errors_of, run
from tests.support.description_samples import ARM, URDF
from tests.support.joint_table import joint_table, link_table
from tests.support.makers import MAKERS
from tests.support.optional import needs
from tests.support.random_robots import random_robot, with_offsets
from tests.support.refusals import refused
from tests.support.soak import soaked
from tests.support.text_files import text_file

pytestmark = pytest.mark.usefixtures("unoptimised")

BAD = (
    ARM.replace("mass = 3.0", "mass = -3.0")
    .replace("stiffness = 1e6", 'stifness = 1e6, clearance = "a"')
    .replace('parent = "link1"\n', "")
    .replace("xyz = [0.0, 0.0, 0.1]", "xyz = [0.0, 0.1]")
    .replace("gravity =", "# \N{SNOWMAN}\n'gra vity' =")
)


def test_a_new_robot_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It and its scenario load, generate and run as they are written."""
    monkeypatch.chdir(tmp_path)
    assert command("new", "my_arm") == "wrote my_arm.toml\n"
    assert command("new", "move", "--scenario", "-o", "s.toml") == "wrote s.toml\n"
    robot = eomgen.load_robot("my_arm.toml")
    assert robot.name == "my_arm"
    assert list(robot.joints[0].coordinates) == ["x", "y", "beta", "gamma"]
    first = Path("my_arm.toml").read_text(encoding="ascii").splitlines()[0]
    assert first == "#:schema ./robot.schema.json"
    for kind in ("robot", "scenario"):
        assert Path(f"{kind}.schema.json").read_bytes() == schema_path(kind).read_bytes()
    printed = command("check", "my_arm.toml", "s.toml")
    assert printed == "my_arm.toml: ok: 1 links, 4 coordinates\ns.toml: ok: 1 s, 0 wrenches, 0 payloads\n"
    command("generate", "my_arm.toml", "-o", "out", "--kernels", "mass_matrix")
    command("simulate", "my_arm.toml", "--scenario", "s.toml", "-o", "out", "--no-plots")
    result = eomgen.load_result("out/trajectory.npz")
    assert result.series("joint1.gamma").values[-1] == pytest.approx(0.8, abs=1e-3)
    assert abs(result.balance.relative_residue) < 1e-4


@pytest.mark.parametrize("name", builtin_robots())
def test_a_scenario_for_a_robot_has_its_names(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A goal of the first coordinate that is driven, within its limits; nothing of a motion where none is."""
    monkeypatch.chdir(tmp_path)
    assert command("new", name, "--scenario") == f"wrote {name}_scenario.toml\n"
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
    refused(InputError, "is there already", write_new_file, name, kind="scenario")


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
        path = text_file(tmp_path / f"{'_'.join(keys)}.toml", taken_up(text, *keys))
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
def test_what_new_refuses(arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.toml").write_text("mine")
    assert message in errors_of("new", *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["there.toml"]
    assert Path("there.toml").read_text() == "mine"


FOUND = (
    (4, 1, "unknown key 'gra vity'; did you mean 'gravity'? (allowed"),
    (9, 8, "links.link1.mass"),
    (24, 7, "joints.joint1.x"),
    (24, 35, "joints.joint1.x.clearance"),
    (28, 3, "joints.joint2"),
    (37, 21, "frames.tcp.placement.xyz"),
)


def test_all_errors_are_said_in_their_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text(BAD, encoding="utf-8")
    status, out, err = run("check", "bad.toml")
    assert (status, err) == (1, "eomgen: check: 1 of 1 files cannot be used; allowed: what is said of each\n")
    starts = [f"bad.toml:{line}:{column}: {place}: " for line, column, place in FOUND]
    assert all(line.startswith(start) for line, start in zip(out.splitlines(), starts, strict=True))
    (facts,) = json.loads(run("check", "--json", "bad.toml")[1])
    assert [(error["line"], error["column"]) for error in facts["errors"]] == [place[:2] for place in FOUND]
    what = {"place": "links.link1.mass", "message": "got -3.0; allowed: a number that is at least 0"}
    assert facts["errors"][1] == {"file": "bad.toml", "line": 9, "column": 8, **what}


def test_check_reads_every_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    _, out, err = run("check", *texts, "missing.toml", "arm.txt")
    assert "5 of 10 files" in err
    lines = out.splitlines()
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


def test_the_schema_is_printed() -> None:
    assert command("schema", "scenario") == schema_text("scenario")
    assert json.loads(command("schema"))["properties"]["gravity"]["description"].endswith("[m/s^2]")
    assert "invalid choice: 'urdf'" in command("schema", "urdf", code=2)
    refused(eomgen.InputError, "there is no format 'urdf'; allowed: robot, scenario, plan", schema_text, "urdf")


ODD = f"""
name = "arm"
home = {{ j1.gamma = 90.0 }}

{link_table("upper", 2.0, (120.0, 0.0, 0.0), (0.1, 0.1, 0.1))}

{link_table("fore", 2.0)}

{joint_table("j1", "base", "upper", "revolute")}
placement = {{ xyz = [0.0, 0.0, 500.0], rpy = [90.0, 0.0, 0.0] }}

{joint_table("j2", "upper", "fore", "revolute")}
dh = {{ a = 400.0, alpha = -90.0 }}

[[springs]]
name = "cable"
links = ["base", "fore"]
points = [[0.0, 0.0, 1.0], [250.0, 0.0, 0.0]]
stiffness = 1e4
"""


ASKED = re.compile("is that in|are these in")


def test_lengths_and_angles_of_another_unit_are_asked_about(tmp_path: Path) -> None:
    """In one note, each by its place; the rest are counted; numbers of usual sizes are not."""
    path = text_file(tmp_path / "odd.toml", ODD)
    found = check_file(path)
    assert not found.errors
    assert [note for note in found.notes if ASKED.search(note)] == [
        "home.j1.gamma = 90 m or rad, links.upper.com.0 = 120 m, joints.j1.placement.xyz.2 = 500 m,"
        " joints.j1.placement.rpy.0 = 90 rad, joints.j2.dh.a = 400 m and 2 more: are these in millimetres or degrees?"
    ]
    path.write_text(re.sub(r"(\d)0\.0\b", r"\g<1>.0", ODD).replace("90", "9").replace("50.0", "5.0"), encoding="utf-8")
    small = check_file(path)
    assert not small.errors
    assert not [note for note in small.notes if ASKED.search(note)]


SIZES = ("links.l1.com.z = 100 m", "joints.j.placement.xyz.2 = 200 m", "joints.j.gamma.limits.lower = -180 rad")
MILLIMETRES = {
    "odd.urdf": """<robot name="mm"><link name="b"/><link name="l1"><inertial><origin xyz="0 0 100"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="b"/><child link="l1"/><origin xyz="0 0 200" rpy="90 0 0"/>
<axis xyz="0 0 1"/><limit lower="-180" upper="1e16" effort="10" velocity="3"/></joint></robot>""",
    "odd.xml": """<mujoco model="mm"><compiler angle="radian"/><worldbody><body name="l1" pos="0 0 200">
<inertial pos="0 0 100" mass="1" diaginertia="0.1 0.1 0.1"/><joint name="j" range="-180 1e16"/>
</body></worldbody></mujoco>""",
    "refined.toml": 'urdf = "odd.urdf"\n[[joints]]\nname = "j"\nx = {}\n',
}


@pytest.mark.parametrize("name", MILLIMETRES)
def test_other_formats_are_asked_about_by_the_same_check(name: str, tmp_path: Path) -> None:
    """Of a URDF that a TOML refines, what the TOML leaves as it is."""
    if name == "odd.xml":
        needs("mujoco")
    paths = {key: text_file(tmp_path / key, text) for key, text in MILLIMETRES.items()}
    (note,) = [note for note in check_file(paths[name]).notes if ASKED.search(note)]
    angle = ("joints.j.placement.rpy.0 = 90 rad",) if name == "odd.urdf" else ()
    places = ", ".join((*SIZES[:2], *angle, SIZES[2]))
    expected = f"{places}: are these in millimetres or degrees?"
    assert note == ("links.l1.com.z = 100 m: is that in millimetres (0.1 m)?" if "toml" in name else expected)


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
    files = [path for kind in ("robots", "scenarios") for path in (Path(eomgen.__path__[0]) / kind).glob("*.toml")]
    assert len(files) > 15
    assert not [note for path in files for note in check_file(path).notes if ASKED.search(note)]
    assert not [name for name in builtin_robots() for note in check_file(name).notes if ASKED.search(note)]


# Studies


NAMES = [name for name in eomgen.builtin_robots() if name not in MAKERS[1:]]


@pytest.mark.parametrize("name", NAMES)
def test_plans_name_what_is_there(name: str) -> None:
    """Every parameter once, and none of which nothing is a multiple."""
    robot = eomgen.load_robot(name)
    plan = plan_from_toml(plan_file_text(robot))
    assert plan.samples == 200
    varied = [expand_tunable(robot, [vary.parameter]) for vary in plan.vary]
    assert all(varied)
    flat = [one for names in varied for one in names]
    assert len(set(flat)) == len(flat)
    values = dict(robot.numbers())
    assert all(values[one] for one in flat)


def test_plans_of_links_that_bend() -> None:
    """Their masses are those of their modes, and nodes have none; modal stiffness varies."""
    plan = plan_from_toml(plan_file_text(eomgen.load_robot("flexible_arm")))
    masses = [f"links.{name}.mass" for name in ("shoulder_hub", "elbow_hub", "payload")]
    assert [vary.parameter for vary in plan.vary] == [*masses, "links.*.modes.*.stiffness"]


def test_what_has_no_tolerances() -> None:
    """A mechanism all of whose loops are elastic."""
    refused(eomgen.InputError, "all loops are elastic", tolerances_file_text, eomgen.load_robot("hexapod_elastic"))


@pytest.mark.parametrize("name", soaked([x for x in NAMES if x != "hexapod_elastic"], {*NAMES} - {"gantry"}))
def test_tables_name_every_quantity(name: str) -> None:
    """Those that are put in are read; with all comments undone, every quantity that there is stands in the table."""
    robot = eomgen.load_robot(name)
    known = tolerance_quantities(robot)
    text = tolerances_file_text(robot)
    whole = re.sub(r'^# (?=")', "", text, flags=re.MULTILINE)
    assert len(quantities_of(whole, known)) == len(known)
    assert set(quantities_of(text, known)) < set(known)


def quantities_of(text: str, known: dict[str, str]) -> list[str]:
    return [entry.name for entry in read_table(parse_toml(text, "table"), tuple(known)).entries]


def test_a_study_from_the_first_file_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a robot in the folder and of a built-in one; schemas lie beside plans; what is there stays."""
    monkeypatch.chdir(tmp_path)
    command("new", "mine")
    for robot in ("mine", "ur5e"):
        command("new", robot, "--plan")
        for kind, ending in (("tolerances", "toml"), ("poses", "csv")):
            assert command("new", robot, f"--{kind}") == f"wrote {robot}_{kind}.{ending}\n"
        assert not check_file(f"{robot}_plan.toml").errors
        found = tolerance(eomgen.load_robot("mine.toml" if robot == "mine" else robot), f"{robot}_tolerances.toml")
        assert found.lines()
    assert (tmp_path / "plan.schema.json").exists()
    assert "is there already" in errors_of("new", "mine", "--plan")
    assert "there is no robot 'nothing'; allowed: the name of a .toml" in errors_of("new", "nothing", "--tolerances")
    command("new", "mine", "--plan", "-o", "here.toml")
    assert (tmp_path / "here.toml").exists()
    (tmp_path / "My-Arm 2.urdf").write_text(URDF)
    for kind, ending in (("poses", "csv"), ("plan", "toml"), ("tolerances", "toml"), ("scenario", "toml")):
        assert command("new", "My-Arm 2.urdf", f"--{kind}") == f"wrote my_arm_2_{kind}.{ending}\n"
    assert "gone.urdf: there is no such file" in errors_of("new", "gone.urdf", "--poses")


# Inertia


ROD = f"""
name = "rod"
links = [{{ name = "rod", mass = 2.0, com = [0.5, 0.0, 0.0], inertia = {{ xx = 0.0, yy = 0.05, zz = 0.05 }} }}]
{joint_table("hinge", "base", "rod", "revolute")}
x = {{ stiffness = 1e9, damping = 1e3 }}
alpha = {{ stiffness = 1e4, damping = 1.0 }}
beta = {{ stiffness = 1e4, damping = 1.0 }}
"""
BARE = """<robot name="bare"><link name="base"/><link name="a"/><link name="b"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    "robot",
    [
        *(with_offsets(random_robot(seed, joints=(2, 3), tree=True), seed) for seed in (70, 71)),
        eomgen.load_robot("geared_arm"),  # motors and armatures count
    ],
)
def test_mass_matrices_are_those_of_kernels(robot: Robot, built: Build) -> None:
    kernel = built(robot, "mass_matrix")
    q = np.linspace(0.1, 0.7, kernel.n)
    assert close(mass_matrix(build_model(robot), q), kernel.mass_matrix(q), 1e-12)


def test_a_massless_robot_is_noted(tmp_path: Path) -> None:
    path = text_file(tmp_path / "bare.urdf", BARE)
    found = check_file(path)
    assert not found.errors
    assert any(note.startswith("0 kg: no link that moves has mass or inertia") for note in found.notes)


def test_links_that_leave_the_mass_matrix_singular_are_noted(tmp_path: Path) -> None:
    tip = ROD.replace("com = [0.5, 0.0, 0.0]", "com = [0.5, 0.1, 0.2]")
    tip = tip.replace("} }]", '} }, { name = "tip", mass = 0.0 }]')
    tip += '[[joints]]\nname = "wrist"\nparent = "rod"\nchild = "tip"\ntype = "revolute"\n'
    path = text_file(tmp_path / "tip.toml", tip.replace("xx = 0.0", "xx = 0.02"))
    (note,) = check_file(path).notes
    assert note.startswith("the mass matrix is singular in every state: 'wrist.gamma' moves no inertia; without mass")
    assert "inertia: 'tip'; give links mass and inertia, or the coordinate an armature, or merge a link" in note
    assert note.endswith("rollouts with method='implicit' do without")
    for change in (("xx = 0.0", "xx = 0.02"), ("alpha = {", "alpha = { armature = 0.01,")):
        assert inertia_notes(robot_from_toml(ROD.replace(*change))) == ()
    assert "'hinge.alpha'" in inertia_notes(robot_from_toml(ROD))[0]


@pytest.mark.parametrize("name", eomgen.builtin_robots())
def test_built_in_robots_have_inertia(name: str) -> None:
    assert inertia_notes(eomgen.load_robot(name)) == ()


def test_a_thin_rod_is_singular_at_its_own_axis(built: Build) -> None:
    """Not at x, which has 1e9 N/m and 2 kg; with what computes M, and without."""
    robot = robot_from_toml(ROD)
    zero = np.zeros((3, 4))
    for kernels in (("mass_matrix",), ("inverse_dynamics",)):
        kernel = built(robot, "forward_dynamics", *kernels)
        with pytest.raises(eomgen.SingularError, match=r"inverted at hinge\.alpha; what they move has no inertia"):
            kernel.forward_dynamics(*zero)
    kernel = built(robot, "forward_dynamics", "mass_matrix", "inverse_dynamics")
    q, _ = eomgen.state.static_equilibrium(kernel, zero[0], fixed=["hinge.gamma"])
    assert abs(q[0]) < 1e-6


@pytest.mark.parametrize("beta", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("kernels", [(), ("mass_matrix",)])
def test_upright_angles_are_a_pair(beta: float, kernels: tuple[str, ...], built: Build) -> None:
    kernel = built(robot_from_toml(ROD.replace("xx = 0.0", "xx = 0.02")), "forward_dynamics", *kernels)
    with pytest.raises(eomgen.SingularError, match=r"at hinge\.alpha and hinge\.gamma; hinge\.beta is at \+-pi/2"):
        kernel.forward_dynamics([0.0, 0.3, beta, 0.2], np.zeros(4), np.zeros(4))
