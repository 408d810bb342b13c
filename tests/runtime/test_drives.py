"""Drives with windings, lags and controllers beside equations of their own, closed forms, and balances."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, IntegrationError
from eomgen.integration.solve import integrate
from eomgen.integration.trajectory import motion_columns
from eomgen.kernel.stepping.input_signals import InputSignals, LinkWrench, Signal
from eomgen.robot.internal_states.drives import short_time_notes
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from eomgen.state.drives import drives_at_rest
from tests.support.builds import Build
from tests.support.drive_reference import AXIS, DAMPING, DRIVES, INERTIA, WINDING, drive, numbers_of, rates_of, servo
from tests.support.joint_table import joint_table, link_table, loop_table
from tests.support.refusals import refused
from tests.support.soak import soaked

EXAMPLE = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
pytestmark = pytest.mark.usefixtures("unoptimised")


def _names(kernel: eomgen.Kernel) -> list[str]:
    return [name.rpartition(".")[2] for name in kernel.internal_states]


@pytest.mark.parametrize("name", DRIVES)
def test_accelerations_and_their_derivatives_are_those_of_the_equations(name: str, built: Build) -> None:
    table, _ = DRIVES[name]
    kernel, numbers, rng = built(servo(table)), numbers_of(table), np.random.default_rng(1)
    names, run = _names(kernel), partial(kernel.calls.run, out=None, whole=True)
    for size in (0.1, 1.0, 10.0, 100.0):
        q, v, u, beside = rng.normal(size=(4, 1)) * [[1.0], [1.0], [size], [1.0]]
        z = size * rng.normal(size=len(names))
        force, rates, voltage = drive(numbers, q[0], v[0], dict(zip(names, z, strict=True)), u[0])
        wanted = [(force + beside[0] - DAMPING * v[0]) / INERTIA, *(rates[x] for x in names)]
        state = q, v, z, u, beside
        a = run("forward_dynamics", values=state)
        np.testing.assert_allclose(a, wanted, rtol=1e-12, atol=1e-12 * size)
        left = run("residual", values=(q, v, z, a[:1], u, beside))
        np.testing.assert_allclose(left, 0.0, atol=1e-12 * size)
        exerted = run("drive_forces", values=state)
        assert exerted[0] == pytest.approx(force + beside[0], rel=1e-14)
        if "current" in names:
            assert exerted[-1] == pytest.approx(voltage - 0.5 * v[0], rel=1e-12, abs=1e-12 * size)
        by_q, by_v, by_u = run("forward_dynamics_jacobian", values=state)
        slopes = by_q[:, :1], by_v[:, :1], by_v[:, 1:], by_u[:, :1], by_u[:, 1:2]
        for k, x in enumerate(state):
            for i in range(x.size):
                step = 1e-6 * max(1.0, abs(x[i]))
                moved = [(*state[:k], x + sign * step * np.eye(x.size)[i], *state[k + 1 :]) for sign in (1.0, -1.0)]
                ends = [run("forward_dynamics", values=values) for values in moved]
                differences = (ends[0] - ends[1]) / (2.0 * step)
                np.testing.assert_allclose(slopes[k][:, i], differences, rtol=1e-5, atol=1e-5 * max(1.0, size))


@pytest.mark.parametrize("name", soaked(DRIVES, ("cascade", "lag")))
def test_all_methods_follow_an_integration_to_twelve_digits(name: str, built: Build) -> None:
    table, u = DRIVES[name]
    kernel, numbers, samples = built(servo(table)), numbers_of(table), 40
    assert kernel.inputs["joint1.gamma"].meaning == kernel.inputs["joint1.gamma"].meaning
    rates = rates_of(numbers, _names(kernel), u, lambda s, v, force: (force - DAMPING * v) / INERTIA)
    begin, t = np.zeros(2 + len(kernel.internal_states)), np.linspace(0.0, 0.5, samples + 1)
    wanted = solve_ivp(rates, (0.0, 0.5), begin, "DOP853", t, rtol=1e-12, atol=1e-14, max_step=2e-4).y.T
    size = np.abs(wanted).max(axis=0) + 1e-9
    within = {"tsit5": 3e-6, "rosenbrock": 1e-4, "radau": 3e-6}
    zero = np.zeros(len(kernel.internal_states))
    for method, bound in within.items():
        motion = kernel.rollout([0.0], [0.0], [u], duration=0.5, samples=samples, method=method, rtol=1e-8, z=zero)
        assert np.abs((np.hstack([*motion, motion.z]) - wanted) / size).max() < bound, method
    for method, steps, bound in (("rk4", 4000, 1e-4), ("implicit", 8000, 2e-2)):
        motion = kernel.rollout(
            [0.0], [0.0], [u], dt=0.5 / steps, steps=steps, every=steps // samples, method=method, z=zero
        )
        assert np.abs((np.hstack([*motion, motion.z]) - wanted) / size).max() < bound, method
    for method in ("scipy:Radau", "scipy:LSODA"):
        motion = integrate(kernel, [0.0], [0.0], duration=0.5, times=t, drive=[u], method=method, rtol=1e-8)
        assert np.abs((np.hstack([motion.q, motion.v, motion.z]) - wanted) / size).max() < 1e-4, method


def test_a_voltage_turns_a_motor_as_its_closed_form_says(built: Build) -> None:
    """Without limits and load: the velocity is a sum of two exponentials."""
    R, L, k, V = 2.0, 0.02, 0.4, 6.0
    kernel = built(servo(f"winding = {{ resistance = {R}, inductance = {L}, torque_constant = {k} }}"))
    roots = np.roots([L * INERTIA, L * DAMPING + R * INERTIA, R * DAMPING + k * k])
    final = k * V / (R * DAMPING + k * k)
    t = np.linspace(0.0, 1.0, 51)
    a, b = roots
    wanted = final * (1.0 + (b * np.exp(a * t) - a * np.exp(b * t)) / (a - b))
    motion = kernel.rollout([0.0], [0.0], [V], duration=1.0, samples=50, method="radau", rtol=1e-10, z=[0.0])
    np.testing.assert_allclose(motion[1][:, 0], wanted.real, atol=1e-8 * final)
    assert kernel.inputs["joint1.gamma"] == ("voltage", "V")
    assert kernel.internal_states == ("joint1.gamma.drive.current",)


def test_a_current_loop_has_the_bandwidth_that_its_gains_are_for(built: Build) -> None:
    """kp = w L and ki = w R cancel the winding's pole: the current follows with the time constant 1 / w."""
    R, L, w = 0.7, 1.4e-3, 2000.0
    winding = f"winding = {{ resistance = {R}, inductance = {L}, torque_constant = 1e-9 }}"
    kernel = built(servo(f"{winding}, controller = {{ current = {{ kp = {w * L}, ki = {w * R} }} }}"))
    zero = np.zeros(1)
    run = partial(kernel.calls.run, "forward_dynamics_jacobian", None, whole=True)
    _, by_v, by_u = run((zero, zero, zero), z=np.zeros(len(kernel.internal_states)))
    states = slice(1, None)
    A, B, row = by_v[states, states], by_u[states, 0], _names(kernel).index("current")
    for frequency in (0.1 * w, w, 10.0 * w):
        gain = np.linalg.solve(1j * frequency * np.eye(len(A)) - A, B)[row]
        assert gain == pytest.approx(1.0 / (1.0 + 1j * frequency / w), abs=1e-9)
    motion = kernel.rollout([0.0], [0.0], [3.0], duration=3e-3, samples=30, method="radau", rtol=1e-9, z=[0.0, 0.0])
    np.testing.assert_allclose(motion.z[:, row], 3.0 * (1.0 - np.exp(-w * np.linspace(0.0, 3e-3, 31))), atol=1e-7)


def test_integrals_do_not_wind_up(built: Build) -> None:
    """A torque that is limited: with back-calculation the coordinate overshoots less than without."""
    loop = "kp = 6.0, ki = 12.0, kd = 0.8, limit = 1.0"
    peaks = {}
    for tracking in (0.2, 1e6):
        kernel = built(servo(f"controller = {{ {loop}, tracking_time = {tracking} }}"))
        motion = kernel.rollout([0.0], [0.0], [1.0], duration=6.0, samples=600, method="radau", rtol=1e-8, z=[0.0])
        peaks[tracking] = motion[0].max()
        assert np.abs(kernel.functions.drive_forces(motion[0], motion[1], [1.0], motion.z)).max() <= 1.0
    assert peaks[0.2] < 1.2
    assert peaks[1e6] > 1.6


def test_fast_windings_need_no_small_steps(built: Build) -> None:
    """With L / R = 1e-4 s and a current loop of 1e-5 s linearly implicit steps are as long as the motion allows."""
    winding = "winding = { resistance = 1.0, inductance = 1e-4, torque_constant = 0.5 }"
    loops = "velocity = { kp = 0.5, ki = 2.0 }, current = { kp = 10.0, ki = 1e5 }"
    kernel = built(servo(f"{winding}, controller = {{ {loops} }}"))
    zero = np.zeros(3)
    steps = {
        method: kernel.rollout([0.0], [0.0], [2.0], duration=2.0, samples=2, method=method, rtol=1e-4, z=zero).steps
        for method in ("tsit5", "rosenbrock", "radau")
    }
    assert steps["tsit5"] > 20000
    assert steps["rosenbrock"] < 400
    assert steps["radau"] < 400
    _, coarse = kernel.rollout([0.0], [0.0], [2.0], dt=1e-2, steps=200, method="implicit", z=zero)
    _, fine = kernel.rollout([0.0], [0.0], [2.0], duration=2.0, samples=200, method="radau", rtol=1e-8, z=zero)
    assert np.abs(coarse - fine).max() < 0.05 * np.abs(fine).max()


@pytest.mark.parametrize("name", soaked(("cascade", "voltage", "lagging cascade", "velocity"), ("cascade", "velocity")))
def test_what_drives_take_in_is_stored_or_dissipated(name: str, built: Build) -> None:
    """Of a winding V i; it stores L i^2 / 2, and its resistance dissipates R i^2."""
    table, u = DRIVES[name]
    kernel = built(servo(table))
    motion = integrate(
        kernel, [0.0], [0.0], duration=0.5, output_step=0.05, drive=[u], method="radau", rtol=1e-9, works=True
    )
    assert motion.z is not None
    balance = motion.energy.sum(axis=1) - motion.energy.sum(axis=1)[0] - motion.works[:, 0] + motion.works[:, 3]
    assert np.abs(balance).max() < 1e-7 * np.abs(motion.works).max()
    if "current" in _names(kernel):
        i = motion.z[:, _names(kernel).index("current")]
        kinetic = 0.5 * INERTIA * motion.v[:, 0] ** 2
        np.testing.assert_allclose(motion.energy.sum(axis=1), kinetic + 0.5e-3 * i * i, rtol=1e-12, atol=1e-15)


def test_forces_beside_a_drive_act_on_its_coordinate(built: Build) -> None:
    """External wrenches act on the arm, whatever u means, in forward dynamics, C and Python."""
    table, u = DRIVES["voltage"]
    kernel = built(servo(table))
    q, v, z, drives = np.zeros(1), np.array([0.3]), np.array([1.0]), np.array([u])
    wrench = {"arm": [0.0, 2.0, 0.0, 0.0, 0.0, 0.5]}
    free = kernel.forward_dynamics(q, v, drives, z)
    pushed = kernel.forward_dynamics(q, v, drives, z, wrench=wrench)
    assert pushed[0] - free[0] == pytest.approx((0.2 * 2.0 + 0.5) / INERTIA)
    values = kernel.calls.arguments("forward_dynamics", (q, v, drives), z, [0.2 * 2.0 + 0.5])
    beside = kernel.calls.run("forward_dynamics", None, values, whole=True)
    assert beside[0] == pytest.approx(pushed[0])
    assert beside[1] == kernel.internal_state_derivatives(q, v, z, drives)[0]
    row = Signal.constant(np.array(wrench["arm"]))
    loads = InputSignals(wrenches=[LinkWrench(0, row)])
    in_c = kernel.rollout([0.0], [0.0], [u], duration=0.2, samples=4, method="radau", rtol=1e-9, loads=loads, z=[0.0])
    motion = integrate(
        kernel, [0.0], [0.0], duration=0.2, output_step=0.05, drive=[u], wrench=wrench, method="scipy:Radau", rtol=1e-9
    )
    np.testing.assert_allclose(in_c[0], motion.q, atol=1e-7)
    still = kernel.rollout([0.0], [0.0], [u], duration=0.2, samples=4, method="radau", rtol=1e-9, z=[0.0])
    assert np.abs(in_c[0] - still[0]).max() > 0.05


def test_a_motor_behind_a_gear_has_a_drive(built: Build) -> None:
    """Its drive acts on the rotor: in N m at the shaft."""
    motor = "motor = { inertia = 1e-3, ratio = 20.0, stiffness = 500.0, damping = 0.5, drive = { lag = 0.01 } }\n"
    kernel = built(robot_from_toml(f"{AXIS}gamma = {{ damping = 0.05 }}\n{motor}"))
    assert kernel.internal_states == ("joint1.motor.drive.force",)
    assert kernel.inputs == {"joint1.gamma": ("torque", "N m"), "joint1.motor": ("torque", "N m")}
    a = kernel.forward_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.7], [0.2])
    assert a[1] == pytest.approx(0.2 / 1e-3)
    assert kernel.internal_state_derivatives([0.0, 0.0], [0.0, 0.0], [0.2], [0.0, 0.7])[0] == pytest.approx(0.5 / 0.01)


BAD = {
    "drive = {}": "drive: there is nothing in it",
    "drive = { current_limit = 1.0, lag = 0.1 }": "drive.current_limit: there is no winding",
    "drive = { winding = { resistance = 1.0, inductance = 1e-3 } }": "torque_constant: it is missing",
    f"drive = {{ current_limit = 1.0, {WINDING.replace('= 1.0', '= 0.0', 1)} }}": "current_limit: the winding has no",
    "drive = { lag = 0.0 }": "drive.lag: got 0.0",
    f"drive = {{ lag = 0.1, {WINDING} }}": "drive.lag: there is a winding",
    "drive = { controller = { current = { kp = 1.0 } } }": "controller.current: there is no winding",
    "drive = { controller = { position = { limit = 1.0 } } }": "controller.position: there is no gain",
    "drive = { controller = { velocity = { kp = 1.0, kd = 1.0 } } }": "controller.velocity.kd: there is no filter",
    "drive = { controller = { kp = 1.0, filter = 1.0 } }": "controller.position.filter: there is no kd",
    "drive = { controller = { kp = 1.0, position = { kp = 1.0 } } }": "controller.kp: position has a table, too",
    "drive = { controller = { kp = 1.0, tracking_time = 1.0 } }": "tracking_time: there is no ki",
    "drive = { controller = { kp = 1.0, ki = 1.0, tracking_time = 1.0 } }": "nothing limits the output",
    "drive = { controller = { ki = 1.0, limit = 1.0 } }": "there is no kp and no tracking_time",
    'drive = { lag = 0.1 }, role = "prescribed"': "the motion is prescribed",
}


@pytest.mark.parametrize("table", BAD)
def test_tables_that_say_nothing_are_refused_by_name(table: str) -> None:
    caught = refused(DescriptionError, "", robot_from_toml, f"{AXIS}gamma = {{ {table} }}\n")
    assert BAD[table] in str(caught), str(caught)


def test_times_that_are_too_short_for_integrations_are_noted() -> None:
    """By checks and simulations: a lag of 1e-12 s takes millions of steps."""
    winding = WINDING.replace("inductance = 1e-3", "inductance = 1e-6")
    kinds = {
        "lag = 1e-12": ["drive.lag = 1e-12 s"],
        "lag = 1e-5, controller = { kp = 1.0, ki = 2.0 }": [],
        f"{winding}, controller = {{ velocity = {{ kp = 1.0, kd = 1.0, filter = 1e-9 }} }}": [
            "drive.controller.velocity.filter = 1e-09 s",
            "drive.winding: inductance / resistance = 1e-06 s",
        ],
    }
    for table, said in kinds.items():
        notes = short_time_notes(build_model(servo(table)).states)
        assert [note.partition(": integrations")[0] for note in notes] == [f"joints.joint1.gamma.{x}" for x in said]


def test_what_nothing_drives_has_no_drive() -> None:
    with pytest.raises(DescriptionError, match=r"joints\.joint1\.x\.drive: nothing drives 'joint1\.x'"):
        robot_from_toml(f"{AXIS}x = {{ stiffness = 1e5, drive = {{ lag = 0.1 }} }}\n")


def test_efforts_clip_forces_alone(built: Build) -> None:
    voltage = built(servo(DRIVES["voltage"][0], ", limits = { effort = 1.0 }"))
    with pytest.raises(InputError, match=r"saturate: joint1\.gamma has 1, but its drive takes a voltage"):
        voltage.rollout([0.0], [0.0], [1.0], dt=1e-3, steps=2, saturate={"joint1.gamma": 1.0}, z=[0.0])
    lag = built(servo("lag = 0.05", ", limits = { effort = 1.0 }"))
    motion = lag.rollout([0.0], [0.0], [5.0], duration=1.0, samples=1, saturate=True, z=[0.0])
    assert motion.z[-1, 0] == pytest.approx(1.0, abs=1e-4)


def test_linear_systems_have_drives(built: Build) -> None:
    """Free drives work about the state: eigenvalues, and responses to their inputs."""
    robot = servo(DRIVES["cascade"][0])
    kernel = built(robot)
    system = eomgen.analysis.linearize(robot, drives="free", inputs=["joint1.gamma"], outputs=["joint1.gamma"])
    zero, z = np.zeros(kernel.n), np.zeros(len(kernel.internal_states))
    by_q, by_v, by_u = kernel.calls.run("forward_dynamics_jacobian", None, (zero, zero, zero), z=z, whole=True)
    A = np.zeros((len(z) + 2,) * 2)
    A[0, 1] = 1.0
    A[1:, 0], A[1:, 1:] = by_q[:, 0], by_v
    np.testing.assert_allclose(system.A, A, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(system.B[1:, 0], by_u[:, 0], rtol=1e-9, atol=1e-9)
    slow = system.bode(frequencies=[1e-3]).H
    np.testing.assert_allclose(np.abs(slow), 1.0, atol=1e-2)  # the position follows its reference
    with pytest.raises(InputError, match=r"joint1\.gamma takes a reference of position"):
        eomgen.analysis.linearize(robot, drives="pd", kp=1.0)


def test_a_saturated_loop_is_said_where_a_linear_system_lacks_its_integral() -> None:
    robot = eomgen.load_robot(EXAMPLE)
    for u, lacks in (([0.1], ()), ([100.0], ("axis.gamma.drive.integral_velocity",))):
        system = eomgen.analysis.linearize(robot, [0.0], v=[0.0], u=u, outputs=["axis.gamma"])
        assert tuple(name for name in system.internal_states if name not in system.states) == lacks
        said = [note for note in system.notes if "are at a limit" in note]
        assert [note.partition(", ")[2].partition(":")[0] for note in said] == list(lacks)


@pytest.mark.parametrize("kp", [0.0, 5.0])
def test_forces_that_cancel_need_no_gain(kp: float) -> None:
    """A weight right above its pivot leaves 1e-16 N m, which a drive without gains need not exert."""
    text = EXAMPLE.read_text(encoding="utf-8").replace("gravity = [0.0, -9.81, 0.0]", "gravity = [-9.81, 0.0, 0.0]")
    robot = robot_from_toml(text)
    law = dict(robot.joints[0].coordinates)["gamma"]
    numbers = {key: x for key, x in law.further.items() if "winding" in key} | {"drive.controller.velocity.kp": kp}
    joint = replace(robot.joints[0], coordinates={"gamma": replace(law, further=numbers)})
    kernel = eomgen.build(replace(robot, joints=(joint,)))
    forces = [1e-15]
    assert np.abs(drives_at_rest(kernel, [np.pi], forces)[0]).max() < 1e-12
    if not kp:
        refused(IntegrationError, "its controller exerts none at rest", drives_at_rest, kernel, [np.pi], [1e-3])


def test_simulations_follow_references_from_rest(tmp_path: Path) -> None:
    """Integrals hold the weight at the start: nothing moves before the reference does."""
    robot = eomgen.load_robot(EXAMPLE)
    still = run_scenario(robot, scenario_from_toml("duration = 0.1\n"))
    motion = still.trajectory
    weight = 4.0 * 9.81 * 0.25
    assert np.abs(motion.q - motion.q[0]).max() < 1e-7
    np.testing.assert_allclose(motion.z[0], [weight / 6.0 / 80.0, 0.8 * weight / 6.0 / 800.0, weight / 6.0], rtol=1e-9)
    motion_text = '[motion]\ntype = "point_to_point"\nduration = 1.0\ngoal = { axis = 0.6 }\n'
    moved = run_scenario(robot, scenario_from_toml(f"duration = 1.5\n{motion_text}"))
    assert moved.trajectory.q[-1, 0] == pytest.approx(0.6, abs=1e-3)
    assert moved.trajectory.input_units == ("rad",)
    moved.save(tmp_path / "moved.npz")
    again = eomgen.load_result(tmp_path / "moved.npz").trajectory
    assert again.input_units == ("rad",)
    assert motion_columns(again)["axis.gamma.drive"][0] == "rad"
    assert moved.balance.relative_residue < 1e-5
    for control, named in (
        ('type = "pd"\nkp = 3.0\nkd = 1.0', r"axis\.gamma takes a reference of position, rad; allowed: reference"),
        ('type = "computed_torque"', r"axis\.gamma takes a reference of position"),
    ):
        with pytest.raises(DescriptionError, match=named):
            run_scenario(robot, scenario_from_toml(f"duration = 0.1\n[control]\n{control}\n"))
    with pytest.raises(DescriptionError, match=r"joint1\.gamma takes a voltage, V; allowed: a torque table"):
        run_scenario(servo(DRIVES["voltage"][0]), scenario_from_toml('duration = 0.1\n[control]\ntype = "reference"\n'))


def test_drives_of_references_and_of_forces_follow_one_motion() -> None:
    """The servo takes the reference, the other drive forces of the rigid model or of a PD law."""
    text = EXAMPLE.read_text(encoding="utf-8")
    robot = robot_from_toml(text)
    link, free = replace(robot.links[0], name="outer", mass=0.5), {"gamma": Coordinate(damping=0.1)}
    joint = replace(robot.joints[0], name="wrist", parent=robot.links[0].name, child="outer", coordinates=free)
    both = replace(robot, links=(*robot.links, link), joints=(*robot.joints, joint), sensors=(), frames=())
    moved = '[motion]\ntype = "point_to_point"\nduration = 0.5\ngoal = { axis = 0.3, wrist = -0.4 }\n'
    for control in ("", '[control]\ntype = "pd"\nkp = { wrist = 400.0 }\nkd = { wrist = 20.0 }\ngravity = true\n'):
        motion = run_scenario(both, scenario_from_toml(f"duration = 1.0\n{moved}{control}")).trajectory
        np.testing.assert_allclose(motion.q[-1], [0.3, -0.4], atol=2e-3)
        assert motion.input_units == ("rad", "N m")
    still = run_scenario(both, scenario_from_toml("duration = 0.1\n")).trajectory
    assert np.abs(still.q - still.q[0]).max() < 1e-6
    for control, named in (
        ('type = "reference"', r"wrist\.gamma takes a torque.*allowed: pd, computed_torque, under which drives that"),
        ('type = "pd"\nkp = { axis = 3.0 }\nkd = 1.0', r"control\.kp\.axis: its drive takes a reference"),
    ):
        with pytest.raises(DescriptionError, match=named):
            run_scenario(both, scenario_from_toml(f"duration = 0.1\n{moved}[control]\n{control}\n"))


LINKAGE = f"""
name = "driven_bar"
gravity = [0.0, -9.81, 0.0]
driven = ["crank.gamma"]
home = {{ "crank.gamma" = 0.9 }}
{link_table("a", 1.0, (0.1, 0.0, 0.0), (0.01, 0.01, 0.01))}
{link_table("b", 1.0, (0.25, 0.0, 0.0), (0.01, 0.03, 0.03))}
{link_table("c", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}
{joint_table("crank", "base", "a", "revolute")}
[joints.gamma.drive]
winding = {{ resistance = 1.0, inductance = 1e-3, torque_constant = 0.5 }}
voltage_limit = 60.0
controller = {{ velocity = {{ kp = 4.0, ki = 10.0 }}, current = {{ kp = 1.0, ki = 1000.0 }} }}
{joint_table("coupler", "a", "b", "revolute")}
placement = {{ xyz = [0.2, 0.0, 0.0] }}
gamma = {{ damping = 0.1 }}
{joint_table("rocker", "base", "c", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0] }}
gamma = {{ damping = 0.1 }}
{loop_table("pin", "b", "c", "revolute")}
placements = [{{ xyz = [0.5, 0.0, 0.0] }}, {{ xyz = [0.4, 0.0, 0.0] }}]
"""


def test_drives_move_closed_loops(built: Build) -> None:
    """Methods agree, works and energies balance, and derivatives are those of the accelerations."""
    kernel = built(robot_from_toml(LINKAGE))
    n, run = kernel.n, partial(kernel.calls.run, out=None, whole=True)
    begin = kernel.assemble([0.9, 0.0, 0.0], ["crank.gamma"])
    v, z = kernel.project_velocity(begin, [1.0, 0.0, 0.0], ["crank.gamma"]), np.array([0.1, 0.02, 0.5])
    state = begin, v, z, np.array([2.0, 0.0, 0.0]), np.array([0.3])
    _, by_v, by_u = run("forward_dynamics_jacobian", values=state)
    for k, slopes in ((2, by_v[:, n:]), (3, by_u[:, :n]), (4, by_u[:, n : n + 1])):
        for i, step in enumerate(1e-5 * np.eye(state[k].size)):
            ends = [(*state[:k], state[k] + s * step, *state[k + 1 :]) for s in (1.0, -1.0)]
            ahead, behind = (run("forward_dynamics", values=end) for end in ends)
            np.testing.assert_allclose(slopes[:, i], (ahead - behind) / 2e-5, rtol=1e-6, atol=1e-6)
    options: dict[str, Any] = {"duration": 1.0, "output_step": 0.25, "drive": [2.0, 0.0, 0.0]}
    motions = [
        integrate(kernel, begin, np.zeros(n), method=method, rtol=1e-9, works=method == "radau", **options)
        for method in ("radau", "rosenbrock", "tsit5", "scipy:Radau")
    ]
    for motion in motions[1:]:
        np.testing.assert_allclose(motion.q, motions[0].q, atol=1e-5)
    energy, works = motions[0].energy.sum(axis=1), motions[0].works
    assert np.abs(energy - energy[0] - works[:, 0] + works[:, 3]).max() < 1e-8 * np.abs(works).max()


UR5 = """
[joints.gamma.drive]
winding = { resistance = 0.8, inductance = 8e-4, torque_constant = %g }
current_limit = 12.0
voltage_limit = 48.0
[joints.gamma.drive.controller]
position = { kp = 12.0, limit = 2.0 }
velocity = { kp = %g, ki = %g }
current = { kp = 0.8, ki = 800.0 }
"""


@pytest.mark.soak
def test_six_servo_axes_follow_an_integration_to_twelve_digits(built: Build) -> None:
    """Of a robot arm: M and the bias are those of the arm without drives, and drives those of their own equations."""
    plain = eomgen.load_robot("ur5")
    drives, joints = [], []
    for joint in plain.joints:
        if joint.type != "revolute":
            joints.append(joint)
            continue
        strong = len(drives) < 3
        text = UR5 % ((12.0, 20.0, 200.0) if strong else (3.0, 4.0, 40.0))
        numbers = tomllib.loads("[[joints]]" + text)["joints"][0]["gamma"]["drive"]
        given = robot_from_toml(AXIS + text).joints[0].coordinates["gamma"].further
        coordinate = replace(joint.coordinates["gamma"], armature=0.3 if strong else 0.03, damping=1.0)
        joints.append(replace(joint, coordinates={"gamma": replace(coordinate, further=given)}))
        drives.append(numbers)
    robot = replace(plain, joints=tuple(joints))
    mechanical = [replace(x, coordinates={k: c.without_states() for k, c in x.coordinates.items()}) for x in joints]
    arm = built(replace(plain, joints=tuple(mechanical)), "mass_matrix", "inverse_dynamics")
    kernel = built(robot, "forward_dynamics", "rollout", "adaptive_rollout", "radau_rollout")
    n, names = 6, ("integral_velocity", "integral_current", "current")
    assert kernel.internal_states == tuple(f"{x}.drive.{name}" for x in kernel.coordinates for name in names)
    begin, goal = np.array([0.2, -1.0, 0.8, -0.5, 0.3, 0.1]), np.array([0.5, -1.4, 1.2, -0.2, 0.1, 0.4])

    def rates(_: float, y: Any) -> Any:
        q, v, z = y[:n], y[n : 2 * n], y[2 * n :].reshape(n, 3)
        found = [
            drive(numbers, q[i], v[i], dict(zip(names, z[i], strict=True)), goal[i]) for i, numbers in enumerate(drives)
        ]
        torque = np.array([force for force, _, _ in found])
        a = np.linalg.solve(arm.mass_matrix(q), torque - arm.inverse_dynamics(q, v, np.zeros(n)))
        return np.concatenate([v, a, [by[name] for _, by, _ in found for name in names]])

    t, y = np.linspace(0.0, 0.2, 5), np.concatenate([begin, np.zeros(n + 3 * n)])
    wanted = solve_ivp(rates, (0.0, 0.2), y, "DOP853", t, rtol=1e-12, atol=1e-13, max_step=1e-3).y.T
    size, zero = np.abs(wanted).max(axis=0) + 1e-6, np.zeros(3 * n)
    for method, rtol, bound in (("rosenbrock", 1e-8, 1e-4), ("radau", 1e-8, 1e-5), ("tsit5", 1e-8, 1e-5)):
        motion = kernel.rollout(begin, np.zeros(n), goal, duration=0.2, samples=4, method=method, rtol=rtol, z=zero)
        assert np.abs((np.hstack([*motion, motion.z]) - wanted) / size).max() < bound, method
