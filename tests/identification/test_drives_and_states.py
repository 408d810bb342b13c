"""Identification of robots with servo drives and force laws with internal states, and of simulated motions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import InputError
from eomgen.identification import base_parameters, compensate, fit, forces, identify
from eomgen.identification.exciting.solve import moving_robot
from eomgen.motion import motion_from_columns, read_motion, write_motion
from eomgen.motion.files import MeasuredMotion
from eomgen.robot.model import build_model
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.measurements import motion_of
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

IDLE = "drives that are 0 and drive nothing, left out: joint1.x"


@pytest.fixture(scope="module")
def simulated() -> eomgen.SimulationResult:
    return eomgen.simulate("one_link", duration=0.5)


@pytest.mark.parametrize("ending", [".npz", ".csv", ""])
def test_drives_that_drive_nothing_are_left_out(
    ending: str, simulated: eomgen.SimulationResult, tmp_path: Path
) -> None:
    motion = simulated.save(tmp_path / f"r{ending}") if ending else simulated.motion
    found = identify("one_link", motion, terms=("links",))
    assert found.notes.count(IDLE) == (ending == ".npz")  # other ways do not have them in the first place
    assert found.base_values == pytest.approx(found.described, rel=2e-3, abs=1e-4)
    drives = forces("one_link", motion).drive
    assert np.abs(drives - simulated.trajectory.u).max() < 0.02 * np.abs(simulated.trajectory.u).max()
    fitted = fit("one_link", motion)["joint1.x"]
    assert fitted.stiffness.value == pytest.approx(fitted.stiffness.described, rel=0.01)


def test_a_fit_says_that_there_are_no_drives(simulated: eomgen.SimulationResult, tmp_path: Path) -> None:
    path = simulated.save(tmp_path / "r.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], *(line.rpartition(",")[0] for line in lines[1:])]) + "\n")
    assert read_motion(path, simulated.trajectory.coordinates).driven == ()
    found = fit("one_link", path)
    such = "no columns such as joint1.gamma.drive; forces that drive joint1.gamma are unknown"
    assert found.warnings[0] == f"the motion has no drives: {such}"
    assert "has no drives" not in "".join(fit("one_link", simulated.motion).warnings)


# Servo drives


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
def servo_result() -> SimulationResult:
    return run_scenario(load_robot(EXAMPLE), scenario_from_toml(SCENARIO))


def test_currents_of_simulations_and_files_give_the_forces(servo_result: SimulationResult, tmp_path: Path) -> None:
    robot = load_robot(EXAMPLE)
    motion = servo_result.motion
    assert motion.states["axis.gamma.drive.current"].shape == motion.t.shape
    found = identify(robot, motion, terms=TERMS)
    assert found.base_values == pytest.approx(found.described, rel=5e-3, abs=2e-3)
    again = identify(robot, servo_result.save(tmp_path / "r.npz"), terms=TERMS)
    assert again.base_values == pytest.approx(found.base_values, rel=1e-12)
    written = read_motion(write_motion(tmp_path / "m.csv", motion), motion.coordinates)
    assert set(written.states) == set(motion.states)
    assert identify(robot, written, terms=TERMS).base_values == pytest.approx(found.base_values, rel=1e-9)
    torque = motion_of(
        motion.coordinates, motion.t, motion.q, motion.v, u=6.0 * motion.states["axis.gamma.drive.current"][:, None]
    )
    assert identify(robot, torque, terms=TERMS).base_values == pytest.approx(found.base_values, rel=1e-9)
    assert found.robot.joints[0].coordinates["gamma"].further == robot.joints[0].coordinates["gamma"].further
    assert base_parameters(robot, terms=TERMS).names == found.base.names


def test_an_input_that_says_nothing_of_the_force_is_refused(servo_result: SimulationResult) -> None:
    text = EXAMPLE.read_text(encoding="ascii")
    begin, end = text.index("winding ="), text.index("[joints.gamma.drive.controller]")
    text = text[:begin] + text[end : text.index("velocity =")] + "\n"
    direct = robot_from_toml(text)
    motion = servo_result.motion
    columns = {"t": motion.t, "axis.gamma": motion.q[:, 0], "axis.gamma.drive": motion.u[:, 0]}
    bare = motion_from_columns(columns | {"axis.gamma.drive.input": 0.0 * motion.t}, motion.coordinates)
    said = r"axis\.gamma\.drive is a reference of position, rad; allowed: N m on the coordinate, or a column"
    refused(InputError, said, identify, direct, bare, terms=TERMS)
    found = identify(direct, motion_from_columns(columns, motion.coordinates), terms=TERMS)
    assert np.isfinite(found.base_values).all()
    with pytest.raises(InputError, match=r"column 'axis\.gamma\.current' is unknown"):
        motion_from_columns(columns | {"axis.gamma.current": motion.t}, motion.coordinates)


def test_static_compensation_is_refused_by_name() -> None:
    """Where a drive's input is a reference, no force can be added to it."""
    with pytest.raises(InputError, match=r"mode: 'static': 'axis\.gamma' of servo_axis have servo drives"):
        compensate(load_robot(EXAMPLE), mode="static")


# Laws with internal states


COULOMB, STIFFNESS, VISCOUS = 1.2, 2e4, 0.3
FRICTION = f'model = "lugre", coulomb = {COULOMB}, bristle_stiffness = {STIFFNESS}, viscous = {VISCOUS}'
TEXT = f"""
name = "arm"
gravity = [0.0, -9.81, 0.0]
{link_table("rod", 4.0, (0.2, 0.01, 0.0), (0.1, 0.12, 0.13))}
{joint_table("j1", "base", "rod", "revolute")}
gamma = {{ friction = {{ {FRICTION} }} }}
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> eomgen.Robot:
    path = tmp_path_factory.mktemp("states") / "arm.toml"
    path.write_text(TEXT, encoding="utf-8")
    return load_robot(path)


@pytest.fixture(scope="module")
def motion(built: Build, robot: eomgen.Robot) -> MeasuredMotion:
    """Two sines, with the bristles' deflection along the path in closed form, and the drive that they take."""
    kernel = built(robot, "inverse_dynamics")
    t = np.linspace(0.0, 8.0, 4001)
    rates, sizes = 2.0 * np.pi * np.array([[0.4], [1.1]]), np.array([[0.8], [0.2]])
    phase = rates * t
    q, v, a = (
        x.sum(axis=0) for x in (sizes * np.sin(phase), sizes * rates * np.cos(phase), -sizes * rates**2 * np.sin(phase))
    )
    z, most = np.zeros_like(q), COULOMB / STIFFNESS
    for k, step in enumerate(np.diff(q)):
        end = np.copysign(most, step)
        z[k + 1] = end + (z[k] - end) * np.exp(-abs(step) / most)
    u = kernel.inverse_dynamics(q[:, None], v[:, None], a[:, None], z=z[:, None])[:, 0]
    columns = {"t": t, "j1.gamma": q, "j1.gamma.rate": v, "j1.gamma.acceleration": a, "j1.gamma.drive": u}
    return motion_from_columns(columns, kernel.coordinates)


def test_identify_finds_friction_as_it_slides_and_keeps_bristles(
    robot: eomgen.Robot, motion: MeasuredMotion, tmp_path: Path
) -> None:
    found = identify(robot, motion)
    assert found.parameters["j1.gamma.dry"] == pytest.approx(COULOMB, rel=1e-3)
    assert found.parameters["j1.gamma.viscous"] == pytest.approx(VISCOUS, rel=1e-2)
    friction = found.robot.joint("j1").coordinates["gamma"].friction
    assert friction.coulomb == found.parameters["j1.gamma.dry"]
    assert friction.bristle_stiffness == STIFFNESS
    assert build_model(found.robot).internal_states == ("j1.gamma.friction.z",)
    written = load_robot(found.to_toml(tmp_path / "found.toml"))
    assert written.joint("j1").coordinates["gamma"].friction == friction


def test_curves_of_stribeck_are_those_that_bristles_slide_by(robot: eomgen.Robot, motion: MeasuredMotion) -> None:
    terms = ("links", "viscous", "dry", "stribeck")
    with pytest.raises(InputError, match="shape: 'lorentzian'; allowed: gaussian, of friction with bristles"):
        identify(robot, motion, terms=terms, shape="lorentzian")
    found = identify(robot, motion, terms=terms)
    friction = found.robot.joint("j1").coordinates["gamma"].friction
    assert friction.bristle_stiffness == STIFFNESS
    assert friction.shape in (None, "gaussian")


def test_states_that_nobody_measured_are_refused(robot: eomgen.Robot, motion: MeasuredMotion) -> None:
    with pytest.raises(InputError, match=r"laws of 'j1\.gamma' have states; allowed: those of friction at drives"):
        identify(robot, motion, terms=("links", "viscous"))
    refused(InputError, r"laws of 'j1\.gamma' have states; allowed: robots without", forces, robot, motion)
    assert forces(robot.without_states(), motion).t.size == motion.t.size


def test_base_parameters_and_excitations_leave_states_out(built: Build, robot: eomgen.Robot) -> None:
    base, plain = base_parameters(robot), base_parameters(robot.without_states())
    assert base.names == plain.names
    assert np.array_equal(base.matrix, plain.matrix)
    with pytest.raises(InputError, match=r"allowed: a kernel of robot\.without_states\(\)"):
        base_parameters(robot, kernel=built(robot, "regressor"))
    assert build_model(moving_robot(robot)).internal_states == ()


def test_robots_without_states() -> None:
    robot = robot_from_toml(TEXT)
    plain = robot.without_states()
    friction: Any = plain.joint("j1").coordinates["gamma"].friction
    assert (friction.coulomb, friction.viscous, friction.bristle_stiffness) == (COULOMB, VISCOUS, None)
    assert friction.smoothing > 0.0
    assert build_model(plain).internal_states == ()
    assert plain.without_states() is plain
    assert eomgen.load_robot("ur5").without_states() == eomgen.load_robot("ur5")
