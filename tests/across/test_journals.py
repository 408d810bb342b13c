"""Journals in bearings through all packages: what is read and refused, kept, simulated, drawn and exported."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.bench.textbook import unknown_to_textbook
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.export.mujoco import left_out, mjcf
from eomgen.pictures import plot_journals, plot_result, report_of
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.elements.journal import Radial, SlidingFriction
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import least_of, number_of
from eomgen.robot.record import record_of, robot_of
from eomgen.robot.value import Coordinate
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import load_result
from tests.support.builds import Build
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

ROOT = Path(__file__).parents[2]
SHAFT = """
name = "shaft"
gravity = [0.0, -9.81, 0.0]
tunable = ["joints.pin.radial.clearance"]
[[links]]
name = "disc"
mass = 2.0
inertia = { xx = 1e-3, yy = 1e-3, zz = 2e-3 }
[[joints]]
name = "pin"
parent = "base"
child = "disc"
type = "revolute"
x = {}
y = {}
radial = { clearance = 1e-4, stiffness = 1e7, restitution_damping = 0.5, friction = {coefficient = 0.1, radius = 0.01}}
"""
REFUSED = {
    "clearance = 1e-4, ": ("", ["joints.pin.radial", "'clearance'", "radial gap in m"]),
    "stiffness = 1e7": ("stiffness = 0.0", ["joints.pin.radial.stiffness", "0.0", "greater than 0"]),
    "clearance = 1e-4": ("clearance = -1e-4", ["joints.pin.radial.clearance", "-0.0001", "at least 0"]),
    "radial = { clearance = 1e-4": ("radial = { clearance = 0.0", ["radial.clearance", "0 and no smoothing"]),
    "x = {}": ("", ["joints.pin.radial", "x does not move", "x, y have tables"]),
    "\nx = {}": (
        "\nx = { stiffness = 1e5 }\ngamma = { friction = { coefficient = 0.1, radius = 0.01 } }",
        ["joints.pin.radial", "gamma has friction with a coefficient, too", "friction in radial"],
    ),
    "y = {}": (
        "y = { stiffness = 1e6, clearance = 1e-4 }",
        ["joints.pin.radial", "y has a clearance, too", "not both"],
    ),
    "stiffness = 1e7,": ("stiffness = 1e7, length = 0.02,", ["alpha does not move", "x, y, alpha, beta have tables"]),
    "coefficient = 0.1, ": ("", ["joints.pin.radial.friction", "'coefficient'"]),
    "friction = {coeff": ("friction = {mu = 0.1, coeff", ["joints.pin.radial.friction", "'mu'", "coefficient"]),
    'type = "revolute"': ('type = "fixed"', ["joints.pin.radial.friction.radius", "gamma does not move"]),
    "restitution_damping": ("restitution", ["joints.pin.radial", "mean 'restitution_damping'"]),
}


@pytest.mark.parametrize("old", REFUSED)
def test_what_does_not_go_together_is_refused(old: str) -> None:
    new, said = REFUSED[old]
    caught = refused(DescriptionError, "", robot_from_toml, SHAFT.replace(old, new), source="my.toml")
    assert all(word in str(caught) for word in said), caught
    assert str(caught).startswith("my.toml:")


def test_robots_of_python_are_looked_at_too() -> None:
    robot = robot_from_toml(SHAFT)
    joint = replace(robot.joints[0], coordinates={"gamma": Coordinate()})
    refused(DescriptionError, r"joints\.pin\.radial: x does not move", build_model, replace(robot, joints=(joint,)))


def test_cut_joints_have_them_where_they_move() -> None:
    """The message says what they need."""
    text = (ROOT / "examples" / "slider_crank.toml").read_text(encoding="utf-8")
    with pytest.raises(
        DescriptionError, match=r"loops\.crankpin\.radial: x does not move; allowed: where x, y have tables"
    ):
        robot_from_toml(text + "radial = { clearance = 1e-4, stiffness = 1e7 }\n")


def test_a_journal_is_read_and_kept() -> None:
    robot = robot_from_toml(SHAFT)
    radial = robot.joint("pin").radial
    assert radial == Radial(1e-4, 1e7, None, 0.5, None, SlidingFriction(0.1, 0.01))
    assert radial.smoothing == pytest.approx(5e-6)
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    held = robot.rigid()
    assert (list(held.joints[0].coordinates), held.joints[0].radial, held.tunable) == (["gamma"], None, ())
    bare = replace(robot, joints=tuple(replace(joint, radial=None) for joint in robot.joints))
    assert "radial" not in record_of(bare)["joints"][0]


def test_a_rigid_robot_keeps_a_journal_that_still_turns_alone() -> None:
    """Its friction asks for gamma, which a rigid prismatic joint does not have."""
    moved = SHAFT.replace('"revolute"', '"prismatic"').replace("x = {}\ny = {}\n", "x = {}\ny = {}\ngamma = {}\n")
    robot = robot_from_toml(moved + 'prescribed = ["x", "y"]\n')
    held = robot.rigid()
    assert list(build_model(held).coordinates) == ["pin.x", "pin.y", "pin.z"]
    assert (robot.joints[0].radial is None, held.joints[0].radial) == (False, None)


def test_numbers_have_texts_units_and_ranges() -> None:
    robot = robot_from_toml(SHAFT)
    page = (ROOT / "docs" / "description.md").read_text(encoding="utf-8")
    for key, number in Radial.NUMBERS.items():
        name = f"joints.pin.radial.{key}"
        assert number.about
        assert f"`{key.rpartition('.')[2]}`" in page or f"{key.rpartition('.')[2]} " in page
        assert number_of(name) is number
        assert least_of(name) == number.least
        assert parameter_unit(robot, name) in UNITS
    assert parameter_unit(robot, "joints.pin.radial.stiffness") == "N/m"
    assert parameter_unit(robot, "joints.pin.radial.restitution_damping") == "s/m"


def test_other_tools_refuse_it_by_name() -> None:
    robot = robot_from_toml(SHAFT)
    assert left_out(robot) == ["joints.pin.radial: left out"]
    refused(InputError, r"MuJoCo has no equal for joints\.pin\.radial", mjcf, robot, 1e-3)
    assert "no journals in bearings (pin)" in unknown_to_textbook(build_model(robot))


def test_info_names_it() -> None:
    info = RobotInfo(build_model(robot_from_toml(SHAFT)), {}, (), {}, {})
    assert info.as_dict()["journals"]["pin.radial"]["friction.radius"] == 0.01
    assert any(line.startswith("pin.radial: clearance 0.0001, stiffness 1e+07") for line in info.lines())


@pytest.mark.soak
def test_a_simulation_reports_and_draws_it(tmp_path: Path) -> None:
    """It starts in the middle, falls, and touches below; the file, the figures and the page know."""
    scenario = scenario_from_toml(
        "duration = 0.012\noutput_step = 1e-4\n[initial]\nequilibrium = true\nheld = ['pin']\n"
    )
    result = eomgen.run_scenario(robot_from_toml(SHAFT), scenario)
    assert any("pin.x" in note for note in result.notes)
    assert np.all(result.trajectory.q[0] == 0.0)
    first = result.trajectory.contacts[0]
    assert (first.coordinate, first.side, first.closes) == ("pin.radial", 0, True)
    assert first.angle == pytest.approx(-np.pi / 2)
    assert first.t == pytest.approx(np.sqrt(2 * 1e-4 / 9.81), rel=1e-3)
    assert any("clearance of pin.radial: closed 1 times" in line for line in result.summary_lines())
    again = load_result(result.save(tmp_path / "motion.npz"))
    assert again.trajectory.contacts == result.trajectory.contacts
    assert "journals.svg" in {path.name for path in plot_result(again, tmp_path, ".svg")}
    assert ">pin.radial<" in plot_journals(again, tmp_path / "journals.svg").read_text(encoding="utf-8")
    page = report_of(again, modes=False).html()
    assert "pin.radial" in page
    with pytest.raises(InputError, match="has no journals"):
        plot_journals(replace(again, description={}, robot_hash=""), tmp_path / "none.svg")


def test_a_slider_crank_with_a_worn_pin(built: Build) -> None:
    """The pin flies, bounces, follows the wall; loops stay closed, and the slider is off by no more than the play."""
    kernel = built(eomgen.load_robot(ROOT / "examples" / "slider_crank.toml"))
    q, speed = kernel.assemble(np.array([0.0, 0.17, 0.0, 0.0, np.pi])), 5000.0 * 2 * np.pi / 60
    v = kernel.project_velocity(q, np.array([speed, 0, 0, 0, 0.0]), fixed=("motor.gamma", "pin.x", "pin.y"))
    qs, vs = kernel.rollout(q, v, np.zeros(5), 1e-6, 12000, every=10)
    assert np.abs(kernel.functions.constraint(qs)).max() < 1e-11
    assert qs[:, 0] == pytest.approx(speed * 1e-5 * np.arange(1201))
    straight = 0.05 * np.cos(qs[:, 0]) + np.sqrt(0.12**2 - (0.05 * np.sin(qs[:, 0])) ** 2)
    distance, ideal = np.hypot(qs[:, 2], qs[:, 3]), 0.05 * speed**2 * (1 + 0.05 / 0.12)
    assert 5e-4 < distance.max() < 6.5e-4
    assert np.abs(qs[:, 1] - straight).max() < 7e-4
    slider = kernel.forward_dynamics(qs, vs, np.zeros(5))[:, 1]
    assert np.abs(slider).max() > 3.0 * ideal
    assert np.all(np.abs(slider[distance < 5e-4]) < 1e-9 * ideal)
    assert 0.05 < np.mean(distance < 5e-4) < 0.9
