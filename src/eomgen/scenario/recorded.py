"""Scenarios that results keep, as ``Scenario.as_dict`` wrote them: of the types that a Scenario has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..forms.plain import value_of
from ..motion.timetable import TimeTable
from ..names import show
from .value import Scenario, Wrench


def scenario_from_record(record: Mapping[str, Any], where: str) -> Scenario:
    """Return the scenario of a record; references that Python made are there by the names of their types alone.

    Raises:
        InputError: it is no such record; the message begins with ``where``.
    """
    scenario: Scenario = value_of(Scenario, record, where)
    if not scenario.duration > 0.0:
        raise InputError(f"{where}: duration: got {show(scenario.duration)}; allowed: a time in s greater than 0")
    wrenches = tuple(
        _with_arrays(wrench, f"{where}: wrenches[{i}].table") for i, wrench in enumerate(scenario.wrenches)
    )
    return replace(scenario, wrenches=wrenches)


def _with_arrays(wrench: Wrench, where: str) -> Wrench:
    table = wrench.table
    t, values = np.array(table.t, dtype=np.float64), np.array(table.values, dtype=np.float64)
    if t.ndim != 1 or not t.size or values.shape != (t.size, len(table.columns)):
        wanted = f"({t.size}, {len(table.columns)})"
        raise InputError(f"{where}.values: got the shape {values.shape}; allowed: {wanted}, a row for each time")
    if (np.diff(t) <= 0.0).any():
        raise InputError(f"{where}.t: got times that do not increase; allowed: increasing times")
    return replace(wrench, table=TimeTable(table.columns, t, values, table.hold))
