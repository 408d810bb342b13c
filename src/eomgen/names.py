"""Names and values of a description: what is an identifier, and how to quote what somebody else wrote.

Nothing of a description goes into a message or a file before it went through this module.
"""

from __future__ import annotations

import difflib
import keyword
import re
from collections.abc import Iterable, Sequence

NAME_LENGTH = 128
ROBOT_LENGTH = 48
IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
ROBOT_NAME = re.compile(r"[a-z][a-z0-9_]*")
IDENTIFIER_RULE = f"a letter or _, then letters, digits or _, at most {NAME_LENGTH} characters"
ROBOT_RULE = (
    f"a lower-case letter, then lower-case letters, digits or _, at most {ROBOT_LENGTH} characters, no Python keyword"
)
_SHOWN = 60  # characters of somebody else's text in a message
_CANDIDATES = 5000  # difflib is slow: look for a near name among so many


def is_identifier(text: str) -> bool:
    """True for a link, joint or frame name.  fullmatch, because $ would accept a trailing newline."""
    return len(text) <= NAME_LENGTH and IDENTIFIER.fullmatch(text) is not None


def is_robot_name(text: str) -> bool:
    """True for a robot name, which becomes file, module and C prefix."""
    return len(text) <= ROBOT_LENGTH and ROBOT_NAME.fullmatch(text) is not None and not keyword.iskeyword(text)


def show(value: object) -> str:
    """A value that came from outside, as short printable ASCII."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        if len(value) > 6 or any(isinstance(item, (dict, list)) for item in value):
            return f"an array of {len(value)} values"
        return "[" + ", ".join(show(item) for item in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and value.bit_length() > 64:
        return f"an integer of {value.bit_length()} bits"  # its repr may raise
    if isinstance(value, str):
        value = value if len(value) <= _SHOWN else value[:_SHOWN] + "..."
    return ascii(value)


def listed(names: Iterable[str], most: int = 8) -> str:
    """The names, quoted, and how many were left out after the first ``most``."""
    names = list(names)
    text = ", ".join(show(name) for name in names[:most])
    return text if len(names) <= most else f"{text} and {len(names) - most} more"


def nearest(name: str, allowed: Iterable[str]) -> str:
    """``; did you mean 'x'?`` for the nearest allowed name, or nothing."""
    candidates = [item for _, item in zip(range(_CANDIDATES), allowed, strict=False)]
    found = difflib.get_close_matches(name[:NAME_LENGTH], candidates, 1, 0.6)
    return f"; did you mean {show(found[0])}?" if found else ""


def to_identifier(text: str) -> str:
    """An identifier that resembles the text: foreign characters become _, a leading digit gets one in front."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text[:NAME_LENGTH])
    return (name if IDENTIFIER.fullmatch(name) else "_" + name)[:NAME_LENGTH]


def to_robot_name(text: str) -> str:
    """A robot name that resembles the text."""
    name = re.sub(r"[^a-z0-9_]", "_", text[:ROBOT_LENGTH].lower())
    return (name if is_robot_name(name) else "robot_" + name.lstrip("_"))[:ROBOT_LENGTH]


def unique_identifiers(texts: Sequence[str]) -> dict[str, str]:
    """Identifier of each text.  A text that is one keeps it; the others are made unique with _2, _3, ..."""
    names = {text: text for text in texts if is_identifier(text)}
    taken = set(names)
    count: dict[str, int] = {}
    for text in texts:
        if text in names:
            continue
        stem = name = to_identifier(text)
        while name in taken:
            count[stem] = count.get(stem, 1) + 1
            suffix = f"_{count[stem]}"
            name = stem[: NAME_LENGTH - len(suffix)] + suffix
        names[text] = name
        taken.add(name)
    return names
