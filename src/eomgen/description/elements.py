"""Reading of force elements between two links, such as [[springs]], whatever their kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..forms.keys import Either, Key, Listed
from ..forms.tables import Pair, Table
from ..names import show
from ..robot.elements import JOINT_ELEMENTS, KINDS, LinkElement
from ..robot.value import COORDINATES
from .forces import ReadText, read_curve, read_placement, whole_element


def read_element(table: str, name: str, entry: Table, read_text: ReadText, folder: Path | None) -> LinkElement:
    """Read one entry.

    Args:
        table: key that lists such elements, one of ``robot.elements.KINDS``.
        entry: of the keys ``ELEMENTS[table]``.
        read_text: returns the text of the file that a curve names.
        folder: where files of matrices are looked for; None where there is none.

    Raises:
        DescriptionError: a key is missing or wrong, or keys do not go together.
    """
    entry.require()
    links = entry.strings("links")
    if links[0] == links[1]:
        entry.fail(f"got {show(links)}; both ends are on one link; allowed: two different links", "links")
    values: dict[str, Any] = {
        key: _value(entry, key, form, read_text, folder)
        for key, form in entry.keys.items()
        if key not in ("name", "links") and key in entry
    }
    element = KINDS[table](name, (links[0], links[1]), **values)
    conflict = element.conflict()
    if conflict is not None:
        entry.fail(conflict[1], conflict[0])
    return element


def _value(entry: Table, key: str, form: Key, read_text: ReadText, folder: Path | None) -> Any:
    """Return the value of a key as its field has it."""
    if key == "curve":
        return read_curve(entry, read_text, "elongation")
    if isinstance(form, Either) and isinstance(entry.values[key], dict):
        return whole_element(JOINT_ELEMENTS[key], entry.value(key), dict.fromkeys(COORDINATES), folder, [])
    value = entry.value(key)
    if isinstance(form, Pair):
        return tuple(read_placement(table) for table in value)
    return tuple(value) if isinstance(form, Listed) else value
