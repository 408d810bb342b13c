"""A link that bends in SymPy: its energy, wrench and modal rows out of the trace form, and proofs of what vanishes.

A particle stands at rho = rho0 + phi_k e_k + 1/2 psi_kl e_k e_l in the link's frame, rho0 = (x, y, z, 1), with modal
coordinates e and sums over repeated indices.  Its velocity in the link's axes is W rho + rho', with A' = A W and
W = [[skew(w), v], [0, 0]], since the link's rotation cancels inside the trace.  Energies are taken to the second degree
in e and e' together, as H(e) is: so no term has three modes in it, and what holds for two modes holds for all.

Source: W. J. Book, "Recursive Lagrangian Dynamics of Flexible Manipulator Arms", The International Journal of Robotics
Research 3(3), 1984, for the expansion; his small rotations of the link are left out: its frame moves rigidly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

import sympy as sp

from eomgen.codegen.joint.lemmas import step
from eomgen.errors import InternalError
from eomgen.robot.value import LINEAR

Matrix = Any  # sympy.ImmutableMatrix: SymPy's matrices carry no usable types

MODES = range(2)
e, e_dot, e_ddot = ([sp.Symbol(f"e{k + 1}{dots}", real=True) for k in MODES] for dots in ("", "_dot", "_ddot"))
w, v, w_dot, v_dot = (sp.Matrix(sp.symbols([f"{name}{axis}" for axis in "xyz"], real=True)) for name in "wvbd")
ex, ey, ez = (sp.Matrix(sp.eye(3)[:, axis]) for axis in range(3))


@dataclass(frozen=True)
class Constants:
    """Integrals over a link with two modes.

    H00: of rho0 rho0^T, 4x4.  H0: by mode, of rho0 phi_k^T, 4x3.  P: by modes k and l, of phi_k phi_l^T, 3x3.  Q: of
    rho0 psi_kl^T, 4x3, symmetric in k and l.
    """

    H00: Matrix
    H0: Sequence[Matrix]
    P: Sequence[Sequence[Matrix]]
    Q: Sequence[Sequence[Matrix]]

    def mass(self, k: int, l: int) -> Any:  # noqa: E741  (the index of eq. (10) with modes)
        """Return m_kl = tr P_kl of the modal mass matrix."""
        return self.P[k][l].trace()

    def slope(self, k: int) -> Matrix:
        """Return G_k = H0k + e_l ([P_lk; 0] + Q_kl), the integral of rho (drho/de_k)^T, 4x3."""
        return self.H0[k] + sum((e[j] * self._second(j, k) for j in MODES), sp.zeros(4, 3))

    def inertia(self) -> Matrix:
        """Return H = H00 + e_k (C_k + C_k^T) with C_k = H0k + 1/2 e_l ([P_lk; 0] + Q_kl), the integral of rho rho^T."""
        half = [(self.H0[k] + self.slope(k)) / 2 for k in MODES]
        wide = [C.row_join(sp.zeros(4, 1)) for C in half]
        return self.H00 + sum((e[k] * (wide[k] + wide[k].T) for k in MODES), sp.zeros(4, 4))

    def without_stiffening(self) -> Constants:
        """Return the constants without Q: deflections that are linear in e."""
        return replace(self, Q=[[sp.zeros(4, 3)] * len(MODES)] * len(MODES))

    def _second(self, j: int, k: int) -> Matrix:
        return self.P[j][k].col_join(sp.zeros(1, 3)) + self.Q[j][k]


@dataclass(frozen=True)
class Equations:
    """Forces that a link needs to move: a force and a moment about its origin, in its axes, and its modes' rows."""

    force: Matrix
    moment: Matrix
    rows: Sequence[Any]


@dataclass(frozen=True)
class Particle:
    """A particle of unit mass: rho0 without its last entry, phi by mode and psi by two modes, 3 numbers each."""

    place: Matrix
    phi: Sequence[Matrix]
    psi: Sequence[Sequence[Matrix]]

    def constants(self) -> Constants:
        """Return what the particle adds to the integrals."""
        rho0 = self.place.col_join(sp.ones(1, 1))
        return Constants(
            rho0 * rho0.T,
            [rho0 * phi.T for phi in self.phi],
            [[one * other.T for other in self.phi] for one in self.phi],
            [[rho0 * psi.T for psi in row] for row in self.psi],
        )

    def bent(self) -> Matrix:
        """Return rho without its last entry."""
        second = _sum(self.psi[k][j] * e[k] * e[j] / 2 for k, j in product(MODES, repeat=2))
        return self.place + _sum(self.phi[k] * e[k] for k in MODES) + second

    def energy(self) -> Any:
        """Return 1/2 |W rho + rho'|^2 to the second degree in e and e'."""
        linear = _sum(self.phi[k] * e[k] for k in MODES), _sum(self.phi[k] * e_dot[k] for k in MODES)
        pairs = list(product(MODES, repeat=2))
        square = (
            _sum(self.psi[k][j] * e[k] * e[j] / 2 for k, j in pairs),
            _sum(self.psi[k][j] * e[k] * e_dot[j] for k, j in pairs),
        )
        by_degree = [v + w.cross(self.place), *(w.cross(at) + rate for at, rate in (linear, square))]
        zeroth, first, second = by_degree
        return zeroth.dot(zeroth) / 2 + zeroth.dot(first) + first.dot(first) / 2 + zeroth.dot(second)


@cache
def generic() -> Constants:
    """Return constants of which nothing is assumed but their symmetries: P_lk = P_kl^T, Q_lk = Q_kl."""
    H00 = sp.ImmutableMatrix(4, 4, lambda i, j: sp.Symbol(f"h{min(i, j)}{max(i, j)}"))
    H0 = [_matrix(f"h{k}_", 4, 3) for k in MODES]
    square = sp.ImmutableMatrix(3, 3, lambda i, j: sp.Symbol(f"p00_{min(i, j)}{max(i, j)}"))
    other, mixed = square.subs({s: sp.Symbol(s.name.replace("p00", "p11")) for s in square}), _matrix("p01_", 3, 3)
    Q = [_matrix(f"q{name}_", 4, 3) for name in ("00", "01", "11")]
    return Constants(H00, H0, [[square, mixed], [mixed.T, other]], [[Q[0], Q[1]], [Q[1], Q[2]]])


def kinetic_energy(constants: Constants) -> Any:
    """Return 1/2 tr(A' H A'^T) + e'_k tr(A' G_k A^T) + 1/2 m_kl e'_k e'_l, with A' = A W."""
    W = _skew(w).row_join(v)
    rates = sum(e_dot[k] * (W * constants.slope(k)).trace() for k in MODES)
    own = sum(constants.mass(k, j) * e_dot[k] * e_dot[j] for k, j in product(MODES, repeat=2))
    return (W * constants.inertia() * W.T).trace() / 2 + rates + own / 2


def equations(T: Any) -> Equations:
    """Derive a link's equations from its kinetic energy: by eq. (5) for e, by its form in moving axes for w and v.

    The latter: force = d/dt T_v + w x T_v, moment = d/dt T_w + w x T_w + v x T_v (G. Hamel 1904; G. Kirchhoff 1876).
    """
    linear, angular = _gradient(T, v), _gradient(T, w)
    return Equations(
        linear.applyfunc(_rate) + w.cross(linear),
        angular.applyfunc(_rate) + w.cross(angular) + v.cross(linear),
        [_rate(T.diff(e_dot[k])) - T.diff(e[k]) for k in MODES],
    )


def recursion(constants: Constants) -> Equations:
    """Write the equations as the recursion computes them, with U = skew(w') + skew(w)^2 and a = v' + w x v:

    f = m a + U c + 2 w x e'_k g_k + e''_k g_k + e'_k e'_l q_kl,
    n = axial(U J) + c x a + 2 (tr S 1 - S^T) w + axial(e''_k N_k^T + e'_k e'_l Q3_kl^T),
    r_k = tr([U a] G_k) + 2 w . e'_l int(phi_l x phi_k) + m_kl e''_l,

    g_k and N_k the last row and the rest of G_k, q_kl and Q3_kl of Q_kl, and S = e'_k N_k.
    """
    H, U, a = constants.inertia(), _skew(w_dot) + _skew(w) ** 2, v_dot + w.cross(v)
    J, c, m = H[:3, :3], H[:3, 3], H[3, 3]
    N, g = zip(*(_parts(constants.slope(k)) for k in MODES), strict=True)
    Q3, q = zip(*(_parts(constants.Q[k][j]) for k, j in product(MODES, repeat=2)), strict=True)
    squares = [e_dot[k] * e_dot[j] for k, j in product(MODES, repeat=2)]
    S = _sum(rate * block for rate, block in zip(e_dot, N, strict=True))
    shaken = _sum(rate * row for rate, row in zip([*e_ddot, *squares], [*g, *q], strict=True))
    turned = _sum(rate * block.T for rate, block in zip([*e_ddot, *squares], [*N, *Q3], strict=True))
    force = m * a + U * c + 2 * w.cross(_sum(rate * row for rate, row in zip(e_dot, g, strict=True))) + shaken
    moment = axial(U * J) + c.cross(a) + 2 * (S.trace() * sp.eye(3) - S.T) * w + axial(turned)
    rows = [
        (U.row_join(a) * constants.slope(k)).trace()
        + 2 * sum(e_dot[j] * w.dot(axial(constants.P[k][j])) for j in MODES)
        + sum(constants.mass(k, j) * e_ddot[j] for j in MODES)
        for k in MODES
    ]
    return Equations(force, moment, rows)


def axial(X: Matrix) -> Matrix:
    """Return (X32 - X23, X13 - X31, X21 - X12): r x s of X = s r^T."""
    return sp.Matrix([X[2, 1] - X[1, 2], X[0, 2] - X[2, 0], X[1, 0] - X[0, 1]])


@cache
def prove_trace_form() -> None:
    """Prove that a particle's energy is that of the trace form; so is the integral's, which is linear in them."""
    names = ("f0", "f1"), (("s00", "s01"), ("s01", "s11"))
    place, phi = _vector("r"), [_vector(name) for name in names[0]]
    particle = Particle(place, phi, [[_vector(name) for name in row] for row in names[1]])
    _prove([particle.energy() - kinetic_energy(particle.constants())], "T of a link that bends")


@cache
def prove_recursion() -> None:
    """Prove that f, n and r_k of the recursion are those that eq. (5) makes of the energy."""
    derived, written = equations(kinetic_energy(generic())), recursion(generic())
    _prove(derived.force - written.force, "force on a link that bends")
    _prove(derived.moment - written.moment, "moment on a link that bends")
    _prove([one - other for one, other in zip(derived.rows, written.rows, strict=True)], "rows of modes")


@cache
def prove_modal_mass_constant() -> None:
    """Prove that m_kl depends on no coordinate, so that a mode's row has no term e' e', with Q or without."""
    written = recursion(generic())
    for k, j, i in product(MODES, repeat=3):
        entry = written.rows[k].diff(e_ddot[j])
        _prove([entry - generic().mass(k, j)], "modal masses")
        _prove([written.rows[k].diff(e_dot[j], e_dot[i])], "no terms e' e' in rows of modes")


@cache
def prove_lemma_7_for_modes() -> None:
    """Prove that a link's own terms e'_k e'_l vanish without Q: d2rho/de_k de_l = psi_kl, as of two translations."""
    written = recursion(generic().without_stiffening())
    for k, j in product(MODES, repeat=2):
        for part in (written.force, written.moment):
            _prove(part.diff(e_dot[k], e_dot[j]), "lemma (7) for modes")


@cache
def prove_sharper_lemma_for_modes() -> None:
    """Prove d2X/dx de_k = 0 for a translation x of a joint at or in front of a link: [0 ¦ e_x] rho = e_x for any e."""
    particle = Particle(_vector("r"), [_vector("f0"), _vector("f1")], [[_vector("s")] * len(MODES)] * len(MODES))
    rho = particle.bent().col_join(sp.ones(1, 1))
    for name in LINEAR:
        _prove(step(name).generator * rho - step(name).generator[:, 3], "sharper lemma for modes")


@cache
def prove_own_rate() -> None:
    """Prove C_k,jk = 0 for a mode k and any coordinate j in front of it: e'_k is in no velocity term of its own row."""
    for k, coordinate in product(MODES, [*w, *v]):
        _prove([recursion(generic()).rows[k].expand().diff(e_dot[k], coordinate)], "a mode's own rate")


@cache
def prove_mean_axes() -> None:
    """Prove that free-free modes about mean axes, n_k = 0 and axial N_k = 0, do not couple with the frame at e = 0.

    Without Q they never move the centre of mass.
    """
    constants = generic()
    symmetric = [block.col_join(sp.zeros(1, 3)) for block in (_symmetrized(H0[:3, :]) for H0 in constants.H0)]
    written = recursion(replace(constants, H0=symmetric))
    home = dict.fromkeys(e, 0)
    for k in MODES:
        _prove(written.force.diff(e_ddot[k]).subs(home), "mean axes: forces")
        _prove(written.moment.diff(e_ddot[k]).subs(home), "mean axes: moments")
    still = recursion(replace(constants, H0=symmetric).without_stiffening())
    for coordinate in (*e, *e_dot, *e_ddot):
        _prove(still.force.diff(coordinate), "mean axes: the centre of mass stays")


@cache
def beam_constants(*kinds: str) -> Constants:
    """Return constants of a straight beam along x, a part of each kind's mode: "y", "z", "torsion" or "axial".

    A particle (x, y, z) of a section that is even in y and in z moves by v ey - y v' ex in the plane y, w ez - z w' ex
    in the plane z, t (y ez - z ey) in torsion and u ex along the axis, v to u and the slopes v', w' functions of x; the
    second order of two bending modes is along -ex.  Integrals of what is odd in y or z vanish.
    """
    x, y, z = sp.symbols("x y z", real=True)
    phi = [_shape(kind, f"_{number}", y, z) for number, kind in enumerate(kinds)]
    bends = [kind in "yz" for kind in kinds]
    psi = [
        [-sp.Symbol(f"s_{min(k, j)}{max(k, j)}") * int(bends[k] and kinds[k] == kinds[j]) * ex for j in MODES]
        for k in MODES
    ]
    one = Particle(sp.Matrix([x, y, z]), phi, psi).constants()

    def over_section(X: Matrix) -> Matrix:
        return X.applyfunc(lambda entry: _even(entry, y, z))

    return Constants(
        over_section(one.H00),
        [over_section(X) for X in one.H0],
        [[over_section(X) for X in row] for row in one.P],
        [[over_section(X) for X in row] for row in one.Q],
    )


@cache
def prove_plane_bending() -> None:
    """Prove what bending in one plane leaves: one entry of n_k, one of axial N_k, a diagonal P_kl, no Coriolis force.

    On a line, without the section's own turning, N_k has one entry and P_kl = m_kl ey ey^T.
    """
    for kind, across, about in (("y", 1, 2), ("z", 2, 1)):
        constants = beam_constants(kind, kind)
        for k in MODES:
            N, g = _parts(constants.H0[k])
            _prove(_but(g, across), "one entry of n_k")
            _prove(_but(axial(N), about), "one entry of axial N_k")
            line = {name: 0 for name in N.free_symbols if name.name in "yz"}
            _prove(_but(N.subs(line), across), "one entry of N_k on a line")
        for k, j in product(MODES, repeat=2):
            _prove(constants.P[k][j] - sp.diag(*constants.P[k][j].diagonal()), "P_kl is diagonal")
            _prove(axial(constants.P[k][j]), "no Coriolis force between modes of one plane")
            Q3, q = _parts(constants.Q[k][j])
            _prove([*_but(Q3, 0), *Q3[1:, 0], *_but(q, 0)], "Q_kl is along the beam")


@cache
def prove_kinds_of_beams_apart() -> tuple[tuple[str, str], ...]:
    """Prove m_kl = 0 between two kinds of a beam's modes; return pairs that have no Coriolis force either."""
    apart = []
    for one, other in ((a, b) for a, b in product(KINDS, repeat=2) if KINDS.index(a) < KINDS.index(b)):
        constants = beam_constants(one, other)
        _prove([constants.mass(0, 1)], f"m_kl of {one} and {other}")
        if axial(constants.P[0][1]).is_zero_matrix:
            apart.append((one, other))
    return tuple(apart)


KINDS = ("y", "z", "torsion", "axial")


def proofs() -> Iterator[str]:
    """Run every proof and name it; InternalError if one fails."""
    prove_trace_form()
    yield "T = 1/2 tr(A' H A'^T) + e'_k tr(A' G_k A^T) + 1/2 m_kl e'_k e'_l"
    prove_recursion()
    yield "f, n and r_k are those of eq. (5)"
    prove_modal_mass_constant()
    yield "m_kl is constant: no terms e' e' in rows of modes"
    prove_lemma_7_for_modes()
    yield "lemma (7) for modes: without Q no own terms e' e' in f and n"
    prove_sharper_lemma_for_modes()
    yield "sharper lemma for modes: no mode turns a translation at or in front of its link"
    prove_own_rate()
    yield "C_k,jk = 0 for a mode k and j in front of it"
    prove_mean_axes()
    yield "mean axes: no coupling with the frame at e = 0"
    prove_plane_bending()
    yield "bending in a plane: one entry of n_k and of axial N_k, P_kl diagonal, no Coriolis force"
    apart = ", ".join(f"{one} and {other}" for one, other in prove_kinds_of_beams_apart())
    yield f"modes of two kinds of a beam: m_kl = 0; no Coriolis force between {apart}"


def _shape(kind: str, number: str, y: Any, z: Any) -> Matrix:
    """Return phi of one kind of a beam's modes."""
    value, slope = sp.symbols(f"v{number} g{number}", real=True)
    if kind in "yz":
        across, direction = (y, ey) if kind == "y" else (z, ez)
        return value * direction - across * slope * ex
    return value * (y * ez - z * ey) if kind == "torsion" else value * ex


def _even(expression: Any, *variables: Any) -> Any:
    """Return the part of a polynomial that is even in each of the variables."""
    for variable in variables:
        expression = (expression + expression.subs(variable, -variable)).expand() / 2
    return expression


def _parts(block: Matrix) -> tuple[Matrix, Matrix]:
    """Split a 4x3 block: its upper 3x3 part, and its last row as a column."""
    return block[:3, :], block[3, :].T


def _but(X: Matrix, entry: int) -> list[Any]:
    """Return the entries of a vector but for one, or those of a matrix but for its column."""
    return (
        [x for row in X.tolist() for j, x in enumerate(row) if j != entry]
        if X.shape[1] > 1
        else [x for i, x in enumerate(X) if i != entry]
    )


def _symmetrized(X: Matrix) -> Matrix:
    return sp.ImmutableMatrix(3, 3, lambda i, j: X[min(i, j), max(i, j)])


def _gradient(T: Any, by: Matrix) -> Matrix:
    return sp.Matrix([T.diff(x) for x in by])


def _rate(expression: Any) -> Any:
    """Differentiate by time: e to e', e' to e'', v and w to their rates."""
    pairs = [*zip([*e, *e_dot, *w, *v], [*e_dot, *e_ddot, *w_dot, *v_dot], strict=True)]
    return sum(expression.diff(x) * x_dot for x, x_dot in pairs)


def _vector(name: str) -> Matrix:
    return sp.Matrix(sp.symbols([f"{name}{axis}" for axis in "xyz"]))


def _matrix(name: str, rows: int, columns: int) -> Matrix:
    return sp.ImmutableMatrix(rows, columns, lambda i, j: sp.Symbol(f"{name}{i}{j}"))


def _skew(a: Matrix) -> Matrix:
    return sp.ImmutableMatrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def _sum(terms: Any) -> Matrix:
    first, *others = terms
    return sum(others, first)


def _prove(residue: Any, claim: str) -> None:
    if any(sp.expand(entry) != 0 for entry in residue):
        raise InternalError(f"the proof failed: {claim}")
