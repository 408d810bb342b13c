"""Bars that measurements have to reach: whether they do is decided here alone, and said alike on every page."""

from __future__ import annotations

HELD, MISSED, UNKNOWN = "held", "missed", "not measured"


def is_held(value: float | None, bar: float, *, at_most: bool = False) -> bool | None:
    """Whether a measured value reaches its bar: at least that, or at most; None where nothing was measured.

    What is not a number reaches nothing.
    """
    if value is None:
        return None
    return value <= bar if at_most else value >= bar


def verdict(value: float | None, bar: float, *, at_most: bool = False) -> str:
    """The word for it: HELD, MISSED, or UNKNOWN where nothing was measured."""
    return {True: HELD, False: MISSED, None: UNKNOWN}[is_held(value, bar, at_most=at_most)]


def bracket(value: float | None, bar: float | None, *, at_most: bool = False) -> str:
    """Text behind a number in a table: its bar in brackets, with a word where that is missed; "" without one."""
    if bar is None:
        return ""
    said = f", {MISSED}" if verdict(value, bar, at_most=at_most) == MISSED else ""
    return f" ({bar:g}{said})"
