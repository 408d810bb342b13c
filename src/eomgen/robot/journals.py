"""Journals in round bearings: the contact of a joint's x and y, of alpha and beta where the bearing has a length."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..limits import LARGEST
from .laws import RADIAL, SHARE, SMALLEST, SMOOTHING

CROSSWISE = ("x", "y")
TILTING = ("alpha", "beta")
TURNING = "gamma"


@dataclass(frozen=True)
class SlidingFriction:
    """Dry friction of a contact at the sliding rate v: coefficient times the normal force, times sgn(v).

    radius: m, of the journal, whose turning then slides, too; None where only its motion across does.
    sgn(v) is v / sqrt(v^2 + smoothing^2); smoothing: m/s, ``laws.SMOOTHING`` where it is None.
    """

    coefficient: float
    radius: float | None = None
    smoothing: float | None = None

    def __post_init__(self) -> None:
        if self.smoothing is None:
            object.__setattr__(self, "smoothing", SMOOTHING)


@dataclass(frozen=True)
class Radial:
    """Contact of a journal, which the joint's child carries, in a round bearing of its parent.

    The centre of the journal is e = sqrt(x^2 + y^2) off that of the bearing; what of e lies beyond the ``clearance``
    (m) is pushed back along (x, y) as the ends of a coordinate's clearance push: with ``stiffness`` (N/m),
    ``restitution_damping`` (s/m), and over ``smoothing`` (m), a twentieth of the clearance where it is None.
    With a ``length`` (m) the points length / 2 before and behind the joint's origin on the journal's axis touch, each.
    """

    clearance: float
    stiffness: float
    length: float | None = None
    restitution_damping: float | None = None
    smoothing: float | None = None
    friction: SlidingFriction | None = None

    def __post_init__(self) -> None:
        if self.smoothing is None and self.clearance:
            object.__setattr__(self, "smoothing", max(SHARE * self.clearance, SMALLEST))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The joint's coordinates that move the places of contact."""
        return CROSSWISE if self.length is None else (*CROSSWISE, *TILTING)

    @property
    def felt(self) -> tuple[str, ...]:
        """The joint's coordinates that the contacts feel: with a sliding radius its turning, too."""
        slides = self.friction is not None and self.friction.radius is not None
        return (*self.coordinates, TURNING) if slides else self.coordinates

    def law(self) -> dict[str, float]:
        """The numbers that are given, by their names: "clearance", "friction.coefficient"."""
        found = {key: value for key, value in vars(self).items() if key != "friction" and value is not None}
        rubbing = vars(self.friction) if self.friction else {}
        return found | {f"friction.{key}": value for key, value in rubbing.items() if value is not None}


def radial_conflict(given: Radial, active: Mapping[str, Any]) -> tuple[str, str] | None:
    """The key ("" for the table) and the message of what is wrong with a journal in a joint; None if nothing is.

    Args:
        active: the joint's coordinates.
    """
    for name in given.coordinates:
        if name not in active:
            why = "" if name in CROSSWISE else " with a length"
            return "", f"{name} does not move; allowed{why}: where {', '.join(given.coordinates)} have tables"
        if active[name].clearance is not None:
            return "", f"{name} has a clearance of its own; allowed: {RADIAL} or clearances, not both"
    for name, coordinate in active.items():
        if coordinate.friction is not None and coordinate.friction.coefficient is not None:
            return (
                "",
                f"{name} has friction with a coefficient of its own; allowed: friction in {RADIAL}, with a radius",
            )
    if not 0.0 < given.stiffness <= LARGEST:
        return "stiffness", f"got {given.stiffness!r}; allowed: a finite number greater than 0, N/m"
    if given.smoothing is None:
        return "clearance", f"got 0 and no smoothing; allowed: 0 with a smoothing of at least {SMALLEST:g}"
    if given.friction is not None and given.friction.radius is not None and TURNING not in active:
        return (
            "friction.radius",
            f"{TURNING} does not move; allowed: where it is a coordinate (of a cut joint: with a table)",
        )
    return None
