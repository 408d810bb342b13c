"""Identification of robots with servo drives: currents give the forces on their coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import InputError
from eomgen.identification import base_parameters, compensate, identify
from eomgen.motion import motion_from_columns, read_motion, write_motion
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")]

EXAMPLE = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
SCENARIO = """
duration = 2.0
output_step = 2e-3
[motion]
type = "via"
points = [{ axis = 0.8 }, { axis = -0.7 }, { axis = 0.5 }]
times = [0.5, 1.1, 1.6]
"""
TERMS = ("links", "rotors", "viscous")


@pytest.fixture(scope="module")
def simulated() -> SimulationResult:
    return run_scenario(load_robot(EXAMPLE), scenario_from_toml(SCENARIO))


def test_currents_of_simulations_and_files_give_the_forces(simulated: SimulationResult, tmp_path: Path) -> None:
    robot = load_robot(EXAMPLE)
    motion = simulated.motion
    assert motion.states["axis.gamma.drive.current"].shape == motion.t.shape
    found = identify(robot, motion, terms=TERMS)
    assert found.base_values == pytest.approx(found.described, rel=5e-3, abs=2e-3)
    again = identify(robot, simulated.save(tmp_path / "r.npz"), terms=TERMS)
    assert again.base_values == pytest.approx(found.base_values, rel=1e-12)
    written = read_motion(write_motion(tmp_path / "m.csv", motion), motion.coordinates)
    assert set(written.states) == set(motion.states)
    assert identify(robot, written, terms=TERMS).base_values == pytest.approx(found.base_values, rel=1e-9)
    torque = motion_from_columns(
        {"t": motion.t, "axis.gamma": motion.q[:, 0], "axis.gamma.rate": motion.v[:, 0],  # type: ignore[index]
         "axis.gamma.drive": 6.0 * motion.states["axis.gamma.drive.current"]},
        motion.coordinates,
    )  # fmt: skip
    assert identify(robot, torque, terms=TERMS).base_values == pytest.approx(found.base_values, rel=1e-9)
    assert found.robot.joints[0].coordinates["gamma"].further == robot.joints[0].coordinates["gamma"].further
    assert base_parameters(robot, terms=TERMS).names == found.base.names


def test_an_input_that_says_nothing_of_the_force_is_refused(simulated: SimulationResult) -> None:
    text = EXAMPLE.read_text(encoding="ascii")
    begin, end = text.index("winding ="), text.index("[joints.gamma.drive.controller]")
    text = text[:begin] + text[end : text.index("velocity =")] + "\n"
    direct = robot_from_toml(text)
    motion = simulated.motion
    columns = {"t": motion.t, "axis.gamma": motion.q[:, 0], "axis.gamma.drive": motion.u[:, 0]}
    bare = motion_from_columns(columns | {"axis.gamma.drive.input": 0.0 * motion.t}, motion.coordinates)
    said = r"axis\.gamma\.drive is a reference of position, rad; allowed: N m on the coordinate, or a column"
    with pytest.raises(InputError, match=said):
        identify(direct, bare, terms=TERMS)
    found = identify(direct, motion_from_columns(columns, motion.coordinates), terms=TERMS)
    assert np.isfinite(found.base_values).all()
    with pytest.raises(InputError, match=r"column 'axis\.gamma\.current' is unknown"):
        motion_from_columns(columns | {"axis.gamma.current": motion.t}, motion.coordinates)


def test_static_compensation_is_refused_by_name() -> None:
    """Where a drive's input is a reference, no force can be added to it."""
    with pytest.raises(InputError, match=r"mode: 'static': 'axis\.gamma' of servo_axis have servo drives"):
        compensate(load_robot(EXAMPLE), mode="static")
