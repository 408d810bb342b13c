"""Names of a description's parts, and how to quote what somebody else wrote.

Nothing of a description goes into a message or a file before it went through this module or ``identifiers``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

NAME_LENGTH = 128
SHOWN = 60  # characters of somebody else's text in a message
ESCAPED = 84  # and how many they may become when they are escaped
_LISTED = 320  # characters of a list of names
_PAIRS = 3_000_000  # difflib is slow: pairs of characters that are compared in search of a near name, half a second


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
        shown = value[:SHOWN]
        while len(ascii(shown)) > ESCAPED:
            shown = shown[:-1]
        value = value if len(shown) == len(value) else shown + "..."
    elif not isinstance(value, (int, float)):  # arrays take lines
        text = " ".join(ascii(value).split())
        return text if len(text) <= ESCAPED else text[:SHOWN] + "..."
    return ascii(value)


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
