"""Scenarios against closed forms, SciPy, MuJoCo and Pinocchio; wrenches and payloads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.integration.solve import integrate
from eomgen.motion.point_to_point import Harmonic
from eomgen.motion.time_derivatives import Jump
from eomgen.robot.value import Coordinate, Joint, Link, Placement, Robot
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.scenario.value import Scenario
from eomgen.simulation.balance import EnergyBalance
from eomgen.simulation.loads import Wrenches, combined_body
from eomgen.simulation.references import PrescribedMotion, make_reference
from eomgen.simulation.run import run_scenario, simulate
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.joint_table import joint_table, link_table
from tests.support.optional import OptionalModule
from tests.support.random_robots import Array, random_robot
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

mujoco, pin = OptionalModule("mujoco"), OptionalModule("pinocchio")
MASS, LENGTH, INERTIA = 2.0, 0.5, 0.1  # of the pendulum; about the axis:
ABOUT_AXIS = INERTIA + MASS * LENGTH**2
TIGHT = "[integrator]\nmethod = 'scipy:DOP853'\nrtol = 1e-11\n"


def pendulum(gravity: float) -> Robot:
    """A link along X0 at q = 0 that turns about Z0; gravity along -Y0."""
    link = Link("rod", MASS, (LENGTH, 0.0, 0.0), (INERTIA, INERTIA, INERTIA, 0.0, 0.0, 0.0))
    hinge = Joint("hinge", "base", "rod", "revolute", coordinates={"gamma": Coordinate()})
    return Robot("pendulum", (0.0, -gravity, 0.0), (link,), (hinge,))


# Drives


def test_a_torque_table_turns_a_link_as_its_integral() -> None:
    """Without gravity the angle is the second integral of straight pieces; the late, short pulse is not missed."""
    scenario = scenario_from_toml(
        "duration = 8.0\noutput_step = 0.1\n[initial]\nv = { hinge = 0.2 }\n[control]\ntype = 'torque'\n"
        "coordinates = ['hinge']\nrows = [[0, 0], [5.0, 0.0], [5.01, 30.0], [5.02, 0.0]]\n" + TIGHT
    )
    result = run_scenario(pendulum(0.0), scenario)
    t, ramp = result.trajectory.t, 30.0 / 0.01
    kinks = [(5.0, ramp), (5.01, -2.0 * ramp), (5.02, ramp)]  # changes of slope
    rate = 0.2 + sum(k * np.maximum(t - at, 0.0) ** 2 / 2.0 for at, k in kinks) / ABOUT_AXIS
    angle = 0.2 * t + sum(k * np.maximum(t - at, 0.0) ** 3 / 6.0 for at, k in kinks) / ABOUT_AXIS
    assert np.abs(result.trajectory.q[:, 0] - angle).max() < 1e-10
    assert np.abs(result.trajectory.v[:, 0] - rate).max() < 1e-10
    work = 0.5 * ABOUT_AXIS * (rate**2 - 0.2**2)
    assert np.abs(result.balance.of("drives") - work).max() < 1e-10


def test_a_table_that_holds_jumps(tmp_path: Path) -> None:
    (tmp_path / "torque.csv").write_text("# s, N m\nt,hinge.gamma\n0,1.5\n0.35,-2\n0.7125,0\n")
    text = (
        "duration = 1.0\noutput_step = 0.01\n[control]\ntype = 'torque'\nfile = 'torque.csv'\ninterpolation = 'hold'\n"
    )
    result = run_scenario(pendulum(0.0), scenario_from_toml(text + TIGHT, folder=tmp_path))
    t = result.trajectory.t
    jumps = [(0.0, 1.5), (0.35, -3.5), (0.7125, 2.0)]
    angle = sum(k * np.maximum(t - at, 0.0) ** 2 / 2.0 for at, k in jumps) / ABOUT_AXIS
    assert np.abs(result.trajectory.q[:, 0] - angle).max() < 1e-8
    assert np.array_equal(np.unique(result.trajectory.u), [-2.0, 0.0, 1.5])
    assert result.trajectory.u[35, 0] == -2.0  # at the jump what comes


@pytest.mark.parametrize("gravity", [False, True])
def test_joint_pd_against_scipy(gravity: bool) -> None:
    """theta'' from the closed form, integrated by SciPy; the program is the quintic."""
    kp, kd, g = 40.0, 5.0, 9.81
    scenario = scenario_from_toml(
        "duration = 1.5\noutput_step = 0.05\n[initial]\nequilibrium = false\nq = { hinge.gamma = 0.3 }\n"
        "[motion]\ntype = 'point_to_point'\nstart = { hinge = 0.1 }\ngoal = [0.9]\nbegin = 0.2\nduration = 1.0\n"
        f"[control]\ntype = 'pd'\nkp = {kp}\nkd = {{ hinge = {kd} }}\ngravity = {str(gravity).lower()}\n" + TIGHT
    )
    result = run_scenario(pendulum(g), scenario)

    def closed_form(t: float, y: Array) -> list[float]:
        r = min(max((t - 0.2) / 1.0, 0.0), 1.0)
        q_d, v_d = 0.1 + 0.8 * (10 * r**3 - 15 * r**4 + 6 * r**5), 0.8 * 30 * (r - r * r) ** 2
        weight = MASS * g * LENGTH * np.cos(y[0])
        torque = kp * (q_d - y[0]) + kd * (v_d - y[1]) + (weight if gravity else 0.0)
        return [y[1], (torque - weight) / ABOUT_AXIS]

    t = result.trajectory.t
    found = solve_ivp(closed_form, (0.0, 1.5), [0.3, 0.0], t_eval=t, rtol=1e-11, atol=1e-12).y
    assert np.abs(result.trajectory.q[:, 0] - found[0]).max() < 1e-8
    assert np.abs(result.trajectory.v[:, 0] - found[1]).max() < 1e-7


def test_computed_torque_follows_with_its_bandwidth() -> None:
    """An initial error e of a rigid robot dies out as e (1 + w t) exp(-w t)."""
    scenario = scenario_from_toml(
        "duration = 0.6\noutput_step = 0.02\n[initial]\nequilibrium = false\nq = { hinge = 0.05 }\n"
        "[motion]\ntype = 'point_to_point'\nstart = [0.0]\ngoal = [1.0]\n"
        "[control]\ntype = 'computed_torque'\nbandwidth = 20\n" + TIGHT
    )
    result = run_scenario(pendulum(9.81), scenario)
    t = result.trajectory.t
    assert np.abs(result.tracking_error[:, 0] - 0.05 * (1 + 20 * t) * np.exp(-20 * t)).max() < 1e-8


def test_the_call_and_the_file_are_one_simulation() -> None:
    robot = eomgen.load_robot("one_link")
    called = simulate(robot, duration=0.5, goal={"joint1": 0.4}, bandwidth=20.0, rtol=1e-7)
    text = (
        "duration = 0.5\n[motion]\ntype = 'point_to_point'\ngoal = { joint1 = 0.4 }\n"
        "[control]\ntype = 'computed_torque'\nbandwidth = 20.0\n[integrator]\nrtol = 1e-7\n"
    )
    read = run_scenario(robot, scenario_from_toml(text))
    assert np.array_equal(called.trajectory.q, read.trajectory.q)
    assert dict(called.scenario) == dict(read.scenario)


# Motions


def test_a_circle_is_round() -> None:
    """The tool of a rigid arm stays on it by Pinocchio's geometry of the pose, and turns the right way round once."""
    robot, center = eomgen.load_robot("ur5"), np.array([0.35, 0.15, 0.35])
    normal, start = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.12, 0.0])
    text = (
        f"duration = 1.0\noutput_step = 5e-3\n[motion]\ntype = 'circle'\ncenter = {center.tolist()}\nduration = 0.8\n"
        f"normal = {normal.tolist()}\nfrom = {(center + start).tolist()}\nframe = 'tcp'\n"
    )
    result = run_scenario(robot, scenario_from_toml(text))
    for pose, near in ((result.program_pose, 2e-8), (result.pose, 2e-6)):
        arm = pose[:, :3, 3] - center
        assert np.abs(np.linalg.norm(arm, axis=1) - 0.12).max() < near
        assert np.abs(arm @ normal).max() < near
        angle = np.unwrap(np.arctan2(arm @ np.cross(normal, start / 0.12), arm @ start / 0.12))
        assert angle[0] == pytest.approx(0.0, abs=1e-5)
        assert angle[-1] == pytest.approx(2 * np.pi, abs=1e-4)
        assert (np.diff(angle) > -1e-6).all()
        r = result.trajectory.t / 0.8
        assert np.abs(angle - 2 * np.pi * np.where(r < 1, 10 * r**3 - 15 * r**4 + 6 * r**5, 1.0)).max() < 2e-5


def test_a_line_is_straight() -> None:
    text = (
        "duration = 0.5\nframe = 'tcp'\n[motion]\ntype = 'line'\nfrom = [0.4, 0.2, 0.2]\nto = [0.4, -0.1, 0.3]\n"
        "begin = 0.1\nduration = 0.3\n"
    )
    result = run_scenario(eomgen.load_robot("puma560"), scenario_from_toml(text))
    place, t = result.program_pose[:, :3, 3], result.trajectory.t
    r = np.clip((t - 0.1) / 0.3, 0.0, 1.0)[:, np.newaxis]
    s = 10 * r**3 - 15 * r**4 + 6 * r**5
    assert np.abs(place - ([0.4, 0.2, 0.2] + s * np.array([0.0, -0.3, 0.1]))).max() < 1e-8
    assert np.abs(result.tool_deviation).max() < 1e-5


@pytest.mark.parametrize("timing", ["times = [0.1, 0.5, 0.8, 1.5]", "speed = [1.0, 2.5, 1.5]\nbegin = 0.1"])
def test_via_points_are_hit_smoothly(timing: str) -> None:
    """Positions at the times; rates and accelerations continuous and those of the positions; rest at both ends."""
    robot = eomgen.load_robot("puma560")
    points = [
        [0.0] * 6,
        [0.4, -0.3, 0.2, 0.1, 0.0, 0.5],
        [0.1, -0.8, 0.3, 0.0, 0.4, 0.0],
        [-0.3, -0.5, 0.0, 0.0, 0.0, 0.0],
    ]
    text = f"duration = 1.8\n[motion]\ntype = 'via'\npoints = {points}\n{timing}\n"
    driven = [f"joint{i}.gamma" for i in range(1, 7)]
    program = make_reference(scenario_from_toml(text), robot, driven, lambda: eomgen.build(robot), "tcp", {})
    if "times" in timing:
        times = np.array([0.1, 0.5, 0.8, 1.5])
    else:
        spans = [0.5 / 1.0, 0.5 / 2.5, 0.4 / 1.5]
        times = 0.1 + np.concatenate([[0.0], np.cumsum(spans)])
    assert np.abs(program.at(times)[0] - points).max() < 1e-12
    h = 1e-5
    t = np.linspace(-0.1, 1.7, 7001)
    q, v, a = program.at(t)
    ahead, behind = program.at(t + h), program.at(t - h)
    assert np.abs((ahead[0] - behind[0]) / (2 * h) - v).max() < 1e-5 * np.abs(v).max() + 1e-7
    assert np.abs((ahead[1] - behind[1]) / (2 * h) - a).max() < 1e-3 * np.abs(a).max()
    assert np.abs(ahead[2] - behind[2]).max() < 5e-3 * np.abs(a).max()  # no jump anywhere, the ends among them
    for end in (times[0], times[-1]):
        assert np.abs(program.at(end)[1]).max() < 1e-9
        assert np.abs(program.at(end)[2]).max() < 1e-7
    assert np.array_equal(q[0], points[0])


def test_a_sampled_motion_is_followed(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 101)
    rows = "\n".join(f"{x},{0.3 * np.sin(4 * x)}" for x in t.tolist())
    (tmp_path / "way.csv").write_text(f"t,hinge.gamma\n{rows}\n")
    text = "duration = 1.0\noutput_step = 7e-3\n[motion]\ntype = 'sampled'\nfile = 'way.csv'\n" + TIGHT
    result = run_scenario(pendulum(9.81), scenario_from_toml(text, folder=tmp_path))
    expected = 0.3 * np.sin(4 * result.trajectory.t)
    assert np.abs(result.program_q[:, 0] - expected).max() < 1e-8
    assert np.abs(result.trajectory.q[:, 0] - expected).max() < 1e-7
    drive = ABOUT_AXIS * -16.0 * expected + MASS * 9.81 * LENGTH * np.cos(expected)
    assert np.abs(result.trajectory.u[:, 0] - drive).max() < 1e-3


# Initial states


@pytest.mark.parametrize("seed", soaked((3, 6), (3,)))
def test_equilibrium_leaves_nothing_over(seed: int) -> None:
    """Springs, gravity and a wrench are in balance: no acceleration at t = 0 by Pinocchio's inverse dynamics."""
    robot = random_robot(seed, joints=(2, 2), forces=False)
    stiff = ({name: replace(c, stiffness=300.0) for name, c in x.coordinates.items()} for x in robot.joints)
    joints = (replace(x, coordinates=table) for x, table in zip(robot.joints, stiff, strict=True))
    robot = replace(robot, joints=tuple(joints))
    link = robot.joints[-1].child
    text = (
        f"duration = 0.01\n[initial]\nequilibrium = true\n[[wrenches]]\nlink = '{link}'\nforce = [1.0, -2.0, 0.5]\n"
        "moment = [0.1, 0.2, -0.3]\naxes = 'link'\npoint = [0.1, 0.0, 0.2]\n"
    )
    result = run_scenario(robot, scenario_from_toml(text))
    motion = result.trajectory
    kernel = eomgen.build(robot, kernels=("residual", "external_force"))
    zero = np.zeros(kernel.n)
    assert np.abs(result.wrench[0]).max() > 0.1
    assert np.abs(kernel.residual(motion.q[0], zero, zero, zero, wrench=result.wrench[0])).max() < 1e-9
    assert np.abs(motion.q[0]).max() > 1e-4
    assert np.abs(motion.v).max() < 1e-6


def test_initial_states_are_as_given() -> None:
    text = "duration = 0.1\n[initial]\nq = { hinge.gamma = 0.7 }\nv = { hinge = -0.4 }\n"
    motion = run_scenario(pendulum(9.81), scenario_from_toml(text)).trajectory
    assert (motion.q[0, 0], motion.v[0, 0]) == (0.7, -0.4)
    text = "duration = 0.1\n[initial]\nq = { hinge = -1.2 }\nequilibrium = true\n"
    hanging = run_scenario(pendulum(9.81), scenario_from_toml(text))
    assert hanging.trajectory.q[0, 0] == pytest.approx(-np.pi / 2, abs=1e-12)
    assert not hanging.programmed


# Prescribed motions

SHAKEN = f"""
name = "shaken"
{link_table("cart", 1.0, inertia=(0.1, 0.1, 0.1))}
{link_table("bob", 2.0, (0.3, 0.0, 0.0), (0.02, 0.03, 0.04))}
{joint_table("rail", "base", "cart", "prismatic")}
prescribed = ["z"]
{joint_table("pin", "cart", "bob", "revolute")}
placement = {{ rpy = [1.5707963267948966, 0.0, 0.0] }}
gamma = {{ damping = 0.2 }}
"""


@pytest.mark.soak
def test_prescribed_motions(tmp_path: Path) -> None:
    """Harmonic as ``integrate`` has it; the same motion sampled; and computed torque that knows the platform's."""
    robot = robot_from_toml(SHAKEN)
    harmonic = (
        "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'rail.z'\namplitude = 0.1\nfrequency = 2.0\nphase = 0.4\n"
    )
    found = run_scenario(robot, scenario_from_toml("duration = 1.0\noutput_step = 0.02\n" + harmonic + TIGHT))
    kernel = eomgen.build(robot)
    wave = Harmonic([0.1], 2.0, 0.4)
    direct = integrate(
        kernel, [0, 0], [0, 0], 1.0, prescribed=wave, method="scipy:DOP853", rtol=1e-11, output_step=0.02
    )
    assert np.abs(found.trajectory.q - direct.q).max() < 1e-9
    assert np.abs(found.trajectory.u - direct.u).max() < 1e-6
    assert found.prescribed == ("rail.z",)
    assert found.balance.relative_residue < 1e-8
    assert abs(found.balance.of("prescribed")).max() > 0.1
    t = np.linspace(0.0, 1.0, 201)
    np.savez(tmp_path / "shake.npz", **{"t": t, "rail.z": 0.1 * np.sin(4 * np.pi * t + 0.4)})
    text = "duration = 1.0\noutput_step = 0.02\n[[prescribed]]\ntype = 'sampled'\nfile = 'shake.npz'\n" + TIGHT
    sampled = run_scenario(robot, scenario_from_toml(text, folder=tmp_path))
    assert np.abs(sampled.trajectory.q - direct.q).max() < 1e-6
    text = "duration = 1.0\n[motion]\ntype = 'point_to_point'\nstart = [0.0]\ngoal = [0.5]\n"
    driven = run_scenario(replace(robot, name="driven"), scenario_from_toml(text + harmonic + TIGHT))
    undamped = np.abs(driven.tracking_error).max()
    assert undamped < 1e-7  # the rigid model has the damper, the platform's motion too


# Energy


@pytest.mark.soak
@pytest.mark.parametrize("seed", soaked((21, 22, 23), (21,)))
def test_energy_balances_of_random_robots(seed: int) -> None:
    """Springs, dampers, friction, clearances of random robots under torques and a wrench: nothing is left over."""
    robot = random_robot(seed, joints=(2, 3), tree=True)
    link = robot.joints[-1].child
    names = [f"{j.name}.{c}" for j in robot.joints for c in j.coordinates][:2]
    rows = [[0.0, *([0.0] * len(names))], [0.2, *np.linspace(1.0, -2.0, len(names)).tolist()]]
    text = (
        f"duration = 0.3\noutput_step = 1e-3\n[control]\ntype = 'torque'\ncoordinates = {names}\nrows = {rows}\n"
        f"[[wrenches]]\nlink = '{link}'\nforce = [2.0, 1.0, 0.0]\nt1 = 0.2\n[integrator]\nrtol = 1e-9\n"
    )
    result = run_scenario(robot, scenario_from_toml(text))
    assert result.balance.relative_residue < 1e-5
    assert not any("balance" in note for note in result.notes)


def test_a_balance_that_does_not_close_is_said() -> None:
    """rk4 with a step that is far too large gains energy."""
    robot = eomgen.load_robot("one_link")
    text = (
        "duration = 1.0\noutput_step = 0.1\n[initial]\nq = { joint1.x = 0.001 }\n"
        "[integrator]\nmethod = 'rk4'\nstep = 0.02\n"
    )
    result = run_scenario(robot, scenario_from_toml(text))
    assert result.balance.relative_residue > 1e-3
    assert any("balance does not close" in note for note in result.notes)


def test_a_body_that_moves_on_is_balanced() -> None:
    """Nothing works on it, so that all that its kinetic energy does is the error of an integration."""
    kinetic = 2.0 + 1e-5 * np.sin(np.linspace(0.0, 9.0, 50))
    still = np.zeros((50, 5))
    kept = EnergyBalance(still, np.stack([kinetic, np.zeros(50)], axis=1))
    assert kept.note() is None
    lost = EnergyBalance(still, np.stack([kinetic * np.linspace(1.0, 0.99, 50), np.zeros(50)], axis=1))
    assert "does not close: 1 of 0.02" in str(lost.note())


def test_dampers_take_what_the_closed_form_says() -> None:
    link = Link("mass", 2.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    joint = Joint("slide", "base", "mass", "prismatic", coordinates={"z": Coordinate(800.0, 4.0)})
    robot = Robot("oscillator", (0.0, 0.0, 0.0), (link,), (joint,))
    scenario = scenario_from_toml("duration = 2.0\n[initial]\nq = { slide = 0.1 }\n" + TIGHT)
    result = run_scenario(robot, scenario)
    t, w = result.trajectory.t, np.sqrt(400.0 - 1.0)
    decay = np.exp(-t)
    q = 0.1 * decay * (np.cos(w * t) + np.sin(w * t) / w)
    v = -0.1 * decay * np.sin(w * t) * (w + 1 / w)
    lost = 0.5 * 800 * 0.1**2 - 0.5 * 800 * q**2 - 0.5 * 2 * v**2
    assert np.abs(result.balance.of("dissipated") - lost).max() < 1e-8
    assert (np.diff(result.balance.of("dissipated")) >= 0.0).all()


def test_built_in_scenarios_run() -> None:
    circle = run_scenario(eomgen.load_robot("puma560"), load_scenario("puma560_circle"))
    shaken = run_scenario(eomgen.load_robot("shaken_arm"), load_scenario("shaken_platform"))
    for result in (circle, shaken):
        assert result.balance.relative_residue < 1e-5
        assert 1e-5 < np.linalg.norm(result.tool_deviation, axis=1).max() < 1e-2
    assert isinstance(load_scenario("puma560_circle"), Scenario)


@pytest.mark.soak
def test_dense_tables_are_followed(tmp_path: Path) -> None:
    """501 samples of a sine as a torque: the angle of a free link is its second integral, to the table's own error."""
    t = np.linspace(0.0, 0.5, 501)
    rows = "\n".join(f"{x!r},{np.sin(30 * x).item()!r}" for x in t.tolist())
    (tmp_path / "torque.csv").write_text(f"t,hinge\n{rows}\n")
    text = "duration = 0.5\noutput_step = 0.01\n[control]\ntype = 'torque'\nfile = 'torque.csv'\n"
    result = run_scenario(pendulum(0.0), scenario_from_toml(text + TIGHT, folder=tmp_path))
    t = result.trajectory.t
    angle = (30 * t - np.sin(30 * t)) / 900.0 / ABOUT_AXIS
    assert np.abs(result.trajectory.q[:, 0] - angle).max() < (30.0 * 1e-3) ** 2 / 12 * np.abs(angle).max() * 1.05


@pytest.mark.soak
def test_equilibrium_on_a_platform_that_moves() -> None:
    """The bob of SHAKEN hangs straight down below the pin, wherever the platform's motion begins; then it is shaken."""
    text = (
        "duration = 0.3\n[initial]\nequilibrium = true\nq = { pin = 2.5 }\n"
        "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'rail.z'\namplitude = 0.1\nfrequency = 2.0\nphase = 1.0\n"
    )
    robot = replace(robot_from_toml(SHAKEN), gravity=(-9.81, 0.0, 0.0))
    result = run_scenario(robot, scenario_from_toml(text))
    motion = result.trajectory
    down = np.array([-1.0, 0.0, 0.0])
    pose = eomgen.build(robot, kernels=("kinematics",)).frame_pose(motion.q[0], "bob")
    assert np.abs(pose[:3, 0] - down).max() < 1e-9  # the bob's x axis, on which its mass is
    assert motion.q[0, 0] == pytest.approx(0.1 * np.sin(1.0), rel=1e-14)
    assert motion.v[0, 0] == pytest.approx(0.4 * np.pi * np.cos(1.0), rel=1e-14)
    assert np.ptp(motion.q[:, 1]) > 1e-2


# Wrenches and payloads


def thick_robot(seed: int) -> Robot:
    return random_robot(seed, joints=(3, 3), types=("revolute", "prismatic"), rigid=True, forces=False)


@pytest.mark.parametrize("seed", [11, 12])
def test_wrenches_over_time_against_mujoco(seed: int) -> None:
    """xfrc_applied of MuJoCo, constant over its steps, is a table that holds."""
    robot, step = thick_robot(seed), 2e-4
    link = robot.joints[-1].child
    rng = np.random.default_rng(seed)
    rows = [[t, *rng.uniform(-3.0, 3.0, 6).tolist()] for t in (0.0, 0.06, 0.13)]
    text = (
        f"duration = 0.2\noutput_step = 0.02\n[[wrenches]]\nlink = '{link}'\nrows = {rows}\ninterpolation = 'hold'\n"
        "t0 = 0.03\n" + TIGHT
    )
    result = run_scenario(robot, scenario_from_toml(text))
    other = MujocoRobot(robot, step)
    q = np.zeros(other.model.nv)
    mujoco.mj_resetData(other.model, other.data)
    other.set_state(q, q)
    states = [q]
    for i in range(1000):
        t = i * step
        row = rows[int(np.searchsorted([0.06, 0.13], t + 1e-9))]
        other.data.xfrc_applied[other.model.body(link).id] = np.array(row[1:]) * (t > 0.03 - 1e-9)
        mujoco.mj_step(other.model, other.data)
        if (i + 1) % 100 == 0:
            states.append(np.array(other.data.qpos))
    assert np.abs(result.trajectory.q - states).max() < 1e-8 * max(1.0, np.abs(states).max())
    assert not result.wrench[1].any()
    assert np.array_equal(result.wrench[3, result.links.index(link)], rows[1][1:])


@pytest.mark.parametrize("axes", ["base", "link"])
def test_a_force_at_a_point_against_mujoco(axes: str) -> None:
    robot = thick_robot(13)
    link, rng = robot.joints[-1].child, np.random.default_rng(0)
    force, moment, point = rng.uniform(-2, 2, (3, 3))
    kernel, other = eomgen.build(robot, kernels=("external_force", "kinematics")), MujocoRobot(robot)
    text = (
        f"duration = 1.0\n[[wrenches]]\nlink = '{link}'\nforce = {force.tolist()}\nmoment = {moment.tolist()}\n"
        f"point = {point.tolist()}\naxes = '{axes}'\n"
    )
    wrenches = Wrenches(scenario_from_toml(text), robot, kernel)
    body = other.model.body(link).id
    for _ in range(5):
        q = rng.uniform(-1, 1, kernel.n)
        other.set_state(q, np.zeros(kernel.n))
        turn = other.data.xmat[body].reshape(3, 3)
        R, place = (turn if axes == "link" else np.eye(3)), other.data.xpos[body] + turn @ point
        found = np.zeros(kernel.n)
        mujoco.mj_applyFT(other.model, other.data, R @ force, R @ moment, place, body, found)
        assert np.abs(kernel.functions.external_force(q, wrenches(0.0, q, q)) - found).max() < 1e-12 * max(
            1, np.abs(found).max()
        )


def carrying(robot: Robot, link: str, load: Link) -> Robot:
    """The robot with the load as a further link, held by a fixed joint."""
    place = Joint("grip", link, "load", "fixed", Placement())
    return replace(robot, links=(*robot.links, replace(load, name="load")), joints=(*robot.joints, place))


@pytest.mark.parametrize("t0", [0.0, 0.123])
def test_a_payload_is_a_further_body(t0: float) -> None:
    """From t0 on the motion is that of a robot which has the load as a link held by a fixed joint."""
    robot = eomgen.load_robot("one_link")
    load = Link("load", 0.7, (0.9, 0.05, 0.02), (0.01, 0.02, 0.015, 0.001, 0.0, -0.002))
    xx, yy, zz, xy, _, yz = load.inertia
    text = (
        "duration = 0.4\noutput_step = 1e-2\n[initial]\nv = { joint1 = 1.5 }\n[[payloads]]\nlink = 'link1'\n"
        f"mass = {load.mass}\npoint = {list(load.com)}\nt0 = {t0}\n"
        f"inertia = {{ xx = {xx}, yy = {yy}, zz = {zz}, xy = {xy}, yz = {yz} }}\n" + TIGHT
    )
    result = run_scenario(robot, scenario_from_toml(text))
    t = result.trajectory.t
    heavy = eomgen.build(replace(carrying(robot, "link1", load), name="heavy"))
    light = eomgen.build(robot)
    options = {"method": "scipy:DOP853", "rtol": 1e-11}
    q0, v0, before = np.zeros(2), np.array([0.0, 1.5]), np.zeros((0, 2))
    if t0:
        first = integrate(light, q0, v0, t0, times=np.append(t[t < t0], t0), **options)
        q0, v0, before = first.q[-1], first.v[-1], first.q[:-1]
    rest = integrate(heavy, q0, v0, 0.4, times=np.append([t0] if t0 else [], t[t >= t0]), **options)
    expected = np.concatenate([before, rest.q[1:] if t0 else rest.q])
    assert np.abs(result.trajectory.q - expected).max() < 1e-9
    assert result.balance.relative_residue < 1e-7
    brought = heavy.energy(q0, v0).sum() - light.energy(q0, v0).sum()
    assert result.balance.of("payloads")[-1] == pytest.approx(brought if t0 else 0.0, abs=1e-9)


def test_bodies_are_joined_as_pinocchio_adds_inertias() -> None:
    rng = np.random.default_rng(4)

    def body() -> tuple[Link, Any]:
        found = pin.Inertia.Random()
        m, c, i = found.mass, found.lever, found.inertia
        return Link("l", m, tuple(c.tolist()), (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])), found

    for _ in range(5):
        pin.seed(int(rng.integers(1000)))
        (a, pin_a), (b, pin_b), (c, pin_c) = body(), body(), body()
        found, expected = combined_body(a, [b, c]), pin_a + pin_b + pin_c
        xx, yy, zz, xy, xz, yz = found.inertia
        assert found.mass == pytest.approx(expected.mass)
        assert np.allclose(found.com, expected.lever, atol=1e-13)
        assert np.allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], expected.inertia, atol=1e-12)


def test_prescribed_motions_jump_where_samples_begin_and_end(tmp_path: Path) -> None:
    """Velocities do, of samples that do not rest there; a harmonic motion has no jumps."""
    text = "duration = 1.0\n[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'mount.z'\namplitude = 1\nfrequency = 1\n"
    names = ("mount.x", "mount.y", "mount.z")
    for name, end in (("mount.x", 1.2), ("mount.y", 1.0)):
        t = np.linspace(0.0, end, 6)
        np.savez(tmp_path / f"{name}.npz", **{"t": t, name: np.sin(t)})
        text += f"[[prescribed]]\ntype = 'sampled'\nfile = '{name}.npz'\n"
    motion = PrescribedMotion(scenario_from_toml(text, folder=tmp_path), names, names, {})
    assert motion.jumps(2) == (Jump(0.0, 1), Jump(1.0, 1), Jump(1.2, 1))
    assert motion.jumps(0) == ()
