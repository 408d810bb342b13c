"""Reading of [[springs]]: springs, dampers and cables between points of two links."""

from __future__ import annotations

from ..forms.keys import Listed
from ..forms.tables import Table
from ..names import show
from ..robot.geometry import ZERO, Vector
from ..robot.laws import BETWEEN_POINTS
from ..robot.rules import spring_conflict
from ..robot.value import Spring
from .draft import Draft
from .forces import ReadText, read_curve


def read_spring(name: str, entry: Table, read_text: ReadText) -> Spring:
    """One entry of [[springs]].

    Args:
        entry: of the keys ``SPRING``.
        read_text: gives the text of the file that a curve names.

    Raises:
        DescriptionError: a key is missing or wrong, or keys do not go together.
    """
    entry.require()
    links = entry.strings("links")
    if links[0] == links[1]:
        entry.fail(f"got {show(links)}; both ends are on one link; allowed: two different links", "links")
    given = {key: entry.number(key) for key in BETWEEN_POINTS if key != "curve"}
    spring = Spring(
        name,
        (links[0], links[1]),
        _points(entry),
        **given,
        tension_only=entry.boolean("tension_only") or False,
        curve=read_curve(entry, read_text, "elongation"),
    )
    found = spring_conflict(spring)
    if found is not None:
        entry.fail(found[1], found[0])
    return spring


def _points(entry: Table) -> tuple[Vector, Vector]:
    """The spring's ends in the links' frames, m; the frames' origins where none are given."""
    points: list[tuple[float, ...]] | None = entry.value("points", Listed)
    if points is None:
        return ZERO, ZERO
    (a, b, c), (d, e, f) = points
    return (a, b, c), (d, e, f)


def check_springs(draft: Draft) -> None:
    """DescriptionError if a spring names a link that does not exist."""
    for spring in draft.springs.values():
        for place, link in enumerate(spring.links):
            draft.check_link(link, f"springs.{spring.name}.links.{place}")
