"""External wrenches by the names of frames and links, as rows of links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, UnknownNameError
from ..names import listed, nearest_or_all, parameter_name, show
from .arrays import joint_lead, numbers_in
from .calls import Calls
from .raw import Array

WrenchLike = ArrayLike | Mapping[str, ArrayLike]  # rows of links, (links, 6), or wrenches by frame or link
ALLOWED = "six finite numbers, (6,) or (..., 6): force (N), then moment (N m)"


class Place(NamedTuple):
    """Place of a wrench: the link's row, its number among the frames, and the arm from its centre of mass, (3,), m.

    The arm is in the link's axes; None is at the centre of mass.
    """

    link: int
    frame: int
    arm: Array | None


def wrench_rows(calls: Calls, q: ArrayLike, wrench: WrenchLike | None) -> ArrayLike | None:
    """Return rows of links, (..., links, 6), about centres of mass in the base frame; what is no mapping as it came.

    Args:
        calls: of a kernel with kinematics, where wrenches are at frames.
        q: (n,) or (..., n).
        wrench: by name, (6,) or (..., 6), base frame: at a frame's origin, or about a link's centre of mass.

    Raises:
        UnknownNameError: a name is none of a frame or link that moves.
        ArrayError: a wrench is not six finite numbers, or does not go together with q.
    """
    if not isinstance(wrench, Mapping):
        return wrench
    values = {name: (place_of_wrench(calls, name), wrench_numbers(calls, name, x)) for name, x in wrench.items()}
    states, lead = calls.array("q", q, (calls.n,))
    for name, (_, numbers) in values.items():
        lead = joint_lead(f"wrench: {name}", numbers.shape[:-1], lead)
    rows = np.zeros((*lead, len(calls.raw.libraries.meta["links"]), 6), calls.dtype)
    for place, numbers in values.values():
        rows[..., place.link, :] += numbers
        if place.arm is not None:
            R_0k = calls.run(calls.raw.writing("pose").name, None, (states,), (place.frame,))[..., :3, :3]
            rows[..., place.link, 3:] += np.cross(R_0k @ place.arm, numbers[..., :3])
    return rows


def place_of_wrench(calls: Calls, name: str) -> Place:
    """Return the place of a wrench by name; UnknownNameError where there is nothing that moves."""
    meta = calls.raw.libraries.meta
    links, frames = list(meta["links"]), list(meta["frames"])
    carriers: Mapping[str, str] = meta.get("frame_links", {})
    known = [*(frame for frame, link in carriers.items() if link in links), *links]
    if name not in known:
        if name in frames:
            raise UnknownNameError(f"wrench: {show(name)} does not move; allowed: {listed(known)}")
        raise UnknownNameError(f"wrench: {show(name)} is unknown{nearest_or_all(str(name), known)}")
    if name not in carriers:
        return Place(links.index(name), frames.index(name), None)
    link = carriers[name]
    if link in carriers or name in links:
        both = link if link in carriers else name
        raise UnknownNameError(
            f"wrench: {show(name)}: {show(both)} names a frame and a link; allowed: another name for the frame, or an"
            f" array of shape ({len(links)}, 6)"
        )
    zero = np.zeros(calls.n, calls.dtype)
    T_0f, T_0k = (calls.run(calls.raw.writing("pose").name, None, (zero,), (frames.index(x),)) for x in (name, link))
    arm = T_0k[:3, :3].T @ (T_0f[:3, 3] - T_0k[:3, 3]) - _centre_of_mass(calls, link)
    return Place(links.index(link), frames.index(link), np.asarray(arm, calls.dtype))


def _centre_of_mass(calls: Calls, link: str) -> Array:
    """Return a link's centre of mass in its axes, (3,), m, with the parameters of now."""
    described = calls.raw.libraries.meta["coms"][link]
    names = [parameter_name("links", link, "com", axis) for axis in "xyz"]
    return np.array([calls.parameters.get(name, x) for name, x in zip(names, described, strict=True)], calls.dtype)


def wrench_numbers(calls: Calls, name: str, value: Any) -> Array:
    """Return a wrench as an array of the kernel's dtype, (6,) or (..., 6)."""
    numbers = numbers_in(f"wrench: {name}", value, ALLOWED, finite=calls.checks)
    if not numbers.ndim or numbers.shape[-1] != 6:
        raise ArrayError(f"wrench: {name}: got {show(value)}; allowed: {ALLOWED}")
    with np.errstate(over="ignore"):
        return np.asarray(numbers, calls.dtype)
