"""MJCF that is read, against MuJoCo: dynamics and poses of random models, and equality constraints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomgen.cli.entry import main
from eomgen.description.load import load_robot, robot_from_mjcf
from eomgen.description.mjcf.read import root_tag
from eomgen.errors import DescriptionError
from eomgen.export.mujoco import mjcf
from eomgen.identifiers import to_identifier
from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Coupling, Robot
from tests.oracles.mjcf import MjcfOracle
from tests.support.builds import Build
from tests.support.description_samples import MJCF, URDF, link_poses
from tests.support.figures import Figures
from tests.support.fuzzing import check_message
from tests.support.mjcf_models import random_model
from tests.support.optional import OptionalModule
from tests.support.random_robots import seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]
mujoco = OptionalModule("mujoco")
KERNELS = ("mass_matrix", "inverse_dynamics", "energy", "kinematics")


def deviations(text: str, built: Build, states: int = 5) -> tuple[dict[str, float], list[str]]:
    """Greatest deviations of a model that is read from MuJoCo's, relative; and the notes."""
    robot = robot_from_mjcf(text)
    kernel, oracle = built(robot, *KERNELS), MjcfOracle(text, robot)
    rng, worst = np.random.default_rng(0), dict.fromkeys(("M", "inverse", "kinetic", "potential", "pose"), 0.0)
    first = None

    def compare(key: str, ours: np.ndarray, theirs: np.ndarray, scale: float = 0.0) -> None:
        worst[key] = max(worst[key], float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), scale)))

    for _ in range(states):
        q, v, a = rng.uniform(-1.0, 1.0, (3, kernel.n))
        compare("M", kernel.mass_matrix(q), oracle.mass_matrix(q))
        compare("inverse", kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a))
        ours, theirs = kernel.energy(q, v), oracle.energy(q, v)
        first = (ours, theirs) if first is None else first
        compare("kinetic", ours[:1], theirs[:1])
        compare("potential", ours[1:] - first[0][1], theirs[1:] - first[1][1], scale=1.0)  # zero is elsewhere
        for name, pose in oracle.poses(q).items():
            compare("pose", kernel.frame_pose(q, to_identifier(name)), pose)
    return worst, list(robot.notes)


@pytest.mark.parametrize("seed", seeds(0, 3, 80))
def test_random_models_move_as_mujocos(seed: int, built: Build, figures: Figures) -> None:
    worst, _ = deviations(random_model(seed), built)
    for key, value in worst.items():
        figures.at_most(key, value, 1e-10)


def test_what_a_model_becomes() -> None:
    robot = robot_from_mjcf(MJCF)
    assert [(j.name, j.type, tuple(j.coordinates)) for j in robot.joints if j.coordinates] == [
        ("torso_joint", "prismatic", ("x", "z", "beta")),
        ("hip", "revolute", ("gamma",)),  # not orthogonal to the next
        ("twist", "revolute", ("gamma",)),
        ("knee", "revolute", ("gamma",)),
        ("loose", "free", COORDINATES),
    ]
    assert robot.base == "world"
    assert robot.gravity == (0.0, 0.0, -9.81)
    hip, knee = robot.joint("hip"), robot.joint("knee")
    assert hip.offset[5] == pytest.approx(-np.radians(5))
    assert hip.coordinates["gamma"].preload == pytest.approx(-5 * np.radians(10))
    assert hip.limits == pytest.approx(np.radians([-30, 40]))
    assert knee.limits == hip.limits  # limited="false", but a range by its class
    root = robot.joint("torso_joint").coordinates
    assert root["z"].armature == 0.2
    assert root["beta"].friction.coulomb == 0.3
    assert robot.link("torso").mass == 4.0
    assert robot.link("thigh").mass == pytest.approx(500 * 8 * 0.1 * 0.05 * 0.2)
    assert robot.link("thigh_hip").mass == 0.0
    assert [frame.name for frame in robot.frames] == ["hook", "head"]
    (rope,) = robot.springs
    assert (rope.links, rope.free_length, rope.stiffness) == (("world", "torso"), 0.5, 20.0)
    for note in (
        "'rootx -> torso_joint.x'",
        "limits of joints: 'hip', 'twist'",
        "'push'",
        "contacts",
        "'rooty'",
        "'loose'",
    ):
        assert any(note in found for found in robot.notes), note


def test_the_sample_moves_as_mujocos(built: Build) -> None:
    text = MJCF.replace('<geom type="mesh" mesh="shin"/>', "").replace('frictionloss="0.3"', "")
    worst, _ = deviations(text, built)
    assert max(worst.values()) <= 1e-10


def test_a_site_with_the_name_of_a_body_is_called_otherwise() -> None:
    """The pose of a name is one: the body's."""
    robot = robot_from_mjcf(
        MJCF.replace('site name="head"', 'site name="torso"').replace('site="head"', 'site="torso"')
    )
    assert [frame.name for frame in robot.frames] == ["hook", "torso_2"]
    assert any("'torso -> torso_2'" in note for note in robot.notes)
    robot = robot_from_mjcf(MJCF.replace('site name="head"', 'site name="thigh_hip"').replace('"head"', '"thigh_hip"'))
    assert "thigh_hip" not in [link.name for link in robot.links]


AXES = {"+x": "1 0 0", "-x": "-1 0 0", "+y": "0 1 0", "-y": "0 -1 0", "+z": "0 0 1", "-z": "0 0 -1"}


@pytest.mark.parametrize(
    ("joints", "expected"),
    [
        (["slide +x", "slide +y", "slide +z", "hinge +x", "hinge +y", "hinge +z"], ["free: x y z alpha beta gamma"]),
        (["hinge +x", "hinge +y", "hinge +z"], ["revolute: alpha beta gamma"]),
        (["hinge +z", "hinge +y", "hinge +x"], ["revolute: alpha gamma", "revolute: gamma"]),  # left-handed
        (["hinge +z", "hinge +y", "hinge -x"], ["revolute: alpha beta gamma"]),
        (["hinge +x", "slide +x"], ["revolute: gamma", "prismatic: z"]),  # the slide moves along turned axes
        (["slide +x", "slide +x"], ["prismatic: z", "prismatic: z"]),
        (["slide -y", "hinge +y"], ["prismatic: z", "revolute: gamma"]),
        (["slide -y", "hinge -y"], ["revolute: z gamma"]),
        (["slide +x", "slide +z", "hinge +y"], ["prismatic: x z beta"]),
        (["ball +z", "slide +x"], ["fixed: alpha beta gamma", "prismatic: z"]),
    ],
)
def test_joints_of_one_body_become_few(joints: list[str], expected: list[str]) -> None:
    written = "".join(f'<joint type="{kind}" axis="{AXES[axis]}"/>' for kind, axis in (text.split() for text in joints))
    text = BODY.format(written)
    robot = robot_from_mjcf(text)
    assert [f"{joint.type}: {' '.join(joint.coordinates)}" for joint in robot.joints] == expected
    oracle = MjcfOracle(text, robot)
    for seed in range(3):
        q = np.random.default_rng(seed).uniform(-1, 1, oracle.n)
        assert np.abs(link_poses(robot, q)["b"] - oracle.poses(q)["b"]).max() < 1e-14


BODY = '<mujoco><worldbody><body name="b">{}<geom size="0.1"/></body></worldbody></mujoco>'
REFUSED = [  # what is replaced, by what, the line, and what the message says
    ('pos="0 0 0.1" axis="0 1 1"', 'axis="0 0 0"', 20, "axis too small"),
    ('name="rootx"', 'name="rootx" stifness="1"', 13, "unrecognized attribute: 'stifness'"),
    ('ref="5"', 'ref="x"', 20, "'ref'"),
    ('ref="5"', 'ref="nan"', 20, "ref is 'nan'; allowed: finite numbers"),
    ('ref="5"', 'ref="inf"', 20, "joint 'hip': qpos0 is inf; allowed: finite numbers of magnitude up to 1e+30"),
    ('ref="5"', 'class="log"', 20, "'log'"),
    ('ref="5"', 'stiffness="1 2 3"', 20, "joint 'hip': stiffness is '1 2 3'; allowed: a linear and a cubic term"),
    ('ref="5"', 'stiffness="1 0 3"', 20, "joint 'hip': springref is 0.174533 with a cubic stiffness"),
    ('ref="5"', 'springyield="1"', 20, "joint 'hip': springyield is set"),
    ('ref="5"', 'type="screw"', 20, "'screw'"),
    ('ref="5"', 'damping="-1"', 20, "joint 'hip': damping is '-1'; allowed: a linear term that is at least 0"),
    ('ref="5"', 'damping="1 2"', 20, "joint 'hip': damping is '1 2'"),
    ('name="twist"', 'name="hip"', 21, "repeated name 'hip'"),
    ('damping="0.1"', 'damping="a"', 6, "'damping'"),
    ('quat="1 0 0.2 0"', 'quat="0 0 0 0"', 23, "zero quaternion"),
    ('quat="1 0 0.2 0"', 'quat="1 0 0.2 0" euler="0 0 0"', 23, "multiple orientation"),
    ('quat="1 0 0.2 0"', 'gravcomp="1"', 23, "body 'shin': gravcomp is 1"),
    ('mass="1.5"', "", 25, "'mass'"),
    ("0.02 0.03 0.02", "0.02 0.03 0.2", 23, "balanceinertia"),
    ('<site name="head"', '<site mass="1" name="head"', 17, "unrecognized attribute: 'mass'"),
    ('eulerseq="xyz"', 'eulerseq="xyw"', 19, "euler sequence"),
    ('eulerseq="xyz"', 'inertiafromgeom="true"', 26, "mesh 'shin'"),
    ('timestep="0.001"', 'density="1.2"', 4, "option: density is 1.2: forces of a fluid"),
    ('<motor name="push" joint="hip"/>', "<motor/></actuator><include file='a.xml'/><actuator>", 36, "'a.xml'"),
    ("<actuator>", '<equality><tendon tendon1="rope"/></equality><actuator>', 36, "'rope' is no <fixed> one"),
    ("<actuator>", "<actuators/><actuator>", 36, "unrecognized element"),
    ('<site site="hook"/>', "", 34, "'rope'"),
    ('<site site="hook"/>', '<site site="hoof"/>', 34, "'hoof'"),
    ("</spatial>", '<site site="hook"/></spatial>', 34, "two <site>"),
    ('springlength="0.5"', 'springlength="0 0.5"', 34, "tendon 'rope': springlength is '0 0.5', with a slack range"),
    ('damping="1" springlength', 'frictionloss="1" springlength', 34, "tendon 'rope': frictionloss is 1"),
    ('<freejoint name="loose"/>', "<freejoint/><joint/>", 31, "'ball'"),
    ('type="sphere" size="0.1"', 'type="sphere" size="0"', 31, "size 0 must be positive"),
    ('name="ball"', 'name="world"', 31, "repeated name 'world'"),
    ("<mujoco", "<muyoco", 2, "MISMATCHED_ELEMENT"),
]
DAMPED = """<mujoco><worldbody><body pos="0.1 0.2 0.3" euler="20 30 40"><joint name="root" {}/>
<inertial mass="1.5" pos="0.05 0.1 -0.02" diaginertia="0.02 0.03 0.04"/>
<body pos="0.2 0 0" quat="1 0.2 0.3 0.4"><joint name="arm" type="ball" damping="0.3" pos="0.02 0.03 0.01"/>
<inertial mass="0.5" pos="0.05 0.1 -0.02" diaginertia="0.02 0.03 0.04"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("kind", soaked(["free", "ball"], ["ball"]))
def test_damped_balls_move_as_mujocos(kind: str, built: Build, figures: Figures) -> None:
    """Alike in all directions, and so they turn freely; the way there and back."""
    text = DAMPED.format(f'type="{kind}" damping="0.7"')
    robot = robot_from_mjcf(text)
    root, arm, *_ = robot.joints
    assert (root.damping, arm.damping) == (
        JointDamping(0.7 if kind == "free" else None, 0.7),
        JointDamping(None, 0.3),
    )
    model = build_model(robot)
    assert [model.bodies[k].joint for k in model.turning] == ["root", "arm"]
    written = mjcf(robot, 1e-3, actuators=True)
    again = robot_from_mjcf(written)
    assert [(joint.name, joint.type, joint.damping) for joint in again.joints[:2]] == [
        ("root", root.type, root.damping),
        ("arm", "fixed", arm.damping),
    ]
    for worst, _ in (deviations(text, built), deviations(written, built)):
        for key, value in worst.items():
            figures.at_most(key, value, 1e-10)
    off = DAMPED.format(f'type="{kind}" damping="0.7"').replace(
        "<worldbody>", '<option><flag damper="disable"/></option><worldbody>', 1
    )
    assert all(joint.damping is None for joint in robot_from_mjcf(off).joints)


@pytest.mark.parametrize(("old", "new", "line", "reason"), REFUSED, ids=[f"{new[:30]}" for _, new, _, _ in REFUSED])
def test_refusals_name_the_line(old: str, new: str, line: int, reason: str) -> None:
    assert MJCF.count(old) >= 1
    caught = refused(DescriptionError, "", robot_from_mjcf, MJCF.replace(old, new, 1), source="m.xml")
    check_message(caught)
    assert str(caught).startswith(f"m.xml:{line}: ")
    assert reason in str(caught)
    assert "; allowed: " in str(caught)


@pytest.mark.parametrize("kind", ["ball", "free"])
@pytest.mark.parametrize("key", ["stiffness", "armature", "frictionloss"])
def test_forces_on_quaternions_are_refused(kind: str, key: str) -> None:
    text = BODY.format(f'<joint name="j" type="{kind}" {key}="5"/>')
    refused(DescriptionError, f"joint 'j': {key} is '5', which acts otherwise", robot_from_mjcf, text)


def test_the_range_of_a_ball_is_named() -> None:
    robot = robot_from_mjcf(BODY.format('<joint name="j" type="ball" range="0 40"/>'))
    assert "the range of ball joints is left out: 'j'" in robot.notes


@pytest.mark.parametrize(
    "section",
    ['<asset><model name="x" file="{}"/></asset>', '<include file="{}"/>', '<asset><mesh file="{}" name="m"/></asset>'],
)
def test_a_text_alone_opens_no_file(section: str, tmp_path: Path) -> None:
    """By an absolute path, too, though the same file is read where the text has a place."""
    other = tmp_path / "other.xml"
    other.write_text('<mujoco><worldbody><body name="x"><joint/><geom size="1"/></body></worldbody></mujoco>')
    body = '<body><joint/><geom type="mesh" mesh="m"/></body>'
    text = f"<mujoco>{section.format(other)}<worldbody>{body}</worldbody></mujoco>"
    refused(DescriptionError, "MuJoCo .* says: .*other.xml", robot_from_mjcf, text)


def test_entities_are_not_expanded() -> None:
    """MuJoCo's parser knows none, so that no text grows."""
    entities = "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9))
    text = MJCF.partition("\n")[2].replace('model="legs"', 'model="&j;"')
    robot = robot_from_mjcf(f'<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa">{entities}]>\n{text}')
    assert len(robot.name) < 10


def own_model() -> str:
    """The model that comes with MuJoCo, without what has no equal here; each such thing is refused before."""
    path = Path(mujoco.__file__).parent / "testdata" / "model.xml"
    if not path.is_file():
        pytest.skip("this wheel of MuJoCo brings no model")
    text = path.read_text(encoding="utf-8")
    changes = (
        (' density="1.225" viscosity="1.8e-5"', "", "forces of a fluid"),
        (' gravcomp="0.5"', "", "gravcomp"),
        ('damping=".1" armature=".1"', 'damping=".1" armature="0"', "acts otherwise"),
    )
    weld = '<weld body1="world" body2="cylinder"/>'
    if weld not in text or not all(old in text for old, _, _ in changes):
        pytest.skip("this wheel of MuJoCo brings another model")
    text = text.replace(weld, "")
    for old, new, reason in changes:
        refused(DescriptionError, reason, robot_from_mjcf, text)
        text = text.replace(old, new)
    return text


def test_mujocos_own_model() -> None:
    """Order, poses, masses and inertias of its bodies: free joints, balls and hinges, a mesh of numbers."""
    text = own_model()
    robot = robot_from_mjcf(text)
    oracle = MjcfOracle(text, robot)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, oracle.n)
    poses, found = link_poses(robot, q), oracle.poses(q)
    names = [
        link.name for link in robot.links if link.name in found and link.name != "head"
    ]  # a site is called so, too
    assert len(names) >= 2
    for name in names:
        assert np.abs(poses[name] - found[name]).max() < 1e-12
        assert robot.link(name).mass == pytest.approx(oracle.model.body(name).mass[0], rel=1e-12)
    assert sum(link.mass for link in robot.links) == pytest.approx(oracle.model.body_mass.sum(), rel=1e-12)
    moments = [np.linalg.eigvalsh(tensor(link.inertia)) for link in robot.links if link.mass]
    theirs = np.sort(oracle.model.body_inertia[oracle.model.body_mass > 0], axis=1)
    assert np.allclose(moments, theirs, rtol=1e-9)


def tensor(inertia: tuple[float, ...]) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.soak
def test_mujocos_own_model_moves_as_there(built: Build, figures: Figures) -> None:
    worst, _ = deviations(own_model(), built)
    for key, value in worst.items():
        figures.at_most(key, value, 1e-10)


def test_a_file_is_known_by_its_root(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "model.xml"
    path.write_text("<!-- <robot> -->\n" + MJCF.partition("\n")[2], encoding="utf-8")
    assert load_robot(path).name == "legs"
    assert main(["info", str(path)]) == 0
    shown = capsys.readouterr()
    assert "legs: 12 coordinates" in shown.out
    assert "note: contacts between geoms are left out" in shown.err
    path.write_text(URDF, encoding="utf-8")
    assert load_robot(path).name == "arm"
    for text in ("", "<", "<!--", "<?xml", "<" * 100_000, "<!-- " * 100_000):
        assert root_tag(text) in ("", "<" * 79, "<?xml")
    path.write_text("", encoding="utf-8")
    refused(DescriptionError, r"model\.xml:1: MuJoCo .* says: .*empty.*; allowed: ", load_robot, path)


def test_deep_files_are_read_as_mujoco_does() -> None:
    """A chain, frames and default classes as deep as its parser takes them; deeper ones are refused."""
    count = 480
    chain = "<body><joint/><geom size='0.1'/>" * count + "</body>" * count
    robot = robot_from_mjcf(f"<mujoco><worldbody>{chain}</worldbody></mujoco>")
    assert len(robot.joints) == count
    deep = "<frame pos='0.1 0 0'>" * count + "<geom size='0.1'/>" + "</frame>" * count
    classes = "".join(f"<default class='c{k}'>" for k in range(count)) + "<geom density='10'/>" + "</default>" * count
    text = f"<mujoco><default>{classes}</default><worldbody><body childclass='c{count - 1}'><joint/>{deep}</body>"
    link = robot_from_mjcf(f"{text}</worldbody></mujoco>").links[0]
    assert link.com == pytest.approx((0.1 * count, 0.0, 0.0))
    assert link.mass == pytest.approx(10 * 4 / 3 * np.pi * 1e-3)
    refused(
        DescriptionError, "nesting is too deep", robot_from_mjcf, f"<mujoco><worldbody>{chain * 2}".replace("/>", ">")
    )


MODEL = """<mujoco>
  <compiler angle="degree"/>
  <default><equality solref="0.01 1"/></default>
  <worldbody>
    <site name="ground" pos="0.3 0.2 0.1" euler="10 20 30"/>
    <body name="a" pos="0.1 0 0.2" euler="0 30 0">
      <joint name="turn" axis="0 0 1" pos="0.1 0 0" ref="30"/>
      <geom size="0.1"/>
      <body name="b" pos="0.5 0 0" quat="0.5 0.1 0.2 0.3">
        <joint name="slide" type="slide" axis="1 0 0" ref="0.25"/>
        <joint name="hinge" axis="0 1 0"/>
        <geom size="0.1"/>
        <site name="tip" pos="0.2 0 0.1" euler="0 40 0"/>
      </body>
    </body>
    <body name="c" pos="0 1 0"><joint name="far" axis="1 0 0"/><geom size="0.1"/>
      <body name="e"><joint name="ball" type="ball"/><geom size="0.1"/></body></body>
  </worldbody>
  <tendon><fixed name="sum"><joint joint="hinge" coef="2"/><joint joint="turn" coef="-3"/></fixed>
    <fixed name="far"><joint joint="far" coef="0.5"/><joint joint="turn" coef="4"/></fixed></tendon>
  <equality>{}</equality>
</mujoco>
"""


def read(equality: str) -> Robot:
    return robot_from_mjcf(MODEL.format(equality), source="m.xml")


def residual(equality: str, q: dict[str, float]) -> np.ndarray:  # type: ignore[type-arg]
    """MuJoCo's of its one constraint, at positions of the hinges and slides."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(equality))
    data = mujoco.MjData(model)
    for name, value in q.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    return np.array(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY])


NAMES = {"turn": "turn.gamma", "slide": "b_joint.x", "hinge": "b_joint.gamma", "far": "far.gamma"}
STATES = [
    dict(zip(("turn", "slide", "hinge", "far"), row, strict=True))
    for row in np.random.default_rng(0).normal(size=(3, 4))
]


@pytest.mark.parametrize(
    ("equality", "scale"),
    [
        ('<joint joint1="turn" joint2="slide" polycoef="0.5 2 0 0 0"/>', 1.0),
        ('<joint joint1="slide" joint2="turn"/>', 1.0),
        ('<joint joint1="turn" polycoef="0.1 3"/>', 1.0),
        ('<tendon tendon1="sum" polycoef="0.1 3"/>', 2.0),
        ('<tendon tendon1="far" tendon2="sum" polycoef="0.1 3"/>', 0.5),
    ],
)
def test_joints_are_coupled_as_in_mujoco(equality: str, scale: float) -> None:
    (coupling,) = read(equality).couplings
    for q in STATES:
        x = {f"{NAMES[name]}": value for name, value in q.items()}
        value = x[coupling.of] - sum(r * x[name] for name, r in coupling.to.items()) - (coupling.offset or 0.0)
        assert scale * value == pytest.approx(residual(equality, q)[0], abs=1e-12)


@pytest.mark.parametrize(
    ("equality", "kind"),
    [
        ('<connect body1="b" body2="c" anchor="0.1 0.2 0.3"/>', "spherical"),
        ('<connect body1="b" anchor="0.1 0.2 0.3"/>', "spherical"),
        ('<connect site1="tip" site2="ground"/>', "spherical"),
        ('<weld body1="b" body2="c"/>', "fixed"),
        ('<weld body1="c" body2="a" relpose="0.1 0.2 0.3 0.7 0.1 0.2 -0.3"/>', "fixed"),
        ('<weld body1="a"/>', "fixed"),
        ('<weld body1="c" body2="b" anchor="0.3 0.1 0.2"/>', "fixed"),
        ('<weld body1="c" body2="b" anchor="0.3 0.1 0.2" relpose="0.1 0.2 0.3 0.7 0.1 0.2 -0.3"/>', "fixed"),
        ('<weld site1="tip" site2="ground"/>', "fixed"),
    ],
)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_loops_close_where_mujocos_constraints_do(equality: str, kind: str, built: Build) -> None:
    """The gap between the cut frames is as long as MuJoCo's residual; the turn of one to the other is as large."""
    (loop,) = read(equality).loops
    assert loop.type == kind
    tree = built(read(""), "kinematics")
    for q in STATES:
        x = np.zeros(tree.n)
        for name, value in q.items():
            x[tree.coordinates.index(NAMES[name])] = value
        ends = []
        for link, placement in zip(loop.links, loop.placements, strict=True):
            at = np.eye(4)
            at[:3, :3], at[:3, 3] = placement.rotation, placement.xyz
            ends.append(tree.frame_pose(x, link) @ at)
        found = residual(equality, q)
        gap = ends[1][:3, 3] - ends[0][:3, 3]
        assert np.linalg.norm(gap) == pytest.approx(np.linalg.norm(found[:3]), abs=1e-12)
        turn = ends[0][:3, :3].T @ ends[1][:3, :3]
        sine = np.sqrt(max(0.0, 3.0 - np.trace(turn))) / 2.0  # of half the angle
        if kind == "fixed":
            assert np.linalg.norm(found[3:]) == pytest.approx(sine, abs=1e-12)


def test_the_reference_position_is_home() -> None:
    robot = read('<weld body1="b" body2="c" name="1 weld"/>')
    assert sorted(robot.home.values()) == pytest.approx([0.25, np.pi / 6])
    assert robot.loops[0].name == "_1_weld"
    assert "equality constraints, which are soft in MuJoCo, are read as rigid: '_1_weld'" in robot.notes
    assert read("").home == {} == read('<weld body1="a" active="false"/>').home


@pytest.mark.parametrize("switch", ["equality", "constraint"])
def test_constraints_that_are_switched_off_are_none(switch: str) -> None:
    off = f'<option><flag {switch}="disable"/></option><worldbody>'
    text = MODEL.format('<weld body1="a"/>').replace("<worldbody>", off)
    assert robot_from_mjcf(text).loops == ()


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        ('<joint joint1="turn" joint2="slide" polycoef="0 1 2"/>', "polycoef is '0 1 2'; allowed: a constant and"),
        ('<joint joint1="trn"/>', "'trn'"),
        ('<joint joint1="ball"/>', "only HINGE and SLIDE"),
        ("<joint/>", "'joint1'"),
        ('<joint joint1="turn" joint2="turn"/>', "'turn' is repeated"),
        ('<tendon tendon1="sum" tendon2="far" polycoef="0 0 0 4"/>', "polycoef is '0 0 0 4'; allowed: a constant"),
        ('<connect body1="d" anchor="0 0 0"/>', "'d'"),
        ('<connect body1="a"/>', "'anchor'"),
        ('<connect site1="tip"/>', "'site2'"),
        ('<weld body1="a" body2="a"/>', "'a' is repeated"),
        ('<weld body1="a" relpose="1 2"/>', "'relpose'"),
        ('<weld body1="a" tendon1="b"/>', "'tendon1'"),
        ('<weld name="w" body1="a"/><weld name="w" body1="b"/>', "repeated name 'w'"),
    ],
)
def test_bad_equalities(equality: str, message: str) -> None:
    line = next(k for k, text in enumerate(MODEL.splitlines(), 1) if "<equality>" in text)
    caught = refused(DescriptionError, "", read, equality)
    check_message(caught)
    assert str(caught).startswith(f"m.xml:{line}: ")
    assert message in str(caught)
    assert "; allowed: " in str(caught)


def test_links_that_do_not_move_against_each_other_are_refused_with_their_place() -> None:
    text = """<mujoco model="r">
  <worldbody>
    <body name="torso"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="arm"><joint type="hinge"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body>
  </worldbody>
  <equality>
    <connect name="pin" body1="torso" anchor="0 0 0"/>
  </equality>
</mujoco>"""
    caught = refused(DescriptionError, "'torso' and 'world' do not move against each other", robot_from_mjcf, text)
    assert caught.line == 8


COMPILED = {  # what MuJoCo's compiler makes of a model
    "frames": """<mujoco><compiler angle="radian" eulerseq="zyx"/>
  <default><joint damping="0.2"/><default class="leg"><joint stiffness="3" springref="0.4" axis="0 1 0"/>
    <geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.4"/></default></default>
  <worldbody><frame pos="0.1 0.2 0.3" euler="0.3 0.2 0.1" childclass="leg">
    <body name="hip" pos="0 0 1"><joint ref="0.3" range="-1 1"/><geom/>
      <replicate count="2" sep="-" offset="0 0.3 0" euler="0 0 0.5">
        <body name="foot" pos="0 0 -0.4" xyaxes="0 1 0 -1 0 0"><geom/>
          <joint type="slide" ref="-0.1" springdamper="0.5 1"/>
          <site name="toe" zaxis="1 0 1"/></body></replicate></body></frame></worldbody></mujoco>""",
    "fused": """<mujoco><compiler fusestatic="true" inertiafromgeom="true" autolimits="false" boundinertia="0.01"/>
  <worldbody><body name="arm" euler="10 20 30">
    <joint axis="1 1 0" pos="0.1 0 0" ref="20" springref="-10" stiffness="4"/>
    <inertial mass="9" pos="1 2 3" diaginertia="1 1 1"/><geom type="box" size="0.1 0.2 0.3" shellinertia="true"/>
    <body name="plate" pos="0.5 0 0" axisangle="1 0 0 40"><geom size="0.2"/><site name="tip" pos="0 0 1"/>
      <body name="tool" quat="1 0 1 0"><joint type="ball" damping="0.3" pos="0 0.1 0"/><geom size="0.1" pos="0 0 0.2"/>
  </body></body></body></worldbody></mujoco>""",
    "aligned": """<mujoco><compiler alignfree="true"/><worldbody>
    <body name="a" pos="0.3 0.2 1" euler="20 30 40"><freejoint/><site name="top" pos="0 0 0.3"/>
      <inertial pos="0.1 0 0" mass="1" fullinertia="0.02 0.03 0.04 0.005 0 0"/></body>
    <body name="b"><freejoint align="false"/>
      <inertial pos="0.1 0 0" mass="1" fullinertia="0.02 0.03 0.04 0.005 0 0"/></body>
  </worldbody></mujoco>""",
    "fixed tendons": """<mujoco><worldbody><body name="a"><joint name="x" ref="30"/><geom size="0.1" pos="0.1 0 0"/>
    <body name="b" pos="0 1 0"><joint name="y" type="slide" springref="0.4" axis="1 0 0"/><geom size="0.1"/>
  </body></body>  </worldbody><tendon>
    <fixed name="couplings.rest" stiffness="3" damping="0.4"><joint joint="x" coef="-2"/><joint joint="y" coef="0.7"/>
    </fixed><fixed name="cubic" springlength="0.3" stiffness="2 0 5"><joint joint="y" coef="1.5"/>
    <joint joint="x" coef="2"/></fixed>
  </tendon></mujoco>""",
}


@pytest.mark.parametrize("name", soaked(COMPILED, ("fixed tendons",)))
def test_what_the_compiler_makes_moves_as_there(name: str, built: Build, figures: Figures) -> None:
    worst, _ = deviations(COMPILED[name], built)
    for key, value in worst.items():
        figures.at_most(key, value, 1e-10)


@pytest.mark.parametrize("name", COMPILED)
def test_frames_are_where_the_compiler_puts_them(name: str) -> None:
    robot = robot_from_mjcf(COMPILED[name])
    oracle = MjcfOracle(COMPILED[name], robot)
    pairs = [(joint, key) for joint in robot.joints for key in joint.coordinates]
    offsets = np.array([joint.offset[COORDINATES.index(key)] or 0.0 for joint, key in pairs])
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (3, oracle.n)):
        poses = link_poses(robot, q + offsets)
        found = {to_identifier(key): pose for key, pose in oracle.poses(q).items()}
        assert {link.name for link in robot.links} & set(found)
        for key in set(poses) & set(found):
            assert np.abs(poses[key] - found[key]).max() < 1e-13


def test_what_the_compiler_joins_and_moves_is_named() -> None:
    assert "bodies that fusestatic has joined with their parents: 'plate'" in robot_from_mjcf(COMPILED["fused"]).notes
    (note,) = [note for note in robot_from_mjcf(COMPILED["aligned"]).notes if "aligns" in note]
    assert note.endswith("(align, alignfree): 'a'")
    couplings = robot_from_mjcf(COMPILED["fixed tendons"]).couplings
    assert [coupling.name for coupling in couplings] == ["rest", "cubic"]


def test_an_aligned_free_joint_is_followed_or_named() -> None:
    inertial = '<inertial pos="0.1 0 0" mass="1" fullinertia="0.02 0.03 0.04 0.005 0 0"/>'
    text = f'<mujoco><worldbody><body name="a"><freejoint align="true"/>{inertial}</body></worldbody></mujoco>'
    assert any("align" in note for note in robot_from_mjcf(text).notes)


@pytest.mark.parametrize("law", [None, Coordinate(stiffness=2.0, damping=0.01)], ids=["rigid", "elastic"])
def test_a_coupling_that_is_written_as_a_tendon_is_read_again(law: Coordinate | None) -> None:
    ratios = {"joint1.gamma": 0.4, "joint2.gamma": -0.7}
    coupling = Coupling("pull", "joint3.gamma", ratios, law=law)
    robot = replace(load_robot("ur5"), couplings=(coupling,), driven=None)
    (again,) = robot_from_mjcf(mjcf(robot, 1e-3, approximate=True)).couplings
    assert (sorted(again.to.values()), again.law is None) == ([-0.7, 0.4], law is None)
