"""Questions about lengths and angles that are so large that they may be in millimetres or degrees."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from .tables import Entries, Few, Form, Kinds, Sub

UNUSUAL = {"m": 50.0, "rad": 20.0, "m or rad": 20.0}  # by the unit of a key: larger sizes are asked about
MOST_NAMED = 5
_FOREIGN = {"millimetres": "m", "degrees": "rad"}  # units that people take, with those that numbers have here

Quantity = tuple[str, float, str]  # place, value, unit


def unit_note(quantities: Iterable[Quantity]) -> tuple[str, ...]:
    """Ask in one note about those quantities of a file or robot that are unusually large; no note where none is.

    It names MOST_NAMED of them, and says how many are left.
    """
    large = [quantity for quantity in quantities if is_unusual(*quantity[1:])]
    if not large:
        return ()
    if len(large) == 1:
        return (unit_question(*large[0]),)
    named = ", ".join(f"{where} = {number:g} {unit}" for where, number, unit in large[:MOST_NAMED])
    left = f" and {len(large) - MOST_NAMED} more" if len(large) > MOST_NAMED else ""
    units = {unit for _, _, unit in large}
    foreign = " or ".join(word for word, own in _FOREIGN.items() if any(own in unit for unit in units))
    return (f"{named}{left}: are these in {foreign}?",)


def is_unusual(number: float, unit: str) -> bool:
    """Return whether a length or an angle is so large that it is asked about."""
    return abs(number) > UNUSUAL.get(unit, math.inf)


def unit_question(where: str, number: float, unit: str) -> str:
    """Ask whether a number, which stands at that place, is in degrees or millimetres."""
    degrees = f"degrees ({math.radians(number):.6g} rad)"
    millimetres = f"millimetres ({1e-3 * number:.6g} m)"
    asked = {"m": millimetres, "rad": degrees}.get(unit, f"{degrees} or {millimetres}")
    return f"{where} = {number:g} {unit}: is that in {asked}?"


def quantities_in(form: Form | Kinds, values: Mapping[str, Any], where: str = "") -> Iterator[Quantity]:
    """Yield place, value and unit of each length and angle of a file without faults."""
    keys = form.keys if isinstance(form, Form) else form.kinds[values["type"]]
    for key, value in values.items():
        kind, place = keys.get(key), ".".join(filter(None, (where, key)))
        if isinstance(kind, Sub):
            yield from quantities_in(kind.inner, value, place)
        elif isinstance(kind, Entries):
            for index, item in enumerate(value):
                yield from quantities_in(kind.inner, item, kind.where(key, index, item))
        elif isinstance(kind, Few):
            for index, item in enumerate(value):
                yield from quantities_in(kind.inner, item, f"{place}.{index}")
        elif kind is not None and kind.unit in UNUSUAL:
            for inner, number in _numbers(value, place):
                yield inner, number, kind.unit


def _numbers(value: Any, where: str) -> Iterator[tuple[str, float]]:
    """All numbers of a value, in arrays and tables too, with their places."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield where, float(value)
    elif isinstance(value, (list, dict)):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(inner, f"{where}.{key}")
