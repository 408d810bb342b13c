"""Motors in descriptions: what is read, and what is refused."""

from __future__ import annotations

import pickle
from dataclasses import replace

import pytest

from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Friction, Motor
from tests.support.description_samples import ARM
from tests.support.pendulums import MOTOR, described
from tests.support.refusals import refused

pytestmark = pytest.mark.quick


def test_a_description() -> None:
    robot = described(
        "motor = { inertia = 1e-4, ratio = -100, stiffness = 2e4, cubic = 3.0, clearance = 1e-3, damping = 10,"
        " friction = { coulomb = 0.1, viscous = 0.2 } }",
        more='x = { stiffness = 1e5 }\nprescribed = ["motor"]',
        tunable='["joints.joint1.motor.ratio"]',
    )
    motor = robot.joints[0].motor
    spring = Coordinate(2e4, 10.0, cubic=3.0, clearance=1e-3)
    assert motor == Motor(1e-4, -100.0, spring, Friction(0.1, viscous=0.2), True)
    assert list(robot.joints[0].coordinates) == ["x", "gamma"]
    model = build_model(robot)
    assert model.coordinates == ("joint1.x", "joint1.gamma", "joint1.motor")
    values = {
        "ratio": -100.0,
        "stiffness": 2e4,
        "damping": 10.0,
        "cubic": 3.0,
        "clearance": 1e-3,
        "smoothing": 5e-5,
        "friction.coulomb": 0.1,
        "friction.viscous": 0.2,
        "friction.smoothing": 4e-8,
    }
    own = {name[20:]: value for name, value in model.parameters.items() if name.startswith("joints.joint1.motor.")}
    assert own == values
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert described(MOTOR[:-2] + ', role = "prescribed" }').joints[0].motor.prescribed  # type: ignore[union-attr]
    rigid = robot.rigid()
    assert rigid.tunable == ()
    assert rigid.joints[0].coordinates["gamma"] == Coordinate(armature=1.0, prescribed=True)


@pytest.mark.parametrize(
    ("motor", "more", "message"),
    [
        (MOTOR.replace("1e-4", "0"), "", r"motor\.inertia: got 0; allowed: .*greater than 0"),
        (MOTOR.replace("1e-4", "-1e-4"), "", r"motor\.inertia: got -0\.0001; allowed"),
        (MOTOR.replace("100", "0"), "", r"motor\.ratio: got 0\.0; allowed: .*not 0"),
        (MOTOR.replace("100", "inf"), "", r"motor\.ratio: got inf; allowed"),
        (MOTOR.replace("ratio = 100,", ""), "", r"motor: the key 'ratio' is missing"),
        (MOTOR.replace("inertia = 1e-4,", ""), "", r"motor: the key 'inertia' is missing"),
        (
            MOTOR.replace(", stiffness = 2e4", ""),
            "",
            r"motor\.stiffness: there is no spring .*one of stiffness, .*curve",
        ),
        (MOTOR.replace(" }", ", armature = 1.0 }"), "", r"motor: unknown key 'armature'"),
        (MOTOR.replace(" }", ", backlash = 1.0 }"), "", r"motor: unknown key 'backlash'"),
        (MOTOR.replace(" }", ', role = "locked" }'), "", r"motor\.role: .*leave its table out"),
        (
            MOTOR.replace(" }", ", restitution_damping = 1.0 }"),
            "",
            r"motor\.restitution_damping: there is no clearance",
        ),
        (MOTOR.replace(" }", ", curve = [[0, 0], [1, 1]] }"), "", r"motor\.curve: stiffness is set, too"),
        (MOTOR.replace(" }", ", friction = { static = 1.0 } }"), "", r"motor\.friction: the key 'coulomb' is missing"),
        (MOTOR.replace(" }", ", friction = { coulomb = 1, static = 2 } }"), "", r"motor\.friction: .*belong together"),
        ("motor = 3", "", r"motor: got 3; allowed: a table"),
        (MOTOR, 'gamma = { role = "locked" }', r"motor: gamma is locked"),
        (
            MOTOR.replace(" }", ', role = "free" }'),
            'prescribed = ["motor"]',
            r"prescribed: motor is prescribed here and free",
        ),
        ("", 'prescribed = ["motor"]', r"prescribed: got 'motor'"),
    ],
)
def test_what_is_refused(motor: str, more: str, message: str) -> None:
    refused(DescriptionError, r"joints\.joint1\." + message, described, motor, more=more)


@pytest.mark.parametrize("kind", ["fixed", "free"])
def test_joints_without_a_principal_coordinate(kind: str) -> None:
    with pytest.raises(DescriptionError, match=rf"joints\.joint1\.motor: a {kind} joint has no principal coordinate"):
        described(MOTOR, kind, "x = {}" if kind == "fixed" else "")


def test_a_robot_that_no_reader_has_seen() -> None:
    robot = described(MOTOR)
    for wrong, message in (
        (Motor(-1.0, 2.0, Coordinate(1.0)), "inertia: got -1.0"),
        (Motor(1.0, float("nan"), Coordinate(1.0)), "ratio: got nan"),
        (Motor(1.0, 2.0, Coordinate()), "no spring"),
        (Motor(1.0, 2.0, Coordinate(1.0, prescribed=True)), "role belong"),
    ):
        refused(DescriptionError, message, build_model, replace(robot, joints=(replace(robot.joints[0], motor=wrong),)))


def test_descriptions_without_motors_read_as_before() -> None:
    assert all(joint.motor is None for joint in robot_from_toml(ARM).joints)
