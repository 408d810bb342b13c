"""Random trees whose links bend, beside Lagrange's equations of clouds of particles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from eomgen.codegen.kernels.accelerations import CONSTRAINED, SOLVERS
from eomgen.codegen.kernels.blocks import row_blocks
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive, derive_cheapest
from eomgen.codegen.program.ir import evaluate
from eomgen.errors import InputError
from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import FIXED_BODY, build_model
from eomgen.robot.parameter_names import parameters
from eomgen.robot.value import Frame, Placement, Robot
from tests.oracles.complex_step import complex_jacobian, complex_steps
from tests.support.bending_robots import Bending, bent, with_mode_follower
from tests.support.random_robots import Array, State, random_robot, seeds, with_random_loops

LIMIT = 1e-12  # relative to the largest number of a result


def answer(robot: Robot, kernel: str, **arrays: Array) -> Array:
    """Return a kernel's outputs, (outputs,), from its program in Python's arithmetic."""
    model = build_model(robot)
    inputs = {name: list(map(float, array)) for name, array in arrays.items()}
    inputs["p"] = [*model.parameters.values(), *[0.0] * len(model.turning)]
    found = evaluate(derive(model, kernel), inputs)
    return np.array([found[key] for key in sorted(found) if key[0] == "out"])


def draw(seed: int, *, follows: bool = True) -> Bending:
    """A tree of two to four joints with any subset of six coordinates, or all; links of 0 to 3 modes."""
    types = ("revolute", "prismatic", "fixed", "free")
    robot = random_robot(seed, (2, 4), 3, tree=True, types=types, name=f"bending{seed}")
    bending = bent(robot, seed)
    return with_mode_follower(bending, seed) if seed % 3 == 2 and follows else bending


def accelerations(robot: Robot, kernel: str = "forward_dynamics", **arrays: Array) -> dict[str, Array]:
    """Return accelerations, (n,), and what else a kernel gives behind them, by the solvers that suit a robot."""
    model = build_model(robot)
    inputs = {name: list(map(float, array)) for name, array in arrays.items()}
    inputs["p"] = [*model.parameters.values(), *[0.0] * len(model.turning)]
    by_solver = {}
    for solver, variant in (CONSTRAINED if robot.loops else SOLVERS).items():
        if variant.suits(Derivation(model)):
            found = evaluate(derive_cheapest(model, kernel, solver)[0], inputs)
            by_solver[solver] = np.array([found[key] for key in sorted(found) if key[0] == "out"])
    return by_solver


def slopes(robot: Robot, kernel: str, label: str, **arrays: Array) -> Array:
    """Return derivatives of a kernel's outputs by one of its arrays, (outputs, numbers), by complex steps."""
    return complex_jacobian(robot, kernel, arrays, label)


def close(found: Array, expected: Array, limit: float = LIMIT) -> None:
    assert np.abs(found - expected.ravel()).max() <= limit * np.abs(expected).max(), (found, expected)


@pytest.mark.parametrize("seed", seeds(100, 6, 60))
def test_random_trees_are_those_of_lagrange(seed: int) -> None:
    bending = draw(seed)
    robot, oracle, s = bending.robot, bending.oracle(), bending.state(seed)
    M, residual = oracle.mass_matrix(s.q), oracle.residual(s.q, s.v, s.a, s.u)
    close(answer(robot, "mass_matrix", q=s.q), M)
    close(answer(robot, "residual", q=s.q, v=s.v, a=s.a, u=s.u), residual)
    close(answer(robot, "bias_force", q=s.q, v=s.v), oracle.bias_force(s.q, s.v))
    close(answer(robot, "inverse_dynamics", q=s.q, v=s.v, a=s.a), residual + s.u)
    found = accelerations(robot, q=s.q, v=s.v, u=residual + s.u)
    assert found
    for a in found.values():
        close(a, s.a, 1e-13 * float(np.linalg.cond(M)))
    close(answer(robot, "energy", q=s.q, v=s.v), np.array(oracle.energy(s.q, s.v)))
    center, linear, angular = oracle.momentum(s.q, s.v)
    close(answer(robot, "center_of_mass", q=s.q), center)
    close(answer(robot, "centroidal_momentum", q=s.q, v=s.v), np.concatenate([linear, angular]))


@pytest.mark.parametrize("seed", seeds(500, 3, 24))
def test_numbers_that_are_parameters_are_those_of_the_description(seed: int) -> None:
    """Masses of rigid links, placements, springs of joints and of modes as run-time values: the same motion."""
    bending = draw(seed)
    oracle, s = bending.oracle(), bending.state(seed)
    names = tuple(".".join(x.path) for x in parameters(bending.robot) if x.is_set)
    assert any(".modes.1.stiffness" in name for name in names)
    robot = replace(bending.robot, tunable=names)
    residual = oracle.residual(s.q, s.v, s.a, s.u)
    close(answer(robot, "residual", q=s.q, v=s.v, a=s.a, u=s.u), residual)
    close(answer(robot, "mass_matrix", q=s.q), oracle.mass_matrix(s.q))
    found = accelerations(robot, q=s.q, v=s.v, u=residual + s.u)
    for a in found.values():
        close(a, s.a, 1e-13 * float(np.linalg.cond(oracle.mass_matrix(s.q))))


@pytest.mark.parametrize("seed", seeds(200, 3, 30))
def test_frames_of_random_trees_move_with_the_modes(seed: int) -> None:
    """Poses, velocities and accelerations of frames, links and nodes."""
    bending = draw(seed)
    robot, oracle, s = bending.robot, bending.oracle(), bending.state(seed)
    standing = bending.standing()
    frames = [standing[name] for name in build_model(robot).frames]
    poses = np.array([oracle.pose(frame, s.q, node)[:3] for frame, node in frames])
    close(answer(robot, "kinematics", q=s.q)[: poses.size], poses)
    rates = np.array([oracle.jacobian(frame, s.q, node) @ s.v for frame, node in frames])
    close(answer(robot, "frame_velocities", q=s.q, v=s.v), rates)
    accelerations = np.array([oracle.acceleration(frame, (s.q, s.v, s.a), node) for frame, node in frames])
    close(answer(robot, "frame_accelerations", q=s.q, v=s.v, a=s.a), accelerations)


@pytest.mark.parametrize("seed", seeds(600, 3, 24))
def test_wrenches_on_links_and_nodes(seed: int) -> None:
    """Forces and moments go to the coordinates by the Jacobians of the points that they act on, J^T w."""
    bending = draw(seed)
    robot, oracle, s = bending.robot, bending.oracle(), bending.state(seed)
    links, standing = build_model(robot).links, bending.standing()
    wrench = np.random.default_rng(seed).normal(size=(len(links), 6))
    force = np.zeros(len(s.q))
    for name, w in zip(links, wrench, strict=True):
        frame, node = standing[name]
        force += oracle.jacobian(replace(frame, placement=Placement(robot.link(name).com)), s.q, node).T @ w
    close(answer(robot, "external_force", q=s.q, wrench=wrench.ravel()), force)


@pytest.mark.parametrize("seed", seeds(800, 3, 24))
def test_reactions_on_the_ground_are_what_changes_the_momenta(seed: int) -> None:
    """Newton and Euler of the whole robot: wrenches of joints on the base, drives among them, less the weight."""
    types = ("revolute", "prismatic", "fixed")
    plain = random_robot(seed, (2, 4), 3, tree=True, types=types, armature=False)
    still = tuple(replace(x, axis_turn=IDENTITY) for x in plain.joints)
    bending = bent(replace(plain, joints=still), seed)
    robot, oracle, s = bending.robot, bending.oracle(), bending.state(seed)
    model, total = build_model(robot), np.zeros(6)
    reactions = answer(robot, "reactions", q=s.q, v=s.v, a=s.a).reshape(-1, 6)
    for body, wrench in zip(model.bodies, reactions, strict=True):
        if body.parent == FIXED_BODY:
            A = oracle.pose(Frame(body.name, body.name), s.q)
            force = A[:3, :3] @ wrench[:3]
            total += np.concatenate([force, A[:3, :3] @ wrench[3:] + np.cross(A[:3, 3], force)])
    close(total, oracle.ground_wrench(s.q, s.v, s.a), 1e-11)


@pytest.mark.parametrize("seed", seeds(300, 3, 30))
def test_derivatives_of_random_trees(seed: int) -> None:
    """The residual's by complex steps of its program; C v is the bias, C + C^T the rate of M, and C is linear in v."""
    bending = draw(seed)
    robot, oracle, s = bending.robot, bending.oracle(), bending.state(seed)
    n = len(s.q)
    found = answer(robot, "residual_jacobian", q=s.q, v=s.v, a=s.a).reshape(3, n, n)
    for block, label in zip(found, "qva", strict=True):
        close(block.ravel(), complex_steps(robot, s, label))
    C = answer(robot, "coriolis_matrix", q=s.q, v=s.v).reshape(n, n)
    rate = oracle.mass_matrix_rate(s.q, s.v)
    close((C + C.T).ravel(), rate)
    close(C @ s.v, oracle.bias_force(s.q, s.v), 1e-11)


@pytest.mark.parametrize("seed", seeds(400, 4, 30))
def test_loops_on_random_trees(seed: int) -> None:
    """J is the derivative of g, and J_dot v + J a that of J v along the motion; so are their own derivatives."""
    bending = draw(seed, follows=False)
    kinds = np.random.default_rng(seed).choice(["revolute", "prismatic", "fixed", "spherical"], 2)
    robot, s = with_random_loops(bending.robot, seed, kinds.tolist()), bending.state(seed)
    n, g = len(s.q), answer(robot, "constraint", q=s.q)
    J = answer(robot, "constraint_jacobian", q=s.q)
    close(J, slopes(robot, "constraint", "q", q=s.q))
    bias = slopes(robot, "constraint_jacobian", "q", q=s.q).reshape(len(g), n, n) @ s.v @ s.v
    close(answer(robot, "constraint_bias", q=s.q, v=s.v), bias)
    multipliers = np.linspace(-1.0, 1.0, len(g))
    values = answer(robot, "closing_derivatives", q=s.q, v=s.v, a=s.a, multipliers=multipliers)
    by_q = slopes(robot, "constraint_bias", "q", q=s.q, v=s.v)
    by_q = by_q + np.einsum("rij,i->rj", slopes(robot, "constraint_jacobian", "q", q=s.q).reshape(len(g), n, n), s.a)
    by_v = slopes(robot, "constraint_bias", "v", q=s.q, v=s.v)
    pulled = np.einsum("r,rij->ij", multipliers, slopes(robot, "constraint_jacobian", "q", q=s.q).reshape(-1, n, n))
    at = 0
    for block in row_blocks(build_model(robot)):
        rows, columns = slice(block.first, block.first + block.rows), list(block.columns)
        own = [x[rows] for x in (J.reshape(-1, n), by_q, by_v)]
        for whole in own:
            assert not np.delete(whole, columns, axis=1).any()
            close(values[at : at + block.size], whole[:, columns], 1e-11)
            at += block.size
        at += len(columns) ** 2
    total, at = np.zeros((n, n)), 0
    for block in row_blocks(build_model(robot)):
        at += 3 * block.size
        size = len(block.columns)
        total[np.ix_(block.columns, block.columns)] += values[at : at + size**2].reshape(size, size)
        at += size**2
    close(total.ravel(), pulled, 1e-11)


@pytest.mark.parametrize("seed", seeds(700, 4, 30))
@pytest.mark.parametrize("nodes", [True, False])
def test_motions_of_closed_loops(seed: int, nodes: bool) -> None:
    """M a + h = u + J^T lambda and J a + J_dot v = 0, also where no node moves with the modes."""
    robot, bending, s, J = with_loop(seed, nodes=nodes)
    n, oracle = len(s.q), bending.oracle()
    whole = np.block([[oracle.mass_matrix(s.q), -J.T], [J, np.zeros((len(J), len(J)))]])
    bias = answer(robot, "constraint_bias", q=s.q, v=s.v)
    right = np.concatenate([-oracle.residual(s.q, s.v, np.zeros(n), s.u), -bias])
    expected = np.linalg.solve(whole, right)
    found = accelerations(robot, "constrained_dynamics", q=s.q, v=s.v, u=s.u)
    assert found
    for values in found.values():
        assert np.abs(values[:n] - expected[:n]).max() < 1e-14 * np.linalg.cond(whole) * np.abs(expected).max()


def with_loop(seed: int, *, nodes: bool) -> tuple[Robot, Bending, State, Array]:
    """Draw a robot with a loop whose rows are independent in a state, and J there; ``nodes``: whether any move."""
    for number in range(seed, seed + 20000, 1000):
        bending = draw(number, follows=False)
        if not nodes:
            modes = {x.name: replace(x.modes, nodes=()) for x in bending.plain.links if x.modes is not None}
            links = tuple(replace(x, modes=modes.get(x.name)) for x in bending.plain.links)
            bending = replace(bending, plain=replace(bending.plain, links=links), nodes={}, frames={})
        robot, s = with_random_loops(bending.robot, number, ["spherical"]), bending.state(number)
        J = answer(robot, "constraint_jacobian", q=s.q).reshape(-1, len(s.q))
        if np.linalg.matrix_rank(J, 1e-6) == len(J):
            return robot, bending, s, J
    raise AssertionError("no robot among twenty has independent rows")


@pytest.mark.parametrize("key", ["K", "D"])
@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        (((4.0, 0.1), (0.2, 5.0)), r"got 0\.1 at \(1, 2\), 0\.2 at \(2, 1\); allowed: a symmetric"),
        (((1.0, 3.0), (3.0, 4.0)), r"scaled by its diagonal it has the eigenvalue -0\.5; allowed: .* semidefinite"),
        (((-1.0, 0.0), (0.0, 4.0)), r"scaled by its diagonal it has the eigenvalue -1; allowed"),
        (((0.0, 1e-9), (1e-9, 4.0)), r"got 1e-09 at \(1, 2\), 0 at \(1, 1\); allowed: a positive semidefinite"),
        (((4.0, math.nan), (math.nan, 4.0)), r"got nan at \(1, 2\); allowed: finite"),
    ],
)
def test_matrices_by_which_motions_give_energy_are_refused(
    key: str, matrix: tuple[tuple[float, ...], ...], said: str
) -> None:
    bending = bent(random_robot(1, (1, 1)), 1, (2,))
    links = tuple(
        x if x.modes is None else replace(x, modes=replace(x.modes, **{key: matrix})) for x in bending.plain.links
    )
    with pytest.raises(InputError, match=rf"links\.link1\.modes\.{key}: {said}"):
        build_model(replace(bending, plain=replace(bending.plain, links=links)).robot)
