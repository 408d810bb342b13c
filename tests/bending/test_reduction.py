"""Reductions of finite elements beside full matrices, and flexible links as chains of rigid segments."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

import eomgen
from eomgen.bending import reduction
from eomgen.bending.checks import check_matrices, rigid_motions
from eomgen.bending.constants import skew
from eomgen.bending.finite_elements import FiniteElements
from eomgen.bending.mass_integrals import EXACT, MEAN, REDUCED, integrals
from eomgen.bending.reduction import reduce
from eomgen.description.bending.links import link_of_beam
from eomgen.description.load import robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import InputError
from eomgen.robot.checks import check_values
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of
from eomgen.robot.sections import AXES
from eomgen.robot.value import COORDINATES, BeamModes, Coupling, Frame, LinkBeam, Node, Robot, made_of
from tests.description.test_beams import crane
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.beams import straight
from tests.support.bending_robots import bent
from tests.support.builds import Build
from tests.support.description_samples import link_poses
from tests.support.figures import Figures
from tests.support.finite_elements import bar, beam, free_rows, stress_of_bar
from tests.support.joint_table import joint_table
from tests.support.random_robots import Array, random_robot, seeds

pytestmark = pytest.mark.quick
TIP = np.array([1.0, 0.0, 0.0])


def _full(elements: FiniteElements) -> tuple[np.ndarray, np.ndarray]:
    rows = free_rows(elements)
    return tuple(matrix.toarray()[np.ix_(rows, rows)] for matrix in (elements.K, elements.M))  # type: ignore[return-value]


def _rigid_reference(elements: FiniteElements) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return dense K and M of a clamped bar with a rigid end, and the displacements of all coordinates by unknowns."""
    rows = free_rows(elements)
    end = np.isin(elements.dofs[rows, 0], elements.interfaces[0].nodes)
    inner = rows[~end]
    T = np.zeros((len(elements.dofs), len(inner) + 6))
    T[inner, range(len(inner))] = 1.0
    T[rows[end], -6:] = rigid_motions(elements.nodes, elements.dofs[rows[end]], elements.interfaces[0].place)
    return T.T @ elements.K.toarray() @ T, T.T @ elements.M.toarray() @ T, T


@pytest.mark.parametrize("dense", [True, False])
def test_craig_bampton_modes_are_those_of_full_matrices(monkeypatch: pytest.MonkeyPatch, dense: bool) -> None:
    monkeypatch.setattr(reduction, "DENSE", 10_000 if dense else 0)
    elements = bar(count=8)
    link = reduce(elements, craig_bampton=True)
    K, M, _ = _rigid_reference(elements)
    static = np.vstack([-np.linalg.solve(K[:-6, :-6], K[:-6, -6:]), np.eye(6)])
    assert link.K[:6, :6] == pytest.approx(static.T @ K @ static, rel=1e-9, abs=1e-6)
    squares = eigh(K[:-6, :-6], M[:-6, :-6], eigvals_only=True, subset_by_index=(0, 7))
    assert link.K.diagonal()[6:] == pytest.approx(squares, rel=1e-10)
    assert np.count_nonzero(link.K[:6, 6:]) == 0
    assert np.array_equal(link.interface_Phi[0], np.eye(6, 14))
    masses = np.einsum("klaa->kl", link.P)
    assert masses[:6, :6] == pytest.approx(static.T @ M @ static, rel=1e-9, abs=1e-9)


def test_guyan_condensation_has_no_modes_beside_its_interface() -> None:
    elements = bar(count=0)
    link = reduce(elements)
    K, M, _ = _rigid_reference(elements)
    static = np.vstack([-np.linalg.solve(K[:-6, :-6], K[:-6, -6:]), np.eye(6)])
    squares = eigh(static.T @ K @ static, static.T @ M @ static, eigvals_only=True)
    assert (2.0 * np.pi * link.frequencies) ** 2 == pytest.approx(squares, rel=1e-9)


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_own_modes_have_the_lowest_frequencies_and_the_statics_of_all_elements(kind: str) -> None:
    elements = bar(kind, count=8)
    link = reduce(elements)
    assert pytest.approx(np.diag((2.0 * np.pi * link.frequencies) ** 2), rel=1e-12) == link.K
    masses = np.einsum("klaa->kl", link.P)
    assert masses == pytest.approx(np.eye(14), abs=1e-12)
    assert np.count_nonzero(masses - np.diag(masses.diagonal())) == 0
    if kind == "rbe2":
        K, M, _ = _rigid_reference(elements)
        load = np.vstack([np.zeros((len(K) - 6, 6)), np.eye(6)])
        bent = np.linalg.solve(K, load)[-6:]
    else:
        K, M = _full(elements)
        rows = free_rows(elements)
        end = np.isin(elements.dofs[rows, 0], elements.interfaces[0].nodes)
        motions = rigid_motions(elements.nodes, elements.dofs[rows[end]], TIP)
        A = np.zeros((6, len(K)))
        A[:, end] = np.linalg.pinv(motions)
        bent = A @ np.linalg.solve(K, A.T)
    Phi = link.interface_Phi[0]
    assert Phi @ np.linalg.solve(link.K, Phi.T) == pytest.approx(bent, rel=1e-8, abs=1e-12 * np.abs(bent).max())
    squares = eigh(K, M, eigvals_only=True, subset_by_index=(0, 5))
    found = (2.0 * np.pi * link.frequencies[:6]) ** 2
    assert np.all(found > squares * (1.0 - 1e-10))  # a reduced model is stiffer
    assert found == pytest.approx(squares, rel=1e-2)
    assert found[:2] == pytest.approx(squares[:2], rel=3e-4)


def test_a_free_link_has_free_free_modes_without_momenta() -> None:
    elements = replace(bar(clamped=False, count=8), interfaces=())
    link = reduce(elements)
    K, M = elements.K.toarray(), elements.M.toarray()
    squares = eigh(K, M, eigvals_only=True, subset_by_index=(6, 13))
    assert (2.0 * np.pi * link.frequencies) ** 2 == pytest.approx(squares, rel=1e-8)
    assert link.is_free
    assert np.abs(link.H0[:, 3]).max() < 1e-10
    N = link.H0[:, :3]
    assert np.abs(N - np.swapaxes(N, 1, 2)).max() < 1e-10
    assert reduce(bar(clamped=False)).frequencies[:2] == pytest.approx(link.frequencies[:2], rel=2e-3)


def test_mass_and_inertia_are_those_of_a_box() -> None:
    link = reduce(bar())
    length, b, h = 1.0, 0.1, 0.06
    mass = 2000.0 * length * b * h
    assert link.mass == pytest.approx(mass, rel=1e-12)
    assert link.com == pytest.approx([0.5, 0.0, 0.0], abs=1e-12)
    expected = mass / 12.0 * np.array([b * b + h * h, length**2 + h * h, length**2 + b * b])
    # trilinear functions integrate squares of coordinates exactly, of elements whose edges are along them
    assert link.inertia.diagonal() == pytest.approx(expected, rel=1e-10)
    body, moment = np.zeros((6, 6)), skew(mass * link.com)
    body[:3, :3], body[:3, 3:], body[3:, :3] = mass * np.eye(3), -moment, moment
    body[3:, 3:] = np.diag(expected) + mass * (0.5**2 * np.diag([0.0, 1.0, 1.0]))  # about the origin
    assert check_matrices(bar()) == pytest.approx(body, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("elements", [bar(), beam(lumped=True), beam(), replace(beam(), reduced=True)])
def test_integrals_have_the_kinetic_energy_of_the_mass_matrix(elements: FiniteElements) -> None:
    """Momenta and modal masses are those of M, whatever its kind: T of any motion at e = 0."""
    modes = np.random.default_rng(1).standard_normal((len(elements.dofs), 3))
    found = integrals(elements, modes)
    R = rigid_motions(elements.nodes, elements.dofs)
    W = []
    for column in range(6):
        twist = np.zeros((4, 4))
        if column < 3:
            twist[column, 3] = 1.0
        else:
            twist[:3, :3] = skew(np.eye(3)[column - 3])
        W.append(twist)
    rigid = np.array([[np.trace(a @ found.H00 @ b.T) for b in W] for a in W])
    assert rigid == pytest.approx(R.T @ elements.M @ R, rel=1e-9, abs=1e-12)
    momenta = np.array([[np.trace(a[:3] @ found.H0[k]) for k in range(3)] for a in W])
    assert momenta == pytest.approx(R.T @ elements.M @ modes, rel=1e-9, abs=1e-9)
    assert np.einsum("klaa->kl", found.P) == pytest.approx(modes.T @ elements.M @ modes, rel=1e-9, abs=1e-9)


def test_kinds_of_mass_matrices_are_known() -> None:
    modes = np.zeros((66, 1))
    assert integrals(beam(lumped=True), modes).how == EXACT
    assert integrals(beam(), modes).how == MEAN
    assert integrals(replace(beam(), reduced=True), modes).how == REDUCED
    assert reduce(bar()).masses_are == EXACT


def test_lumped_masses_are_summed_as_bodies() -> None:
    """H0 and P of nodes with mass and inertia, particle by particle: eight of each node with its moments."""
    elements = beam(lumped=True)
    rows, modes = elements.by_node(), np.random.default_rng(2).standard_normal((len(elements.dofs), 2))
    found = integrals(elements, modes)
    H0, P, M = np.zeros((2, 4, 3)), np.zeros((2, 2, 3, 3)), elements.M.toarray()
    for node, place in enumerate(elements.nodes):
        mass, inertia = M[rows[node, 0], rows[node, 0]], M[np.ix_(rows[node, 3:], rows[node, 3:])]
        spread = np.sqrt(np.maximum((0.5 * np.trace(inertia) * np.eye(3) - inertia).diagonal() / mass, 0.0))
        for sign in np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T:
            d = sign * spread
            phi = [modes[rows[node, :3], k] + np.cross(modes[rows[node, 3:], k], d) for k in range(2)]
            for k in range(2):
                H0[k] += mass / 8.0 * np.outer(np.append(place + d, 1.0), phi[k])
                P[k] += mass / 8.0 * np.array([np.outer(phi[k], other) for other in phi])
    assert pytest.approx(H0, rel=1e-10, abs=1e-12) == found.H0
    assert pytest.approx(P, rel=1e-10, abs=1e-12) == found.P


def test_velocity_terms_of_consistent_masses_with_rotations_converge_with_the_mesh() -> None:
    """Their error falls with the square of the elements' size; signs of modes are the solver's own."""
    found = {pieces: reduce(beam(count=2, pieces=pieces)) for pieces in (5, 10, 80)}
    for name in ("P", "H0"):
        coarse, fine, exact = (np.abs(getattr(found[pieces], name)) for pieces in (5, 10, 80))
        assert np.abs(fine - exact).max() < 0.1 * np.abs(exact).max()
        assert np.abs(fine - exact).max() < 0.4 * np.abs(coarse - exact).max()


def test_stiffening_by_rotation_is_that_of_a_beam() -> None:
    """Q and Psi of a slender bar beside psi_kl = -ex int v_k' v_l' of a beam of the same mode."""
    elements = replace(bar(count=0), stress={})
    elements = replace(elements, stress=stress_of_bar(elements))
    link = reduce(elements)
    assert link.Q is not None
    assert link.interface_Psi is not None
    bends = int(np.flatnonzero(link.interface_Phi[0, 1])[0])
    x = np.linspace(0.0, 1.0, 2001)
    # of six static shapes: a cubic with this displacement and rotation of the end
    v, turn = link.interface_Phi[0, [1, 5], bends]
    slope = (6.0 * v - 2.0 * turn) * x + (3.0 * turn - 6.0 * v) * x * x
    run = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] ** 2 + slope[:-1] ** 2) * np.diff(x))])
    line = 2000.0 * 0.1 * 0.06
    expected = -line * np.sum(0.5 * ((x * run)[1:] + (x * run)[:-1]) * np.diff(x))
    assert link.Q[bends, bends, 0, 0] == pytest.approx(expected, rel=5e-3)
    assert link.interface_Psi[0, 0, bends, bends] == pytest.approx(-run[-1], rel=5e-3)
    assert pytest.approx(np.swapaxes(link.Q, 0, 1), abs=0.0) == link.Q
    assert not [note for note in link.notes() if "stiffening" in note]


def test_notes_say_what_is_left_out() -> None:
    first = 2.0 * np.pi * reduce(bar()).frequencies[0]
    notes = reduce(bar()).notes()
    assert len(notes) == 1
    assert f"keep rates below {0.1 * first:.3g} rad/s" in notes[0]
    assert any("mean translational masses" in note for note in reduce(beam()).notes())
    assert any("reduced model" in note for note in reduce(replace(beam(), reduced=True)).notes())


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_the_energy_of_a_bent_link_that_moves_is_that_of_all_its_nodes(kind: str) -> None:
    """T = 1/2 tr(W H W^T) + e'_k tr(W G_k) + 1/2 m_kl e'_k e'_l of the constants, beside nodes where they are."""
    elements = bar(kind, counts=(4, 1, 1), count=3)
    link, shapes = reduce(elements, craig_bampton=True), []
    for mode in np.eye(9):  # displacements of all nodes by each mode, out of full matrices
        shapes.append(_shape(elements, mode))
    modes = np.array(shapes).T
    signs = np.sign(np.einsum("kab,kab->k", integrals(elements, modes).H0, link.H0))  # of modes by another solver
    assert np.all(signs[:6] == 1.0)
    modes = modes * signs
    found = integrals(elements, modes)
    assert pytest.approx(found.H0, rel=1e-7, abs=1e-8 * np.abs(found.H0).max()) == link.H0
    rng = np.random.default_rng(3)
    for _ in range(4):
        e, rates, twist = 0.05 * rng.standard_normal(9), rng.standard_normal(9), rng.standard_normal(6)
        W = np.hstack([skew(twist[3:]), twist[:3, None]])  # of points in the link's axes, (3, 4)
        G = link.H0 + 0.0
        G[:, :3] += np.einsum("l,lkab->kab", e, link.P)
        C = link.H0 + 0.5 * (G - link.H0)
        bent = np.zeros((4, 4))
        bent[:, :3] = np.einsum("k,kab->ab", e, C)
        H = link.H00 + bent + bent.T
        energy = 0.5 * np.trace(W @ H @ W.T) + rates @ np.einsum("ab,kba->k", W, G)
        energy += 0.5 * rates @ np.einsum("klaa->kl", link.P) @ rates
        places = elements.nodes + (modes @ e).reshape(-1, 3)
        velocities = (np.cross(twist[3:], places) + twist[:3]).ravel() + modes @ rates
        assert energy == pytest.approx(0.5 * velocities @ elements.M @ velocities, rel=1e-8)


def _shape(elements: FiniteElements, mode: np.ndarray) -> np.ndarray:
    """Return the displacements of all coordinates by a Craig-Bampton mode: 6 of the tip, then fixed-interface modes."""
    rows, K, M = free_rows(elements), *_full(elements)
    end = np.isin(elements.dofs[rows, 0], elements.interfaces[0].nodes)
    motions = rigid_motions(elements.nodes, elements.dofs[rows[end]], TIP)
    moved = np.zeros(len(elements.dofs))
    if elements.interfaces[0].kind == "rbe2":
        T = np.zeros((len(rows), np.count_nonzero(~end) + 6))
        T[~end, :-6], T[end, -6:] = np.eye(np.count_nonzero(~end)), motions
        A = np.eye(6, len(T[0]), k=len(T[0]) - 6)
    else:
        T, A = np.eye(len(rows)), np.zeros((6, len(rows)))
        A[:, end] = np.linalg.pinv(motions)
    K, M = T.T @ K @ T, T.T @ M @ T
    X = np.linalg.solve(K, A.T)
    Z = np.linalg.svd(A)[2][6:].T
    fixed = Z @ eigh(Z.T @ K @ Z, Z.T @ M @ Z, subset_by_index=(0, 2))[1]
    moved[rows] = T @ (X @ np.linalg.solve(A @ X, mode[:6]) + fixed @ mode[6:])
    return moved


ARM = """
name = "crane"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "arm"
modal_damping = {damping}
[links.beam]
length = 0.8
E = 7.0e10
G = 2.63e10
density = 2700.0
A = 2.4e-5
Iy = 3.2e-11
Iz = 7.2e-11
J = 7.5e-11
shear = [0.85, 0.8]
axis = "{axis}"
modes = {{ {modes} }}
[[links]]
name = "hand"
mass = {mass}
"""
JOINTS = f"""
{joint_table("shoulder", "base", "arm", "revolute")}
{joint_table("wrist", "arm", "hand", "fixed")}
node = "tip"
[[frames]]
name = "tcp"
link = "hand"
"""
WHOLE = "y = 5, z = 5, torsion = 4, axial = 4"


def arm(modes: str = WHOLE, *, mass: float = 0.0, damping: float = 0.0, axis: str = "x") -> Robot:
    return robot_from_toml(ARM.format(modes=modes, mass=mass, damping=damping, axis=axis) + JOINTS)


def clamped(robot: Robot) -> Robot:
    """The robot with its shoulder held, which a link that bends by modes does not allow."""
    joints = (replace(x, coordinates={} if x.name == "shoulder" else x.coordinates) for x in robot.joints)
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("axis", ["x", "y", "-z"])
@pytest.mark.parametrize("segments", [1, 3])
def test_tips_deflect_as_by_modes(segments: int, axis: str, figures: Figures) -> None:
    """Deflections and slopes under forces and moments at the tip, and under the weight, for any number of segments."""
    robot = arm(axis=axis)
    modes = robot.links[0].modes
    by_force = np.array(modes.nodes[0].Phi) @ np.linalg.inv(modes.K)
    chain = straight(clamped(robot.with_segments(segments)))
    wanted, size = by_force @ np.array(modes.nodes[0].Phi).T, np.sqrt(np.diag(chain.by_tip(np.eye(6))))
    figures.at_most("tip", float(np.abs((chain.by_tip(np.eye(6)) - wanted) / np.outer(size, size)).max()), 1e-10)
    gravity = np.array([3.0, -4.0, -9.0])
    sag = by_force @ np.array([H0[3] @ gravity for H0 in np.array(modes.H0)])
    found = chain.by_weight(gravity)
    assert np.abs(found - sag)[:3].max() < 1e-9 * np.abs(sag[:3]).max()
    assert np.abs(found - sag)[3:].max() < 1e-9 * np.abs(sag[3:]).max()


@pytest.mark.parametrize("seed", seeds(0, 2, 40))
def test_random_beams(seed: int, figures: Figures) -> None:
    """Of any numbers, along any axis, with modes in some directions: what these deflect at the tip, and masses."""
    rng = np.random.default_rng([seed, 19])
    counts = {way: int(rng.integers(0, 4)) for way in BeamModes().counts}
    counts["yz"[seed % 2]] += 2  # a moment at the tip needs two
    beam = LinkBeam(
        *rng.uniform(0.3, 3.0, 1),
        *rng.uniform(1e9, 2e11, 2),
        *10.0 ** rng.uniform([-4, -8, -8, -8], [-2, -6, -6, -6]),
        tuple(rng.uniform(0.3, 1.0, 2)),
        float(rng.uniform(500.0, 9000.0)),
        BeamModes(**counts),
        str(rng.choice(list(AXES))),
    )
    robot = arm()
    link = link_of_beam("arm", beam, 0.01)
    made = [part for node in made_of(link) for part in node]
    joints = tuple(made[1] if x.name == "arm_tip" else x for x in robot.joints)
    robot = replace(robot, links=(link, *robot.links[1:]), joints=joints, couplings=made[2])
    modes, N = link.modes, int(rng.integers(1, 9))
    chain = straight(clamped(robot.with_segments(N)))
    Phi = np.array(modes.nodes[0].Phi)
    moved = [k for k in range(6) if Phi[k].any() and max(counts[way] for way in ways_of(k, beam.axis)) > 1]
    assert moved
    wanted = (Phi @ np.linalg.inv(modes.K) @ Phi.T)[np.ix_(moved, moved)]
    found = np.array([chain.by_tip(wrench)[moved] for wrench in np.eye(6)[moved]]).T
    size = np.sqrt(np.diag(wanted))
    figures.at_most("tip", float(np.abs((found - wanted) / np.outer(size, size)).max()), 1e-8)
    assert sum(chain.masses.values()) == pytest.approx(link.mass, rel=1e-13)


def ways_of(row: int, axis: str) -> list[str]:
    """Directions of modes that move a coordinate of the tip."""
    section = int(np.flatnonzero(np.array(AXES[axis])[row % 3])[0])
    return [["axial"], ["y"], ["z"], ["torsion"], ["z"], ["y"]][section + row - row % 3]


def test_frequencies_tend_to_those_of_modes(figures: Figures) -> None:
    """The first three of bending by the cube of the number of segments, those of twist and stretch by its square."""
    modes = arm().links[0].modes
    own = 2.0 * np.pi * np.array(modes.frequencies())
    wanted = [*own[0:3], *own[5:8], own[10], own[14]]
    errors = []
    for segments in (8, 16, 32):
        found = straight(clamped(arm().with_segments(segments))).frequencies()
        errors.append([np.abs(found / x - 1.0).min() for x in wanted])
    for coarse, fine in pairwise(errors):
        falls = np.array(coarse) / np.array(fine)
        print("errors fall by", falls.round(2))
        assert (falls[:6] > 7.5).all()
        assert (falls[6:] > 3.8).all()
    figures.at_most("with 16 segments", float(np.max(errors[1])), 4e-3)


def test_coordinates_and_damping_are_those_of_the_modes() -> None:
    """Deflections that no mode has stay locked; the first mode of each direction is damped as before."""
    beam = arm("z = 2, torsion = 1", damping=0.03).with_segments(4).beams[0]
    assert set(COORDINATES) - set(beam.rigid) == {"z", "beta", "alpha"}
    modes = arm("z = 2, torsion = 1", damping=0.03).links[0].modes
    assert modes is not None
    for key, k in (("z", 0), ("beta", 0), ("alpha", 2)):
        omega = 2.0 * np.pi * modes.frequencies()[k]
        assert beam.damping[COORDINATES.index(key)] * omega / 2.0 == pytest.approx(0.03, rel=1e-12)
    assert all(beam.damping[COORDINATES.index(key)] == 0.0 for key in beam.rigid)


def test_all_else_stays() -> None:
    """What stands on nodes, in the same order; the robot is one that can be changed and read again."""
    robot = replace(arm(mass=0.4), tunable=("links.arm.mass", "links.hand.mass"), home={"shoulder.gamma": 0.2})
    chain = robot.with_segments(2)
    check_values(chain)
    assert robot_from_record(record_of(chain, whole=True), chain.source) == chain
    assert [x.name for x in chain.joints] == ["shoulder", "arm0", "arm1", "arm2", "arm_tip", "wrist"]
    assert [x.name for x in chain.links] == ["arm", "arm0", "arm1", "arm2", "arm_tip", "hand"]
    assert (chain.frames, chain.home, chain.tunable) == (robot.frames, robot.home, ("links.hand.mass",))
    assert not chain.couplings
    assert sum(x.mass for x in chain.links) == pytest.approx(sum(x.mass for x in robot.links), rel=1e-14)
    assert chain.with_value("beams.arm.segments", 3).joints == robot.with_segments(3).joints
    arms = eomgen.load_robot("flexible_arm")
    one = arms.with_segments(2, ["forearm"])
    assert [x.name for x in one.links if x.modes is not None] == ["upper"]
    assert one.with_segments(2, ("upper",)).beams == arms.with_segments(2).beams[::-1]


@pytest.mark.parametrize("axis", ["x", "-y"])
@pytest.mark.parametrize("segments", [1, 2, 5])
@pytest.mark.parametrize("distance", [0.05, 0.4, 0.7, 0.8])
def test_nodes_between_the_ends_stand_on_segments(distance: float, segments: int, axis: str) -> None:
    """Parallel to the link's frame while nothing bends, in the link of the nearest end of a segment."""
    robot = arm("y = 2", axis=axis)
    link, along = robot.links[0], np.array(AXES[axis])[:, 0]
    still = ((0.0, 0.0),) * 6
    node = Node("eye", (*(float(x) for x in distance * along),), ((0.1, 0.0), *still[1:]))  # type: ignore[arg-type]
    link = replace(link, modes=replace(link.modes, nodes=(*link.modes.nodes, node)))
    _, (made, joint, couplings) = made_of(link)
    frame = Frame("camera", "arm_eye")
    robot = replace(robot, links=(link, *robot.links[1:], made), joints=(*robot.joints, joint), frames=(frame,))
    chain = replace(robot, couplings=(*robot.couplings, *couplings)).with_segments(segments)
    place = chain.joint("arm_eye")
    assert place.parent == f"arm{min(int(distance / (0.8 / segments) + 0.5), segments)}"
    assert [x.name for x in chain.joints].index("arm_eye") > [x.name for x in chain.joints].index(place.parent)
    pose = link_poses(chain, np.zeros(sum(len(x.coordinates) for x in chain.joints)))["arm_eye"]
    assert np.abs(pose[:3, 3] - distance * along).max() < 1e-14
    assert np.abs(pose[:3, :3] - np.eye(3)).max() < 1e-14
    assert build_model(chain).frames[0] == "camera"


def test_mass_matrix_and_forces_of_the_chain_are_mujocos(built: Build, figures: Figures) -> None:
    """Of segments that bend, twist and stretch, with a body at the tip, far from straight."""
    robot = arm("y = 1, z = 1, torsion = 1, axial = 1", mass=0.3, damping=0.01).with_segments(2)
    kernel, oracle = built(robot, "mass_matrix", "inverse_dynamics", "bias_force"), MujocoRobot(robot)
    assert kernel.n == 13
    for seed in range(3):
        q, v, a = np.random.default_rng(seed).uniform(-0.3, 0.3, (3, kernel.n))
        M, force, bias = oracle.mass_matrix(q), oracle.inverse_dynamics(q, v, a), oracle.bias_force(q, v)
        figures.at_most("M", float(np.abs(kernel.mass_matrix(q) - M).max() / np.abs(M).max()), 1e-10)
        figures.at_most("bias", float(np.abs(kernel.bias_force(q, v) - bias).max() / np.abs(bias).max()), 1e-10)
        found = np.abs(kernel.inverse_dynamics(q, v, a) - force).max() / np.abs(force).max()
        figures.at_most("inverse dynamics", float(found), 1e-10)


@pytest.mark.soak
def test_a_motion_tends_to_that_of_modes(built: Build, figures: Figures) -> None:
    """An arm that falls and bends: the tip's way tends to that by modes with the cube of the number of segments."""

    def tips(robot: Robot) -> Array:
        kernel = built(robot, "adaptive_rollout", "kinematics", "forward_dynamics")
        zero = np.zeros(kernel.n)
        q, _ = kernel.rollout(zero, zero, duration=0.4, samples=40, rtol=1e-8, method="rosenbrock")
        return np.array([kernel.frame_pose(x, "tcp")[:3, 3] for x in q])

    robot = arm("y = 4", mass=0.02)
    wanted = tips(robot)
    errors = [float(np.abs(tips(robot.with_segments(n)) - wanted).max()) for n in (2, 4, 8)]
    print("m from modes:", errors)
    assert np.abs(wanted - wanted[0]).max() > 0.3
    assert errors[0] > 7.0 * errors[1] > 49.0 * errors[2]
    figures.at_most("with 8 segments, m", errors[-1], 1e-4)


def refused(robot: Robot, message: str, segments: Any = 4, links: Any = None) -> None:
    with pytest.raises(InputError, match=message):
        robot.with_segments(segments, links)


def test_what_is_refused() -> None:
    robot = arm("y = 2")
    refused(eomgen.load_robot("one_link"), "segments: no link of one_link bends by modes; allowed: robots with links")
    refused(robot, "links: 'hand' does not bend by modes; known: arm", links=["hand"])
    of_points = bent(random_robot(1, (1, 1)), 1, (2,)).robot
    refused(of_points, r"links\.link1\.modes: a file says nothing of sections; allowed: .*beams")
    for segments in (0, 101, -3, True, 2.0, "4", None):
        refused(robot, r"segments: got .*; allowed: a whole number from 1 to 100", segments)
    stiffer = robot.with_value("links.arm.modes.K", [[2.0 * x for x in row] for row in robot.links[0].modes.K])  # type: ignore[union-attr]
    refused(stiffer, r"links\.arm\.modes\.1\.stiffness: .* J, and that of the beam is .* J; allowed: the beam's")
    follows = Coupling("wheel", "wrist.gamma", {"arm.mode2": 1.0})
    refused(replace(robot, couplings=(*robot.couplings, follows)), r"couplings\.wheel: it couples arm\.mode2; allowed")
    refused(replace(robot, driven=("arm.mode1",)), r"driven: 'arm\.mode1'; allowed: coordinates of joints")
    refused(replace(robot, home={"arm.mode1": 0.1}), r"home\.arm\.mode1: 0\.1, and chains .* begin straight")
    refused(
        crane(), r"joints\.cross: it slides along bridge, and along a chain .*; allowed: links along which no joint"
    )
    named = (*robot.links, replace(robot.links[1], name="arm2"))
    refused(replace(robot, links=named), r"links\.arm: links or joints of its chain .*'arm2'; allowed: other names")
    assert replace(robot, frames=(Frame("arm2", "hand"),)).with_segments(2).frames[0].name == "arm2"
