"""Reductions of finite elements, beside full matrices: statics, frequencies, integrals, stiffening by rotation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from eomgen.bending import reduction
from eomgen.bending.checks import rigid_motions
from eomgen.bending.constants import skew
from eomgen.bending.finite_elements import FiniteElements
from eomgen.bending.mass_integrals import EXACT, MEAN, REDUCED, integrals
from eomgen.bending.reduction import reduce
from tests.support.finite_elements import bar, beam, free_rows, stress_of_bar

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
