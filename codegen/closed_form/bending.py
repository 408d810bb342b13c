"""Links that bend in closed form: poses by coordinates that lead, pseudo-inertias and moments of modes, in SymPy.

Nodes follow modes: their coordinates are written as what these make of them, so that all is by the coordinates of the
described robot.  M is eq. (11) with two more traces, and C its Christoffel symbols, which eq. (12) is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import sympy as sp

from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.value import LinkModes

from ..joint.lemmas import Matrix, joint_transform, step
from ..tree.bound import Bound

Expr = Any  # sympy.Expr
Value = Callable[[str, float], Expr]  # gives an expression for a named number
AXES = "xyz"


def exact(number: Any) -> Expr:
    """Make floats that are small multiples of 1/2 exact in a number or expression: they prune, and read better."""
    expression = sp.sympify(number)
    small = {f: sp.Rational(float(f)) for f in expression.atoms(sp.Float) if float(2 * f) in range(-4, 5)}
    return expression.xreplace(small)


@dataclass(frozen=True)
class BentLink:
    """A link that bends, where it is: indices of its modes, G_k (4, 3) each, and the modal masses."""

    indices: Sequence[int]
    G: Sequence[Matrix]
    masses: Matrix


def placed(whole: Model, described: Model, q: Sequence[Expr]) -> list[Expr]:
    """Return positions of the whole tree's coordinates, followers among them, by those of the described robot."""
    at: dict[str, Expr] = dict(zip(described.coordinates, q, strict=True))
    for name, coupling in described.followers.items():
        at[name] = exact(coupling.value(at.__getitem__))
    return [at[name] for name in whole.coordinates]


def poses(whole: Model, bound: Bound, at: Sequence[Expr], placements: Sequence[Matrix]) -> list[Matrix]:
    """Return A_0k of every body, 4x4, where the coordinates are."""
    found: list[Matrix] = []
    for body, B in zip(whole.bodies, placements, strict=True):
        parent = found[body.parent] if body.parent != FIXED_BODY else sp.eye(4)
        angles = {
            step(name).symbol: at[i] + bound.angle_offsets[i] for name, i in zip(body.active, body.indices, strict=True)
        }
        found.append(parent * B * joint_transform(body.active).xreplace(angles))
    return found


def bend(
    whole: Model, described: Model, q: Sequence[Expr], inertias: list[Matrix], value: Value
) -> dict[int, BentLink]:
    """Bend the bodies' pseudo-inertias, which are those while nothing bends, and return the links that bend by body.

    Args:
        inertias: H of every body, 4x4; changed in place.
        value: gives an expression for a number of a link's modes, by ``number_name``.
    """
    links: dict[int, BentLink] = {}
    for k, body in enumerate(whole.bodies):
        modes = whole.robot.link(body.name).modes
        if modes is None:
            continue
        turn = sp.Matrix(whole.robot.joint(body.joint).axis_turn).T.applyfunc(exact)
        named = _named(body.name, modes, value)
        indices = [described.coordinates.index(whole.coordinates[i]) for i in body.modes]
        e, m = [q[i] for i in indices], range(modes.count)
        first = [_turned(named.H0[i], turn) for i in m]
        pairs = {(i, j): _turned((*named.P[j][i], (0, 0, 0)), turn) for i, j in product(m, repeat=2)}
        if named.Q is not None:
            pairs = {(i, j): P + _turned(named.Q[i][j], turn) for (i, j), P in pairs.items()}
        grown = [sum((pairs[i, j] * e[j] for j in m), sp.zeros(4, 3)) for i in m]
        for i in m:
            C = (first[i] + grown[i] / 2).row_join(sp.zeros(4, 1))
            inertias[k] = inertias[k] + e[i] * (C + C.T)
        G = [one + other for one, other in zip(first, grown, strict=True)]
        links[k] = BentLink(indices, G, sp.Matrix(modes.count, modes.count, lambda i, j, of=named: of.masses[i][j]))
    return links


def mass_matrix(
    bodies: Sequence[tuple[Matrix, Mapping[int, Matrix]]],
    inertias: Sequence[Matrix],
    links: Mapping[int, BentLink],
    armature: Matrix,
) -> Matrix:
    """Compute M, (n, n): eq. (11), tr(dA/ds G_k A^T) between coordinates and modes, and modal masses.

    Args:
        bodies: A_0k and its derivatives by coordinates, by index.
        armature: that of rotors, (n, n).
    """
    M = sp.Matrix(armature)
    for k, ((A, first), H) in enumerate(zip(bodies, inertias, strict=True)):
        for s, D in first.items():
            for v, other in first.items():
                M[s, v] += _trace(D * H, other)
        if k not in links:
            continue
        link, R = links[k], A[:3, :3]
        for i, index in enumerate(link.indices):
            for s, D in first.items():
                entry = _trace((D * link.G[i])[:3, :], R)
                M[s, index] += entry
                M[index, s] += entry
            for j, other in enumerate(link.indices):
                M[index, other] += link.masses[i, j]
    return sp.ImmutableMatrix(M)


def christoffel(M: Matrix, q: Sequence[Expr]) -> tuple[tuple[tuple[Expr, ...], ...], ...]:
    """Compute C_s,vw = 1/2 (dM_sv/dw + dM_sw/dv - dM_vw/ds)."""
    n = range(len(q))
    slope = {(s, v, w): M[s, v].diff(q[w]) for s, v, w in product(n, repeat=3)}
    return tuple(tuple(tuple((slope[s, v, w] + slope[s, w, v] - slope[v, w, s]) / 2 for w in n) for v in n) for s in n)


def number_name(link: str, *key: Any) -> str:
    """Name a number of a link's modes: "links.arm.modes.N.1.x.y", "n.1.y", "P.1.2.x.y", "Q.1.2.x.y", "q.1.2.y"."""
    return ".".join(map(str, ("links", link, "modes", *key)))


def numbers(link: str, modes: LinkModes) -> dict[str, float]:
    """Return all numbers of a link's modes but those of K and D, by name."""
    found: dict[str, float] = {}

    def keep(name: str, number: float) -> float:
        return found.setdefault(name, number)

    _named(link, modes, keep)
    return found


def _named(link: str, modes: LinkModes, value: Value) -> LinkModes:
    """Return the modes with expressions in the place of their numbers; equal ones have one name."""
    m = range(modes.count)

    def moment(rows: Sequence[Sequence[float]], letters: str, *which: int) -> Any:
        """Write a block of 3 x 3 and, where there is one, a last row."""
        one = [i + 1 for i in which]
        block = [
            [value(number_name(link, letters[0], *one, AXES[i], AXES[j]), rows[i][j]) for j in range(3)]
            for i in range(3)
        ]
        last = [value(number_name(link, letters[1], *one, AXES[j]), rows[3][j]) for j in range(3)] if rows[3:] else []
        return (*map(tuple, block), *([tuple(last)] if last else []))

    def pair(k: int, j: int) -> Any:
        if k > j:
            return tuple(zip(*pair(j, k), strict=True))
        rows = modes.P[k][j]
        if k == j:
            rows = tuple(tuple(rows[min(a, b)][max(a, b)] for b in range(3)) for a in range(3))
        return _symmetric_names(link, rows, value, k) if k == j else moment(rows, "P", k, j)

    second = None
    if modes.Q is not None:
        second = tuple(tuple(moment(modes.Q[min(k, j)][max(k, j)], "Qq", min(k, j), max(k, j)) for j in m) for k in m)
    return replace(
        modes,
        H0=tuple(moment(modes.H0[k], "Nn", k) for k in m),
        P=tuple(tuple(pair(k, j) for j in m) for k in m),
        Q=second,
    )


def _symmetric_names(link: str, rows: Sequence[Sequence[float]], value: Value, k: int) -> Any:
    def entry(a: int, b: int) -> Expr:
        i, j = min(a, b), max(a, b)
        return value(number_name(link, "P", k + 1, k + 1, AXES[i], AXES[j]), rows[i][j])

    return tuple(tuple(entry(a, b) for b in range(3)) for a in range(3))


def _turned(rows: Sequence[Sequence[Expr]], turn: Matrix) -> Matrix:
    """Return R N R^T and, below it, (R n)^T of an integral [N; n^T]."""
    block, last = sp.Matrix([list(row) for row in rows[:3]]), sp.Matrix(list(rows[3]))
    return (turn * block * turn.T).col_join((turn * last).T)


def _trace(left: Matrix, right: Matrix) -> Expr:
    return sp.Add(*(a * b for a, b in zip(left, right, strict=True)))
