"""Figures that long runs print at their end: counts and worst deviations, gathered over workers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

WORST, TOTAL = "worst", "total"
Figure = tuple[str, float, float | None]  # kind, value, limit


class Figures:
    """Greatest values and sums by name, in the dictionary that a test's report carries."""

    def __init__(self, recorded: dict[str, Figure]) -> None:
        self.recorded = recorded

    def at_most(self, name: str, value: float, limit: float) -> None:
        """Fails where the value is above its limit or no number; keeps the greatest."""
        self.recorded[name] = merged(self.recorded.get(name), (WORST, value, limit))
        assert value <= limit, f"{name}: {value:.3g} is above {limit:.3g}"

    def count(self, name: str, value: float = 1) -> None:
        """Adds to a sum."""
        self.recorded[name] = merged(self.recorded.get(name), (TOTAL, value, None))


def merged(old: Any, new: Any) -> tuple[str, float, float | None]:
    if old is None:
        return (new[0], float(new[1]), new[2])
    if new[0] == TOTAL:
        return (TOTAL, old[1] + new[1], None)
    return max(old, new, key=lambda entry: entry[1])[0], max(old[1], new[1]), new[2]


def gathered(reports: Iterable[Any]) -> Mapping[str, dict[str, Figure]]:
    """Figures of the reports by the tests' names without their parameters."""
    by_test: dict[str, dict[str, Figure]] = {}
    for report in reports:
        for key, figures in getattr(report, "user_properties", ()):
            if key == "figures" and getattr(report, "when", "") == "call":
                of_test = by_test.setdefault(report.nodeid.partition("[")[0], {})
                for name, figure in figures.items():
                    of_test[name] = merged(of_test.get(name), figure)
    return by_test


def lines(figures: Mapping[str, Figure]) -> list[str]:
    """Return a line per figure: a sum, or the worst value beside its limit."""
    texts = []
    for name, figure in figures.items():
        value, limit = shown(figure)
        texts.append(f"  {name:<62} {value:>12}" + (f"   (at most {limit})" if limit else ""))
    return texts


def shown(figure: Figure) -> tuple[str, str]:
    """Return the value as text, and its limit, empty where it has none."""
    kind, value, limit = figure
    return f"{value:,.1f}" if kind == TOTAL else f"{value:.2e}", "" if limit is None else f"{limit:.0e}"
