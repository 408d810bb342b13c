"""Vectors, rotations, poses and pseudo-inertias over any scalar: a float, a SymPy expression, a node of a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Scalar = Any  # float, sympy.Expr or ir.Node
Vec = tuple[Scalar, Scalar, Scalar]
Mat = tuple[Vec, Vec, Vec]

ZERO: Vec = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class PseudoInertia:
    """H = [[J, mc], [mc^T, m]], the integral of r r^T dm with r = (x, y, z, 1).

    ``second`` is the symmetric 3x3 block J (kg m^2), ``first`` the first moment mc (kg m), ``mass`` m (kg).
    """

    second: Mat
    first: Vec
    mass: Scalar

    def __add__(self, other: PseudoInertia) -> PseudoInertia:
        return PseudoInertia(sum_mat(self.second, other.second), add(self.first, other.first), self.mass + other.mass)


@dataclass(frozen=True)
class Pose:
    """A pose: rotation (3x3) and origin (3) of a frame in another."""

    rotation: Mat
    origin: Vec

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(matmul(self.rotation, other.rotation), add(matvec(self.rotation, other.origin), self.origin))


def congruence(pose: Pose, inertia: PseudoInertia) -> PseudoInertia:
    """Return X H X^T: the pseudo-inertia seen from the frame that ``pose`` stands in."""
    R, p, m = pose.rotation, pose.origin, inertia.mass
    h = matvec(R, inertia.first)
    RJ = matmul(R, inertia.second)
    J = matmul(RJ, transpose(R))
    upper = [[J[i][j] + p[i] * h[j] + (h[i] + m * p[i]) * p[j] if j >= i else None for j in range(3)] for i in range(3)]
    second = mat3(tuple(upper[min(i, j)][max(i, j)] for j in range(3)) for i in range(3))
    return PseudoInertia(second, add(h, scale(m, p)), m)


def vec3(items: Any) -> Vec:
    """Return the three items of an iterable."""
    a, b, c = items
    return (a, b, c)


def mat3(rows: Any) -> Mat:
    """Return the three rows of an iterable of iterables."""
    a, b, c = rows
    return (vec3(a), vec3(b), vec3(c))


def add(a: Vec, b: Vec) -> Vec:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vec, b: Vec) -> Vec:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(factor: Scalar, a: Vec) -> Vec:
    """Return factor a."""
    return (factor * a[0], factor * a[1], factor * a[2])


def dot(a: Vec, b: Vec) -> Scalar:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def along(row: Mapping[int, Scalar], x: Sequence[Scalar] | Mapping[int, Scalar]) -> Scalar:
    """Multiply a sparse row by a vector: the sum of its entries times those of x at their indices."""
    total: Scalar = 0.0
    for index, arm in row.items():
        total = total + arm * x[index]
    return total


def cross(a: Vec, b: Vec) -> Vec:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def sum_mat(R: Mat, S: Mat) -> Mat:
    """Return R + S."""
    return (add(R[0], S[0]), add(R[1], S[1]), add(R[2], S[2]))


def trace(S: Mat) -> Scalar:
    """Sum the diagonal."""
    return S[0][0] + S[1][1] + S[2][2]


def about(axis: int, sine: Scalar, cosine: Scalar) -> Mat:
    """Return the rotation matrix about x, y or z."""
    if axis == 0:
        return ((1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine))
    if axis == 1:
        return ((cosine, 0.0, sine), (0.0, 1.0, 0.0), (-sine, 0.0, cosine))
    return ((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0))


def transpose(R: Mat) -> Mat:
    """Return R^T."""
    return mat3(zip(*R, strict=True))


def matvec(R: Mat, a: Vec) -> Vec:
    """Return R a."""
    return (dot(R[0], a), dot(R[1], a), dot(R[2], a))


def matmul(R: Mat, S: Mat) -> Mat:
    """Return R S."""
    columns = transpose(S)
    return mat3(tuple(dot(row, column) for column in columns) for row in R)


def is_zero(x: Scalar) -> bool:
    """Whether a scalar is the plain number zero."""
    return isinstance(x, float) and x == 0.0
