"""Required figures: the one place that decides whether a measured number reaches what is required of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Bar:
    """A measured number and what is required of it, in one unit.

    Attributes:
        what: names the figure in a sentence.
        measured: the number, or None where it was not measured.
        required: the least number, or the largest with ``at_most``.
    """

    what: str
    measured: float | None
    required: float
    at_most: bool = False

    @property
    def verdict(self) -> str:
        """Return "held", "missed" or "not measured"; a number that is NaN misses."""
        if self.measured is None:
            return "not measured"
        reached = self.measured <= self.required if self.at_most else self.measured >= self.required
        return "held" if reached else "missed"

    @property
    def is_missed(self) -> bool:
        """Return whether it was measured and does not reach what is required."""
        return self.verdict == "missed"

    @property
    def brackets(self) -> str:
        """Return what a table writes behind the number: the requirement, and that it is missed where it is."""
        return f"({self.required:g}, missed)" if self.is_missed else f"({self.required:g})"


def conclusion(bars: Iterable[Bar], figure: str = ".1f") -> str:
    """Return one sentence that names every bar that is missed or was not measured, or says that all are held."""
    bars = tuple(bars)
    said = []
    missed = [bar for bar in bars if bar.is_missed]
    if missed:
        each = "; ".join(f"{bar.what} ({bar.measured:{figure}} of {bar.required:g})" for bar in missed)
        said.append(f"Required figures that are missed: {each}.")
    absent = [bar.what for bar in bars if bar.verdict == "not measured"]
    if absent:
        said.append(f"Required and not measured: {'; '.join(absent)}.")
    return " ".join(said) if said else f"All {len(bars)} required figures are held."
