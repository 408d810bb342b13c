"""Nastran: matrices of OUTPUT4 (.op4), ASCII or binary, dense or sparse, the rows of which another file names.

Each matrix has a heading (columns, rows, negative where strings say their rows in words of their own, form, type, name,
and in ASCII a FORTRAN format) and a record of each column that is not 0: its number, the row of its first entry, how
many words its entries have, one of single and two of double precision.  Row 0 says that strings of entries follow: each
with IS = row + 65536 (words + 1), or with words + 1 and row where rows are negative or more than 65535.  A column
behind the last one ends the matrix.  Binary files have these as FORTRAN records, with a length of four bytes on both
sides, in either order of bytes.  Source: NX Nastran DMAP Programmer's Guide, OUTPUT4.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from struct import unpack
from typing import BinaryIO

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...identifiers import plain_path
from ..finite_elements import MOST_ENTRIES, MOST_ROWS
from .contents import Entries, Labels
from .selection import Selection
from .text import Line, lines_of, number_of, opened, refusal

_PACKED = 65536
_SQUARE, _SYMMETRIC = 1, 6
_WORDS = {1: 1, 2: 2}  # of an entry by its type: real, of single and of double precision
_HEADING, _LONG_HEADING = 24, 48  # bytes, of words of 32 and 64 bits
_FORMAT = re.compile(r"\(?1P,?[0-9]{0,2}[ED]([0-9]{1,2})\.[0-9]{1,2}\)?")
_ALLOWED = "what OUTPUT4 writes"


@dataclass
class _Matrix:
    """A matrix as it is read: its heading, and rows, columns and entries of the parts that were read."""

    where: str
    columns: int
    rows: int
    form: int
    kind: int
    name: str
    is_kept: bool = False
    of_rows: array[int] = field(default_factory=lambda: array("i"))
    of_columns: array[int] = field(default_factory=lambda: array("i"))
    entries: array[float] = field(default_factory=lambda: array("d"))

    @property
    def is_big(self) -> bool:
        """Whether strings say their rows in words of their own."""
        return self.rows < 0 or self.rows >= _PACKED

    def offer(self, selection: Selection) -> None:
        """Keep the matrix if the selection wants it; InputError if it is no square matrix of real numbers then."""
        size = abs(self.rows)
        is_square = size == self.columns and 1 <= size <= MOST_ROWS and self.form in (_SQUARE, _SYMMETRIC)
        fits = is_square and self.kind in _WORDS
        self.is_kept = selection.wants(self.name, fits)
        if self.is_kept and not fits:
            got = f"{size} rows, {self.columns} columns, form {self.form}, type {self.kind}"
            allowed = f"square up to {MOST_ROWS} rows, form 1 or 6, type 1 or 2, real"
            raise InputError(f"{self.where}: {self.name} has {got}; allowed: {allowed}")

    def add(self, where: str, column: int, row: int, entries: Array) -> None:
        """Add entries of a column from a row on."""
        if not (1 <= column <= self.columns and row >= 1 and row + len(entries) - 1 <= abs(self.rows)):
            got = f"{len(entries)} entries from row {row} on in column {column}"
            raise InputError(f"{where}: got {got}; allowed: within {abs(self.rows)} rows, {self.columns} columns")
        if len(self.entries) + len(entries) > MOST_ENTRIES:
            raise InputError(f"{where}: more than {MOST_ENTRIES} entries of {self.name}; allowed: up to that")
        self.of_rows.extend(range(row, row + len(entries)))
        self.of_columns.extend([column] * len(entries))
        self.entries.frombytes(np.ascontiguousarray(entries, dtype=np.float64).tobytes())

    def by_keys(self, path: Path, keys: Labels) -> Entries:
        """Return its entries by the keys of its rows."""
        if len(keys) != self.columns:
            got = f"{self.name} has {self.columns} rows, and {len(keys)} have names"
            raise InputError(f"{plain_path(path)}: {got}; allowed: a .dof or .mapping file with all its rows")
        rows, columns = (np.array(x) - 1 for x in (self.of_rows, self.of_columns))
        return Entries(keys[rows], keys[columns], np.array(self.entries), path)


def read_matrices(path: Path, keys: Labels, selection: Selection) -> dict[str, Entries]:
    """Return the matrices of a file by the roles of the selection, as far as it has them.

    Args:
        path: of the file.
        keys: of the rows, in the order of the matrices.
        selection: which of its matrices are read.

    Raises:
        InputError: it is no such file or ends early, or several matrices may be meant; the message has the place.
    """
    with opened(path) as stream:
        start = stream.read(4)
        order = next((x for x in ("little", "big") if int.from_bytes(start, x) in (_HEADING, _LONG_HEADING)), "")
        stream.seek(0)
        if order:
            found = _binary(path, stream, "<" if order == "little" else ">", selection)
        else:
            found = _ascii(path, selection)
    return {role: found[number].by_keys(path, keys) for role, number in selection.chosen().items()}


def _ascii(path: Path, selection: Selection) -> list[_Matrix]:
    """Return the matrices of a file in ASCII, without entries where they are not asked for."""
    matrices: list[_Matrix] = []
    lines = (line for line in lines_of(path) if line[1].strip())
    for heading in lines:
        matrix, width = _heading(path, heading)
        matrix.offer(selection)
        matrices.append(matrix)
        _columns(path, lines, matrix, width)
    return matrices


def _heading(path: Path, line: Line) -> tuple[_Matrix, int]:
    """Return a matrix without entries, and how many characters an entry has."""
    number, text = line
    words = [text[8 * k : 8 * k + 8].strip() for k in range(5)]
    width = _FORMAT.fullmatch(text[40:].strip().upper())
    if width is None or not int(width[1]) or not all(re.fullmatch(r"-?[0-9]{1,8}", word) for word in words[:4]):
        raise refusal(path, number, text, f"columns, rows, form, type, name and format, {_ALLOWED}")
    columns, rows, form, kind = (int(word) for word in words[:4])
    where = f"{plain_path(path)}, line {number}"
    return _Matrix(where, columns, rows, form, kind, words[4].upper()), int(width[1])


def _columns(path: Path, lines: Iterator[Line], matrix: _Matrix, width: int) -> None:
    """Read the columns of a matrix, up to the one that ends it."""
    column, row, line, words = 0, 0, 0, 0  # where entries go, the line that says so, and how many words they have
    each = _WORDS.get(matrix.kind, 1)
    entries = array("d")

    def wrong() -> InputError:
        got = f"{words} words, and {len(entries)} entries behind it"
        return refusal(path, line, got, f"{each} words of an entry, as its type is {matrix.kind}")

    def keep() -> None:
        if column > matrix.columns or not (entries or words):
            return
        if matrix.is_kept and words not in (len(entries), each * len(entries)):  # some writers count entries
            raise wrong()
        if matrix.is_kept:
            matrix.add(f"{plain_path(path)}, line {line}", column, row, np.array(entries))
        del entries[:]

    for number, text in lines:
        if "." in text:
            if column > matrix.columns:
                return
            if not matrix.is_kept:
                continue
            found = [number_of(text[k : k + width]) for k in range(0, len(text.rstrip()), width)]
            entries.extend(x for x in found if x is not None)
            if None in found or row == 0:
                raise refusal(path, number, text.strip(), f"finite numbers of {width} characters behind their row")
            if len(entries) > min(words, abs(matrix.rows)):
                raise wrong()
            continue
        keep()
        says = [int(word) for word in text.split() if re.fullmatch(r"[0-9]{1,10}", word)]
        if len(says) != len(text.split()) or (len(says) != 3 and (column == 0 or len(says) != 1 + matrix.is_big)):
            raise refusal(path, number, text.strip(), "column, row and words, or the row of a string of entries")
        line = number
        if len(says) == 3:
            column, row, words = says[0], says[1], says[2] if says[1] else 0
        else:
            row, words = _string(says)
    raise InputError(f"{plain_path(path)}: ends in {matrix.name}; allowed: up to column {matrix.columns + 1}, its end")


def _string(says: list[int]) -> tuple[int, int]:
    """Return the row where a string of entries begins, and its words."""
    if len(says) == 2:
        return says[1], says[0] - 1
    packed, row = divmod(says[0], _PACKED)
    return row, packed - 1


def _records(path: Path, stream: BinaryIO, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield the records of a binary file: where each begins, and what it has."""
    while ends := stream.read(4):
        at = stream.tell() - 4
        length = unpack(f"{order}i", ends)[0] if len(ends) == 4 else -1
        if not 12 <= length <= 16 * (MOST_ROWS + 1):
            raise InputError(f"{plain_path(path)}, byte {at}: has a record of length {length}; allowed: {_ALLOWED}")
        data = stream.read(length)
        if len(data) < length or stream.read(4) != ends:
            raise InputError(f"{plain_path(path)}, byte {at}: has a record that does not end; allowed: {_ALLOWED}")
        yield at, data


def _binary(path: Path, stream: BinaryIO, order: str, selection: Selection) -> list[_Matrix]:
    """Return the matrices of a binary file, ``order`` its order of bytes."""
    matrices: list[_Matrix] = []
    records = _records(path, stream, order)
    for at, data in records:
        where = f"{plain_path(path)}, byte {at}"
        if len(data) != _HEADING:
            words = "words of 64 bits" if len(data) == _LONG_HEADING else f"a heading of {len(data)} bytes"
            raise InputError(f"{where}: has {words}; allowed: words of 32 bits, with a heading of {_HEADING} bytes")
        columns, rows, form, kind, text = unpack(f"{order}4i8s", data)
        name = text.decode("ascii", "replace").strip().upper()
        matrix = _Matrix(where, columns, rows, form, kind, name)
        matrix.offer(selection)
        matrices.append(matrix)
        for start, record in records:
            column, row, words = unpack(f"{order}3i", record[:12])
            if column == matrix.columns + 1:
                break
            place = f"{plain_path(path)}, byte {start}"
            if len(record) != 12 + 4 * words:
                raise InputError(f"{place}: has {len(record) - 12} bytes for {words} words; allowed: {_ALLOWED}")
            if matrix.is_kept and row:
                matrix.add(place, column, row, _entries(place, record[12:], matrix.kind, order))
            elif matrix.is_kept:
                _strings(place, record[12:], matrix, column, order)
        else:
            raise InputError(f"{plain_path(path)}: ends in {name}; allowed: up to column {columns + 1}, its end")
    return matrices


def _strings(place: str, data: bytes, matrix: _Matrix, column: int, order: str) -> None:
    """Add the strings of entries of a column in a binary file."""
    head = 2 if matrix.is_big else 1
    at = 0
    while at < len(data):
        begin = at + 4 * head
        row, words = _string(list(unpack(f"{order}{head}i", data[at:begin]))) if begin <= len(data) else (0, 0)
        at = begin + 4 * words
        if words < 1 or at > len(data):
            raise InputError(f"{place}: has a string of {words} words in column {column}; allowed: {_ALLOWED}")
        matrix.add(place, column, row, _entries(place, data[begin:at], matrix.kind, order))


def _entries(place: str, data: bytes, kind: int, order: str) -> Array:
    """Return the entries of a record, by their type."""
    size = 4 * _WORDS[kind]
    if len(data) % size:
        raise InputError(f"{place}: has {len(data)} bytes of entries; allowed: {size} for each, as its type is {kind}")
    return np.frombuffer(data, dtype=f"{order}f{size}").astype(np.float64)
