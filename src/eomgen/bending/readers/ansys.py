"""Ansys Mechanical APDL: matrices of the .full file as text, and the mapping of their rows.

*EXPORT writes Matrix Market (MMF); HBMAT writes Harwell-Boeing, ASCII, and with its option Mapping JOB.mapping: a line
for each row with its number, its node and UX, UY, UZ, ROTX, ROTY or ROTZ.  Sources: Mechanical APDL Command Reference,
*EXPORT and HBMAT; R. Boisvert, R. Pozo, K. Remington, "The Matrix Market Exchange Formats", NISTIR 5935, 1996; I. Duff,
R. Grimes, J. Lewis, "Users' Guide for the Harwell-Boeing Sparse Matrix Collection", TR/PA/92/86, CERFACS, 1992.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...identifiers import plain_path
from ...names import show
from ..finite_elements import MOST_ENTRIES, MOST_ROWS
from .calculix import WHAT, by_numbers
from .contents import Entries, Labels, keys_of
from .text import SMALLER, Line, integers, lines_of, number_of, refusal, rows_of_numbers

DIRECTIONS = ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")
BANNER = "%%matrixmarket"
_HEADER = "%%MatrixMarket matrix coordinate real symmetric or general"
_FORMAT = re.compile(r"\((?:[0-9]{1,3}P,?)?([0-9]{0,4})[IEDFG]([0-9]{1,3})(?:\.[0-9]{1,3})?(?:E[0-9]{1,3})?\)")


def read_mapping(path: Path) -> Labels:
    """Return the keys of all rows of a .mapping file, in the order of rows; lines before the first row are its
    heading."""
    labels, directions = array("q"), array("q")
    for line, text in lines_of(path):
        words = text.split()
        is_row = len(words) == 3 and words[0].isdecimal() and words[1].isdecimal() and words[2].upper() in DIRECTIONS
        if not is_row:
            if labels and words:
                raise refusal(path, line, text.strip(), f"row, node and one of {', '.join(DIRECTIONS)}")
            continue
        if int(words[0][:16]) != len(labels) + 1:
            raise refusal(path, line, text.strip(), f"row {len(labels) + 1} next")
        if len(labels) == MOST_ROWS:
            raise refusal(path, line, f"more than {MOST_ROWS} rows", f"up to that, {SMALLER}")
        labels.append(int(words[1][:16]))
        directions.append(DIRECTIONS.index(words[2].upper()) + 1)
    if not labels:
        raise InputError(
            f"{plain_path(path)}: has no line of a row; allowed: row, node and one of {', '.join(DIRECTIONS)}"
        )
    return keys_of(path, np.array(labels, dtype=np.int64), np.array(directions, dtype=np.int64))


def read_matrix(path: Path, keys: Labels) -> Entries:
    """Return a matrix in Matrix Market or Harwell-Boeing format, by the keys of its rows."""
    lines = lines_of(path)
    first = next(lines, (1, ""))
    table = _market(path, first, lines) if first[1].lower().startswith(BANNER) else _harwell_boeing(path, lines)
    return by_numbers(path, table, keys)


def _market(path: Path, first: Line, lines: Iterator[Line]) -> Array:
    """Return row, column and entry of a file of Matrix Market."""
    words = first[1].lower().split()
    known = len(words) == 5 and words[1:3] == ["matrix", "coordinate"] and words[3] in ("real", "integer")
    if not known or words[4] not in ("symmetric", "general"):
        raise refusal(path, 1, first[1], f"a header {_HEADER}")
    rest = (line for line in lines if line[1].strip() and not line[1].lstrip().startswith("%"))
    number, text = next(rest, (1, ""))
    sizes = text.split()
    if len(sizes) != 3 or not all(size.isdecimal() and len(size) < 12 for size in sizes):
        raise refusal(path, number, text, "numbers of rows, columns and entries")
    rows, columns, count = (int(size) for size in sizes)
    if rows != columns or rows > MOST_ROWS or count > MOST_ENTRIES:
        raise refusal(path, number, text, f"a square matrix of up to {MOST_ROWS} rows and {MOST_ENTRIES} entries")
    table = rows_of_numbers(path, rest, 3, WHAT)
    if len(table) != count:
        raise InputError(f"{plain_path(path)}: has {len(table)} entries; allowed: {count}, as line {number} says")
    return table


def _harwell_boeing(path: Path, lines: Iterator[Line]) -> Array:
    """Return row, column and entry of an assembled matrix in Harwell-Boeing format, whose first line has been read."""
    header = [line for _, line in zip(range(3), lines, strict=False)]
    if len(header) < 3:
        raise InputError(f"{plain_path(path)}: ends in its heading; allowed: Matrix Market, or Harwell-Boeing in ASCII")
    cards = _whole(path, header[0], 4, "numbers of lines: of all, pointers, rows, entries")
    kind = header[1][1][:3].upper()
    sizes = _whole(path, (header[1][0], header[1][1][3:]), 3, "a kind RSA or RUA, rows, columns, entries")
    if kind not in ("RSA", "RUA"):
        raise refusal(path, header[1][0], header[1][1], "a kind RSA or RUA: real, symmetric or not, assembled")
    rows, columns, count = sizes[:3]
    if rows != columns or not 1 <= rows <= MOST_ROWS or count > MOST_ENTRIES:
        raise refusal(
            path, header[1][0], header[1][1], f"a square matrix of 1 to {MOST_ROWS} rows, {MOST_ENTRIES} entries"
        )
    formats = _FORMAT.findall("".join(header[2][1].upper().split()))
    if len(formats) < 3:
        raise refusal(
            path, header[2][0], header[2][1], "formats of pointers, rows and entries, as (10I8) (10I8) (4D20.12)"
        )
    if len(cards) > 4 and cards[4] > 0:
        next(lines, None)  # the line that describes right-hand sides
    wanted = (columns + 1, count, count)
    parts = []
    for card, (_, width), want in zip(cards[1:4], formats, wanted, strict=False):
        parts.append(_fixed(path, islice(lines, card), int(width), want))
    pointers, of_rows = integers(path, parts[0], "pointer"), integers(path, parts[1], "row")
    if pointers[0] != 1 or pointers[-1] != count + 1 or np.any(np.diff(pointers) < 0):
        raise InputError(
            f"{plain_path(path)}: got pointers {pointers[0]} to {pointers[-1]}; allowed: 1 to {count + 1}, rising"
        )
    of_columns = np.repeat(np.arange(1, columns + 1), np.diff(pointers))
    return np.column_stack([of_rows, of_columns, parts[2]])


def _whole(path: Path, line: Line, least: int, what: str) -> list[int]:
    """Return the whole numbers of a line."""
    words = line[1].split()
    if len(words) < least or not all(word.isdecimal() and len(word) < 12 for word in words):
        raise refusal(path, line[0], line[1].strip(), what)
    return [int(word) for word in words]


def _fixed(path: Path, lines: Iterator[Line], width: int, count: int) -> Array:
    """Return so many numbers of lines of fixed width."""
    if width < 1:
        raise InputError(f"{plain_path(path)}: has a format of width {width}; allowed: 1 or more")
    numbers = array("d")
    for line, text in lines:
        for start in range(0, len(text.rstrip()), width):
            number = number_of(text[start : start + width])
            if number is None or len(numbers) == count:
                got = text[start : start + width]
                raise refusal(path, line, got, f"{count} finite numbers, each {width} characters wide")
            numbers.append(number)
    if len(numbers) != count:
        raise InputError(
            f"{plain_path(path)}: has {len(numbers)} numbers of {show(count)}; allowed: as many as it says"
        )
    return np.array(numbers)
