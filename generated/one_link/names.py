"""Names and values of a description: what is an identifier, and how to quote what somebody else wrote.

Nothing of a description goes into a message or a file before it went through this module.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from .errors import InputError

NAME_LENGTH = 128
ROBOT_LENGTH = 48
IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
ROBOT_NAME = re.compile(r"(?!eomf?(_|$))[a-z][a-z0-9_]*")  # these begin names of the C library
IDENTIFIER_RULE = f"a letter or _, then letters, digits or _, at most {NAME_LENGTH} characters"
ROBOT_RULE = (
    f"a lower-case letter, then lower-case letters, digits or _, at most {ROBOT_LENGTH} characters, no Python keyword,"
    " and not eom or eomf before a _ or alone"
)
_SHOWN = 60  # characters of somebody else's text in a message
_ESCAPED = 84  # and how many they may become when they are escaped
_LISTED = 320  # characters of a list of names
_SUFFIX = 9  # characters that make an identifier unique
_PAIRS = 3_000_000  # difflib is slow: pairs of characters that are compared in search of a near name, half a second


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


def show(value: object) -> str:
    """Show a value that came from outside as short printable ASCII."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        whole = f"an array of {len(value)} values"
        if len(value) > 6 or any(isinstance(item, (dict, list)) for item in value):
            return whole
        text = "[" + ", ".join(show(item) for item in value) + "]"
        return text if len(text) <= _LISTED else whole
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and value.bit_length() > 64:
        return f"an integer of {value.bit_length()} bits"  # its repr may raise
    if isinstance(value, str):
        shown = value[:_SHOWN]
        while len(ascii(shown)) > _ESCAPED:
            shown = shown[:-1]
        value = value if len(shown) == len(value) else shown + "..."
    elif not isinstance(value, (int, float)):  # arrays take lines
        text = " ".join(ascii(value).split())
        return text if len(text) <= _ESCAPED else text[:_SHOWN] + "..."
    return ascii(value)


def show_path(text: str) -> str:
    """Show a path: of a long one the end, where the file's name is."""
    if len(ascii(text)) <= _ESCAPED:
        return ascii(text)
    shown = text[-_SHOWN:]
    while len(ascii(shown)) > _ESCAPED:
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


def listed(names: Iterable[str], most: int = 8) -> str:
    """Return the names, quoted, and how many were left out after the first ``most``, or fewer where they are long."""
    names = list(names)
    shown = [show(name) for name in names[:most]]
    while len(shown) > 1 and sum(map(len, shown)) > _LISTED:
        shown.pop()
    text = ", ".join(shown)
    return text if len(names) == len(shown) else f"{text} and {len(names) - len(shown)} more"


def html_table(title: str, rows: Mapping[str, object]) -> str:
    """Return a small table in HTML: a title, and a line for every name and its value."""
    import html  # takes as long to import as all of this module

    lines = "".join(f"<tr><td>{html.escape(k)}</td><td>{html.escape(str(x))}</td></tr>" for k, x in rows.items())
    return f"<table><caption>{html.escape(title)}</caption>{lines}</table>"


def component_name(owner: str, component: str) -> str:
    """Name a component: ``joint1.x``, a coordinate of a joint; ``tcp.fx``, of a wrench at a frame."""
    return f"{owner}.{component}"


def split_component(name: str) -> tuple[str, str]:
    """Split a name that ``component_name`` made into owner and component."""
    owner, _, component = name.rpartition(".")
    return owner, component


def split_state(name: str) -> tuple[str, str, str]:
    """Return owner, law and state of the name of an internal state: "j1.x", "maxwell", "0.z" of "j1.x.maxwell.0.z"."""
    *words, state = name.split(".")
    if words[-1].isdigit():  # of a branch
        state = f"{words.pop()}.{state}"
    return ".".join(words[:-1]), words[-1], state


def joint_of(coordinate: str) -> str:
    """Return the joint's name in a coordinate's: ``joint1`` of ``joint1.x``."""
    return split_component(coordinate)[0]


def kind_of(coordinate: str) -> str:
    """Return the kind of a coordinate: ``x`` of ``joint1.x``."""
    return split_component(coordinate)[1]


class DriveInput(NamedTuple):
    """Meaning of u at a coordinate, "torque", "voltage" or "reference of position", and its unit."""

    meaning: str
    unit: str

    @property
    def is_force(self) -> bool:
        """Whether it is a force or torque, if one that the drive follows with a lag."""
        return self in (*_FORCES, _MODAL_FORCE)


_FORCES = (DriveInput("force", "N"), DriveInput("torque", "N m"))
_MODAL_FORCE = DriveInput("modal force", "J")  # modal coordinates have no unit


def plain_input(coordinate: str, *, is_prescribed: bool = False) -> DriveInput:
    """Return what u means at a coordinate whose drive is no servo drive: a force, or an acceleration.

    Args:
        coordinate: its name.
        is_prescribed: whether its motion is given.
    """
    kind = kind_of(coordinate)
    is_linear, is_modal = kind in ("x", "y", "z"), kind.startswith("mode")
    if is_prescribed:
        return DriveInput("acceleration", "m/s^2" if is_linear else "1/s^2" if is_modal else "rad/s^2")
    return _MODAL_FORCE if is_modal else _FORCES[0 if is_linear else 1]


def parameter_name(*path: str) -> str:
    """Name of a parameter: ``joints.joint1.x.stiffness``, of any parts, such as a coordinate's whole name."""
    return ".".join(path)


def parameter_path(name: str) -> tuple[str, ...]:
    """Split a parameter's name: (``joints``, ``joint1``, ``x``, ``stiffness``)."""
    return tuple(name.split("."))


def nearest(name: object, allowed: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest allowed name, or nothing."""
    name_nearby = _nearest(name, allowed)
    return "" if name_nearby is None else f"; did you mean {show(name_nearby)}?"


def nearest_or_all(name: object, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest known name, or ``; known: x, y`` with all where none is near."""
    names = list(known)
    suggestion = _nearest(name, names)
    if suggestion is not None:
        return f"; did you mean {suggestion!r}?"
    return f"; known: {', '.join(names)}" if names else "; there are none"


def _nearest(name: object, allowed: Iterable[str]) -> str | None:
    if not isinstance(name, str):
        return None
    name = name[:NAME_LENGTH]
    candidates, pairs = [], _PAIRS
    for item in allowed:
        pairs -= (len(item) + 8) * (len(name) + 8)
        if pairs < 0:
            break
        candidates.append(item)
    import difflib  # likewise

    matches = difflib.get_close_matches(name, candidates, 1, 0.6)
    return matches[0] if matches else None


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
