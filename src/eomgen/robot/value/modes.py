"""Links that bend: constants of their modes and nodes.

A particle of the link is at rho0 + sum_k phi_k e_k + 1/2 sum_kl psi_kl e_k e_l, with modal coordinates e and rho0 =
(x, y, z, 1) in the link's frame.  A node is a joint of eq. (3) whose six coordinates are functions of e: Phi e + 1/2 e
Psi e (``nodes`` makes it one).

Source: W. J. Book, "Recursive Lagrangian Dynamics of Flexible Manipulator Arms", The International Journal of Robotics
Research 3(3), 1984, for the expansion; the constants are integrals that A. A. Shabana, "Dynamics of Multibody Systems",
calls inertia shape integrals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ...identifiers import is_identifier
from ...names import show
from ..fields import Numbers, Picklable
from ..geometry import COORDINATES, LINEAR, Vector
from .coordinate import Coordinate

if TYPE_CHECKING:
    from collections.abc import Sequence

Table = tuple[tuple[float, ...], ...]  # rows
ROUND_OFF = 1e-9  # that matrices may be off their transposes, as a part of their greatest entry, and below zero
DIAGONALS: Mapping[str, str] = MappingProxyType({"K": "stiffness", "D": "damping"})  # what their diagonals are called


@dataclass(frozen=True)
class Node(Picklable):
    """A place of a link that bends where joints, frames and loads stand.

    place: where it is while nothing bends, m, link frame.  Phi: what the modes make of its coordinates x, y, z (m),
    alpha, beta, gamma (rad), 6 rows of m numbers.  Psi: the second order of x, y and z, three symmetric matrices of m
    rows; None where there is none.
    """

    name: str
    place: Vector
    Phi: Table
    Psi: tuple[Table, ...] | None = None

    def moving(self) -> tuple[str, ...]:
        """Name the coordinates that modes move."""
        second = dict(zip(LINEAR, self.Psi or (), strict=False))
        rows = zip(COORDINATES, self.Phi, strict=True)
        return tuple(name for name, row in rows if any(row) or any(map(any, second.get(name, ()))))


@dataclass(frozen=True)
class LinkModes(Picklable):
    """Constants of a link's m modes, in its frame: kg, m, N.

    H0: integrals of rho0 phi_k^T dm, m x 4 x 3.  P: of phi_k phi_l^T, m x m x 3 x 3, whose traces are the modal mass
    matrix.  Q: of rho0 psi_kl^T, m x m x 4 x 3, symmetric in k and l; None where deflections are linear in e, which
    leaves stiffening by rotation out.  K, D: stiffness and damping, m x m; their diagonals may be parameters, what is
    beside them is constant.  nodes: all but the root, where the link
    stands on its joint and nothing moves.
    """

    H0: tuple[Table, ...]
    P: tuple[tuple[Table, ...], ...]
    K: Table
    D: Table
    nodes: tuple[Node, ...]
    Q: tuple[tuple[Table, ...], ...] | None = None

    @property
    def count(self) -> int:
        """m, the number of modes."""
        return len(self.K)

    @property
    def names(self) -> tuple[str, ...]:
        """Kinds of their coordinates: mode1, mode2, ..."""
        return tuple(f"mode{k}" for k in range(1, self.count + 1))

    @property
    def masses(self) -> Table:
        """Modal mass matrix, tr P_kl, m x m."""
        return tuple(tuple(block[0][0] + block[1][1] + block[2][2] for block in row) for row in self.P)

    def frequencies(self) -> tuple[float, ...]:
        """Return the frequency of each mode by itself, Hz: of a link clamped at its root where m and K are diagonal."""
        squares = (self.K[k][k] / mass for k, mass in enumerate(self.masses[k][k] for k in range(self.count)))
        return tuple(math.sqrt(x) / (2.0 * math.pi) for x in squares)

    def line(self, link: str) -> str:
        """Return what bends the link of that name, on one line."""
        frequencies = ", ".join(f"{x:.4g}" for x in self.frequencies())
        nodes = ", ".join(node.name for node in self.nodes) or "none"
        second = "" if self.Q is not None else "; not stiffened by rotation"
        coupled = " and ".join(key for key in DIAGONALS if self.couplings(key))
        second += f"; coupled by {coupled}" if coupled else ""
        return f"link {link} bends: {self.count} modes of {frequencies} Hz, each by itself; nodes {nodes}{second}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {"frequencies_hz": list(self.frequencies()), "nodes": [node.name for node in self.nodes]}

    def coordinates(self) -> dict[str, Coordinate]:
        """Return the modal coordinates by their kinds, with the diagonals of K and D."""
        diagonals = ((self.K[k][k], self.D[k][k]) for k in range(self.count))
        return {
            name: Coordinate(stiffness=stiffness, damping=damping)
            for name, (stiffness, damping) in zip(self.names, diagonals, strict=True)
        }

    def numbers(self) -> Numbers:
        """Yield all numbers that may be parameters, by their names below the link's: "modes.1.stiffness"."""
        for k in range(self.count):
            yield f"modes.{k + 1}.stiffness", self.K[k][k]
            yield f"modes.{k + 1}.damping", self.D[k][k]

    def conflict(self) -> tuple[str, str] | None:
        """Return the key and the message of what no link can have; None if all is right."""
        m = self.count
        shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
            "H0": (self.H0, (m, 4, 3)),
            "P": (self.P, (m, m, 3, 3)),
            "K": (self.K, (m, m)),
            "D": (self.D, (m, m)),
        }
        if self.Q is not None:
            shapes["Q"] = (self.Q, (m, m, 4, 3))
        for node in self.nodes:
            shapes[f"nodes.{node.name}.Phi"] = (node.Phi, (6, m))
            if node.Psi is not None:
                shapes[f"nodes.{node.name}.Psi"] = (node.Psi, (3, m, m))
        for key, (value, shape) in shapes.items():
            if not _has_shape(value, shape):
                return key, f"allowed: an array of {' x '.join(map(str, shape))} numbers, as there are {m} modes"
        for node in self.nodes:
            if not is_identifier(node.name):
                return "nodes", f"got {show(node.name)}; allowed: an identifier"
        return next(self._wrong_matrices(), None)

    def couplings(self, key: str) -> dict[tuple[int, int], float]:
        """Return what K or D, by its name, has beside the diagonal: by modes (k, j) with k < j, without round-off."""
        matrix: Table = getattr(self, key)
        between = {
            (k, j): 0.5 * (matrix[k][j] + matrix[j][k]) for k in range(self.count) for j in range(k + 1, self.count)
        }
        sizes = _sizes(matrix)
        return {(k, j): x for (k, j), x in between.items() if abs(x) > ROUND_OFF * sizes[k] * sizes[j]}

    def least(self) -> dict[str, float]:
        """Return the least values of parameters beside constants: whatever others are, K and D stay semidefinite.

        With the least eigenvalue r of a matrix that is scaled by its diagonal, r times that may go.
        """
        found: dict[str, float] = {}
        for key, name in DIAGONALS.items():
            coupled = {k for pair in self.couplings(key) for k in pair}
            if coupled:
                matrix: Table = getattr(self, key)
                left = (1.0 - max(_least_eigenvalue(matrix), 0.0)) * (1.0 - ROUND_OFF)
                found |= {f"modes.{k + 1}.{name}": left * matrix[k][k] for k in sorted(coupled)}
        return found

    def _wrong_matrices(self) -> Iterator[tuple[str, str]]:
        """Yield keys and messages of matrices that are not symmetric, or give energy to a motion."""
        for key, matrix in (("K", self.K), ("D", self.D)):
            message = next(_wrong(matrix), None)
            if message is not None:
                yield key, message


def coupling_name(link: str, key: str, k: int, j: int) -> str:
    """Name an entry of K or D beside the diagonal, of modes k and j: "links.arm.modes.K.1.2"."""
    return f"links.{link}.modes.{key}.{k + 1}.{j + 1}"


def _wrong(matrix: Table) -> Iterator[str]:
    """Yield messages of what is wrong with a matrix of stiffness or damping."""
    size = max((abs(x) for row in matrix for x in row), default=0.0)
    for k, row in enumerate(matrix):
        for j, x in enumerate(row):
            if not math.isfinite(x):
                yield f"got {x} at ({k + 1}, {j + 1}); allowed: finite numbers"
            elif abs(x - matrix[j][k]) > ROUND_OFF * size:
                where = f"{x:g} at ({k + 1}, {j + 1}), {matrix[j][k]:g} at ({j + 1}, {k + 1})"
                yield f"got {where}; allowed: a symmetric matrix"
            elif x != 0.0 and row[k] == 0.0:
                where = f"{x:g} at ({k + 1}, {j + 1}), 0 at ({k + 1}, {k + 1})"
                yield f"got {where}; allowed: a positive semidefinite matrix"
    least = _least_eigenvalue(matrix)
    if least < -ROUND_OFF * len(matrix):
        yield f"scaled by its diagonal it has the eigenvalue {least:.4g}; allowed: a positive semidefinite matrix"


def _sizes(matrix: Table) -> list[float]:
    return [math.sqrt(abs(row[k])) for k, row in enumerate(matrix)]


def _least_eigenvalue(matrix: Table) -> float:
    """Return the least eigenvalue of a symmetric matrix that is scaled to a diagonal of 1, -1 or 0."""
    import numpy as np

    scale = 1.0 / np.array([size or 1.0 for size in _sizes(matrix)])
    scaled = np.array(matrix) * np.outer(scale, scale)
    return float(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)).min(initial=math.inf))


def _has_shape(value: Any, shape: Sequence[int]) -> bool:
    if not shape:
        return isinstance(value, float)
    return isinstance(value, tuple) and len(value) == shape[0] and all(_has_shape(x, shape[1:]) for x in value)
