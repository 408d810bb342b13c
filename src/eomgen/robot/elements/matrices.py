"""Symmetric matrices over coordinates of a frame as seen from another: entries by name, other frames, and checks.

Entries are those on and above the diagonal that are not 0, "x.x", "x.beta", in the order of ``COORDINATES``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from types import MappingProxyType

from ...limits import LARGEST
from ..geometry import ANGULAR, COORDINATES, Placement, Vector
from ..numbers import Conflict, Number

Rows = Sequence[Sequence[float]]
Matrix = list[list[float]]

ROUND_OFF = 1e-9  # of a matrix scaled by its diagonal
PAIRS = tuple((one, other) for i, one in enumerate(COORDINATES) for other in COORDINATES[i:])
ABOUT: Mapping[str, str] = MappingProxyType(
    {
        "matrix": "rows over the coordinates that move, in their order, or six; symmetric, positive semidefinite",
        "at": "frame in the joint's in which six rows were given, for small deviations; default the joint's",
        "preload": "constant forces at zero deviation, as many as rows",
    }
)
_FORCE = ("N", "N m")  # of translations and rotations
_SEEN = 0.1  # of a direction's largest share, from which on its coordinates are named


def entry_name(one: str, other: str) -> str:
    """Return the name of an entry, "x.beta"."""
    return f"{one}.{other}"


def entry_numbers(what: str, per: tuple[str, str]) -> list[Number]:
    """Return the numbers of all 21 entries.

    Args:
        what: a word for the matrix.
        per: units of motions that forces are per, of translations and of rotations: "m", "rad", or "m/s" as "s/m".
    """
    numbers = []
    for one, other in PAIRS:
        unit = _FORCE[one in ANGULAR] + per[other in ANGULAR]
        about = f"entry of the {what} along {one} and {other}"
        numbers.append(Number(entry_name(one, other), about, (unit,), least=0.0 if one == other else None))
    return numbers


def preload_numbers() -> list[Number]:
    """Return the numbers of constant forces, "preload.x"."""
    about = "constant force along {}; a positive one pushes towards negative values"
    return [
        Number(f"preload.{name}", about.format(name), (_FORCE[name in ANGULAR],), least=None) for name in COORDINATES
    ]


def names_of(entries: Mapping[str, float]) -> tuple[str, ...]:
    """Return the coordinates that entries name, in their order."""
    named = {name for key in entries for name in key.split(".")}
    return tuple(name for name in COORDINATES if name in named)


def entries_of(matrix: Rows, names: Sequence[str]) -> dict[str, float]:
    """Return the entries of a symmetric matrix over these coordinates that are not 0."""
    upper = {
        entry_name(one, other): 0.5 * (matrix[i][j] + matrix[j][i])
        for i, one in enumerate(names)
        for j, other in enumerate(names)
        if i <= j
    }
    return {key: value for key, value in upper.items() if value != 0.0}


def matrix_of(entries: Mapping[str, float], names: Sequence[str]) -> Matrix:
    """Return the matrix over these coordinates, (n, n)."""
    upper = {(one, other): entries.get(entry_name(one, other), 0.0) for one, other in PAIRS}
    return [[upper.get((one, other), upper.get((other, one), 0.0)) for other in names] for one in names]


def ordered(entries: Mapping[str, float]) -> Mapping[str, float]:
    """Return entries that are not 0 in their order, read-only; what is no entry stands behind them."""
    known = [entry_name(*pair) for pair in PAIRS]
    return MappingProxyType({key: entries[key] for key in dict.fromkeys((*known, *entries)) if entries.get(key)})


def entries_among(entries: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """Return the entries whose rows and columns both are of these coordinates."""
    return {key: value for key, value in entries.items() if all(name in names for name in key.split("."))}


def couples(entries: Mapping[str, float]) -> bool:
    """Whether there are entries beside the diagonal."""
    return any(key.partition(".")[0] != key.rpartition(".")[2] for key in entries)


def matrix_lines(entries: Mapping[str, float], names: Sequence[str]) -> list[str]:
    """Return the matrix as lines of text, with names of its rows and columns."""
    rows = [[f"{x:.4g}" for x in row] for row in matrix_of(entries, names)]
    width = max(len(x) for row in (names, *rows) for x in row) + 2
    head = "".join(f"{name:>{width}}" for name in names)
    return [
        f"  {'':5}{head}",
        *(f"  {x:5}{''.join(f'{y:>{width}}' for y in row)}" for x, row in zip(names, rows, strict=True)),
    ]


def motion_at(at: Placement) -> Matrix:
    """Return A of (d, theta)_at = A (d, theta), (6, 6), of small translations and rotations about the origin.

    The point at p moves by d + theta x p; both are seen in the axes R of the frame: [[R^T, -R^T skew(p)], [0, R^T]].
    """
    R = at.rotation
    A = [[0.0] * 6 for _ in range(6)]
    for i in range(3):
        axis: Vector = (R[0][i], R[1][i], R[2][i])
        arm = _cross(at.xyz, axis)  # axis . (theta x p) = theta . (p x axis)
        for j in range(3):
            A[i][j] = A[i + 3][j + 3] = axis[j]
            A[i][j + 3] = arm[j]
    return A


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def carried(matrix: Rows, at: Placement) -> Matrix:
    """Return A^T K A: a matrix that was given at a frame, at the origin; right for small deviations."""
    A = motion_at(at)
    KA = [[sum(row[k] * A[k][j] for k in range(6)) for j in range(6)] for row in matrix]
    return [[sum(A[k][i] * KA[k][j] for k in range(6)) for j in range(6)] for i in range(6)]


def carried_forces(forces: Sequence[float], at: Placement) -> list[float]:
    """Return A^T f: a force and a moment that were given at a frame, at the origin."""
    A = motion_at(at)
    return [sum(A[k][i] * forces[k] for k in range(6)) for i in range(6)]


def matrix_conflict(matrix: Rows, names: Sequence[str]) -> Conflict | None:
    """Return the key ("" or an entry's name) and the message of what is wrong with a matrix; None if nothing is.

    It has to be symmetric, and positive semidefinite up to round-off: no deviation has a negative energy.  Both are
    judged on the matrix scaled by its diagonal, because units are mixed.
    """
    for i, name in enumerate(names):
        if not (math.isfinite(matrix[i][i]) and 0.0 <= matrix[i][i] <= LARGEST):
            message = f"got {matrix[i][i]!r}; allowed: a finite number that is at least 0"
            return entry_name(name, name), message
    sizes = [math.sqrt(matrix[i][i]) for i in range(len(names))]
    for i, j in combinations(range(len(names)), 2):
        here, there, bound = matrix[i][j], matrix[j][i], sizes[i] * sizes[j]
        key = entry_name(names[i], names[j])
        if not all(math.isfinite(x) and abs(x) <= LARGEST for x in (here, there)):
            return key, f"got {here if not abs(here) <= LARGEST else there!r}; allowed: a finite number"
        if abs(here - there) > ROUND_OFF * bound and here != there:
            other = entry_name(names[j], names[i])
            return key, f"got {here!r}, and {other} is {there!r}; allowed: a symmetric matrix"
        if abs(here) > bound * (1.0 + ROUND_OFF):
            return key, f"got {here!r}; {_minor_text(names[i], names[j], bound)}"
    return _definite_conflict(matrix, names, sizes)


def _minor_text(one: str, other: str, bound: float) -> str:
    units = " (units?)" if (one in ANGULAR) != (other in ANGULAR) else ""
    ends = f"{entry_name(one, one)} and {entry_name(other, other)}"
    return f"allowed: up to {bound:.6g}, the root of the product of {ends}{units}"


def _definite_conflict(matrix: Rows, names: Sequence[str], sizes: Sequence[float]) -> Conflict | None:
    """Return the message about a direction of negative energy, with its coordinates; None if there is none."""
    import numpy as np

    held = [i for i, size in enumerate(sizes) if size > 0.0]
    if not held:
        return None
    scaled = np.array([[matrix[i][j] / (sizes[i] * sizes[j]) for j in held] for i in held])
    values, vectors = np.linalg.eigh(scaled)
    if values[0] >= -ROUND_OFF * len(held):
        return None
    shares = np.abs(vectors[:, 0])
    direction = [names[i] for i, share in zip(held, shares, strict=True) if share >= _SEEN * shares.max()]
    return "", (
        f"a motion along {', '.join(direction)} together has a negative energy: the matrix, scaled by its diagonal, has"
        f" the eigenvalue {values[0]:.4g}; allowed: a positive semidefinite matrix"
    )
