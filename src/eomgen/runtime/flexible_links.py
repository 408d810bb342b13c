"""Flexible links that bend too far for their modes; a package of a robot without them does not carry this module."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .raw import Array
from .singular import scaled_eigenvalues

MODE = "mode"  # begins the kinds of modal coordinates, "arm.mode1"


def bending_links(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the links that bend, by their names, with the places of their modes among coordinates."""
    found: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        link, _, kind = name.rpartition(".")
        if kind.startswith(MODE):
            found.setdefault(link, []).append(place)
    return found


def bent_too_far(mass: Callable[[Array], Array | None], q: Array, names: Sequence[str], limit: float) -> str | None:
    """Say which links bend so far that the second order of their modes has negative inertia; None if none does.

    They are those without whose deflection the mass matrix were positive definite: each by itself, or all together.

    Args:
        mass: gives the mass matrix in a state, or None.
        q: coordinates in that state, (n,), m or rad.
        names: of the coordinates.
        limit: scaled eigenvalues below it are zero, those below its negative negative.
    """

    def is_indefinite(state: Array) -> bool:
        M = mass(state)
        return M is None or not np.isfinite(M).all() or float(scaled_eigenvalues(M)[0][0]) < -limit

    def is_cause(places: Sequence[int]) -> bool:
        straight = q.copy()
        straight[places] = 0.0
        return not is_indefinite(straight)

    links = bending_links(names)
    if not links or not is_indefinite(q):
        return None
    causes = [link for link, places in links.items() if is_cause(places)]
    if not causes and is_cause([place for places in links.values() for place in places]):
        causes = [link for link, places in links.items() if q[places].any()]
    if not causes:
        return None
    values = ", ".join(f"{names[place]} = {q[place]:.4g}" for link in causes for place in links[link])
    which = f"link {causes[0]} bends" if len(causes) == 1 else f"links {' and '.join(causes)} bend"
    return (
        f"{which} farther than modes of second order reach ({values}); allowed: smaller deflections, of which"
        f" eomgen info has the range, or a link that is cut in two"
    )
