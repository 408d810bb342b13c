"""Text of a file, and TOML of a text, of descriptions, scenarios and plans."""

from __future__ import annotations

import re
import tomllib
from itertools import islice
from pathlib import Path

from ..errors import DescriptionError
from ..files import read_regular
from ..identifiers import check_kind
from ..limits import LARGEST

_MOST_BYTES = 1 << 20  # these take a second to read, if they are the slowest of their kind
_MOST_XML = 1 << 22  # so does this of XML
_XML = (".urdf", ".xml", ".mjcf", ".xacro")
_MOST_PARTS = 8  # of a dotted key: the parser's time and memory grow with the square of it
_WORD = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_WORD}(?:[ \t]*\.[ \t]*{_WORD}){{{_MOST_PARTS}}}")
_MOST_TABLES = 20_000  # four for each of the links that a robot may have
_TABLE = re.compile(r"^[ \t]*\[[^\n,=]*\][ \t\r]*(?:#[^\n]*)?$", re.MULTILINE)  # rows of an array have commas
_MOST_DIGITS = 4300  # of a number: where Python's integers stop
_MANY_DIGITS = re.compile(rf"(?<![0-9_])[0-9](?:_?[0-9]){{{_MOST_DIGITS}}}")
_DEEP = 50  # brackets in brackets, far more than a description has
_BRACKET = re.compile(  # with strings and comments as a whole, so that a bracket in them is none
    r'"""(?:[^"\\]|\\.|"{1,2}(?!"))*(?:"{3,5})?|"(?:[^"\\\n]|\\.)*"?'  # as far as it goes, or each quote would be a try
    r"|'''(?:[^']|'{1,2}(?!'))*(?:'{3,5})?|'[^'\n]*'?|#[^\n]*|[\[\]{}]",
    re.DOTALL,
)
_SAID_PLACE = re.compile(r" \(at (?:line ([0-9]+), column ([0-9]+)|end of document)\)$")
_REMEDIES = {  # what the parser says, and what to write instead
    "Cannot overwrite": "each key once in its table",
    "Duplicate inline table key": "each key once in its table",
    "Cannot declare": "each [table] once; [[name]] begins one more entry of an array",
    "Cannot mutate": "a table in braces is whole; further keys belong inside them",
    "Cannot redefine": "each key once in its table",
    "Expected '='": "key = value",
    "Expected newline": "one key = value a line",
    "Expected ']": "a table's name in [brackets], an array's in [[double ones]]",
    "Invalid value": 'a number, true, false, "text", [an array] or { a = 1 }',
    "Invalid statement": "key = value, [table] or [[table]]",
    "Invalid initial character": "a key of letters, digits, _ and -, or in quotes",
    "Invalid date": "a number; a description has no dates",
    "Unclosed array": "], the array's end",
    "Unclosed inline table": "}, the table's end, on the same line",
    "Unterminated string": "the closing quotes",
    "Unescaped": r"'...' where \ stands for itself, or \\",
    "Illegal character": "text without control characters",
    "Invalid hex": r"\u and four hexadecimal digits",
    "Escaped character": r"\u and the digits of a character that there is",
}


def read_text(path: Path, source: str, kind: str = ".toml, .urdf or .xml file") -> str:
    """Return the text of a file, UTF-8; DescriptionError with the source if there is none."""
    source = source if source.isascii() and source.isprintable() else ascii(source)
    try:
        return read_regular(path, _MOST_XML if path.suffix in _XML else _MOST_BYTES).decode("utf-8-sig")
    except FileNotFoundError:
        raise DescriptionError(f"there is no such file; allowed: an existing {kind}", source=source) from None
    except UnicodeDecodeError as error:
        message = f"byte {error.start} is no UTF-8; allowed: UTF-8 text"
        refusal = DescriptionError(message, source=source)
        refusal.line = error.object.count(b"\n", 0, error.start) + 1
        raise refusal from None
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL
        reason = getattr(error, "strerror", None) or str(error)
        allowed = "" if "allowed: " in reason else f"; allowed: an existing {kind}"
        raise DescriptionError(f"cannot be read: {reason}{allowed}", source=source) from None


def parse_toml(text: str, source: str) -> dict[str, object]:
    """Return the values of a TOML text; DescriptionError with the source if it is none."""
    check_kind("text", text, isinstance(text, str), "a text in TOML")
    for pattern, most, what in (
        (_DEEP_KEY, 0, f"a key has more than {_MOST_PARTS} parts; allowed: the few that a key of this file has"),
        (_MANY_DIGITS, 0, f"a number has more than {_MOST_DIGITS} digits; allowed: magnitudes up to {LARGEST:g}"),
        (_TABLE, _MOST_TABLES, f"there are more than {_MOST_TABLES} tables; allowed: up to {_MOST_TABLES}"),
    ):
        match = next(islice(pattern.finditer(text), most, None), None)
        if match is not None:
            error = DescriptionError(f"not valid TOML: {what}", source=source)
            error.line, error.column = line_and_column(text, match.start())
            raise error
    try:
        values: dict[str, object] = tomllib.loads(text)
    except RecursionError:
        message = "not TOML that can be read: it is nested too deeply; allowed: tables and arrays a few levels deep"
        refusal = DescriptionError(message, source=source)
        refusal.line, refusal.column = line_and_column(text, _too_deep(text))
        raise refusal from None
    except ValueError as error:  # TOMLDecodeError, or what Python says of an integer or a date
        raise _refusal(text, str(error), source) from None
    return values


def _too_deep(text: str) -> int:
    """Return the offset of the first bracket that is nested too deeply, or of the deepest one, before parsing."""
    depth = deepest = offset = 0
    for match in _BRACKET.finditer(text):
        if match.group() in ("]", "}"):
            depth -= 1
        elif match.group() in ("[", "{"):
            depth += 1
            if depth > deepest:
                deepest, offset = depth, match.start()
            if depth > _DEEP:
                break
    return offset


def _refusal(text: str, said: str, source: str) -> DescriptionError:
    """Return the parser's refusal as a DescriptionError: printable ASCII, with what to write instead, and its place."""
    place = _SAID_PLACE.search(said)
    reason = ascii(said[: place.start()] if place is not None and place[1] else said)[1:-1][:300]
    remedy = next((what for begin, what in _REMEDIES.items() if said.startswith(begin)), "TOML 1.0, see toml.io")
    error = DescriptionError(f"not valid TOML: {reason}; allowed: {remedy}", source=source)
    if place is not None and place[1]:
        error.line, error.column = int(place[1]), int(place[2])
    elif place is not None:
        error.line, error.column = line_and_column(text, len(text.rstrip()))
    return error


def line_and_column(text: str, offset: int) -> tuple[int, int]:
    """Return line and column of an offset in a text, from 1."""
    return text.count("\n", 0, offset) + 1, offset - text.rfind("\n", 0, offset)
