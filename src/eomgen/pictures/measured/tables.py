"""Tables that pages about measurements have in common; each is left out where it has no rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ...identification.calibration.identifiability import unidentifiable_rows
from ...shown import interval_ends
from ..report import Table


def number(value: float | None, factor: float = 1.0, digits: int = 6) -> str:
    """Text of a number times a factor; empty where there is none."""
    return "" if value is None or not np.isfinite(value) else f"{factor * float(value):.{digits}g}"


def ends(low: float, high: float) -> tuple[str, str]:
    """Return the ends of an interval with as many digits that two of them differ; empty where they are not known."""
    return interval_ends(float(low), float(high), 6) if np.isfinite([low, high]).all() else ("", "")


def table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> tuple[Table, ...]:
    """One table, or none where it has no rows."""
    texts = tuple(tuple(row) for row in rows)
    return (Table(title, tuple(head), texts),) if texts else ()


def merged_table(merged: Mapping[str, str]) -> tuple[Table, ...]:
    """Return the table of parameters that are not identifiable, and why."""
    return table("Not identifiable", ("parameter", "why"), unidentifiable_rows(merged))


def weak_table(weak: Iterable[tuple[str, float]]) -> tuple[Table, ...]:
    """Return the table of poorly observable directions, which show less than their noise."""
    rows = [(text, number(value, 1.0, 2)) for text, value in weak]
    return table("Poorly observable directions", ("along", "std. deviation of the first, m or rad"), rows)


def columns_of(rows: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    """Rows without the columns that are empty in all of them but the head."""
    kept = [i for i in range(len(rows[0])) if any(row[i] for row in rows[1:])]
    return [tuple(row[i] for i in kept) for row in rows]
