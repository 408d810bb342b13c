"""Places of keys in a TOML text: asked only when an error is reported, so that reading pays nothing for it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from ..errors import DescriptionError
from .toml_text import line_and_column

Path = tuple[str, ...]  # keys from the top of the text; the index of an array's element as a key of digits

_BETWEEN = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")
_BLANK = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\n]+")  # numbers, booleans, and dates, which may have a space inside
_STRINGS = (  # longest delimiter first
    re.compile(r'"""[^"\\]*(?:(?:\\.|"{1,2}(?!"))[^"\\]*)*"{3,5}', re.DOTALL),
    re.compile(r"'''[^']*(?:'{1,2}(?!')[^']*)*'{3,5}"),
    re.compile(r'"[^"\\\n]*(?:\\.[^"\\\n]*)*"'),
    re.compile(r"'[^'\n]*'"),
)
_STEP = re.compile(r"([^.\[\]]+)|\[([0-9]+)\]")  # of a place in a message: joints.joint1.x, links[0].name
_DEEPEST = 100  # keys of a path; no form of ours goes as deep
_OF_ENTRY = 2  # components that lead to an entry: a file that refines a URDF does not have all of its joints


def lines_of(text: str, wanted: Sequence[tuple[Sequence[str], bool]]) -> list[tuple[int, int] | None]:
    """Return line and column, from 1, of the deepest key or element of each path in the text, in one pass over it.

    Args:
        text: valid TOML.
        wanted: paths, keys from the top of the text, of an array the element's index as digits; each with whether the
            place of the value is wanted, where all of the path is there and ends with a key that has one.

    Returns:
        None where not even the first key is there.
    """
    marks = [_Mark(tuple(path)) for path, _ in wanted]
    with suppress(
        RecursionError, IndexError, _Enough
    ):  # too deep, or no TOML after all; or nothing is left to look for
        _Scan(text, marks).statements()
    places: list[tuple[int, int] | None] = []
    for mark, (_, value) in zip(marks, wanted, strict=True):
        offset = mark.value if value and mark.value is not None else mark.offset
        places.append(line_and_column(text, offset) if mark.depth else None)
    return places


@contextmanager
def located(text: str, values: Mapping[str, object], source: str) -> Iterator[None]:
    """Add line and column to errors of a text's values, read from that source."""
    try:
        yield
    except DescriptionError as error:
        if error.source == source:
            locate([error], text, values)
        raise


def locate(errors: Sequence[DescriptionError], text: str, values: Mapping[str, object]) -> None:
    """Add line and column to each error that has none yet; the text is read once for all."""
    without = [error for error in errors if error.line is None]
    paths = [error.path or _path_of(values, error.where) for error in without]
    places = lines_of(text, [(path, not error.at_key) for path, error in zip(paths, without, strict=True)])
    for error, path, place in zip(without, paths, places, strict=True):
        known = place if path else None if error.where else (1, 1)
        error.line, error.column = known or (None, None)


def refusal(message: str, where: str, source: str, text: str) -> DescriptionError:
    """Return the error of a place in a text; without line and column where the text is empty."""
    error = DescriptionError(message, where=where, source=source)
    if text:
        locate([error], text, tomllib.loads(text))
    return error


def _path_of(values: object, where: str) -> Path:
    """Return the path of a place as messages write it, entries by name; () where there is no entry of this name."""
    path: list[str] = []
    words = [key or index for key, index in _STEP.findall(where)]
    for word in words:
        if isinstance(values, list):
            names = [item.get("name") if isinstance(item, dict) else None for item in values]
            index = names.index(word) if word in names else int(word) if word.isdigit() else len(values)
            word = str(index)
            values = values[index] if index < len(values) else None
        else:
            values = values.get(word) if isinstance(values, dict) else None
        if values is None:
            break
        path.append(word)
    return tuple(path) if len(path) >= min(_OF_ENTRY, len(words)) else ()


@dataclass(eq=False)
class _Mark:
    """A wanted path: how many of its keys are located, the last at ``offset``, its value at ``value``."""

    path: Path
    depth: int = 0
    offset: int = 0
    value: int | None = None


class _Enough(Exception):
    """End of a scan: all paths are located."""


class _Scan:
    """One pass over a text that locates the marks."""

    def __init__(self, text: str, marks: Sequence[_Mark]) -> None:
        self.text, self.at = text, 0
        self.last: dict[Path, int] = {}  # index of the last entry of every array of tables
        self.of: dict[Path, list[_Mark]] = {}  # marks by each prefix of their paths
        sought = [mark for mark in marks if 0 < len(mark.path) <= _DEEPEST]
        for mark in sought:
            for length in range(1, len(mark.path) + 1):
                self.of.setdefault(mark.path[:length], []).append(mark)
        self.rest = len(sought)

    def statements(self) -> None:
        """Scan until the end, or until all is located."""
        prefix: Path = ()
        while self.rest:
            self._skip(_BETWEEN)
            if self.at >= len(self.text):
                return
            if self.text[self.at] == "[":
                prefix = self._header()
            else:
                self._pair(prefix)

    def _skip(self, *patterns: re.Pattern[str]) -> str:
        """Skip and return the text that the first matching pattern matches; IndexError without one, as at the end."""
        for pattern in patterns:
            match = pattern.match(self.text, self.at)
            if match is not None:
                self.at = match.end()
                return match.group()
        raise IndexError

    def _note(self, path: Path, offset: int) -> None:
        for mark in self.of.get(path, ()):
            if len(path) > mark.depth:
                mark.depth, mark.offset = len(path), offset
                self.rest -= len(path) == len(mark.path)

    def _keys(self) -> list[tuple[str, int]]:
        """Read a dotted key: its keys with their offsets."""
        keys = []
        while True:
            self._skip(_BLANK)
            offset = self.at
            keys.append((self._key(), offset))
            self._skip(_BLANK)
            if self.text[self.at] != ".":
                return keys
            self.at += 1

    def _key(self) -> str:
        if self.text[self.at] == '"':
            value: str = tomllib.loads("key = " + self._string())["key"]
            return value
        return self._string()[1:-1] if self.text[self.at] == "'" else self._skip(_BARE)

    def _string(self) -> str:
        return self._skip(*_STRINGS)

    def _header(self) -> Path:
        """Read [a.b] or [[a.b]]; return the path of the pairs behind it."""
        many = self.text.startswith("[[", self.at)
        self.at += 2 if many else 1
        path: Path = ()
        keys = self._keys()
        for place, (key, offset) in enumerate(keys, 1):
            path = (*path, key)
            self._note(path, offset)
            if many and place == len(keys):
                self.last[path] = self.last.get(path, -1) + 1
            if path in self.last:
                path = (*path, str(self.last[path]))
                self._note(path, offset)
        self.at += 2 if many else 1
        return path

    def _pair(self, path: Path) -> None:
        for key, offset in self._keys():
            path = (*path, key)
            self._note(path, offset)
        self.at += 1  # the equals sign
        self._skip(_BLANK)
        for mark in self.of.get(path, ()):
            if mark.path == path and mark.value is None:
                mark.value = self.at
        if not self.rest:
            raise _Enough
        self._value(path)

    def _value(self, path: Path) -> None:
        first = self.text[self.at]
        if first in "\"'":
            self._string()
        elif first not in "[{":
            self._skip(_SCALAR)
        else:
            self._inner(path, "]" if first == "[" else "}")

    def _inner(self, path: Path, end: str) -> None:
        """Scan an array's elements, or an inline table's pairs."""
        self.at += 1
        index = 0
        while True:
            self._skip(_BETWEEN)
            if self.text[self.at] == end:
                self.at += 1
                return
            if self.text[self.at] == ",":
                self.at += 1
                continue
            if end == "}":
                self._pair(path)
            else:
                self._note((*path, str(index)), self.at)
                self._value((*path, str(index)))
                index += 1
