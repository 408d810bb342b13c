"""Laws of mechanics that compiled kernels keep, and four ways to the same numbers."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.kernels import equations
from eomgen.codegen.kernels.accelerations import FACTORISED, SOLVERS
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.writers import WRITERS
from eomgen.codegen.program.ir import evaluate, finish
from eomgen.codegen.tree.bound import bind
from eomgen.codegen.tree.composite import mass_matrix
from eomgen.codegen.tree.frozen_joints import geometry
from eomgen.codegen.tree.recursion import inertial_rows
from eomgen.errors import SingularError
from eomgen.robot.geometry import ZERO
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, Placement, Robot
from tests.oracles.lagrange import LagrangeOracle
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.small_robots import free_body
from tests.support.soak import soaked

TOLERANCE = 1e-11  # relative, max-norm
STATES = 20
TYPES = ("revolute", "prismatic", "fixed", "free")


@dataclass(frozen=True)
class Case:
    """A random robot, its kernel with everything, and STATES random states, each array (STATES, n).

    ``size`` is the size of its forces: what differences of forces are compared with.
    """

    robot: Robot
    kernel: eomgen.Kernel
    q: Array
    v: Array
    a: Array
    u: Array
    size: float


def random_states(robot: Robot, seed: int, count: int = STATES) -> tuple[Array, Array, Array, Array]:
    rng = np.random.default_rng(seed)
    states = [random_state(robot, rng) for _ in range(count)]
    q, v, a, u = (np.array([getattr(state, name) for state in states]) for name in "qvau")
    return q, v, a, u


KERNELS = (
    "mass_matrix",
    "bias_force",
    "inverse_dynamics",
    "generalized_force",
    "residual",
    "forward_dynamics",
    "coriolis_matrix",
    "christoffel",
    "energy",
    "kinematics",
)


@pytest.fixture(scope="module", params=soaked(range(300, 308), (303, 304)))
def case(request: pytest.FixtureRequest, built: Build) -> Case:
    seed = request.param
    robot = random_robot(seed, joints=(1, 4), tree=seed % 2 == 0, types=TYPES)
    kernel, (q, v, a, u) = built(robot, *KERNELS), random_states(robot, seed)
    terms = (kernel.bias_force(q, v), kernel.inverse_dynamics(q, v, a), kernel.generalized_force(q, v), u)
    return Case(robot, kernel, q, v, a, u, max(float(np.abs(term).max()) for term in terms))


def times(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))


def test_mass_matrix_is_symmetric_and_positive_definite(case: Case) -> None:
    M = case.kernel.mass_matrix(case.q)
    assert np.array_equal(M, np.swapaxes(M, 1, 2))
    np.linalg.cholesky(M)  # raises where M is not positive definite


def test_terms_add_up_to_the_residual(case: Case) -> None:
    k, q, v, a, u = case.kernel, case.q, case.v, case.a, case.u
    total = times(k.mass_matrix(q), a) + k.bias_force(q, v) - k.generalized_force(q, v)
    assert np.abs(k.inverse_dynamics(q, v, a) - total).max() <= TOLERANCE * case.size
    assert np.abs(k.residual(q, v, a, u) - (total - u)).max() <= TOLERANCE * case.size


def test_forward_after_inverse_dynamics_is_the_identity(case: Case) -> None:
    k, q, v, a, u = case.kernel, case.q, case.v, case.a, case.u
    limit = 100 * np.linalg.cond(k.mass_matrix(q)) * np.finfo(float).eps
    drives = k.inverse_dynamics(q, v, a)
    found = k.forward_dynamics(q, v, drives)
    forces = np.abs(drives).max(axis=1) / np.abs(times(k.mass_matrix(q), a)).max(
        axis=1
    )  # what cancels in the right side
    error = np.abs(found - a).max(axis=1) / np.abs(a).max(axis=1)
    assert (error <= limit * np.maximum(1, forces)).all()
    again = k.inverse_dynamics(q, v, k.forward_dynamics(q, v, u))
    assert np.abs(again - u).max() <= 1e-9 * case.size
    assert np.abs(k.residual(q, v, k.forward_dynamics(q, v, u), u)).max() <= 1e-9 * case.size


def test_coriolis_matrix(case: Case) -> None:
    """C v = bias, and M_dot - 2 C is skew-symmetric; M_dot by a complex step, exact to round-off."""
    k, q, v = case.kernel, case.q, case.v
    C = k.coriolis_matrix(q, v)
    size = np.abs(k.mass_matrix(q)).max() * np.abs(v).max()
    assert np.abs(times(C, v) - k.bias_force(q, v)).max() <= TOLERANCE * size * np.abs(v).max()
    S = rates(case.robot, "mass_matrix", q, v, case.a).reshape(C.shape) - 2 * C
    assert np.abs(S + np.swapaxes(S, 1, 2)).max() <= TOLERANCE * size


def rates(robot: Robot, kernel: str, q: Array, v: Array, a: Array) -> Array:
    """The rate of a kernel's result along motions, (states, ...), from its program on complex numbers."""
    model, h = build_model(robot), 1e-30
    program = derive(model, kernel)
    result = []
    for q_i, v_i, a_i in zip(q, v, a, strict=True):
        step = {"q": q_i + 1j * h * v_i, "v": v_i + 1j * h * a_i, "p": list(model.parameters.values())}
        found = evaluate(program, step, sincos=lambda x: (cmath.sin(x), cmath.cos(x)))
        result.append([np.imag(found["out", index]) / h for index in range(len(found))])
    return np.array(result)


def test_christoffel_symbols(case: Case) -> None:
    """Symmetric in the last two indices; contracted once they are C, twice the bias."""
    k, q, v = case.kernel, case.q, case.v
    T, C = k.christoffel(q), k.coriolis_matrix(q, v)
    size = np.abs(k.mass_matrix(q)).max()
    assert np.abs(T - np.swapaxes(T, 2, 3)).max() <= TOLERANCE * size
    assert np.abs(np.einsum("nsvw,nw->nsv", T, v) - C).max() <= TOLERANCE * size * np.abs(v).max()
    assert (
        np.abs(np.einsum("nsvw,nv,nw->ns", T, v, v) - k.bias_force(q, v)).max()
        <= TOLERANCE * size * np.abs(v).max() ** 2
    )


def test_energy_rate_is_power(case: Case) -> None:
    """d(T + V)/dt = v . (u - damping v) on any motion, by a complex step."""
    k, q, v, a = case.kernel, case.q, case.v, case.a
    kinetic = k.energy(q, v)[:, 0]
    assert np.allclose(kinetic, np.einsum("ni,ni->n", v, times(k.mass_matrix(q), v)) / 2, rtol=1e-12)
    given = [coordinate for joint in case.robot.joints for coordinate in joint.coordinates.values()]
    damping = np.array([coordinate.damping or 0.0 for coordinate in given])
    power = np.einsum("ni,ni->n", v, k.inverse_dynamics(q, v, a) - damping * v)
    rate = rates(case.robot, "energy", q, v, a).sum(axis=1)
    assert np.abs(rate - power).max() <= TOLERANCE * case.size * np.abs(v).max() * k.n


def test_linear_in_acceleration_and_quadratic_in_velocity(case: Case) -> None:
    k, q, v, a, u = case.kernel, case.q, case.v, case.a, case.u
    first = k.inverse_dynamics(q, v, a) - k.inverse_dynamics(q, v, 0 * a)
    second = k.inverse_dynamics(q, v, a + u) - k.inverse_dynamics(q, v, u)
    assert np.abs(first - second).max() <= TOLERANCE * case.size
    assert np.abs(k.bias_force(q, -3 * v) - 9 * k.bias_force(q, v)).max() <= TOLERANCE * 9 * case.size
    assert np.array_equal(k.bias_force(q, 0 * v), np.zeros_like(v))


def test_regrouped_inertias_change_nothing(case: Case) -> None:
    """The kernels' frames and pseudo-inertias against the description's own."""
    model = build_model(case.robot)
    for kernel, arrays in (("inverse_dynamics", (case.q, case.v, case.a)), ("mass_matrix", (case.q,))):
        plain = Derivation(model, regrouped=False)
        program = finish(plain.graph, kernel, WRITERS[kernel](plain))
        found = getattr(case.kernel, kernel)(*arrays)
        for i in range(3):
            inputs = {"p": list(model.parameters.values()), **dict(zip("qva", (x[i] for x in arrays), strict=False))}
            expected = np.array(list(evaluate(program, inputs).values()))
            assert np.abs(found[i].ravel() - expected).max() <= TOLERANCE * np.abs(expected).max()


def recursion_on_floats(robot: Robot, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Inverse dynamics and M by the generator's recursions, run on plain floats: no graph, no C."""
    model = build_model(robot)
    bound = bind(model, lambda _, number: number, lambda x: (math.sin(x), math.cos(x)))
    joints = geometry(model, bound, list(q), lambda x: (math.sin(x), math.cos(x)))
    rows, _ = inertial_rows(model, bound, joints, list(v), list(a), bound.gravity)
    u = np.array(rows) + [x.stiffness * s + x.damping * rate for x, s, rate in zip(bound.laws, q, v, strict=True)]
    M = np.zeros((model.size, model.size))
    for (i, j), value in mass_matrix(model, bound, joints).items():
        M[i, j] = M[j, i] = value
    return u, M


@pytest.mark.parametrize("seed", seeds(402, 1, 8))
def test_four_ways_agree(seed: int, built: Build) -> None:
    """Closed form (11)-(12), recursion on floats, compiled kernel, LagrangesMethod: small robots, any coordinates."""
    robot = random_robot(seed, max_size=3 if seed < 408 else 4, tree=seed % 2 == 0)
    kernel = built(robot, "inverse_dynamics", "mass_matrix", "bias_force", "residual")
    symbolic = closed_form(build_model(robot)).function("residual", "mass_matrix", "bias")
    oracle = LagrangeOracle(robot)
    for state in range(3):
        s = random_state(robot, seed + 1000 * state)
        residual, M, bias = symbolic(s.q, s.v, s.a, s.u)
        drives, M_floats = recursion_on_floats(robot, s.q, s.v, s.a)
        size = max(np.abs(M @ s.a).max(), np.abs(bias).max(), np.abs(s.u).max(), np.abs(residual).max())
        for found in (residual, drives - s.u, kernel.residual(s.q, s.v, s.a, s.u)):
            assert np.abs(found - oracle.residual(s.q, s.v, s.a, s.u)).max() <= TOLERANCE * size
        for found in (M, M_floats, kernel.mass_matrix(s.q)):
            assert np.abs(found - oracle.mass_matrix(s.q)).max() <= TOLERANCE * np.abs(M).max()
        for found in (bias, kernel.bias_force(s.q, s.v)):
            assert np.abs(found - oracle.bias_force(s.q, s.v)).max() <= TOLERANCE * size
        assert np.abs(kernel.inverse_dynamics(s.q, s.v, s.a) - drives).max() <= TOLERANCE * size


@pytest.mark.parametrize("seed", seeds(500, 1, 12))
def test_kernel_equals_recursion_on_floats(seed: int, built: Build) -> None:
    """Up to three joints with any subset of the six coordinates in each."""
    robot = random_robot(seed)
    kernel = built(robot, "inverse_dynamics", "mass_matrix")
    for state in range(5):
        s = random_state(robot, seed + 1000 * state)
        u, M = recursion_on_floats(robot, s.q, s.v, s.a)
        assert np.abs(kernel.inverse_dynamics(s.q, s.v, s.a) - u).max() <= TOLERANCE * np.abs(u).max()
        assert np.abs(kernel.mass_matrix(s.q) - M).max() <= TOLERANCE * np.abs(M).max()


def test_loop_equals_straight_line(built: Build, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tensor C of large robots (one Coriolis matrix per column) against that of small ones."""
    robot = random_robot(44, joints=(4, 4), tree=True, types=("revolute", "free"), max_coordinates=3)
    kernels = []
    for name, limit in (("in_loops", 0), ("in_lines", 10**9)):  # the cache does not know of the limit
        monkeypatch.setattr(equations, "STRAIGHT_COLUMNS", limit)
        kernels.append(built(replace(robot, name=name), "christoffel"))
    loop, line = kernels
    assert loop.operations != line.operations
    q, *_ = random_states(robot, 4)
    T = line.christoffel(q)
    assert np.abs(loop.christoffel(q) - T).max() <= 1e-13 * np.abs(T).max()


@pytest.mark.parametrize("seed", seeds(0, 1, 12))
def test_solvers_of_forward_dynamics_agree(seed: int) -> None:
    """Factorised and eliminated: chains and trees, any coordinates, joints with six of them and armature on some."""
    types = ("revolute", "prismatic", "fixed", "free") if seed % 2 else ("free",)
    robot = random_robot(seed, joints=(1, 4), tree=seed % 3 == 0, types=types, armature=seed % 4 < 2)
    model, s = build_model(robot), random_state(robot, seed)
    inputs = {"q": s.q, "v": s.v, "u": s.u, "p": list(model.parameters.values())}
    found = []
    for name in SOLVERS:
        program, chosen = equations.derive_cheapest(model, "forward_dynamics", name)
        assert chosen == name
        values = evaluate(program, inputs)
        found.append(np.array([values["out", i] for i in range(model.size)]))
    entries = evaluate(derive(model, "mass_matrix"), inputs)
    M = np.array([entries["out", i] for i in range(model.size**2)]).reshape(model.size, model.size)
    error = np.abs(found[0] - found[1]).max() / np.abs(found[0]).max()
    assert error <= 10 * np.linalg.cond(M) * np.finfo(float).eps


def test_cheaper_solver_is_chosen() -> None:
    six, thirty_six = (build_model(eomgen.load_robot(name)) for name in ("puma560", "puma560_elastic"))
    assert equations.derive_cheapest(six, "forward_dynamics")[1] == FACTORISED
    assert equations.derive_cheapest(thirty_six, "forward_dynamics")[1] != FACTORISED


def test_single_precision(case: Case, built: Build) -> None:
    single = built(case.robot, "mass_matrix", "inverse_dynamics", "kinematics", dtype="float32")
    arrays = [x.astype(np.float32) for x in (case.q, case.v, case.a)]
    wide = [x.astype(np.float64) for x in arrays]
    M, u = single.mass_matrix(arrays[0]), single.inverse_dynamics(*arrays)
    assert M.dtype == u.dtype == single.dtype == np.float32
    expected = case.kernel.mass_matrix(wide[0])
    assert np.abs(M - expected).max() <= 1e-5 * np.abs(expected).max()
    assert np.abs(u - case.kernel.inverse_dynamics(*wide)).max() <= 1e-4 * case.size
    frame = case.kernel.frames[0]
    assert np.abs(single.frame_pose(arrays[0], frame) - case.kernel.frame_pose(wide[0], frame)).max() <= 1e-5


def chain_of_free_bodies(count: int) -> Robot:
    body = free_body()
    links = tuple(replace(body.links[0], name=f"body{i}") for i in range(count))
    joints = tuple(
        replace(body.joints[0], name=f"free{i}", parent=f"body{i - 1}" if i else "base", child=f"body{i}")
        for i in range(count)
    )
    return replace(body, name=f"free_bodies_{count}", links=links, joints=joints)


@pytest.mark.parametrize("beta", [np.pi / 2, -np.pi / 2, np.pi / 2 + 1e-9])
@pytest.mark.parametrize("count", [1, 3])
def test_euler_angles_at_their_singularity(count: int, beta: float, built: Build) -> None:
    """An error that names the coordinate, the state, and what may be the reason."""
    kernel = built(chain_of_free_bodies(count), "forward_dynamics")
    q = np.zeros((3, kernel.n))
    q[1, -2] = beta
    assert kernel.coordinates[-2] == f"free{count - 1}.beta"
    zero = np.zeros_like(q)
    with pytest.raises(SingularError, match=rf"free{count - 1}\.(alpha|beta|gamma) in state 1; .*beta"):
        kernel.forward_dynamics(q, zero, zero)
    with pytest.raises(SingularError, match=rf"free{count - 1}\.(alpha|beta|gamma); "):
        kernel.forward_dynamics(q[1], zero[1], zero[1])
    assert np.isfinite(kernel.forward_dynamics(q[::2], zero[::2], zero[::2])).all()


@pytest.mark.parametrize("joints", [2, 14])
def test_a_massless_tip_is_named(joints: int, built: Build) -> None:
    robot = chain_of_free_bodies(joints)
    planar = tuple(
        replace(joint, type="revolute", name=f"turn{i}", coordinates={"gamma": Coordinate()})
        for i, joint in enumerate(robot.joints)
    )
    links = (*robot.links[:-1], Link(robot.links[-1].name, 0.0, ZERO, (0.0,) * 6))
    kernel = built(
        replace(robot, name=f"tip_{joints}", joints=planar, links=links), "forward_dynamics", "inverse_dynamics"
    )
    zero = np.zeros(joints)
    with pytest.raises(SingularError, match=rf"turn{joints - 1}\.gamma"):
        kernel.forward_dynamics(zero, zero, zero)
    assert kernel.inverse_dynamics(zero, zero, zero)[-1] == 0.0


def test_a_rotor_makes_a_massless_tip_move(built: Build) -> None:
    body = free_body()
    joint = replace(body.joints[0], type="revolute", coordinates={"gamma": Coordinate(armature=0.5)})
    robot = replace(body, name="rotor", joints=(joint,), links=(Link("body", 0.0, ZERO, (0.0,) * 6),))
    assert built(robot, "forward_dynamics").forward_dynamics([0.3], [0.0], [2.0]) == pytest.approx([4.0])


@pytest.mark.parametrize("tilt", [(0.4, 0.5, 0.6), (0.5, 0.1, 0.0), (1.0, 0.3, 0.2), (0.2, 0.9, 0.1), (0.7, 0.2, 0.4)])
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_massless_link_between_slides(solver: str, tilt: tuple[float, float, float]) -> None:
    """Five coordinates move one mass: what the first slide leaves of the inertia is round-off, not a pivot."""
    body = free_body()
    slides = dict.fromkeys(("x", "y", "z", "gamma"), Coordinate())
    first = replace(body.joints[0], name="carriage", type="revolute", child="hollow", coordinates=slides)
    tilted = Placement.from_rpy((0.1, 0.2, 0.3), tilt)
    second = Joint("slide", "hollow", "body", "prismatic", tilted, coordinates={"z": Coordinate()})
    hollow = Link("hollow", 0.0, ZERO, (0.0,) * 6)
    model = build_model(replace(body, links=(hollow, body.links[0]), joints=(first, second)))
    program, _ = equations.derive_cheapest(model, "forward_dynamics", solver)
    inputs = {letter: [0.1, -0.2, 0.3, 0.4, 0.5] for letter in "qvu"}
    found = evaluate(program, {**inputs, "p": list(model.parameters.values())})
    assert any(not found["pivot", 2 * i] > 1e-12 * found["pivot", 2 * i + 1] for i in range(model.size))
