"""Numbers that know what they come from, as programs keep them; ``tree.traced`` computes with them."""

from __future__ import annotations


class Named(float):
    """A number with what it comes from.

    Attributes:
        term: a name, or an operator and two numbers.
    """

    __slots__ = ("term",)


def to_float(number: float) -> float:
    """Return a number as a float; one with a name keeps it."""
    return number if isinstance(number, Named) else float(number)
