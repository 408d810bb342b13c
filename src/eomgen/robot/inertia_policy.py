"""The inertia policy: which links are bodies, and what happens to those that are not.

A link is a body if its 4x4 pseudo-inertia H = [[J, m c], [m c^T, m]] is positive semi-definite.  About the centre of
mass H is block diagonal, so that means: m >= 0, and J_c = 1/2 tr(I_c) 1 - I_c has no negative eigenvalue.  This covers
positive moments and the triangle rule; a thin rod and a massless link are bodies.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..errors import DescriptionError, EomgenWarning
from ..names import listed
from .value import Joint, Link

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

POLICIES = ("error", "warn", "project")
ROUND_OFF = 1e-9  # relative to the largest eigenvalue of J_c, or to mass size^2 where that is more
WAYS_OUT = 'inertia = "warn" takes it as it is, inertia = "project" the nearest possible body (or --inertia)'
Spots = Callable[[Sequence[str]], list[str]]


@dataclass(frozen=True)
class Judged:
    """A link, its policy, and its size.

    Attributes:
        link: mass in kg, inertia in kg m^2 about the centre of mass.
        policy: "error", "warn" (as it is) or "project" (mass and com kept, negative eigenvalues of J_c put to zero).
        size: of the link, m: its inertia may have round-off of the order of mass size^2.
    """

    link: Link
    policy: str
    size: float = 0.0


def apply_inertia_policy(
    judged: Sequence[Judged], *, source: str = "", spots: Spots = lambda names: [""] * len(names)
) -> tuple[tuple[Link, ...], tuple[str, ...]]:
    """Return the links that their policies let through, and one note per link that is no body.

    Args:
        judged: the links.
        source: the description's name, for messages.
        spots: where a file speaks of the links of these names, for notes; "" where that is not known.

    Raises:
        DescriptionError: a link of policy "error" is no body.
    """
    if not judged:
        return (), ()
    import numpy as np

    links = [each.link for each in judged]
    lowest = lowest_moments(links, [each.size for each in judged])
    bad = [int(k) for k in np.flatnonzero(lowest < 0.0)]
    refused = [k for k in bad if judged[k].policy == "error"]
    if refused:
        first, others = links[refused[0]], [links[k].name for k in refused[1:]]
        more = f" The same holds for {listed(others)}." if others else ""
        message = f"{_diagnosis(first, lowest[refused[0]])}; {WAYS_OUT}.{more}"
        raise DescriptionError(message, where=f"links.{first.name}.inertia", source=source)
    said: dict[int, str] = {}
    for k in bad:
        said[k] = f"{_diagnosis(links[k], lowest[k])}; taken as it is"
        if judged[k].policy == "project":
            projected = replace(links[k], inertia=_nearest_body(second_moments([links[k]])[0]))
            said[k] = f"{_diagnosis(links[k], lowest[k])}; projected to {_shown(projected)}"
            links[k] = projected
    warned = set(said)
    for k, link in enumerate(links):
        if link.mass == 0.0 and any(link.inertia):
            said.setdefault(k, "it has inertia but no mass; taken as it is")
    notes = []
    for k, spot in zip(said, spots([links[k].name for k in said]), strict=True):
        note = f"{spot}: link {links[k].name}: {said[k]}" if spot else f"link {links[k].name}: {said[k]}"
        notes.append(note)
        if k in warned:
            about = note if spot or not source else f"{source}: {note}"
            warnings.warn(about, EomgenWarning, stacklevel=7)  # who called load_robot
    return tuple(links), tuple(notes)


def link_sizes(links: Mapping[str, Link], joints: Sequence[Joint]) -> dict[str, float]:
    """Return the size of each link, m, by name: distances of its centre of mass and of its joints from its origin."""
    sizes = {name: math.hypot(*link.com) for name, link in links.items()}
    for joint in joints:
        if joint.parent in sizes:
            sizes[joint.parent] = max(sizes[joint.parent], math.hypot(*joint.placement.xyz))
    return sizes


def lowest_moments(links: Sequence[Link], sizes: Sequence[float]) -> NDArray[np.float64]:
    """Return the lowest eigenvalue of each link's J_c, (links,), kg m^2; 0 where it is below zero by round-off alone.

    Args:
        links: at least one.
        sizes: of the links, m, see ``Judged``.
    """
    import numpy as np

    lowest, highest = np.linalg.eigvalsh(second_moments(links))[:, (0, -1)].T
    spread = [link.mass * size**2 for link, size in zip(links, sizes, strict=True)]
    scale = np.maximum(np.maximum(abs(lowest), abs(highest)), spread)
    moments: NDArray[np.float64] = np.where(lowest < -ROUND_OFF * scale, lowest, np.maximum(lowest, 0.0))
    return moments


def second_moments(links: Sequence[Link]) -> NDArray[np.float64]:
    """Return J_c = 1/2 tr(I) 1 - I of each link about its centre of mass, (links, 3, 3), kg m^2, link axes."""
    import numpy as np

    xx, yy, zz, xy, xz, yz = np.array([link.inertia for link in links], dtype=float).reshape(-1, 6).T
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    moments: NDArray[np.float64] = 0.5 * (xx + yy + zz)[:, None, None] * np.eye(3) - inertia
    return moments


def _nearest_body(moment: NDArray[np.float64]) -> tuple[float, float, float, float, float, float]:
    """Return the inertia of J_c with its negative eigenvalues set to zero: the nearest in the Frobenius norm."""
    import numpy as np

    values, vectors = np.linalg.eigh(moment)
    clipped = (vectors * np.maximum(values, 0.0)) @ vectors.T
    ((xx, xy, xz), (_, yy, yz), (_, _, zz)) = (np.trace(clipped) * np.eye(3) - clipped).tolist()
    return xx, yy, zz, xy, xz, yz


def _diagnosis(link: Link, eigenvalue: float) -> str:
    return (
        f"no body can have the inertia {_shown(link)}: its second moment 1/2 tr(I) 1 - I about the centre of mass has "
        f"the eigenvalue {eigenvalue:.3g} kg m^2 (allowed: none below zero, so each principal moment of inertia is at "
        "most the sum of the others)"
    )


def _shown(link: Link) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in link.inertia) + ") [xx yy zz xy xz yz]"
