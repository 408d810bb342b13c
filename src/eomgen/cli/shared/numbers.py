"""Read numbers of options from their texts; what is none is refused by name."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import TypeVar

from ...errors import InputError
from ...limits import LARGEST, MOST_COUNTED, SMALLEST, is_usable
from ...names import show

Value = TypeVar("Value")

_NUMBERS = f"0, or a number of magnitude {SMALLEST:g} to {LARGEST:g}"
_DIGITS = 18  # of whole numbers, so that 64 bits hold them


def real(text: str) -> float:
    """Read a number of an option, as ``type`` of an argument: one that can be computed with (``is_usable``)."""
    value = _finite(text)
    if value is None:
        raise argparse.ArgumentTypeError(f"{show(text)}; allowed: {_NUMBERS}")
    return value


def whole(text: str) -> int:
    """Read a whole number of an option, as ``type`` of an argument: how many, or which, up to MOST_COUNTED."""
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= _DIGITS and int(digits) <= MOST_COUNTED):
        raise argparse.ArgumentTypeError(f"{show(text)}; allowed: a whole number, up to {MOST_COUNTED}")
    return int(text)


def as_seed(text: str) -> int:
    """Read the seed of random numbers, as ``type`` of an argument."""
    if not (text.isascii() and text.isdecimal() and len(text) <= _DIGITS):
        raise argparse.ArgumentTypeError(f"{show(text)}; allowed: a whole number of up to {_DIGITS} digits")
    return int(text)


def reals(label: str, texts: Sequence[str]) -> list[float]:
    """Read numbers of an option that are behind a name; InputError, which begins with the label, of what is none."""
    return [_number(label, text) for text in texts]


def coordinate_values(label: str, texts: Sequence[str] | None) -> list[float] | dict[str, float] | None:
    """Return numbers in order, numbers by name if a text is NAME=VALUE, or None where no texts are given.

    Raises:
        InputError: a value is no number, or has no name where others have one, or a name is given twice; it begins
            with the label.
    """
    if texts is None:
        return None
    if any("=" in text for text in texts):
        return by_name(label, texts)
    return reals(label, texts)


def gains(label: str, texts: Sequence[str] | None) -> float | dict[str, float] | None:
    """Return one number for all, numbers by name, or None without texts; errors as of ``coordinate_values``."""
    values = coordinate_values(label, texts)
    if isinstance(values, list):
        if len(values) != 1:
            raise InputError(f"{label}: {len(values)} numbers; allowed: one number, or NAME=VALUE for each")
        return values[0]
    return values


def by_name(label: str, texts: Sequence[str]) -> dict[str, float]:
    """Read numbers by name, from NAME=VALUE; errors as of ``coordinate_values``."""
    rows = []
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            raise InputError(f"{label}: {show(text)}; allowed: NAME=VALUE")
        rows.append((name.strip(), _number(f"{label}: {name}", value)))
    return once_each(label, rows)


def once_each(label: str, rows: Iterable[tuple[str, Value]]) -> dict[str, Value]:
    """Return values by name; InputError, which begins with the label, of a name that is given twice."""
    values: dict[str, Value] = {}
    for name, value in rows:
        if name in values:
            raise InputError(f"{label}: {show(name)} is given twice; allowed: once")
        values[name] = value
    return values


def _number(label: str, text: str) -> float:
    value = _finite(text)
    if value is None:
        raise InputError(f"{label}: {show(text)} is not a number; allowed: {_NUMBERS}")
    return value


def _finite(text: str) -> float | None:
    """Return the number that a text says, if it can be computed with."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if is_usable(value) else None
