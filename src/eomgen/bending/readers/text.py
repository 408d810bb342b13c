"""Texts of finite elements, line by line: bounded in size, and refused with the line where something is wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...files import open_regular
from ...identifiers import plain_path
from ...names import show
from ...npz import most_bytes
from ..finite_elements import MOST_ENTRIES

VARIABLE = "EOMGEN_MATRIX_MB"  # of the environment: megabytes that a text of finite elements may have
_MOST_MB = 2048
_MOST_LINE = 4096  # bytes
_CHUNK = 20_000  # lines that are made numbers at a time
SMALLER = "reduce larger models where they are made"

Line = tuple[int, str]  # its number from 1 on, and its text without the end


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file of finite elements to be read.

    Raises:
        InputError: it cannot be read, or is larger than the environment's EOMGEN_MATRIX_MB says (2048).
    """
    try:
        with open_regular(path, most_bytes(VARIABLE, _MOST_MB)) as stream:
            yield stream
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        more = "" if "allowed: " in reason else "; allowed: an existing file"
        size = f" (the environment's {VARIABLE} has their MB)" if "bytes" in reason else ""
        raise InputError(f"{plain_path(path)}: cannot be read: {reason}{more}{size}") from None


def lines_of(path: Path) -> Iterator[Line]:
    """Yield the lines of a text, one at a time.

    Raises:
        InputError: the file cannot be read, is too large, or has a line that no program writes.
    """
    with opened(path) as stream:
        number = 0
        while data := stream.readline(_MOST_LINE + 1):
            number += 1
            if len(data) > _MOST_LINE:
                raise InputError(f"{plain_path(path)}, line {number}: has more than {_MOST_LINE} bytes; allowed: text")
            yield number, data.decode("ascii", "replace").rstrip("\r\n")


def refusal(path: Path, line: int, got: str, allowed: str) -> InputError:
    """Return the error of a line: what it has, and what is allowed."""
    return InputError(f"{plain_path(path)}, line {line}: got {show(got)}; allowed: {allowed}")


def number_of(text: str) -> float | None:
    """Return a number as Fortran and Nastran write it (1.5D+3, 2.5+10); None for what is none or not finite."""
    word = text.strip().upper().replace("D", "E")
    sign = max(word.rfind("+"), word.rfind("-"))
    if sign > 0 and word[sign - 1] != "E":
        word = f"{word[:sign]}E{word[sign:]}"
    if not word or "_" in word:
        return None
    try:
        number = float(word)
    except ValueError:
        return None
    return number if np.isfinite(number) else None


def rows_of_numbers(
    path: Path,
    lines: Iterable[Line],
    width: int,
    what: str,
    separator: str | None = None,
    most: int | None = None,
) -> Array:
    """Return the numbers of lines, (lines, width), with bounded memory beside them.

    Args:
        path: of the file, for messages.
        lines: of the file; empty ones are passed over.
        width: numbers of a line.
        what: they are, for messages: "row, column, entry".
        separator: between numbers; None: spaces.
        most: lines that there may be; as many as a matrix may have entries if None.

    Raises:
        InputError: a line has something else, or there are too many.
    """
    most = MOST_ENTRIES if most is None else most
    rest, parts, count = (line for line in lines if line[1].strip()), list[Array](), 0
    while chunk := list(islice(rest, _CHUNK)):
        texts = [text.replace("D", "E").replace("d", "e") for _, text in chunk]
        try:
            part = np.loadtxt(texts, delimiter=separator, comments=None, ndmin=2, dtype=np.float64)
            fits = part.shape == (len(chunk), width) and bool(np.all(np.isfinite(part)))
        except ValueError:
            fits = False
        if not fits:
            part = _by_lines(path, chunk, width, what, separator)
        count += len(part)
        if count > most:
            got = f"more than {most} lines of {what}"
            raise InputError(f"{plain_path(path)}: got {got}; allowed: up to that, {SMALLER}")
        parts.append(part)
    return np.concatenate(parts) if parts else np.zeros((0, width))


def _by_lines(path: Path, chunk: list[Line], width: int, what: str, separator: str | None) -> Array:
    """Return the numbers of lines, or refuse the first that has others."""
    rows = []
    for line, text in chunk:
        words = text.split(separator)
        if separator is not None and len(words) == width + 1 and not words[-1].strip():
            words.pop()  # a separator at the end
        numbers = [number_of(word) for word in words]
        row = [number for number in numbers if number is not None]
        if len(words) != width or len(row) != width:
            raise refusal(path, line, text.strip(), f"{width} finite numbers, {what}")
        rows.append(row)
    return np.array(rows)


def integers(path: Path, numbers: Array, what: str) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Return whole numbers of an array of numbers; InputError with the first that is none."""
    whole = np.abs(numbers) < 2.0**53
    wrong = np.flatnonzero(~whole | (np.where(whole, numbers, 0.5) % 1.0 != 0.0))
    if len(wrong):
        raise InputError(f"{plain_path(path)}: got {numbers.ravel()[wrong[0]]:g} as {what}; allowed: whole numbers")
    return numbers.astype(np.int64)
