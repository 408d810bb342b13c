"""Point-to-point spring-dampers and cables between two links; ``codegen.forces.springs`` has their forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from ..geometry import ZERO, Placement, Vector
from ..laws import Curve, curve_conflict
from ..numbers import SMALLEST, Number, by_key, divisor
from .element import LinkElement, Slopes

TAUT = 1e-4  # of a cable's free length over which its tension sets in: a tenth of steel's strain at 200 MPa


@dataclass(frozen=True)
class Spring(LinkElement):
    """A spring, damper or cable along the line between two points of two links.

    links: either may be the base; points: its ends (m) in the links' frames.  Its tension T (N), which pulls the points
    together where it is positive, is that of the elongation e = length - ``free_length`` (m; 0 where it is None) and of
    its velocity: stiffness (N/m) times e plus damping (N s/m) times e_dot.  ``curve``: measured points (e, T) instead
    of stiffness.  ``tension_only``: a cable; T acts on max(e, 0), which sets in over ``smoothing`` (m), TAUT of the
    free length where it is None, and is never negative.
    """

    points: tuple[Vector, Vector] = (ZERO, ZERO)
    free_length: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    tension_only: bool = False
    smoothing: float | None = None
    curve: Curve | None = None

    TABLE: ClassVar[str] = "springs"
    TITLE: ClassVar[str] = "springs, dampers and cables between points of two links"
    SHORT: ClassVar[str] = "springs between points"
    KIND: ClassVar[str] = "spring"
    ALWAYS: ClassVar[tuple[str, ...]] = ("free_length", "stiffness", "damping")
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(
        Number("free_length", "length without force; default 0", ("m",)),
        Number("stiffness", "force per elongation", ("N/m",)),
        Number("damping", "force per velocity of the length", ("N s/m",)),
        divisor("smoothing", "over which a cable's tension sets in; default free_length / 10000", ("m",)),
        Number(
            "curve",
            "measured points [[elongation, force], ...], or a CSV file of two columns; in the place of stiffness",
            ("N",),
            least=None,
        ),
    )
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "points": "its ends in the links' frames; default their origins",
            "tension_only": "true: a cable, which never pushes",
        }
    )

    def __post_init__(self) -> None:
        if self.tension_only and self.smoothing is None and self.free_length:
            object.__setattr__(self, "smoothing", max(TAUT * self.free_length, SMALLEST))

    @property
    def optional(self) -> tuple[str, ...]:
        """Names of the numbers that may stand beside each other; a parameter may stand for one that is missing."""
        return ("free_length", "damping") if self.curve is not None else ("free_length", "stiffness", "damping")

    def law(self) -> dict[str, float]:
        """Return the numbers that are set, by their names: "stiffness", "free_length", "curve.0"."""
        numbers = {key: getattr(self, key) for key in self.NUMBERS if key != "curve"}
        numbers |= {f"curve.{i}": force for i, (_, force) in enumerate(self.curve or ())}
        return {key: value for key, value in numbers.items() if value is not None}

    def ends(self) -> dict[str, Vector | Placement]:
        """Return its points."""
        return {f"points.{i}": point for i, point in enumerate(self.points)}

    def conflict(self) -> tuple[str, str] | None:
        """Return the key and the message of the first conflict; None if there is none."""
        if self.stiffness is None and self.damping is None and self.curve is None:
            return "", "it has no force; allowed: with stiffness, damping or curve"
        if self.curve is not None:
            for key, taken in (("stiffness", self.stiffness is not None), ("tension_only", self.tension_only)):
                if taken:
                    return "curve", f"{key} is set, too; allowed: a curve alone says which force each elongation has"
            conflict = curve_conflict(self.curve, "elongation")
            if conflict is not None:
                return conflict
        if self.smoothing is not None and not self.tension_only:
            return "smoothing", "nothing sets in; allowed: smoothing with tension_only = true"
        if self.tension_only and self.smoothing is None:
            return (
                "tension_only",
                f"there is no free_length and no smoothing; allowed: with one of them above {SMALLEST:g}",
            )
        return None

    @classmethod
    def slopes(cls, numbers: Mapping[str, float]) -> Slopes:
        """Return none: its kernels have the stiffness, which acts across the line, too."""
        return {}

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield what a straight tendon has otherwise."""
        if self.curve is not None:
            yield ".curve: left out"
        if self.tension_only:
            yield ".smoothing: a tendon gets taut with a kink, in the middle of it"
            if self.damping:
                yield ".damping: left out (it would act on a slack tendon, too)"

    def knots(self) -> tuple[float, ...]:
        """Return the elongations (m) of its curve; () without one."""
        return tuple(elongation for elongation, _ in self.curve or ())

    def as_dict(self) -> dict[str, object]:
        """Return its forces as the description has them, for JSON."""
        return {"name": self.name, "links": list(self.links), "tension_only": self.tension_only, **self.law()}

    @property
    def kind(self) -> str:
        """Spring or cable."""
        return "cable" if self.tension_only else self.KIND
