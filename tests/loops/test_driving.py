"""Inverse dynamics, reactions and derivatives of closed mechanisms in C, against singular values and differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.solve.drives import WEIGHINGS, least_drives
from eomgen.codegen.solve.rows import Row
from eomgen.errors import LoopError, UnknownNameError
from eomgen.integration import integrate
from eomgen.kernel.complete import Kernel
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Coordinate, Coupling, Placement, Robot
from tests.oracles import closed_loops as oracle
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.linkages import KERNELS as LOOP_KERNELS
from tests.support.methods import method_of
from tests.support.random_robots import Array, random_state
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

CLOSURE: tuple[str, ...] = ("constraint", "constraint_jacobian", "constraint_bias", "cut_poses")
KERNELS = (*CLOSURE, "forward_dynamics", "inverse_dynamics", "external_force", "kinematics")
STATICS = (*KERNELS, "reactions", "external_reactions", "loop_reactions")
DERIVED = (*CLOSURE, "forward_dynamics", "constrained_dynamics", "forward_dynamics_jacobian")
GUESSES = {
    "four_bar": ([0.5, 0.2, 1.2], (0,)),
    "bennett": ([1.0, 1.5, -1.0], (0,)),
    "gough": ([0.1, -0.05, 0.9, 0.1, -0.2, 0.15, *[0.0, 0.0, 1.0] * 6], range(6)),
}


def driven_at(name: str, *driven: str, choose: bool = True) -> Robot:
    """An example with drives at these coordinates, or at all principal ones where nothing is chosen."""
    robot = eomgen.load_robot(name)
    return replace(robot, driven=driven if choose else None, name=f"{name}_{'_'.join(driven).replace('.', '_')}")


def states(kernel: Kernel, name: str, count: int, seed: int = 1) -> tuple[Array, Array, Array]:
    """Closed states and accelerations under random drives, (count, n) each."""
    rng = np.random.default_rng(seed)
    guess, held = GUESSES[name]
    found, stays = [], np.isin(np.arange(kernel.n), list(held))
    for _ in range(count):
        moved = np.array(guess) + np.where(stays, rng.uniform(-0.1, 0.1, kernel.n), 0.0)
        found.append(oracle.closed_state(kernel, moved, list(held), rng))
    q, v = (np.array(x) for x in zip(*found, strict=True))
    return q, v, kernel.forward_dynamics(q, v, rng.normal(size=q.shape))


def given(robot: Robot, name: str, coordinate: str) -> Robot:
    """The robot with one coordinate prescribed, which then has no drive."""
    joints = []
    for joint in robot.joints:
        if joint.name == name:
            numbers = dict(joint.coordinates)
            numbers[coordinate] = replace(numbers[coordinate], prescribed=True)
            joint = replace(joint, coordinates=numbers)
        joints.append(joint)
    kept = None if robot.driven is None else tuple(x for x in robot.driven if x != f"{name}.{coordinate}")
    return replace(robot, joints=tuple(joints), driven=kept)


def drives_of(kernel: Kernel) -> list[int]:
    return list(kernel.raw.libraries.meta["driven"])


@pytest.mark.parametrize("seed", range(40))
def test_least_drives_of_random_rows(seed: int) -> None:
    """Just driven, with too many drives, without any to spare; rows that follow from others, lengths far from 1 m."""
    rng = np.random.default_rng(seed)
    n, rank, length = int(rng.integers(4, 12)), int(rng.integers(2, 5)), 10.0 ** rng.uniform(-1, 1)
    turning = rng.random(n) < 0.6
    J = rng.normal(size=(rank, n)) * np.where(turning, length, 1.0)
    J = np.vstack([J, rng.normal(size=(int(rng.integers(0, 3)), rank)) @ J])
    driven = set(rng.permutation(n)[: int(rng.integers(n - rank, n + 1))].tolist())
    u = np.array([rng.normal() * length ** turning[i] if i in driven else 0.0 for i in range(n)])
    needed = u + J.T @ rng.normal(size=len(J))
    expected = oracle.least_drives(J, needed, sorted(driven))[0]
    rows = [Row({i: float(x) for i, x in enumerate(row)}, 0.0, group=(0, False)) for row in J]
    found, multipliers, left = map(
        np.array, least_drives(rows, needed.tolist(), driven, lambda i: bool(turning[i]), WEIGHINGS["float64"])
    )
    size = np.abs(needed).max()
    assert np.abs(found - expected).max() <= 1e-10 * size
    assert np.abs(left).max() <= 1e-12 * size
    assert np.abs(found + left + J.T @ multipliers - needed).max() <= 1e-13 * max(size, np.abs(multipliers).max())


@pytest.mark.parametrize(
    ("name", "driven"),
    [
        ("four_bar", None),
        ("bennett", ("joint1.gamma",)),
        *(
            pytest.param(name, driven, marks=pytest.mark.soak)
            for name, driven in (("four_bar", ("joint3.gamma",)), ("bennett", None), ("gough", None))
        ),
    ],
)
def test_drives_and_reactions_are_those_of_singular_values(
    name: str, driven: tuple[str, ...] | None, built: Build
) -> None:
    """Without and with wrenches, one state and many; in batches to the bit."""
    robot = driven_at(name, *(driven or ()), choose=driven is not None)
    rng = np.random.default_rng(2)
    kernel = built(robot, *STATICS)
    q, v, _ = states(kernel, name, 5)
    for wrench in (None, rng.normal(size=(5, len(kernel.links), 6))):
        a = kernel.forward_dynamics(q, v, rng.normal(size=q.shape), wrench=wrench)
        u = kernel.inverse_dynamics(q, v, a, wrench=wrench)
        cuts, reactions = (f(q, v, a, wrench=wrench) for f in (kernel.loop_reactions, kernel.reactions))
        for i in range(5):
            given = None if wrench is None else wrench[i]
            tree = kernel.inverse_dynamics(q[i], v[i], a[i], wrench=given, cut=True)
            J, size = kernel.functions.constraint_jacobian(q[i]), np.abs(tree).max()
            expected, multipliers, left = oracle.least_drives(J, tree, drives_of(kernel))
            assert left <= 1e-12 * size
            assert np.abs(u[i] - expected).max() <= 1e-11 * max(size, np.abs(expected).max())
            for one, many in (
                (kernel.inverse_dynamics, u),
                (kernel.loop_reactions, cuts),
                (kernel.reactions, reactions),
            ):
                assert np.array_equal(one(q[i], v[i], a[i], wrench=given), many[i])
            if np.linalg.matrix_rank(J, 1e-7) == np.count_nonzero(np.abs(J).max(axis=1) > 1e-12):  # nothing redundant
                found = oracle.cut_wrenches(kernel, q[i], multipliers)
                assert np.abs(cuts[i] - found).max() <= 1e-11 * np.abs(found).max()
            # the tree with the forces in the cuts as wrenches on its links is the mechanism
            acting = oracle.as_link_wrenches(kernel, robot, q[i], cuts[i]) + (0.0 if given is None else given)
            pushed = kernel.inverse_dynamics(q[i], v[i], a[i], wrench=acting, cut=True)
            assert np.abs(pushed - u[i]).max() <= 1e-11 * max(size, np.abs(u[i]).max())
            borne = kernel.reactions(q[i], v[i], a[i], wrench=acting, cut=True)
            assert np.abs(borne - reactions[i]).max() <= 1e-11 * np.abs(borne).max()


def test_drives_make_the_motion_that_they_are_of(built: Build) -> None:
    """Back through forward dynamics, where one crank's drive does what three did."""
    kernel = built(driven_at("four_bar", "joint3.gamma"), *KERNELS)
    q, v, a = states(kernel, "four_bar", 3)
    u = kernel.inverse_dynamics(q, v, a)
    assert (u[:, :2] == 0.0).all()
    assert np.abs(kernel.forward_dynamics(q, v, u) - a).max() <= 1e-11 * np.abs(a).max()


def test_prescribed_coordinates_have_a_drive(built: Build) -> None:
    """The force that a prescribed crank takes is the drive that a free one would need."""
    robot = driven_at("four_bar", "joint1.gamma")
    free, prescribed = built(robot, *KERNELS), built(given(robot, "joint1", "gamma"), *KERNELS)
    q, v, a = states(free, "four_bar", 2)
    assert np.abs(prescribed.inverse_dynamics(q, v, a) - free.inverse_dynamics(q, v, a)).max() <= 1e-12


@pytest.mark.soak
def test_single_precision_finds_the_same_drives(built: Build) -> None:
    for choose in (False, True):
        robot = driven_at("four_bar", *("joint1.gamma",) * choose, choose=choose)
        exact, single = built(robot, *STATICS), built(robot, *STATICS, dtype="float32")
        arrays = states(exact, "four_bar", 5)
        rounded = [x.astype(np.float32) for x in arrays]
        for name in ("inverse_dynamics", "reactions", "loop_reactions"):
            expected, found = getattr(exact, name)(*arrays), getattr(single, name)(*rounded)
            assert np.abs(found - expected).max() <= 2e-5 * np.abs(expected).max()


def test_what_is_no_motion_of_the_mechanism_is_refused(built: Build) -> None:
    kernel = built(driven_at("four_bar", "joint3.gamma"), *STATICS)
    q, v, a = (x[0] for x in states(kernel, "four_bar", 1))
    away = np.array([0.0, 0.1, 0.0])
    calls = {"inverse_dynamics": ", or cut=True for the open tree", "loop_reactions": ""}
    for name, tree in calls.items():
        call = getattr(kernel, name)
        title = f"^{name}: {kernel.name}: loop joint4 "
        with pytest.raises(LoopError, match=rf"{title}is open: joint4\.. is left with .* m; .*kernel\.assemble{tree}$"):
            call(q + away, v, a)
        with pytest.raises(
            LoopError, match=rf"{title}is opening: joint4\.. is left with .* m/s; .*project_velocity{tree}$"
        ):
            call(q, v + away, a)
        message = rf"{title}opens at the accelerations: joint4\.. is left with 0\.\d+ m/s\^2; allowed: those .*{tree}$"
        caught = refused(LoopError, message, call, q, v, a + away)
        J = kernel.functions.constraint_jacobian(q) @ away
        assert caught.loop == "joint4"
        assert min(abs(abs(J) - caught.gap)) <= 1e-9
        refused(LoopError, rf"{title}opens at the accelerations in state 1: ", call, q, v, [a, a + away])
    assert np.isfinite(kernel.inverse_dynamics(q + away, v, a, cut=True)).all()


def test_drives_that_cannot_make_the_motion_are_refused(built: Build) -> None:
    """They name what is left, of the motion as a whole."""
    kernel = built(driven_at("four_bar"), *STATICS)
    q, v, a = states(kernel, "four_bar", 2)
    message = r"drives at none cannot make this motion in state 0: .* N or N m are left at joint.\.gamma; "
    message += r"allowed: drives that hold all 1 degrees of freedom, or cut=True for the open tree$"
    e = refused(LoopError, message, kernel.inverse_dynamics, q, v, a)
    needed = kernel.inverse_dynamics(q[0], v[0], a[0], cut=True)
    left = oracle.least_drives(kernel.functions.constraint_jacobian(q[0]), needed, [])[2]
    assert 0.5 * left <= e.gap <= 1.0001 * left  # as a whole, and its largest part
    with pytest.raises(LoopError, match=r"^reactions: .* cannot make this motion: "):
        kernel.reactions(q[0], v[0], a[0], wrench=np.zeros((3, 6)))


@pytest.mark.soak
@pytest.mark.parametrize("elastic", [("x",), ("x", "y", "z", "alpha", "beta")])
def test_elastic_coordinates_of_a_cut_bear_what_their_laws_say(elastic: tuple[str, ...], built: Build) -> None:
    """The same bars without a loop, with the forces in the cut as wrenches, move alike."""
    robot = driven_at("four_bar", choose=False)
    soft = Coordinate(stiffness=3e3, damping=2.0)
    loop = replace(robot.loops[0], coordinates=dict.fromkeys(elastic, soft), offset=(0.01, *[None] * 5))
    robot = replace(robot, loops=(loop,), name=f"soft_{len(elastic)}")
    kernel = built(robot, *(STATICS if len(elastic) == 1 else STATICS[3:]))
    bars = built(
        replace(robot, loops=(), name="bars"), "inverse_dynamics", "reactions", *KERNELS[6:], "external_reactions"
    )
    rng = np.random.default_rng(8)
    q, v = np.array([0.5, 0.2, 1.2]), rng.normal(size=3)
    if kernel.constraints:
        q, v = oracle.closed_state(kernel, q, [0], rng)
    wrench = rng.normal(size=(3, 6))
    a = kernel.forward_dynamics(q, v, rng.normal(size=3), wrench=wrench)
    cut = kernel.loop_reactions(q, v, a, wrench=wrench)
    acting = oracle.as_link_wrenches(kernel, robot, q, cut) + wrench
    for name in ("inverse_dynamics", "reactions"):
        found = getattr(kernel, name)(q, v, a, wrench=wrench)
        expected = getattr(bars, name)(q, v, a, wrench=acting)
        if name == "reactions" or not kernel.constraints:
            assert np.abs(found - expected).max() <= 1e-11 * np.abs(expected).max()
        else:  # drives at all joints: one of many ways
            J = kernel.functions.constraint_jacobian(q)
            assert np.abs(oracle.least_drives(J, expected, drives_of(kernel))[0] - found).max() <= 1e-10
    gap = kernel.loop_coordinates(q)[0, 0] - 0.01
    rate = np.diff(kernel.loop_coordinates([q - 1e-6 * v, q + 1e-6 * v])[:, 0, 0])[0] / 2e-6
    R = kernel.functions.cut_poses(q)[0, :3, :3]
    assert abs((R @ cut[0, :3])[0] + 3e3 * gap + 2.0 * rate) <= 1e-7


def test_coupled_coordinates_share_their_drives(built: Build) -> None:
    """Gears between the joints of bars without a loop: drives, and derivatives in all directions."""
    gears = (Coupling("gear", "joint3.gamma", {"joint1.gamma": -0.5, "joint2.gamma": 0.3}, is_constraint=True),)
    robot = replace(driven_at("four_bar", choose=False), loops=(), couplings=gears, name="geared_bars")
    kernel = built(robot, *CLOSURE[:3], "constrained_dynamics", "inverse_dynamics", *DERIVED[4:])
    q, v = np.array([0.5, 0.2, -0.25 + 0.06]), np.array([1.0, 2.0, -0.5 + 0.6])
    u = np.array([3.0, -1.0, 0.0])
    a = kernel.forward_dynamics(q, v, u)
    found, tree = kernel.inverse_dynamics(q, v, a), kernel.inverse_dynamics(q, v, a, cut=True)
    assert np.abs(found - oracle.least_drives(kernel.functions.constraint_jacobian(q), tree, [0, 1])[0]).max() <= 1e-12
    assert np.abs(found - u).max() <= 1e-11
    for place, x in enumerate(kernel.forward_dynamics_jacobian(q, v, u)):
        expected = differences(kernel, [q, v, u], place, 1e-5)
        assert np.abs(x - expected).max() <= 1e-8 * max(1.0, np.abs(x).max())
    with pytest.raises(LoopError, match=r"^inverse_dynamics: geared_bars: .*gear.* is open"):
        kernel.inverse_dynamics(q + [0.0, 0.0, 0.1], v, a)


def test_coordinates_of_cut_joints(built: Build) -> None:
    kernel = built(eomgen.load_robot("bennett"), *CLOSURE)
    q = np.random.default_rng(3).uniform(-1.5, 1.5, (7, 3))
    for found, poses in zip(kernel.loop_coordinates(q), kernel.functions.cut_poses(q), strict=True):
        (x, y, z, alpha, beta, gamma), pose = found[0], poses[0]
        (a, b, c), (s, t, u) = np.cos([alpha, beta, gamma]), np.sin([alpha, beta, gamma])
        R = np.array([[1, 0, 0], [0, a, -s], [0, s, a]]) @ [[b, 0, t], [0, 1, 0], [-t, 0, b]]
        assert np.abs(R @ [[c, -u, 0], [u, c, 0], [0, 0, 1]] - pose[:3, :3]).max() <= 1e-14
        assert np.array_equal(pose[:3, 3], [x, y, z])
    assert np.array_equal(kernel.loop_coordinates(q[2]), kernel.loop_coordinates(q)[2])


def test_robots_without_loops_have_nothing_of_them(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "inverse_dynamics", "forward_dynamics_jacobian")
    state = [np.full(kernel.n, x) for x in (1.0, 2.0, 3.0)]
    assert np.array_equal(kernel.inverse_dynamics(*state, cut=True), kernel.inverse_dynamics(*state))
    assert kernel.forward_dynamics_jacobian(*state, cut=True)[2].shape == (kernel.n, kernel.n)
    refused(UnknownNameError, "without the kernel loop_reactions", kernel.loop_reactions, *state)


# ---- derivatives


def smooth(kernel: Kernel, *state: Array) -> Array:
    """Accelerations beyond the closed states."""
    found: Array = kernel.calls.run("constrained_dynamics", None, state)[: kernel.n]
    return found


def differences(kernel: Kernel, state: list[Array], place: int, step: float) -> Array:
    columns = []
    for unit in step * np.eye(kernel.n):
        ahead, behind = ([x + s * unit if i == place else x for i, x in enumerate(state)] for s in (1.0, -1.0))
        columns.append((smooth(kernel, *ahead) - smooth(kernel, *behind)) / (2 * step))
    return np.array(columns).T


def test_derivatives_are_those_of_the_smooth_extension(built: Build) -> None:
    """In all directions, also those that open the loop; batches to the bit."""
    kernel = built(eomgen.load_robot("four_bar"), *DERIVED)
    q, v, _ = states(kernel, "four_bar", 4)
    u = np.random.default_rng(5).normal(size=q.shape)
    batch = kernel.forward_dynamics_jacobian(q, v, u)
    for i in range(4):
        one = kernel.forward_dynamics_jacobian(q[i], v[i], u[i])
        for place, (found, many) in enumerate(zip(one, batch, strict=True)):
            expected = differences(kernel, [q[i], v[i], u[i]], place, 1e-5)
            assert np.abs(found - expected).max() <= 1e-8 * max(1.0, np.abs(found).max())
            assert np.array_equal(found, many[i])
    J = kernel.functions.constraint_jacobian(q)
    assert np.abs(np.einsum("tmn,tnk->tmk", J, batch[2])).max() <= 1e-12  # no drive opens a loop


@pytest.mark.soak
def test_derivatives_of_redundant_loops_along_closed_motions(built: Build) -> None:
    """Bennett's linkage moves though its constraint has more rows than it needs."""
    kernel, rng = built(eomgen.load_robot("bennett"), *DERIVED), np.random.default_rng(7)
    q, v, _ = (x[0] for x in states(kernel, "bennett", 1))
    u, h, ends = rng.normal(size=3), 1e-4, []
    by_q, by_v, by_u = kernel.forward_dynamics_jacobian(q, v, u)
    way = oracle.onto_closed(kernel, q, rng.normal(size=3))
    for sign in (1.0, -1.0):
        moved, _ = oracle.closed_state(kernel, q + sign * h * way, [], rng)
        rates = oracle.onto_closed(kernel, moved, v)
        ends.append((moved, rates, smooth(kernel, moved, rates, u)))
    dq, dv, da = ((x - y) / (2 * h) for x, y in zip(*ends, strict=True))
    assert np.abs(by_q @ dq + by_v @ dv - da).max() <= 1e-6 * np.abs(da).max()
    assert np.abs(by_u - differences(kernel, [q, v, u], 2, 1e-2)).max() <= 1e-9 * np.abs(by_u).max()


@pytest.mark.soak
def test_derivatives_with_a_prescribed_leg(built: Build) -> None:
    """Of its acceleration, too; in double and in single precision."""
    robot = driven_at("gough", choose=False)
    leg = given(robot, next(x.name for x in robot.joints if x.type == "prismatic"), "z")
    kernel = built(leg, *DERIVED)
    assert len(kernel.prescribed) == 1
    q, v, _ = (x[0] for x in states(kernel, "gough", 1))
    u = np.random.default_rng(9).normal(size=kernel.n)
    found = kernel.forward_dynamics_jacobian(q, v, u)
    for place, x in enumerate(found):
        expected = differences(kernel, [q, v, u], place, 1e-5)
        assert np.abs(x - expected).max() <= 1e-7 * np.abs(x).max()
    single = built(leg, *DERIVED, dtype="float32")
    rounded = single.forward_dynamics_jacobian(*(x.astype(np.float32) for x in (q, v, u)))
    for x, y in zip(rounded, found, strict=True):
        assert np.abs(x - y).max() <= 2e-3 * np.abs(y).max()


def test_derivatives_of_an_open_state_are_refused_and_those_of_the_tree_are_not(built: Build) -> None:
    kernel = built(eomgen.load_robot("four_bar"), *DERIVED)
    state = [np.array([0.5, 0.2, 1.0]), np.zeros(3), np.zeros(3)]
    with pytest.raises(
        LoopError, match=r"^forward_dynamics_jacobian: four_bar: loop joint4 is open: joint4\.x is left"
    ):
        kernel.forward_dynamics_jacobian(*state)
    by_q, by_v, by_u = kernel.forward_dynamics_jacobian(*state, cut=True)
    moved = [state[0] + 1e-6, *state[1:]]
    change = kernel.forward_dynamics(*moved, cut=True) - kernel.forward_dynamics(*state, cut=True)
    assert np.abs(by_q.sum(axis=1) * 1e-6 - change).max() <= 1e-9
    assert np.abs(by_v).max() == 0.0
    assert np.linalg.matrix_rank(by_u) == 3


@pytest.mark.soak
def test_a_prescribed_crank_moves_as_its_force_moves_a_free_one(built: Build) -> None:
    free = ClosedLoops(built(eomgen.load_robot("four_bar"), *LOOP_KERNELS))
    driven = ClosedLoops(built(given(eomgen.load_robot("four_bar"), "joint1", "gamma"), *LOOP_KERNELS))
    crank = Harmonic([0.8], [1.5])
    moves = [np.ravel(x)[0] for x in crank(0.0)]
    q = driven.consistent_positions([moves[0], 0.7, 1.2])
    assert q[0] == moves[0]
    v = driven.consistent_velocities(q, [moves[1], 0.0, 0.0])
    result = integrate(driven.kernel, q, v, 0.5, prescribed=crank, step=1e-3, output_step=1e-3)
    assert result.info["gap"] <= 1e-12
    assert driven.redundancy(q).mobility == 0
    assert np.abs(result.q[:, 0] - [np.ravel(crank(t)[0])[0] for t in result.t]).max() == 0.0
    for i in range(0, result.t.size, 50):
        a = free.forward_dynamics(result.q[i], result.v[i], result.u[i]).a
        assert abs(a[0] - np.ravel(crank(result.t[i])[2])[0]) <= 1e-8 * max(1.0, np.abs(a).max())
    power = result.u[:, 0] * result.v[:, 0]
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2) * 1e-3])
    energy = result.energy.sum(axis=1)
    assert np.abs(energy - energy[0] - work).max() <= 1e-4 * np.ptp(energy)
    assert np.ptp(energy) >= 1.0


def test_prescribed_accelerations_that_open_a_loop_are_refused(built: Build) -> None:
    robot = given(given(eomgen.load_robot("four_bar"), "joint1", "gamma"), "joint3", "gamma")
    loops = ClosedLoops(built(robot, *LOOP_KERNELS))
    q = ClosedLoops(built(eomgen.load_robot("four_bar"), *LOOP_KERNELS)).consistent_positions([0.5, 0.2, 1.2])
    with pytest.raises(LoopError, match=r"joint4 opens at the prescribed accelerations: joint4\.[xy] .* m/s\^2"):
        loops.forward_dynamics(q, np.zeros(3), [1.0, 0.0, 1.0])
    assert np.abs(loops.forward_dynamics(q, np.zeros(3), np.zeros(3)).a).max() <= 1e-12


@pytest.mark.soak
def test_an_offset_in_a_loop_is_a_turned_placement(built: Build) -> None:
    """An offset of an angle alpha that does not move turns the joint's frame about x."""
    robot, rng = eomgen.load_robot("bennett"), np.random.default_rng(4)
    before, second, *behind = robot.joints
    R = np.array(second.placement.rotation) @ Placement.from_rpy((0.0, 0.0, 0.0), (0.02, 0.0, 0.0)).rotation
    placed = replace(second, placement=Placement(second.placement.xyz, tuple(map(tuple, R.tolist()))))  # type: ignore[arg-type]
    offset = replace(second, offset=(0.0, 0.0, 0.0, 0.02, 0.0, 0.0))
    a, b = (built(replace(robot, joints=(before, x, *behind)), *LOOP_KERNELS) for x in (offset, placed))
    state = random_state(robot, rng)
    q, v = state.q, state.v
    for name in ("constraint", "constraint_jacobian", "cut_poses"):
        assert np.abs(method_of(a, name)(q) - method_of(b, name)(q)).max() <= 1e-14
    assert np.abs(a.functions.constraint_bias(q, v) - b.functions.constraint_bias(q, v)).max() <= 1e-13


@pytest.mark.parametrize(("name", "driven"), [("four_bar", ["joint3.gamma"]), ("bennett", ["joint1.gamma"])])
def test_inverse_of_forward_dynamics(name: str, driven: list[str], built: Build) -> None:
    """Drives at one joint that make the accelerations which other drives made; they do the same work."""
    rng = np.random.default_rng(6)
    loops = ClosedLoops(built(eomgen.load_robot(name), *LOOP_KERNELS))
    q = loops.consistent_positions(GUESSES[name][0], held=["joint1.gamma"])
    v = loops.consistent_velocities(q, rng.normal(size=3))
    u = rng.normal(size=3)
    a = loops.forward_dynamics(q, v, u).a
    found = loops.inverse_dynamics(q, v, a, driven=driven)
    assert [loops.kernel.coordinates[i] for i in np.flatnonzero(found.u)] == driven
    again = loops.forward_dynamics(q, v, found.u)
    assert np.abs(again.a - a).max() <= 1e-9 * np.abs(a).max()
    assert np.abs(again.multipliers - found.multipliers).max() <= 1e-8 * np.abs(found.multipliers).max()
    assert abs(found.u @ v - u @ v) <= 1e-9 * max(1.0, np.abs(u @ v))
    spread = loops.inverse_dynamics(q, v, a, driven=loops.kernel.coordinates)
    assert np.linalg.norm(spread.u) <= min(np.linalg.norm(u), np.linalg.norm(found.u)) + 1e-9
    assert np.abs(loops.forward_dynamics(q, v, spread.u).a - a).max() <= 1e-9 * np.abs(a).max()
    refused(LoopError, "drives at none cannot make this motion", loops.inverse_dynamics, q, v, a, driven=[])
    refused(LoopError, "opens at the accelerations", loops.inverse_dynamics, q, v, a + [0.0, 1.0, 0.0], driven=driven)
    refused(UnknownNameError, "driven: 'joint9' is unknown", loops.inverse_dynamics, q, v, a, driven=["joint9"])


@pytest.mark.soak
def test_legs_of_goughs_platform_hold_it(built: Build) -> None:
    """Forces in six legs at rest balance the platform's weight, by virtual work of its six freedoms."""
    robot = eomgen.load_robot("gough")
    loops = ClosedLoops(built(robot, *LOOP_KERNELS))
    names = loops.kernel.coordinates
    q = loops.consistent_positions(GUESSES["gough"][0], held=names[:6])
    zero = np.zeros(len(names))
    legs = [name for name in names if name.endswith(".z") and name.startswith("leg")]
    assert len(legs) == 6
    found = loops.inverse_dynamics(q, zero, zero, driven=legs)
    assert found.redundancy.mobility == 6
    a = loops.forward_dynamics(q, zero, found.u).a
    assert np.abs(a).max() <= 1e-9 * np.abs(found.u).max()


def test_contacts_in_a_loop_are_found(built: Build) -> None:
    """A stop for the rocker: it closes and opens where the rocker passes the end of its clearance."""
    robot = eomgen.load_robot("four_bar")
    stop = replace(robot.joints[2].coordinates["gamma"], stiffness=200.0, clearance=1.4, smoothing=1e-3)
    joints = (*robot.joints[:2], replace(robot.joints[2], coordinates={"gamma": stop}))
    loops = ClosedLoops(built(replace(robot, joints=joints, name="stopped_bars"), *LOOP_KERNELS))
    q = loops.consistent_positions([0.5, 0.2, 1.2], held=["joint1.gamma"])
    v = loops.consistent_velocities(q, [4.0, 0.0, 0.0], held=["joint1.gamma"])
    motion = integrate(loops.kernel, q, v, 1.0, step=1e-3, output_step=1e-3)
    rocker = motion.of("joint3.gamma")
    crossings = np.flatnonzero((np.abs(rocker[1:]) > 1.4) != (np.abs(rocker[:-1]) > 1.4))
    assert len(motion.contacts) == len(crossings) >= 2
    for contact, i in zip(motion.contacts, crossings, strict=True):
        assert contact.coordinate == "joint3.gamma"
        assert motion.t[i] <= contact.t <= motion.t[i + 1]
        assert contact.closes == (abs(rocker[i + 1]) > 1.4)
