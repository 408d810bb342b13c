"""Checks of finite elements as mechanics: symmetry, rigid-body motions, mass and inertia, definiteness, ranks.

Each refusal has the number that is wrong, and the node and direction where it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from .finite_elements import DIRECTIONS, MODAL, FiniteElements

SYMMETRIC = 1e-8  # that a matrix may be off its transpose, as a part of its greatest entry
RIGID = 1e-6  # of K's entries: what forces of a rigid-body motion may add up to; files have seven digits or more
EQUAL_MASS = 1e-6  # that masses along x, y and z may differ by, as a part of them
SINGULAR = 1e-13  # of the diagonal of K, clamped: what pivots that are round-off stay below
RANK = 1e-6  # of singular values of rigid-body motions, rotations by the size of the set
MOTIONS = ("translation along x", "translation along y", "translation along z") + tuple(
    f"rotation about {axis}" for axis in "xyz"
)
_ADVICE = "write M and K without boundary conditions, in one set of units with the nodes"


def rigid_motions(places: Array, dofs: Any, origin: Array | None = None) -> Array:
    """Return the displacements of unit translations and rotations about an origin, (n, 6).

    Args:
        places: of nodes, (N, 3).
        dofs: (n, 2), node and direction of each displacement; amplitudes of modes stay 0.
        origin: (3,); None: that of the link's frame.
    """
    R = np.zeros((len(dofs), len(DIRECTIONS)))
    rows = np.flatnonzero(dofs[:, 0] != MODAL)
    nodes, directions = dofs[rows, 0], dofs[rows, 1]
    R[rows, directions] = 1.0
    arms = places[nodes] - (0.0 if origin is None else origin)
    for axis in range(3):
        turned = np.cross(np.eye(3)[axis], arms)
        moved = directions < 3
        R[rows[moved], 3 + axis] = turned[moved, directions[moved]]
    return R


def check_matrices(elements: FiniteElements) -> Array:
    """Check M and K of the whole link and return its mass matrix of rigid-body motions about the origin, (6, 6).

    Raises:
        InputError: a matrix is not symmetric, K has a force in a rigid-body motion, masses differ by direction, or a
            mass is not positive.
    """
    for name, matrix in (("M", elements.M), ("K", elements.K), *elements.stress.items()):
        _check_symmetry(elements, name, matrix)
    _check_diagonal(elements)
    R = rigid_motions(elements.nodes, elements.dofs)
    _check_null_vectors(elements, R)
    G = R.T @ (elements.M @ R)
    _check_mass(G)
    return np.asarray(0.5 * (G + G.T))


def _check_symmetry(elements: FiniteElements, name: str, matrix: Any) -> None:
    difference = abs(matrix - matrix.T).tocoo()
    size = abs(matrix).max() if matrix.nnz else 0.0
    if not matrix.nnz or size == 0.0:
        raise InputError(f"{name}: all entries are 0; allowed: a matrix of the link")
    if difference.nnz and difference.data.max() > SYMMETRIC * size:
        k = int(difference.data.argmax())
        i, j = int(difference.row[k]), int(difference.col[k])
        entries = f"{matrix[i, j]:g} and {matrix[j, i]:g}"
        where = f"({elements.row_name(i)}) and ({elements.row_name(j)})"
        raise InputError(f"{name}: got {entries} between {where}; allowed: a symmetric matrix")


def _check_diagonal(elements: FiniteElements) -> None:
    """Refuse a negative diagonal entry of M or K."""
    for name, matrix in (("M", elements.M), ("K", elements.K)):
        diagonal = matrix.diagonal()
        least = int(diagonal.argmin())
        if diagonal[least] < 0.0:
            got = f"{diagonal[least]:g} on the diagonal at {elements.row_name(least)}"
            raise InputError(f"{name}: got {got}; allowed: 0 or more")


def _check_null_vectors(elements: FiniteElements, R: Array) -> None:
    """Refuse a stiffness matrix that resists a rigid-body motion: it is held, or its nodes are elsewhere."""
    forces = elements.K @ R
    sizes = np.abs(elements.K) @ np.abs(R)
    for k, motion in enumerate(MOTIONS):
        shares = np.abs(forces[:, k]) / max(float(sizes[:, k].max()), np.finfo(float).tiny)
        worst = int(shares.argmax())
        if shares[worst] > RIGID:
            unit = ("N", "N m")[int(elements.dofs[worst, 1] > 2)]
            got = f"the {motion} by 1 {('m', 'rad')[int(k > 2)]} is resisted by {forces[worst, k]:.4g} {unit}"
            share = f"{shares[worst]:.1e} of the greatest sum of terms"
            raise InputError(
                f"K: got {got} at {elements.row_name(worst)}, {share}; allowed: up to {RIGID:g}, as rigid-body motions "
                f"cost no energy: {_ADVICE}"
            )


def _check_mass(G: Array) -> None:
    """Refuse masses that are not positive, or not the same along x, y and z."""
    masses = G.diagonal()[:3]
    if not masses.min() > 0.0:
        raise InputError(
            f"M: has a mass of {masses.min():g} kg along {DIRECTIONS[int(masses.argmin())]}; allowed: above 0"
        )
    if np.ptp(masses) > EQUAL_MASS * masses.max():
        got = ", ".join(f"{mass:.9g} kg along {axis}" for mass, axis in zip(masses.tolist(), "xyz", strict=True))
        raise InputError(f"M: has masses of {got}; allowed: the same up to {EQUAL_MASS:g} of it: {_ADVICE}")


def check_rank(name: str, motions: Array, advice: str) -> None:
    """Refuse a set of nodes whose displacements leave a rigid-body motion open.

    Args:
        name: of the set, in the message.
        motions: displacements of unit motions about the middle of the set, (rows, 6).
        advice: what to do instead.

    Raises:
        InputError: their rank is below six; the message has it, and a motion that is open.
    """
    size = np.sqrt(np.square(motions[:, 3:]).sum() / max(np.count_nonzero(motions[:, :3]), 1)) or 1.0
    scaled = motions / np.array([1.0] * 3 + [size] * 3)
    _, S, V = np.linalg.svd(np.vstack([scaled, np.zeros((6, 6))]), full_matrices=False)
    rank = int(np.count_nonzero(RANK * S.max(initial=0.0) < S))
    if rank < 6:
        motion = MOTIONS[int(np.abs(V[-1]).argmax())]
        raise InputError(
            f"{name}: its displacements have rank {rank} and leave the {motion} open; allowed: rank 6: {advice}"
        )


def check_pivots(factors: Any, diagonal: Array, names: Any) -> None:
    """Refuse a clamped stiffness matrix that is not positive definite, by the pivots of its factors.

    Args:
        factors: of ``scipy.sparse.linalg.splu`` without exchanges of rows.
        diagonal: of the matrix.
        names: gives the name of a row by its number.

    Raises:
        InputError: a pivot is not positive; the message has its row, and the pivot as a part of the diagonal.
    """
    pivots = factors.U.diagonal()
    of_row = np.empty(len(pivots), dtype=np.intp)
    of_row[factors.perm_c] = np.arange(len(pivots))
    shares = pivots / np.where(diagonal[of_row] > 0.0, diagonal[of_row], 1.0)
    least = int(shares.argmin())
    if not shares[least] > SINGULAR:
        row = int(of_row[least])
        raise InputError(
            f"K, clamped: its pivot at {names(row)} is {shares[least]:.1e} of its diagonal; allowed: above "
            f"{SINGULAR:g}: a positive definite matrix, of a link in one piece without mechanisms"
        )


def check_responses(factors: Any, K: Any, names: Any) -> None:
    """Refuse a clamped stiffness matrix of a large link that is singular or indefinite, without a copy of its factors.

    Args:
        factors: of K.
        K: sparse, (n, n).
        names: gives the name of a row by its number.

    Raises:
        InputError: a load moves a row as a mechanism does, or gains energy; the message has the number and the row.
    """
    load = np.random.default_rng(0).standard_normal(K.shape[0])
    moved = np.asarray(factors.solve(load))
    row = int(np.abs(moved).argmax())
    share = float(np.abs(load).max() / max(K.diagonal()[row] * abs(moved[row]), np.finfo(float).tiny))
    energy = float(load @ moved)
    if not (share > SINGULAR and energy > 0.0):
        got = f"a load moves {names(row)} as if it had {share:.1e} of its stiffness, with the energy {energy:.3g} J"
        raise InputError(
            f"K, clamped: {got}; allowed: above {SINGULAR:g} and above 0: a positive definite matrix, of a link in one "
            "piece without mechanisms"
        )
