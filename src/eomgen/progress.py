"""Functions that callers hand in, and that long work tells how far it has come."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]  # called with the fraction that is done, from 0 to 1, and a line of text
StageReport = Callable[[str], None]  # called with a line of text when a stage begins


def no_progress(_fraction: float, _text: str) -> None:
    """Say nothing: a Progress."""


def no_report(_text: str) -> None:
    """Say nothing: a StageReport."""
