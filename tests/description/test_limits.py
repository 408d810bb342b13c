"""Limits of coordinates: what TOML, URDF and MJCF say of them is kept, and written back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomgen.description.load import load_robot, robot_from_mjcf, robot_from_toml, robot_from_urdf
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError
from eomgen.export.mujoco import mjcf
from eomgen.robot.bounds import Limits
from eomgen.robot.mechanism import effort_of
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash
from eomgen.robot.value import Coordinate, Joint, Robot
from tests.support.description_samples import ARM, MJCF, URDF
from tests.support.optional import OptionalModule
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

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
    """The largest force of the actuators on each joint, in MuJoCo, whatever their controls; read here or by MuJoCo."""
    text = ACTUATED.format(geom=geom)
    path = tmp_path / "model.xml"
    path.write_text(text)
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
