"""Centres of stiffness: where the coupling block of a stiffness matrix is symmetric, and principal stiffnesses there.

With K = [[A, B], [B^T, C]] over translations and small rotations, at a point p, d_p = d + theta x p, the coupling is
B + A skew(p), and is symmetric where (tr(A) 1 - A) p = -w, with skew(w) = B - B^T (J. Loncaric, "Normal Forms of
Stiffness and Compliance Matrices", IEEE Journal of Robotics and Automation 3, 1987).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..geometry import COORDINATES, Placement
from .matrices import carried, matrix_of, names_of

SHARE = 1e-9  # of the largest stiffness, below which one is none


@dataclass(frozen=True)
class PrincipalStiffness:
    """Principal stiffnesses, three each, ascending, N/m and N m/rad, and the point (m) that they are about."""

    center: tuple[float, float, float]
    translational: tuple[float, ...]
    rotational: tuple[float, ...]


def principal_stiffness(entries: Mapping[str, float]) -> PrincipalStiffness | str:
    """Return the principal stiffnesses of a matrix's two blocks at its centre of stiffness, or why there is none.

    Args:
        entries: of a stiffness matrix, by names, "x.beta".
    """
    import numpy as np

    missing = [name for name in COORDINATES if name not in names_of(entries)]
    if missing:
        return f"no stiffness of {', '.join(missing)}"
    K = np.array(matrix_of(entries, COORDINATES))
    A, B = K[:3, :3], K[:3, 3:]
    forces = np.linalg.eigvalsh(A)
    if forces[1] <= SHARE * forces[2]:
        return "two directions without a stiffness"
    W = B - B.T
    p = np.linalg.solve(np.trace(A) * np.eye(3) - A, -np.array([W[2, 1], W[0, 2], W[1, 0]]))
    x, y, z = p.tolist()
    C = np.array(carried(K.tolist(), Placement((-x, -y, -z))))[3:, 3:]
    return PrincipalStiffness((x, y, z), tuple(forces.tolist()), tuple(np.linalg.eigvalsh(C).tolist()))


def principal_line(entries: Mapping[str, float]) -> str:
    """Say the principal stiffnesses of a matrix in a line."""
    found = principal_stiffness(entries)
    if isinstance(found, str):
        return f"no centre of stiffness: {found}"
    numbers = [", ".join(f"{x:.4g}" for x in values) for values in (found.translational, found.rotational)]
    place = ", ".join(f"{x + 0.0:.4g}" for x in found.center)
    return f"principal {numbers[0]} N/m and {numbers[1]} N m/rad at the centre of stiffness ({place}) m"
