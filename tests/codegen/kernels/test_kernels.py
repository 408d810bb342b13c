"""Laws of mechanics that compiled kernels keep, and four ways to the same numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.kernels import equations
from eomgen.codegen.kernels.accelerations import FACTORISED, SOLVERS
from eomgen.codegen.program.ir import evaluate
from eomgen.codegen.tree.bound import bind
from eomgen.codegen.tree.composite import mass_matrix
from eomgen.codegen.tree.frozen_joints import PosedTree, geometry
from eomgen.codegen.tree.recursion import inertial_rows
from eomgen.errors import SingularError
from eomgen.robot.geometry import ZERO
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, Placement, Robot
from tests.oracles.lagrange import LagrangeOracle
from tests.support.builds import Build
from tests.support.closeness import distance
from tests.support.figures import Figures
from tests.support.many_laws import CHECKS
from tests.support.many_robots import Subject
from tests.support.programs import answer, by_solvers
from tests.support.random_robots import Array, random_robot, random_state, random_states, seeds
from tests.support.refusals import refused
from tests.support.small_robots import free_body
from tests.support.soak import soaked

TOLERANCE = 1e-11  # relative, max-norm
STATES = 20
TYPES = ("revolute", "prismatic", "fixed", "free")


KERNELS = (
    "reactions",
    "residual_jacobian",
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
def case(request: pytest.FixtureRequest, built: Build) -> Subject:
    """A random robot, its kernel, and STATES random states."""
    seed = request.param
    robot = random_robot(seed, joints=(1, 4), tree=seed % 2 == 0, types=TYPES, rods=False)
    return Subject(robot, built(robot, *KERNELS), *random_states(robot, seed, STATES), "energy, christoffel, jacobians")


def times(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))


def test_terms_add_up_to_the_residual(case: Subject) -> None:
    """Forces are linear in accelerations; the bias is a quadratic form of rates, with the Christoffel symbols."""
    k, q, v, a, u, size = case.kernel, case.q, case.v, case.a, case.u, case.forces.max()
    total = times(case.M, a) + k.bias_force(q, v) - k.generalized_force(q, v)
    assert np.abs(k.inverse_dynamics(q, v, a) - total).max() <= TOLERANCE * size
    assert np.abs(k.residual(q, v, a, u) - (total - u)).max() <= TOLERANCE * (size + np.abs(u).max())
    assert np.abs(k.residual(q, v, k.forward_dynamics(q, v, u), u)).max() <= 1e-9 * (size + np.abs(u).max())
    assert np.array_equal(k.bias_force(q, 0 * v), np.zeros_like(v))
    T = k.christoffel(q)
    assert np.abs(T - np.swapaxes(T, 2, 3)).max() <= TOLERANCE * np.abs(case.M).max()
    bias = np.einsum("nsvw,nv,nw->ns", T, v, v)
    assert np.abs(bias - k.bias_force(q, v)).max() <= TOLERANCE * np.abs(case.M).max() * np.abs(v).max() ** 2


def recursion_on_floats(robot: Robot, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Inverse dynamics and M by the generator's recursions, run on plain floats: no graph, no C."""
    model = build_model(robot)
    bound = bind(model, lambda _, number: number, lambda x: (math.sin(x), math.cos(x)))
    tree = PosedTree(model, bound, geometry(model, bound, list(q), lambda x: (math.sin(x), math.cos(x))))
    rows, _ = inertial_rows(tree, list(v), list(a), bound.gravity)
    u = np.array(rows) + [x.stiffness * s + x.damping * rate for x, s, rate in zip(bound.laws, q, v, strict=True)]
    M = np.zeros((model.size, model.size))
    for (i, j), value in mass_matrix(tree).items():
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


def test_loop_equals_straight_line(built: Build, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tensor C of large robots (one Coriolis matrix per column) against that of small ones."""
    robot = random_robot(44, joints=(4, 4), tree=True, types=("revolute", "free"), max_coordinates=3)
    kernels = []
    for name, limit in (("in_loops", 0), ("in_lines", 10**9)):  # the cache does not know of the limit
        monkeypatch.setattr(equations, "STRAIGHT_COLUMNS", limit)
        kernels.append(built(replace(robot, name=name), "christoffel"))
    loop, line = kernels
    assert loop.operations != line.operations
    q, *_ = random_states(robot, 4, STATES)
    T = line.christoffel(q)
    assert np.abs(loop.christoffel(q) - T).max() <= 1e-13 * np.abs(T).max()


@pytest.mark.parametrize("seed", seeds(0, 1, 12))
def test_solvers_of_forward_dynamics_agree(seed: int) -> None:
    """Factorised and eliminated: chains and trees, any coordinates, joints with six of them and armature on some."""
    types = ("revolute", "prismatic", "fixed", "free") if seed % 2 else ("free",)
    robot = random_robot(seed, joints=(1, 4), tree=seed % 3 == 0, types=types, armature=seed % 4 < 2)
    s = random_state(robot, seed)
    first, second = by_solvers(robot, "forward_dynamics", q=s.q, v=s.v, u=s.u).values()
    M = answer(robot, "mass_matrix", s).reshape(len(s.q), -1)
    assert distance(second, first) <= 10 * np.linalg.cond(M) * np.finfo(float).eps


def test_cheaper_solver_is_chosen() -> None:
    for name, is_factorised in (("puma560", True), ("puma560_elastic", False)):
        chosen = equations.derive_cheapest(build_model(eomgen.load_robot(name)), "forward_dynamics")[1]
        assert (chosen == FACTORISED) == is_factorised


def test_single_precision(case: Subject, built: Build) -> None:
    single = built(case.robot, "mass_matrix", "inverse_dynamics", "kinematics", dtype="float32")
    arrays = [x.astype(np.float32) for x in (case.q, case.v, case.a)]
    wide = [x.astype(np.float64) for x in arrays]
    M, u = single.mass_matrix(arrays[0]), single.inverse_dynamics(*arrays)
    assert M.dtype == u.dtype == single.dtype == np.float32
    expected = case.kernel.mass_matrix(wide[0])
    assert np.abs(M - expected).max() <= 1e-5 * np.abs(expected).max()
    assert np.abs(u - case.kernel.inverse_dynamics(*wide)).max() <= 1e-4 * case.forces.max()
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
    refused(SingularError, rf"free{count - 1}\.(alpha|beta|gamma); ", kernel.forward_dynamics, q[1], zero[1], zero[1])
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
    refused(SingularError, rf"turn{joints - 1}\.gamma", kernel.forward_dynamics, zero, zero, zero)
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


@pytest.mark.parametrize("law", CHECKS)
def test_laws_of_mechanics(law: Callable[[Subject, Figures], None], case: Subject, figures: Figures) -> None:
    law(case, figures)
