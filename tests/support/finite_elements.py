"""Finite elements for tests: a bar of bricks, a beam with rotations, and load cases of the bar."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array

from eomgen.bending.finite_elements import DIRECTIONS, FiniteElements, Interface

ROOT = Path(__file__).parents[2]
EXAMPLE = runpy.run_path(str(ROOT / "examples" / "brick_bar.py"))
LENGTH = 1.0


def bar(
    kind: str = "rbe2", *, clamped: bool = True, count: int = 6, counts: Any = (8, 2, 2), **about: Any
) -> FiniteElements:
    """Return the bar of the example, clamped or free, with its end as an interface."""
    nodes, K, M = EXAMPLE["bar"](counts=counts, **about)
    dofs = np.array([(node, way) for node in range(len(nodes)) for way in range(3)])
    root = np.flatnonzero(nodes[:, 0] == 0.0) if clamped else np.array([], dtype=np.intp)
    end = np.flatnonzero(nodes[:, 0] == LENGTH)
    tip = Interface("tip", kind, end, np.array([LENGTH, 0.0, 0.0]))
    return FiniteElements(nodes, dofs, csr_array(M), csr_array(K), root, (tip,), count, np.arange(1, len(nodes) + 1))


def beam(count: int = 4, pieces: int = 10, *, lumped: bool = False) -> FiniteElements:
    """Return a clamped beam of Euler-Bernoulli elements along x, six coordinates a node, of 2 kg and 0.8 m."""
    length, EA, GJ, EIy, EIz, rhoA, rhoJ = 0.8, 1e6, 30.0, 50.0, 80.0, 2.5, 1e-3
    h = length / pieces
    n = 6 * (pieces + 1)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h], [-12, -6 * h, 12, -6 * h]])
    bend = np.vstack([bend, [6 * h, 2 * h * h, -6 * h, 4 * h * h]]) / h**3
    mass = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h], [54, 13 * h, 156, -22 * h]])
    mass = np.vstack([mass, [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]) * rhoA * h / 420.0
    two, linear = np.array([[1, -1], [-1, 1]]) / h, np.array([[2, 1], [1, 2]]) * h / 6.0
    turned = np.diag([1.0, -1.0, 1.0, -1.0])  # w' = -beta
    for piece in range(pieces):
        at = 6 * piece
        K[np.ix_([at, at + 6], [at, at + 6])] += EA * two
        K[np.ix_([at + 3, at + 9], [at + 3, at + 9])] += GJ * two
        M[np.ix_([at + 3, at + 9], [at + 3, at + 9])] += rhoJ * linear
        M[np.ix_([at, at + 6], [at, at + 6])] += rhoA * linear
        for rows, EI, turn in (([1, 5, 7, 11], EIz, np.eye(4)), ([2, 4, 8, 10], EIy, turned)):
            place = np.ix_([at + row for row in rows], [at + row for row in rows])
            K[place] += EI * turn @ bend @ turn
            M[place] += turn @ mass @ turn
    if lumped:
        shares = np.full(pieces + 1, rhoA * h)
        shares[[0, -1]] /= 2.0
        M = np.kron(np.diag(shares), np.diag([1.0, 1.0, 1.0, 4e-4, 2.5e-4, 3e-4]))
    nodes = np.column_stack([np.linspace(0.0, length, pieces + 1), np.zeros(pieces + 1), np.zeros(pieces + 1)])
    dofs = np.array([(node, way) for node in range(pieces + 1) for way in range(6)])
    tip = Interface("tip", "node", np.array([pieces]), nodes[-1])
    labels = np.arange(1, pieces + 2)
    return FiniteElements(nodes, dofs, csr_array(M), csr_array(K), np.array([0]), (tip,), count, labels)


def free_rows(elements: FiniteElements) -> np.ndarray:
    """Return the rows of coordinates that the root does not hold."""
    return np.flatnonzero(~np.isin(elements.dofs[:, 0], elements.root))


def stress_of_bar(elements: FiniteElements, counts: Any = (8, 2, 2), **about: Any) -> dict[str, csr_array]:
    """Return the geometric stiffness matrices of a bar's load cases, K_G = int dN_a . sigma dN_b dV (x) 1_3."""
    nodes, size = elements.nodes, np.array([LENGTH, 0.1, 0.06]) / counts
    rows = free_rows(elements)
    K, M = elements.K.toarray(), elements.M.toarray()
    first = np.array(list(np.ndindex(*counts)))
    number = np.arange(len(nodes)).reshape([n + 1 for n in counts])
    corners = np.array([number[tuple((first + (c + 1) // 2).T)] for c in EXAMPLE["CORNERS"]]).T
    E, nu = 2e8, 0.3
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    loads = {}
    for j, name in enumerate(("x", "y", "z", "1")):
        rho = nodes[:, j] if j < 3 else np.ones(len(nodes))
        for i in range(3):
            field = np.zeros((len(nodes), 3))
            field[:, i] = -rho
            loads[f"body.{name}.{DIRECTIONS[i]}"] = M @ field.ravel()
    end = elements.interfaces[0].nodes
    for i in range(3):
        push = np.zeros((len(nodes), 3))
        push[end, i] = -1.0 / len(end)
        loads[f"tip.{DIRECTIONS[i]}"] = push.ravel()
    found = {}
    for case, load in loads.items():
        moved = np.zeros(len(K))
        moved[rows] = np.linalg.solve(K[np.ix_(rows, rows)], load[rows])
        u = moved.reshape(-1, 3)
        entries = np.zeros((len(corners), 8, 8))
        for point in EXAMPLE["GAUSS"]:
            factors = (1 + EXAMPLE["CORNERS"] * point) / 2
            ways = [EXAMPLE["CORNERS"][:, d] / size[d] * np.delete(factors, d, 1).prod(1) for d in range(3)]
            dN = np.array(ways)
            strain = np.einsum("da,eab->edb", dN, u[corners])
            strain = 0.5 * (strain + np.swapaxes(strain, 1, 2))
            stress = lam * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2.0 * mu * strain
            entries += np.prod(size) / 8.0 * np.einsum("da,edb,bc->eac", dN, stress, dN)
        places = np.repeat(corners, 8, axis=1).ravel(), np.tile(corners, 8).ravel()
        small = coo_array((entries.ravel(), places), shape=(len(nodes),) * 2).toarray()
        found[case] = csr_array(np.kron(small, np.eye(3)))
    return found
