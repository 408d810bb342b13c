"""Lines of generated code that are no longer than 120 columns."""

from __future__ import annotations

import re

COLUMNS = 120
DEEPER = 8  # columns that a continued line stands further to the right
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|/\*.*?(?:\*/|$)|\s|[^\s"/]+|/')


def wrapped(code: str) -> str:
    """Break long lines of C between tokens: behind a comma if that leaves no short line, in comments between words.

    Lines of the preprocessor break in their comments alone.
    """
    lines, is_comment = [], False
    for line in code.split("\n"):
        lines += [line] if len(line) <= COLUMNS else _broken(line, is_comment)
        opened, closed = line.rfind("/*"), line.rfind("*/")
        is_comment = opened > closed if opened != closed else is_comment
    return "\n".join(lines)


def _broken(line: str, is_comment: bool) -> list[str]:
    """Break one line; ``is_comment``: it begins within a comment."""
    indent = len(line) - len(line.lstrip())
    parts, rest = list[str](), line
    while len(rest) > COLUMNS:
        at, in_comment = _place(rest, is_comment, parts)
        if at == 0:
            break
        parts.append(rest[:at].rstrip())
        rest = (" * " if in_comment else " " * (indent + DEEPER)) + rest[at:].lstrip()
        is_comment = in_comment
    return [*parts, rest]


def _place(line: str, is_comment: bool, parts: list[str]) -> tuple[int, bool]:
    """Return where a line is to break, 0 for nowhere, and whether that is in a comment."""
    start = len(line) - len(line.lstrip(" *" if is_comment else " "))
    end = line.find("*/") if is_comment else 0
    words = [m.end() for m in re.finditer(r" ", line[: end if end >= 0 else len(line)])] if is_comment else []
    commented, behind = {x for x in words if x > start}, set[int]()
    for match in _TOKEN.finditer(line, max(end, 0)) if end >= 0 else ():
        if match[0].startswith("/*"):
            commented |= {match.start() + m.end() for m in re.finditer(r" ", match[0]) if m.end() > len("/* ")}
        elif match[0] == " " and match.start() > start and (parts or not line.startswith("#")):
            behind.add(match.end())
    fits = [x for x in sorted(commented | behind) if x <= COLUMNS + 1]
    commas = [x for x in fits if line[x - 2] == "," and x not in commented and x > COLUMNS // 2]
    at = commas[-1] if commas and fits[-1] not in commented else fits[-1] if fits else 0
    return at, at in commented
