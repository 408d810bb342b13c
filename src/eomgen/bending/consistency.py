"""Checks of the constants of a link that bends: what no body has, whatever they were computed from."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from .constants import Constants

SYMMETRIC = 1e-8  # that matrices may be off their transposes, as a part of their greatest entry
DEFINITE = 1e-12  # of the greatest eigenvalue: what the least has to be above, and negative ones may be below 0
_FREE = 1e-6  # of linear and angular momentum by modes, as a part of what masses allow: of mean axes
_COUPLED = 1e-3  # of normalised masses: modes that share momentum
_UNCOUPLED = 1e-6  # of normalised matrices: modes that do not


def constants_conflict(constants: Constants, K: Array, D: Array) -> tuple[str, str] | None:
    """Return the key and the message of what no link that bends can have; None if all is right.

    Args:
        constants: finite, in the shapes that ``Constants`` says.
        K: stiffness, (m, m), finite.
        D: damping, (m, m), finite.
    """
    return next(_conflicts(constants, K, D), None)


def is_free(constants: Constants) -> bool:
    """Return whether the modes are those of a free link in mean axes: they have no linear and no angular momentum."""
    momenta, scales = _momenta(constants)
    return bool(np.all(np.abs(momenta) <= _FREE * scales))


def clamped_conflict(constants: Constants, K: Array) -> str | None:
    """Return the message of modes of a free link that were moved to vanish at its root; None for others.

    They diagonalise stiffness and the masses that are left in mean axes, but not the masses of a clamped link.
    """
    masses = constants.masses
    momenta, _ = _momenta(constants)
    mean = masses - momenta @ np.linalg.pinv(_rigid_masses(constants.H00), 1e-12, hermitian=True) @ momenta.T
    if np.diag(mean).min() <= DEFINITE * np.diag(masses).max():
        return None
    off = max(_coupling(mean), _coupling(K))
    if off > _UNCOUPLED or _coupling(masses) < _COUPLED:
        return None
    text = "modes of a free link, moved so that they vanish at the root: masses of two of them are coupled by"
    return (
        f"{text} {_coupling(masses):.2g}, in mean axes by {off:.1g}, and first frequencies would be some 20 % off;"
        " allowed: modes of the link that is clamped at its root, or those of the free link behind a free joint"
    )


def _conflicts(constants: Constants, K: Array, D: Array) -> Iterator[tuple[str, str]]:
    H00, P, Q = constants.H00, constants.P, constants.Q
    if not H00[3, 3] > 0.0:
        yield "H00", f"the mass is {H00[3, 3]:g} kg; allowed: a number greater than 0"
    for key, matrix in (("H00", H00), ("K", K), ("D", D)):
        yield from _unsymmetric(key, matrix, matrix.T)
    yield from _unsymmetric("P", P, P.transpose(1, 0, 3, 2))
    if Q is not None:
        yield from _unsymmetric("Q", Q, Q.transpose(1, 0, 2, 3))
    least, greatest = _ends(K)
    if least <= DEFINITE * greatest:
        got = f"its least eigenvalue is {least:.4g}, its greatest {greatest:.4g}"
        yield "K", f"{got}; allowed: a positive definite matrix"
    least, greatest = _ends(D)
    if least < -DEFINITE * max(greatest, -least) * len(D):
        yield "D", f"its least eigenvalue is {least:.4g}; allowed: a matrix that takes energy out"
    masses, scale = constants.masses, np.sqrt(np.clip(np.diag(constants.masses), 0.0, None))
    if scale.min() == 0.0:
        k = int(np.argmin(np.diag(masses)))
        yield "P", f"the mass of mode {k + 1}, tr P, is {masses[k, k]:g}; allowed: a number greater than 0"
    least, _ = _ends(masses / np.outer(scale, scale))
    if least <= DEFINITE:
        text = f"modes are linearly dependent: the least eigenvalue of their masses is {least:.2g} of what each has"
        yield "P", f"{text}; allowed: linearly independent modes"
    momenta, _ = _momenta(constants)
    whole = np.block([[_rigid_masses(H00), momenta.T], [momenta, masses]])
    size = np.sqrt(np.clip(np.diag(whole), np.finfo(float).tiny, None))
    least, _ = _ends(whole / np.outer(size, size))
    if least < -SYMMETRIC:
        text = "masses of rigid motions and modes together have the eigenvalue"
        yield "H0", f"{text} {least:.3g} of what each has; allowed: not below 0, integrals over one and the same mass"


def _unsymmetric(key: str, matrix: Array, other: Array) -> Iterator[tuple[str, str]]:
    off = np.abs(matrix - other)
    worst = np.unravel_index(int(np.argmax(off)), off.shape)
    if off[worst] > SYMMETRIC * np.abs(matrix).max():
        place = ", ".join(str(int(i) + 1) for i in worst)
        yield key, f"got {matrix[worst]:g} at ({place}), {other[worst]:g} at its mirror; allowed: a symmetric one"


def _ends(matrix: Array) -> tuple[float, float]:
    """Return the least and the greatest eigenvalue of a symmetric matrix."""
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2.0)
    return float(values[0]), float(values[-1])


def _coupling(matrix: Array) -> float:
    """Return the greatest entry off the diagonal of a matrix that is scaled to a diagonal of 1."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scaled = np.abs(matrix) / np.outer(scale, scale)
    np.fill_diagonal(scaled, 0.0)
    return float(scaled.max())


def _momenta(constants: Constants) -> tuple[Array, Array]:
    """Return linear and angular momentum about the origin by unit rates of modes, (m, 6), and what masses allow."""
    N, n = constants.H0[:, :3], constants.H0[:, 3]
    axial = np.stack([N[:, 1, 2] - N[:, 2, 1], N[:, 2, 0] - N[:, 0, 2], N[:, 0, 1] - N[:, 1, 0]], axis=1)
    own = np.sqrt(np.clip(np.diag(constants.masses), 0.0, None))
    length = np.sqrt(max(float(np.trace(constants.H00[:3, :3])), 0.0))
    scales = np.outer(own, np.repeat([np.sqrt(max(constants.H00[3, 3], 0.0)), length], 3))
    return np.hstack([n, axial]), scales


def _rigid_masses(H00: Array) -> Array:
    """Return the mass matrix of translations and rotations about the origin, (6, 6)."""
    (x, y, z), J, mass = H00[:3, 3], H00[:3, :3], H00[3, 3]
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.block([[mass * np.eye(3), cross], [cross.T, np.trace(J) * np.eye(3) - J]])
