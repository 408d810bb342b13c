"""Links that bend, in the trace form: the pseudo-inertia of the bent body, and what its modes add to eq. (5).

With rho = rho0 + phi_k e_k + 1/2 psi_kl e_k e_l, link axes, and G_k the integral of rho (d rho / d e_k)^T,

    T = 1/2 tr(A' H A'^T) + e'_k tr(A' G_k A^T) + 1/2 m_kl e'_k e'_l,
    G_k = H0_k + e_l ([P_lk; 0] + Q_kl),        H = H00 + e_k (C_k + C_k^T),  C_k half way between H0_k and G_k,

and m_kl = tr P_kl is constant.  As in ``recursion``, R cancels in all traces.

Source: W. J. Book, "Recursive Lagrangian Dynamics of Flexible Manipulator Arms", The International Journal of Robotics
Research 3(3), 1984; his rotations 1 + e_k M_k of what stands on a link are those of eq. (3) here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from eomgen.robot.geometry import IDENTITY
from eomgen.robot.value import LinkModes

from .spatial import (
    ZERO,
    Mat,
    Scalar,
    Vec,
    add,
    cross,
    dot,
    mat3,
    matmul,
    matvec,
    scale,
    subtract,
    sum_mat,
    trace,
    transpose,
    vec3,
)

NONE: Mat = (ZERO, ZERO, ZERO)
AXES = tuple(enumerate("xyz"))
ROUND_OFF = 1e-13  # of modal masses, as a part of those on the diagonal


@dataclass(frozen=True)
class Moment:
    """An integral of rho x^T: ``block`` 3 x 3 of rho's x, y and z, and ``row`` of its 1, so the integral of x."""

    block: Mat
    row: Vec

    def __add__(self, other: Moment) -> Moment:
        return Moment(sum_mat(self.block, other.block), add(self.row, other.row))

    def scaled(self, factor: Scalar) -> Moment:
        """Return the integral times a number."""
        return Moment(mat3(scale(factor, row) for row in self.block), scale(factor, self.row))

    def turned(self, R: Mat) -> Moment:
        """Return the integral in other axes."""
        return Moment(matmul(matmul(R, self.block), transpose(R)), matvec(R, self.row))

    def about(self) -> Vec:
        """Return the integral of rho x x."""
        return antisymmetric(transpose(self.block))


NOTHING = Moment(NONE, ZERO)


def antisymmetric(X: Mat) -> Vec:
    """Return the integral of r x a, of X the integral of a r^T."""
    return (X[2][1] - X[1][2], X[0][2] - X[2][0], X[1][0] - X[0][1])


@dataclass(frozen=True)
class Modal:
    """Constants of a body's modes in its axes: of H0 and Q by modes; ``crossed`` twice phi_l x phi_k; masses.

    ``slopes``: [P_lk; 0] + Q_kl by (k, l); ``squares`` Q_kl, empty where deflections are linear in e.
    """

    first: tuple[Moment, ...]
    slopes: tuple[tuple[Moment, ...], ...]
    squares: tuple[tuple[Moment, ...], ...]
    crossed: tuple[tuple[Vec, ...], ...]
    masses: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Bent:
    """A body that bends, where it is: its modes' indices in q, their constants, G_k."""

    indices: range
    modal: Modal
    G: tuple[Moment, ...]

    def sum(self, x: Sequence[Scalar]) -> Moment:
        """Return sum G_k x_k, of x by all coordinates."""
        total = NOTHING
        for k, G in zip(self.indices, self.G, strict=True):
            total = total + G.scaled(x[k])
        return total

    def acceleration_moment(self, v: Sequence[Scalar], a: Sequence[Scalar]) -> tuple[Vec, Vec]:
        """Return sum G_k e''_k + Q_kl e'_k e'_l: its row, and its integral of rho x x, of all coordinates."""
        row, about = ZERO, ZERO
        for k, G in zip(self.indices, self.G, strict=True):
            row, about = add(row, scale(a[k], G.row)), add(about, scale(a[k], G.about()))
        for k, squares in enumerate(self.modal.squares):
            for j in range(k + 1):
                Q = squares[j].scaled(1.0 if j == k else 2.0)
                both = v[self.indices[j]] * v[self.indices[k]]
                row, about = add(row, scale(both, Q.row)), add(about, scale(both, Q.about()))
        return row, about

    def masses(self) -> Iterator[tuple[int, int, float]]:
        """Yield entries of the modal mass matrix by indices (i, j), i <= j."""
        for k, i in enumerate(self.indices):
            for j in range(k, len(self.indices)):
                yield i, self.indices[j], self.modal.masses[k][j]


def constants_of(link: str, modes: LinkModes, rotation: Mat, named: Callable[[float, str], float]) -> Modal:
    """Return a link's constants in axes in which its own have this rotation, each named by its integral."""
    where = f"links.{link}" + ("" if rotation == IDENTITY else " in axes of its joint")

    def name(number: float, integrand: str) -> float:
        return named(number, f"integral({integrand} dm, {where})")

    def moment(rows: Sequence[Sequence[float]], left: str, right: str) -> Moment:
        raw = Moment(mat3(rows[:3]), vec3(rows[3]) if len(rows) > 3 else ZERO).turned(rotation)
        block = mat3([name(raw.block[i][j], f"{left}{x} {right}.{y}") for j, y in AXES] for i, x in AXES)
        return Moment(block, vec3(name(raw.row[j], f"{right}.{y}") for j, y in AXES))

    m = range(modes.count)
    phi = [f"phi{k + 1}" for k in m]
    P = [[moment(modes.P[k][j], f"{phi[k]}.", phi[j]) for j in m] for k in m]
    Q = modes.Q or ()
    squares = tuple(tuple(moment(x, "", f"psi{k + 1}{j + 1}") for j, x in enumerate(row)) for k, row in enumerate(Q))
    slopes = tuple(tuple(P[j][k] + squares[k][j] if squares else P[j][k] for j in m) for k in m)
    crossed = tuple(tuple(scale(-2.0, antisymmetric(P[j][k].block)) for j in m) for k in m)
    clean = _cleaned(modes.masses)
    masses = tuple(tuple(name(clean[k][j], f"{phi[k]} . {phi[j]}") for j in m) for k in m)
    return Modal(tuple(map(moment, modes.H0, [""] * len(m), phi)), slopes, squares, crossed, masses)


def _cleaned(masses: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], ...]:
    """Return modal masses without what rounding has left of orthogonal modes, and of those whose masses are 1."""
    sizes = [math.sqrt(abs(row[k])) for k, row in enumerate(masses)]

    def entry(k: int, j: int) -> float:
        exact = 1.0 if k == j else 0.0
        return exact if abs(masses[k][j] - exact) <= ROUND_OFF * sizes[k] * sizes[j] else masses[k][j]

    return tuple(tuple(entry(k, j) for j in range(len(row))) for k, row in enumerate(masses))


def modal_wrench(body: Bent, rate: Vec, v: Sequence[Scalar], a: Sequence[Scalar]) -> tuple[Vec, Vec]:
    """Return what moving modes add to the force and the moment that a body takes, at its origin.

    Args:
        rate: the body's angular velocity, in its axes.
        v, a: of all coordinates.
    """
    moving, (force, moment), twice = body.sum(v), body.acceleration_moment(v, a), scale(2.0, rate)
    turning = subtract(scale(trace(moving.block), twice), matvec(transpose(moving.block), twice))
    return add(cross(twice, moving.row), force), add(turning, moment)


def modal_rows(
    body: Bent, rate: Vec, U: Mat, origin: Vec, v: Sequence[Scalar], a: Sequence[Scalar]
) -> dict[int, Scalar]:
    """Return the rows of eq. (5) of a body's modes, by their indices: tr([U a] G_k) and what moving modes add."""
    rows: dict[int, Scalar] = {}
    for k, index in enumerate(body.indices):
        G = body.G[k]
        row = dot(G.row, origin)
        for i in range(3):
            row = row + dot(U[i], transpose(G.block)[i])
        spin = ZERO
        for place, pair in zip(body.indices, body.modal.crossed[k], strict=True):
            spin = add(spin, scale(v[place], pair))
        row = row + dot(rate, spin)
        for place, mass in zip(body.indices, body.modal.masses[k], strict=True):
            row = row + mass * a[place]
        rows[index] = row
    return rows


def modal_energy(body: Bent, rate: Vec, shift: Vec, v: Sequence[Scalar]) -> Scalar:
    """Return what moving modes add to the kinetic energy of a body with these angular and linear velocities."""
    moving = body.sum(v)
    energy = dot(moving.row, shift) + dot(moving.about(), rate)
    for i, j, mass in body.masses():
        energy = energy + ((0.5 if i == j else 1.0) * mass) * (v[i] * v[j])
    return energy
