"""Springs between points: Pinocchio's external forces, MuJoCo's tendons, complex steps, the laws of mechanics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.tree.bound import bind
from eomgen.codegen.tree.frames import choose_frames
from eomgen.errors import InputError
from eomgen.integration.plan import choose_method
from eomgen.integration.solve import integrate
from eomgen.integration.steps import fixed_step
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, Placement, Robot, Spring
from eomgen.state.equilibrium import static_equilibrium
from tests.oracles.mujoco_models import MujocoRobot
from tests.oracles.springs import SpringOracle, implicit_step, pulled
from tests.support.added_forces import check_batches, check_jacobians, check_oracle
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.elastic_robots import elastic_robot
from tests.support.pendulums import pendulum
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.random_springs import sprung, with_springs
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

NAMES = ("inverse_dynamics", "residual", "generalized_force", "forward_dynamics", "energy", "reactions")


@pytest.mark.parametrize("seed", seeds(2000, 1, 12))
def test_forces_are_external_forces_in_pinocchio(seed: int, built: Build) -> None:
    """Rows, accelerations, energy, reactions, lengths and tensions; one state at a time, and several on vectors."""
    robot = sprung(seed)
    kernel, oracle = built(robot, *NAMES, "mass_matrix"), SpringOracle(robot)
    states = [random_state(robot, seed + i) for i in range(9)]
    for s in states:
        check_oracle(kernel, oracle, s)
        assert close(kernel.reactions(s.q, s.v, s.a), oracle.reactions(s.q, s.v, s.a))
        assert close(kernel.functions.spring_forces(s.q, s.v), oracle.forces(s.q, s.v))
        assert close(kernel.functions.spring_jacobian(s.q), oracle.jacobian(s.q))
        assert close(kernel.functions.spring_stiffness(s.q), oracle.stiffness(s.q))
    check_batches(kernel, states, inverse_dynamics=3, spring_forces=2, energy=2)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(2090, 1, 4))
def test_frames_that_move_take_points_along(seed: int, built: Build) -> None:
    """Rigid chains, whose body frames the generator shifts and turns; C without a warning."""
    robot = with_springs(random_robot(seed, joints=(3, 5), types=("revolute", "prismatic"), rigid=True), seed)
    model = build_model(robot)
    bound = bind(model, lambda _, number: number, lambda x: (np.sin(x), np.cos(x)))
    moved = choose_frames(model, bound)
    assert any(a.ends != b.ends for a, b in zip(bound.elements["springs"], moved.elements["springs"], strict=True))
    kernel, oracle = built(robot, *NAMES, flags=("-O0", "-Werror")), SpringOracle(robot)
    for i in range(5):
        s = random_state(robot, seed + i)
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), oracle.inverse_dynamics(s.q, s.v, s.a))
        assert close(kernel.reactions(s.q, s.v, s.a), oracle.reactions(s.q, s.v, s.a))
        assert close(kernel.energy(s.q, s.v), oracle.energy(s.q, s.v))


@pytest.mark.parametrize("seed", seeds(2020, 1, 8))
def test_derivatives_are_exact(seed: int, built: Build) -> None:
    """Complex steps through the program of the residual, and M times the derivatives of forward dynamics."""
    robot = sprung(seed, (1, 3))
    check_jacobians(robot, [random_state(robot, seed + i) for i in range(3)], built)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(2040, 1, 3))
def test_rows_are_the_gradient_of_energy(seed: int, built: Build) -> None:
    """Pinocchio's and the quadrature's energy, differences of eighth order."""
    robot = sprung(seed, (1, 3), forces=False)
    robot = replace(robot, springs=tuple(replace(s, damping=None) for s in robot.springs if s.name != "spring6"))
    kernel, oracle = built(robot, "generalized_force"), SpringOracle(robot)
    s, h, still = random_state(robot, seed), 5e-3, np.zeros(kernel.n)
    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    for i, unit in enumerate(np.eye(kernel.n)):
        parts = [
            w * (oracle.energy(s.q + k * h * unit, still)[1] - oracle.energy(s.q - k * h * unit, still)[1])
            for k, w in enumerate(weights, 1)
        ]
        assert kernel.generalized_force(s.q, still)[i] == pytest.approx(-sum(parts) / h, rel=1e-6, abs=1e-5)


@pytest.mark.soak
@pytest.mark.parametrize("seed", soaked((21, 22, 23), (22,)))
def test_mujocos_tendons_do_the_same(seed: int, built: Build) -> None:
    """Springs, dampers, a spring of free length 0 and a cable that MuJoCo has with a kink."""
    robot = elastic_robot(seed, joints=3, tree=seed > 21)
    robot = with_springs(robot, seed, ("linear", "zero damped", "damper", "cable"))
    states = [random_state(robot, 100 * seed + i) for i in range(20)]
    median = float(np.median([SpringOracle(robot).forces(s.q, s.v)[3, 0] for s in states]))
    cable = replace(robot.springs[3], damping=None, smoothing=1e-9, free_length=median)
    robot = replace(robot, springs=(*robot.springs[:3], cable))
    kernel, oracle = (
        built(robot, "inverse_dynamics", "energy", "generalized_force"),
        MujocoRobot(robot, approximate=True),
    )
    taut = []
    for s in states:
        expected = oracle.inverse_dynamics(s.q, s.v, s.a)
        assert np.abs(kernel.inverse_dynamics(s.q, s.v, s.a) - expected).max() <= 1e-8 * np.abs(expected).max()
        assert close(kernel.functions.spring_forces(s.q, s.v)[:, 0], np.array(oracle.data.ten_length), 1e-12)
        assert close(kernel.functions.spring_jacobian(s.q) @ s.v, np.array(oracle.data.ten_velocity), 1e-11)
        assert close(kernel.energy(s.q, s.v), oracle.energy(s.q, s.v), 1e-8)
        taut.append(kernel.functions.spring_forces(s.q, s.v)[3, 1] > 0.0)
    assert sum(taut) == 10


@pytest.mark.soak
def test_motion_is_mujocos(built: Build) -> None:
    robot = with_springs(elastic_robot(31, joints=2), 31, ("linear", "zero damped"))
    kernel = built(robot, "forward_dynamics", "energy", "rollout")
    rng = np.random.default_rng(31)
    q, v, u = rng.uniform(-0.1, 0.1, 12), rng.uniform(-0.3, 0.3, 12), rng.uniform(-3.0, 3.0, 12)
    states = MujocoRobot(robot, step=1e-4).trajectory(q, v, u, steps=5000, every=500)
    qs, vs = kernel.rollout(q, v, u, 1e-4, 5000, every=500)
    assert np.abs(np.hstack([qs, vs]) - states).max() <= 1e-10


def test_a_spring_of_free_length_zero_balances_a_pendulum(built: Build) -> None:
    """k = m g l / (a b), the textbook's: no torque anywhere, and the sum of energies does not depend on the angle."""
    mass, com, a, b = 2.0, 0.3, 0.25, 0.1
    spring = Spring("balance", ("base", "rod"), ((0.0, a, 0.0), (b, 0.0, 0.0)), stiffness=mass * 9.81 * com / (a * b))
    kernel = built(pendulum((spring,), mass, com), "inverse_dynamics", "energy")
    angles, still = np.linspace(-np.pi, np.pi, 101)[:, None], np.zeros((101, 1))
    assert np.abs(kernel.inverse_dynamics(angles, still, still)).max() <= 1e-13 * mass * 9.81 * com
    assert np.ptp(kernel.energy(angles, still)[:, 1]) <= 1e-12
    kernel.parameters["springs.balance.stiffness"] *= 2.0
    twice = kernel.inverse_dynamics(angles, still, still)[:, 0]
    assert close(twice, -mass * 9.81 * com * np.cos(angles[:, 0]), 1e-12)


@pytest.mark.soak
def test_points_that_meet_give_finite_forces(built: Build) -> None:
    """Length 0: no force of a free length of 0, whatever law; and no NaN of any."""
    for number, spring in enumerate((
        Spring("s", ("base", "rod"), stiffness=1e3),
        Spring("s", ("base", "rod"), stiffness=1e3, damping=5.0),
        Spring("s", ("base", "rod"), stiffness=1e3, damping=5.0, free_length=0.2),
        Spring("s", ("base", "rod"), stiffness=1e3, damping=5.0, free_length=0.2, tension_only=True),
        Spring("s", ("base", "rod"), curve=((-0.2, -5.0), (0.0, 0.0), (0.3, 8.0)), damping=1.0),
    )):  # fmt: skip
        robot = pendulum((replace(spring, points=((0.5, 0.0, 0.0), (0.5, 0.0, 0.0))),))
        kernel = built(replace(robot, name=f"meet{number}"), *NAMES, "residual_jacobian")
        q, v, a = np.zeros(1), np.array([1.5]), np.array([0.5])
        bare = built(replace(robot, name="bare", springs=()), "inverse_dynamics")
        assert kernel.inverse_dynamics(q, v, a) == pytest.approx(bare.inverse_dynamics(q, v, a), abs=1e-9)
        results = (
            kernel.energy(q, v),
            kernel.reactions(q, v, a),
            kernel.functions.spring_forces(q, v),
            kernel.functions.spring_jacobian(q),
        )
        for found in (*results, *kernel.residual_jacobian(q, v, a)):
            assert np.isfinite(found).all()
        single = built(replace(robot, name=f"meet{number}"), "residual_jacobian", dtype="float32")
        assert all(np.isfinite(x).all() for x in single.residual_jacobian(*(y.astype(np.float32) for y in (q, v, a))))


def test_a_linear_spring_of_free_length_zero_divides_by_nothing() -> None:
    """Neither root nor quotient in its kernels."""
    robot = pendulum((Spring("s", ("base", "rod"), ((0.0, 0.2, 0.0), (0.1, 0.0, 0.0)), stiffness=10.0),))
    for name in ("inverse_dynamics", "energy", "residual_jacobian", "reactions"):
        assert derive(build_model(robot), name).count()["div"] == 0


def test_a_cable_goes_slack_and_taut(built: Build) -> None:
    """A mass thrown up on a cable: free flight while slack, and the whole motion is SciPy's with branches."""
    link = Link("block", 2.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    joint = Joint("rail", "base", "block", "prismatic", coordinates={"z": Coordinate()})
    cable = Spring(
        "rope", ("base", "block"), ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), free_length=0.8, stiffness=3e3, damping=15.0,
        tension_only=True, smoothing=0.01,
    )  # fmt: skip
    robot = Robot("hung", (0.0, 0.0, -9.81), (link,), (joint,), springs=(cable,))
    kernel = built(robot, "rollout", "energy", "forward_dynamics")
    q, v = kernel.rollout(np.array([0.3]), np.array([2.0]), np.zeros(1), dt=1e-5, steps=150_000, every=100)
    length, T = kernel.functions.spring_forces(q, v)[:, 0].T
    slack = length <= 0.8
    assert np.all(T[slack] == 0.0)
    assert np.all(T >= 0.0)
    assert 0.2 < slack.mean() < 0.9
    assert np.count_nonzero(np.diff(slack.astype(int))) >= 3
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.max(np.diff(energy)) <= 1e-6 * np.ptp(energy)
    assert np.ptp(energy[: np.argmin(slack)]) <= 1e-9

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], -9.81 + pulled(cable, 1.0 - y[0], -y[1]) / 2.0]

    expected = solve_ivp(rate, (0.0, 1.5), [0.3, 2.0], rtol=1e-10, atol=1e-12, max_step=1e-3)
    assert q[-1, 0] == pytest.approx(expected.y[0, -1], abs=1e-6)
    assert v[-1, 0] == pytest.approx(expected.y[1, -1], abs=1e-5)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(2050, 1, 2))
def test_energy_is_conserved(seed: int, built: Build) -> None:
    """Without dampers; curves, cables and springs of free length 0 among them."""
    robot = sprung(seed, (2, 3), forces=False)
    robot = replace(robot, springs=tuple(replace(s, damping=None) for s in robot.springs if s.name != "spring6"))
    kernel, s = built(robot, "rollout", "energy", "forward_dynamics"), random_state(robot, seed)
    q, v = kernel.rollout(0.3 * s.q, 0.3 * s.v, np.zeros(kernel.n), dt=2e-5, steps=10_000, every=100)
    energy = kernel.energy(q, v)
    assert np.ptp(energy[:, 0]) > 0.1
    assert np.ptp(energy.sum(axis=1)) <= 1e-6 * np.ptp(energy[:, 0])


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(2060, 1, 4))
def test_implicit_steps_are_those_of_the_formula(seed: int, built: Build) -> None:
    robot = sprung(seed)
    kernel = built(robot, "rollout", "forward_dynamics", "mass_matrix", "bias_force", "generalized_force")
    s, dt = random_state(robot, seed), 0.02
    q, v = s.q, s.v
    for _ in range(3):
        v = v + dt * implicit_step(robot, kernel, q, v, s.u, dt)
        q = q + dt * v
    qs, vs = kernel.rollout(s.q, s.v, s.u, dt, 3, method="implicit")
    assert close(qs[-1], q, 1e-6)
    assert close(vs[-1], v, 1e-6)


def test_implicit_steps_are_stable_whatever_the_stiffness(built: Build) -> None:
    """A cable of 1e9 N/m at a step of 1 ms, a hundred times too long for an explicit method."""
    cable = Spring(
        "stop", ("base", "rod"), ((0.0, 1.0, 0.0), (0.5, 0.0, 0.0)), free_length=1.2, stiffness=1e9, tension_only=True
    )
    kernel = built(pendulum((cable,), damping=0.5), "rollout", "forward_dynamics", "energy")
    q, v = kernel.rollout(np.zeros(1), np.zeros(1), np.zeros(1), dt=1e-3, steps=6000, method="implicit")
    inertia = 0.05 + 2.0 * 0.09
    assert np.abs(v).max() < np.sqrt(2.0 * 9.81 * 2.0 * 0.3 / inertia)  # of a fall by a quarter turn
    assert np.abs(v[-1000:]).max() < 1e-3 * 9.81 * 2.0 * 0.3 / inertia  # what the weight gives in a step
    length = kernel.functions.spring_forces(q, v)[:, 0, 0]
    assert length.max() <= 1.2 + 1e-3 * np.abs(v).max()  # the way of one step
    assert length[-1000:] == pytest.approx(1.2, abs=2e-5)


@pytest.mark.soak
def test_default_steps_know_a_stiff_cable(built: Build) -> None:
    """Slack at the start: rk4 has a step that stays stable when it gets taut; its damper counts, too."""
    cable = Spring(
        "stop", ("base", "rod"), ((0.0, 1.0, 0.0), (0.5, 0.0, 0.0)), free_length=1.2, stiffness=1e8, tension_only=True,
        smoothing=1e-3,
    )  # fmt: skip
    kernel = built(pendulum((cable,)), "forward_dynamics", "inverse_dynamics", "energy", "mass_matrix")
    assert choose_method(kernel) == "scipy:Radau"
    times = np.array([0.0, 1.0])
    stiffness, inertia = 1e8 * 0.25, 0.05 + 2.0 * 0.09
    assert fixed_step(kernel, np.zeros(1), None, times) == pytest.approx(0.5 / np.sqrt(stiffness / inertia))
    found = integrate(kernel, np.zeros(1), np.zeros(1), 0.6, method="rk4")
    energy = found.energy.sum(axis=1)
    assert kernel.functions.spring_forces(found.q, found.v)[:, 0, 1].max() > 100.0
    assert np.ptp(energy) <= 1e-3 * np.ptp(found.energy[:, 0])
    assert np.abs(integrate(kernel, np.zeros(1), np.zeros(1), 0.1).q[-1] - found.q[100]).max() < 1.0
    damper = Spring("d", ("base", "rod"), ((0.0, 0.5, 0.0), (0.5, 0.0, 0.0)), damping=1e5)
    slow = built(replace(pendulum((damper,)), name="slow"), "forward_dynamics", "energy", "mass_matrix")
    assert choose_method(slow) == "scipy:DOP853"
    arm = slow.functions.spring_jacobian(np.zeros(1))[0, 0]
    assert fixed_step(slow, np.zeros(1), None, times) == pytest.approx(0.5 * inertia / (1e5 * arm * arm))
    end = integrate(slow, np.zeros(1), np.zeros(1), 0.05, method="rk4")
    assert np.abs(end.v).max() < 1e-2


def test_equilibrium_is_where_moments_vanish(built: Build) -> None:
    spring = Spring("s", ("base", "rod"), ((0.0, 0.8, 0.0), (0.5, 0.0, 0.0)), free_length=0.5, stiffness=60.0)
    robot = pendulum((spring,))
    kernel, oracle = built(robot, "inverse_dynamics", "mass_matrix"), SpringOracle(robot)
    q, _ = static_equilibrium(kernel, np.array([-0.2]))
    assert np.abs(oracle.inverse_dynamics(q, np.zeros(1), np.zeros(1))).max() <= 1e-9
    assert abs(q[0]) > 0.01


def test_what_moves_both_points_has_no_row() -> None:
    """A spring between the second and the third link of a chain: nothing is computed for the first joint."""
    links = tuple(Link(f"l{i}", 1.0, (0.1, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)) for i in range(3))
    names = ("base", "l0", "l1", "l2")
    joints = tuple(
        Joint(
            f"j{i}", names[i], names[i + 1], "revolute", Placement((0.4, 0.0, 0.0)), coordinates={"gamma": Coordinate()}
        )
        for i in range(3)
    )
    robot = Robot("chain", (0.0, -9.81, 0.0), links, joints)
    spring = Spring("s", ("l1", "l2"), ((0.1, 0.2, 0.0), (0.2, 0.0, 0.0)), free_length=0.1, stiffness=5.0)
    program = derive(build_model(replace(robot, springs=(spring,))), "spring_jacobian")
    assert program.instructions[program.outputs["out", 0]].leaf == 0.0
    assert program.instructions[program.outputs["out", 1]].leaf == 0.0
    assert {i.leaf for i in program.instructions if i.op == "input" and i.leaf[0] == "q"} == {("q", 2)}


@pytest.mark.soak
def test_numbers_are_parameters(built: Build) -> None:
    """Set at run time they give what a description with these numbers gives."""
    robot = sprung(2070, (2, 2))
    tunable = tuple(f"springs.spring1.points.{i}.{axis}" for i in range(2) for axis in "xyz")
    kernel = built(replace(robot, tunable=tunable), *NAMES)
    changed = []
    for spring in robot.springs:
        numbers = {
            key: 1.3 * getattr(spring, key) for key in ("stiffness", "damping", "free_length", "smoothing")
            if getattr(spring, key) is not None
        }  # fmt: skip
        kernel.parameters.update({f"springs.{spring.name}.{key}": value for key, value in numbers.items()})
        if spring.curve is not None:
            numbers["curve"] = tuple((x, 2.0 * y) for x, y in spring.curve)
            names = {f"springs.{spring.name}.curve.{i}": y for i, (_, y) in enumerate(numbers["curve"])}
            kernel.parameters.update(names)
        changed.append(replace(spring, **numbers))
    points = ((0.1, -0.2, 0.3), (0.05, 0.4, -0.1))
    changed[0] = replace(changed[0], points=points)
    kernel.parameters.update(dict(zip(tunable, (*points[0], *points[1]), strict=True)))
    oracle, s = SpringOracle(replace(robot, springs=tuple(changed))), random_state(robot, 2070)
    assert close(kernel.inverse_dynamics(s.q, s.v, s.a), oracle.inverse_dynamics(s.q, s.v, s.a))
    assert close(kernel.reactions(s.q, s.v, s.a), oracle.reactions(s.q, s.v, s.a))
    for key in ("stiffness", "free_length", "damping"):
        with pytest.raises(InputError, match=f"springs.spring1.{key} = -1.0 is negative"):
            kernel.parameters[f"springs.spring1.{key}"] = -1.0
    with pytest.raises(InputError, match=r"springs.spring4.smoothing = 0.0 is too small"):
        kernel.parameters["springs.spring4.smoothing"] = 0.0


def test_rigid_robots_leave_out_what_cannot_move() -> None:
    robot = eomgen.load_robot("balanced_arm")
    mount = Joint("mount", "fore", "hand", "fixed", coordinates={"x": Coordinate(stiffness=1e4)})
    hand = Link("hand", 0.1, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0))
    inner = Spring("inner", ("fore", "hand"), stiffness=10.0)
    robot = replace(
        robot, links=(*robot.links, hand), joints=(*robot.joints, mount), springs=(*robot.springs, inner),
        tunable=("springs.inner.points.0.x", "springs.stop.points.0.x"),
    )  # fmt: skip
    rigid = robot.rigid()
    assert [spring.name for spring in rigid.springs] == ["balance", "tendon", "stop"]
    assert rigid.tunable == ("springs.stop.points.0.x",)
    assert len(build_model(rigid).robot.springs) == 3


def test_spring_kernels_are_for_robots_with_springs() -> None:
    model = build_model(eomgen.load_robot("one_link"))
    with pytest.raises(InputError, match=r"'spring_forces' is for robots with \[\[springs\]\], and one_link has none"):
        derive_equations(model, ("spring_forces",))
