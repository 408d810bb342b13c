"""Inertia integrals of modes of finite elements, from their mass matrix: H00, H0, P and the modal masses.

What M alone says of any elements is exact: mass, first moments and inertia, the momenta of each mode (N_k's
antisymmetric part and n_k) and modal masses.  Where M is that of solids, mu (x) 1_3, or has its rotational masses node
by node (lumped masses, points of mass and inertia), all other integrals are exact, too.  Else (consistent masses of
beams and shells) the symmetric part of N_k and P_kl, of which velocity terms alone depend, come from the mean of the
translational masses, with an error of the order of the elements' size squared; of a reduced model they cannot be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Index
from .checks import rigid_motions
from .constants import skew
from .finite_elements import FiniteElements

EXACT, MEAN, REDUCED = "exact", "mean of translational masses", "reduced model"
_SEEN = 1e-3  # of modal masses: translations by which modes have a direction
_SAME = 1e-9  # of the greatest entry: blocks that are equal, or 0


@dataclass(frozen=True)
class MassIntegrals:
    """H00, (4, 4); H0, (m, 4, 3); P, (m, m, 3, 3), whose traces are the modal masses; how: EXACT, MEAN or REDUCED."""

    H00: Array
    H0: Array
    P: Array
    how: str


def integrals(elements: FiniteElements, modes: Array) -> MassIntegrals:
    """Integrate modes over a link's masses.

    Args:
        elements: of the link.
        modes: displacements of the matrices' rows, (n, m).
    """
    rows = elements.by_node()
    nodes = np.flatnonzero(rows[:, 0] >= 0)
    rows = rows[nodes]
    blocks = None if elements.reduced or np.any(elements.dofs[:, 0] < 0) else _exact_blocks(elements.M, rows)
    R, M = rigid_motions(elements.nodes, elements.dofs), elements.M
    if blocks is not None:
        return _exact(blocks, elements.nodes[nodes], _on_nodes(modes, rows))
    G, momenta, masses = R.T @ (M @ R), R.T @ (M @ modes), modes.T @ (M @ modes)
    m = modes.shape[1]
    H00 = pseudo_inertia(G)
    if elements.reduced or np.any(elements.dofs[:, 0] < 0):
        N, P, how = np.zeros((m, 3, 3)), np.zeros((m, m, 3, 3)), REDUCED
    else:
        u = _on_nodes(modes, rows)[:, :3]
        mu = sum((M[rows[:, d]][:, rows[:, d]] for d in (1, 2)), M[rows[:, 0]][:, rows[:, 0]]) / 3.0
        r = elements.nodes[nodes]
        moved = np.stack([mu @ u[:, d] for d in range(3)], axis=1)  # (N, 3, m)
        N, P, how = np.einsum("ia,ibk->kab", r, moved), np.einsum("iak,ibl->klab", u, moved, optimize=True), MEAN
    H0 = np.zeros((m, 4, 3))
    H0[:, :3] = 0.5 * (N + np.swapaxes(N, 1, 2)) - 0.5 * skew(momenta[3:].T)
    H0[:, 3] = momenta[:3].T
    P = _with_traces(P, 0.5 * (masses + masses.T))
    return MassIntegrals(H00, H0, P, how)


def _with_traces(P: Array, masses: Array) -> Array:
    """Return P with modal masses as its traces: what is missing goes to the directions in which both modes move."""
    missing = masses - np.einsum("klaa->kl", P)
    moves = np.sqrt(np.maximum(np.einsum("kkaa->ka", P), 0.0))
    shares = np.einsum("ka,la->kla", moves, moves)
    total, size = shares.sum(axis=2), np.sqrt(np.outer(masses.diagonal(), masses.diagonal()))
    is_seen = total > _SEEN * size
    shares = np.where(is_seen[:, :, None], shares / np.where(is_seen, total, 1.0)[:, :, None], 1.0 / 3.0)
    return np.asarray(P + (missing[:, :, None] * shares)[:, :, :, None] * np.eye(3))


def pseudo_inertia(G: Array) -> Array:
    """Return H00, (4, 4), of a mass matrix of rigid-body motions about the origin, (6, 6)."""
    H = np.zeros((4, 4))
    H[3, 3] = np.trace(G[:3, :3]) / 3.0
    C = G[:3, 3:]  # -skew of the first moments
    H[:3, 3] = H[3, :3] = 0.5 * np.array([C[1, 2] - C[2, 1], C[2, 0] - C[0, 2], C[0, 1] - C[1, 0]])
    inertia = 0.5 * (G[3:, 3:] + G[3:, 3:].T)
    H[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return H


@dataclass(frozen=True)
class _Blocks:
    """mu: sparse masses of nodes, (N, N); s, J: first and second moments of what each node carries, (N, 3), (N, 3,
    3)."""

    mu: Any
    s: Array
    J: Array


def _on_nodes(modes: Array, rows: Index) -> Array:
    """Return displacements and rotations of nodes, (N, 6, m); 0 where there is no coordinate."""
    return np.where((rows >= 0)[:, :, None], modes[rows], 0.0)


def _exact_blocks(M: Any, rows: Index) -> _Blocks | None:
    """Take a mass matrix apart into mu (x) 1_3 and moments of nodes; None where it is not of that form."""
    size = abs(M).max()
    x, y, z = (rows[:, d] for d in range(3))
    mu = M[x][:, x]
    for other in (y, z):
        if _greatest(M[other][:, other] - mu) > _SAME * size:
            return None
    if any(_greatest(M[one][:, other]) > _SAME * size for one, other in ((x, y), (x, z), (y, z))):
        return None
    count = len(rows)
    s, J = np.zeros((count, 3)), np.zeros((count, 3, 3))
    if np.all(rows[:, 3:] < 0):
        return _Blocks(mu, s, J)
    translation, inertia = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    for b in range(3):
        there = np.flatnonzero(rows[:, 3 + b] >= 0)
        turned = rows[there, 3 + b]
        for a in range(6):
            others = np.flatnonzero(rows[:, a] >= 0)
            block = M[rows[others, a]][:, turned].tocoo()
            i, j = others[block.row], there[block.col]
            if np.any(np.abs(block.data[i != j]) > _SAME * _scale(M, rows, a, b)):
                return None
            same = i == j
            (translation if a < 3 else inertia)[i[same], a % 3, b] += block.data[same]
    s = 0.5 * np.stack(
        [
            translation[:, 1, 2] - translation[:, 2, 1],
            translation[:, 2, 0] - translation[:, 0, 2],
            translation[:, 0, 1] - translation[:, 1, 0],
        ],
        axis=1,
    )
    if np.abs(translation + skew(s)).max(initial=0.0) > _SAME * max(np.abs(translation).max(initial=0.0), 1e-300):
        return None
    traces = np.einsum("iaa->i", inertia)
    J = 0.5 * traces[:, None, None] * np.eye(3) - 0.5 * (inertia + np.swapaxes(inertia, 1, 2))
    return _Blocks(mu, s, J)


def _greatest(matrix: Any) -> float:
    return float(abs(matrix).max()) if matrix.nnz else 0.0


def _scale(M: Any, rows: Index, a: int, b: int) -> float:
    """Return the size that entries between directions are measured by: the mean of their diagonals."""
    diagonal = M.diagonal()
    one, other = (np.abs(diagonal[rows[rows[:, d] >= 0, d]]).max(initial=0.0) for d in (a, 3 + b))
    return float(np.sqrt(one * other))


def _exact(blocks: _Blocks, r: Array, motions: Array) -> MassIntegrals:
    """Integrate over particles at r + d of each node, with masses mu between nodes and moments s, J of d."""
    u, t = motions[:, :3], motions[:, 3:]
    mu, s, J = blocks.mu, blocks.s, blocks.J
    rho = np.hstack([r, np.ones((len(r), 1))])
    H00 = rho.T @ (mu @ rho)
    H00[:3, :3] += np.einsum("ia,ib->ab", r, s) + np.einsum("ia,ib->ab", s, r) + J.sum(axis=0)
    H00[:3, 3] += s.sum(axis=0)
    H00[3, :3] += s.sum(axis=0)
    moved = np.stack([mu @ u[:, d] for d in range(3)], axis=1)
    H0 = np.einsum("ia,ibk->kab", rho, moved)
    P = np.einsum("iak,ibl->klab", u, moved, optimize=True)
    if s.any() or J.any():
        T = skew(np.moveaxis(t, 2, 0))  # (m, N, 3, 3), rotations of nodes
        turned = np.einsum("kiab,ib->iak", T, s)  # of first moments
        H0 += np.einsum("ia,ibk->kab", rho, turned)
        H0[:, :3] += np.einsum("ia,ibk->kab", s, u) + np.einsum("iac,kibc->kab", J, T)
        mixed = np.einsum("iak,ibl->klab", u, turned, optimize=True)
        P = P + mixed + np.transpose(mixed, (1, 0, 3, 2))
        P = P + np.einsum("kiac,icd,libd->klab", T, J, T, optimize=True)
    return MassIntegrals(0.5 * (H00 + H00.T), H0, P, EXACT)
