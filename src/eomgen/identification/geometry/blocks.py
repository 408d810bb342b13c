"""Coordinates that stiffness matrices couple, in blocks: where entries of C or K stand among parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...arrays import Array, Index

FORCE, ENTRY = "force", "entry"  # factors of compliances C, s = C f, and of entries of K, C = K^-1


class Unknown(Protocol):
    """Knowledge of blocks about a parameter of an error model; its attributes are those of ``ErrorParameter``."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def station(self) -> int:
        """Index of the station that it moves."""

    @property
    def coordinate(self) -> int:
        """Index of the coordinate that it moves."""

    @property
    def factor(self) -> str:
        """FORCE or ENTRY: of which kind its number is."""

    @property
    def other(self) -> int | None:
        """Index of its second coordinate; None without one."""


@dataclass(frozen=True)
class Block:
    """Entries of coordinates that hang together: where they stand among the parameters of a model, (n, n).

    of_stiffness: whether they are those of K, some of which stay as they are; else those of C.
    """

    station: int
    coordinates: tuple[int, ...]
    index: Index
    of_stiffness: bool = False

    @property
    def pairs(self) -> list[tuple[int, int, int]]:
        """Index of every parameter, with its row and column."""
        n = len(self.coordinates)
        return [(int(self.index[i, j]), i, j) for i in range(n) for j in range(i, n)]

    def stiffness(self, x: Array) -> Array:
        """Return K of the values of all parameters, (P,); infinite on the diagonal where nothing bends, (n, n)."""
        if self.of_stiffness:
            return np.asarray(x)[self.index]
        C = np.asarray(x)[self.index]
        soft = np.diagonal(C) != 0.0
        K = np.diag(np.where(soft, 0.0, np.inf))
        own = np.ix_(soft, soft)
        try:
            K[own] = np.linalg.inv(C[own])
        except np.linalg.LinAlgError:
            K[own] = np.nan
        return K

    def compliance(self, x: Array) -> Array:
        """Return C of the values of all parameters, (P,) or (P, N): (n, n) or (N, n, n); NaN where K is singular."""
        values = np.asarray(x)[self.index]
        values = values if values.ndim == 2 else np.moveaxis(values, -1, 0)
        if not self.of_stiffness:
            return values
        try:
            return np.asarray(np.linalg.inv(values))
        except np.linalg.LinAlgError:
            return np.full_like(values, np.nan)

    def bend(self, C: Array, forces: Array) -> Array:
        """Return deflections C f, (N, n), of forces at the coordinates of all stations, (N, S, 6)."""
        return np.asarray(np.einsum("...ij,...j->...i", C, forces[:, self.station, list(self.coordinates)]))

    def others(self, i: int) -> list[int]:
        """Return its coordinates but for that of row i."""
        return [c for row, c in enumerate(self.coordinates) if row != i]

    def bent(self, C: Array, s: Array) -> Iterator[tuple[int, Array]]:
        """Yield the index of every entry of K, with what it changes per unit at deflections s, (N, n): -C dK s."""
        for at, i, j in self.pairs:
            both = s[:, [j]] * C[..., i, :] + (s[:, [i]] * C[..., j, :] if i != j else 0.0)
            yield at, -both

    def slopes(self, K: Array) -> Array:
        """Return derivatives of the entries of K by those of C, in the order of ``pairs``: dK = -K dC K."""
        pairs = [(i, j) for _, i, j in self.pairs]
        with np.errstate(invalid="ignore"):
            rows = [[-(K[i, a] * K[b, j] + (K[i, b] * K[a, j] if a != b else 0.0)) for a, b in pairs] for i, j in pairs]
        return np.array(rows)


def unfinished(parameters: Sequence[Unknown]) -> str:
    """Return the name of an entry whose block lacks others, or has others of another kind; "" if all are whole."""
    places: dict[tuple[int, int | None, int | None], str] = {
        (q.station, q.coordinate, q.other): q.factor for q in parameters if q.other is not None
    }
    for q in parameters:
        ends = [{a, b} for k, a, b in places if k == q.station] if q.other is not None else []
        group = sorted(set[int | None]().union(*(pair for pair in ends if pair & {q.coordinate, q.other})), key=str)
        pairs = [(q.station, a, b) for i, a in enumerate(group) for b in group[i:]]
        if (q.factor == ENTRY and q.other is None) or any(places.get(pair) != q.factor for pair in pairs):
            return q.name
    return ""


def blocks_of(parameters: Sequence[Unknown]) -> list[Block]:
    """Return the groups of coordinates that matrices couple, in the order of the stations."""
    places: dict[tuple[int, int, int], int] = {}
    for i, parameter in enumerate(parameters):
        if parameter.other is not None:
            places[parameter.station, parameter.coordinate, parameter.other] = i
    blocks = []
    first = sorted({(k, a) for k, a, _ in places})
    while first:
        k, a = first[0]
        ends = [{one, other} for station, one, other in places if station == k]
        group = sorted(set[int]().union(*(pair for pair in ends if a in pair)))
        index = np.array([[places[k, min(i, j), max(i, j)] for j in group] for i in group], dtype=np.intp)
        blocks.append(Block(k, tuple(group), index, parameters[index[0, 0]].factor == ENTRY))
        first = [place for place in first if place[0] != k or place[1] not in group]
    return blocks
