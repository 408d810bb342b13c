"""Static equilibrium, of springs and of servo drives; the sizes that coordinates have under springs."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis.frequency import response
from eomgen.analysis.matrices import linearize
from eomgen.analysis.modal import modes
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import ArrayError, IntegrationError, UnknownNameError
from eomgen.integration.plan import choose_method
from eomgen.loops.equilibrium import closed_equilibrium
from eomgen.robot.internal_states.standstill import standstill_of
from eomgen.robot.value import Coordinate
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from eomgen.state import drives_at_rest, static_equilibrium
from eomgen.state.springs import coordinate_sizes, stiffnesses
from tests.support.bristled import served_arm
from tests.support.builds import Build
from tests.support.drive_reference import drive, loops_of
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.refusals import refused
from tests.support.soak import soaked
from tests.support.swinging import MASS, NEEDED, STIFFNESS, elastic_arm, oscillator

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")]


def test_sizes_of_coordinates(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    sizes, rates = coordinate_sizes(kernel, np.zeros(1))
    assert sizes == pytest.approx(10.0 / 400.0)
    assert rates == pytest.approx(10.0 / 20.0)
    kernel.parameters["joints.slide.z.stiffness"] = 0.0
    assert [x.tolist() for x in coordinate_sizes(kernel, np.zeros(1))] == [[1.0], [1.0]]
    assert not stiffnesses(kernel).any()
    assert choose_method(kernel) == "scipy:DOP853"


def test_a_spring_under_gravity_hangs_where_it_must(built: Build) -> None:
    kernel = built(oscillator(gravity=-9.81), *NEEDED)
    q, u = static_equilibrium(kernel, [0.3])
    assert q == pytest.approx(-9.81 * MASS / STIFFNESS, rel=1e-12)
    assert u == [0.0]
    q, _ = static_equilibrium(kernel, [0.0], u=[9.81 * MASS])
    assert q == pytest.approx(0.0, abs=1e-15)
    q, u = static_equilibrium(kernel, [0.3], fixed=["slide.z"])
    assert q == [0.3]
    assert u == pytest.approx(STIFFNESS * 0.3 + 9.81 * MASS)


@pytest.mark.parametrize("seed", soaked(range(5, 9), (5, 8)))
def test_static_equilibrium_has_no_acceleration(seed: int, built: Build) -> None:
    kernel = built(elastic_arm(seed), *NEEDED, "residual", "external_force")
    zero = np.zeros(kernel.n)
    wrench = np.random.default_rng(seed).uniform(-2.0, 2.0, (len(kernel.links), 6))
    for held in ((), ("joint1.gamma", "joint2.gamma")):
        q, u = static_equilibrium(kernel, zero, wrench=wrench, fixed=held)
        assert np.abs(kernel.residual(q, zero, zero, u, wrench=wrench)).max() < 1e-11 * 400.0
        assert np.abs(kernel.forward_dynamics(q, zero, u, wrench=wrench)).max() < 1e-8
        free = [name not in held for name in kernel.coordinates]
        assert not u[free].any()
        assert np.abs(q).max() > 1e-3


def test_equilibrium_under_a_drive_that_depends_on_the_state(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    q, u = static_equilibrium(kernel, np.zeros(kernel.n), u=lambda q: 1.0 - 50.0 * q)
    assert u == pytest.approx(1.0 - 50.0 * q)
    assert np.abs(kernel.forward_dynamics(q, np.zeros(kernel.n), u)).max() < 1e-8


def test_what_nothing_holds_is_named(built: Build) -> None:
    robot = oscillator(gravity=-9.81)
    loose = replace(robot, joints=(replace(robot.joints[0], coordinates={"x": Coordinate(10.0), "z": Coordinate()}),))
    kernel = built(loose, *NEEDED)
    for options, error, message in (
        ({}, IntegrationError, r"nothing holds slide\.z"),
        ({"fixed": ["slide.y"]}, UnknownNameError, r"fixed: 'slide\.y' is unknown"),
        ({"u": lambda _q: np.zeros(5), "fixed": ["slide.z"]}, ArrayError, "u: expected forces of shape"),
    ):
        refused(error, message, static_equilibrium, kernel, [0.0, 0.0], **options)


# Servo drives


EXAMPLE = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
WINDING = "winding = { resistance = 1.5, inductance = 1e-3, torque_constant = 0.5 }"
IDEAL = "winding = { resistance = 0.0, inductance = 1e-3, torque_constant = 0.5 }"
LIMITS = "current_limit = 5.0, voltage_limit = 6.0"
P, PI = "kp = 20.0", "kp = 20.0, ki = 5.0"
TABLES = [  # drives of all kinds
    "lag = 0.05",
    WINDING,
    f"{WINDING}, {LIMITS}",
    f"{IDEAL}, {LIMITS}",
    f"{WINDING}, {LIMITS}, controller = {{ current = {{ {P} }} }}",
    f"{WINDING}, {LIMITS}, controller = {{ current = {{ {PI}, kd = 1e-3, filter = 0.01 }} }}",
    f"{IDEAL}, {LIMITS}, controller = {{ current = {{ {P} }} }}",
    f"{IDEAL}, {LIMITS}, controller = {{ {P} }}",
    f"{WINDING}, {LIMITS}, controller = {{ {P}, kd = 0.3 }}",
    f"{WINDING}, {LIMITS}, controller = {{ {PI}, kd = 0.3, filter = 0.01, limit = 4.0 }}",
    f"{WINDING}, {LIMITS}, controller = {{ position = {{ {P}, limit = 3.0 }}, velocity = {{ {PI}, limit = 4.5 }},"
    f" current = {{ {PI} }} }}",
    f"{WINDING}, controller = {{ position = {{ {P} }}, velocity = {{ {P}, kd = 0.1, filter = 0.02 }},"
    f" current = {{ {P}, limit = 8.0 }} }}",
    "controller = { kp = 30.0, kd = 1.0, limit = 5.0 }",
    "controller = { kd = 1.0 }",
    "controller = { position = { kp = 3.0 }, velocity = { kd = 0.2, filter = 0.01 } }",
    "lag = 0.1, controller = { velocity = { kp = 3.0, ki = 10.0, limit = 2.0, tracking_time = 0.2 } }",
    "lag = 0.1, controller = { velocity = { kp = 3.0, limit = 2.0 } }",
    "controller = { position = { ki = 2.0, limit = 1.0, tracking_time = 0.5 }, velocity = { kp = 4.0 } }",
]
NAMES = ("filter_position", "integral_position", "filter_velocity", "integral_velocity", "filter_current")
NAMES = (*NAMES, "integral_current", "current", "force", "input")

ARM = f"""
name = "arm"
gravity = [0.0, -9.81, 0.0]
{link_table("arm", 2.0, (0.2, 0.0, 0.0), (0.01, 0.05, 0.05))}
{frame_table("tcp", "arm", (0.5, 0.0, 0.0))}
{joint_table("axis", "base", "arm", "revolute")}
"""


def _numbers(table: str) -> dict[str, float]:
    """Return the numbers of a table by the names that laws have for them."""
    numbers = dict[str, float]()

    def flat(prefix: str, value: object) -> None:
        if isinstance(value, dict):
            for key, one in value.items():
                flat(f"{prefix}.{key}", one)
        else:
            assert isinstance(value, (int, float))
            numbers[prefix] = float(value)

    read = tomllib.loads(f"drive = {{ {table} }}")["drive"]
    read = {**read, **({"controller": loops_of(read)} if "controller" in read else {})}
    flat("drive", read)
    return numbers


@pytest.mark.parametrize("table", TABLES)
def test_a_drive_rests_with_what_follows_from_its_force(table: str) -> None:
    """Input and states for a force: all rates vanish, and it is the force; beyond the limit it cannot be exerted."""
    one, described = standstill_of(_numbers(table)), tomllib.loads(f"drive = {{ {table} }}")["drive"]
    most = one.greatest if math.isfinite(one.greatest) else 7.0
    for share in (0.0, 0.3, -0.99, 1.0):
        force, s = (share * most if math.isfinite(one.compliance) else 0.0), 0.4
        z = dict.fromkeys(NAMES, 0.0) | {name: force * x for name, x in one.states.items()}
        exerted, rates, _ = drive(described, s, 0.0, z, one.input(force, s))
        assert exerted == pytest.approx(force, abs=1e-12)
        assert one.can_exert(force)
        for name, rate in rates.items():
            assert rate == pytest.approx(0.0, abs=1e-9), name
        if one.compliance:
            assert one.force(one.input(force, s), s) == pytest.approx(force, rel=1e-12, abs=1e-12)
    assert math.isinf(one.greatest) == (one.limit == "")
    if one.limit:
        assert not one.can_exert(1.001 * one.greatest)
        beyond = one.input(1.5 * one.greatest, 0.4)
        z = dict.fromkeys(NAMES, 0.0) | {name: 1.5 * one.greatest * x for name, x in one.states.items()}
        exerted, rates, _ = drive(described, 0.4, 0.0, z, beyond)
        still = all(abs(rate) < 1e-9 for rate in rates.values())
        assert not (still and exerted == pytest.approx(1.5 * one.greatest))
        if one.compliance:
            assert one.force(beyond, 0.4) == one.greatest


def _arm(table: str, more: str = "") -> eomgen.Robot:
    return robot_from_toml(f"{ARM}gamma = {{ drive = {{ {table} }}{more} }}\n")


@pytest.mark.parametrize(
    ("table", "u"),
    [
        (f"{WINDING}, controller = {{ position = {{ {P} }}, velocity = {{ {PI} }}, current = {{ {PI} }} }}", 0.3),
        (f"{WINDING}, controller = {{ position = {{ {P} }}, velocity = {{ {P} }}, current = {{ {P} }} }}", 0.3),
        ("lag = 0.05, controller = { kp = 300.0, kd = 1.0 }", -0.2),
        ("lag = 0.05", 3.0),
        (WINDING, 8.0),
        (f"{WINDING}, controller = {{ velocity = {{ {PI} }} }}", 0.0),
    ],
)
def test_equilibria_are_states_that_stay(table: str, u: float, built: Build) -> None:
    kernel = built(_arm(table))
    q, forces = static_equilibrium(kernel, [0.25], u=[u])
    under, z = drives_at_rest(kernel, q, forces)
    assert under == pytest.approx([u], rel=1e-7, abs=1e-9)
    assert forces == pytest.approx(9.81 * 0.4 * np.cos(q), rel=1e-9)
    assert kernel.functions.drive_forces(q, [0.0], [u], z) == pytest.approx(forces, rel=1e-7)
    assert kernel.forward_dynamics(q, [0.0], [u], z) == pytest.approx([0.0], abs=1e-6)
    rates = kernel.internal_state_derivatives(q, [0.0], z, [u])
    assert rates == pytest.approx(np.zeros(len(z)), abs=1e-4)
    if "ki" in table:
        assert q == pytest.approx([u if "position" in table else 0.25], abs=1e-12)
    elif "position" in table or "kp = 300.0" in table:
        assert abs(q[0] - u) > 1e-3  # the steady error that holds the load


def test_wrenches_act_beside_drives(built: Build) -> None:
    kernel = built(load_robot(EXAMPLE))
    q, forces = static_equilibrium(kernel, [0.0], u=[0.3], wrench={"tcp": [0.0, -20.0, 0.0, 0.0, 0.0, 0.0]})
    assert forces == pytest.approx([(9.81 + 10.0) * np.cos(0.3)])
    assert q == pytest.approx([0.3])
    held, needed = static_equilibrium(kernel, [0.7], u=[0.3], fixed=["axis.gamma"])
    assert (held, needed) == (pytest.approx([0.7]), pytest.approx([9.81 * np.cos(0.7)]))


def test_limits_that_cannot_hold_are_said_by_name(built: Build) -> None:
    kernel, weak = built(load_robot(EXAMPLE)), built(_arm("controller = { kp = 300.0, limit = 2.0 }"))
    moving = built(_arm(f"{WINDING}, controller = {{ velocity = {{ {PI} }} }}"))
    damped = built(_arm("controller = { kd = 1.0 }"))
    push = {"tcp": [0.0, -200.0, 0.0, 0.0, 0.0, 0.0]}
    for call, error, said in (
        (
            lambda: static_equilibrium(kernel, [0.0], u=[0.0], wrench=push),
            IntegrationError,
            r"axis\.gamma would have to exert 109\.8 N m, drive\.current_limit leaves 72 N m; allowed: another pose",
        ),
        (
            lambda: drives_at_rest(kernel, [0.0], [80.0]),
            IntegrationError,
            r"axis\.gamma would have to exert 80 N m, drive\.current_limit",
        ),
        (
            lambda: static_equilibrium(weak, [0.1], u=[0.1]),
            IntegrationError,
            r"exert 3\.9\d* N m, drive\.controller\.position\.limit leaves 2 N m",
        ),
        (
            lambda: static_equilibrium(moving, [0.1], u=[0.5]),
            IntegrationError,
            r"axis\.gamma has a reference of velocity of 0\.5 rad/s, .*allowed: 0",
        ),
        (lambda: drives_at_rest(damped, [0.0], [1.0]), IntegrationError, "its controller exerts none at rest"),
        (lambda: drives_at_rest(kernel, [0.0], [1.0, 2.0]), ArrayError, r"forces: expected float64 of shape \(1,\)"),
    ):
        refused(error, said, call)
    q, forces = static_equilibrium(weak, [1.4], u=[3.0])  # its limit holds the arm up elsewhere
    assert (forces[0], q[0]) == (pytest.approx(2.0), pytest.approx(np.arccos(2.0 / 3.924)))


def test_linear_systems_know_the_inputs_and_states_that_hold_the_load(built: Build) -> None:
    """Also with a steady error: about the state nothing moves, and A is the difference of the equations there."""
    robot = served_arm()
    kernel = built(robot)
    n = len(kernel.coordinates)
    system = linearize(robot, {"j1": 0.3, "j2": 0.4}, kernel=kernel, inputs=["j2.gamma"])
    assert kernel.forward_dynamics(system.q, 0 * system.q, system.u, system.z) == pytest.approx(np.zeros(n), abs=1e-7)
    assert kernel.internal_state_derivatives(system.q, 0 * system.q, system.z, system.u) == pytest.approx(
        0 * system.z, abs=1e-7
    )
    assert system.z[[name.endswith("drive.current") for name in kernel.internal_states]].all()
    place = kernel.coordinates.index("j2.gamma")
    assert system.u[place] == pytest.approx(system.q[place])  # its velocity loop leaves no error
    ends = []
    for sign in (1.0, -1.0):
        u = system.u.copy()
        u[place] += sign * 1e-6
        ends.append(kernel.internal_state_derivatives(system.q, 0 * system.q, system.z, u))
    assert system.B[2 * n :, 0] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6, abs=1e-6)
    again = linearize(robot, {"j1": 0.3, "j2": 0.4}, kernel=kernel, inputs=["j2.gamma"], z=system.z)
    assert (again.A == system.A).all()
    locked = linearize(robot, {"j1": 0.3, "j2": 0.4}, kernel=kernel, drives="locked")
    assert not locked.z.any()
    assert locked.u[place] != system.u[place]


def test_analyses_say_which_limits_cannot_hold() -> None:
    weak = _arm("controller = { kp = 300.0, limit = 2.0 }")
    for analysis in (
        lambda: linearize(weak),
        lambda: modes(weak, drives="free"),
        lambda: response(weak, ["axis.gamma"], ["tcp.y"], [1.0], drives="free"),
    ):
        refused(IntegrationError, r"drive\.controller\.position\.limit leaves 2 N m", analysis)
    assert modes(weak, drives="locked").eigenvalues.size == 0


def test_a_motion_is_linear_about_inputs_of_its_drives(built: Build) -> None:
    """Under u at a state with currents: accelerations are those of u, and slopes those of its limits."""
    robot = load_robot(EXAMPLE)
    kernel = built(robot)
    z = [0.01, 1e-3, 2.0]
    for u, free in ((0.35, True), (2.0, False)):
        system = linearize(robot, [0.3], v=[0.2], u=[u], z=z, kernel=kernel, inputs=["axis.gamma"])
        assert system.a == pytest.approx(kernel.forward_dynamics([0.3], [0.2], [u], z))
        assert system.u == pytest.approx([u])
        assert system.B.any() == free  # beyond the limit of its velocity the reference does nothing
        assert (system.A[2:, 0] != 0.0).any() == free
        x0 = np.array([0.3, 0.2, *z])

        def rates(x: np.ndarray, u: float = u) -> np.ndarray:
            q, v = x[:1], x[1:2]
            return np.r_[
                v, kernel.forward_dynamics(q, v, [u], x[2:]), kernel.internal_state_derivatives(q, v, x[2:], [u])
            ]

        expected = np.array([(rates(x0 + h) - rates(x0 - h)) / 2e-6 for h in 1e-6 * np.eye(5)]).T
        names = ("axis.gamma", "axis.gamma.rate", *kernel.internal_states)
        part = [names.index(name) for name in system.states]
        assert (len(part) == 5) == free  # the velocity's integral goes its own way there
        expected = expected[np.ix_(part, part)]
        assert pytest.approx(expected, rel=1e-5, abs=1e-5 * np.abs(expected).max()) == system.A


def test_a_mechanism_rests_under_its_drive(built: Build) -> None:
    text = (Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml").read_text(encoding="utf-8")
    for loop in (PI, P):
        table = f"drive = {{ lag = 0.01, controller = {{ kp = 400.0{', ki = 5.0' if loop == PI else ''} }} }}"
        changed = text.replace('name = "joint1"\n', f'name = "joint1"\ngamma = {{ {table} }}\n', 1)
        assert changed != text
        kernel = built(robot_from_toml(changed))
        guess = np.array(kernel.home)
        place = kernel.coordinates.index("joint1.gamma")
        u = np.zeros_like(guess)
        u[place] = guess[place] + 0.05
        q = closed_equilibrium(kernel, guess, u=u)
        forces = kernel.inverse_dynamics(q, 0 * q, 0 * q, z=np.zeros(len(kernel.internal_states)))
        if loop == PI:
            holding = forces[place]
        under, z = drives_at_rest(kernel, q, forces)
        assert under[place] == pytest.approx(u[place], abs=1e-7)
        assert (abs(q[place] - u[place]) < 1e-12) == (loop == PI)
        assert kernel.forward_dynamics(q, 0 * q, u, z) == pytest.approx(0 * q, abs=1e-6)
    weak = table.replace("400.0", "400.0, ki = 5.0, limit = 1e-3")
    closed = built(robot_from_toml(text.replace('name = "joint1"\n', f'name = "joint1"\ngamma = {{ {weak} }}\n', 1)))
    said = rf"joint1\.gamma would have to exert {abs(holding):.4g} N m, .*position\.limit leaves 0\.001 N m"
    refused(IntegrationError, said, closed_equilibrium, closed, guess, u=u)


def test_simulations_begin_with_the_steady_error(built: Build) -> None:
    """A controller without an integral: the arm sags as its gain has it, and stays there."""
    robot = _arm(f"{WINDING}, voltage_limit = 30.0, controller = {{ kp = 400.0, kd = 20.0 }}")
    scenario = "duration = 0.2\n[initial]\nq = { axis = 0.3 }\nequilibrium = true\n[control]\ntype = 'reference'\n"
    result = run_scenario(robot, scenario_from_toml(scenario))
    q = result.motion.q[:, 0]
    assert np.ptp(q) < 1e-7
    sag = 0.3 - q[0]
    assert sag == pytest.approx(9.81 * 0.4 * np.cos(q[0]) / 0.5 * 1.5 / 400.0, rel=1e-6)
    pushed = scenario + "[[wrenches]]\nlink = 'arm'\nforce = [0.0, -5.0, 0.0]\n"
    moved = run_scenario(robot, scenario_from_toml(pushed)).motion.q[:, 0]
    assert np.ptp(moved) < 1e-7
    assert moved[0] < q[0]
    heavy = scenario + "[[wrenches]]\nlink = 'arm'\npoint = [0.5, 0.0, 0.0]\nforce = [0.0, -50.0, 0.0]\n"
    said = r"axis\.gamma would have to exert .* N m, drive\.voltage_limit leaves 10 N m"
    refused(IntegrationError, said, run_scenario, robot, scenario_from_toml(heavy))
