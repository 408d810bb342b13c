"""Robots with motors in what is built on kernels: descriptions, statics, simulations, loops, analysis, reports."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.analysis.sensitivity import offset_sensitivity
from eomgen.analysis.structures import compare
from eomgen.bench.beside import bench
from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.joint.zero_listing import zero_report
from eomgen.errors import InputError
from eomgen.identification.from_motion import forces
from eomgen.identification.stiffness.solve import fit
from eomgen.integration.solve import integrate
from eomgen.integration.steps import fixed_step
from eomgen.motion.files import motion_from_columns
from eomgen.motion.point_to_point import Harmonic, PointToPoint
from eomgen.pipeline.costs import robot_info
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Motor
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario, simulate
from eomgen.state.equilibrium import static_equilibrium
from eomgen.state.springs import coordinate_sizes, stiffness_matrix, stiffnesses
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.pendulums import MOTOR, described
from tests.support.random_motors import geared_robot, gears, motor_state, without_motors
from tests.support.random_robots import Array, random_robot

pytestmark = pytest.mark.usefixtures("unoptimised")


def test_static_equilibrium_is_the_closed_form(built: Build) -> None:
    """A pendulum on its spring: the drive carries the weight over the ratio, the spring winds up by weight / k."""
    kernel = built(described(MOTOR), "inverse_dynamics", "mass_matrix")
    at = 100.0 * 0.3
    q, u = static_equilibrium(kernel, [0.3, at], fixed=["joint1.motor"])
    weight = 2.0 * 9.81 * 0.25 * np.cos(q[0])
    assert np.isclose(at / 100.0 - q[0], weight / 2e4, rtol=1e-9)
    assert np.allclose(u, [0.0, weight / 100.0], rtol=1e-9, atol=1e-12)
    again, _ = static_equilibrium(
        kernel, [0.2, 20.0], u=lambda q: np.stack([0 * q[..., 0], u[1] + 0.1 * (at - q[..., 1])], -1)
    )
    assert np.allclose(again, q, atol=1e-8)


@pytest.mark.soak
def test_stiffnesses_and_steps(built: Build) -> None:
    """What transmissions add is the Hessian of the springs' energy; rk4 resolves the resonance."""
    robot = geared_robot(2101, (2, 3))
    kernel = built(robot, "mass_matrix", "residual_jacobian", "inverse_dynamics")
    still = replace(robot, name="weightless", gravity=(0.0, 0.0, 0.0))
    none = np.zeros(kernel.n)
    by_q, _, M = built(still, "residual_jacobian").residual_jacobian(none, none, none)
    assert np.allclose(stiffness_matrix(kernel), by_q, atol=1e-10)
    assert np.array_equal(stiffnesses(kernel), np.diagonal(stiffness_matrix(kernel)))
    w = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(M, by_q))).max())
    assert np.isclose(fixed_step(kernel, none, None, np.array([0.0, 1.0])), min(1e-3, 0.5 / w))
    sizes, rates = coordinate_sizes(kernel, none)
    assert np.all((sizes > 0.0) & (sizes <= 1.0) & (rates <= 1.0))
    curved = geared_robot(2102, (1, 2), kinds=("curve",))
    kernel = built(curved, "mass_matrix")
    for gear in gears(curved):
        points = np.array(gear.motor.transmission.curve)
        steepest = max(0.0, float(np.max(np.diff(points[:, 1]) / np.diff(points[:, 0]))))
        assert np.isclose(stiffnesses(kernel)[gear.at], steepest / gear.motor.ratio**2)
        assert kernel.knots[kernel.coordinates[gear.at]] == tuple(points[:, 0])


@pytest.mark.parametrize("method", ["scipy:Radau", "rk4"])
def test_integrate_is_scipys_motion(method: str, built: Build) -> None:
    robot = geared_robot(2111, (2, 2))
    kernel, s = built(robot, "forward_dynamics", "energy", "mass_matrix", "inverse_dynamics"), motor_state(robot, 4)
    n = kernel.n

    def rate(_: float, y: Array) -> Array:
        return np.concatenate([y[n:], kernel.forward_dynamics(y[:n].copy(), y[n:].copy(), s.u)])

    exact = solve_ivp(rate, (0.0, 0.2), np.concatenate([s.q, s.v]), "DOP853", rtol=1e-12, atol=1e-12).y[:n, -1]
    options: dict[str, Any] = {"rtol": 1e-9} if method == "scipy:Radau" else {"step": 1e-4}
    found = integrate(kernel, s.q, s.v, 0.2, drive=lambda t, q, v: s.u, method=method, **options)
    assert np.abs(found.q[-1] - exact).max() < 1e-6 * np.abs(exact).max()


def test_a_position_controlled_motor_shakes_its_joint(built: Build) -> None:
    """Motion of the load behind a motor with a given cosine: the closed form of a driven oscillator."""
    robot = described(MOTOR.replace("2e4", "50.0").replace(" }", ', role = "prescribed" }'))
    robot = replace(robot, gravity=(0.0, 0.0, 0.0))
    kernel = built(robot, "forward_dynamics", "energy", "mass_matrix", "inverse_dynamics")
    inertia, k, w = 0.05 + 2.0 * 0.25**2, 50.0, 7.0
    motion = Harmonic([20.0], [w / (2.0 * np.pi)], [np.pi / 2])
    q0 = k / (k - inertia * w * w) * 0.2  # the driven part alone
    found = integrate(kernel, [q0, 20.0], [0.0, 0.0], 2.0, prescribed=motion, rtol=1e-9)
    assert np.allclose(found.of("joint1.motor"), 20.0 * np.cos(w * found.t), atol=1e-9)
    assert np.allclose(found.of("joint1.gamma"), q0 * np.cos(w * found.t), atol=1e-6)
    transmitted = k * (found.q[:, 1] / 100.0 - found.q[:, 0])
    needed = transmitted / 100.0 - 1e-4 * 20.0 * w * w * np.cos(w * found.t)
    assert np.allclose(found.u[:, 1], needed, atol=1e-6)
    with pytest.raises(InputError, match=r"the motion of joint1\.motor is missing"):
        simulate(robot)


@pytest.mark.soak
def test_a_simulation_of_the_geared_arm() -> None:
    """The arm follows its program up to what its springs, its backlash and its friction allow."""
    robot = eomgen.load_robot("geared_arm")
    result = simulate(robot, duration=0.5)
    motion, joints = result.trajectory, ("waist", "shoulder", "elbow")
    assert result.program_coordinates == tuple(f"{name}.gamma" for name in joints)
    assert result.deviation_coordinates == ()
    goal = result.program_q[-1]
    assert np.abs(goal).min() > 0.1
    for i, name in enumerate(joints):
        motor = robot.joint(name).motor
        assert np.abs(motion.of(f"{name}.gamma") - result.program_q[:, i]).max() < 0.02
        assert np.abs(motion.of(f"{name}.motor") / motor.ratio - result.program_q[:, i]).max() < 0.02
        driven = motion.u[:, motion.coordinates.index(f"{name}.gamma")]
        assert not driven.any()
        assert motion.u[:, motion.coordinates.index(f"{name}.motor")].any()
    play = robot.joint("elbow").motor
    assert abs(motion.of("elbow.gamma")[0] - result.program_q[0, 2]) < 1e-12  # in the middle of its backlash
    deflection = motion.of("elbow.motor") / play.ratio - motion.of("elbow.gamma")
    assert 5e-4 < np.abs(deflection).max() < 3e-3
    text = "\n".join(result.summary_lines())
    assert "drives act at waist.motor, shoulder.motor, elbow.motor" in text


@pytest.mark.soak
def test_drives_of_a_stiff_gear_are_the_rigid_ones_over_the_ratio() -> None:
    robot = described(MOTOR.replace("2e4", "1e7").replace(" }", ", damping = 1e3 }"))
    hard = simulate(robot, duration=0.5)
    rigid = simulate(robot.rigid(), duration=0.5)
    assert np.abs(hard.trajectory.of("joint1.gamma") - rigid.trajectory.of("joint1.gamma")).max() < 1e-5
    assert np.allclose(100.0 * hard.trajectory.u[:, 1], rigid.trajectory.u[:, 0], atol=1e-2 * rigid.trajectory.u.max())


@pytest.mark.soak
def test_loops_over_motors(built: Build) -> None:
    """A four-bar linkage whose crank a motor drives: constraint and both rows of the transmission hold."""
    robot = eomgen.load_robot("four_bar")
    motor = Motor(1e-4, 30.0, Coordinate(40.0, 0.2))
    joints = (replace(robot.joints[0], motor=motor), *robot.joints[1:])
    kernel = built(replace(robot, name="geared_bar", joints=joints))
    mechanism = ClosedLoops(kernel)
    crank, at = (kernel.coordinates.index(f"joint1.{name}") for name in ("gamma", "motor"))
    guess = np.array([{"joint1.gamma": 1.0, "joint1.motor": 33.0}.get(name, 0.8) for name in kernel.coordinates])
    q = mechanism.consistent_positions(guess, held=["joint1.gamma"])
    assert q[at] == 33.0
    rates = np.array([2.0 if i == crank else 0.0 for i in range(kernel.n)])
    v = mechanism.consistent_velocities(q, rates, held=["joint1.gamma"])
    u = np.array([0.5 if i == at else 0.0 for i in range(kernel.n)])
    found = mechanism.forward_dynamics(q, v, u)
    J = kernel.functions.constraint_jacobian(q)
    assert not J[:, at].any()
    assert np.abs(J @ found.a + kernel.functions.constraint_bias(q, v)).max() < 1e-9
    residual = kernel.residual(q, v, found.a, u) - J.T @ found.multipliers
    assert np.abs(residual).max() < 1e-9
    force = 40.0 * (q[at] / 30.0 - q[crank]) + 0.2 * (v[at] / 30.0 - v[crank])
    assert np.isclose(found.a[at], (0.5 - force / 30.0) / 1e-4, rtol=1e-9)
    motion = integrate(mechanism.kernel, q, v, 0.05, drive=lambda t, q, v: u)
    assert motion.info["gap"] < 1e-11


def test_forces_of_a_measured_motion(built: Build) -> None:
    """Drives at the motor, springs at both ends; what is not measured or not linear is refused."""
    robot = described(MOTOR.replace(" }", ", damping = 10.0, friction = { coulomb = 0.01 } }"))
    kernel, t = built(robot, "inverse_dynamics", "reactions"), np.linspace(0.0, 1.0, 201)
    gamma, phi = 0.3 * np.sin(5.0 * t), 1e-3 * np.cos(7.0 * t)
    columns = {"t": t, "joint1.gamma": gamma, "joint1.motor": 100.0 * (gamma + phi)}
    motion = motion_from_columns(columns, kernel.coordinates)
    found = forces(robot, motion, kernel=kernel)
    inner = slice(10, -10)
    k, b = 2e4 * phi, 10.0 * -7e-3 * np.sin(7.0 * t)
    assert np.allclose(found.spring[inner], np.stack([k, -k / 100.0], 1)[inner], atol=1e-4)
    assert np.allclose(found.damper[inner], np.stack([b, -b / 100.0], 1)[inner], atol=1e-4)
    assert np.allclose(found.required, found.drive + found.spring + found.damper)
    inertia = 0.05 + 2.0 * 0.25**2
    needed = -inertia * 0.3 * 25.0 * np.sin(5.0 * t) + 2.0 * 9.81 * 0.25 * np.cos(gamma)
    assert np.allclose(found.required[inner, 0], needed[inner], atol=1e-3)
    del columns["joint1.motor"]
    with pytest.raises(InputError, match=r"joint1\.motor was not measured"):
        forces(robot, motion_from_columns(columns, kernel.coordinates), kernel=kernel)
    worn = replace(described(MOTOR.replace(" }", ", clearance = 1e-3 }")), name="worn_gear")
    with pytest.raises(InputError, match=r"joints\.joint1\.motor\.clearance: allowed: transmissions of stiffness"):
        forces(worn, motion, kernel=built(worn, "inverse_dynamics", "reactions"))


def test_a_fit_leaves_transmissions_alone(built: Build) -> None:
    """The deviation beside a motor is fitted as ever."""
    robot = described(MOTOR, more="x = { stiffness = 300.0, damping = 2.0 }")
    kernel = built(robot, "inverse_dynamics", "mass_matrix")
    t = np.linspace(0.0, 4.0, 4001)
    sway, gamma = 0.01 * np.sin(9.0 * t) + 0.004 * np.sin(17.0 * t), 0.3 * np.sin(2.0 * t)
    q = np.stack([sway, gamma, 100.0 * gamma + 0.1], 1)
    v = np.gradient(q, t, axis=0, edge_order=2)
    a = np.gradient(v, t, axis=0, edge_order=2)
    u = kernel.inverse_dynamics(q, v, a)
    columns = {"t": t} | {name: q[:, i] for i, name in enumerate(kernel.coordinates)}
    columns["joint1.x.drive"] = u[:, 0]
    names = ["joint1.x", "joint1.gamma", "joint1.motor"]
    result = fit(robot, motion_from_columns(columns, kernel.coordinates), coordinates=names, kernel=kernel)
    assert [entry.coordinate for entry in result.fitted] == ["joint1.x"]
    stiffness = result.fitted[0].stiffness
    assert abs(stiffness.value - 300.0) < 3.0
    for name in names[1:]:
        assert any(line.startswith(f"{name} hangs on a transmission") for line in result.warnings)


@pytest.mark.soak
def test_comparisons_name_the_motors() -> None:
    robot = described(MOTOR.replace(" }", ", damping = 10.0 }"))
    found = compare([robot, robot.rigid()], duration=0.3)
    geared, rigid = found.entries
    assert list(geared.drives) == ["joint1.motor"]
    assert list(rigid.drives) == ["joint1.gamma"]
    assert np.isclose(100.0 * geared.drives["joint1.motor"], rigid.drives["joint1.gamma"], rtol=0.1)


@pytest.mark.parametrize("seed", [2121, 2122])
def test_sensitivity_is_that_of_the_links(seed: int) -> None:
    robot = geared_robot(seed, (1, 2))
    s, bare = motor_state(robot, seed), without_motors(robot)
    own = np.setdiff1d(np.arange(len(s.q)), [gear.at for gear in gears(robot)])
    names, found = offset_sensitivity(robot, s.q, "tcp")
    wanted_names, wanted = offset_sensitivity(bare, s.q[own], "tcp")
    assert names == wanted_names
    assert np.array_equal(found, wanted)


def test_reports() -> None:
    robot = eomgen.load_robot("geared_arm")
    info = robot_info(robot)
    assert info.as_dict()["driven"] == ["waist.motor", "shoulder.motor", "elbow.motor"]
    assert info.as_dict()["motors"]["elbow.motor"] == "elbow.gamma"
    text = "\n".join(info.lines())
    assert "drives elbow.gamma, ratio -50, clearance 0.0005" in text
    assert "motor: its rotor's inertia about its own axis stands on the diagonal of M alone" in text
    zeros = zero_report(build_model(robot))
    assert zeros.as_dict()["motors"] == info.as_dict()["driven"]
    assert any(line.startswith("waist.motor, shoulder.motor, elbow.motor: motor: its") for line in zeros.lines())
    timed = bench(described(MOTOR), repeat=1, kernels=("inverse_dynamics",))
    assert "know no motors behind transmissions (joint1.motor): kernels are timed alone" in timed.note
    assert [row.counterpart for row in timed.rows] == [None] * len(timed.rows)
    assert timed.rows[0].kernel.least > 0.0
    plain = robot_info(random_robot(2131, joints=(1, 1)))
    assert plain.as_dict()["motors"] == {}


def test_readable_equations() -> None:
    form = readable_closed_form(build_model(described(MOTOR)))
    motor = form.lines()[-1].strip()
    wanted = "J_motor_joint1*motorddot_1 = D_motor_1 + "
    assert motor.startswith(wanted)
    q, theta = form.form.q
    names = {str(letter.symbol): letter.symbol for letter in form.letters}
    k, ratio = names["a_motor_joint1"], names["N_motor_joint1"]
    assert (form.force[1] - form.form.u[1] + k * (theta / ratio - q) / ratio).expand() == 0
    assert form.force[0].expand().coeff(k) == theta / ratio - q
    assert not form.force[0].has(form.form.u[0])
    assert r"J_{\mathrm{motor},joint1}" in form.latex()
    assert {letter.unit for letter in form.letters if str(letter.symbol) == "a_motor_joint1"} == {"N m/rad"}


@pytest.mark.soak
def test_scenarios_drive_at_motors(built: Build) -> None:
    """A prescribed motor, a torque at a joint's motor and gains at a joint, against integrations by hand."""
    robot = replace(described(MOTOR.replace("2e4", "50.0")), gravity=(0.0, 0.0, 0.0))
    kernel = built(robot, "forward_dynamics", "energy", "mass_matrix", "inverse_dynamics", "kinematics")
    ratio, q0 = kernel.ratio("joint1.motor"), np.zeros(2)
    how = "duration = 0.5\noutput_step = 0.01\n[integrator]\nrtol = 1e-9\n"
    torque = '[control]\ntype = "torque"\ncoordinates = ["joint1"]\nrows = [[0.0, 0.1], [0.5, 0.1]]\n'
    pushed = run_scenario(robot, scenario_from_toml(how + torque))
    expected = integrate(kernel, q0, q0, 0.5, drive=lambda t, q, v: [0.0, 0.1], rtol=1e-9, output_step=0.01)
    assert np.abs(pushed.trajectory.q - expected.q).max() <= 1e-6 * np.abs(expected.q).max()
    gains = (
        '[motion]\ntype = "point_to_point"\nstart = [0.0]\ngoal = [0.3]\nduration = 0.4\n'
        '[control]\ntype = "pd"\nkp = 40.0\nkd = 4.0\n'
    )
    held = run_scenario(robot, scenario_from_toml(how + gains))
    motor_u = held.trajectory.u[:, 1]
    q, v = held.trajectory.q[:, 1] / ratio, held.trajectory.v[:, 1] / ratio
    program = PointToPoint(np.zeros(1), np.array([0.3]), 0.4).at(held.trajectory.t)
    assert np.abs(motor_u - (40.0 * (program[0][:, 0] - q) + 4.0 * (program[1][:, 0] - v)) / ratio).max() <= 1e-12
    assert (held.trajectory.u[:, 0] == 0.0).all()
    robot = replace(robot, joints=(replace(robot.joints[0], motor=replace(robot.joints[0].motor, prescribed=True)),))
    shake = '[[prescribed]]\ntype = "harmonic"\ncoordinate = "joint1.motor"\namplitude = 20.0\nfrequency = 1.0\n'
    shaken = run_scenario(robot, scenario_from_toml(how + shake)).trajectory
    assert np.abs(shaken.of("joint1.motor") - 20.0 * np.sin(2 * np.pi * shaken.t)).max() <= 1e-12
    assert np.ptp(shaken.of("joint1.gamma")) > 0.1
