"""MJCF in several files, with meshes and copies, in the process that compiles it; and xacro, and SDF."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eomgen.cli.entry import main
from eomgen.description.load import as_robot, load_robot, robot_from_mjcf
from eomgen.errors import DescriptionError, InputError
from eomgen.robot.value import Robot
from tests.oracles.mjcf import MjcfOracle
from tests.support.builds import Build
from tests.support.description_samples import MJCF, URDF
from tests.support.fuzzing import check_message
from tests.support.mjcf_models import humanoids
from tests.support.mutations import mutant
from tests.support.optional import needs
from tests.support.refusals import refused
from tests.support.soak import soaked
from tests.support.surfaces import check_robot
from tests.support.text_files import text_file

LEG = """<mujocoinclude>
  <default><default class="leg"><joint damping="0.2" axis="0 1 0" range="-40 50"/></default></default>
  <asset><mesh name="foot" file="foot.stl" scale="0.5 0.5 0.5"/></asset>
</mujocoinclude>
"""
WALKER = """<mujoco model="walker">
  <include file="leg.xml"/>
  <worldbody>
    <body name="trunk" pos="0 0 1">
      <joint name="lift" type="slide" axis="0 0 1" armature="0.3"/>
      <geom type="box" size="0.2 0.1 0.1"/>
      <replicate count="2" sep="-" offset="0 0.3 0">
        <body name="leg" childclass="leg" pos="0.1 0 -0.2" euler="0 20 0">
          <joint name="hip" springdamper="0.5 1"/>
          <geom type="mesh" mesh="foot" pos="0 0.02 -0.1"/>
          <site name="toe" pos="0 0 -0.3"/>
        </body>
      </replicate>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="lift"/></actuator>
</mujoco>
"""
EMPTY = '<include file="empty.xml"/>'
CORNERS = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.3, 0.0], [0.1, 0.1, 0.5]])  # m


def stl() -> bytes:
    """A tetrahedron, as a binary STL."""
    faces = [CORNERS[list(face)] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    parts = [struct.pack("<12fH", 0.0, 0.0, 0.0, *face.ravel(), 0) for face in faces]
    return bytes(80) + struct.pack("<I", len(parts)) + b"".join(parts)


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    (tmp_path / "foot.stl").write_bytes(stl())
    (tmp_path / "leg.xml").write_text(LEG)
    return written(tmp_path, WALKER)


def written(folder: Path, text: str) -> Path:
    (folder / "empty.xml").write_text("<mujocoinclude><statistic extent='2'/></mujocoinclude>")
    return text_file(folder / "model.xml", text)


@pytest.mark.soak
def test_a_model_of_several_files_moves_as_mujocos(walker: Path, built: Build) -> None:
    robot = load_robot(walker)
    coordinates = [f"{joint.name}.{key}" for joint in robot.joints for key in joint.coordinates]
    assert coordinates == ["lift.z", "hip_0.gamma", "hip_1.gamma"]
    assert {frame.name for frame in robot.frames} == {"toe_0", "toe_1"}
    assert robot.joint("hip_0").limits == pytest.approx(np.radians([-40, 50]))
    assert robot.joint("hip_0").coordinates["gamma"].stiffness
    volume = abs(np.linalg.det(0.5 * (CORNERS[1:] - CORNERS[0]))) / 6.0
    assert robot.link("leg_0").mass == pytest.approx(1000.0 * volume, rel=1e-6)  # STL has floats of 32 bits
    assert any("'push'" in note for note in robot.notes)

    kernel, oracle = built(robot, "mass_matrix", "inverse_dynamics", "kinematics"), MjcfOracle(walker, robot)
    for q, v, a in np.random.default_rng(0).uniform(-1.0, 1.0, (3, 3, 3)):
        assert np.allclose(kernel.mass_matrix(q), oracle.mass_matrix(q), rtol=1e-11, atol=1e-12)
        assert np.allclose(kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a), rtol=1e-11, atol=1e-11)
        for name, pose in oracle.poses(q).items():
            assert np.allclose(kernel.frame_pose(q, name.replace("-", "_")), pose, atol=1e-13)


def test_without_mujoco_a_refusal_says_what_would_help(walker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for call, given in ((load_robot, walker), (robot_from_mjcf, MJCF)):
        refused(InputError, r"\(MJCF\) are read through MuJoCo, which is .*eomgen\[mujoco\]", call, given)


def test_what_is_only_shown_or_measured_need_not_be_there(tmp_path: Path) -> None:
    more = """<asset><mesh name="shin" file="gone.stl"/><texture name="sky" type="2d" file="gone.png"/>
      <texture name="box" type="cube" fileright="gone.png" fileleft="gone.png"/><mesh name="unused" file="gone.obj"/>
      <hfield name="hills" file="gone.png" size="1 1 1 1"/><skin name="skin" file="gone.skn"/>
      <material name="blue" texture="sky"/></asset><sensor><touch site="gone"/></sensor>
      <worldbody><geom type="hfield" hfield="hills"/></worldbody>"""
    text = MJCF.replace('mesh="shin"/>', 'mesh="shin" material="blue"/>')
    robot, wanted = (
        load_robot(written(tmp_path, text.replace("</mujoco>", f"{more}{EMPTY}</mujoco>"))),
        robot_from_mjcf(MJCF),
    )
    assert (robot.links, robot.joints, robot.springs) == (wanted.links, wanted.joints, wanted.springs)


@pytest.mark.parametrize("attribute", ['mass="0"', 'density="0"', 'group="3"'])
def test_meshes_without_mass_need_not_be_there(attribute: str, tmp_path: Path) -> None:
    """Of a body whose other geoms have one; and a capsule that is fitted to a mesh."""
    shown = f'<geom type="mesh" mesh="gone" {attribute}/><geom type="capsule" mesh="gone" {attribute}/>'
    assets = '<compiler inertiagrouprange="0 2"/><asset><mesh name="gone" file="gone.stl"/></asset>'
    text = f'<mujoco>{assets}<worldbody><body><joint/><geom size="0.5"/>{{}}</body></worldbody></mujoco>'
    assert load_robot(written(tmp_path, text.format(shown))).links == robot_from_mjcf(text.format("")).links
    caught = refused(DescriptionError, "gone.stl", robot_from_mjcf, text.format(shown.replace(attribute, "")))
    assert caught.line == 1


def test_a_hundred_humanoids_are_read_in_seconds(tmp_path: Path) -> None:
    """2,200 coordinates in less than 5 s of processor time, that of the process that compiles included."""
    needs("mujoco")
    path = text_file(tmp_path / "many.xml", humanoids(100))
    before = os.times()
    robot = load_robot(path)
    spent = sum(after - begin for after, begin in zip(os.times()[:4], before[:4], strict=True))
    assert sum(len(joint.coordinates) for joint in robot.joints) == 2200
    assert spent < 5.0


REFUSED = {  # what stands in the model instead of its include, and words of the refusal
    "an include that is missing": (
        '<include file="nothing.xml"/>',
        ["include", "nothing.xml", "MuJoCo 4", "model.xml:2:"],
    ),
    "a mesh that counts and is missing": (
        '<asset><mesh name="foot" file="gone.stl"/></asset><default><default class="leg"/></default>',
        ["gone.stl", "model.xml:2:"],
    ),
    "a fluid, in another file": ('<include file="leg.xml"/><include file="fluid.xml"/>', ["density is 1000", "fluid"]),
    "a tendon of a pulley": ('<include file="leg.xml"/><include file="rope.xml"/>', ["tendon 'rope'", "straight"]),
    "weight that is carried": ('<include file="leg.xml"/><include file="float.xml"/>', ["body 'up'", "gravcomp"]),
}


@pytest.mark.parametrize("case", soaked(REFUSED, ("an include that is missing", "a fluid, in another file")))
def test_refusals_name_file_and_reason(case: str, walker: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = walker.parent
    (folder / "fluid.xml").write_text('<mujocoinclude><option density="1000"/></mujocoinclude>')
    rope = '<site site="toe-0"/><pulley divisor="2"/><site site="toe-0"/><site site="toe-1"/>'
    (folder / "rope.xml").write_text(
        f'<mujocoinclude><tendon><spatial name="rope" stiffness="3"><site site="toe-1"/>{rope}</spatial></tendon>'
        "</mujocoinclude>"
    )
    (folder / "float.xml").write_text(
        '<mujocoinclude><worldbody><body name="up" gravcomp="1"><joint/><geom size="1"/></body></worldbody>'
        "</mujocoinclude>"
    )
    new, words = REFUSED[case]
    path = written(folder, WALKER.replace('<include file="leg.xml"/>', new))
    caught = refused(DescriptionError, "", load_robot, path)
    check_message(caught)
    for word in ("model.xml", "allowed", *words):
        assert word in str(caught)
    assert main(["check", str(path)]) == 1
    assert words[0] in capsys.readouterr().out


BODY = '<body name="b"><joint/><geom size="1"/></body>'


def attaching(file: str, count: int = 1, name: str = "m") -> str:
    """A model that attaches the one of a file so many times."""
    assets = "".join(f'<model name="{name}{i}" file="{file}"/>' for i in range(count))
    places = "".join(f'<frame><attach model="{name}{i}" body="b" prefix="{i}"/></frame>' for i in range(count))
    body = f"<body name='b'><joint/><geom size='1'/>{places}</body>"
    return f"<mujoco><asset>{assets}</asset><worldbody>{body}</worldbody></mujoco>"


def copied(count: int, inside: str) -> str:
    return f'<replicate count="{count}" offset="0 0 1">{inside}</replicate>'


def part(inside: str) -> str:
    return f"<mujocoinclude>{inside}</mujocoinclude>"


def world(inside: str) -> str:
    return f"<mujoco><worldbody>{inside}</worldbody></mujoco>"


HOSTILE = {  # files, and words of the refusal; model.xml is the one that is read
    "attaches itself": ({"model.xml": attaching("model.xml")}, r"model\.xml:1: <model>: .* attaches itself"),
    "attaches itself through another": (
        {"model.xml": attaching("other.xml"), "other.xml": attaching("model.xml")},
        r"model\.xml:1: <model>: the model 'other.xml' attaches itself",
    ),
    "includes itself": ({"model.xml": WALKER, "leg.xml": part('<include file="leg.xml"/>')}, "already included"),
    "models in models": (
        {f"{'model' if i == 0 else f'm{i}'}.xml": attaching(f"m{i + 1}.xml") for i in range(80)},
        "could not parse model file",
    ),
    "models in many files": (
        {f"{'model' if i == 0 else f'm{i}'}.xml": attaching(f"m{i + 1}.xml") for i in range(210)},
        r"m200\.xml:1: <model>: the model has 201 other files .*allowed: up to 200 files",
    ),
    "twice as many in each file": (
        {f"{'model' if i == 0 else f'm{i}'}.xml": attaching(f"m{i + 1}.xml", 2) for i in range(40)} | {"m40.xml": BODY},
        r"m\d+\.xml:1: <attach>: the model has \d+ elements, with all copies and files; allowed: up to 20000",
    ),
    "no number behind an include": (
        {"model.xml": WALKER, "leg.xml": part('<default><geom mass="NaN"/></default>')},
        "a number is nan, in a file that it names; allowed: finite",
    ),
    "too many copies": (
        {"model.xml": world(copied(6000, BODY))},
        r"model\.xml:1: <replicate>: its content is copied 6000 times; allowed: up to 1000",
    ),
    "copies of copies": (
        {"model.xml": world(copied(100, "\n" + copied(100, copied(100, BODY))))},
        r"model\.xml:2: <replicate>: its content is copied 10000 times",
    ),
    "copies of an included file": (
        {"model.xml": world(copied(50, '<include file="a.xml"/>')), "a.xml": part("\n" + copied(50, BODY))},
        r"a\.xml:2: <replicate>: its content is copied 2500 times",
    ),
    "copies in other words": (
        {"model.xml": world(copied(1, BODY).replace('"1"', "\n'00000000000&#57;99999999999'", 1) + "<!-- <mujoco")},
        r"model\.xml:1: <replicate>: its content is copied 999999999 times",
    ),
    "a composite": (
        {"model.xml": world('<body><composite type="cable" count="100000 1 1"/></body>')},
        r"model\.xml:1: <composite>: its content is copied 100000 times",
    ),
    "a flexcomp": (
        {"model.xml": world('<flexcomp name="f" type="grid" count="1000 1000 9" dim="3"/>')},
        r"model\.xml:1: <flexcomp>: its content is copied 9000000 times",
    ),
    "many elements": ({"model.xml": world("<site/>" * 500_000)}, r"<site>: the model has 20001 elements"),
    "a long tag": ({"model.xml": "<mujoco><" + "a" * 2_000_000}, "MuJoCo .* says"),
    "long attributes": ({"model.xml": "<mujoco><frame " + "a" * 2_000_000 + ">"}, "MuJoCo .* says"),
    "comments without end": ({"model.xml": "<mujoco>" + "<!-- '" * 300_000}, "MuJoCo .* says"),
    "quotes without end": ({"model.xml": "<mujoco>" + "<a \"'" * 300_000}, "MuJoCo .* says"),
    "many numbers": (
        {"model.xml": f'<mujoco><custom><numeric name="n" size="200000"/></custom>{world(BODY)[8:]}'},
        "the model has 200000 numbers of <numeric>; allowed: up to 100000",
    ),
    "an included pipe": ({"model.xml": '<mujoco><include file="/dev/zero"/></mujoco>'}, "<include>: .* cannot be read"),
}


@pytest.mark.parametrize(
    "case", soaked(HOSTILE, [case for case in HOSTILE if case not in ("models in models", "many numbers")])
)
def test_what_would_end_mujoco_ends_another_process(case: str, tmp_path: Path) -> None:
    files, words = HOSTILE[case]
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    before = os.times()
    caught = refused(DescriptionError, words, load_robot, tmp_path / "model.xml")
    assert sum(after - begin for after, begin in zip(os.times()[:4], before[:4], strict=True)) < 5.0
    check_message(caught)
    assert caught.line is not None


def test_files_that_are_named_twice_are_no_circle(tmp_path: Path) -> None:
    (tmp_path / "twice.xml").write_text(f'<mujoco model="t"><worldbody>{BODY}</worldbody></mujoco>')
    assert len(load_robot(text_file(tmp_path / "model.xml", attaching("twice.xml", 2))).joints) == 3


@pytest.mark.parametrize(("limit", "value"), [("SECONDS", 1), ("GIBIBYTES", 1), ("WALL_SECONDS", 0.05)])
def test_what_takes_long_is_refused_within_the_limits(
    limit: str, value: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By as many bodies as a description may have."""
    monkeypatch.setattr(f"eomgen.description.mjcf.compiled.{limit}", value)
    path = text_file(tmp_path / "model.xml", world(BODY.replace(' name="b"', "") * 4990))
    caught = refused(DescriptionError, r"MuJoCo.* (memory|bad_alloc|took more than|was ended)", load_robot, path)
    check_message(caught)


@pytest.mark.parametrize("count", [2, pytest.param(60, marks=pytest.mark.soak)])
def test_mutants_behind_an_include_are_read_or_refused(count: int, tmp_path: Path) -> None:
    """Whatever stands in a file that a model names: a robot, or a refusal in a line; this process goes on."""
    for seed in range(count):
        content = mutant("mjcf", 60_000_000 + seed)
        (tmp_path / "leg.xml").write_bytes(content)
        (tmp_path / "model.xml").write_text(
            f'<mujoco><asset><model name="m" file="leg.xml"/></asset><worldbody>{BODY}</worldbody></mujoco>'
            if seed % 2
            else f'<mujoco><include file="leg.xml"/><worldbody>{BODY}</worldbody></mujoco>'
        )
        try:
            check_robot(load_robot(tmp_path / "model.xml", inertia="project"))
        except DescriptionError as error:
            check_message(error)


IGNORED = {"gravcomp": "1", "eular": "0 0 4", "mocap": "true", "mass": "3", "size": "4", "prefix": "p"}
KNOWN = {
    "frame": {"pos": "1 2 3", "quat": "1 1 0 0", "axisangle": "1 0 0 9", "xyaxes": "0 1 0 -1 0 0", "zaxis": "1 0 0"},
    "replicate": {"count": "3", "sep": "-", "offset": "1 0 0"},
}
KNOWN = {tag: {**values, "euler": "0 0 4", "class": "c", "childclass": "c"} for tag, values in KNOWN.items()}


@pytest.mark.parametrize("tag", KNOWN)
def test_attributes_that_mujoco_ignores_are_named(tag: str) -> None:
    """Those of frames and copies that leave the compiled model as it is."""
    mujoco = needs("mujoco")
    default = '<default><geom size="1"/><default class="c"><geom size="2"/></default></default>'
    count = ' count="2"' if tag == "replicate" else ""

    def found(words: str) -> tuple[list[object], list[str]]:
        have = "" if "count=" in words else count
        body = f'<{tag}{have}{words}><body name="b" pos="1 0 0"><joint/><geom type="sphere"/></body></{tag}>'
        text = f"<mujoco>{default}{world(body)[8:]}"
        model = mujoco.MjModel.from_xml_string(text)
        numbers = [getattr(model, f"body_{key}").tolist() for key in ("pos", "quat", "mass", "gravcomp")]
        notes = [note for note in robot_from_mjcf(text, source="m.xml").notes if "ignores" in note]
        return [model.names, *numbers], notes

    plain, notes = found("")
    assert notes == []
    for key, value in {**IGNORED, **KNOWN["frame"], **KNOWN["replicate"]}.items():
        model, notes = found(f' {key}="{value}"')
        assert (model == plain) is (key not in KNOWN[tag]), key
        assert notes == [f"m.xml:1: <{tag}>: MuJoCo ignores the attribute '{key}'"] * (key not in KNOWN[tag])


def test_warnings_become_notes_and_no_log_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = f'<mujoco><compiler settotalmass="3"/><worldbody>{BODY}</worldbody></mujoco>'
    robot = load_robot(written(tmp_path, text))
    (note,) = (note for note in robot.notes if "MuJoCo warns" in note)
    assert "'settotalmass' is deprecated" in note
    assert robot.links[0].mass == pytest.approx(3.0)
    for section in ('<include file="part"/>', '<asset><mesh name="m" file="part"/></asset>', "<bad/>"):
        body = BODY.replace("<geom ", '<geom type="mesh" mesh="m"/><geom ')
        path = written(tmp_path, f"<mujoco>{section}{world(body)[8:]}")
        refused(DescriptionError, "MuJoCo .* says", load_robot, path)
    assert not list(tmp_path.glob("MUJOCO_LOG*"))


def test_the_compiling_process_logs_nothing(tmp_path: Path) -> None:
    """By MuJoCo's logger alone, which writes a file in the folder where its process works; the model's here."""
    needs("mujoco")
    log = "import mujoco; mujoco.set_mju_user_warning(None); mujoco.MjSpec.from_file('part')"
    code = f"from eomgen.description.mjcf.compiling import _answer; _answer('', {str(tmp_path)!r}); {log}"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert "could not find decoder" in found.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["nan", "NaN", "-nan", "nan(12)"])
@pytest.mark.parametrize("place", ['geom size="1" mass="{}"', 'geom size="1" pos="{} 0 0"', 'joint damping="{}"'])
@pytest.mark.parametrize("include", [EMPTY, ""])
def test_numbers_that_are_none_are_refused(text: str, place: str, include: str, tmp_path: Path) -> None:
    body = f'<body name="b"><joint/><geom size="1"/><{place.format(text)}/></body>'
    path = written(tmp_path, f"<mujoco>{include}<worldbody>{body}</worldbody></mujoco>")
    caught = refused(DescriptionError, r"model\.xml:1: .* is '.*(nan|NaN).*'; allowed: .*finite", load_robot, path)
    check_message(caught)


def test_names_may_say_nan(tmp_path: Path) -> None:
    body = BODY.replace('name="b"', 'name="nan"')
    path = written(tmp_path, f"<mujoco>{EMPTY}<worldbody>{body}</worldbody></mujoco>")
    assert [link.name for link in load_robot(path).links] == ["nan"]


def expanded(tmp_path: Path, text: str) -> Robot:
    path = text_file(tmp_path / "arm.urdf.xacro", text)
    return load_robot(path, xacro=True)


MACROS = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)


def test_macros_of_xacro_are_expanded(tmp_path: Path) -> None:
    needs("xacro")
    (tmp_path / "more.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="m" value="2"/></robot>'
    )
    include = '<xacro:include filename="more.xacro"/>'
    moments = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="extra"><inertial><mass value="${{m * 2}}"/>{moments}</inertial></link>'
    joint = '<joint name="hold" type="fixed"><parent link="lower"/><child link="extra"/></joint>'
    robot = expanded(tmp_path, MACROS.replace("</robot>", f"{include}{link}{joint}</robot>"))
    assert robot.link("extra").mass == 4.0
    with pytest.raises(DescriptionError, match=r"arm\.urdf\.xacro: xacro says: .*gone\.xacro") as caught:
        expanded(tmp_path, MACROS.replace("</robot>", '<xacro:include filename="gone.xacro"/></robot>'))
    check_message(caught.value)


def test_macros_are_expanded_only_for_who_asks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file's expressions are evaluated where somebody has asked for it, and nowhere else."""
    xacro = needs("xacro")
    expanded_files: list[str] = []
    real = xacro.process_file
    monkeypatch.setattr(xacro, "process_file", lambda path, **how: (expanded_files.append(path), real(path, **how))[1])
    path = text_file(tmp_path / "arm.xacro", MACROS)
    for command in ("check", "info", "simulate"):
        assert main([command, str(path)]) == 1
        said = "".join(capsys.readouterr())
        assert "as Python" in said
        assert "--xacro" in said
    for given in (False, 1, "yes", None):
        with pytest.raises(
            DescriptionError, match=r"xacro runs what stands in .* allowed: --xacro, or xacro=True"
        ) as e:
            load_robot(path, xacro=given)  # type: ignore[arg-type]
        check_message(e.value)
    refused(DescriptionError, "--xacro", as_robot, path)
    assert expanded_files == []
    assert main(["check", "--xacro", str(path)]) == 0
    assert expanded_files == [str(path)]


def test_packages_are_found_where_they_are_said_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By Python and by the command line, from another folder; nothing of it is left behind."""
    needs("xacro")
    (tmp_path / "arm" / "pkg").mkdir(parents=True)
    (tmp_path / "arm" / "pkg" / "more.xacro").write_text(MACROS)
    monkeypatch.chdir(tmp_path)
    path = Path("arm.xacro")
    include = '<xacro:include filename="$(find arm_pkg)/more.xacro"/>'
    path.write_text(f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{include}</robot>')
    wanted = [link.name for link in expanded(tmp_path, MACROS).links]
    robot = load_robot(path, xacro={"arm_pkg": "arm/pkg", "other": tmp_path})
    assert [link.name for link in robot.links] == wanted
    assert main(["check", str(path), "--xacro", "--package", "arm_pkg=arm/pkg"]) == 0
    capsys.readouterr()
    assert "ament_index_python" not in sys.modules
    for given, said in (
        (["--package", "arm_pkg=arm/pkg"], "--package: given without --xacro"),
        (["--xacro", "--package", "arm_pkg"], "package: 'arm_pkg'; allowed: NAME=DIR"),
        (["--xacro", "--package", "arm_pkg=gone"], "package 'arm_pkg': there is no folder 'gone'"),
    ):
        assert main(["check", str(path), *given]) == 1
        assert said in "".join(capsys.readouterr())
    with pytest.raises(DescriptionError, match=r"no package 'arm_pkg'; did you mean 'arm_pk'\?.* --package NAME=DIR"):
        load_robot(path, xacro={"arm_pk": "arm/pkg"})


FAMILY = """<robot name="$(arg name)" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="kind" default="choose_one"/><xacro:arg name="gripper" default="false"/>
<xacro:macro name="arm" params="sizes length:=0.5"><link name="foot"/>
<link name="rod"><inertial><origin xyz="${length / 2} 0 0"/><mass value="${sizes['mass']}"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="foot"/><child link="rod"/></joint></xacro:macro>
<xacro:arm sizes="${xacro.load_yaml('$(find family)/$(arg kind).yaml')}"/>
<xacro:if value="$(arg gripper)"><link name="hand"/>
<joint name="wrist" type="fixed"><parent link="rod"/><child link="hand"/></joint></xacro:if></robot>"""


def test_arguments_of_xacro(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As of the files of Universal Robots: a name without a default, numbers from a file of YAML by an argument."""
    needs("xacro")
    path = text_file(tmp_path / "family.urdf.xacro", FAMILY)
    (tmp_path / "long.yaml").write_text("mass: 3.5\n")
    found: dict[str, Any] = {
        "xacro": {"family": tmp_path},
        "xacro_args": {"name": "mine", "kind": "long", "gripper": True},
    }
    robot = load_robot(path, **found)
    assert (robot.name, robot.link("rod").mass, robot.link("rod").com[0]) == ("mine", 3.5, 0.25)
    assert robot.link("hand")
    words = ["check", str(path), "--xacro", "--package", f"family={tmp_path}"]
    assert main([*words, "kind:=long", "--xacro-arg", "name:=mine"]) == 0
    for given, said in (
        (["kind:=long"], "Undefined substitution argument name; arguments of this file: 'name'; allowed"),
        (["name:=mine"], "choose_one.yaml.*arguments of this file: 'name', 'kind', .*NAME:=VALUE, or xacro_args="),
        (
            ["name:=a", "kind:=long", "knid:=1"],
            "xacro_args: there is no argument 'knid'; did you mean 'kind'.; allowed",
        ),
        (["name:=a", "name:=b"], "xacro-arg: 'name' is given twice"),
        (["--xacro-arg", "name"], "xacro-arg: 'name'; allowed: NAME:=VALUE"),
    ):
        capsys.readouterr()
        assert main([*words, *given]) == 1
        assert re.search(said, "".join(capsys.readouterr()))
    assert main(["info", str(path), "name:=mine"]) == 1
    refused(
        DescriptionError,
        "xacro_args: 'name' is a table; allowed: texts, numbers",
        load_robot,
        path,
        **found | {"xacro_args": {"name": {}}},
    )
    refused(InputError, "xacro_args: got a value of type int; allowed: values", load_robot, path, xacro_args=5)
    refused(DescriptionError, "allowed: with a .xacro file", load_robot, "ur5", xacro_args={"name": "mine"})


def test_packages_of_another_thread_are_not_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that begins while another reads with its packages has its own alone."""
    xacro = needs("xacro")
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg" / "more.xacro").write_text(MACROS)
    path = tmp_path / "arm.xacro"
    include = '<xacro:include filename="$(find arm_pkg)/more.xacro"/>'
    path.write_text(f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{include}</robot>')
    real, refusals, threads = xacro.process_file, [], []

    def read_without() -> None:
        try:
            load_robot(path, xacro=True)
        except DescriptionError as error:
            refusals.append(str(error))

    def process_file(name: str, **how: object) -> object:
        if not threads:
            threads.append(threading.Thread(target=read_without))
            threads[0].start()
            threads[0].join(0.5)
        return real(name, **how)

    monkeypatch.setattr(xacro, "process_file", process_file)
    assert load_robot(path, xacro={"arm_pkg": tmp_path / "pkg"}).name == "r"
    threads[0].join()
    assert len(refusals) == 1
    assert "no package 'arm_pkg'" in refusals[0]
    assert "ament_index_python" not in sys.modules


def test_without_xacro_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    refused(InputError, r"need xacro, which is not installed: .*eomgen\[xacro\]", expanded, tmp_path, MACROS)


def test_sdf_is_refused_with_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = text_file(tmp_path / "arm.sdf", '<sdf version="1.9"/>')
    refused(DescriptionError, "SDF is not read; allowed: the URDF", load_robot, path)
    assert main(["check", str(path)]) == 1
    assert "SDF is not read" in capsys.readouterr().out
