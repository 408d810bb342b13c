"""Reading of stiffness and damping matrices of joints, what is refused, and what becomes of them in other rooms."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.pictures import report_of
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot import JointDamping, JointStiffness, record_of, robot_hash, robot_of
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import least_of, number_of
from eomgen.scenario.load import scenario_from_toml
from tests.support.small_robots import free_body

pytestmark = pytest.mark.quick

TEXT = """
name = "mount"
[[links]]
name = "body"
mass = 1.0
inertia = { xx = 0.01, yy = 0.02, zz = 0.03 }
[[joints]]
name = "root"
parent = "base"
child = "body"
type = "revolute"
x = {}
beta = { stiffness = 3.0 }
stiffness = { matrix = [[900.0, 20.0, 0.0], [20.0, 5.0, 1.0], [0.0, 1.0, 4.0]], preload = [1.0, 0.0, -0.5] }
damping = { loss_factor = 0.02, at_hz = 40.0 }
"""
SIX = """{ matrix = [[900.0, 10.0, 0.0, 0.0, 20.0, 0.0], [10.0, 50.0, 0.0, 0.0, 0.0, 0.0], \
[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [20.0, 0.0, 0.0, 0.0, 5.0, 1.0], \
[0.0, 0.0, 0.0, 0.0, 1.0, 4.0]]"""
MATRIX = "[[900.0, 20.0, 0.0], [20.0, 5.0, 1.0], [0.0, 1.0, 4.0]]"
REFUSED = {
    "asymmetric": (
        "[[900.0, 20.0",
        "[[900.0, 21.0",
        ["stiffness.matrix", "x.beta", "21.0", "beta.x is 20.0", "symmetric"],
    ),
    "negative": ("1.0, 4.0]]", "1.0, -4.0]]", ["stiffness.matrix", "gamma.gamma", "-4.0", "at least 0"]),
    "units": (
        MATRIX,
        "[[900.0, 2e3, 0.0], [2e3, 5.0, 1.0], [0.0, 1.0, 4.0]]",
        ["x.beta", "2000.0", "67.082", "x.x and beta.beta", "units?"],
    ),
    "two angles": (
        MATRIX,
        "[[900.0, 20.0, 0.0], [20.0, 5.0, 7.0], [0.0, 7.0, 4.0]]",
        ["beta.gamma", "7.0", "up to 4.47214", "root of the product of beta.beta and gamma.gamma"],
    ),
    "indefinite": (
        MATRIX,
        "[[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]",
        ["stiffness.matrix", "x, beta, gamma together", "eigenvalue -0.8", "positive semidefinite"],
    ),
    "rows": (
        MATRIX,
        "[[1.0, 0.0], [0.0, 1.0]]",
        ["stiffness.matrix", "2 rows", "3, for x, beta, gamma, or six, for x, y"],
    ),
    "ragged": (MATRIX, "[[1.0, 0.0], [0.0]]", ["stiffness.matrix.1", "[0.0]", "2 numbers"]),
    "no rows": (MATRIX, "[]", ["stiffness.matrix", "one to six"]),
    "a number": (MATRIX, "7.0", ["stiffness.matrix", "7.0", "one to six"]),
    "nan": ("[[900.0", "[[nan", ["stiffness.matrix", "nan"]),
    "zero": (
        MATRIX + ", preload = [1.0, 0.0, -0.5]",
        "[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]",
        ["no number"],
    ),
    "no matrix": (f"matrix = {MATRIX}, ", "", ["joints.root.stiffness", "'matrix'", "missing", "six rows"]),
    "six numbers": (MATRIX, "[900.0, 20.0, 1.0, 1.0, 1.0, 1.0]", ["stiffness.matrix", "rows"]),
    "preload": ("[1.0, 0.0, -0.5]", "[1.0]", ["stiffness.preload", "[1.0]", "3 numbers"]),
    "place": ("preload = [1.0, 0.0, -0.5]", "at = { xyz = [0.1, 0.0, 0.0] }", ["stiffness.at", "3 rows", "six rows"]),
    "unknown": ("preload", "preloads", ["'preloads'", "mean 'preload'", "matrix, at"]),
    "no frequency": (", at_hz = 40.0", "", ["joints.root.damping", "at_hz", "missing"]),
    "no share": ("loss_factor = 0.02, ", "", ["joints.root.damping", "ratio or loss_factor", "missing"]),
    "two forms": (
        "loss_factor = 0.02",
        "ratio = 0.1, loss_factor = 0.02",
        ["joints.root.damping", "ratio and loss_factor"],
    ),
    "two other forms": (
        "loss_factor = 0.02, at_hz = 40.0",
        f"linear = 1.0, matrix = {MATRIX}",
        ["linear or angular and matrix"],
    ),
    "no stiffness": (
        f"stiffness = {{ matrix = {MATRIX}, preload = [1.0, 0.0, -0.5] }}",
        "",
        ["joints.root.damping", "stiffness"],
    ),
    "frequency": ("40.0", "0.0", ["joints.root.damping.at_hz", "0.0", "1e-12"]),
    "place of no matrix": (
        "loss_factor = 0.02, at_hz = 40.0",
        "linear = 1.0, at = {}",
        ["joints.root.damping.at", "no matrix"],
    ),
    "a table of numbers": ("matrix = [[", "x = [[", ["joints.root.stiffness", "'x'", "matrix"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_wrong_is_refused(case: str) -> None:
    old, new, said = REFUSED[case]
    assert old in TEXT
    with pytest.raises(DescriptionError) as caught:
        robot_from_toml(TEXT.replace(old, new), source="my.toml")
    assert all(word in str(caught.value) for word in ["my.toml", *said]), caught.value


def test_rows_of_what_does_not_move_are_left_out_and_named() -> None:
    robot = robot_from_toml(
        TEXT.replace(f"{{ matrix = {MATRIX}", SIX).replace("1.0, 0.0, -0.5]", "1.0, 2.0, 0.0, 0.0, 0.0, -0.5]")
    )
    assert robot.notes == ("joints.root.stiffness: rows of coordinates that do not move are left out: y",)
    assert robot.joints == robot_from_toml(TEXT).joints
    alone = SIX.replace("900.0, 10.0", "0.0, 0.0").replace("10.0, 50.0", "0.0, 50.0").replace("20.0", "0.0")
    with pytest.raises(DescriptionError, match="rows of y alone"):
        robot_from_toml(
            TEXT.replace(
                f"{{ matrix = {MATRIX}", alone.replace("5.0, 1.0", "0.0, 0.0").replace("1.0, 4.0", "0.0, 0.0")
            ).replace(", preload = [1.0, 0.0, -0.5]", "")
        )


def test_they_are_read_kept_and_named() -> None:
    robot = robot_from_toml(TEXT)
    (joint,) = robot.joints
    assert joint.stiffness == JointStiffness.of(
        [[900.0, 20.0, 0.0], [20.0, 5.0, 1.0], [0.0, 1.0, 4.0]], ("x", "beta", "gamma"), preload=(1.0, 0.0, -0.5)
    )
    assert joint.damping == JointDamping(loss_factor=0.02, at_hz=40.0)
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    without = replace(robot, joints=(replace(joint, stiffness=None, damping=None),))
    assert "stiffness" not in record_of(without)["joints"][0]
    assert robot_hash(robot) != robot_hash(without)
    left = robot.rigid().joints[0]
    assert left.stiffness == JointStiffness({"gamma.gamma": 4.0}, {"gamma": -0.5})
    assert left.damping == joint.damping
    free = replace(joint, stiffness=JointStiffness({"x.x": 1.0}))
    assert replace(robot, joints=(free,)).rigid().joints[0].damping is None
    for key, number in JointStiffness.NUMBERS.items():
        name = f"joints.root.stiffness.{key}"
        assert number_of(name) is number
        assert least_of(name) == (0.0 if len(set(key.split("."))) == 1 else None)
        assert parameter_unit(robot, name) in UNITS
    assert parameter_unit(robot, "joints.root.stiffness.x.beta") == "N/rad"
    assert parameter_unit(robot, "joints.root.damping.x.beta") == "N.s/rad"
    for element, message in (
        (JointStiffness({"y.y": 1.0}), "y does not move"),
        (JointStiffness({"beta.x": 1.0}), "no such entry"),
        (JointStiffness({"x.x": 1.0, "x.beta": 1.0}), "units"),
        (JointStiffness({"x.x": 1.0}, {"x": np.inf}), "preload"),
        (JointStiffness({}, {}), "no number"),
        (JointDamping(entries={"x.x": 1.0, "gamma.gamma": 1.0, "x.gamma": 2.0}), "x.gamma"),
        (JointDamping(entries={"q.x": 1.0}), "no such entry"),
        (JointDamping(entries={"z.z": 1.0}), "z does not move"),
    ):
        wrong = replace(robot, joints=(replace(joint, **{element.TABLE: element}),))
        with pytest.raises(DescriptionError, match=message):
            build_model(wrong)
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    assert info.as_dict()["joint_stiffness"]["root"]["x.beta"] == 20.0
    assert "root.stiffness: preload.x 1, preload.gamma -0.5" in info.lines()
    assert "  no centre of stiffness: no stiffness of y, z, alpha" in info.lines()
    assert any(line.split() == ["beta", "20", "5", "1"] for line in info.lines())
    assert "root" in unknown_to_textbook(build_model(robot))
    assert "none between them" in unknown_to_textbook(build_model(robot))


def test_a_joint_with_a_matrix_keeps_its_angles() -> None:
    """Charts switch where nothing refers to an angle: a matrix does, isotropic damping does not."""
    free = free_body()

    def turning(**elements: object) -> tuple[int, ...]:
        return build_model(replace(free, joints=(replace(free.joints[0], **elements),))).turning

    assert turning(damping=JointDamping(1.0, 2.0)) == (0,)
    assert turning(stiffness=JointStiffness({"x.x": 1.0})) == ()
    assert turning(damping=JointDamping(entries={"x.x": 1.0})) == ()


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_a_simulation_balances_its_energy() -> None:
    scenario = scenario_from_toml(
        "duration = 0.5\n[integrator]\nrtol = 1e-8\n[initial.v]\n'root.beta' = 2.0\n'root.x' = 1.0\n"
    )
    robot = robot_from_toml(TEXT.replace("0.02, at_hz", "0.5, at_hz"))
    result = eomgen.run_scenario(robot, scenario)
    assert result.balance.relative_residue < 1e-6
    assert result.balance.of("dissipated")[-1] > 0.01
    page = report_of(result, modes=False).html()
    assert "root.stiffness" in page
    assert "root.damping" in page
