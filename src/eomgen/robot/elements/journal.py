"""Journal bearings (revolute clearance joints): contact of a joint's x and y, of alpha and beta with a length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

from ...limits import LARGEST
from ..laws import SHARE, SMOOTHING
from ..numbers import SMALLEST, Conflict, Number, by_key, divisor
from .joint_element import JointElement

RADIAL = "radial"  # a joint's table of its journal

CROSSWISE = ("x", "y")
TILTING = ("alpha", "beta")
TURNING = "gamma"


@dataclass(frozen=True)
class SlidingFriction:
    """Coulomb friction of a contact at the sliding velocity v: coefficient times the normal force, times sgn(v).

    radius: m, of the journal, whose rotation then slides, too; None where only its motion across does.
    sgn(v) is v / sqrt(v^2 + smoothing^2); smoothing: m/s, ``laws.SMOOTHING`` where it is None.
    """

    coefficient: float
    radius: float | None = None
    smoothing: float | None = None

    def __post_init__(self) -> None:
        if self.smoothing is None:
            object.__setattr__(self, "smoothing", SMOOTHING)


@dataclass(frozen=True)
class Radial(JointElement):
    """Contact of a journal on the joint's child in a round bearing of its parent.

    The centre of the journal is at e = sqrt(x^2 + y^2) from that of the bearing; the penetration, e less the
    ``clearance`` (m), is pushed back along (x, y) as at the ends of a coordinate's clearance: with ``stiffness`` (N/m),
    ``restitution_damping`` (s/m), and over ``smoothing`` (m), a twentieth of the clearance where it is None.
    With a ``length`` (m) the points length / 2 before and behind the joint's origin on the journal's axis touch, each.
    """

    clearance: float
    stiffness: float
    length: float | None = None
    restitution_damping: float | None = None
    smoothing: float | None = None
    friction: SlidingFriction | None = None

    TABLE: ClassVar[str] = RADIAL
    FAMILIES: ClassVar[Mapping[str, str]] = MappingProxyType({"joints": "bearings", "loops": "cut_bearings"})
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(
        Number(
            "clearance",
            "radial gap, the bearing's radius less the journal's",
            ("m",),
            needed="the radial gap in m, at least 0",
        ),
        Number("stiffness", "of each contact, greater than 0", ("N/m",), needed="a stiffness in N/m, above 0"),
        divisor(
            "length", "of the bearing, which then touches at both ends; default one contact, in the middle", ("m",)
        ),
        Number(
            "restitution_damping",
            "multiplies a contact's force by 1 + restitution_damping * velocity of its penetration",
            ("s/m",),
        ),
        divisor("smoothing", "over which a contact sets in; default clearance / 20", ("m",)),
        Number(
            "friction.coefficient",
            "friction along the tangent per normal force",
            ("1",),
            needed="a number that is at least 0",
        ),
        Number("friction.radius", "of the journal; with it the velocity of gamma slides, too", ("m",)),
        divisor(
            "friction.smoothing",
            f"velocity s over which friction reverses, sgn(v) = v / sqrt(v^2 + s^2); default {SMOOTHING:g}",
            ("m/s",),
        ),
    )
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "joints": "contact of a journal, which moves along x and y, in a round bearing",
            "loops": "contact of the second link's journal, whose x and y have tables, in a round bearing of the first"
            " one",
            "friction": "Coulomb friction of the contact: coefficient, radius, smoothing",
        }
    )
    UNITS: ClassVar[tuple[str, str]] = ("m, N/m", "m")
    ROLE: ClassVar[str] = "journal"
    BEYOND: ClassVar[str] = "no journals in bearings"

    def __post_init__(self) -> None:
        if self.smoothing is None and self.clearance:
            object.__setattr__(self, "smoothing", max(SHARE * self.clearance, SMALLEST))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The joint's coordinates that move the contact points."""
        return CROSSWISE if self.length is None else (*CROSSWISE, *TILTING)

    @property
    def held(self) -> tuple[str, ...]:
        """Coordinates that the contacts hold."""
        return self.coordinates

    @property
    def felt(self) -> tuple[str, ...]:
        """The joint's coordinates on which the contacts depend: with a sliding radius its rotation, too."""
        slides = self.friction is not None and self.friction.radius is not None
        return (*self.coordinates, TURNING) if slides else self.coordinates

    def conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        """Return the key ("" for the table) and the message of what is wrong with it in a joint; None if nothing is."""
        for name in self.coordinates:
            if name not in active:
                why = "" if name in CROSSWISE else " with a length"
                return "", f"{name} does not move; allowed{why}: where {', '.join(self.coordinates)} have tables"
            if active[name].clearance is not None:
                return "", f"{name} has a clearance, too; allowed: {RADIAL} or clearances, not both"
        for name, coordinate in active.items():
            if coordinate.friction is not None and coordinate.friction.coefficient is not None:
                allowed = f"friction in {RADIAL}, with a radius"
                return "", f"{name} has friction with a coefficient, too; allowed: {allowed}"
        if not 0.0 < self.stiffness <= LARGEST:
            return "stiffness", f"got {self.stiffness!r}; allowed: a finite number greater than 0, N/m"
        if self.smoothing is None:
            return "clearance", f"got 0 and no smoothing; allowed: 0 with a smoothing of at least {SMALLEST:g}"
        if TURNING in self.felt and TURNING not in active:
            allowed = "where it is a coordinate (of a loop joint: with a table)"
            return "friction.radius", f"{TURNING} does not move; allowed: {allowed}"
        return None

    def left_with(self, active: Mapping[str, Any]) -> Radial | None:
        """Return the journal where all coordinates of its contacts move; None elsewhere."""
        return self if all(name in active for name in self.felt) else None

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield all of it: MuJoCo's contacts are those of shapes."""
        yield ": left out"
