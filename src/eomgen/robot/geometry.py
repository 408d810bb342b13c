"""Poses, vectors, rotation matrices and inertia tensors of a description as floats; right angles stay exact.

``JointFacts`` are the results of the symbolic derivation of a joint's transform, as plain values.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from typing import Any, NamedTuple

from ..identifiers import check_kind
from ..limits import LARGEST

LINEAR = ("x", "y", "z")
ANGULAR = ("alpha", "beta", "gamma")
COORDINATES = LINEAR + ANGULAR  # of a frame as seen from another: T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma), eq. (3)

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]  # rows

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ZERO: Vector = (0.0, 0.0, 0.0)

# Columns are the joint's x, y and z axes; for the axes along +-x, +-y and +-z only 0 and +-1 appear.
_TURNS: dict[Vector, Matrix] = {
    (0.0, 0.0, 1.0): IDENTITY,
    (1.0, 0.0, 0.0): ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    (0.0, 1.0, 0.0): ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    (0.0, 0.0, -1.0): ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    (-1.0, 0.0, 0.0): ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    (0.0, -1.0, 0.0): ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
}


RIGHT = 4e-16  # round-off of sines and cosines of right angles


def snap(value: float) -> float:
    """Return the value; a sine or cosine that misses -1, 0 or 1 by less than 4e-16 becomes exact."""
    check_kind("value", value, isinstance(value, Real), "a number")
    for exact in (-1.0, 0.0, 1.0):
        if abs(value - exact) < RIGHT:
            return exact
    return value


def rotation_from_rpy(rpy: Vector) -> Matrix:
    """Return the rotation matrix Rz(yaw) Ry(pitch) Rx(roll) of URDF's roll, pitch, yaw, rad."""
    allowed = f"three numbers of magnitude up to {LARGEST:g}, rad"
    three = hasattr(rpy, "__len__") and len(rpy) == 3 and all(isinstance(x, Real) and abs(x) <= LARGEST for x in rpy)
    check_kind("rpy", rpy, three, allowed)
    (cr, sr), (cp, sp), (cy, sy) = ((snap(math.cos(t)), snap(math.sin(t))) for t in rpy)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def axis_turn(axis: Vector) -> Matrix:
    """Return a rotation whose third column is the direction of ``axis``, with as many entries 0, 1, -1 as possible."""
    length = math.hypot(*axis)
    x, y, z = (snap(component / length) + 0.0 for component in axis)
    if (x, y, z) in _TURNS:
        return _TURNS[x, y, z]
    if z == 0.0:  # z itself is orthogonal to the axis
        first = (0.0, 0.0, 1.0)
    elif y == 0.0:
        first = (0.0, 1.0, 0.0)
    elif x == 0.0:
        first = (1.0, 0.0, 0.0)
    else:
        side = math.hypot(x, y)
        first = (-y / side, x / side, 0.0)
    second = (y * first[2] - z * first[1], z * first[0] - x * first[2], x * first[1] - y * first[0])
    return ((first[0], second[0], x), (first[1], second[1], y), (first[2], second[2], z))


def turn_inertia(
    inertia: tuple[float, float, float, float, float, float], rotation: Matrix
) -> tuple[float, float, float, float, float, float]:
    """Rotate an inertia tensor, R I R^T (INERTIA_KEYS order): from a placed frame's axes to those it is placed in."""
    if rotation == IDENTITY:
        return inertia
    xx, yy, zz, xy, xz, yz = inertia
    tensor = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))

    def entry(i: int, j: int) -> float:
        return sum(rotation[i][k] * tensor[k][m] * rotation[j][m] for k in range(3) for m in range(3))

    return entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)


@dataclass(frozen=True)
class Placement:
    """A constant pose: origin ``xyz`` (m) and ``rotation`` (3x3, axes of the placed frame as columns).

    ``rpy`` (rad) is kept where the description has it, so that it can be a run-time parameter.
    """

    xyz: Vector = ZERO
    rotation: Matrix = IDENTITY
    rpy: Vector | None = None

    @classmethod
    def from_rpy(cls, xyz: Vector, rpy: Vector) -> Placement:
        """Return the pose of a URDF origin: translation, then Rz(yaw) Ry(pitch) Rx(roll)."""
        return cls(xyz, rotation_from_rpy(rpy), rpy)

    @classmethod
    def from_dh(cls, a: float, alpha: float, d: float, theta: float) -> Placement:
        """Return the pose of modified Denavit-Hartenberg parameters: Rx(alpha) Tx(a) Rz(theta) Tz(d); m, rad."""
        ca, sa, ct, st = (snap(t) for t in (math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)))
        rotation = ((ct, -st, 0.0), (ca * st, ca * ct, -sa), (sa * st, sa * ct, ca))
        return cls((a, -sa * d, ca * d), rotation)

    def numbers(self) -> Iterator[tuple[str, float]]:
        """Yield the numbers that may be run-time parameters, by their names: "xyz.0"; rpy where it is known."""
        yield from ((f"xyz.{i}", x) for i, x in enumerate(self.xyz))
        yield from ((f"rpy.{i}", x) for i, x in enumerate(self.rpy or ()))


class JointStep(NamedTuple):
    """An elementary transform of eq. (3), along or about ``axis``; rotation[i][j] = (1, sine, cosine) factors."""

    is_rotation: bool
    axis: int
    rotation: tuple[tuple[tuple[float, float, float], ...], ...]


Term = tuple[int, tuple[tuple[str, str], ...]]  # a coefficient, and factors ("sin", "gamma") or ("", "x")
Entries = tuple[tuple[tuple[Term, ...], ...], ...]  # rows of a 4x4 matrix, each entry a sum of terms


@dataclass(frozen=True)
class JointFacts:
    """Transform of a joint by eq. (3), its derivatives, and identities that are proved of them.

    Attributes:
        active: the joint's active coordinates, in canonical order.
        sympy: version of SymPy that derived the facts.
        steps: elementary transform per active coordinate.
        transform: A_(i-1)i.
        first: dA_(i-1)i/ds per active coordinate.
        second: d2A_(i-1)i/ds dw per pair of ``combinations_with_replacement(active, 2)``.
        zero_pairs: pairs of them whose second derivative vanishes.
        constant: coordinates s with dA_(i-1)i/ds N = dA_(i-1)i/ds for every downstream transform N.
        orthogonal: pairs of translations with orthogonal derivatives.
        coaxial: pairs of a translation and a rotation about the same axis that do not act on each other.
    """

    active: tuple[str, ...]
    sympy: str
    steps: tuple[JointStep, ...]
    transform: Entries
    first: tuple[Entries, ...]
    second: tuple[Entries, ...]
    zero_pairs: tuple[tuple[str, str], ...]
    constant: tuple[str, ...]
    orthogonal: tuple[tuple[str, str], ...]
    coaxial: tuple[tuple[str, str], ...]

    def to_json(self) -> str:
        """Write the facts as JSON."""
        return json.dumps(vars(self))

    @classmethod
    def from_json(cls, text: str | bytes) -> JointFacts:
        """Read what ``to_json`` wrote."""
        values = {name: _tuples(value) for name, value in json.loads(text).items()}
        return cls(**{**values, "steps": tuple(JointStep(*step) for step in values["steps"])})


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
