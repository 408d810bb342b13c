"""Equality constraints of MJCF against MuJoCo's own residuals."""

from __future__ import annotations

import numpy as np
import pytest

from eomgen.description.load import robot_from_mjcf
from eomgen.errors import DescriptionError
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.optional import OptionalModule

mujoco = OptionalModule("mujoco")

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

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
    "equality",
    [
        '<joint joint1="turn" joint2="slide" polycoef="0.5 2 0 0 0"/>',
        '<joint joint1="slide" joint2="turn"/>',
        '<joint joint1="turn" polycoef="0.1 3"/>',
    ],
)
def test_joints_are_coupled_as_in_mujoco(equality: str) -> None:
    (coupling,) = read(equality).couplings
    for q in STATES:
        x = {f"{NAMES[name]}": value for name, value in q.items()}
        value = x[coupling.of] - sum(r * x[name] for name, r in coupling.to.items()) - (coupling.offset or 0.0)
        assert value == pytest.approx(residual(equality, q)[0], abs=1e-12)


@pytest.mark.parametrize(
    ("equality", "kind"),
    [
        ('<connect body1="b" body2="c" anchor="0.1 0.2 0.3"/>', "spherical"),
        ('<connect body1="b" anchor="0.1 0.2 0.3"/>', "spherical"),
        ('<connect site1="tip" site2="ground"/>', "spherical"),
        ('<weld body1="b" body2="c"/>', "fixed"),
        ('<weld body1="c" body2="a" relpose="0.1 0.2 0.3 0.7 0.1 0.2 -0.3"/>', "fixed"),
        ('<weld body1="a"/>', "fixed"),
        ('<weld site1="tip" site2="ground"/>', "fixed"),
    ],
)
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


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        (
            '<joint joint1="turn" joint2="slide" polycoef="0 1 2"/>',
            r"polycoef is '0 1 2'; allowed: a constant and a lin",
        ),
        ('<joint joint1="trn"/>', r"joint1 is 'trn', and there is no hinge or slide of that name; did you mean 'turn'"),
        ('<joint joint1="ball"/>', r"joint1 is 'ball', and there is no hinge or slide of that name"),
        ("<joint/>", r"joint1 is ''"),
        ('<joint joint1="turn" joint2="turn"/>', r"couplings\.joint\.to: 'turn\.gamma' is coupled to itself"),
        (
            '<connect body1="d" anchor="0 0 0"/>',
            r"body1 is 'd', and there is no such body.*\(allowed: 'world', 'a', 'b'",
        ),
        ('<connect body1="a"/>', r"there is no anchor; allowed: an anchor in body1, or two sites"),
        ('<connect site1="tip"/>', r"site2 is '', and there is no such site.*\(allowed: 'ground', 'tip'\)"),
        ('<weld body1="a" body2="a"/>', r"both ends are on 'a'; allowed: two different bodies"),
        ('<weld body1="a" relpose="1 2"/>', r"relpose is '1 2'; allowed: 7 numbers"),
        ('<weld body1="a" tendon1="b"/>', r"unknown attribute 'tendon1'"),
        (
            '<flex flex="f"/>',
            r"<flex> constrains the motion softly, which has no equal here; allowed: joint, connect, w",
        ),
        ('<weld name="w" body1="a"/><weld name="w" body1="b"/>', r"there are two of this name; allowed: unique names"),
    ],
)
def test_bad_equalities(equality: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=r"m\.xml:19:\d+: .*" + message):
        read(equality)


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
    with pytest.raises(DescriptionError, match="'torso' and 'world' do not move against each other") as caught:
        robot_from_mjcf(text)
    assert caught.value.line == 8
