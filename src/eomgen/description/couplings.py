"""Reading of [[couplings]]: gears, racks and belts between coordinates, rigid or elastic."""

from __future__ import annotations

from ..forms.keys import ByName
from ..forms.tables import Table
from ..robot.value import Coordinate, Coupling
from .forces import ReadText, read_coordinate
from .keys import CUT_COORDINATE


def read_coupling(name: str, entry: Table, read_text: ReadText) -> Coupling:
    """One entry of [[couplings]].

    Args:
        entry: of the keys ``COUPLING``.
        read_text: gives the text of the file that a curve names.

    Raises:
        DescriptionError: a key is missing or wrong, or keys do not go together.
    """
    entry.require()
    given = {key: value for key, value in entry.values.items() if key in CUT_COORDINATE.keys}
    law = None
    if given:
        inner = CUT_COORDINATE.read(given, entry.where, entry.source, entry.path)
        law = read_coordinate(inner, Coordinate(), read_text)
    ratios: dict[str, float] = entry.value("to", ByName)
    return Coupling(name, entry.text("of") or "", ratios, entry.number("offset"), law)
