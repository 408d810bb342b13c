"""Eq. (3) and its derivatives in SymPy, and the proofs of the lemmas that let terms be dropped.

A joint is a product of elementary 4x4 transforms, one per active coordinate, in the order x, y, z, alpha, beta, gamma.
Everything that is proved here is proved for one joint between generic upstream and downstream matrices,

    A_0k = L(upstream) . A_(i-1)i(S_i) . N(downstream),

so it holds for a joint anywhere in a chain or tree, and no expression ever grows with the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, reduce
from itertools import combinations, combinations_with_replacement, product
from types import MappingProxyType
from typing import Any

import sympy as sp

from eomgen.errors import InternalError
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR

Matrix = Any  # sympy.ImmutableMatrix: SymPy's matrices carry no usable types


@dataclass(frozen=True)
class Step:
    """One elementary transform of eq. (3).

    ``transform`` is A(s), 4x4, with the coordinate's ``symbol`` s; ``generator`` the constant 4x4 D of dA/ds = A D.
    """

    coordinate: str
    symbol: Any
    transform: Matrix
    generator: Matrix

    @property
    def is_rotation(self) -> bool:
        """Whether the coordinate is an angle: its generator then has a 3x3 block."""
        return not self.generator[:3, :3].is_zero_matrix

    @property
    def axis(self) -> int:
        """0, 1 or 2: the axis of the translation or rotation, read off the generator."""
        D = self.generator
        entries = (D[2, 1], D[0, 2], D[1, 0]) if self.is_rotation else (D[0, 3], D[1, 3], D[2, 3])
        (axis,) = (i for i, entry in enumerate(entries) if entry != 0)
        return axis

    @property
    def rotation(self) -> Matrix:
        """The 3x3 rotation block of A(s)."""
        return self.transform[:3, :3]


@dataclass(frozen=True)
class JointDerivatives:
    """Derivatives of A_(i-1)i, 4x4 each: ``first[s]`` by one coordinate, ``second[s, w]`` by two, in any order."""

    first: Mapping[str, Matrix]
    second: Mapping[tuple[str, str], Matrix]


@cache
def step(coordinate: str) -> Step:
    """Return the elementary transform of one coordinate, with its generator taken from dA/ds and proved."""
    s = sp.Symbol(coordinate, real=True)
    A = sp.ImmutableMatrix(_translation(coordinate, s) if coordinate in LINEAR else _rotation(coordinate, s))
    derivative = A.diff(s)
    D = derivative.subs(s, 0)  # A(0) = 1, so this is the only candidate for dA/ds = A D
    _prove(derivative - A * D, f"dA/ds = A D for {coordinate}")
    return Step(coordinate, s, A, sp.ImmutableMatrix(D))


@cache
def joint_transform(active: tuple[str, ...]) -> Matrix:
    """Return A_(i-1)i of eq. (3), 4x4, for the active coordinates; the others are zero and do not appear."""
    steps = [step(name).transform for name in COORDINATES if name in active]
    return sp.ImmutableMatrix(reduce(lambda A, B: A * B, steps, sp.eye(4)))


@cache
def joint_derivatives(active: tuple[str, ...]) -> JointDerivatives:
    """Return first and second derivatives of A_(i-1)i by the active coordinates."""
    A = joint_transform(active)
    first = {name: A.diff(step(name).symbol) for name in active}
    upper = {(s, w): first[s].diff(step(w).symbol) for s, w in combinations_with_replacement(active, 2)}
    second = {(s, w): upper[(s, w) if (s, w) in upper else (w, s)] for s, w in product(active, repeat=2)}
    return JointDerivatives(MappingProxyType(first), MappingProxyType(second))


@cache
def prove_second_derivative_zeros(active: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of coordinates of one joint with d2A/ds dw = 0: by the lemmas, those with a translation.

    Raises:
        InternalError: other pairs vanish.
    """
    second = joint_derivatives(active).second
    pairs = tuple(pair for pair in combinations_with_replacement(active, 2) if second[pair].is_zero_matrix)
    if pairs != tuple(pair for pair in combinations_with_replacement(active, 2) if pair[0] in LINEAR):
        raise InternalError("the proof failed: second derivatives vanish by lemma (7) and the sharper lemma alone")
    return pairs


@cache
def prove_translation_columns(active: tuple[str, ...]) -> tuple[str, ...]:
    """Prove dA_0k/dx = L [0 ¦ e_x] for the translations, which are returned: nothing downstream changes it.

    So for two joints, A_0k = L A_i M A_l N, d2A_0k/dx dw = 0 for every coordinate w of the downstream joint l.
    """
    derivatives, downstream = joint_derivatives(active), _homogeneous("n")
    translations = tuple(name for name in active if name in LINEAR)
    for name in translations:
        column = derivatives.first[name]
        _prove(column - step(name).generator, f"dA/d{name} is constant")
        _prove(column * downstream - column, f"dA/d{name} N = dA/d{name}")
    return translations


@cache
def prove_translations_orthogonal(active: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return pairs of translations of one joint with tr(D_i H D_j^T) = 0, for every H and every upstream pose.

    tr(L D_i H D_j^T L^T) = tr(L^T L D_i H D_j^T), and L^T L = [[1, g], [g^T, c]] because its rotation is orthogonal.
    """
    H, gram = _symmetric("h"), _gram()
    pairs = combinations([name for name in active if name in LINEAR], 2)
    return tuple((i, j) for i, j in pairs if _trace(gram * step(i).generator * H * step(j).generator.T) == 0)


@cache
def prove_coaxial(active: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return pairs (translation, rotation) about one axis of one joint, which never act on each other.

    With nothing that turns between them, the translation's direction e and the rotation's Omega have e^T Omega = 0,
    so tr(dA/dx H (Omega X)^T) = 0 for every X: both entries of M and every C with that pair vanish.
    """
    H, X, gram = _symmetric("h"), sp.ImmutableMatrix(4, 4, lambda i, j: sp.Symbol(f"x{i}{j}")), _gram()
    moments = {i: gram * step(i).generator * H * X.T for i in active if i in LINEAR}
    pairs = product(moments, [name for name in active if name in ANGULAR])
    return tuple((i, j) for i, j in pairs if _trace(moments[i] * step(j).generator.T) == 0)


@cache
def prove_coaxial_swap() -> None:
    """Prove C_i,jk = -C_l,mk for coaxial pairs (i, m) and (l, j) of two joints, and every k that j and m move.

    A coaxial pair shares one direction: dA_0k/dx = [0 | e] and Omega = skew(e).  For the pairs' directions p and r the
    two entries are p^T skew(r) y and r^T skew(p) y with the same y.
    """
    p, r, y = (sp.Matrix(sp.symbols(f"{letter}:3")) for letter in "pry")
    _prove((p.T * _skew(r) * y + r.T * _skew(p) * y).expand(), "coaxial swap")


@cache
def prove_antisymmetry(active: tuple[str, ...]) -> None:
    """Prove C_i,jk = -C_k,ij whenever j is at or upstream of both i and k (in the product of elementary transforms).

    Then dA_0k/ds_j = Omega_j A_0k with Omega_j = P D_j P^-1, P the product up to s_j, and Omega_j does not depend on
    s_i or s_k.  So the sum of both is tr(S (Omega_j + Omega_j^T)) with S = dA/ds_i H (dA/ds_k)^T, whose last row and
    column are zero: only the 3x3 block of Omega_j counts, and it is skew.
    """
    upstream = _homogeneous("p")[:3, :3]
    S = sp.zeros(4, 4)
    S[:3, :3] = sp.Matrix(3, 3, lambda i, j: sp.Symbol(f"s{i}{j}"))
    for name in active:
        omega = sp.zeros(4, 4)
        omega[:3, :3] = upstream * step(name).generator[:3, :3] * upstream.T
        omega[:3, 3] = sp.Matrix(sp.symbols("o:3"))
        total = sp.expand(_trace(S * (omega + omega.T)))
        _prove(sp.Matrix([total]), f"antisymmetry for {name}")


def _translation(coordinate: str, s: Any) -> Matrix:
    A = sp.eye(4)
    A[LINEAR.index(coordinate), 3] = s
    return A


def _rotation(coordinate: str, s: Any) -> Matrix:
    """Return the right-handed rotation by s about axis k, which turns axis i to axis j (cyclic)."""
    k = ANGULAR.index(coordinate)
    i, j = (k + 1) % 3, (k + 2) % 3
    A = sp.eye(4)
    A[i, i] = A[j, j] = sp.cos(s)
    A[i, j], A[j, i] = -sp.sin(s), sp.sin(s)
    return A


def _homogeneous(letter: str) -> Matrix:
    """Return a generic matrix [[R, p], [0, 1]], nothing assumed of R."""
    rows = [[sp.Symbol(f"{letter}{i}{j}") for j in range(4)] for i in range(3)]
    return sp.ImmutableMatrix([*rows, [0, 0, 0, 1]])


def _symmetric(letter: str) -> Matrix:
    return sp.ImmutableMatrix(4, 4, lambda i, j: sp.Symbol(f"{letter}{min(i, j)}{max(i, j)}"))


def _gram() -> Matrix:
    """Return L^T L of a pose L, with R^T R = 1 used and the rest generic."""
    gram = sp.eye(4)
    for i in range(4):
        gram[i, 3] = gram[3, i] = sp.Symbol(f"g{i}")
    return sp.ImmutableMatrix(gram)


def _skew(a: Matrix) -> Matrix:
    return sp.ImmutableMatrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def _trace(product: Matrix) -> Any:
    return sum(product[i, i] for i in range(4))


def _prove(residue: Matrix, claim: str) -> None:
    if not residue.is_zero_matrix:
        raise InternalError(f"the proof failed: {claim}")
