"""Numbers over time: rows of a scenario, or a file's, between which they are straight or constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError
from ..forms.tables import Table
from ..kernel.stepping.input_signals import Signal
from ..names import listed, show
from ..shown import Shown
from .files import read_columns
from .time_derivatives import Jump, by_time, order_in, times_in

LINEAR, HOLD = "linear", "hold"
INTERPOLATIONS = (LINEAR, HOLD)


@dataclass(frozen=True, eq=False)  # arrays have no one truth
class TimeTable(Shown):
    """Columns over time; before the first and after the last time they are what they are there.

    Attributes:
        columns: names, (k,).
        t: times, (T,), s, increasing.
        values: (T, k).
        hold: whether a row holds until the next (from its time on), instead of straight lines between them.
    """

    columns: tuple[str, ...]
    t: Array
    values: Array
    hold: bool = False

    def at(self, t: float) -> Array:
        """Return the columns at a time, (k,)."""
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        if i < 0 or i + 1 >= self.t.size or self.hold:
            row: Array = self.values[max(i, 0)]
            return row
        share = (t - self.t[i]) / (self.t[i + 1] - self.t[i])
        between: Array = self.values[i] + share * (self.values[i + 1] - self.values[i])
        return between

    def series(self, t: ArrayLike, order: int) -> Array:
        """Return the columns and their time derivatives up to an order, (order + 1, *t.shape, k); see ``with_series``.

        Jumps of rows that hold are no part of them.
        """
        times = times_in(t)
        rows = np.zeros((order_in(order) + 1, *times.shape, self.values.shape[1]))
        i = np.searchsorted(self.t, times, side="right") - 1
        rows[0] = self.values[np.maximum(i, 0)]
        if not self.hold and self.t.size > 1:
            inside = (times >= self.t[0]) & (times <= self.t[-1])
            piece = np.clip(i, 0, self.t.size - 2)
            rates = (np.diff(self.values, axis=0) / np.diff(self.t)[:, np.newaxis])[piece]
            ahead = np.clip(times, self.t[0], self.t[-1]) - self.t[piece]
            rows[0] = self.values[piece] + ahead[..., np.newaxis] * rates
            rows[1:2, inside] = rates[inside]
        return rows

    def jumps(self, order: int) -> tuple[Jump, ...]:
        """Return where the columns, or their time derivatives up to an order, jump, by time; see ``with_series``."""
        rates = np.diff(self.values, axis=0)
        if self.hold or self.t.size == 1:
            return by_time((Jump(t, 0) for t in self.t[1:][rates.any(axis=1)].tolist()), order)
        rates = np.pad(rates / np.diff(self.t)[:, np.newaxis], ((1, 1), (0, 0)))
        return by_time((Jump(t, 1) for t in self.t[np.diff(rates, axis=0).any(axis=1)].tolist()), order)

    def as_signal(self) -> Signal:
        """Return it as data for integrations in C."""
        if self.hold or self.t.size == 1:
            return Signal(np.append(self.t, self.t[-1] + 1.0), self.values[:, np.newaxis])
        slopes = np.diff(self.values, axis=0) / np.diff(self.t)[:, np.newaxis]
        return Signal(self.t, np.stack([self.values[:-1], slopes], axis=1))


def inline_table(table: Table, key: str, columns: tuple[str, ...], hold: bool) -> TimeTable:
    """Return the table of rows [t, ...] under a key; DescriptionError if they are none, or not in order of time."""
    rows = table.rows(key, len(columns) + 1)
    if not rows:
        table.fail(f"got no rows; allowed: one or more rows of t and {listed(columns)}", key)
    values = np.array(rows)
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0.0)
    if late.size:
        i = int(late[0]) + 1
        table.fail(f"got the time {values[i, 0]:g} after {values[i - 1, 0]:g}; allowed: increasing times", f"{key}.{i}")
    return TimeTable(columns, values[:, 0].copy(), values[:, 1:].copy(), hold)


def read_table(path: Path, columns: Sequence[str] | None, hold: bool) -> TimeTable:
    """Return the table of a .csv file: a header with t and the columns' names, in any order.

    All of ``columns`` must be there.

    Raises:
        InputError: with the file, line and column, the value and what is allowed.
    """
    columns_read, lines = read_columns(path)
    if "t" not in columns_read:
        raise InputError(f"{path}: there is no column t; allowed: t (s) and {listed(columns or ['coordinates'])}")
    t = columns_read.pop("t")
    names = tuple(columns_read) if columns is None else tuple(columns)
    known = set(names)
    missing = [name for name in names if name not in columns_read]
    foreign = [name for name in columns_read if name not in known]
    if missing or foreign or not names:
        what = f"column {show(foreign[0])} is unknown" if foreign else f"the columns {listed(missing)} are missing"
        raise InputError(f"{path}: {what}; allowed: t, {listed(names) or 'and coordinates'}")
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if back.size:
        i = int(back[0]) + 1
        place = f"line {lines[i]}" if lines is not None else f"sample {i}"
        raise InputError(f"{path}: {place}: column 't': {t[i]:g} after {t[i - 1]:g}; allowed: increasing times")
    return TimeTable(names, t, np.stack([columns_read[name] for name in names], axis=1), hold)
