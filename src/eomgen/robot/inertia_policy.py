"""The inertia policy: which links are bodies, and what happens to those that are not.

A link is a body if its 4x4 pseudo-inertia H = [[J, m c], [m c^T, m]] is positive semi-definite.  About the centre of
mass H is block diagonal, so that means: m >= 0, and J_c = 1/2 tr(I_c) 1 - I_c has no negative eigenvalue.  This covers
positive moments and the triangle rule; a thin rod and a massless link are bodies.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..errors import DescriptionError, EomgenWarning
from ..names import listed, show
from .value import Link

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

POLICIES = ("error", "warn", "project")
ROUND_OFF = 1e-9  # relative to the largest eigenvalue of J_c
WAYS_OUT = 'inertia = "warn" takes it as it is, inertia = "project" the nearest possible body (or --inertia)'


def apply_inertia_policy(
    links: Sequence[Link], policy: str, *, base: str = "", source: str = ""
) -> tuple[tuple[Link, ...], tuple[str, ...]]:
    """The links that the policy lets through, and one note per link that is no body.

    Args:
        links: mass in kg, inertia in kg m^2 about the centre of mass.
        base: the name of the link that is fixed to the ground, for messages.
        policy: "error", "warn" (as it is) or "project" (mass and com kept, negative eigenvalues of J_c put to zero).
        source: the description's name, for messages.

    Raises:
        DescriptionError: the policy is "error" and a link is no body, or the policy does not exist.
    """
    if policy not in POLICIES:
        raise DescriptionError(f"got {show(policy)}; allowed: {', '.join(POLICIES)}", where="inertia", source=source)
    if not links:
        return (), ()
    import numpy as np

    moments = second_moments(links)
    lowest, highest = np.linalg.eigvalsh(moments)[:, (0, -1)].T
    bad = [int(k) for k in np.flatnonzero(lowest < -ROUND_OFF * np.maximum(abs(lowest), abs(highest)))]
    result, notes = list(links), []
    if bad and policy == "error":
        first, others = links[bad[0]], [links[k].name for k in bad[1:]]
        more = f" The same holds for {listed(others)}." if others else ""
        where = f"links.{first.name}.inertia"
        root = " (this link is fixed to the ground, so its inertia has no effect)" if first.name == base else ""
        message = f"{_diagnosis(first, lowest[bad[0]])}; {WAYS_OUT}{root}.{more}"
        raise DescriptionError(message, where=where, source=source)
    for k in bad:
        note = f"link {links[k].name}: {_diagnosis(links[k], lowest[k])}; "
        if policy == "project":
            result[k] = replace(links[k], inertia=_nearest_body(moments[k]))
            note += f"projected to {_shown(result[k])}"
        else:
            note += "taken as it is"
        notes.append(note)
        warnings.warn(f"{source}: {note}" if source else note, EomgenWarning, stacklevel=5)
    for k in sorted(set(range(len(links))) - set(bad)):
        if links[k].mass == 0.0 and any(links[k].inertia):
            notes.append(f"link {links[k].name}: it has inertia but no mass; taken as it is")
    return tuple(result), tuple(notes)


def second_moments(links: Sequence[Link]) -> NDArray[np.float64]:
    """J_c = 1/2 tr(I) 1 - I of each link about its centre of mass, (links, 3, 3), kg m^2, link axes."""
    import numpy as np

    xx, yy, zz, xy, xz, yz = np.array([link.inertia for link in links], dtype=float).reshape(-1, 6).T
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    moments: NDArray[np.float64] = 0.5 * (xx + yy + zz)[:, None, None] * np.eye(3) - inertia
    return moments


def _nearest_body(moment: NDArray[np.float64]) -> tuple[float, float, float, float, float, float]:
    """Inertia of J_c with its negative eigenvalues put to zero: the nearest one in the Frobenius norm."""
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
