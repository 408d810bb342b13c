"""Articulated inertias: how a body with all that hangs on it answers an acceleration, and the algebra of its blocks."""

from __future__ import annotations

from dataclasses import dataclass

from ..tree.composite import rotated_block
from ..tree.frozen_joints import JointGeometry, Rotation, unit
from ..tree.recursion import Wrench, rotational_inertia
from ..tree.spatial import (
    ZERO,
    Mat,
    PseudoInertia,
    Scalar,
    Vec,
    add,
    cross,
    mat3,
    matmul,
    matvec,
    scale,
    sum_mat,
    transpose,
    vec3,
)

NOTHING: Mat = (ZERO, ZERO, ZERO)


@dataclass(frozen=True)
class Articulated:
    """Articulated inertia: blocks L, C, A, and the wrench p at zero acceleration, all at one frame."""

    L: Mat
    C: Mat
    A: Mat
    p: Wrench

    def __add__(self, other: Articulated) -> Articulated:
        L, C, A = sum_mat(self.L, other.L), sum_mat(self.C, other.C), sum_mat(self.A, other.A)
        return Articulated(L, C, A, self.p + other.p)

    def answer(self, a: Vec, d: Vec) -> Wrench:
        """Return the wrench at accelerations (a, d)."""
        force = add(add(matvec(self.L, a), matvec(self.C, d)), self.p.force)
        return Wrench(force, add(add(matvec(transpose(self.C), a), matvec(self.A, d)), self.p.moment))


def inertia_tensor(J: Mat) -> Mat:
    """Return I = tr(J) 1 - J."""
    return mat3(rotational_inertia(PseudoInertia(J, ZERO, 0.0), unit(axis)) for axis in range(3))


def gyroscopic_moment(J: Mat, w: Vec) -> Vec:
    """Return w x I w, the antisymmetric block of skew(w)^2 J: 12 products."""
    x, y, z = w
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return (
        (J[1][1] - J[2][2]) * yz + J[1][2] * (zz - yy) + J[0][1] * xz - J[0][2] * xy,
        (J[2][2] - J[0][0]) * xz + J[0][2] * (xx - zz) + J[1][2] * xy - J[0][1] * yz,
        (J[0][0] - J[1][1]) * xy + J[0][1] * (yy - xx) + J[0][2] * yz - J[1][2] * xz,
    )


def inverse_or_zero(pivot: Scalar) -> Scalar:
    """Return 1 / pivot; 0 for a pivot that is a plain zero, which the kernel reports when it runs."""
    return 0.0 if isinstance(pivot, float) and pivot <= 0.0 else 1.0 / pivot


def inverse3(S: Mat) -> tuple[Mat, Scalar]:
    """Invert a symmetric matrix by cofactors; return the inverse and its determinant."""
    (a, b, c), (_, d, e), (_, _, f) = S
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * A + b * B + c * C
    r = inverse_or_zero(determinant)
    A, B, C, D, E, F = (r * x for x in (A, B, C, D, E, F))
    return ((A, B, C), (B, D, E), (C, E, F)), determinant


def diagonal_product(S: Mat) -> Scalar:
    """Multiply the diagonal: at least the determinant of a positive matrix, which is compared to it."""
    return S[0][0] * S[1][1] * S[2][2]


def diagonal(x: Vec) -> Mat:
    """Return the matrix with x on its diagonal."""
    return ((x[0], 0.0, 0.0), (0.0, x[1], 0.0), (0.0, 0.0, x[2]))


def rows_scaled(x: Vec, S: Mat) -> Mat:
    """Return diag(x) S."""
    return (scale(x[0], S[0]), scale(x[1], S[1]), scale(x[2], S[2]))


def symmetric(S: Mat) -> Mat:
    """Mirror the upper half of a matrix that is symmetric but for round-off."""
    return (S[0], (S[0][1], S[1][1], S[1][2]), (S[0][2], S[1][2], S[2][2]))


def less(S: Mat, x: Vec, y: Vec) -> Mat:
    """Return S - x y^T."""
    return mat3(add(S[i], scale(-1.0 * x[i], y)) for i in range(3))


def with_row(inertia: Articulated, row: int, entries: Wrench, held: Scalar) -> Articulated:
    """Replace the row and column of unit axis ``row`` (0-2 force, 3-5 moment), and the wrench along it."""
    axis, force, moment = row % 3, list(inertia.p.force), list(inertia.p.moment)
    L, C, A = ([list(line) for line in block] for block in (inertia.L, inertia.C, inertia.A))
    if row < 3:
        force[axis] = held
        L[axis], C[axis] = list(entries.force), list(entries.moment)
        for i in range(3):
            L[i][axis] = entries.force[i]
    else:
        moment[axis] = held
        A[axis] = list(entries.moment)
        for i in range(3):
            A[i][axis], C[i][axis] = entries.moment[i], entries.force[i]
    return Articulated(mat3(L), mat3(C), mat3(A), Wrench(vec3(force), vec3(moment)))


def turned(turn: Rotation, inertia: Articulated) -> Articulated:
    """Turn articulated inertia and force from the axes behind a rotation to those in front of it."""
    L, C, A = (rotated_block(turn, block) for block in (inertia.L, inertia.C, inertia.A))
    return Articulated(L, C, A, inertia.p.turned(turn.matrix))


def to_parent(inertia: Articulated, joint: JointGeometry) -> Articulated:
    """Shift articulated inertia and force to the parent's origin: C - L P, A - C^T P + P C', P = skew(offset)."""
    R, back = joint.turn, transpose(joint.turn)
    L, C, A = (matmul(matmul(R, block), back) for block in (inertia.L, inertia.C, inertia.A))
    force, moment = matvec(R, inertia.p.force), matvec(R, inertia.p.moment)
    p = joint.offset
    L, A = symmetric(L), symmetric(A)
    moved = mat3(add(C[i], scale(-1.0, cross(L[i], p))) for i in range(3))
    Ct = transpose(C)
    first = mat3(add(A[i], scale(-1.0, cross(Ct[i], p))) for i in range(3))
    second = transpose(mat3(cross(p, column) for column in transpose(moved)))
    return Articulated(L, moved, symmetric(sum_mat(first, second)), Wrench(force, add(moment, cross(p, force))))
