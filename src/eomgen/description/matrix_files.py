"""Matrices out of files beside a description: Matrix Market, arrays of NumPy, and CSV.

Matrix Market is read as its authors define it (R. Boisvert, R. Pozo, K. Remington, "The Matrix Market Exchange
Formats", NISTIR 5935, 1996): arrays by columns or coordinates of entries, real or integer, general or symmetric.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..forms.toml_text import read_text
from ..limits import LARGEST
from ..names import show
from ..robot.elements.matrices import Matrix
from ..robot.value import COORDINATES

ENDINGS = (".mtx", ".npz", ".csv")
NAMED = "K"  # of the array of a .npz that has several
ROWS = len(COORDINATES)
_KIND = "file of a matrix, of one to six rows"
_MOST_NPZ = 1 << 20  # bytes of all arrays
_BANNER = ("%%matrixmarket", "matrix")
_FORMATS, _FIELDS, _SYMMETRIES = ("array", "coordinate"), ("real", "integer"), ("general", "symmetric")
_HEADER = f"%%MatrixMarket matrix {' or '.join(_FORMATS)} {' or '.join(_FIELDS)} {' or '.join(_SYMMETRIES)}"
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_DIGITS = re.compile(r"\d{1,9}", re.ASCII)
_ALLOWED_ROWS = f"1 to {ROWS} rows of as many numbers"


@dataclass(frozen=True)
class FileMatrix:
    """A matrix, (n, n), and the names of its rows where the file has them, else ()."""

    rows: Matrix
    names: tuple[str, ...] = ()


def read_matrix(path: Path) -> FileMatrix:
    """Read the square matrix of a file, of one to six rows.

    Args:
        path: of a .mtx; of a .npz with one array, or with one of the name K, and perhaps the names of its rows as
            ``coordinates``; or of a .csv of its rows, perhaps behind a line of their names.

    Raises:
        InputError: the file cannot be read, or has no such matrix; the message has the file, and the line of a text.
    """
    if path.suffix == ".npz":
        return _of_arrays(path)
    lines = _lines_of(path)
    return _market(path, lines) if path.suffix == ".mtx" else _csv(path, lines)


def _lines_of(path: Path) -> list[str]:
    return read_text(path, str(path), _KIND).splitlines()


def _refusal(path: Path, line: int, got: object, allowed: str) -> InputError:
    return InputError(f"{path}, line {line}: got {show(got)}; allowed: {allowed}")


def _number(path: Path, line: int, text: str) -> float:
    number = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not abs(number) <= LARGEST:
        raise _refusal(path, line, text, f"a finite number of magnitude up to {LARGEST:g}")
    return number


def _market(path: Path, lines: list[str]) -> FileMatrix:
    """Return the matrix of a file of Matrix Market."""
    header = lines[0].split() if lines else []
    words = tuple(word.lower() for word in header)
    known = len(words) == 5 and words[:2] == _BANNER
    if not (known and words[2] in _FORMATS and words[3] in _FIELDS and words[4] in _SYMMETRIES):
        raise _refusal(path, 1, lines[0] if lines else "", f"a header {_HEADER}")
    is_symmetric = words[4] == "symmetric"
    rest = ((k, text.split()) for k, text in enumerate(lines[1:], 2) if text.strip() and text.lstrip()[0] != "%")
    line, sizes = next(rest, (len(lines), []))
    counts = 2 if words[2] == "array" else 3
    if len(sizes) != counts or not all(_DIGITS.fullmatch(word) for word in sizes):
        what = "rows and columns" if counts == 2 else "rows, columns and entries"
        raise _refusal(path, line, " ".join(sizes), f"a line with the numbers of {what}")
    n, columns = int(sizes[0]), int(sizes[1])
    if n != columns or not 1 <= n <= ROWS:
        raise _refusal(path, line, " ".join(sizes), f"a square matrix of 1 to {ROWS} rows")
    if counts == 3:
        return FileMatrix(_by_places(path, rest, n, int(sizes[2]), len(lines), is_symmetric=is_symmetric))
    places = [(i, j) for j in range(n) for i in range(j if is_symmetric else 0, n)]
    rows, left = [[0.0] * n for _ in range(n)], iter(places)
    for line, words_of in rest:
        place = next(left, None)
        if len(words_of) != 1 or place is None:
            what = f"a number a line, {len(places)} of them"
            raise _refusal(path, line, " ".join(words_of), what)
        _set(rows, place, _number(path, line, words_of[0]), is_symmetric=is_symmetric)
    _refuse_missing(path, len(lines), sum(1 for _ in left), len(places))
    return FileMatrix(rows)


def _by_places(
    path: Path, rest: Iterator[tuple[int, list[str]]], n: int, count: int, last: int, *, is_symmetric: bool
) -> Matrix:
    """Return the matrix of lines of row, column and entry, which are counted from 1."""
    rows, seen = [[0.0] * n for _ in range(n)], set[tuple[int, int]]()
    for line, words in rest:
        text = " ".join(words)
        if len(seen) == count:
            raise _refusal(path, line, text, f"{count} entries, as the file says of itself")
        inside = len(words) == 3 and all(_DIGITS.fullmatch(x) and 1 <= int(x) <= n for x in words[:2])
        if not inside:
            raise _refusal(path, line, text, f"a row and a column, each from 1 to {n}, and their number")
        i, j = int(words[0]) - 1, int(words[1]) - 1
        place = (max(i, j), min(i, j)) if is_symmetric else (i, j)
        if place in seen:
            twice = ", and only one half of a symmetric matrix" if is_symmetric else ""
            raise _refusal(path, line, text, f"each entry once{twice}")
        seen.add(place)
        _set(rows, place, _number(path, line, words[2]), is_symmetric=is_symmetric)
    _refuse_missing(path, last, count - len(seen), count)
    return rows


def _set(rows: Matrix, place: tuple[int, int], number: float, *, is_symmetric: bool) -> None:
    i, j = place
    rows[i][j] = number
    if is_symmetric:
        rows[j][i] = number


def _refuse_missing(path: Path, last: int, missing: int, count: int) -> None:
    if missing:
        raise InputError(f"{path}, line {last}: the file ends after {count - missing} numbers; allowed: {count}")


def _csv(path: Path, lines: list[str]) -> FileMatrix:
    """Return the matrix of lines of numbers with commas between them."""
    rows, names = Matrix(), tuple[str, ...]()
    for line, text in enumerate(lines, 1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in text.split(",")]
        if not rows and not names and set(cells) <= set(COORDINATES):
            names = tuple(cells)
            continue
        width = len(names) or len(rows[0] if rows else cells)
        if len(cells) != width or not width <= ROWS:
            allowed = f"{width} numbers with commas between them" if width <= ROWS else _ALLOWED_ROWS
            raise _refusal(path, line, text, allowed)
        if len(rows) == width:
            raise _refusal(path, line, text, f"{width} rows")
        rows.append([_number(path, line, cell) for cell in cells])
    width = len(names or (rows or [[]])[0])
    if not rows or len(rows) != width:
        allowed = f"{width} rows of {width} numbers" if width else _ALLOWED_ROWS
        raise InputError(f"{path}, line {len(lines)}: the file ends after {len(rows)} rows; allowed: {allowed}")
    return FileMatrix(rows, names)


def _of_arrays(path: Path) -> FileMatrix:
    """Return the matrix of a file of arrays."""
    import numpy as np  # only who has such a file pays for NumPy

    from ..npz import read_npz

    arrays = read_npz(path, most=_MOST_NPZ)
    name = NAMED if NAMED in arrays or len(arrays) != 1 else next(iter(arrays))
    if name not in arrays:
        found = ", ".join(map(show, list(arrays)[:ROWS])) or "none"
        raise InputError(f"{path}: has the arrays {found}; allowed: one array, or one of the name {NAMED}")
    array, place = arrays[name], f"{path}: array {show(name)}"
    if array.dtype.kind not in "iuf":
        raise InputError(f"{place}: has dtype {array.dtype}; allowed: numbers")
    if array.ndim != 2 or array.shape[0] != array.shape[1] or not 1 <= len(array) <= ROWS:
        raise InputError(f"{place}: has shape {array.shape}; allowed: (n, n) with n from 1 to {ROWS}")
    with np.errstate(over="ignore"):  # of wider numbers
        numbers = array.astype(np.float64)
    within = np.abs(numbers) <= LARGEST
    if not within.all():
        i, j = np.argwhere(~within)[0].tolist()
        got = f"{numbers[i, j]:g} in row {i + 1}, column {j + 1}"
        raise InputError(f"{place}: got {got}; allowed: finite numbers of magnitude up to {LARGEST:g}")
    return FileMatrix((numbers + 0.0).tolist(), _names_among(path, arrays.get("coordinates")))


def _names_among(path: Path, names: Any) -> tuple[str, ...]:
    """Return the names of rows of an array of texts; () where there is none."""
    if names is None:
        return ()
    found = tuple(map(str, names.ravel()[: ROWS + 1].tolist()))
    if not set(found) <= set(COORDINATES):
        raise InputError(f"{path}: array 'coordinates': got {show(list(found))}; allowed: {', '.join(COORDINATES)}")
    return found
