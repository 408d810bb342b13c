"""Reading of [[loops]]: joints that are cut, so that the rest of the robot is a tree."""

from __future__ import annotations

from collections.abc import Callable

from ..forms.tables import Pair, Table
from ..names import show
from ..robot.geometry import ZERO
from ..robot.value import COORDINATES, Coordinate, Loop, Placement
from .draft import Draft
from .forces import ReadText, journal, read_coordinate


def read_loop(name: str, entry: Table, beside: Callable[[Table], ReadText]) -> Loop:
    """One entry of [[loops]].

    Args:
        entry: of the keys ``LOOP``.
        beside: of a coordinate's table what gives the text of the file that its curve names.

    Raises:
        DescriptionError: a key is missing or wrong, keys do not go together, or the loop joins a link to itself.
    """
    entry.require()
    links = entry.strings("links")
    if links[0] == links[1]:
        entry.fail(f"got {show(links)}; a loop cannot join a link to itself; allowed: two different links", "links")
    kind = entry.choice("type")
    assert kind is not None
    tables = {key: table for key in COORDINATES if (table := entry.table(key)) is not None}
    coordinates = {key: read_coordinate(table, Coordinate(), beside(table)) for key, table in tables.items()}
    offset, radial = _offset(entry), journal(entry, coordinates)
    return Loop(name, (links[0], links[1]), kind, _placements(entry), coordinates, offset, radial)


def _offset(entry: Table) -> tuple[float | None, ...]:
    table = entry.table("offset")
    return tuple(None if table is None or key not in table else table.number(key) for key in COORDINATES)


def _placements(entry: Table) -> tuple[Placement, Placement]:
    """The cut joint's frame on both links; a placement that is left out is the link's own frame."""
    tables: list[Table] | None = entry.value("placements", Pair)
    if tables is None:
        return Placement(), Placement()
    first, second = (read_placement(table) for table in tables)
    return first, second


def read_placement(table: Table) -> Placement:
    """The pose that a table of ``xyz`` (m) and ``rpy`` (rad) gives; what is left out is zero."""
    xyz, rpy = table.vector("xyz") or ZERO, table.vector("rpy")
    return Placement(xyz) if rpy is None else Placement.from_rpy(xyz, rpy)


def check_loops(draft: Draft) -> None:
    """DescriptionError if a loop names a link that does not exist."""
    for loop in draft.loops.values():
        for place, link in enumerate(loop.links):
            draft.check_link(link, f"loops.{loop.name}.links.{place}")
