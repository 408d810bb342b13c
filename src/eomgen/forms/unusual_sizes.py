"""Questions about lengths and angles that are so large that they may be in millimetres or degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from .tables import Entries, Few, Form, Kinds, Sub

UNUSUAL = {"m": 50.0, "rad": 20.0, "m or rad": 20.0}  # by the unit of a key: larger sizes are asked about
MOST_QUESTIONS = 5


def unit_questions(form: Form | Kinds, values: dict[str, Any]) -> tuple[str, ...]:
    """Ask about numbers of a file without faults: a line each, at most MOST_QUESTIONS, then how many are left."""
    questions = [unit_question(where, number, unit) for where, number, unit in _large(form, values, "")]
    left = len(questions) - MOST_QUESTIONS
    return (*questions[:MOST_QUESTIONS], *([f"{left} more of such sizes"] if left > 0 else []))


def is_unusual(number: float, unit: str) -> bool:
    """Return whether a length or an angle is so large that it is asked about."""
    return abs(number) > UNUSUAL.get(unit, math.inf)


def unit_question(where: str, number: float, unit: str) -> str:
    """Ask whether a number, which stands at that place, is in degrees or millimetres."""
    degrees = f"degrees ({math.radians(number):.6g} rad)"
    millimetres = f"millimetres ({1e-3 * number:.6g} m)"
    asked = {"m": millimetres, "rad": degrees}.get(unit, f"{degrees} or {millimetres}")
    return f"{where} = {number:g} {unit}: is that in {asked}?"


def _large(form: Form | Kinds, values: dict[str, Any], where: str) -> Iterator[tuple[str, float, str]]:
    """Place, value and unit of each number that is larger than usual."""
    keys = form.keys if isinstance(form, Form) else form.kinds[values["type"]]
    for key, value in values.items():
        kind, place = keys.get(key), ".".join(filter(None, (where, key)))
        if isinstance(kind, Sub):
            yield from _large(kind.inner, value, place)
        elif isinstance(kind, Entries):
            for index, item in enumerate(value):
                yield from _large(kind.inner, item, kind.where(key, index, item))
        elif isinstance(kind, Few):
            for index, item in enumerate(value):
                yield from _large(kind.inner, item, f"{place}.{index}")
        elif kind is not None and kind.unit in UNUSUAL:
            for inner, number in _numbers(value, place):
                if is_unusual(number, kind.unit):
                    yield inner, number, kind.unit


def _numbers(value: Any, where: str) -> Iterator[tuple[str, float]]:
    """All numbers of a value, in arrays and tables too, with their places."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield where, float(value)
    elif isinstance(value, (list, dict)):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(inner, f"{where}.{key}")
