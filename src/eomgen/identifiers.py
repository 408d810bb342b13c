"""Identifiers and words of descriptions and options: what is one, and what is made one; paths and texts in messages."""

from __future__ import annotations

import keyword
import re
from collections.abc import Collection, Sequence
from typing import Any

from .errors import InputError
from .names import ESCAPED, NAME_LENGTH, SHOWN, show

ROBOT_LENGTH = 48
IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
ROBOT_NAME = re.compile(r"(?!eomf?(_|$))[a-z][a-z0-9_]*")  # these begin names of the C library
IDENTIFIER_RULE = f"a letter or _, then letters, digits or _, at most {NAME_LENGTH} characters"
ROBOT_RULE = (
    f"a lower-case letter, then lower-case letters, digits or _, at most {ROBOT_LENGTH} characters, no Python keyword,"
    " and not eom or eomf before a _ or alone"
)
_SUFFIX = 9  # characters that make an identifier unique


def is_identifier(text: str) -> bool:
    """Return True for a link, joint or frame name.  fullmatch, because $ would accept a trailing newline."""
    return len(text) <= NAME_LENGTH and IDENTIFIER.fullmatch(text) is not None


def is_state_name(text: str) -> bool:
    """Return True for the name of an internal state: OWNER.LAW.STATE, such as "joint1.gamma.maxwell.0.z"."""
    first, *words = text.split(".")
    return len(text) <= 4 * NAME_LENGTH and is_identifier(first) and len(words) > 1 and all(map(is_word, words))


def is_word(text: str) -> bool:
    """Return True for an identifier, or a number of letters, digits or _: what stands between dots of names."""
    return is_identifier(f"_{text}") and text != ""


def is_robot_name(text: str) -> bool:
    """Return True for a robot name, which becomes file, module and C prefix."""
    return len(text) <= ROBOT_LENGTH and ROBOT_NAME.fullmatch(text) is not None and not keyword.iskeyword(text)


def show_path(text: str) -> str:
    """Show a path: of a long one the end, where the file's name is."""
    if len(ascii(text)) <= ESCAPED:
        return ascii(text)
    shown = text[-SHOWN:]
    while len(ascii(shown)) > ESCAPED:
        shown = shown[1:]
    return ascii("..." + shown)


def plain_path(path: object) -> str:
    """Show a path in a message: as it is, or quoted where it has a line end or a character that steers a terminal."""
    text = str(path)
    return text if text.isprintable() else show_path(text)


def printable(text: str) -> str:
    """Make text printable in a terminal: characters that steer it (escapes, turns of direction ...) become codes.

    Newlines and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode("ascii") for c in text)


def parameter_path(name: str) -> tuple[str, ...]:
    """Split a parameter's name: (``joints``, ``joint1``, ``x``, ``stiffness``)."""
    return tuple(name.split("."))


def to_identifier(text: str) -> str:
    """Turn a text into an identifier that resembles it: foreign characters become _, one precedes a leading digit."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text[:NAME_LENGTH])
    return (name if IDENTIFIER.fullmatch(name) else "_" + name)[:NAME_LENGTH]


def to_robot_name(text: str) -> str:
    """Turn a text into a robot name that resembles it."""
    name = re.sub(r"[^a-z0-9_]", "_", text[:ROBOT_LENGTH].lower())
    return (name if is_robot_name(name) else "robot_" + name.lstrip("_"))[:ROBOT_LENGTH]


def unique_identifiers(texts: Sequence[str]) -> dict[str, str]:
    """Return identifiers of texts: those that are one stay; others are made unique with _2, _3, ..."""
    names = {text: text for text in texts if is_identifier(text)}
    taken = set(names)
    count: dict[str, int] = {}
    for text in texts:
        if text in names:
            continue
        name = to_identifier(text)
        stem = name[: NAME_LENGTH - _SUFFIX]  # one count for all that would be cut to the same, so that it ends soon
        while name in taken:
            count[stem] = count.get(stem, 1) + 1
            name = f"{stem}_{count[stem]}"
        names[text] = name
        taken.add(name)
    return names


def are_names(values: object) -> bool:
    """Return whether a value is a sequence of texts, and no text itself."""
    return isinstance(values, Sequence) and not isinstance(values, str) and all(isinstance(x, str) for x in values)


def word_in(label: str, value: Any, allowed: Collection[str]) -> str:
    """Return one of the allowed words; InputError, which begins with the label, of anything else."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"{label}: {show(value)} is unknown; allowed: {', '.join(allowed)}")
    return value


def check_kind(label: str, value: object, fits: bool, allowed: str) -> None:
    """Raise an InputError that names an argument, the type of its value and what is allowed, where it does not fit."""
    if not fits:
        raise InputError(f"{label}: got a value of type {type(value).__name__}; allowed: {allowed}")
