"""Print lines, notes, and results as text or JSON."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from ...identifiers import printable
from ...optional import NotInstalledError

_MICRO = re.compile(r"(?<=[0-9] )u(?=(m|rad|s|N|J|W)\b)|(?<=\[)u(?=(m|rad|s|N|J|W)\b)")  # 5 um, [urad]


def with_micro_signs(text: str, stream: TextIO) -> str:
    """Return the text with micro signs in the place of the u of units, on a terminal whose encoding has them."""
    try:
        "\N{MICRO SIGN}".encode(stream.encoding or "ascii")
    except (UnicodeError, LookupError):
        return text
    return _MICRO.sub("\N{MICRO SIGN}", text) if stream.isatty() else text


def say(text: str, file: TextIO | None = None) -> None:
    """Print a line that may have names of others' files in it; nothing in it steers the terminal or ends the line."""
    print(with_micro_signs(printable(text).replace("\n", "\\n"), file or sys.stdout), file=file)


def say_lines(lines: Iterable[str], file: TextIO | None = None) -> None:
    """Print lines, each as ``say`` does."""
    for line in lines:
        say(line, file)


def show_json(values: Any) -> None:
    """Print values as JSON, one to a line."""
    print(json.dumps(values, indent=1))


def show_result(options: argparse.Namespace, result: Any) -> None:
    """Print a result that has ``lines`` and ``as_dict``: as text, or as JSON with --json."""
    if options.json:
        show_json(result.as_dict())
    else:
        say_lines(result.lines())


def show_files(
    options: argparse.Namespace, lines: Sequence[str], values: Mapping[str, Any], written: Iterable[Path]
) -> None:
    """Print a result as ``lines`` or as JSON of ``values``, with the files that were written."""
    if options.json:
        show_json({"files": [str(path) for path in written], **values})
        return
    say_lines(lines)
    show_written(written)


def show_written(paths: Iterable[Path]) -> None:
    """Print the paths of files that were written."""
    for path in paths:
        say(f"wrote {path}")


@contextmanager
def can_be_left_out(what: str) -> Iterator[None]:
    """Let work that a command does besides be left out where its package is missing, with a line that says so."""
    try:
        yield
    except NotInstalledError as error:
        say(f"note: {what} left out: {error}", sys.stderr)
