"""Columns of numbers of .csv files: read by NumPy in blocks; what it refuses is looked at value by value.

The header says how values are separated: by commas, or else by semicolons or tabs, as programs of countries with
decimal commas do.  There a file has decimal points or decimal commas, not both.
"""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError
from ..files import csv_cells, open_regular
from ..identifiers import plain_path
from ..limits import LARGEST, MOST_ENTRIES
from ..names import show
from .measured_numbers import ALLOWED, within_limits

COLUMNS_RULE = "t, coordinates such as joint1.x, and with .rate, .acceleration or .drive behind them"
_MOST_BYTES = 1 << 27  # what takes a second to read, if its numbers have all their digits
_MOST_NUMBERS = 6_000_000  # so does this, if they are short
_TOO_MANY = f"these are too many numbers; allowed: up to {_MOST_NUMBERS} of a file"
_MOST_COLUMNS = 4 * MOST_ENTRIES
_BLOCK = 1 << 20  # bytes; a line may have as many, so that no line is too long to be looked at
_NUMBER = re.compile(r"\s*[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?\s*", re.ASCII)
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_MARKS = {",": "commas", ".": "points"}  # of decimals
_QUOTED = re.compile(r'"[^"]*"')
_BREAKS = "\r\n"


def read_csv(
    path: Path, *, rule: str = COLUMNS_RULE, blanks: bool = False
) -> tuple[dict[str, Array], NDArray[np.int32]]:
    """Return columns (T,) by the names in the header, and the line that each row stands on, (T,).

    Empty lines, and lines that begin with #, are left out.  Values are separated as the names in the header are: by
    commas, semicolons or tabs; the latter two allow decimal commas.  A file may have 128 MiB and 6 million numbers,
    which have the limits of ``measured_numbers``.

    Args:
        path: of the file.
        rule: what columns it may have, for messages.
        blanks: whether a cell may be empty, which is NaN then.

    Raises:
        InputError: the file cannot be opened, or is larger; or with line and column, what came and what is allowed.
    """
    try:
        with open_regular(path, _MOST_BYTES) as stream:
            _look_over(stream, plain_path(path))
            stream.seek(0)
            text = io.TextIOWrapper(stream, encoding="utf-8-sig", newline="")
            reader = _Reader(path, rule, blanks)
            while lines := text.readlines(4 * _BLOCK):
                reader.take(lines)
            return reader.columns()
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL
        raise InputError(f"{plain_path(path)}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _look_over(stream: BinaryIO, path: str) -> None:
    """Refuse in one pass what is no UTF-8, has a line that is too long, or more lines than can be read in a second.

    A line's length is measured in blocks: up to one is allowed, two are refused.
    """
    decoder = codecs.getincrementaldecoder("utf-8")()
    before, line = 0, 1
    for block in iter(lambda: stream.read(_BLOCK), b""):
        try:
            decoder.decode(block, len(block) < _BLOCK)
        except UnicodeDecodeError as error:
            at = before + len(block) - len(error.object) + error.start
            raise InputError(f"{path}: byte {at} is no UTF-8; allowed: UTF-8 text") from None
        breaks = max(block.count(b"\n"), block.count(b"\r"))
        if not breaks and len(block) == _BLOCK:
            raise InputError(f"{path}: line {line}: it has more than {_BLOCK} bytes; allowed: shorter lines")
        before, line = before + len(block), line + breaks
        if line > _MOST_NUMBERS:
            raise InputError(f"{path}: line {line}: {_TOO_MANY}")


class _Reader:
    """Lines of a file, taken block by block."""

    def __init__(self, path: Path, rule: str, blanks: bool) -> None:
        self._path, self._rule, self._blanks = plain_path(path), rule, blanks
        self._header: list[str] = []
        self._separator, self._mark = (
            ",",
            "",
        )  # between values; of decimals, once a value of a file with ; or tabs has one
        self._blank = _QUOTED  # an empty cell, once the separator is known
        self._rows = 0  # that were taken
        self._tables: list[Array] = []
        self._lines: list[NDArray[np.int32]] = []
        self._next = 1  # line that the next block begins with

    def take(self, lines: Sequence[str]) -> None:
        """Take whole lines."""
        first, self._next = self._next, self._next + len(lines)
        kept = [i for i, line in enumerate(lines) if line[0] not in _BREAKS and line.lstrip()[:1] != "#"]
        if kept and not self._header:
            self._header = self._names(f"{self._path}: line {first + kept[0]}", lines[kept.pop(0)])
        if not kept:
            return
        rows = list(lines) if len(kept) == len(lines) else [lines[i] for i in kept]
        numbers = np.array(kept, dtype=np.int32) + first
        self._rows += len(rows)
        if self._rows * len(self._header) > _MOST_NUMBERS:
            raise InputError(f"{self._path}: line {numbers[-1]}: {_TOO_MANY}")
        open_end = next((i for i, row in enumerate(rows) if row.count('"') % 2), None)
        if open_end is not None:  # NumPy would read on in the next line
            self._refuse(rows[open_end:], numbers[open_end:])
        if self._blanks:
            rows = [self._blank.sub("nan", row) for row in rows]
        pointed = rows if self._separator == "," else self._with_points(rows, numbers)
        try:
            table = np.loadtxt(pointed, delimiter=self._separator, comments=None, quotechar='"', ndmin=2)
        except ValueError:
            self._refuse(rows, numbers)
        if table.shape != (len(rows), len(self._header)) or not within_limits(table, blanks=self._blanks).all():
            self._refuse(rows, numbers)
        self._tables.append(table)
        self._lines.append(numbers)

    def _with_points(self, rows: list[str], numbers: NDArray[np.int32]) -> list[str]:
        """Return rows with decimal points; InputError where a file has both marks, so that 1,234 is ambiguous."""
        text = "".join(rows)
        present = [mark for mark in _MARKS if mark in text]
        self._mark = self._mark or next((mark for row in rows for mark in present if mark in row), "")
        for other in present:
            if other != self._mark:
                number = next(number for number, row in zip(numbers.tolist(), rows, strict=True) if other in row)
                raise InputError(
                    f"{self._path}: line {number}: decimal {_MARKS[other]} in a file with decimal"
                    f" {_MARKS[self._mark]}; allowed: one of both, and nothing between thousands"
                )
        return [row.replace(",", ".") for row in rows] if self._mark == "," else rows

    def columns(self) -> tuple[dict[str, Array], NDArray[np.int32]]:
        """Return columns and lines of all that was taken; InputError where it has no rows."""
        if not self._tables:
            raise InputError(f"{self._path}: has no values; allowed: a header ({self._rule}), then a line for each row")
        table = np.empty((len(self._header), sum(map(len, self._tables))))
        np.concatenate([block.T for block in self._tables], axis=1, out=table)
        return dict(zip(self._header, table, strict=True)), np.concatenate(self._lines)

    def _names(self, place: str, line: str) -> list[str]:
        bare = _QUOTED.sub("", line.strip())
        separators = [mark for mark in ",;" if mark in bare] or ["\t" if "\t" in bare else ","]
        if len(separators) > 1:
            raise InputError(f"{place}: has , and ; between names; allowed: one of commas, semicolons and tabs")
        [self._separator] = separators
        self._blank = _empty_cell(self._separator)
        names = [name.strip() for name in csv_cells(place, line, self._separator)]
        if len(names) > _MOST_COLUMNS:
            raise InputError(f"{place}: {len(names)} columns; allowed: up to {_MOST_COLUMNS}")
        seen: set[str] = set()
        for i, name in enumerate(names, 1):
            if name in seen:
                raise InputError(f"{place}: column {i}: {show(name)} is there twice; allowed: once")
            seen.add(name)
        return names

    def _refuse(self, rows: Sequence[str], numbers: NDArray[np.int32]) -> NoReturn:
        """Raise the InputError of the first row that is wrong."""
        for number, row in zip(numbers.tolist(), rows, strict=True):
            place = f"{self._path}: line {number}"
            cells = csv_cells(place, row, self._separator)
            if len(cells) != len(self._header):
                more = ", as in the header" + (", and decimal points" if self._separator == "," else "")
                raise InputError(
                    f"{place}: {len(cells)} values; allowed: {len(self._header)}, one for each column, with"
                    f" {_SEPARATORS[self._separator]} between them{more}"
                )
            for name, cell in zip(self._header, cells, strict=True):
                if self._blanks and cell == "nan":
                    continue
                number = cell.replace(",", ".") if self._mark == "," else cell
                if not (_NUMBER.fullmatch(number) and abs(float(number)) <= LARGEST):
                    raise InputError(f"{place}: column {show(name)}: {show(cell.strip())}; allowed: {ALLOWED}")
        raise InputError(
            f"{self._path}: lines {numbers[0]} to {numbers[-1]} are no numbers; allowed: numbers, each {ALLOWED}"
        )


def _empty_cell(separator: str) -> re.Pattern[str]:
    """Return what finds cells without a value in a line."""
    spaces = " \t".replace(separator, "")
    return re.compile(f"(?:(?<={separator})|(?<=^))[{spaces}]*(?={separator}|\\r?\\n?$)")
