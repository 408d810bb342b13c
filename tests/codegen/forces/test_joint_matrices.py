"""Stiffness and damping matrices of joints: against linear algebra, beams, MuJoCo and Lagrange."""

from __future__ import annotations

import pickle
import warnings
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import sympy as sp

import eomgen
from eomgen.analysis import modes
from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.forces.joint_stiffness import CoordinateMatrix
from eomgen.codegen.forces.scalar_functions import Functions
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import Graph, evaluate, finish
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.export.mujoco import left_out, mjcf
from eomgen.robot import Bushing, JointDamping, JointStiffness, Loop, Placement, Robot
from eomgen.robot.elements.matrices import matrix_of
from eomgen.robot.elements.stiffness_center import PrincipalStiffness, principal_stiffness
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import number_of
from eomgen.robot.value import COORDINATES, Coordinate
from eomgen.state.elements import damping_forces, joint_damping, joint_stiffness, stiffness_forces
from eomgen.state.springs import any_spring, fastest_rates, line_rates, stiffnesses
from tests.oracles.mjcf import MjcfOracle
from tests.support.added_forces import (
    NAMES,
    check_closed_form,
    check_forces,
    check_same,
    check_single_precision,
    check_slopes,
    check_step,
    implicit_step,
    products,
    stacked,
)
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.refusals import refused
from tests.support.small_robots import free_body
from tests.support.soak import across, soaked

pytestmark = pytest.mark.usefixtures("unoptimised")


def definite(rng: np.random.Generator, names: tuple[str, ...], scale: float = 1.0) -> Array:
    """A random positive definite matrix of springs of all directions."""
    rows = rng.normal(size=(len(names) + 1, len(names)))
    return np.asarray(scale * (rows.T @ rows))


def with_matrices(seed: int, share: str = "", joints: tuple[int, int] = (1, 3)) -> Robot:
    """A random robot whose joints have a stiffness matrix, preloads, and a damping matrix or a proportional one."""
    rng, made = np.random.default_rng(seed), []
    robot = random_robot(seed, joints=joints, types=("revolute", "fixed", "free"), max_coordinates=4)
    for joint in robot.joints:
        names = tuple(joint.coordinates)
        if not names:
            made.append(joint)
            continue
        stiffness = JointStiffness.of(definite(rng, names, 20.0).tolist(), names, preload=rng.normal(size=len(names)))
        damping = JointDamping.of(definite(rng, names).tolist(), names)
        if share:
            damping = JointDamping(**{share: float(rng.uniform(0.1, 0.5))}, at_hz=2.5)
        made.append(replace(joint, stiffness=stiffness, damping=damping))
    return replace(robot, joints=tuple(made))


def bare(robot: Robot) -> Robot:
    return replace(robot, joints=tuple(replace(joint, stiffness=None, damping=None) for joint in robot.joints))


def matrices(robot: Robot) -> tuple[Array, Array, Array]:
    """K, D and p over all coordinates, from the description."""
    names = build_model(robot).coordinates
    K, D, p = np.zeros((len(names),) * 2), np.zeros((len(names),) * 2), np.zeros(len(names))
    for joint in robot.joints:
        own = [i for i, name in enumerate(names) if name.rpartition(".")[0] == joint.name]
        if joint.stiffness is None or joint.damping is None or not own:
            continue
        kinds = tuple(names[i].rpartition(".")[2] for i in own)
        block, at_hz = np.array(matrix_of(joint.stiffness.entries, kinds)), joint.damping.at_hz or 1.0
        K[np.ix_(own, own)] = block
        w = 2.0 * np.pi * at_hz
        D[np.ix_(own, own)] = matrix_of(joint.damping.entries, kinds)
        D[np.ix_(own, own)] += (2.0 * (joint.damping.ratio or 0.0) + (joint.damping.loss_factor or 0.0)) * block / w
        p[own] = [joint.stiffness.preload.get(kind, 0.0) for kind in kinds]
    return K, D, p


@pytest.mark.parametrize("share", ["", "ratio", "loss_factor"])
@pytest.mark.parametrize("seed", seeds(2600, 1, 8))
def test_forces_are_those_of_linear_algebra(seed: int, share: str, built: Build) -> None:
    """What they add to a robot without them, with derivatives, and the functions of the kernel's state."""
    robot = with_matrices(seed, share)
    (K, D, p), states = matrices(robot), [random_state(robot, seed + i) for i in range(9)]
    q, v = stacked(states)
    forces = -q @ K - v @ D - p
    energies = [0.5 * s.q @ K @ s.q + p @ s.q for s in states]
    kernel, other = check_forces(robot, bare(robot), states, forces, energies, built)
    for s in states:
        slopes, rigid = (x.residual_jacobian(s.q, s.v, s.a) for x in (kernel, other))
        assert close(slopes[0], rigid[0] + K)
        assert close(slopes[1], rigid[1] + D)
    assert close(joint_stiffness(kernel), K)
    assert close(joint_damping(kernel), D)
    assert close(stiffness_forces(kernel, q) + damping_forces(kernel, q, v), -forces)
    assert close(stiffnesses(kernel), stiffnesses(other) + np.diag(K))
    assert min(fastest_rates(kernel, 0.0 * q[0])) > 0.0


@pytest.mark.parametrize("share", ["", "ratio"])
@pytest.mark.parametrize("seed", seeds(2620, 1, 8))
def test_an_implicit_step_is_the_linear_system(seed: int, share: str) -> None:
    """(M + dt D + dt^2 K) a = u - K (q + dt v) - D v - p - bias, with what the robot has beside them."""
    robot, dt = with_matrices(seed, share, (1, 2)), 0.05
    s, (K, D, p) = random_state(robot, seed), matrices(robot)
    force = -K @ (s.q + dt * s.v) - p - D @ s.v
    check_step(robot, bare(robot), s, dt, lambda a: force - (dt * D + dt * dt * K) @ a)


@pytest.mark.parametrize("seed", seeds(2640, 1, 6))
def test_slopes_are_those_of_complex_steps(seed: int) -> None:
    robot = with_matrices(seed, "loss_factor", (1, 2))
    check_slopes(robot, random_state(robot, seed))


def held(stiffness: JointStiffness | None, damping: JointDamping | None = None, *names: str) -> Robot:
    """A body on a joint with these coordinates, all six without."""
    body = free_body()
    table = dict.fromkeys(names or COORDINATES, Coordinate())
    joint = replace(body.joints[0], type="fixed", coordinates=table, stiffness=stiffness, damping=damping)
    return replace(body, name="held", joints=(joint,))


def test_a_beams_end_has_its_closed_form(built: Build) -> None:
    """Timoshenko's stiffness is diagonal in the middle; at the end deflections and slopes couple."""
    E, G, A, Iy, Iz, J, length, k = 7e10, 2.6e10, 1.2e-3, 8e-7, 3e-7, 1e-6, 0.4, 5.0 / 6.0
    in_plane, across = (12.0 * E * moment / (G * A * k * length**2) for moment in (Iz, Iy))
    one, two, axial = 1.0 + in_plane, 1.0 + across, E * A / length
    middle = [axial, 12.0 * E * Iz / (length**3 * one), 12.0 * E * Iy / (length**3 * two)]
    middle += [G * J / length, E * Iy / length, E * Iz / length]
    stiffness = JointStiffness.of(np.diag(middle).tolist(), at=Placement((-0.5 * length, 0.0, 0.0)))
    found = np.array(matrix_of(stiffness.entries, COORDINATES))
    expected = np.diag([*middle[:4], (4.0 + across) * middle[4] / two, (4.0 + in_plane) * middle[5] / one])
    expected[1, 5] = expected[5, 1] = -6.0 * E * Iz / (length**2 * one)
    expected[2, 4] = expected[4, 2] = 6.0 * E * Iy / (length**2 * two)
    sizes = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / np.outer(sizes, sizes)).max() < 1e-12
    force = np.array([0.0, 30.0, -20.0, 0.0, 0.0, 0.0])
    tip = np.linalg.solve(found, force)
    deflections = length**3 / (3.0 * E) / np.array([Iz, Iy]) + length / (G * A * k)  # of a cantilever, per force
    np.testing.assert_allclose(tip[1:3], force[1:3] * deflections, rtol=1e-12)
    np.testing.assert_allclose(tip[[4, 5]], 0.5 * length**2 / E * np.array([20.0 / Iy, 30.0 / Iz]), rtol=1e-12)
    kernel = built(replace(held(stiffness), gravity=(0.0, 0.0, 0.0)), "inverse_dynamics")
    assert close(kernel.inverse_dynamics(tip, 0.0 * tip, 0.0 * tip), force, 1e-9)
    principal = principal_stiffness(stiffness.entries)
    assert isinstance(principal, PrincipalStiffness)
    np.testing.assert_allclose(principal.center, (-0.5 * length, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(principal.rotational, sorted(middle[3:]), rtol=1e-9)
    np.testing.assert_allclose(principal.translational, sorted(middle[:3]), rtol=1e-12)


def test_a_frame_moves_with_the_joint() -> None:
    """K at a turned frame: the energy of small motions of that frame."""
    rng, at = np.random.default_rng(5), Placement.from_rpy((0.3, -0.2, 0.5), (0.4, -0.7, 0.2))
    K, preload, motion = definite(rng, COORDINATES), rng.normal(size=6), rng.normal(size=6)
    made = JointStiffness.of(K.tolist(), at=at, preload=preload.tolist())
    R, moved, turned = np.array(at.rotation), motion[:3], motion[3:]
    there = np.concatenate([R.T @ (moved + np.cross(turned, at.xyz)), R.T @ turned])
    assert close(motion @ np.array(matrix_of(made.entries, COORDINATES)) @ motion, there @ K @ there, 1e-12)
    assert close(sum(made.preload[x] * y for x, y in zip(COORDINATES, motion, strict=True)), preload @ there, 1e-12)


def test_a_diagonal_is_written_for_mujoco(built: Build) -> None:
    """A matrix without entries beside the diagonal has an equal; of others that is written on request."""
    diagonal = JointStiffness.of(np.diag([9e3, 8e3, 7e3, 60.0, 50.0, 40.0]).tolist(), preload=[3.0] * 6)
    robot = held(diagonal, JointDamping(ratio=0.1, at_hz=3.0))
    assert left_out(robot) == []
    kernel, oracle = built(robot, "inverse_dynamics"), MjcfOracle(mjcf(robot, 1e-3), robot)
    q, v, a = np.random.default_rng(3).uniform(-0.5, 0.5, (3, kernel.n))
    wanted = oracle.inverse_dynamics(q, v, a)
    assert np.abs(kernel.inverse_dynamics(q, v, a) - wanted).max() < 1e-10 * np.abs(wanted).max()
    coupled = replace(diagonal, entries={**diagonal.entries, "x.beta": 20.0})
    damping = JointDamping(entries={"x.x": 2.0, "beta.beta": 3.0, "x.beta": 1.0})
    robot = held(coupled, damping)
    assert [note.partition(": ")[0] for note in left_out(robot)] == ["joints.free.stiffness", "joints.free.damping"]
    refused(InputError, r"joints\.free\.stiffness: its diagonal alone", mjcf, robot, 1e-3)
    assert 'stiffness="9000.0"' in mjcf(robot, 1e-3, approximate=True)


def test_lagranges_equations() -> None:
    """A rod on a slide that turns, both coupled by the matrix: SymPy's Euler-Lagrange equations."""
    m, c, inertia, g = 2.0, 0.3, 0.05, 9.81
    K, D = sp.Matrix([[90, 12], [12, 8]]), sp.Matrix([[3, sp.Rational(-1, 2)], [sp.Rational(-1, 2), 1]])
    text = f"""
name = "rod"
gravity = [0.0, -9.81, 0.0]
{link_table("rod", 2.0, (0.3, 0.0, 0.0), (0.0, 0.05, 0.05))}
{joint_table("joint", "base", "rod", "revolute")}
x = {{}}
stiffness = {{ matrix = [[90.0, 12.0], [12.0, 8.0]], preload = [0.7, -0.2] }}
damping = {{ matrix = [[3.0, -0.5], [-0.5, 1.0]] }}
"""
    robot, t = robot_from_toml(text), sp.Symbol("t")
    x, angle = sp.Function("x")(t), sp.Function("gamma")(t)
    s = sp.Matrix([x, angle])
    place = sp.Matrix([x + c * sp.cos(angle), c * sp.sin(angle)])
    kinetic = (m * place.diff(t).dot(place.diff(t)) + inertia * angle.diff(t) ** 2) / 2
    potential = m * g * place[1] + (s.T * K * s)[0] / 2 + 0.7 * x - 0.2 * angle
    L, rows = kinetic - potential, D * s.diff(t)
    wanted = [L.diff(y.diff(t)).diff(t) - L.diff(y) + rows[i] for i, y in enumerate(s)]
    values = random_state(robot, 4)
    swap = {
        y.diff(t, k): value[i] for k, value in ((2, values.a), (1, values.v), (0, values.q)) for i, y in enumerate(s)
    }
    numbers = [float(row.doit().subs(swap)) for row in wanted]
    model, inputs = build_model(robot), {name: getattr(values, name) for name in "qvau"}
    found = evaluate(derive(model, "inverse_dynamics"), {**inputs, "p": list(model.parameters.values())})
    assert close(np.array(list(found.values())), np.array(numbers), 1e-12)
    form = closed_form(model)
    zero = 0.0 * values.u
    assert close(form.function("residual")(values.q, values.v, values.a, zero), np.array(numbers), 1e-12)
    letters = {str(letter.symbol): letter for letter in readable_closed_form(model).letters}
    assert letters["a_x_gamma_joint"].unit == "N/rad"
    assert letters["b_x_gamma_joint"].unit == "N s/rad"
    assert letters["a_x_gamma_joint"].latex == "a_{x \\gamma,joint}"


def test_what_matrices_cost() -> None:
    """36 products in the place of six, and the same for damping; a proportional one takes six, for its factor."""
    full = JointStiffness.of(definite(np.random.default_rng(1), COORDINATES).tolist())
    damping = JointDamping.of(definite(np.random.default_rng(2), COORDINATES).tolist())
    sixfold = held(None)
    table = dict.fromkeys(COORDINATES, Coordinate(stiffness=2.0))
    springs = replace(sixfold, joints=(replace(sixfold.joints[0], coordinates=table),))
    both = dict.fromkeys(COORDINATES, Coordinate(stiffness=2.0, damping=1.0))
    dampers = replace(sixfold, joints=(replace(sixfold.joints[0], coordinates=both),))
    assert products(held(full)) - products(springs) == 30
    assert products(held(full, damping)) - products(dampers) == 60
    assert products(held(full, JointDamping(ratio=0.1, at_hz=2.0))) - products(held(full)) == 6
    few = JointStiffness.of(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).tolist())
    assert products(held(few)) == products(springs)


def test_a_ratio_is_that_of_its_frequency(built: Build) -> None:
    """One coordinate that swings at at_hz has this damping ratio; a loss factor is twice that."""
    body, w = free_body(), 2.0 * np.pi * 7.0
    for damping, ratio in (
        (JointDamping(ratio=0.03, at_hz=7.0), 0.03),
        (JointDamping(loss_factor=0.03, at_hz=7.0), 0.015),
    ):
        robot = held(JointStiffness({"x.x": body.links[0].mass * w * w}), damping, "x")
        kernel = built(robot, "residual_jacobian", "mass_matrix")
        q = np.zeros(1)
        K, D, _ = kernel.residual_jacobian(q, q, q)
        M = kernel.mass_matrix(q)
        roots = np.roots([M[0, 0], D[0, 0], K[0, 0]])
        assert close(np.abs(roots), np.array([w, w]), 1e-9)
        assert close(-roots.real / np.abs(roots), np.array([ratio, ratio]), 1e-9)


def test_entries_are_parameters_checked_as_a_whole(built: Build) -> None:
    """One, several at once, those of float32, copies; what is refused changes nothing and says which motion."""
    rng = np.random.default_rng(8)
    K = definite(rng, ("x", "beta", "gamma"), 10.0)
    robot = held(JointStiffness.of(K.tolist(), ("x", "beta", "gamma")), None, "x", "beta", "gamma")
    for dtype in ("float64", "float32"):
        kernel = built(robot, "generalized_force", dtype=dtype)
        q = np.array([0.1, 0.2, 0.3], dtype)
        prefix, p = "joints.free.stiffness", kernel.parameters
        bound = float(np.sqrt(p[f"{prefix}.x.x"] * p[f"{prefix}.beta.beta"]))
        before, force = dict(p), kernel.generalized_force(q, 0 * q)
        for name, value in {"x.beta": 1.1 * bound, "x.x": 0.0, "gamma.gamma": -1.0}.items():
            with pytest.raises(InputError, match=rf"{prefix}\.{name}"):
                p[f"{prefix}.{name}"] = value
            with pytest.raises(InputError, match=rf"{prefix}\.{name}"):
                p.update({f"{prefix}.beta.beta": p[f"{prefix}.beta.beta"], f"{prefix}.{name}": value})
        with pytest.raises(InputError, match="negative energy where x and beta"):
            kernel.replaced(parameters={f"{prefix}.x.beta": -1.1 * bound})
        assert dict(p) == before
        assert np.array_equal(kernel.generalized_force(q, 0 * q), force)
        swapped = {f"{prefix}.x.x": before[f"{prefix}.x.x"] * 4.0, f"{prefix}.x.beta": 1.5 * bound}
        swapped |= {f"{prefix}.x.gamma": 0.0, f"{prefix}.beta.gamma": 0.0}
        p.update(swapped)
        assert p[f"{prefix}.x.beta"] == pytest.approx(1.5 * bound)
        assert close(
            kernel.generalized_force(q, 0 * q)[0],
            force[0]
            - 3.0 * before[f"{prefix}.x.x"] * 0.1
            - (1.5 * bound - before[f"{prefix}.x.beta"]) * 0.2
            + before[f"{prefix}.x.gamma"] * 0.3,
            1e-4,
        )
        p.update({name: 0.0 for name in p if name.startswith(prefix)})
        rank_one = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]) / 7.0  # semidefinite, of rounded numbers
        names = ("x", "beta", "gamma")
        p.update(
            {f"{prefix}.{a}.{b}": rank_one[i, j] for i, a in enumerate(names) for j, b in enumerate(names) if i <= j}
        )
        assert pickle.loads(pickle.dumps(kernel)).parameters == dict(p)


def test_a_zero_has_no_term_and_no_parameter_unless_asked_for(built: Build) -> None:
    full = JointStiffness({"x.x": 5.0, "beta.beta": 2.0})
    robot = held(full, JointDamping(entries={"x.x": 1.0, "beta.beta": 1.0}), "x", "beta")
    names = [name for name in build_model(robot).parameters if name.startswith("joints")]
    assert names == [
        f"joints.free.{x}" for x in ("stiffness.x.x", "stiffness.beta.beta", "damping.x.x", "damping.beta.beta")
    ]
    asked = replace(
        robot, tunable=("joints.free.stiffness.x.beta", "joints.free.damping.x.beta", "joints.free.stiffness.preload.x")
    )
    kernel = built(asked, "generalized_force")
    q, v = np.array([0.1, 0.2]), np.array([0.3, -0.1])
    before = kernel.generalized_force(q, v)
    kernel.parameters.update(dict(zip(asked.tunable, (1.5, 0.4, 0.25), strict=True)))
    change = -np.array([1.5 * 0.2 - 0.4 * 0.1 + 0.25, 1.5 * 0.1 + 0.4 * 0.3])
    assert close(kernel.generalized_force(q, v) - before, change, 1e-12)
    refused(DescriptionError, r"joints\.free\.stiffness\.x\.y", robot.with_value, "joints.free.stiffness.x.y", 1.0)
    assert robot.with_value("joints.free.stiffness.x.beta", 1.0).joints[0].stiffness == replace(
        full, entries={**full.entries, "x.beta": 1.0}
    )


def test_derivatives_by_entries(built: Build) -> None:
    K = definite(np.random.default_rng(4), COORDINATES, 10.0)
    robot = held(JointStiffness.of(K.tolist()), JointDamping(ratio=0.1, at_hz=2.0))
    kernel, s = built(robot, "inverse_dynamics", "inverse_dynamics_parameter_tangent"), random_state(robot, 1)
    entry, tau = "joints.free.stiffness.x.beta", 0.1 / (np.pi * 2.0)
    J = kernel.parameter_jacobian("inverse_dynamics", (s.q, s.v, s.a), [entry, "joints.free.damping.ratio"])
    wanted = np.zeros(6)
    wanted[[0, 4]] = (s.q + tau * s.v)[[4, 0]]
    assert close(J[:, 0], wanted, 1e-12)
    assert close(J[:, 1], joint_stiffness(kernel) @ s.v / (np.pi * 2.0), 1e-12)


def test_modes_are_those_of_the_matrices() -> None:
    K = definite(np.random.default_rng(4), COORDINATES, 400.0)
    robot = replace(held(JointStiffness.of(K.tolist())), gravity=(0.0, 0.0, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = modes(robot)
    M = eomgen.build(robot, kernels=("mass_matrix",)).mass_matrix(np.zeros(6))
    wanted = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real) / (2.0 * np.pi)
    np.testing.assert_allclose(np.sort(found.frequencies), np.sort(wanted), rtol=1e-6)


@pytest.mark.parametrize("method", ["implicit", "rosenbrock", "rk4"])
def test_rollouts_of_a_body_on_springs(method: str, built: Build) -> None:
    """Small translations without gravity: the exponential of a matrix."""
    from scipy.linalg import expm

    rng = np.random.default_rng(6)
    K, names = definite(rng, ("x", "y", "z"), 400.0), ("x", "y", "z")
    robot = held(JointStiffness.of(K.tolist(), names), JointDamping(loss_factor=0.2, at_hz=3.0), *names)
    robot = replace(robot, gravity=(0.0, 0.0, 0.0))
    kernel = built(robot, "rollout", "adaptive_rollout", "mass_matrix", "forward_dynamics")
    q0, v0, T, m = rng.normal(size=3) * 1e-2, rng.normal(size=3), 0.2, robot.links[0].mass
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K / m, -K * 0.2 / (6.0 * np.pi) / m]])
    wanted = expm(A * T) @ np.concatenate([q0, v0])
    fixed, loose = {"dt": T / 4000, "steps": 4000}, {"duration": T, "samples": 1, "rtol": 1e-9}
    q, v = kernel.rollout(q0, v0, np.zeros(3), method=method, **(loose if method == "rosenbrock" else fixed))
    found = np.concatenate([q[-1], v[-1]])
    assert np.abs(found - wanted).max() < (5e-3 if method == "implicit" else 1e-6) * np.abs(wanted).max()


FORMS = ["matrices", "ratio", "loss_factor", "damping alone"]
METHODS = {"implicit": "rollout", "rosenbrock": "adaptive_rollout", "radau": "radau_rollout"}


def elements(seed: int, form: str) -> tuple[JointStiffness | None, JointDamping]:
    rng = np.random.default_rng(seed)
    stiffness = JointStiffness.of(definite(rng, COORDINATES, 20.0).tolist(), preload=rng.normal(size=6).tolist())
    damping = JointDamping.of(definite(rng, COORDINATES).tolist())
    if form == "damping alone":
        return None, damping
    return stiffness, damping if form == "matrices" else JointDamping(**{form: 0.3}, at_hz=2.0)


def on_bushing(stiffness: JointStiffness | None, damping: JointDamping) -> Robot:
    mount = Bushing("mount", ("base", "body"), stiffness=stiffness, damping=damping)
    return replace(held(None), name="on_bushing", elements=(mount,))


def on_loop(stiffness: JointStiffness | None, damping: JointDamping) -> Robot:
    free = dict.fromkeys(COORDINATES, Coordinate())
    loop = Loop("mount", ("base", "body"), "fixed", coordinates=free, stiffness=stiffness, damping=damping)
    return replace(held(None), name="on_loop", loops=(loop,))


@pytest.mark.parametrize(("form", "made"), across(FORMS, (on_bushing, on_loop)))
@pytest.mark.parametrize("seed", seeds(2700, 1, 4))
def test_they_are_those_of_a_joint(seed: int, form: str, made: type[Robot], built: Build) -> None:
    """Implicit steps too: rank-one rows make the block that a joint's coordinates have."""
    parts = elements(seed, form)
    robot, joint = made(*parts), held(*parts)  # type: ignore[arg-type]
    kernel, other = built(robot, *NAMES), built(joint, *NAMES)
    states = [random_state(joint, seed + i) for i in range(5)]
    check_same(kernel, other, states, 1e-9)
    for s in states:
        for found, wanted in zip(*(x.residual_jacobian(s.q, s.v, s.a) for x in (kernel, other)), strict=True):
            assert close(found, wanted, 1e-8)
    assert close(implicit_step(robot, s, 0.02), implicit_step(joint, s, 0.02), 1e-8)
    check_single_precision(other, robot, stacked(states), built, 1e-3)
    there = 0.0 * states[0].q
    assert close(np.array(fastest_rates(kernel, there)), np.array(fastest_rates(other, there)), 1e-9)
    assert any_spring(kernel) == any_spring(other) == (form != "damping alone")
    assert line_rates(kernel, there)[1].any()


def end_of(kernel: eomgen.Kernel, method: str, q0: Array, rtol: float) -> Array:
    """The state after a twentieth of a second from rest."""
    steps = {"dt": 1e-3, "steps": 50} if method == "implicit" else {"duration": 0.05, "samples": 1, "rtol": rtol}
    q, v = kernel.rollout(q0, 0.0 * q0, 0.0 * q0, method=method, **steps)
    return np.concatenate([q[-1], v[-1]])


@pytest.mark.parametrize(("method", "made"), across(METHODS, (on_bushing, on_loop)))
def test_rollouts_are_those_of_a_joint(method: str, made: type[Robot], built: Build) -> None:
    """Also where stiffness is so large that nothing but its place in the matrix keeps steps stable."""
    stiffness, damping = elements(6, "ratio")
    assert stiffness is not None
    stiff = JointStiffness({key: 1e4 * x for key, x in stiffness.entries.items()})
    q0 = np.array([1e-3, -2e-3, 1e-3, 2e-3, 1e-3, -1e-3])
    robots = made(stiff, damping), held(stiff, damping)  # type: ignore[arg-type]
    kernels = [built(robot, "mass_matrix", "forward_dynamics", METHODS[method]) for robot in robots]
    found, wanted = (end_of(kernel, method, q0, 1e-6) for kernel in kernels)
    assert np.abs(wanted).max() > 1e-8
    assert np.abs(found - wanted).max() < 1e-3 * np.abs(wanted).max()


@pytest.mark.parametrize(("method", "dtype"), across(METHODS, ("float64", "float32")))
def test_matrices_may_lose_their_rank(method: str, dtype: str, built: Build) -> None:
    """Parameters may be 0, or those of one direction alone: the rows of the others are none."""
    parts, q0, ends = elements(6, "matrices"), np.array([0.1, -0.2, 0.1, 0.2, 0.1, -0.1], dtype), []
    one = 3.0 * np.outer(np.arange(1.0, 7.0), np.arange(1.0, 7.0))
    for made, prefix in ((held, "joints.free"), (on_bushing, "bushings.mount"), (on_loop, "loops.mount")):
        kernel = built(made(*parts), METHODS[method], dtype=dtype)  # type: ignore[operator]
        numbers = {x: 0.0 for x in kernel.parameters if x.startswith(prefix)}
        alone = {f"{prefix}.stiffness.{key}": x for key, x in JointStiffness.of(one.tolist()).entries.items()}
        for changes in (numbers, numbers | alone):
            kernel.parameters.update(changes)
            ends.append(end_of(kernel, method, q0, 1e-4))
    tolerance = 1e-9 if dtype == "float64" else 1e-4
    for first, other in ((0, 2), (0, 4), (1, 3), (1, 5)):
        assert close(ends[other], ends[first], tolerance)
    assert not close(ends[0], ends[1], 1e-3)


@pytest.mark.parametrize("rank", range(7))
@pytest.mark.parametrize("seed", seeds(2740, 1, 6))
def test_directions_make_the_matrix(seed: int, rank: int) -> None:
    """Sums of d l l^T, of matrices without full rank too; slopes are never negative."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(rank, 6)) * 10.0 ** rng.uniform(-3, 3, 6)
    K = rows.T @ rows
    graph = Graph()
    pairs = {(i, j): graph.input("k", 6 * i + j) for i in range(6) for j in range(i, 6)}
    directions = CoordinateMatrix(pairs).directions(Functions(graph.call))
    values = [x for row, d in directions for x in (d, *(row.get(i, 0.0) for i in range(6)))]
    program = finish(graph, "directions", {("out", i): value for i, value in enumerate(values)})
    numbers = evaluate(program, {"k": K.ravel().tolist()})
    found = np.array([float(numbers["out", i]) for i in range(len(values))]).reshape(-1, 7)
    assert (found[:, 0] >= 0.0).all()
    sizes = np.sqrt(np.maximum(np.diag(K), 1e-300))
    made = np.einsum("k,ki,kj->ij", found[:, 0], found[:, 1:], found[:, 1:])
    assert np.abs((made - K) / np.outer(sizes, sizes)).max() < 1e-7


def test_forces_are_told(built: Build) -> None:
    """``element_forces`` and ``cut_forces`` have what the matrices add, and reactions hold it."""
    parts = elements(7, "matrices")
    K, D = np.array(matrix_of(parts[0].entries, COORDINATES)), np.array(matrix_of(parts[1].entries, COORDINATES))
    preload = np.array([parts[0].preload[name] for name in COORDINATES])
    s = random_state(held(*parts), 2)
    bushing, loop = built(on_bushing(*parts), "element_forces"), built(on_loop(*parts), "cut_forces", "loop_reactions")
    wanted = np.column_stack([s.q, K @ s.q + D @ s.v + preload])
    assert close(bushing.functions.element_forces(s.q, s.v), wanted, 1e-9)
    assert close(loop.functions.cut_forces(s.q, s.v), wanted, 1e-9)
    assert bushing.element_rows == tuple(f"mount.{name}" for name in COORDINATES)
    assert loop.cut_laws == bushing.element_rows


def test_closed_form_has_those_of_loops() -> None:
    stiffness = JointStiffness({"x.x": 9.0, "x.gamma": 2.0, "gamma.gamma": 4.0})
    loops = on_loop(stiffness, JointDamping(ratio=0.1, at_hz=1.0)).loops
    robot = replace(held(None, None, "x", "gamma"), loops=loops)
    check_closed_form(robot, random_state(robot, 3), 1e-9)


@pytest.mark.parametrize("made", [on_bushing, on_loop])
def test_entries_of_bushings_and_loops_are_checked_as_a_whole(made: type[Robot], built: Build) -> None:
    parts = elements(8, "matrices")
    robot = made(*parts)  # type: ignore[arg-type]
    kernel = built(robot, "generalized_force")
    prefix = "bushings.mount" if made is on_bushing else "loops.mount"
    p = kernel.parameters
    bound = np.sqrt(p[f"{prefix}.stiffness.x.x"] * p[f"{prefix}.stiffness.beta.beta"])
    before = dict(p)
    for table in ("stiffness", "damping"):
        with pytest.raises(InputError, match=rf"{prefix}\.{table}\.x\.beta.*negative energy"):
            p[f"{prefix}.{table}.x.beta"] = 2.0 * bound
    assert dict(p) == before
    p.update({name: 4.0 * x for name, x in before.items() if name.startswith(prefix)})
    s = random_state(held(*parts), 2)
    other = built(held(*parts), "generalized_force")
    idle = built(replace(free_body(), joints=(replace(free_body().joints[0], type="fixed"),)), "generalized_force")
    weight = idle.generalized_force(s.q, s.v)
    assert close(kernel.generalized_force(s.q, s.v) - weight, 4.0 * (other.generalized_force(s.q, s.v) - weight), 1e-8)
    for name in p:
        if name.startswith(prefix):
            assert number_of(name) is not None
            assert parameter_unit(robot, name) in UNITS
    asked = replace(robot, tunable=(f"{prefix}.stiffness.preload.x",))
    assert f"{prefix}.stiffness.preload.x" in build_model(asked).parameters


BY_ENTRIES = {  # robots, and parameters of theirs
    "joint": (lambda K: held(K, JointDamping(ratio=0.3, at_hz=2.0)), "joints.free", "damping.ratio"),
    "bushing": (lambda K: on_bushing(K, JointDamping.of(np.eye(6).tolist())), "bushings.mount", "damping.gamma.gamma"),
}


@pytest.mark.parametrize(
    ("owner", "method"),
    soaked(product(BY_ENTRIES, ("implicit", "rosenbrock", "rk4")), {("joint", "implicit"), ("bushing", "rosenbrock")}),
)
def test_gradients_of_rollouts_by_entries(owner: str, method: str, built: Build) -> None:
    make, prefix, damping = BY_ENTRIES[owner]
    kernel = built(make(JointStiffness.of(definite(np.random.default_rng(4), COORDINATES).tolist())))
    q0, still = np.array([0.1, -0.2, 0.1, 0.2, 0.1, -0.1]), np.zeros(6)
    adaptive, fixed = {"duration": 0.1, "samples": 2, "rtol": 1e-9}, {"dt": 1e-3, "steps": 20}
    options = {"method": method, **(adaptive if method == "rosenbrock" else fixed)}
    names = (f"{prefix}.stiffness.x.beta", f"{prefix}.{damping}")

    def loss(t: float, q: Array, v: Array) -> tuple[float, Array, Array]:
        return float((q**2).sum() + (v**2).sum()), 2.0 * q, 2.0 * v

    _, gradient = kernel.rollout_gradient(q0, still, still, loss=loss, parameters=names, **options)
    for name in names:
        x, ends = kernel.parameters[name], list[float]()
        for step in (1e-4, -1e-4):
            q, v = kernel.replaced(parameters={name: x + step}).rollout(q0, still, still, **options)
            ends.append(float((q**2).sum() + (v**2).sum()))
        assert gradient[name] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-4)
