"""Damping of joints' own motions: against rotations, complex steps, linear systems, and through all packages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.description.load import robot_from_toml
from eomgen.integration.plan import choose_method
from eomgen.pictures import report_of
from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.model import build_model
from eomgen.robot.value import ANGULAR, COORDINATES, Coordinate, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.state.elements import damping_diagonal, damping_forces
from tests.support.added_forces import (
    NAMES,
    check_closed_form,
    check_forces,
    check_slopes,
    check_step,
    products,
    stacked,
)
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import Array, random_robot, random_state, seeds, some_prescribed
from tests.support.random_springs import with_springs
from tests.support.small_robots import free_body

STEP = 1e-30


def damped(seed: int, joints: tuple[int, int] = (1, 3), **given: object) -> Robot:
    """A random robot whose joints have damping and offsets of angles; every third one moves in all directions."""
    rng, found = np.random.default_rng(seed), []
    robot = random_robot(seed, joints=joints, types=("revolute", "fixed", "free"), max_coordinates=3, **given)  # type: ignore[arg-type]
    for number, joint in enumerate(robot.joints):
        table = dict(joint.coordinates)
        if number % 3 == 0 and table:
            table |= {name: table.get(name, Coordinate()) for name in ANGULAR}
        linear, angular = rng.uniform(0.5, 3.0, 2).tolist()
        made = JointDamping(linear, angular).left_with(table)
        offset = tuple(float(rng.uniform(-0.5, 0.5)) if rng.random() < 0.3 else None for _ in COORDINATES)
        found.append(replace(joint, coordinates=table, damping=made, offset=offset))
    return replace(robot, joints=tuple(found))


def without(robot: Robot) -> Robot:
    return replace(robot, joints=tuple(replace(joint, damping=None) for joint in robot.joints))


def metrics(robot: Robot, q: Array) -> Array:
    """D of forces -D v, (n, n): of every joint the squares of both velocities, by complex steps of its pose."""
    names = build_model(robot).coordinates
    total = np.zeros((len(names),) * 2)
    for joint in robot.joints:
        own = [i for i, name in enumerate(names) if name.rpartition(".")[0] == joint.name]
        if joint.damping is None or not own:
            continue

        def pose(x: Array, joint: eomgen.robot.Joint = joint, own: list[int] = own) -> tuple[Array, Array]:
            given = dict(zip(joint.coordinates, x[own], strict=True))
            values = [given.get(k, 0.0) + (o or 0.0) for k, o in zip(COORDINATES, joint.offset, strict=True)]
            turn = np.eye(3)
            for axis, angle in enumerate(values[3:]):
                turn = turn @ about(axis, angle)
            return np.array(values[:3]), turn

        still = pose(q.astype(complex))[1].real
        for i in own:
            for j in own:
                (x, R), (y, S) = (pose(q + STEP * 1j * np.eye(len(q))[k]) for k in (i, j))
                moved = x.imag @ y.imag / STEP**2 if i in own else 0.0
                turned = 0.5 * np.trace((still.T @ R.imag).T @ (still.T @ S.imag)) / STEP**2
                total[i, j] += (joint.damping.linear or 0.0) * moved + (joint.damping.angular or 0.0) * turned
    return total


def about(axis: int, angle: complex) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = np.eye(3, dtype=complex)
    found[i, i], found[i, j], found[j, i], found[j, j] = c, -s, s, c
    return found


@pytest.mark.parametrize("seed", [*seeds(2300, 1, 4), *seeds(2305, 0, 7)])  # 2304 ends in a rod without inertia
def test_forces_take_the_power_of_both_velocities(seed: int, built: Build) -> None:
    robot = damped(seed)
    states = [random_state(robot, seed + i) for i in range(9)]
    forces = [-metrics(robot, s.q) @ s.v for s in states]
    assert np.abs(forces).max() > 0.1
    kernel, _ = check_forces(robot, without(robot), states, forces, [0.0] * 9, built)
    q, v = stacked(states)
    assert close(damping_forces(kernel, q, v), -np.array(forces))
    assert close(damping_diagonal(kernel), np.diagonal(metrics(robot, q[0])))


@pytest.mark.parametrize("seed", seeds(2320, 1, 15))
def test_slopes_are_those_of_the_forces(seed: int) -> None:
    robot = damped(seed, (1, 2))
    check_slopes(robot, random_state(robot, seed))


@pytest.mark.soak
def test_closed_form_has_it() -> None:
    robot = random_robot(2331, joints=(1, 1), types=("fixed",), counts=(0,))
    table = dict.fromkeys(("x", *ANGULAR), Coordinate())
    joint = replace(robot.joints[0], coordinates=table, damping=JointDamping(0.5, 0.7))
    robot = replace(robot, joints=(joint,), links=robot.links[:1])
    check_closed_form(robot, random_state(robot, 1))
    texts = {str(letter.symbol): letter.unit for letter in readable_closed_form(build_model(robot)).letters}
    assert texts[f"b_angular_{joint.name}"] == "N m s/rad"
    assert texts[f"b_linear_{joint.name}"] == "N s/m"


@pytest.mark.parametrize("kind", ["alone", "prescribed", "springs"])
@pytest.mark.parametrize("seed", seeds(2340, 1, 12))
def test_an_implicit_step_is_the_linear_system(seed: int, kind: str) -> None:
    """(M + dt D) a = u - D v - bias, with what the robot without damping of joints has beside them."""
    robot, dt = damped(seed, (1, 2) if kind == "alone" else (2, 2)), 0.05
    robot = {"prescribed": some_prescribed, "springs": with_springs}.get(kind, lambda robot, _: robot)(robot, seed)
    s = random_state(robot, seed)
    D = metrics(robot, s.q)
    check_step(robot, without(robot), s, dt, lambda a: -D @ (s.v + dt * a))


def ball(damping: JointDamping | None, *names: str, **changes: object) -> Robot:
    """A body that hangs on a joint of these coordinates."""
    body = free_body()
    joint = replace(
        body.joints[0],
        name="ball",
        type="fixed",
        coordinates=dict.fromkeys(names or ANGULAR, Coordinate()),
        damping=damping,
    )
    return replace(body, joints=(replace(joint, **changes),))


@pytest.mark.parametrize("method", ["implicit", "rosenbrock"])
def test_a_damping_without_end_holds_still(method: str, built: Build) -> None:
    """1e9 N m s/rad: the matrix has the damping, off its diagonal, too."""
    kernel = built(ball(JointDamping(angular=1e9)), *NAMES, "rollout", "adaptive_rollout", "mass_matrix")
    q0, v0 = np.array([0.3, 0.8, -0.4]), np.array([1.0, -2.0, 3.0])
    steps = {"dt": 0.01, "steps": 100} if method == "implicit" else {"duration": 1.0, "samples": 1, "rtol": 1e-4}
    q, v = kernel.rollout(q0, v0, np.zeros(3), method=method, **steps)
    assert np.abs(q[-1] - q0).max() < 1e-6
    assert np.abs(v[-1]).max() < 1e-6
    assert choose_method(kernel) == "auto"


def test_what_does_not_turn_another_axis_is_a_hinges_damping(built: Build) -> None:
    """Two angles one behind the other; and the free ends of the damping's numbers."""
    hinges = {"alpha": Coordinate(damping=0.3), "beta": Coordinate(damping=0.3)}
    one = built(ball(JointDamping(angular=0.3), "alpha", "beta"), *NAMES)
    other = built(ball(None, coordinates=hinges), *NAMES)
    s = random_state(ball(None, "alpha", "beta"), 3)
    assert close(one.inverse_dynamics(s.q, s.v, s.a), other.inverse_dynamics(s.q, s.v, s.a))


def test_what_it_costs() -> None:
    """A few products, and nothing where it is not."""
    assert 0 < products(ball(JointDamping(angular=0.5))) - products(ball(None)) <= 6


TUMBLER = f"""
name = "tumbler"
{link_table("body", 1.0, inertia=(0.01, 0.02, 0.03))}
{joint_table("root", "base", "body", "free")}
damping = {{ linear = 2.0, angular = 0.1 }}
"""


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_a_simulation_balances_its_energy() -> None:
    """Through the pole of its angles; what is lost was taken by the damping."""
    scenario = scenario_from_toml(
        "duration = 1.0\n[integrator]\nrtol = 1e-9\n"
        "[initial.v]\n'root.beta' = 20.0\n'root.x' = 1.0\n'root.gamma' = 1.0\n"
    )
    robot = robot_from_toml(TUMBLER)
    result = eomgen.run_scenario(robot, scenario)
    assert np.abs(np.cos(result.trajectory.q[:, 4])).min() < 0.4  # where other angles are taken
    assert result.balance.relative_residue < 1e-6
    assert result.balance.of("dissipated")[-1] > 0.1
    assert "root.damping" in report_of(result, modes=False).html()
