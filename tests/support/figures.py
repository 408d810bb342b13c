"""Figures that long runs print at their end: counts and worst deviations, gathered over workers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

WORST, TOTAL = "worst", "total"
Found = dict[str, tuple[str, float, float | None]]


class Figures:
    """Greatest values and sums by name; ``found`` is what a test's report carries: {name: (kind, value, limit)}."""

    def __init__(self, found: Found) -> None:
        self.found = found

    def at_most(self, name: str, value: float, limit: float) -> None:
        """Fails where the value is above its limit or no number; keeps the greatest."""
        self.found[name] = merged(self.found.get(name), (WORST, value, limit))
        assert value <= limit, f"{name}: {value:.3g} is above {limit:.3g}"

    def count(self, name: str, value: float = 1) -> None:
        """Adds to a sum."""
        self.found[name] = merged(self.found.get(name), (TOTAL, value, None))


def merged(old: Any, new: Any) -> tuple[str, float, float | None]:
    if old is None:
        return (new[0], float(new[1]), new[2])
    if new[0] == TOTAL:
        return (TOTAL, old[1] + new[1], None)
    return max(old, new, key=lambda entry: entry[1])[0], max(old[1], new[1]), new[2]


def gathered(reports: Iterable[Any]) -> Mapping[str, Found]:
    """Figures of the reports by the tests' names without their parameters."""
    result: dict[str, Found] = {}
    for report in reports:
        for key, found in getattr(report, "user_properties", ()):
            if key == "figures" and getattr(report, "when", "") == "call":
                of_test = result.setdefault(report.nodeid.partition("[")[0], {})
                for name, entry in found.items():
                    of_test[name] = merged(of_test.get(name), entry)
    return result


def lines(found: Found) -> list[str]:
    """One per figure: a sum, or the worst value beside its limit."""
    texts = []
    for name, (kind, value, limit) in found.items():
        text = f"{value:,.1f}" if kind == TOTAL else f"{value:.2e}"
        texts.append(f"  {name:<62} {text:>12}" + ("" if limit is None else f"   (at most {limit:.0e})"))
    return texts
