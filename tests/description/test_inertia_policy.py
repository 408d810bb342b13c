"""Inertias that no body can have, limits of coordinates and stops at them: what is read, noted and refused."""

from __future__ import annotations

import json
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.authoring.check import check_file, check_files
from eomgen.cli import entry
from eomgen.cli import entry as cli
from eomgen.description.load import load_robot, robot_from_mjcf, robot_from_toml, robot_from_urdf
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError, EomgenWarning
from eomgen.export.mujoco import left_out, mjcf
from eomgen.robot.bounds import Limits
from eomgen.robot.mechanism import effort_of
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Coordinate, Coupling, Joint, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.support.bad_files import changed
from tests.support.description_samples import ARM, MJCF, URDF
from tests.support.optional import OptionalModule, needs
from tests.support.refusals import refused
from tests.support.text_files import text_file

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]
STRANGE = changed(URDF, 'izz="0.15"', 'izz="0.9"')  # of the link upper, line 4
STRANGE_TOML = changed(ARM, "{ xx = 0.1, yy = 0.2, zz = 0.2 }", "{ xx = 0.1, yy = 0.2, zz = 0.5 }")
LIGHTLY = "ignore::eomgen.errors.EomgenWarning"


def test_what_others_wrote_is_taken_with_a_note_that_says_where() -> None:
    with pytest.warns(EomgenWarning, match=re.escape("r.x:4:3: link upper: no body can have")):
        robot = robot_from_urdf(STRANGE, source="r.x")
    (note,) = [note for note in robot.notes if "no body" in note]
    assert note.startswith("r.x:4:3: link upper: no body can have")
    assert note.endswith("taken as it is")
    with pytest.warns(EomgenWarning):
        assert robot.links == robot_from_urdf(STRANGE, inertia="warn").links
    refused(DescriptionError, "links.upper.inertia", robot_from_urdf, STRANGE, inertia="error")


def test_toml_is_refused_by_default() -> None:
    with pytest.raises(DescriptionError, match=r"my\.toml:10:11: links\.link1\.inertia: no body can have"):
        robot_from_toml(STRANGE_TOML, source="my.toml")


def refined(folder: Path, toml: str = "", urdf: str = STRANGE) -> Path:
    (folder / "arm.urdf").write_text(urdf)
    return text_file(folder / "arm.toml", 'urdf = "arm.urdf"\n' + toml)


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
    path = text_file(tmp_path / "a.urdf", STRANGE)
    assert check_file(path).errors == ()
    assert len(check_file(path, inertia="error").errors) == 1
    (error,) = check_file(path, inertia="off").errors
    assert "error, warn, project" in str(error)


mujoco = OptionalModule("mujoco")
WHOLE = "limits = { lower = -1, upper = 2, velocity = 3, effort = 4 }"


def joint1(limits: str = "limits = [-1, 2]", gamma: str = "damping = 0.1, armature = 0.02") -> Robot:
    text = ARM.replace("limits = [-1, 2]", limits)
    return robot_from_toml(text.replace("gamma = { damping = 0.1, armature = 0.02 }", f"gamma = {{ {gamma} }}"))


def test_a_table_says_what_the_short_form_says_and_more() -> None:
    short, whole = joint1(), joint1("", WHOLE)
    assert short.limits_of("joint1.gamma") == Limits(-1.0, 2.0)
    assert whole.limits_of("joint1.gamma") == Limits(-1.0, 2.0, 3.0, 4.0)
    assert short.joint("joint1").limits == whole.joint("joint1").limits == (-1.0, 2.0)
    assert joint1("", "limits = { lower = -1, upper = 2 }").joint("joint1") == joint1(gamma="").joint("joint1")
    assert not short.limits_of("joint2.z")
    assert not short.limits_of("joint1.x")
    assert robot_from_record(record_of(whole), "") == whole
    assert robot_hash(whole) != robot_hash(short)


def test_one_end_of_a_range_is_enough() -> None:
    robot = joint1("stops = { stiffness = 1e5 }", "limits = { upper = 0.5 }")
    joint = robot.joint("joint1")
    assert joint.limits is None
    assert joint.range == (-np.inf, 0.5)
    assert joint.coordinates["gamma"].further["stops.upper"] == 0.5
    assert "stops.lower" not in joint.coordinates["gamma"].further
    text = ARM.replace("limits = [-1, 2]", "").replace("gamma = {", "gamma = { limits = { upper = 0.5 },")
    allowed = r"home\.joint1\.gamma: got 1\.0; allowed: within the limits, -inf to 0\.5"
    refused(DescriptionError, allowed, robot_from_toml, "home = { joint1.gamma = 1.0 }\n" + text)


def test_limits_of_a_motor_hold_behind_its_gear() -> None:
    own = "limits = { lower = -50, velocity = 200, effort = 0.03 }"
    motor = f"motor = {{ inertia = 1e-4, ratio = -100, stiffness = 1e4, {own} }}"
    robot = joint1(motor, "limits = { velocity = 3, effort = 4 }")
    assert robot.limits_of("joint1.motor") == Limits(lower=-50.0, velocity=200.0, effort=0.03)
    rigid = robot.rigid().limits_of("joint1.gamma")
    assert rigid == Limits(None, 0.5, 2.0, 3.0)
    assert effort_of(robot, "joint1.motor") == pytest.approx(0.03)
    weak = joint1(motor, "limits = { effort = 2 }")
    assert effort_of(weak, "joint1.motor") == pytest.approx(0.02)
    assert effort_of(weak, "joint1.x") is None


def test_a_urdf_has_them_and_toml_refines_them(tmp_path: Path) -> None:
    plain = robot_from_urdf(URDF)
    assert plain.limits_of("shoulder.gamma") == Limits(-1.0, 2.0, 1.0, 10.0)
    (tmp_path / "arm.urdf").write_text(URDF)
    path = tmp_path / "arm.toml"
    path.write_text(
        'urdf = "arm.urdf"\n[[joints]]\nname = "shoulder"\ngamma = { limits = { lower = -0.5, effort = 3 } }\n'
    )
    assert load_robot(path).limits_of("shoulder.gamma") == Limits(-0.5, 2.0, 1.0, 3.0)
    path.write_text('urdf = "arm.urdf"\n[[joints]]\nname = "shoulder"\nlimits = [0, 1]\nx = { stiffness = 1e6 }\n')
    assert load_robot(path).limits_of("shoulder.gamma") == Limits(0.0, 1.0, 1.0, 10.0)


@pytest.mark.parametrize(
    ("limit", "kept", "said"),
    [
        ('velocity="0" effort="-1"', Limits(-1.0, 2.0), "'shoulder velocity', 'shoulder effort'"),
        ('velocity="inf" effort="2"', Limits(-1.0, 2.0, None, 2.0), "'shoulder velocity'"),
        ('velocity="3" effort="2"', Limits(-1.0, 2.0, 3.0, 2.0), ""),
    ],
)
def test_limits_of_a_urdf_that_are_none_are_said(limit: str, kept: Limits, said: str) -> None:
    robot = robot_from_urdf(URDF.replace('effort="10" velocity="1"', limit))
    assert robot.limits_of("shoulder.gamma") == kept
    notes = [note for note in robot.notes if "<limit>" in note]
    assert [note.endswith(said) for note in notes] == ([True] if said else [])
    refused(DescriptionError, "effort is 'much'", robot_from_urdf, URDF.replace('effort="10"', 'effort="much"'))


def test_mjcf_has_efforts() -> None:
    needs("mujoco")
    text = MJCF.replace('<joint name="knee"', '<joint name="knee" actuatorfrcrange="-8 9"')
    robot = robot_from_mjcf(text)
    by_name = {f"{j.name}.{c}": j.limits_of(c).effort for j in robot.joints for c in j.coordinates}
    assert by_name["knee.gamma"] == 9.0
    assert sorted(x for x in by_name.values() if x) == [6.0, 9.0]
    assert any("not symmetric: 'knee'" in note for note in robot.notes)


ACTUATED = """<mujoco>
<default><general ctrlrange="-2 2"/><default class="c"><joint actuatorfrcrange="-9 9"/></default></default>
<worldbody><body name="a"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><joint name="h" class="c"/>
<body name="b" pos="1 0 0"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><joint name="k" axis="0 1 0"/></body>
{geom}</body></worldbody>
<actuator><motor joint="h" gear="3"/><motor joint="h"/>
<position joint="k" kp="50" forcerange="-5 5" gear="-2"/></actuator>
</mujoco>"""


@pytest.mark.parametrize("geom", ["", '<replicate count="1"><geom size="0.1"/></replicate>'])
def test_actuators_push_as_hard_as_mujoco_lets_them(geom: str, tmp_path: Path) -> None:
    """The largest force of the actuators on each joint, in MuJoCo, whatever their controls."""
    needs("mujoco")
    text = ACTUATED.format(geom=geom)
    path = text_file(tmp_path / "model.xml", text)
    robot = load_robot(path)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[:] = [1e3, 1e3, -1e3]
    mujoco.mj_forward(model, data)
    efforts = [robot.limits_of(f"{name}.gamma").effort for name in ("h", "k")]
    np.testing.assert_allclose(efforts, np.abs(data.qfrc_actuator))


def test_a_model_of_mujoco_has_them_and_gives_them_back() -> None:
    robot = joint1("", WHOLE)
    text = mjcf(robot, 1e-3, approximate=True, actuators=True)
    model = mujoco.MjModel.from_xml_string(text)
    joint = model.joint("joint1.gamma")
    np.testing.assert_array_equal(model.jnt_actfrcrange[joint.id], [-4.0, 4.0])
    assert not model.jnt_actfrclimited[joint.id]
    back = robot_from_mjcf(text)
    for name in build_model(robot).coordinates:
        assert back.limits_of(name) == robot.limits_of(name), name


def test_a_robot_made_in_python_is_checked() -> None:
    robot = joint1()
    joint, name = robot.joint("joint2"), "z"

    def with_limits(limits: Limits) -> Robot:
        own = {**joint.coordinates, name: Coordinate(limits=limits)}
        made: Joint = replace(joint, coordinates=own, motor=None, damping=None, radial=None)
        return replace(robot, joints=tuple(made if one is joint else one for one in robot.joints))

    with pytest.raises(DescriptionError, match=r"limits\.velocity: got -1\.0; allowed: a number greater than 0"):
        build_model(with_limits(Limits(velocity=-1.0)))
    with pytest.raises(DescriptionError, match=r"limits\.effort: got nan; allowed: a finite number"):
        build_model(with_limits(Limits(effort=float("nan"))))


ASKED = {"stiffness": 1e5, "damping": 10.0}
HARD = {"stops.stiffness": 1e5, "stops.damping": 10.0, "stops.smoothing": 1e-4}
TEXT = "stops = { stiffness = 1e5, damping = 10.0 }"


def with_stops(text: str = TEXT, limits: str = "limits = [-1, 2]") -> Robot:
    return robot_from_toml(ARM.replace("limits = [-1, 2]", f"{limits}\n{text}"))


def numbers(robot: Robot, joint: str, name: str = "gamma") -> dict[str, float]:
    return dict(robot.joint(joint).coordinates[name].further)


def test_at_a_joints_limits() -> None:
    """They are numbers of the principal coordinate, and run-time parameters, the limits among them."""
    robot = with_stops()
    assert numbers(robot, "joint1") == {**HARD, "stops.lower": -1.0, "stops.upper": 2.0}
    assert not robot.joint("joint2").coordinates["z"].further
    names = [name for name in build_model(robot).parameters if ".stops." in name]
    keys = ("stiffness", "damping", "smoothing", "lower", "upper")
    assert names == [f"joints.joint1.gamma.stops.{key}" for key in keys]
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    assert with_stops("", "") == replace(robot_from_toml(ARM), joints=with_stops("", "").joints)


def test_in_tables_of_coordinates() -> None:
    """With their own ends, one of which may be open; a motor's are those of its shaft."""
    text = ARM.replace("x = { stiffness = 1e6", "x = { stops = { stiffness = 1e5, upper = 1e-3 }, stiffness = 1e6")
    motor = "motor = { inertia = 1e-4, ratio = 50.0, stiffness = 1e4, stops = { stiffness = 3.0, lower = -60.0 } }"
    robot = robot_from_toml(text.replace("limits = [-1, 2]", motor))
    assert numbers(robot, "joint1", "x") == {"stops.stiffness": 1e5, "stops.smoothing": 1e-4, "stops.upper": 1e-3}
    assert not robot.joints[0].motor.transmission.further
    assert robot.joints[0].motor.further == {"stops.stiffness": 3.0, "stops.smoothing": 1e-4, "stops.lower": -60.0}
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    assert robot.rigid().joints[0].motor is None


@pytest.mark.parametrize("what", ["at the top", "of a caller"])
def test_at_all_limits(what: str) -> None:
    """But where a joint has its own; a caller's are in the place of those at the top."""
    top = f"{TEXT}\n" if what == "at the top" else "stops = { stiffness = 3.0 }\n"
    given = None if what == "at the top" else ASKED
    second = '"prismatic"\nlimits = [0.0, 0.3]'
    text = top + ARM.replace('"prismatic"', second)
    robot = robot_from_toml(text, stops=given)
    assert numbers(robot, "joint1") == {**HARD, "stops.lower": -1.0, "stops.upper": 2.0}
    assert numbers(robot, "joint2", "z") == {**HARD, "stops.lower": 0.0, "stops.upper": 0.3}
    robot = robot_from_toml(text.replace("0.3]", "0.3]\nstops = { stiffness = 7.0 }"), stops=given)
    assert numbers(robot, "joint2", "z")["stops.stiffness"] == 7.0
    assert not robot.notes


def test_urdfs_on_request(tmp_path: Path) -> None:
    robot = robot_from_urdf(URDF, stops=ASKED)
    assert numbers(robot, "shoulder") == {**HARD, "stops.lower": -1.0, "stops.upper": 2.0}
    assert not numbers(robot, "elbow")
    assert not numbers(robot_from_urdf(URDF), "shoulder")
    tight = robot_from_urdf(URDF.replace('lower="-1" upper="2"', 'lower="0" upper="0"'), stops=ASKED)
    assert not numbers(tight, "shoulder")
    assert any("limits without room between them have no stops: 'shoulder.gamma'" in note for note in tight.notes)
    (tmp_path / "arm.urdf").write_text(URDF)
    refined = tmp_path / "arm.toml"
    refined.write_text('urdf = "arm.urdf"\n[[joints]]\nname = "shoulder"\nstops = { stiffness = 2.0 }\n')
    assert numbers(load_robot(refined), "shoulder")["stops.upper"] == 2.0
    refined.write_text(f'urdf = "arm.urdf"\n{TEXT}\n[[joints]]\nname = "shoulder"\nlimits = [-0.5, 0.5]\n')
    assert numbers(load_robot(refined), "shoulder") == {**HARD, "stops.lower": -0.5, "stops.upper": 0.5}


def test_mjcf_on_request() -> None:
    """Any coordinate whose range MuJoCo keeps; without stops a note says that nothing stops there."""
    needs("mujoco")
    robot = robot_from_mjcf(MJCF, stops=ASKED)
    low, high = np.radians([-30.0, 40.0])
    for name in ("hip", "twist"):
        assert numbers(robot, name) == pytest.approx({**HARD, "stops.lower": low, "stops.upper": high})
    assert not numbers(robot, "knee")  # limited="false"
    assert not any("nothing stops" in note for note in robot.notes)
    off = robot_from_mjcf(MJCF.replace('contact="disable"', 'limit="disable"'), stops=ASKED)
    assert not numbers(off, "hip")
    assert off.limits_of("hip.gamma").lower == low
    text = MJCF.replace('type="slide" axis="0 0 1" armature="0.2"', 'type="slide" axis="0 0 1" range="-1 3"')
    beside = robot_from_mjcf(text, stops=ASKED)
    assert numbers(beside, "torso_joint", "z") == {**HARD, "stops.lower": -1.0, "stops.upper": 3.0}
    text = text.replace('name="rootx" type="slide" axis="1 0 0"', 'name="rootx" type="slide" axis="1 0 0" range="0 1"')
    assert numbers(robot_from_mjcf(text, stops=ASKED), "torso_joint", "x")["stops.upper"] == 1.0
    assert any(
        "nothing stops at the limits of joints: 'rootx', 'rootz'" in note for note in robot_from_mjcf(text).notes
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stops = {}", r"joint1\.stops: the key 'stiffness' is missing; allowed: a stiffness in N/m or N m/rad"),
        ("stops = { stiffness = -1 }", r"joint1\.stops\.stiffness: got -1; allowed: .* at least 0"),
        ("stops = { stiffness = 1, smoothing = 0 }", r"stops\.smoothing: got 0; allowed: .* at least 1e-12"),
        ("stops = { stiffness = 1, upper = 1 }", r"joint1\.stops: unknown key 'upper'"),
        ("stops = 1e5", r"joint1\.stops: got 100000\.0; allowed: a table with the keys 'stiffness', 'damping'"),
        (
            "motor = { inertia = 1, ratio = 1, stiffness = 1, stops = { stiffness = 1 } }",
            r"motor\.stops: there is no lower and no upper; allowed: with one of them",
        ),
    ],
)
def test_what_is_refused(text: str, message: str, tmp_path: Path) -> None:
    """By readers, and by ``eomgen check`` with the place."""
    refused(DescriptionError, message, with_stops, text)
    path = text_file(tmp_path / "arm.toml", ARM.replace("limits = [-1, 2]", f"limits = [-1, 2]\n{text}"))
    found = check_file(path)
    assert found.errors
    assert all(f"{path}:" in line for line in found.lines)


def test_what_has_nothing_to_stop() -> None:
    for old, new, message in (
        ("limits = [-1, 2]", TEXT, r"joint1\.stops: there are no limits to stop at; allowed: with limits = "),
        ('"prismatic"', f'"fixed"\n{TEXT}', r"joint2\.stops: a fixed joint has no principal coordinate to stop"),
        (
            "gamma = { damping = 0.1, armature = 0.02 }",
            f'gamma = {{ role = "locked" }}\n{TEXT}',
            r"joint1\.stops: gamma is locked, so that stops would do nothing",
        ),
        (
            "gamma = { damping = 0.1,",
            f"{TEXT}\ngamma = {{ stops = {{ stiffness = 1.0, lower = 0.0 }}, damping = 0.1,",
            r"joint1\.stops: gamma has stops in its table, too; allowed: one of them",
        ),
    ):
        refused(DescriptionError, message, robot_from_toml, ARM.replace(old, new))
    one_sided = ARM.replace("gamma = { damping = 0.1,", "gamma = { stops = { stiffness = 1.0, lower = 2, upper = 1 },")
    with pytest.raises(DescriptionError, match=r"joint1\.gamma\.stops\.lower: got 2\.0; allowed: at most upper, 1\.0"):
        robot_from_toml(one_sided)
    free = robot_from_toml(ARM.replace("limits = [-1, 2]", ""), stops=ASKED)
    assert free.notes == ("stops are asked for, and there are no limits to put them at",)


@pytest.mark.parametrize(
    ("stops", "message"),
    [
        ({}, "stops: the key 'stiffness' is missing"),
        ({"stiffness": "hard"}, r"stops\.stiffness: got 'hard'; allowed: a number that is at least 0"),
        ({"stiffness": 1.0, "clearance": 1.0}, "stops: unknown key 'clearance'"),
        (1e5, r"stops: got 100000\.0; allowed: a mapping with 'stiffness', 'damping'"),
    ],
)
def test_what_callers_may_ask_for(stops: object, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        load_robot("one_link", stops=stops)  # type: ignore[arg-type]


def test_checks_warn_of_starts_beyond_a_stop(tmp_path: Path) -> None:
    arm, run = tmp_path / "arm.toml", tmp_path / "run.toml"
    arm.write_text(ARM.replace("limits = [-1, 2]", f"limits = [0.5, 2]\n{TEXT}"))
    run.write_text("duration = 1.0\n[initial]\nq = { joint1 = 2.5, joint2.z = 9.0, other = 1.0 }\n")
    first, second = check_files([arm, run])
    assert first.notes == ("home: joint1.gamma = 0 rad lies beyond its lower stop at 0.5 rad",)
    assert second.notes == ("initial.q of robot arm: joint1.gamma = 2.5 rad lies beyond its upper stop at 2 rad",)
    assert f"{run}: note: initial.q of robot arm" in second.lines[1]
    assert check_files([run])[0].notes == ()
    arm.write_text(f'home = {{ "joint1.gamma" = 0.6 }}\n{arm.read_text()}')
    assert check_file(arm).notes == ()


@pytest.mark.soak
def test_a_simulation_says_what_was_touched(tmp_path: Path) -> None:
    """In its lines, and again from its file; and that it began beyond a stop."""
    text = ARM.replace("x = { stiffness = 1e6, damping = 10 }\n", "").replace("limits = [-1, 2]", "limits = [-1, 1]")
    robot = robot_from_toml(text, stops=ASKED)
    scenario = scenario_from_toml(
        "duration = 0.4\n[initial]\nequilibrium = false\nq = { joint1 = 0.9 }\nv = { joint1 = 2.0 }\n"
    )
    result = run_scenario(robot, scenario)
    assert next((c.coordinate, c.side, c.kind) for c in result.trajectory.contacts if c.closes) == (
        "joint1.gamma", 1, "stop"
    )  # fmt: skip
    (line,) = [line for line in result.summary_lines() if "stop of" in line]
    assert line.startswith("  upper stop of joint1.gamma: touched 1 times, first at 0.05")
    again = eomgen.load_result(result.save(tmp_path / "run.npz"))
    assert again.trajectory.contacts == result.trajectory.contacts
    beyond = run_scenario(robot, replace(scenario, initial=replace(scenario.initial, q={"joint1": 1.2})))  # type: ignore[arg-type, type-var]
    assert any("joint1.gamma starts at 1.2 rad, beyond its upper stop at 1 rad" in note for note in beyond.notes)


def test_drives_do_not_cancel_a_stop() -> None:
    """Computed torque goes by the rigid robot, which has none."""
    robot = with_stops("", "limits = [-1, 1]")
    stopped = with_stops("stops = { stiffness = 1e5, damping = 100.0 }", "limits = [-1, 1]")
    assert replace(stopped.rigid(), joints=()) == replace(robot.rigid(), joints=())
    assert stopped.rigid().joints == robot.rigid().joints != stopped.joints
    tuned = robot_from_toml(ARM.replace("limits = [-1, 2]", f"limits = [-1, 2]\n{TEXT}").replace(
        '"links.link2.mass"', '"links.link2.mass", "joints.*.gamma.stops"'))  # fmt: skip
    assert tuned.rigid().tunable == ("links.link2.mass",)


def test_what_mujoco_makes_of_them(tmp_path: Path) -> None:
    """A limited range, as stiff as MuJoCo has it; and back."""
    motor = "motor = { inertia = 1e-4, ratio = 50.0, stiffness = 1e4, stops = { stiffness = 3.0, lower = -60.0 } }"
    robot = with_stops(f"{TEXT}\n{motor}")
    assert left_out(robot) == [
        "joints.joint1.gamma.stops: a limited range, a soft constraint as stiff as MuJoCo makes it",
        "joints.joint1.motor.stops: a limited range, a soft constraint as stiff as MuJoCo makes it",
    ]
    refused(eomgen.InputError, r"no equal for joints\.joint1\.gamma\.stops: a limited range", mjcf, robot, 1e-3)
    with pytest.warns(EomgenWarning, match="a limited range"):
        path = eomgen.export_mjcf(robot, tmp_path / "arm.xml", approximate=True)
    model = mujoco.MjModel.from_xml_path(str(path))
    limited = {model.joint(i).name: (bool(model.jnt_limited[i]), *model.jnt_range[i]) for i in range(model.njnt)}
    assert limited["joint1.gamma"] == (True, -1.0, 2.0)
    assert limited["joint1.motor"] == (True, -60.0, 1e9)
    assert not limited["joint1.x"][0]
    back = robot_from_mjcf(mjcf(with_stops(), 1e-3, approximate=True), stops=ASKED)
    assert numbers(back, "joint1") == {**HARD, "stops.lower": -1.0, "stops.upper": 2.0}
    law = Coordinate(5.0, further={**HARD, "stops.upper": 1.0})
    coupled = replace(robot_from_toml(ARM), couplings=(Coupling("belt", "joint2.z", {"joint1.gamma": 0.1}, law=law),))
    assert left_out(coupled) == ["couplings.belt.stops: left out"]


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = str(text_file(tmp_path / "arm.urdf", URDF))
    assert entry.main(["info", arm, "--stops", "stiffness=1e5,damping=10", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    assert {key.rpartition(".")[2]: x for key, x in found.items() if ".stops." in key} == {
        "stiffness": 1e5, "damping": 10.0, "smoothing": 1e-4, "lower": -1.0, "upper": 2.0,
    }  # fmt: skip
    for wrong, message in (("1e5", "'1e5'; allowed: NAME=VALUE"), ("damping=1", "'stiffness' is missing")):
        assert entry.main(["info", arm, "--stops", wrong]) == 1
        assert message in capsys.readouterr().err
