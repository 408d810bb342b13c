"""Reading of [[springs]]: springs, dampers and cables between points of two links."""

from __future__ import annotations

from .characteristic import ReadText, curve_conflict, read_curve
from .keys import Listed
from .names import show
from .robot import SMALLEST, ZERO, Spring, Vector
from .schema import Table
from .tree import Draft


def read_spring(name: str, entry: Table, read_text: ReadText) -> Spring:
    """One entry of [[springs]].

    Args:
        entry: of the keys ``robot_keys.SPRING``.
        read_text: gives the text of the file that a curve names.

    Raises:
        DescriptionError: a key is missing or wrong, or keys do not go together.
    """
    entry.require()
    links = entry.strings("links")
    if links[0] == links[1]:
        entry.fail(f"got {show(links)}; both ends are on one link; allowed: two different links", "links")
    given = {key: entry.number(key) for key in ("free_length", "stiffness", "damping", "smoothing")}
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


def spring_conflict(given: Spring) -> tuple[str, str] | None:
    """The key and the message of what does not go together in a spring; None if all does."""
    if given.stiffness is None and given.damping is None and given.curve is None:
        return "", "it has no force; allowed: with stiffness, damping or curve"
    if given.curve is not None:
        for key, taken in (("stiffness", given.stiffness is not None), ("tension_only", given.tension_only)):
            if taken:
                return "curve", f"{key} is given, too; allowed: a curve alone says which force each elongation has"
        found = curve_conflict(given.curve, "elongation")
        if found is not None:
            return found
    if given.smoothing is not None and not given.tension_only:
        return "smoothing", "nothing sets in; allowed: smoothing with tension_only = true"
    if given.tension_only and given.smoothing is None:
        return "tension_only", f"there is no free_length and no smoothing; allowed: with one of them above {SMALLEST:g}"
    return None


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
