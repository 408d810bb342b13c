"""Stops at limits: of one joint, and on request of all joints with limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from ..errors import DescriptionError
from ..forms.tables import Form, Table
from ..names import component_name, joint_of, kind_of, listed, show
from ..robot.value import PRINCIPAL, Coordinate
from .draft import Draft
from .keys import STOPS

Limits = tuple[float, float]
_PLACES = "stops.lower", "stops.upper"


def stop_numbers(table: Table) -> dict[str, float]:
    """Return numbers of a table of the keys ``STOPS``, by the names of the law: "stops.stiffness"."""
    read = {f"stops.{key}": table.number(key) for key in table.keys}
    return {key: number for key, number in read.items() if number is not None}


def requested_stops(numbers: Mapping[str, object]) -> dict[str, float]:
    """Return the numbers of stops from a caller's mapping.

    Raises:
        DescriptionError: it is no mapping, a key is unknown or missing, or a number out of its range.
    """
    if not isinstance(numbers, Mapping):
        raise DescriptionError(f"got {show(numbers)}; allowed: a mapping with {listed(STOPS.keys)}", where="stops")
    table = Form(STOPS.keys).read(dict(numbers), "stops", "", ())
    table.require()
    return stop_numbers(table)


def joint_stops(entry: Table, kind: str, coordinates: Mapping[str, Coordinate], limits: Limits) -> Coordinate:
    """Return a joint's principal coordinate with stops at the joint's limits, of its table ``stops``.

    Args:
        entry: of the joint.
        kind: its type.
        coordinates: that are active.
        limits: m or rad; a side that is infinite has no stop.

    Raises:
        DescriptionError: there is nothing to stop, or no limit to stop it at.
    """
    table, principal = entry.table("stops"), PRINCIPAL.get(kind)
    assert table is not None
    if principal is None:
        entry.fail(f"a {kind} joint has no principal coordinate to stop; allowed for: {', '.join(PRINCIPAL)}", "stops")
    if principal not in coordinates:
        entry.fail(f"{principal} is locked, so that stops would do nothing; leave one of the two out", "stops")
    numbers = stop_numbers(table) | _places(limits)
    if not any(place in numbers for place in _PLACES):
        entry.fail("there are no limits to stop at; allowed: with limits = [lower, upper]", "stops")
    old = coordinates[principal]
    if principal in entry and "stops" in entry.values[principal]:
        entry.fail(f"{principal} has stops in its table, too; allowed: one of them", "stops")
    return old.with_numbers(numbers)


def stop_all(draft: Draft, numbers: Mapping[str, float]) -> None:
    """Put stops at all limits whose coordinates have none yet; a note says where there is no room between limits.

    Args:
        numbers: of the stops, without their places, as of ``stop_numbers``.
    """
    ranges = _ranges(draft)
    stopped, narrow = 0, []
    for name, limits in ranges.items():
        joint = draft.joints[joint_of(name)]
        coordinate = joint.coordinates.get(kind_of(name))
        if coordinate is None or "stops.stiffness" in coordinate.further:
            continue
        if not limits[0] < limits[1]:
            narrow.append(name)
            continue
        made = coordinate.with_numbers({**numbers, **_places(limits)})
        draft.joints[joint.name] = replace(joint, coordinates={**joint.coordinates, kind_of(name): made})
        stopped += 1
    if narrow:
        draft.notes.append(f"limits without room between them have no stops: {listed(narrow)}")
    if not stopped:
        draft.notes.append("stops are asked for, and there are no limits to put them at")


def _ranges(draft: Draft) -> dict[str, Limits]:
    """Return limits by the name of the coordinate."""
    if draft.ranges is not None:
        return draft.ranges
    ranges = {
        component_name(joint.name, name): joint.limits_of(name).range
        for joint in draft.joints.values()
        for name in joint.coordinates
    }
    return {name: limits for name, limits in ranges.items() if _places(limits)}


def _places(limits: Limits) -> dict[str, float]:
    return {key: place for key, place in zip(_PLACES, limits, strict=True) if math.isfinite(place)}
