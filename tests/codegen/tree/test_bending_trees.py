"""Random trees whose links bend, beside Lagrange's equations of clouds of particles."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from eomgen.codegen.kernels.blocks import row_blocks
from eomgen.errors import InputError
from eomgen.robot.geometry import COORDINATES, IDENTITY
from eomgen.robot.model import FIXED_BODY, build_model
from eomgen.robot.parameter_names import parameters
from eomgen.robot.sections import AXES
from eomgen.robot.value import (
    BeamModes,
    Coordinate,
    Coupling,
    Frame,
    Joint,
    Link,
    LinkBeam,
    Placement,
    Robot,
    ShapesAlong,
    sliding_joint,
)
from tests.oracles.bending_lagrange import BendingOracle, Rail
from tests.oracles.complex_step import complex_jacobian, complex_steps
from tests.support.bending_robots import Bending, bent, with_mode_follower
from tests.support.programs import answer, by_solvers
from tests.support.random_robots import Array, State, random_robot, seeds, with_random_loops

LENGTH = 1.4  # m, of the link along which the joint slides
NO_BEAM = LinkBeam(LENGTH, 7e10, 2.6e10, 4e-4, 2e-8, 5e-8, 3e-8, (0.85, 0.8), 2700.0, BeamModes(1))  # its length counts


def sliding_robot(seed: int, *, follows: bool = False) -> tuple[Robot, BendingOracle]:
    """Return a robot as eomgen takes it, and Lagrange's equations of it.

    Args:
        seed: of its numbers, and of the axis of the beam.
        follows: whether the coordinate that slides follows that of another joint.
    """
    rng = np.random.default_rng([seed, 77])
    names, joints = ("arm", "trolley", "fore"), []
    links = [
        Link(x, rng.uniform(1, 3), _tuple(0.2 * rng.normal(size=3)), (0.5, 0.6, 0.7, 0.05, 0.0, 0.1)) for x in names
    ]
    for joint, parent, child, kind in (
        ("shoulder", "base", "arm", "revolute"),
        ("cross", "arm", "trolley", "prismatic"),
        ("sway", "trolley", "fore", "revolute"),
    ):
        principal = "z" if kind == "prismatic" else "gamma"
        coordinate = Coordinate(stiffness=2.0, damping=0.1, armature=0.2)
        placement = Placement.from_rpy(_tuple(0.3 * rng.normal(size=3)), _tuple(rng.normal(size=3)))
        joints.append(Joint(joint, parent, child, kind, placement, coordinates={principal: coordinate}))
    axis = list(AXES)[seed % len(AXES)]
    gravity = _tuple(3.0 * rng.normal(size=3))
    plain = Robot("sliding", gravity, tuple(links), tuple(joints), (Frame("tool", "fore"), Frame("on", "trolley")))
    bending = bent(plain, seed, (2, 3))
    arm = bending.plain.link("arm")
    m, beam = arm.modes.count, replace(NO_BEAM, axis=axis)
    first = 0.3 * rng.normal(size=(6, m, 4)) * (rng.random(6) < 0.7)[:, None, None]
    second, slopes = _drawn_in(rng, m) if rng.random() < 0.7 else (np.zeros((6, m, m, 4)), {})
    parts = sliding_joint(plain.joint("cross"), replace(arm, beam=beam), _shapes(first, second, slopes))
    slides, place = parts.joints
    straight = replace(plain.joint("cross"), placement=slides.placement)
    more = (Coupling("belt", "cross.z", {"shoulder.gamma": 0.4}, 0.3),) if follows else ()
    described = replace(
        bending.plain, joints=tuple(straight if x.name == "cross" else x for x in plain.joints), couplings=more
    )
    nodes = {x: y for x, y in bending.nodes.items() if x != "cross"}
    whole = replace(bending, plain=described, nodes=nodes, frames={})
    robot = whole.robot
    made = [y for x in robot.joints for y in ((slides, place) if x.name == "cross" else (x,))]
    robot = replace(
        robot, links=(*robot.links, parts.link), joints=tuple(made), couplings=(*robot.couplings, *parts.couplings)
    )
    rails = {"cross": Rail(LENGTH, first, second)}
    oracle = BendingOracle(described, whole.clouds, whole.nodes, build_model(robot).coordinates, rails)
    return robot, oracle


def sliding_state(robot: Robot, seed: int) -> State:
    """Draw a state: modal coordinates up to 0.4, the joint on the beam."""
    names = build_model(robot).coordinates
    rng = np.random.default_rng([seed, 78])
    q, v, a, u = rng.uniform(-1.0, 1.0, (4, len(names)))
    q = np.where(["mode" in name for name in names], 0.4 * q, q)
    return State(np.where([name == "cross.z" for name in names], LENGTH * (0.5 + 0.4 * q), q), v, a, u)


Groups = dict[str, list[tuple[float, list[tuple[int, tuple[float, ...]]]]]]


def _drawn_in(rng: np.random.Generator, m: int) -> tuple[Array, Groups]:
    """Draw second derivatives by pairs of modes, (6, m, m, 4): constants, and integrals of products of slopes.

    Even and odd modes are the groups of which slopes are multiplied; these are returned, too.
    """
    half = 0.2 * rng.normal(size=(6, m, m, 4)) * (np.arange(6) < 3)[:, None, None, None] * (np.arange(4) == 0)
    second, slopes = half + half.transpose(0, 2, 1, 3), 0.5 * rng.normal(size=(3, m, 2))
    groups: Groups = {}
    for i, kind in enumerate(COORDINATES[:3]):
        for begin in range(min(m, 2)):
            sense, modes = float(rng.choice([-1.0, 1.0])), range(begin, m, 2)
            groups.setdefault(kind, []).append((sense, [(k, _tuple(slopes[i, k])) for k in modes]))
            for k, j in itertools.product(modes, modes):
                product = chebyshev.chebmul(slopes[i, k], slopes[i, j])
                second[i, k, j] += sense * np.resize([*chebyshev.chebint(product, scl=LENGTH / 2.0), 0.0, 0.0], 4)
    return second, groups


def _shapes(first: Array, second: Array, slopes: Groups) -> ShapesAlong:
    m = range(first.shape[1])
    return ShapesAlong(
        {kind: [(k, _tuple(row[k])) for k in m] for kind, row in zip(COORDINATES, first, strict=True) if row.any()},
        {
            kind: [(k, j, _tuple(row[k, j])) for k in m for j in m if k <= j]
            for kind, row in zip(COORDINATES, second, strict=True)
            if row.any()
        },
        slopes,
    )


def _tuple(x: Array) -> Any:
    return tuple(map(float, x))


LIMIT = 1e-12  # relative to the largest number of a result


def draw(seed: int, *, follows: bool = True) -> Bending:
    """A tree of two to four joints with any subset of six coordinates, or all; links of 0 to 3 modes."""
    types = ("revolute", "prismatic", "fixed", "free")
    robot = random_robot(seed, (2, 4), 3, tree=True, types=types, name=f"bending{seed}")
    bending = bent(robot, seed)
    return with_mode_follower(bending, seed) if seed % 3 == 2 and follows else bending


def close(found: Array, expected: Array, limit: float = LIMIT) -> None:
    assert np.abs(found - expected.ravel()).max() <= limit * np.abs(expected).max(), (found, expected)


@pytest.mark.parametrize("seed", seeds(100, 6, 60))
def test_random_trees_are_those_of_lagrange(seed: int) -> None:
    bending = draw(seed)
    check_dynamics(bending.robot, bending.oracle(), bending.state(seed))


@pytest.mark.parametrize("seed", seeds(500, 3, 24))
def test_numbers_that_are_parameters_are_those_of_the_description(seed: int) -> None:
    """Masses of rigid links, placements, springs of joints and of modes as run-time values: the same motion."""
    bending = draw(seed)
    names = tuple(".".join(x.path) for x in parameters(bending.robot) if x.is_set)
    assert any(".modes.1.stiffness" in name for name in names)
    check_dynamics(replace(bending.robot, tunable=names), bending.oracle(), bending.state(seed))


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
    for block, label in zip(answer(robot, "residual_jacobian", s).reshape(3, n, n), "qva", strict=True):
        close(block.ravel(), complex_steps(robot, s, label))
    C = answer(robot, "coriolis_matrix", q=s.q, v=s.v).reshape(n, n)
    close((C + C.T).ravel(), oracle.mass_matrix_rate(s.q, s.v))
    close(C @ s.v, oracle.bias_force(s.q, s.v), 1e-11)


@pytest.mark.parametrize("seed", seeds(400, 4, 30))
def test_loops_on_random_trees(seed: int) -> None:
    """J is the derivative of g, and J_dot v + J a that of J v along the motion; so are their own derivatives."""
    bending = draw(seed, follows=False)
    kinds = np.random.default_rng(seed).choice(["revolute", "prismatic", "fixed", "spherical"], 2)
    robot, s = with_random_loops(bending.robot, seed, kinds.tolist()), bending.state(seed)
    n, g, J = len(s.q), answer(robot, "constraint", q=s.q), answer(robot, "constraint_jacobian", q=s.q)
    close(J, complex_jacobian(robot, "constraint", {"q": s.q}, "q"))
    turning = complex_jacobian(robot, "constraint_jacobian", {"q": s.q}, "q").reshape(len(g), n, n)
    close(answer(robot, "constraint_bias", q=s.q, v=s.v), turning @ s.v @ s.v)
    multipliers = np.linspace(-1.0, 1.0, len(g))
    values = answer(robot, "closing_derivatives", q=s.q, v=s.v, a=s.a, multipliers=multipliers)
    by_q, by_v = (complex_jacobian(robot, "constraint_bias", {"q": s.q, "v": s.v}, x) for x in "qv")
    by_q = by_q + np.einsum("rij,i->rj", turning, s.a)
    total, at = np.zeros((n, n)), 0
    for block in row_blocks(build_model(robot)):
        rows, columns = slice(block.first, block.first + block.rows), list(block.columns)
        for whole in (x[rows] for x in (J.reshape(-1, n), by_q, by_v)):
            assert not np.delete(whole, columns, axis=1).any()
            close(values[at : at + block.size], whole[:, columns], 1e-11)
            at += block.size
        total[np.ix_(columns, columns)] += values[at : at + len(columns) ** 2].reshape(len(columns), -1)
        at += len(columns) ** 2
    close(total.ravel(), np.einsum("r,rij->ij", multipliers, turning), 1e-11)


@pytest.mark.parametrize("seed", seeds(700, 4, 30))
@pytest.mark.parametrize("nodes", [True, False])
def test_motions_of_closed_loops(seed: int, nodes: bool) -> None:
    """M a + h = u + J^T lambda and J a + J_dot v = 0, also where no node moves with the modes."""
    robot, bending, s, J = with_loop(seed, nodes=nodes)
    n, oracle = len(s.q), bending.oracle()
    whole = np.block([[oracle.mass_matrix(s.q), -J.T], [J, np.zeros((len(J), len(J)))]])
    bias = answer(robot, "constraint_bias", q=s.q, v=s.v)
    expected = np.linalg.solve(whole, np.concatenate([-oracle.residual(s.q, s.v, np.zeros(n), s.u), -bias]))
    for values in by_solvers(robot, "constrained_dynamics", q=s.q, v=s.v, u=s.u).values():
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


def check_dynamics(robot: Robot, oracle: BendingOracle, s: State) -> None:
    """Compare terms of the equations, accelerations by all solvers, energies and momenta with Lagrange's equations."""
    M, residual = oracle.mass_matrix(s.q), oracle.residual(s.q, s.v, s.a, s.u)
    close(answer(robot, "mass_matrix", q=s.q), M)
    close(answer(robot, "residual", s), residual)
    close(answer(robot, "bias_force", q=s.q, v=s.v), oracle.bias_force(s.q, s.v))
    close(answer(robot, "inverse_dynamics", s), residual + s.u)
    for a in by_solvers(robot, "forward_dynamics", q=s.q, v=s.v, u=residual + s.u).values():
        close(a, s.a, 1e-13 * float(np.linalg.cond(M)))
    close(answer(robot, "energy", s), np.array(oracle.energy(s.q, s.v)))
    center, linear, angular = oracle.momentum(s.q, s.v)
    close(answer(robot, "center_of_mass", q=s.q), center)
    close(answer(robot, "centroidal_momentum", q=s.q, v=s.v), np.concatenate([linear, angular]))


@pytest.mark.parametrize("seed", seeds(200, 2, 12))
def test_frames_move_with_the_beam(seed: int) -> None:
    robot, oracle = sliding_robot(seed)
    s = sliding_state(robot, seed)
    frames = [x for x in oracle.robot.frames if x.name in ("tool", "on")]
    assert [x.name for x in frames] == list(build_model(robot).frames)[: len(frames)]
    poses = np.array([oracle.pose(frame, s.q)[:3] for frame in frames])
    close(answer(robot, "kinematics", q=s.q)[: poses.size], poses)
    rates = np.array([oracle.jacobian(frame, s.q) @ s.v for frame in frames])
    close(answer(robot, "frame_velocities", q=s.q, v=s.v)[: rates.size], rates)
    moved = np.array([oracle.acceleration(frame, (s.q, s.v, s.a)) for frame in frames])
    close(answer(robot, "frame_accelerations", q=s.q, v=s.v, a=s.a)[: moved.size], moved)


@pytest.mark.parametrize("seed", seeds(300, 0, 12))
def test_derivatives_of_sliding_joints_are_those_of_complex_steps(seed: int) -> None:
    robot, oracle = sliding_robot(seed)
    s = sliding_state(robot, seed)
    n = len(s.q)
    for found, label in zip(answer(robot, "residual_jacobian", s).reshape(3, n, n), "qva", strict=True):
        close(found.ravel(), complex_steps(robot, s, label), 1e-11)
    symbols = oracle.christoffel(s.q)
    close(answer(robot, "christoffel", q=s.q), symbols, 1e-11)
    close(answer(robot, "coriolis_matrix", q=s.q, v=s.v), symbols @ s.v, 1e-11)


@pytest.mark.parametrize("seed", seeds(400, 1, 6))
def test_what_modes_leave_out_is_not_there(seed: int) -> None:
    """A rigid robot has a joint that slides along a straight link."""
    robot, oracle = sliding_robot(seed)
    rigid = robot.rigid()
    names = build_model(rigid).coordinates
    assert names == ("shoulder.gamma", "cross.z", "sway.gamma")
    s = sliding_state(robot, seed)
    places = [build_model(robot).coordinates.index(name) for name in names]
    q = np.zeros_like(s.q)
    q[places] = s.q[places]
    expected = oracle.mass_matrix(q)[np.ix_(places, places)]
    close(answer(replace(rigid, name="stiff"), "mass_matrix", q=q[places]), expected)


@pytest.mark.parametrize("seed", seeds(100, 3, 30))
def test_joints_that_slide_along_links_that_bend(seed: int) -> None:
    """Every third with a coordinate that slides as another one makes it."""
    robot, oracle = sliding_robot(seed, follows=seed % 3 == 1)
    check_dynamics(robot, oracle, sliding_state(robot, seed))
