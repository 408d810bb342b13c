"""Reading of [[loops]], loop joints that are cut so that the rest is a tree, and [[couplings]] of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ..forms.keys import ByName
from ..forms.tables import Pair, Table
from ..names import show
from ..robot.joint_types import CUTS
from ..robot.value import COORDINATES, Coordinate, Coupling, Loop
from .forces import ReadText, joint_elements, read_coordinate, read_placement
from .keys import CUT_COORDINATE


def read_loop(
    name: str, entry: Table, beside: Callable[[Table], ReadText], folder: Path | None, notes: list[str]
) -> Loop:
    """Read one entry of [[loops]].

    Args:
        entry: of the keys ``LOOP``.
        beside: returns, of a coordinate's table, a reader of the file that its curve names.
        folder: where files of matrices are looked for; None where there is none.
        notes: is told what is left out.

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
    coordinates = {key: read_coordinate(table, Coordinate(), beside(table), notes) for key, table in tables.items()}
    made = Loop(name, (links[0], links[1]), kind, coordinates=coordinates, offset=read_offset(entry))
    first, second = map(read_placement, entry.value("placements", Pair)) if "placements" in entry else made.placements
    blocked = {component.name for component in CUTS[kind]}
    free = [name for name in COORDINATES if name not in blocked and name not in coordinates]
    return replace(made, placements=(first, second), **joint_elements(entry, coordinates, folder, notes, free))


def read_offset(entry: Table, old: Sequence[float | None] = (None,) * len(COORDINATES)) -> tuple[float | None, ...]:
    """Return the offsets of a joint or loop joint: the old ones with the overrides of its table ``offset``."""
    table = entry.table("offset")
    numbers = [None if table is None or key not in table else table.number(key) for key in COORDINATES]
    return tuple(before if new is None else new for before, new in zip(old, numbers, strict=True))


def read_coupling(name: str, entry: Table, read_text: ReadText, notes: list[str]) -> Coupling:
    """Read one entry of [[couplings]], of the keys ``COUPLING``; other arguments and errors as ``read_coordinate``."""
    entry.require()
    forces = {key: value for key, value in entry.values.items() if key in CUT_COORDINATE.keys}
    law = None
    if forces:
        inner = CUT_COORDINATE.read(forces, entry.where, entry.source, entry.path)
        law = read_coordinate(inner, Coordinate(), read_text, notes)
    ratios: dict[str, float] = entry.value("to", ByName)
    return Coupling(name, entry.text("of") or "", ratios, entry.number("offset"), law)
