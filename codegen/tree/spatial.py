"""Vectors, rotations, poses and pseudo-inertias over any scalar: a float, a SymPy expression, a node of a program."""

from __future__ import annotations

import decimal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from eomgen.robot.geometry import IDENTITY, snap

Scalar = Any  # float, sympy.Expr, ir.Node or, in an ExactPose, Decimal
Vec = tuple[Scalar, Scalar, Scalar]
Mat = tuple[Vec, Vec, Vec]

ZERO: Vec = (0.0, 0.0, 0.0)
_PRECISION = decimal.Context(prec=60)
_UNIT_ROUND_OFF = 2.0**-53  # largest relative error of a decimal number as a float


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

    def exact(self) -> Pose:
        """Return the pose as the first factor of an exact product, if all its entries are numbers; otherwise itself."""
        if not _has_numbers(self):
            return self
        return ExactPose(*_to_decimals(self), vec3(map(abs, self.origin)))

    def rounded(self) -> Pose:
        """Return the pose with floats where it is an exact product; otherwise itself."""
        return self


@dataclass(frozen=True)
class ExactPose(Pose):
    """A product of poses, computed with 60 digits: origins of frames that are far from masses cancel in it.

    ``size`` holds the sums of the magnitudes of the terms of each component of the origin, m.
    """

    size: Vec

    def __matmul__(self, other: Pose) -> Pose:
        if not _has_numbers(other):
            return self.rounded() @ other
        with decimal.localcontext(_PRECISION):
            product = super().__matmul__(Pose(*_to_decimals(other)))
        terms = matvec(mat3(vec3(abs(float(x)) for x in row) for row in self.rotation), vec3(map(abs, other.origin)))
        return ExactPose(product.rotation, product.origin, add(self.size, terms))

    def split(self, axes: Sequence[int]) -> tuple[ExactPose, ExactPose]:
        """Return a pose and a translation along these of its axes whose product is this one, nearest to the origin."""
        with decimal.localcontext(_PRECISION):
            by, origin = scale(decimal.Decimal(0), self.origin), self.origin
            for _ in range(4):  # as the transpose is the inverse to 16 digits
                whole = matvec(transpose(self.rotation), origin)
                by = vec3(x + whole[i] if i in axes else x for i, x in enumerate(by))
                origin = subtract(self.origin, matvec(self.rotation, by))
        sizes = vec3(abs(float(x)) for x in by)
        terms = matvec(mat3(vec3(abs(float(x)) for x in row) for row in self.rotation), sizes)
        translation = ExactPose(_to_decimals(Pose(IDENTITY, ZERO))[0], by, sizes)
        return ExactPose(self.rotation, origin, add(self.size, terms)), translation

    def rounded(self) -> Pose:
        """Round every entry once; right angles are exact, and origins 0 where only the numbers' rounding is left."""
        rotation = mat3(vec3(snap(float(x)) for x in row) for row in self.rotation)
        origin = ((float(x), _UNIT_ROUND_OFF * size) for x, size in zip(self.origin, self.size, strict=True))
        return Pose(rotation, vec3(x if abs(x) > least else 0.0 for x, least in origin))


def _has_numbers(pose: Pose) -> bool:
    return all(isinstance(x, int | float) for row in (*pose.rotation, pose.origin) for x in row)


def _to_decimals(pose: Pose) -> tuple[Mat, Vec]:
    rotation, origin = pose.rotation, pose.origin
    return mat3(vec3(map(decimal.Decimal, row)) for row in rotation), vec3(map(decimal.Decimal, origin))


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


def add_row(row: dict[int, Scalar], factor: Scalar, other: Mapping[int, Scalar]) -> None:
    """Add a sparse row times a factor to another one."""
    for index, arm in other.items():
        row[index] = row.get(index, 0.0) + factor * arm


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
