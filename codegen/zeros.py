"""The zero map of a robot: which terms of eqs. (11) and (12) vanish identically, how many, and why.

The map is structural: it follows from which coordinates are active and from the tree, by the proofs of ``joint``; what a
special geometry or inertia makes zero on top is left to the folding of constants.  Counted are M_sv for s <= v and
C_s,vw for v <= w.  Each zero is counted once, under the first reason of the list that holds for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eomgen.model import Model
from eomgen.robot import ANGULAR, COORDINATES

from . import joint

Mask = NDArray[np.bool_]

TREE = "not in one chain: no body is moved by all of the coordinates"
LEMMA_7 = "lemma (7): the second derivative by two translations vanishes"
SHARPER = "sharper lemma: nothing at or after a joint turns its translations"
ORTHOGONAL = "translations of one joint are orthogonal"
COAXIAL = "coaxial: a rotation does nothing along its own joint's translation on the same axis"
GYRO = "antisymmetry: C_i,jk = -C_k,ij for j <= min(i, k), so C_i,ji = 0"


@dataclass(frozen=True, eq=False)
class Tally:
    """Zeros of one array: entries in all, zeros per reason, and ``mask``, True where an entry survives."""

    total: int
    zeros: tuple[tuple[str, int], ...]
    mask: Mask

    @property
    def survivors(self) -> int:
        """How many entries do not vanish identically."""
        return self.total - sum(count for _, count in self.zeros)

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON."""
        zeros = [{"reason": reason, "count": count} for reason, count in self.zeros]
        return {"total": self.total, "zeros": zeros, "survivors": self.survivors}


@dataclass(frozen=True, eq=False)
class ZeroMap:
    """Zeros of the mass matrix, mask (n, n), and of the tensor C, mask (n, n, n) indexed [s, v, w].

    ``independent`` is the number of survivors of C that the antisymmetry leaves different up to sign.
    """

    mass_matrix: Tally
    christoffel: Tally
    independent: int

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON."""
        christoffel = {**self.christoffel.as_dict(), "independent": self.independent}
        return {"mass_matrix": self.mass_matrix.as_dict(), "christoffel": christoffel}

    def lines(self) -> list[str]:
        """A report for people: entries, zeros by reason, survivors."""
        lines = _lines("M, eq. (11), entries s <= v", self.mass_matrix)
        lines += _lines("C, eq. (12), entries v <= w", self.christoffel)
        return [*lines, f"  {self.independent:>9,}  of them independent up to sign"]


def zero_map(model: Model) -> ZeroMap:
    """Find the structural zeros of a model's M and C."""
    structure = _Structure(model)
    n = model.size
    upper = np.triu(np.ones((n, n), dtype=bool))
    mass = _tally(upper, [(TREE, ~structure.related), *structure.mass_rules()])
    christoffel = _tally(np.broadcast_to(upper, (n, n, n)), structure.christoffel_rules())
    independent = _independent(christoffel.mask)
    return ZeroMap(_mirrored(mass), _mirrored(christoffel), independent)


class _Structure:
    """Relations between the coordinates of a model, as (n, n) masks."""

    def __init__(self, model: Model) -> None:
        self.names = np.array([COORDINATES.index(name) for body in model.bodies for name in body.active])
        self.body = np.array([k for k, body in enumerate(model.bodies) for _ in body.active])
        above = np.zeros((len(model.bodies),) * 2, dtype=bool)
        for k in range(len(model.bodies)):
            above[list(model.ancestors(k)), k] = True
        upstream = above[np.ix_(self.body, self.body)]  # the body of row is an ancestor of that of column, or the same
        self.same = self.body[:, None] == self.body
        self.related = upstream | upstream.T
        self.before = upstream & (~self.same | (np.arange(len(self.names))[:, None] <= np.arange(len(self.names))))
        self.coaxial = self._coaxial(model)

    def mass_rules(self) -> Iterator[tuple[str, Mask]]:
        orthogonal = _table(joint.prove_translations_orthogonal())
        yield ORTHOGONAL, self.same & self._look_up(orthogonal | orthogonal.T)
        yield COAXIAL, self.coaxial | self.coaxial.T

    def christoffel_rules(self) -> Iterator[tuple[str, Mask]]:
        """Zeros of C_s,vw for v <= w; masks broadcast over [s, v, w]."""
        joint.prove_antisymmetry()
        s, v, w = np.ix_(*(np.arange(len(self.names)),) * 3)
        together = self.related[s, v] & self.related[s, w] & self.related[v, w]
        yield TREE, ~together
        yield LEMMA_7, self._second_derivative_zero(joint.LEMMA_7)[v, w]
        yield SHARPER, self._second_derivative_zero(joint.SHARPER)[v, w]
        yield GYRO, (s == w) & self.before[v, w]
        yield COAXIAL, self.coaxial[s, v] & self.before[v, w] | self.coaxial[s, w] & self.before[w, v]

    def _second_derivative_zero(self, reason: str) -> Mask:
        """(v, w) with v before w in the chain, whose second derivative the named lemma proves zero."""
        pairs = [pair for pair in joint.prove_second_derivative_zeros() if pair.reason == reason]
        same = _table([(pair.first, pair.second) for pair in pairs if pair.same_joint])
        apart = _table([(pair.first, pair.second) for pair in pairs if not pair.same_joint])
        return self.before & np.where(self.same, self._look_up(same), self._look_up(apart))

    def _coaxial(self, model: Model) -> Mask:
        """(s, v): a translation, and its joint's first active rotation on the same axis."""
        found = _table(joint.prove_coaxial())
        turns = [next((name for name in body.active if name in ANGULAR), None) for body in model.bodies]
        is_first = np.array([turns[k] == COORDINATES[i] for k, i in zip(self.body, self.names, strict=True)])
        return self.same & self._look_up(found) & is_first

    def _look_up(self, table: Mask) -> Mask:
        return table[np.ix_(self.names, self.names)]


def _table(pairs: Iterable[tuple[str, str]]) -> Mask:
    """A (6, 6) mask of coordinate names."""
    table = np.zeros((6, 6), dtype=bool)
    for a, b in pairs:
        table[COORDINATES.index(a), COORDINATES.index(b)] = True
    return table


def _tally(entries: Mask, rules: Iterable[tuple[str, Mask]]) -> Tally:
    """Apply the rules in order; each zero counts under the first that holds."""
    left = np.array(entries)
    total, counts = int(left.sum()), []
    for reason, zero in rules:
        counts.append((reason, int((left & zero).sum())))
        left &= ~zero
    return Tally(total, tuple(counts), left)


def _mirrored(tally: Tally) -> Tally:
    """The tally with its mask made symmetric in the last two indices."""
    return Tally(tally.total, tally.zeros, tally.mask | np.swapaxes(tally.mask, -1, -2))


def _independent(survivors: Mask) -> int:
    """Survivors with v <= min(s, w) come in pairs C_s,vw = -C_w,vs; the others stand alone."""
    n = len(survivors)
    s, v, _ = np.ix_(*(np.arange(n),) * 3)
    paired = int((survivors & (v <= s)).sum())
    return int(survivors.sum()) - paired // 2


def _lines(title: str, tally: Tally) -> list[str]:
    lines = [f"{title}: {tally.total:,}"]
    lines += [f"  {count:>9,}  {reason}" for reason, count in tally.zeros if count]
    return [*lines, f"  {tally.survivors:>9,}  survive"]
