"""What identifies and plans where laws have states: sliding friction is found, bristles stay, forces are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import InputError
from eomgen.identification import base_parameters, forces, identify
from eomgen.identification.exciting.solve import moving_robot
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot.model import build_model
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

COULOMB, STIFFNESS, VISCOUS = 1.2, 2e4, 0.3
FRICTION = f'model = "lugre", coulomb = {COULOMB}, bristle_stiffness = {STIFFNESS}, viscous = {VISCOUS}'
TEXT = f"""
name = "arm"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "rod"
mass = 4.0
com = [0.2, 0.01, 0.0]
inertia = {{ xx = 0.1, yy = 0.12, zz = 0.13 }}
[[joints]]
name = "j1"
type = "revolute"
parent = "base"
child = "rod"
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
    none = np.zeros_like(q)
    u = kernel.inverse_dynamics(*(np.stack(pair, axis=1) for pair in ((q, none), (v, z), (a, none))))[:, 0]
    columns = {"t": t, "j1.gamma": q, "j1.gamma.rate": v, "j1.gamma.acceleration": a, "j1.gamma.drive": u}
    return motion_from_columns(columns, kernel.coordinates)


def test_identify_finds_friction_as_it_slides_and_keeps_bristles(
    robot: eomgen.Robot, motion: MeasuredMotion, tmp_path: Path
) -> None:
    found = identify(robot, motion)
    assert found.parameters["j1.gamma.dry"] == pytest.approx(COULOMB, rel=1e-3)
    assert found.parameters["j1.gamma.viscous"] == pytest.approx(VISCOUS, rel=1e-2)
    friction = found.robot.joint("j1").coordinates["gamma"].friction
    assert friction is not None
    assert friction.coulomb == found.parameters["j1.gamma.dry"]
    assert friction.bristle_stiffness == STIFFNESS
    assert build_model(found.robot).memory == ("j1.gamma.friction.z",)
    written = load_robot(found.to_toml(tmp_path / "found.toml"))
    assert written.joint("j1").coordinates["gamma"].friction == friction


def test_curves_of_stribeck_are_those_that_bristles_slide_by(robot: eomgen.Robot, motion: MeasuredMotion) -> None:
    terms = ("links", "viscous", "dry", "stribeck")
    with pytest.raises(InputError, match="shape: 'lorentzian'; allowed: gaussian, of friction with bristles"):
        identify(robot, motion, terms=terms, shape="lorentzian")
    found = identify(robot, motion, terms=terms)
    friction = found.robot.joint("j1").coordinates["gamma"].friction
    assert friction is not None
    assert friction.bristle_stiffness == STIFFNESS
    assert friction.shape in (None, "gaussian")


def test_states_that_nobody_measured_are_refused(robot: eomgen.Robot, motion: MeasuredMotion) -> None:
    with pytest.raises(InputError, match=r"laws of 'j1\.gamma' have states; allowed: those of friction at drives"):
        identify(robot, motion, terms=("links", "viscous"))
    with pytest.raises(InputError, match=r"laws of 'j1\.gamma' have states; allowed: robots without"):
        forces(robot, motion)
    assert forces(robot.without_states(), motion).t.size == motion.t.size


def test_base_parameters_and_excitations_leave_states_out(built: Build, robot: eomgen.Robot) -> None:
    base, plain = base_parameters(robot), base_parameters(robot.without_states())
    assert base.names == plain.names
    assert np.array_equal(base.matrix, plain.matrix)
    with pytest.raises(InputError, match=r"allowed: a kernel of robot\.without_states\(\)"):
        base_parameters(robot, kernel=built(robot, "regressor"))
    assert build_model(moving_robot(robot)).memory == ()


def test_robots_without_states() -> None:
    robot = robot_from_toml(TEXT)
    plain = robot.without_states()
    friction: Any = plain.joint("j1").coordinates["gamma"].friction
    assert (friction.coulomb, friction.viscous, friction.bristle_stiffness) == (COULOMB, VISCOUS, None)
    assert friction.smoothing is not None
    assert build_model(plain).memory == ()
    assert plain.without_states() is plain
    assert eomgen.load_robot("ur5").without_states() == eomgen.load_robot("ur5")
