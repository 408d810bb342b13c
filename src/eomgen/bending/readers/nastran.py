"""Nastran: matrices as DMIG entries, as punch files have them, and nodes as GRID entries.

A DMIG entry has its name, node and component of the column, and in further fields node, component and entry of each
row; the header has 0 in the place of the node, and form 6 of a symmetric matrix, of which one triangle is there.
Points without a component (SPOINT) are amplitudes of modes.  Sources: MSC Nastran Quick Reference Guide, and the
references of OptiStruct and Autodesk Nastran, DMIG and GRID.  ``op4`` reads files of OUTPUT4.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...arrays import Array
from ..finite_elements import MOST_ENTRIES, MOST_NODES
from . import coordinate_systems
from .bulk_data import Card, cards, three_numbers, whole
from .contents import Entries, Labels, Nodes, keys_of
from .coordinate_systems import Definition, System
from .selection import Selection
from .text import SMALLER, number_of, refusal

_SYMMETRIC, _SQUARE = 6, 1


@dataclass
class _Matrix:
    """A matrix as it is read: node, component, node and component of each entry, and the entries."""

    number: int
    is_kept: bool
    places: array[int] = field(default_factory=lambda: array("i"))
    entries: array[float] = field(default_factory=lambda: array("d"))


def read(path: Path, selection: Selection) -> tuple[Nodes, dict[str, Entries]]:
    """Return the nodes of a file of bulk data, in the basic system, and its matrices by the roles of the selection.

    Raises:
        InputError: an entry has something else, a coordinate system is missing, or several matrices may be meant.
    """
    grids, definitions, matrices = _Grids(path), dict[int, Definition](), dict[str, _Matrix]()
    for card in cards(path, ("GRID", "GRDSET", "DMIG", *coordinate_systems.CARDS)):
        if card.name == "DMIG":
            _take(path, card, matrices, selection)
        elif card.name == "GRID":
            grids.take(card)
        elif card.name == "GRDSET":
            grids.usual = card.padded(6)
        else:
            coordinate_systems.take(path, card, definitions)
    by_number = {matrix.number: matrix for matrix in matrices.values()}
    found = {role: _entries(path, by_number[number]) for role, number in selection.chosen().items()}
    return grids.nodes(definitions), found


@dataclass
class _Grids:
    """GRID entries as they are read, with the systems of their places (CP) and of their directions (CD)."""

    path: Path
    usual: list[str] = field(default_factory=lambda: [""] * 6)  # fields of GRDSET
    labels: array[int] = field(default_factory=lambda: array("q"))
    lines: array[int] = field(default_factory=lambda: array("q"))
    systems: list[tuple[str, str]] = field(default_factory=list)
    coordinates: array[float] = field(default_factory=lambda: array("d"))

    def take(self, card: Card) -> None:
        """Take an entry."""
        fields = card.padded(6)
        self.coordinates.extend(three_numbers(self.path, card, fields[2:5]))
        self.labels.append(whole(self.path, card, fields[0]))
        self.lines.append(card.line)
        self.systems.append((fields[1], fields[5]))
        if len(self.labels) > MOST_NODES:
            raise refusal(self.path, card.line, f"more than {MOST_NODES} nodes", f"up to that, {SMALLER}")

    def nodes(self, definitions: Mapping[int, Definition]) -> Nodes:
        """Return the nodes, with their places and directions in the basic system."""
        labels, coordinates = np.array(self.labels, dtype=np.int64), np.array(self.coordinates).reshape(-1, 3)
        of_places, of_directions = (self._numbers(name, definitions) for name in ("CP", "CD"))
        needed = {node for definition in definitions.values() for node in definition.nodes}
        rows = [row for row, label in enumerate(self.labels) if label in needed]
        points = {self.labels[row]: (int(of_places[row]), coordinates[row]) for row in rows}
        systems = coordinate_systems.resolved(self.path, definitions, points)
        places = np.zeros_like(coordinates)
        for number in np.unique(of_places).tolist():
            mine = of_places == number
            places[mine] = systems[number].places(coordinates[mine])
        return Nodes(labels, places, axes=_axes(systems, of_directions, places))

    def _numbers(self, name: str, definitions: Mapping[int, Definition]) -> Labels:
        """Return the numbers of the systems of all nodes, CP or CD; InputError of one that is not there."""
        at = ("CP", "CD").index(name)
        usual = self.usual[(1, 5)[at]]
        numbers = []
        for given, line in zip(self.systems, self.lines, strict=True):
            text = given[at] or usual or "0"
            number = int(text) if text.isdecimal() and len(text) < 10 else -1
            if number and number not in definitions:
                allowed = f"0 or nothing, or {coordinate_systems.GIVEN}"
                raise refusal(self.path, line, f"{name} = {text}", allowed)
            numbers.append(number)
        return np.array(numbers, dtype=np.int64)


def _axes(systems: Mapping[int, System], numbers: Labels, places: Array) -> Array | None:
    """Return the directions of nodes, (N, 3, 3); None where all are those of the basic system."""
    if not numbers.any():
        return None
    axes = np.zeros((len(places), 3, 3))
    for number in np.unique(numbers).tolist():
        mine = numbers == number
        axes[mine] = systems[number].directions(places[mine])
    return axes


def _take(path: Path, card: Card, matrices: dict[str, _Matrix], selection: Selection) -> None:
    """Take a DMIG entry, a header or a column, into the matrix of its name."""
    fields = card.fields + [""] * (-len(card.fields) % 4)
    name = fields[0].strip().upper()
    if fields[1].strip() == "0":
        form, kind = whole(path, card, fields[2]), whole(path, card, fields[3])
        fits = form in (_SYMMETRIC, _SQUARE) and kind <= 2
        matrix = _Matrix(len(selection.seen), selection.wants(name, fits))
        if matrix.is_kept and not fits:
            raise refusal(path, card.line, f"form {form}, type {kind}", "form 6 or 1, square, and type 1 or 2, real")
        if name in matrices:
            raise refusal(path, card.line, name, "one header of each matrix")
        matrices[name] = matrix
        return
    if name not in matrices:
        raise refusal(path, card.line, name, "a header of the matrix before its columns")
    if matrices[name].is_kept:
        _take_column(path, card, fields, matrices[name])


def _take_column(path: Path, card: Card, fields: list[str], matrix: _Matrix) -> None:
    """Take a column of a DMIG entry."""
    column = whole(path, card, fields[1]), whole(path, card, fields[2], 0)
    for start in range(4, len(fields), 4):
        node, component, entry = fields[start : start + 3]
        if not node.strip() and not entry.strip():
            continue
        number = number_of(entry)
        if number is None:
            raise refusal(
                path, card.line, entry.strip(), f"a finite number in the column of node {column[0]}, {column[1]}"
            )
        matrix.places.extend((whole(path, card, node), whole(path, card, component, 0), *column))
        matrix.entries.append(number)
    if len(matrix.entries) > MOST_ENTRIES:
        raise refusal(path, card.line, f"more than {MOST_ENTRIES} entries of {fields[0].strip()}", "up to that")


def _entries(path: Path, matrix: _Matrix) -> Entries:
    places = np.array(matrix.places, dtype=np.int64).reshape(-1, 4)
    rows, columns = keys_of(path, places[:, 0], places[:, 1]), keys_of(path, places[:, 2], places[:, 3])
    return Entries(rows, columns, np.array(matrix.entries), path)
