"""Nastran: matrices as DMIG entries, as punch files have them, and nodes as GRID entries.

Fields are small (8 characters), large (16, a star behind the name) or free (commas).  A DMIG entry has its name, node
and component of the column, and in further fields node, component and entry of each row; the header has 0 in the place
of the node, and form 6 of a symmetric matrix, of which one triangle is there.  Points without a component (SPOINT) are
amplitudes of modes.  Sources: MSC Nastran Quick Reference Guide, and the references of OptiStruct and Autodesk Nastran,
DMIG and GRID.  ``op4`` reads files of OUTPUT4.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...names import plain_path
from ..finite_elements import MOST_ENTRIES, MOST_NODES, MOST_ROWS
from .contents import Entries, Nodes, keys_of
from .text import SMALLER, lines_of, number_of, refusal

_SMALL, _LARGE = 8, 16
_SYMMETRIC, _SQUARE = 6, 1
_MOST_FIELDS = 4 * (MOST_ROWS + 1)  # of an entry: a full column


@dataclass
class _Card:
    """An entry of bulk data: the line where it begins, and its fields without names of continuations."""

    line: int
    name: str
    fields: list[str]


@dataclass
class _Matrix:
    """A matrix as it is read: node, component, node and component of each entry, and the entries."""

    form: int
    places: array[int] = field(default_factory=lambda: array("i"))
    entries: array[float] = field(default_factory=lambda: array("d"))


def read(path: Path) -> tuple[Nodes, dict[str, Entries]]:
    """Return the nodes of a file of bulk data, and its matrices: the one whose name begins with K, and with M.

    Raises:
        InputError: an entry has something else, nodes stand in systems of coordinates, or two matrices begin alike.
    """
    labels, places, matrices = list[int](), list[list[float]](), dict[str, _Matrix]()
    for card in _cards(path):
        if card.name == "GRID":
            labels.append(_node(path, card, places))
            if len(labels) > MOST_NODES:
                raise refusal(path, card.line, f"more than {MOST_NODES} nodes", f"up to that, {SMALLER}")
        elif card.name == "DMIG":
            _take(path, card, matrices)
    nodes = Nodes(np.array(labels, dtype=np.int64), np.array(places).reshape(-1, 3))
    found: dict[str, Entries] = {}
    for letter in ("K", "M"):
        names = [name for name in matrices if name.startswith(letter)]
        if len(names) > 1:
            raise InputError(
                f"{plain_path(path)}: has the matrices {', '.join(names)}; allowed: one that begins with {letter}"
            )
        if names:
            found[letter] = _entries(path, matrices[names[0]])
    return nodes, found


def _cards(path: Path) -> Iterator[_Card]:
    """Yield the entries of bulk data, GRID and DMIG alone, with their continuations."""
    card: _Card | None = None
    for line, text in lines_of(path):
        text = text.split("$")[0].rstrip()
        if not text:
            continue
        fields = _fields(text)
        name = fields[0].strip().rstrip("*").upper()
        if name and name[0] not in "+*":
            if card is not None:
                yield card
            card = _Card(line, name, fields[1:]) if name in ("GRID", "DMIG") else None
        elif card is not None:
            card.fields += fields[1:]
            if len(card.fields) > _MOST_FIELDS:
                raise refusal(path, line, f"more than {_MOST_FIELDS} fields of {card.name}", "up to that")
    if card is not None:
        yield card


def _fields(text: str) -> list[str]:
    """Return the first field of a line, and the four or eight behind it."""
    if "," in text:
        words = text.split(",")
        count = 4 if words[0].strip().endswith("*") or words[0].startswith("*") else 8
        return (words + [""] * count)[: count + 1]
    text = text.expandtabs(_SMALL)
    first = text[:_SMALL]
    width = _LARGE if "*" in first else _SMALL
    count = 4 * _LARGE // width
    return [first] + [text[_SMALL + k * width : _SMALL + (k + 1) * width] for k in range(count)]


def _whole(path: Path, card: _Card, text: str, default: int | None = None) -> int:
    word = text.strip()
    if not word and default is not None:
        return default
    if not (word.isdecimal() and len(word) < 10):
        raise refusal(path, card.line, word, f"a whole number in {card.name}")
    return int(word)


def _node(path: Path, card: _Card, places: list[list[float]]) -> int:
    """Take a GRID entry: its place into ``places``; return its number."""
    fields = (card.fields + [""] * 6)[:6]
    for system, where in ((fields[1], "CP"), (fields[5], "CD")):
        if system.strip() not in ("", "0"):
            raise refusal(
                path, card.line, f"{where} = {system.strip()}", "0 or nothing: nodes and directions in basic axes"
            )
    place = [number_of(word) if word.strip() else 0.0 for word in fields[2:5]]
    numbers = [number for number in place if number is not None]
    if len(numbers) != 3:
        raise refusal(
            path, card.line, ", ".join(word.strip() for word in fields[2:5]), "three finite numbers, x, y and z"
        )
    places.append(numbers)
    return _whole(path, card, fields[0])


def _take(path: Path, card: _Card, matrices: dict[str, _Matrix]) -> None:
    """Take a DMIG entry, a header or a column, into the matrix of its name."""
    fields = card.fields + [""] * (-len(card.fields) % 4)
    name = fields[0].strip().upper()
    if fields[1].strip() == "0":
        form, kind = _whole(path, card, fields[2]), _whole(path, card, fields[3])
        if form not in (_SYMMETRIC, _SQUARE) or kind > 2:
            raise refusal(path, card.line, f"form {form}, type {kind}", "form 6 or 1, square, and type 1 or 2, real")
        matrices[name] = _Matrix(form)
        return
    matrix = matrices.get(name)
    if matrix is None:
        raise refusal(path, card.line, name, "a header of the matrix before its columns")
    column = _whole(path, card, fields[1]), _whole(path, card, fields[2], 0)
    for start in range(4, len(fields), 4):
        node, component, entry = fields[start : start + 3]
        if not node.strip() and not entry.strip():
            continue
        number = number_of(entry)
        if number is None:
            raise refusal(
                path, card.line, entry.strip(), f"a finite number in the column of node {column[0]}, {column[1]}"
            )
        matrix.places.extend((_whole(path, card, node), _whole(path, card, component, 0), *column))
        matrix.entries.append(number)
    if len(matrix.entries) > MOST_ENTRIES:
        raise refusal(path, card.line, f"more than {MOST_ENTRIES} entries of {name}", "up to that")


def _entries(path: Path, matrix: _Matrix) -> Entries:
    places = np.array(matrix.places, dtype=np.int64).reshape(-1, 4)
    rows, columns = keys_of(path, places[:, 0], places[:, 1]), keys_of(path, places[:, 2], places[:, 3])
    return Entries(rows, columns, np.array(matrix.entries), path)
