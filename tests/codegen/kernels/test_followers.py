"""Followers of rigid couplings are no coordinates: all kernels against the uncoupled tree, reduced in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.errors import InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import expand_tunable
from eomgen.robot.value import COORDINATES, Coordinate, Coupling, Joint, Robot
from tests.support.builds import Build
from tests.support.methods import method_of
from tests.support.random_followers import Reduction, with_followers
from tests.support.random_motors import motor_state, with_motors
from tests.support.random_robots import (
    Array,
    random_link,
    random_placement,
    random_robot,
    random_state,
    seeds,
    some_prescribed,
    with_offsets,
)
from tests.support.random_springs import with_springs
from tests.support.refusals import refused

KERNELS = (
    *("mass_matrix", "bias_force", "generalized_force", "external_force", "residual", "inverse_dynamics"),
    *("residual_jacobian", "coriolis_matrix", "christoffel", "kinematics", "energy", "reactions", "external_reactions"),
    *("regressor", "forward_dynamics", "forward_dynamics_jacobian", "coupling_forces", "external_coupling_forces"),
)
TIGHT = 1e-11


def sample(seed: int) -> tuple[Robot, Robot]:
    """A random robot with couplings, and without."""
    kinds = seed % 5
    robot = random_robot(seed, joints=(2, 4), max_coordinates=3, max_size=8, tree=bool(seed % 2), rods=False)
    if kinds == 1:
        robot = with_springs(robot, seed)
    if kinds == 2:
        robot = with_offsets(robot, seed)
    if kinds == 3:
        robot = some_prescribed(robot, seed)
    if kinds == 4:
        robot = with_motors(robot, seed)
    tries = (with_followers(robot, seed + 1000 * again, tuned=bool(seed % 3)) for again in range(100))
    return next(coupled for coupled in tries if coupled.couplings), robot


def near(found: Array, expected: Array, tolerance: float = TIGHT) -> None:
    size = max(1.0, float(np.abs(expected).max(initial=0.0)))
    assert found.shape == expected.shape
    assert np.abs(found - expected).max(initial=0.0) <= tolerance * size


@pytest.mark.parametrize("seed", [*seeds(1, 1, 59), *seeds(0, 0, 1)])
def test_kernels_are_those_of_the_tree_reduced(seed: int, built: Build) -> None:
    coupled, robot = sample(seed)
    map_ = Reduction.of(robot, coupled.couplings)
    kernel, tree = built(coupled, *KERNELS, *build_extras(coupled)), built(robot, *KERNELS[:-2], *build_extras(coupled))
    assert kernel.coordinates == map_.names
    assert kernel.constraints == ()
    rng = np.random.default_rng(seed)
    has_motors = any(joint.motor for joint in robot.joints)
    states = [motor_state(robot, 7 * seed + k) if has_motors else random_state(robot, rng) for k in range(7)]
    keep = [tree.coordinates.index(name) for name in kernel.coordinates]
    q, v, a, u = (np.array([getattr(state, name)[keep] for state in states]) for name in "qvau")
    Q, V, A = map_.positions(q), map_.motions(v), map_.motions(a)
    for name, (here, rate) in kernel.followers(q, v).items():
        near(here, Q[:, tree.coordinates.index(name)])
        near(rate, V[:, tree.coordinates.index(name)])
    for name, (here, rate) in kernel.followers(q[0], v).items():  # one state stands for all
        near(here, np.full(len(v), Q[0, tree.coordinates.index(name)]))
        near(rate, V[:, tree.coordinates.index(name)])
    near(kernel.mass_matrix(q), map_.matrix(tree.mass_matrix(Q)))
    near(kernel.bias_force(q, v), map_.forces(tree.bias_force(Q, V)))
    near(kernel.generalized_force(q, v), map_.forces(tree.generalized_force(Q, V)))
    near(kernel.inverse_dynamics(q, v, a), map_.forces(tree.inverse_dynamics(Q, V, A)))
    near(kernel.residual(q, v, a, u), map_.forces(tree.inverse_dynamics(Q, V, A)) - u)
    near(kernel.coriolis_matrix(q, v), map_.matrix(tree.coriolis_matrix(Q, V)))
    near(kernel.christoffel(q), np.einsum("Nabc,ai,bj,ck->Nijk", tree.christoffel(Q), map_.S, map_.S, map_.S))
    for found, expected in zip(kernel.residual_jacobian(q, v, a), tree.residual_jacobian(Q, V, A), strict=True):
        near(found, map_.matrix(expected))
    for found, expected in zip(kernel.energy(q, v).T, tree.energy(Q, V).T, strict=True):
        near(found, expected)
    near(kernel.reactions(q, v, a), tree.reactions(Q, V, A))
    for frame in (kernel.frames[0], kernel.frames[-1]):
        near(kernel.frame_pose(q, frame), tree.frame_pose(Q, frame))
        near(kernel.frame_jacobian(q, frame), tree.frame_jacobian(Q, frame) @ map_.S)
    wrench = rng.normal(size=(7, len(kernel.links), 6))
    near(kernel.functions.external_force(q, wrench), map_.forces(tree.functions.external_force(Q, wrench)))
    near(kernel.inverse_dynamics(q, v, a, wrench=wrench), map_.forces(tree.inverse_dynamics(Q, V, A, wrench=wrench)))
    if coupled.springs:
        near(kernel.functions.spring_jacobian(q), tree.functions.spring_jacobian(Q) @ map_.S)
        near(kernel.functions.spring_stiffness(q), map_.matrix(tree.functions.spring_stiffness(Q)))
    plain = kernel.inverse_dynamics(q, v, a) - kernel.inverse_dynamics(q, 0 * v, 0 * a)
    columns = kernel.functions.regressor(q, v, a) - kernel.functions.regressor(q, 0 * v, 0 * a)
    lawless = not any(c.law() or c.damping for joint in robot.joints for c in joint.all_coordinates.values())
    if lawless and not has_motors and not robot.springs:  # which have dampers of their own
        near(columns @ kernel.regressor_values, plain)
    accelerations(kernel, tree, map_, coupled, (q, v, u, wrench))


def build_extras(robot: Robot) -> tuple[str, ...]:
    return ("spring_jacobian", "spring_stiffness") if robot.springs else ()


def accelerations(
    kernel: eomgen.Kernel, tree: eomgen.Kernel, map_: Reduction, robot: Robot, states: tuple[Array, ...]
) -> None:
    """Accelerations and the couplings' forces by a dense solve of M A = f + J^T lambda, J A = 0 of all coordinates."""
    q, v, u, wrench = states
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    free = [i for i in range(kernel.n) if i not in given]
    Q, V = map_.positions(q), map_.motions(v)
    for outside in (None, wrench):
        a = kernel.forward_dynamics(q, v, u, wrench=outside)
        near(a[:, given], u[:, given], 0.0)
        bias = map_.forces(tree.inverse_dynamics(Q, V, 0 * V, wrench=outside))
        M = map_.matrix(tree.mass_matrix(Q))
        right = u - bias - np.einsum("Nij,Nj->Ni", M[:, :, given], u[:, given])
        if free:
            expected = np.linalg.solve(M[np.ix_(range(len(q)), free, free)], right[:, free, np.newaxis])[..., 0]
            near(a[:, free], expected, 1e-9)
        rows = np.zeros((len(robot.couplings), tree.n))
        for row, x in zip(rows, robot.couplings, strict=True):
            row[tree.coordinates.index(x.of)] = 1.0
            for name, ratio in x.to.items():
                row[tree.coordinates.index(name)] = -ratio
        needed = tree.inverse_dynamics(Q, V, map_.motions(a), wrench=outside)
        followers = [tree.coordinates.index(x.of) for x in robot.couplings]
        held = np.linalg.solve(rows[:, followers].T, needed[:, followers].T).T
        near(kernel.constraint_forces(q, v, u, wrench=outside), held, 1e-9)
    assert kernel.couplings == tuple(x.name for x in robot.couplings)
    by_q, by_v, by_u = kernel.forward_dynamics_jacobian(q, v, u)
    r_q, r_v, r_a = kernel.residual_jacobian(q, v, kernel.forward_dynamics(q, v, u))
    for found, slope in ((by_q, r_q), (by_v, r_v)):
        expected = np.zeros_like(found)
        inside = np.ix_(range(len(q)), free, free)
        expected[:, free] = -np.linalg.solve(r_a[inside], slope[:, free])
        near(found, expected, 1e-9)
    near(by_u[:, given][:, :, given], np.broadcast_to(np.eye(len(given)), (len(q), len(given), len(given))), 0.0)


def springy(seed: int) -> tuple[Robot, Robot]:
    """A random tree with springs and dampers, whose couplings' numbers are run-time parameters; and without these."""
    robot = random_robot(seed, joints=(3, 4), max_coordinates=2, max_size=6, tree=True, rods=False)
    tries = (with_followers(robot, seed + 1000 * again, tuned=True) for again in range(100))
    return next(coupled for coupled in tries if any(x.startswith("couplings.") for x in coupled.tunable)), robot


def slope_by(kernel: eomgen.Kernel, name: str, f: Callable[[eomgen.Kernel], Array], step: float = 1e-5) -> Array:
    """Central difference of order four of f by a parameter."""
    value = kernel.parameters[name]
    at = [f(kernel.replaced(parameters={name: value + k * step})) for k in (-2, -1, 1, 2)]
    return np.asarray((at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step))


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 20))
def test_derivatives_by_ratios_and_offsets(seed: int, built: Build) -> None:
    coupled, _ = springy(seed)
    kernel = built(coupled)
    rng = np.random.default_rng(seed)
    q, v, a, u = rng.uniform(-0.5, 0.5, (4, kernel.n))
    names = [name for name in kernel.parameters if name.startswith("couplings.")]
    assert names
    for function, args in (("inverse_dynamics", (q, v, a)), ("forward_dynamics", (q, v, u)), ("energy", (q, v))):
        exact = kernel.parameter_jacobian(function, args, names)
        for place, name in enumerate(names):

            def result(other: eomgen.Kernel, function: str = function, args: tuple[Array, ...] = args) -> Array:
                return np.asarray(method_of(other, function)(*args))

            near(exact[..., place], slope_by(kernel, name, result), 1e-7)
    weights = rng.normal(size=kernel.n)
    found = kernel.vjp("forward_dynamics", (q, v, u), weights)
    for slope, matrix in zip(found, kernel.forward_dynamics_jacobian(q, v, u), strict=True):
        near(slope, weights @ matrix, 1e-9)
    frame = kernel.frames[0]
    near(kernel.jvp("frame_pose", (q, frame), (v,))[:3, 3], kernel.frame_jacobian(q, frame)[:3] @ v)
    held = kernel.jvp("coupling_forces", (q, v, a), (v, a, u))
    h = 1e-6
    moved = [kernel.functions.coupling_forces(q + s * h * v, v + s * h * a, a + s * h * u) for s in (1.0, -1.0)]
    near(held, (moved[0] - moved[1]) / (2 * h), 1e-7)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 20))
def test_motions_are_those_of_the_tree_reduced(seed: int, built: Build) -> None:
    """Against SciPy's integration of accelerations that NumPy reduces; gradients against differences."""
    coupled, robot = springy(seed)
    map_ = Reduction.of(robot, coupled.couplings)
    kernel, tree = built(coupled), built(robot, "mass_matrix", "inverse_dynamics")
    rng = np.random.default_rng(seed)
    q0, v0 = rng.uniform(-0.3, 0.3, (2, kernel.n))
    u = rng.uniform(-1.0, 1.0, kernel.n)

    def rates(_: float, y: Array) -> Array:
        q, v = np.split(y, 2)
        Q, V = map_.positions(q), map_.motions(v)
        bias = map_.forces(tree.inverse_dynamics(Q, V, 0 * V))
        return np.concatenate([v, np.linalg.solve(map_.matrix(tree.mass_matrix(Q)), u - bias)])

    duration = 0.02
    end = solve_ivp(rates, (0.0, duration), np.concatenate([q0, v0]), method="Radau", rtol=1e-10, atol=1e-12).y[:, -1]
    for method, tolerance in (("rk4", 1e-6), ("implicit", 2e-2), ("rosenbrock", 1e-6), ("tsit5", 1e-6)):
        options = (
            {"dt": 1e-5, "steps": 2000}
            if method in ("rk4", "implicit")
            else {"duration": duration, "samples": 2, "rtol": 1e-9}
        )
        q, v = kernel.rollout(q0, v0, u, method=method, **options)
        near(np.concatenate([q[-1], v[-1]]), end, tolerance)
    names = [name for name in kernel.parameters if name.startswith("couplings.")]
    weights = rng.normal(size=kernel.n)

    def loss(_: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
        dq, dv = np.zeros_like(q), np.zeros_like(v)
        dq[-1] = weights
        return float(q[-1] @ weights), dq, dv

    for method in ("implicit", "rk4"):
        options = {"dt": 1e-4, "steps": 20, "method": method}
        _, slopes = kernel.rollout_gradient(q0, v0, u, loss=loss, parameters=names, **options)

        def result(other: eomgen.Kernel, options: dict[str, object] = options) -> Array:
            return np.asarray(other.rollout(q0, v0, u, **options)[0][-1] @ weights)

        for name in names:
            near(np.asarray(slopes[name]), slope_by(kernel, name, result, 1e-4), 1e-7)
    single = built(coupled, "forward_dynamics", "mass_matrix", dtype="float32")
    state = [x.astype(np.float32) for x in (q0, v0, u)]
    exact = kernel.forward_dynamics(*(x.astype(np.float64) for x in state))
    near(single.forward_dynamics(*state).astype(np.float64), exact, 1e-3)
    many = [np.tile(x, (9, 1)) + 0.01 * rng.normal(size=(9, kernel.n)) for x in (q0, v0, u)]
    each = [kernel.forward_dynamics(*state) for state in zip(*many, strict=True)]
    assert np.array_equal(kernel.forward_dynamics(*many), each)


def gripping_bars() -> Robot:
    """A four-bar whose coupler carries two fingers that open alike, and a flap that follows its crank and a finger."""
    robot = eomgen.load_robot("four_bar")
    rng = np.random.default_rng(3)
    links = [random_link(rng, name, rods=False) for name in ("left", "right", "flap")]
    given = {"left": Coordinate(50.0, 1.0), "flap": Coordinate(damping=0.1), "right": Coordinate()}
    left, flap, right = (
        Joint(name, parent, name, kind, random_placement(rng), coordinates={key: given[name]})
        for name, parent, kind, key in (
            ("left", "coupler", "prismatic", "z"),
            ("flap", "left", "revolute", "gamma"),
            ("right", "coupler", "prismatic", "z"),
        )
    )
    crank, coupler, rocker = robot.joints
    couplings = (
        Coupling("open", "right.z", {"left.z": -1.0}, 0.02),
        Coupling("turn", "flap.gamma", {"joint1.gamma": 0.5, "right.z": 2.0}),
    )
    driven = ("joint1.gamma", "left.z")
    return replace(
        robot, name="gripping", links=(*robot.links, *links), couplings=couplings,
        joints=(crank, coupler, left, flap, right, rocker),
        driven=driven, tunable=("couplings.turn.ratio",),
    )  # fmt: skip


@pytest.mark.soak
def test_loops_and_followers_go_together(built: Build) -> None:
    """Against the same mechanism whose couplings are rows of the constraint as the loop is."""
    robot = gripping_bars()
    robot = replace(robot, tunable=expand_tunable(robot, robot.tunable))
    kernel, whole = built(robot), built(robot.with_constraints())
    assert kernel.couplings == ("open", "turn")
    assert whole.constraints == (*kernel.constraints, "open", "turn")
    map_ = Reduction.of(robot, robot.couplings)
    rng = np.random.default_rng(1)
    for _ in range(3):
        q = kernel.assemble(
            np.array(build_model(robot).home) + 0.1 * rng.normal(size=kernel.n), ["joint1.gamma", "left.z"]
        )
        v = kernel.project_velocity(q, rng.normal(size=kernel.n), ["joint1.gamma", "left.z"])
        Q, V = map_.positions(q), map_.motions(v)
        assert np.abs(whole.functions.constraint(Q)).max() <= 1e-9
        near(kernel.functions.constraint_jacobian(q), (whole.functions.constraint_jacobian(Q) @ map_.S)[:-2])
        U = rng.normal(size=whole.n)
        u = map_.forces(U)
        a, A = kernel.forward_dynamics(q, v, u), whole.forward_dynamics(Q, V, U)
        near(map_.motions(a), A, 1e-8)
        drives = kernel.inverse_dynamics(q, v, a)
        near(kernel.forward_dynamics(q, v, drives), a, 1e-8)
        for name in ("left", "right", "flap"):
            place = kernel.joints.index(name)
            near(kernel.reactions(q, v, a)[place], whole.reactions(Q, V, A)[place], 1e-8)
        near(kernel.functions.coupling_forces(q, v, a), kernel.constraint_forces(q, v, u)[-2:], 1e-9)
        assert kernel.constraint_forces(q, v, u).shape == whole.constraint_forces(Q, V, U).shape
        J, forces = kernel.functions.constraint_jacobian(q), kernel.constraint_forces(q, v, u)[:-2]
        near(kernel.residual(q, v, a, u), J.T @ forces, 1e-8)
        held = np.zeros(whole.n)  # without drives of followers, which the leaders' coupling bears
        near(whole.constraint_forces(Q, V, held)[-2:], kernel.constraint_forces(q, v, map_.forces(held))[-2:], 1e-7)
        for found, expected in zip(
            kernel.forward_dynamics_jacobian(q, v, u)[:2], whole.forward_dynamics_jacobian(Q, V, U)[:2], strict=True
        ):
            ways = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :].T  # motions that keep the loop closed
            near(map_.S @ found @ ways, expected @ map_.S @ ways, 1e-5)
    for method in ("implicit", "rk4"):
        end = [x[-1] for x in kernel.rollout(q, v, u, 1e-4, 50, method=method)]
        other = [x[-1] for x in whole.rollout(Q, V, U, 1e-4, 50, method=method)]
        near(map_.positions(end[0]), other[0], 1e-6)
        near(map_.motions(end[1]), other[1], 1e-5)


@pytest.mark.parametrize("seed", seeds(1, 1, 20))
def test_elastic_couplings_of_followers_are_those_of_the_tree(seed: int, built: Build) -> None:
    """A spring with backlash and a damper between what follows and what leads."""
    coupled, robot = springy(seed)
    rng = np.random.default_rng(seed)
    followers = [x.of for x in coupled.couplings]
    other = next(name for name in build_model(coupled).coordinates)
    law = Coordinate(stiffness=300.0, damping=2.0, clearance=0.02)
    belt = Coupling("belt", followers[-1], {other: 0.7, **dict.fromkeys(followers[:-1][:1], 0.4)}, 0.05, law)
    kernels = ("generalized_force", "energy", "residual_jacobian", "cut_forces", "cut_jacobian", "mass_matrix")
    whole = replace(coupled, couplings=(*coupled.couplings, belt))
    kernel = built(whole, *kernels, "forward_dynamics", "inverse_dynamics", "rollout")
    tree = built(replace(robot, couplings=(belt,)), *kernels, "inverse_dynamics")
    map_ = Reduction.of(robot, coupled.couplings)
    q, v, a, u = rng.uniform(-0.5, 0.5, (4, 6, kernel.n))
    Q, V, A = map_.positions(q), map_.motions(v), map_.motions(a)
    near(kernel.generalized_force(q, v), map_.forces(tree.generalized_force(Q, V)))
    near(kernel.energy(q, v), tree.energy(Q, V))
    near(kernel.functions.cut_forces(q, v), tree.functions.cut_forces(Q, V))
    near(kernel.functions.cut_jacobian(q), tree.functions.cut_jacobian(Q) @ map_.S)
    for found, expected in zip(kernel.residual_jacobian(q, v, a), tree.residual_jacobian(Q, V, A), strict=True):
        near(found, map_.matrix(expected))
    bias = map_.forces(tree.inverse_dynamics(Q, V, 0 * V))
    expected = np.linalg.solve(map_.matrix(tree.mass_matrix(Q)), (u - bias)[..., np.newaxis])[..., 0]
    near(kernel.forward_dynamics(q, v, u), expected, 1e-9)
    ends = [kernel.rollout(q[0], v[0], u[0], 1e-5, 200, method=method)[0][-1] for method in ("implicit", "rk4")]
    near(ends[0], ends[1], 1e-3)


QUANTITIES = ("gravity", "nonlinear_effects", "bias_force", "center_of_mass", "centroidal_momentum")
DERIVATIVES = ("center_of_mass_tangent", "centroidal_momentum_tangent")
MOTIONS = ("frame_velocities", "frame_accelerations", "frame_velocities_tangent", "kinematics", "imu")
GENERALIZED = ("generalized_momentum", "mass_matrix", "coriolis_matrix")
LIMIT = {"float64": 1e-12, "float32": 2e-4}


def moving_mass(robot: Robot) -> float:
    """Sum of the masses of the links that move."""
    model = build_model(robot)
    return sum(robot.link(name).mass for name in model.links)


def check(kernel: eomgen.Kernel, robot: Robot, q: Array, v: Array) -> None:
    """The weight's power, linear momentum as mass times the center's velocity, the bias with and without gravity."""
    mass, limit = moving_mass(robot), LIMIT[str(kernel.dtype)]
    velocity = kernel.jvp("center_of_mass", (q,), (v,))
    gravity, momentum = kernel.gravity(q), kernel.centroidal_momentum(q, v)
    scale = 1.0 + np.abs(momentum).max()
    assert np.abs(momentum[:3] - mass * velocity).max() <= limit * scale
    power = -mass * np.dot(robot.gravity, velocity)
    assert abs(gravity @ v - power) <= limit * (1.0 + np.abs(gravity) @ np.abs(v))
    both, bias = kernel.nonlinear_effects(q, v), kernel.bias_force(q, v)
    assert np.abs(both - bias - gravity).max() <= limit * (1.0 + np.abs(both).max() + np.abs(bias).max())


def check_generalized(kernel: eomgen.Kernel, q: Array, v: Array) -> None:
    """The momentum by the mass matrix, and what its rate has of the kinetic energy."""
    momentum, work = kernel.functions.generalized_momentum(q, v)
    for found, expected in ((momentum, kernel.mass_matrix(q) @ v), (work, kernel.coriolis_matrix(q, v).T @ v)):
        assert np.abs(found - expected).max() <= LIMIT[str(kernel.dtype)] * (1.0 + np.abs(expected).max())


def check_frames(kernel: eomgen.Kernel, robot: Robot, q: Array, v: Array, a: Array) -> None:
    """Velocities by Jacobians, accelerations as their rates; what IMUs read, by both."""
    limit = LIMIT[str(kernel.dtype)]
    velocities, accelerations = kernel.functions.frame_velocities(q, v), kernel.functions.frame_accelerations(q, v, a)
    expected = np.array([kernel.frame_jacobian(q, frame) @ v for frame in kernel.frames])
    assert np.abs(velocities - expected).max() <= limit * (1.0 + np.abs(expected).max())
    rates = kernel.jvp("frame_velocities", (q, v), (v, a))
    size = 1.0 + np.abs(rates).max() + np.abs(velocities).max() ** 2
    assert np.abs(accelerations - rates).max() <= limit * size
    R = np.array([kernel.frame_pose(q, frame)[:3, :3] for frame in kernel.frames])
    force = accelerations[:, :3] - np.array(robot.gravity)
    read = np.concatenate([np.einsum("kij,ki->kj", R, x) for x in (force, velocities[:, 3:])], axis=1)
    assert np.abs(kernel.functions.imu(q, v, a) - read).max() <= limit * (size + np.abs(force).max())


@pytest.mark.parametrize("seed", seeds(0, 1, 40))
def test_followers_springs_offsets_motors_and_prescribed_coordinates(seed: int, built: Build) -> None:
    robot, _ = sample(seed)
    kernel, rng = built(robot, *QUANTITIES, *DERIVATIVES, *MOTIONS, *GENERALIZED), np.random.default_rng(seed)
    for _ in range(4):
        q, v, a = rng.uniform(-1.0, 1.0, (3, kernel.n))
        check(kernel, robot, q, v)
        check_frames(kernel, robot, q, v, a)
        check_generalized(kernel, q, v)


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_batches_have_the_bits_of_single_states(dtype: str, built: Build) -> None:
    robot = random_robot(4, joints=(3, 4), tree=True)
    kernel = built(robot, *QUANTITIES, *DERIVATIVES, *MOTIONS, *GENERALIZED, dtype=dtype)
    q, v, a = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 9, kernel.n)).astype(dtype)
    for name, count in (
        *dict.fromkeys(QUANTITIES, 2).items(),
        *((x, 2) for x in ("frame_velocities", "generalized_momentum")),
        ("frame_accelerations", 3),
        ("imu", 3),
    ):
        call, arrays = method_of(kernel, name), (q, v, a)[: 1 if name in ("gravity", "center_of_mass") else count]
        assert np.array_equal(call(*arrays), np.stack([call(*state) for state in zip(*arrays, strict=True)]))
    check(kernel, robot, q[0], v[0])
    check_frames(kernel, robot, q[0], v[0], a[0])
    check_generalized(kernel, q[0], v[0])


def test_references_of_frames(built: Build) -> None:
    """States of any shape; a point of the link at the base's origin; another reference is refused by name."""
    robot = random_robot(4, joints=(3, 4), tree=True)
    kernel = built(robot, *MOTIONS)
    q, v, a = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 2, 3, kernel.n))
    for reference in ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"):
        velocity = kernel.frame_velocity(q, v, "tcp", reference)
        acceleration = kernel.frame_acceleration(q, v, a, "tcp", reference)
        assert velocity.shape == acceleration.shape == (2, 3, 6)
        assert np.allclose(velocity[1, 2], kernel.frame_velocity(q[1, 2], v[1, 2], "tcp", reference), rtol=1e-14)
        h = 1e-6
        ahead, behind = (kernel.frame_velocity(q + s * h * v, v + s * h * a, "tcp", "WORLD") for s in (1, -1))
        bias = kernel.frame_acceleration(q, v, 0.0 * a, "tcp", reference)
        if reference == "LOCAL_WORLD_ALIGNED":
            J, J_ahead, J_behind = (kernel.frame_jacobian(q + s * h * v, "tcp") for s in (0, 1, -1))
            assert np.allclose(bias, ((J_ahead - J_behind) / (2 * h) @ v[..., np.newaxis])[..., 0], atol=1e-7)
            assert np.allclose(acceleration, (J @ a[..., np.newaxis])[..., 0] + bias, atol=1e-12)
        if reference == "WORLD":
            assert np.allclose(acceleration, (ahead - behind) / (2 * h), atol=1e-7)
    with pytest.raises(InputError, match=r"reference: 'world'; allowed: LOCAL_WORLD_ALIGNED, LOCAL, WORLD"):
        kernel.frame_velocity(q, v, "tcp", "world")  # type: ignore[arg-type]
    refused(UnknownNameError, "frame: 'tpc' is unknown", kernel.frame_acceleration, q, v, a, "tpc")


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(20, 1, 10))
def test_a_flying_robot_keeps_its_momentum_but_for_its_weight(seed: int, built: Build) -> None:
    """Of its rate under forces within: the weight, and no moment about the center of mass."""
    robot = random_robot(seed, joints=(3, 4), rods=False)
    first = replace(robot.joints[0], type="free", coordinates=dict.fromkeys(COORDINATES, Coordinate()))
    robot = replace(robot, joints=(first, *robot.joints[1:]))
    kernel = built(robot, "forward_dynamics", *QUANTITIES, *DERIVATIVES)
    state = random_state(robot, seed)
    place = [kernel.coordinates.index(f"{first.name}.{kind}") for kind in COORDINATES]
    u = state.u.copy()
    u[place] = 0.0
    a = kernel.forward_dynamics(state.q, state.v, u)
    rate = kernel.jvp("centroidal_momentum", (state.q, state.v), (state.v, a))
    expected = np.concatenate([moving_mass(robot) * np.array(robot.gravity), np.zeros(3)])
    size = np.abs(a).max() * moving_mass(robot) + np.abs(expected).max()
    assert np.abs(rate - expected).max() <= 1e-10 * size


def test_masses_as_run_time_parameters(built: Build) -> None:
    """They move the center without a new kernel."""
    robot = eomgen.load_robot("one_link")
    tuned = replace(robot, tunable=("links.link1.mass", "links.link1.com.x"))
    kernel = built(tuned, "center_of_mass")
    q = np.array([0.1, 0.4])
    before = kernel.center_of_mass(q)
    kernel.parameters["links.link1.mass"] *= 3.0
    assert np.allclose(kernel.center_of_mass(q), before, rtol=1e-15)
    kernel.parameters["links.link1.com.x"] += 0.5
    link_x = np.array([np.cos(q[1]), np.sin(q[1]), 0.0])
    assert np.allclose(kernel.center_of_mass(q) - before, 0.5 * link_x, atol=1e-15)


def test_a_robot_without_mass_has_no_center(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    light = replace(robot, links=tuple(replace(link, mass=0.0, com=(0.0, 0.0, 0.0)) for link in robot.links))
    refused(InputError, r"no link of one_link that moves has mass", built, light, "center_of_mass")
