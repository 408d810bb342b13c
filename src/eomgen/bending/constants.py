"""Constants of a link that bends: integrals of its mass over the shapes of its modes.

A particle stands at rho0 + phi_k e_k + 1/2 psi_kl e_k e_l, with modal coordinates e and rho0 = (x, y, z, 1) in the
link's frame.  What dynamics needs of the shapes are integrals over the mass: of rho0 rho0^T, rho0 phi_k^T,
phi_k phi_l^T and rho0 psi_kl^T (A. A. Shabana, "Dynamics of Multibody Systems", calls them inertia shape integrals).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..robot.value import LinkModes, Node


@dataclass(frozen=True, eq=False)
class Constants:
    """Integrals of a body's mass over m modes, in its frame, kg and m.

    H00: of rho0 rho0^T, (4, 4).  H0: of rho0 phi_k^T, (m, 4, 3).  P: of phi_k phi_l^T, (m, m, 3, 3).  Q: of
    rho0 psi_kl^T, (m, m, 4, 3); None where deflections are linear in the modal coordinates.
    """

    H00: Array
    H0: Array
    P: Array
    Q: Array | None = None

    @property
    def count(self) -> int:
        """m, the number of modes."""
        return len(self.H0)

    @property
    def masses(self) -> Array:
        """Modal mass matrix, tr P_kl, (m, m)."""
        return np.asarray(np.trace(self.P, axis1=2, axis2=3))

    def turned(self, rotation: ArrayLike, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Constants:
        """Return the constants in a frame in which the present one has axes, columns of a rotation, and an origin, m.

        Entries that are 0 stay exactly 0 where the rotation has entries 0 and +-1 alone.
        """
        R, R4 = np.array(rotation, dtype=float), np.eye(4)
        R4[:3, :3], R4[:3, 3] = R, origin
        return Constants(
            _clean(R4 @ self.H00 @ R4.T),
            _clean(R4 @ self.H0 @ R.T),
            _clean(R @ self.P @ R.T),
            None if self.Q is None else _clean(R4 @ self.Q @ R.T),
        )

    def link_modes(self, K: ArrayLike, D: ArrayLike, nodes: Sequence[Node]) -> LinkModes:
        """Return the value of a description: with stiffness and damping, (m, m), and nodes in the link's frame."""
        return LinkModes(
            H0=as_tuples(self.H0),
            P=as_tuples(self.P),
            K=as_tuples(K),
            D=as_tuples(D),
            nodes=tuple(nodes),
            Q=None if self.Q is None else as_tuples(self.Q),
        )


def constants_of_masses(
    masses: ArrayLike,
    places: ArrayLike,
    moments: ArrayLike,
    translations: ArrayLike,
    rotations: ArrayLike,
    second: ArrayLike | None = None,
) -> Constants:
    """Return the constants of N small rigid bodies that move with m modes.

    Args:
        masses: (N,), kg; lumped masses of nodes, or those of Gauss points.
        places: centres of mass while nothing bends, (N, 3), m.
        moments: second moments of mass about them, integrals of d d^T, (N, 3, 3), kg m^2.
        translations: of the centres of mass by each mode, (N, 3, m).
        rotations: vectors of small rotations by each mode, (N, 3, m).
        second: second order of the centres' motion, psi_kl, (N, 3, m, m); None: none.
    """
    mass, r, S = (np.asarray(x, dtype=float) for x in (masses, places, moments))
    u = np.moveaxis(np.asarray(translations, dtype=float), 2, 0)  # (m, N, 3)
    turn = skew(np.moveaxis(np.asarray(rotations, dtype=float), 2, 0))  # (m, N, 3, 3)
    m = len(u)
    H00, H0, P = np.zeros((4, 4)), np.zeros((m, 4, 3)), np.zeros((m, m, 3, 3))
    first = mass @ r
    H00[:3, :3] = np.einsum("n,ni,nj->ij", mass, r, r) + S.sum(axis=0)
    H00[:3, 3] = H00[3, :3] = first
    H00[3, 3] = mass.sum()
    H0[:, :3] = np.einsum("n,ni,knj->kij", mass, r, u) + np.einsum("nij,knlj->kil", S, turn)
    H0[:, 3] = np.einsum("n,knj->kj", mass, u)
    P[:] = np.einsum("n,kni,lnj->klij", mass, u, u)
    P += np.einsum("knib,lnjb->klij", turn @ S, turn)
    Q = None
    if second is not None:
        psi = np.asarray(second, dtype=float)
        Q = np.zeros((m, m, 4, 3))
        Q[:, :, :3] = np.einsum("n,ni,njkl->klij", mass, r, psi)
        Q[:, :, 3] = np.einsum("n,njkl->klj", mass, psi)
    return Constants(H00, H0, P, Q)


def body_of(
    H00: ArrayLike,
) -> tuple[float, tuple[float, float, float], tuple[float, float, float, float, float, float]]:
    """Return mass, kg, centre of mass, m, and moments and products of inertia about it, kg m^2, of a pseudo-inertia.

    Args:
        H00: integral of rho0 rho0^T, (4, 4).
    """
    H = np.asarray(H00, dtype=float)
    mass = float(H[3, 3])
    com = H[:3, 3] / mass
    J = H[:3, :3] - mass * np.outer(com, com)
    inertia = np.trace(J) * np.eye(3) - J
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    xx, yy, zz, xy, xz, yz = (float(inertia[i, j]) + 0.0 for i, j in order)
    x, y, z = (float(x) + 0.0 for x in com)
    return mass, (x, y, z), (xx, yy, zz, xy, xz, yz)


def modal_damping(masses: ArrayLike, K: ArrayLike, ratio: float) -> Array:
    """Return the damping matrix that gives all modes a part of critical damping, (m, m).

    Where masses and stiffness are diagonal it is so, too: 2 ratio sqrt(k m).

    Args:
        masses: modal mass matrix, (m, m), positive definite.
        K: modal stiffness, (m, m), positive definite.
        ratio: of critical damping, of each mode of the clamped link.
    """
    M, stiff = np.asarray(masses, dtype=float), np.asarray(K, dtype=float)
    if not np.any(M - np.diag(np.diag(M))) and not np.any(stiff - np.diag(np.diag(stiff))):
        return np.diag(2.0 * ratio * np.sqrt(np.diag(M) * np.diag(stiff)))
    L, squares, X = _squares(M, stiff)
    root = L @ X
    return np.asarray((root * (2.0 * ratio * np.sqrt(squares))) @ root.T)


def first_frequency(masses: ArrayLike, K: ArrayLike) -> float:
    """Return the lowest frequency of modes together, rad/s, by modal masses and stiffness, (m, m)."""
    _, squares, _ = _squares(np.asarray(masses, dtype=float), np.asarray(K, dtype=float))
    return float(np.sqrt(squares[0]))


def _squares(M: Array, K: Array) -> tuple[Array, Array, Array]:
    """Return L with M = L L^T, and squares of frequencies, which rise, with their modes in coordinates L^T x."""
    L = np.asarray(np.linalg.cholesky(M), dtype=np.float64)
    inner = np.linalg.solve(L, np.linalg.solve(L, K).T)
    squares, X = np.linalg.eigh((inner + inner.T) / 2.0)
    return L, np.asarray(np.maximum(squares, 0.0)), np.asarray(X)


def placed_node(node: Node, rotation: Array, origin: Array) -> Node:
    """Return a node in a frame in which the present one has axes, columns of a rotation, and an origin, (3,), m."""
    Phi = np.array(node.Phi)
    return Node(
        node.name,
        as_tuples(rotation @ np.array(node.place) + origin),
        as_tuples(np.vstack([rotation @ Phi[:3], rotation @ Phi[3:]])),
        None if node.Psi is None else as_tuples(np.einsum("ij,jkl->ikl", rotation, np.array(node.Psi))),
    )


def as_tuples(values: ArrayLike) -> Any:
    """Return an array as nested tuples of floats, without negative zeros."""
    array = np.asarray(values, dtype=float) + 0.0
    return _nested(array.tolist())


def _nested(values: Any) -> Any:
    return tuple(_nested(x) for x in values) if isinstance(values, list) else values


def _clean(values: Array) -> Array:
    """Return values without negative zeros."""
    return np.asarray(values + 0.0)


def skew(vectors: Array) -> Array:
    """Return the matrices of cross products of vectors, (..., 3) -> (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape((*vectors.shape, 3))
