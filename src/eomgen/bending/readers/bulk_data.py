"""Entries of Nastran bulk data.

Fields are small (8 characters), large (16 characters, star after the name) or free (comma-separated).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from ...limits import LARGEST
from ..finite_elements import MOST_ROWS
from .text import lines_of, number_of, refusal

_SMALL, _LARGE = 8, 16
_MOST_FIELDS = 4 * (MOST_ROWS + 1)  # of an entry: a full column of a matrix


@dataclass
class Card:
    """A bulk data entry: its first line and its fields, without the names of continuation lines."""

    line: int
    name: str
    fields: list[str]

    def padded(self, count: int) -> list[str]:
        """Return ``count`` stripped fields; missing fields are empty."""
        return [field.strip() for field in (self.fields + [""] * count)[:count]]


def cards(path: Path, names: Collection[str]) -> Iterator[Card]:
    """Yield the entries with one of the given names, including their continuation lines."""
    card: Card | None = None
    for line, text in lines_of(path):
        text = text.split("$")[0].rstrip()
        if not text:
            continue
        fields = _fields(text)
        name = fields[0].strip().rstrip("*").upper()
        if name and name[0] not in "+*":
            if card is not None:
                yield card
            card = Card(line, name, fields[1:]) if name in names else None
        elif card is not None:
            card.fields += fields[1:]
            if len(card.fields) > _MOST_FIELDS:
                raise refusal(path, line, f"more than {_MOST_FIELDS} fields of {card.name}", "up to that")
    if card is not None:
        yield card


def _fields(text: str) -> list[str]:
    """Return the name field of a line and its four or eight data fields."""
    if "," in text:
        words = text.split(",")
        count = 4 if words[0].strip().endswith("*") or words[0].startswith("*") else 8
        return (words + [""] * count)[: count + 1]
    text = text.expandtabs(_SMALL)
    first = text[:_SMALL]
    width = _LARGE if "*" in first else _SMALL
    count = 4 * _LARGE // width
    return [first] + [text[_SMALL + k * width : _SMALL + (k + 1) * width] for k in range(count)]


def whole(path: Path, card: Card, text: str, default: int | None = None) -> int:
    """Return the integer in a field, or the default if the field is empty."""
    word = text.strip()
    if not word and default is not None:
        return default
    if not (word.isdecimal() and len(word) < 10):
        raise refusal(path, card.line, word, f"a whole number in {card.name}")
    return int(word)


def three_numbers(path: Path, card: Card, fields: list[str]) -> list[float]:
    """Return three coordinates; an empty field is 0."""
    numbers = [number_of(word) if word.strip() else 0.0 for word in fields]
    found = [number for number in numbers if number is not None and abs(number) <= LARGEST]
    if len(found) != 3:
        allowed = f"three finite numbers up to {LARGEST:g}, x, y and z"
        raise refusal(path, card.line, ", ".join(word.strip() for word in fields), allowed)
    return found
