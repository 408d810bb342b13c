"""The zero map of a robot: which terms of eqs. (11) and (12) vanish identically, how many, and why.

The map is structural: it follows from which coordinates are active and from the tree, by the proofs of ``joint``; what
a special geometry or inertia makes zero on top is left to the folding of constants.  Counted are M_sv for s <= v and
C_s,vw for v <= w.  Each zero is counted once, under the first reason of the list that holds for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eomgen.robot.model import Body, Model
from eomgen.robot.value import ANGULAR, LINEAR

from .facts import facts_of

Mask = NDArray[np.bool_]

ROTOR = "motor: its rotor's inertia about its own axis stands on the diagonal of M alone"
TREE = "not in one chain: no body is moved by all of the coordinates"
LEMMA_7 = "lemma (7): the second derivative by two translations vanishes"
SHARPER = "sharper lemma: nothing at or after a joint turns its translations"
ORTHOGONAL = "translations of one joint are orthogonal"
COAXIAL = "coaxial: a rotation does nothing along its own joint's translation on the same axis"
MODES = "lemma (7) for modes: the link's own deflections are linear in them"
MODAL_MASS = "modal masses are constant"
GYRO = "antisymmetry: C_i,jk = -C_k,ij for j <= min(i, k), so C_i,ji = 0"


@dataclass(frozen=True, eq=False)
class Tally:
    """Zeros of one array: entries in all, zeros per reason, and ``mask``, True where an entry survives.

    ``reason`` has the mask's shape: the place in ``zeros`` of why an entry vanishes, -1 where it survives.
    """

    total: int
    zeros: tuple[tuple[str, int], ...]
    mask: Mask
    reason: NDArray[np.int8]

    @property
    def survivors(self) -> int:
        """Number of entries that do not vanish identically."""
        return self.total - sum(count for _, count in self.zeros)

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        zeros = [{"reason": reason, "count": count} for reason, count in self.zeros]
        return {"total": self.total, "zeros": zeros, "survivors": self.survivors}


@dataclass(frozen=True, eq=False)
class ZeroMap:
    """Zeros of the mass matrix, mask (n, n), and of the tensor C, mask (n, n, n) indexed [s, v, w].

    Survivors of C that are independent up to sign: ``by_antisymmetry`` counts those that C_i,jk = -C_k,ij leaves
    different, ``independent`` those that C_i,jk = -C_l,mk for coaxial pairs (i, m) and (l, j) leaves different too.
    """

    mass_matrix: Tally
    christoffel: Tally
    by_antisymmetry: int
    independent: int

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        counts = {"independent_by_antisymmetry": self.by_antisymmetry, "independent": self.independent}
        christoffel = {**self.christoffel.as_dict(), **counts}
        return {"mass_matrix": self.mass_matrix.as_dict(), "christoffel": christoffel}

    def lines(self) -> list[str]:
        """Write a report for people: entries, zeros by reason, survivors."""
        lines = _lines("M, eq. (11), entries s <= v", self.mass_matrix)
        lines += _lines("C, eq. (12), entries v <= w", self.christoffel)
        lines.append(f"  {self.by_antisymmetry:>9,}  of them independent up to sign by the antisymmetry")
        return [*lines, f"  {self.independent:>9,}  when coaxial pairs of two joints are exchanged as well"]


def zero_map(model: Model) -> ZeroMap:
    """Find the structural zeros of a model's M and C; where coordinates lead others, what all of them leave zero."""
    if model.followers:
        return _led(model)
    structure = _Structure(model)
    n = len(model.coordinates)
    upper = np.triu(np.ones((n, n), dtype=bool))
    mass = _tally(upper, structure.mass_rules())
    christoffel = _tally(np.broadcast_to(upper, (n, n, n)), structure.christoffel_rules())
    by_antisymmetry = christoffel.survivors - _antisymmetric_pairs(christoffel.mask)
    independent = by_antisymmetry - structure.coaxial_swaps()
    return ZeroMap(_mirrored(mass), _mirrored(christoffel), by_antisymmetry, independent)


def _led(model: Model) -> ZeroMap:
    """Count zeros of S^T M S and of C likewise: each under the reason that the leaders' entry has."""
    whole = model.tree
    zeros, names = zero_map(whole), {name: i for i, name in enumerate(whole.coordinates)}
    places = [names[name] for name in model.coordinates]
    moves = np.eye(len(whole.coordinates), dtype=bool)[:, places]
    for follower, leaders in model.leaders.items():
        moves[names[follower]] = np.isin(model.coordinates, leaders)
    upper = np.triu(np.ones((len(model.coordinates),) * 2, dtype=bool))

    def tally(of: Tally, more: Mask | bool = False) -> Tally:
        mask = of.mask
        for axis in range(mask.ndim):
            mask = np.moveaxis(np.tensordot(moves.T.astype(int), mask.astype(int), (1, axis)) > 0, 0, axis)
        mask = mask | more
        reason = np.where(mask, -1, of.reason[np.ix_(*(places,) * mask.ndim)]).astype(np.int8)
        entries = np.broadcast_to(upper, mask.shape)
        counts = [(name, int(((reason == place) & entries).sum())) for place, (name, _) in enumerate(of.zeros)]
        return Tally(int(entries.sum()), tuple(counts), mask, reason)

    mass = tally(zeros.mass_matrix)
    bends = _bends(model, zeros.mass_matrix.mask @ moves)
    christoffel = tally(zeros.christoffel, bends)
    independent = christoffel.survivors - _antisymmetric_pairs(christoffel.mask & upper)
    return ZeroMap(mass, christoffel, independent, independent)


def _bends(model: Model, inertial: Mask) -> Mask:
    """Return entries of C that second derivatives of followers leave: M_sf d2f/dv dw of each of them that bends.

    inertial: whether M of the tree couples each of its coordinates with what a leader moves, (tree, leaders).
    """
    whole, names = model.tree.coordinates, {name: i for i, name in enumerate(model.coordinates)}
    left = np.zeros((len(model.coordinates),) * 3, dtype=bool)
    pairs: dict[str, set[tuple[int, int]]] = {}

    def moving(name: str) -> list[int]:
        return [names[leader] for leader in model.leaders.get(name, (name,))]

    for follower, coupling in model.followers.items():
        pairs[follower] = {pair for name in coupling.to for pair in pairs.get(name, ())}
        for one, other in coupling.products:
            pairs[follower] |= {*product(moving(one), moving(other)), *pairs.get(one, ()), *pairs.get(other, ())}
        for v, w in pairs[follower]:
            left[:, v, w] |= inertial[whole.index(follower)]
            left[:, w, v] |= inertial[whole.index(follower)]
    return left


class _Structure:
    """Relations between the coordinates of a model, as (n, n) masks."""

    def __init__(self, model: Model) -> None:
        n = len(model.coordinates)
        self.body, self.modal = np.zeros(n, dtype=int), np.zeros(n, dtype=bool)
        for k, body in enumerate(model.bodies):
            self.body[[*body.indices, *body.modes]] = k
            self.modal[list(body.modes)] = True
        self.motor = np.isin(np.arange(n), list(model.motors))
        bent = np.array([_is_bent(model, body.links[0]) for body in model.bodies], dtype=bool)
        self.linear = self.modal & ~bent[self.body]  # modes whose deflections have no second order
        spatial = ~(self.motor[:, None] | self.motor)
        above = np.zeros((len(model.bodies),) * 2, dtype=bool)
        for k in range(len(model.bodies)):
            above[list(model.ancestors(k)), k] = True
        # the body of row is an ancestor of that of column, or the same
        self.same = (self.body[:, None] == self.body) & spatial
        upstream = above[np.ix_(self.body, self.body)] & spatial
        upstream &= self.same | ~self.modal[:, None]  # modes move their own bodies; nodes are joints that follow them
        self.related = upstream | upstream.T | np.diag(self.motor)
        self.before = upstream & (~self.same | (np.arange(n)[:, None] <= np.arange(n)))
        self.translations, self.constant = (np.zeros(n, dtype=bool) for _ in range(2))
        self.vanishing, self.orthogonal, self.coaxial = (np.zeros((n,) * 2, dtype=bool) for _ in range(3))
        for body in model.bodies:
            self._take_facts(model, body)

    def mass_rules(self) -> Iterator[tuple[str, Mask]]:
        if self.motor.any():
            yield ROTOR, (self.motor[:, None] | self.motor) & ~np.eye(len(self.motor), dtype=bool)
        yield TREE, ~self.related
        yield ORTHOGONAL, self.orthogonal | self.orthogonal.T
        yield COAXIAL, self.coaxial | self.coaxial.T

    def christoffel_rules(self) -> Iterator[tuple[str, Mask]]:
        """Yield zeros of C_s,vw for v <= w; masks broadcast over [s, v, w]."""
        s, v, w = np.ix_(*(np.arange(len(self.body)),) * 3)
        if self.motor.any():
            yield ROTOR, self.motor[s] | self.motor[v] | self.motor[w]
        together = self.related[s, v] & self.related[s, w] & self.related[v, w]
        yield TREE, ~together
        # the second derivatives of one joint, or a first one that nothing downstream changes
        zero = self.before & np.where(self.same & ~self.modal, self.vanishing, self.constant[:, None])
        yield LEMMA_7, (zero & self.translations)[v, w]
        yield SHARPER, zero[v, w]
        if self.modal.any():
            yield MODES, self.linear[v] & self.linear[w] & self.same[v, w]
            yield MODAL_MASS, self.modal[s] & self.modal[v] & self.modal[w]
        yield GYRO, (s == w) & self.before[v, w] & ~self.modal[v]
        yield COAXIAL, self.coaxial[s, v] & self.before[v, w] | self.coaxial[s, w] & self.before[w, v]

    def coaxial_swaps(self) -> int:
        """Return pairs C_i,jk = -C_l,mk of coaxial (i, m) and (l, j), the joint of j downstream of that of i."""
        turns = np.flatnonzero(self.coaxial.any(axis=0))  # one rotation at most in each joint
        above = self.before[np.ix_(turns, turns)] & ~np.eye(len(turns), dtype=bool)
        moved = self.before[turns].sum(axis=1)  # coordinates at or after a rotation: the values of k
        return int((above.sum(axis=0) * moved).sum())

    def _take_facts(self, model: Model, body: Body) -> None:
        """Enter the facts about a body's joint into the masks."""
        facts, place = facts_of(model, body.active), dict(zip(body.active, body.indices, strict=True))
        turned = {*body.active, *model.offset_angles(body.joint)}
        turn = next((name for name in ANGULAR if name in turned), None)
        first_turn = [pair for pair in facts.coaxial if pair[1] == turn]  # nothing turns between the two
        tables = ((self.vanishing, facts.zero_pairs), (self.orthogonal, facts.orthogonal), (self.coaxial, first_turn))
        for mask, pairs in tables:
            for one, other in pairs:
                mask[place[one], place[other]] = True
        self.constant[[place[name] for name in facts.constant]] = True
        self.translations[[place[name] for name in body.active if name in LINEAR]] = True


def _is_bent(model: Model, link: str) -> bool:
    """Return whether a link's own deflections have a second order."""
    modes = model.robot.link(link).modes
    return modes is not None and modes.Q is not None


def _tally(entries: Mask, rules: Iterable[tuple[str, Mask]]) -> Tally:
    """Apply the rules in order; each zero counts under the first that holds."""
    left = np.array(entries)
    total = int(left.sum())
    counts: list[tuple[str, int]] = []
    place = np.full(left.shape, -1, dtype=np.int8)
    for reason, zero in rules:
        counted = left & zero
        place[counted] = len(counts)
        counts.append((reason, int(counted.sum())))
        left &= ~counted
    return Tally(total, tuple(counts), left, place)


def _mirrored(tally: Tally) -> Tally:
    """Make the tally's arrays symmetric in the last two indices."""
    mask, reason = (np.maximum(array, np.swapaxes(array, -1, -2)) for array in (tally.mask, tally.reason))
    return Tally(tally.total, tally.zeros, mask, reason)


def _antisymmetric_pairs(survivors: Mask) -> int:
    """Pair survivors with v <= min(s, w), C_s,vw = -C_w,vs; the others stand alone."""
    s, v, _ = np.ix_(*(np.arange(len(survivors)),) * 3)
    return int((survivors & (v <= s)).sum()) // 2


def _lines(title: str, tally: Tally) -> list[str]:
    lines = [f"{title}: {tally.total:,}"]
    lines += [f"  {count:>9,}  {reason}" for reason, count in tally.zeros if count]
    return [*lines, f"  {tally.survivors:>9,}  survive"]
