"""Bushings between frames of two links: numbers and texts; ``codegen.forces.bushings`` has their forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from ...limits import LARGEST
from ..geometry import ANGULAR, COORDINATES, Placement, Vector
from ..laws import DAMPING, STIFFNESS, Number, by_key
from .element import LinkElement, Slopes

_UNITS = {"stiffness": STIFFNESS, "damping": DAMPING}


@dataclass(frozen=True)
class Bushing(LinkElement):
    """A spring and damper of six coordinates between a frame on one link and a frame on another.

    placements: the frames, in link frames.  The second frame, seen from the first, is T(x, y, z) Rx(alpha) Ry(beta)
    Rz(gamma), eq. (3), and each of these six coordinates is resisted by its ``stiffness`` (N/m, N m/rad) times itself
    and its ``damping`` (N s/m, N m s/rad) times its velocity, (6,) each, None for none.  A coordinate whose number is 0
    has no such force and no term in any equation; angles have a pole at beta = +-90 degrees.
    """

    placements: tuple[Placement, Placement] = (Placement(), Placement())
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None

    TABLE: ClassVar[str] = "bushings"
    TITLE: ClassVar[str] = "springs and dampers of six coordinates between frames of two links"
    SHORT: ClassVar[str] = "bushings"
    KIND: ClassVar[str] = "bushing"
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(
        *(
            Number(f"{key}.{name}", f"{key} along {name}", (units[name in ANGULAR],))
            for key, units in _UNITS.items()
            for name in COORDINATES
        )
    )
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "placements": "the frames that it joins, on both links; default their frames",
            "stiffness": "along x, y, z and about alpha, beta, gamma of the second frame as seen from the first",
            "damping": "along x, y, z and about alpha, beta, gamma of the second frame as seen from the first",
        }
    )
    ALWAYS: ClassVar[tuple[str, ...]] = tuple(NUMBERS)

    @property
    def optional(self) -> tuple[str, ...]:
        """All twelve: a parameter may stand for a number that is 0."""
        return tuple(self.NUMBERS)

    def law(self) -> dict[str, float]:
        """Return the numbers that are not 0, by their names: "stiffness.x"."""
        numbers: dict[str, float] = {}
        for key in _UNITS:
            numbers |= {f"{key}.{name}": x for name, x in zip(COORDINATES, getattr(self, key) or (), strict=False) if x}
        return numbers

    def ends(self) -> dict[str, Vector | Placement]:
        """Return its frames."""
        return {f"placements.{i}": placement for i, placement in enumerate(self.placements)}

    def conflict(self) -> tuple[str, str] | None:
        """Return the key and the message of a number that is not allowed; None if all are."""
        for key in _UNITS:
            values = getattr(self, key)
            if values is not None and len(values) != len(COORDINATES):
                return key, f"got {len(values)} numbers; allowed: six, for {', '.join(COORDINATES)}"
            for name, x in zip(COORDINATES, values or (), strict=False):
                if not (math.isfinite(x) and 0.0 <= x <= LARGEST):
                    return key, f"{name}: got {x!r}; allowed: a finite number that is at least 0"
        return None if self.law() else ("", "it has no force; allowed: with a stiffness or damping above 0")

    @classmethod
    def slopes(cls, numbers: Mapping[str, float]) -> Slopes:
        """Return stiffness and damping along each coordinate that has a number."""
        pairs = {name: [f"{key}.{name}" for key in _UNITS] for name in COORDINATES}
        known = {name: keys for name, keys in pairs.items() if not numbers.keys().isdisjoint(keys)}
        return {name: (numbers.get(k, 0.0), numbers.get(c, 0.0)) for name, (k, c) in known.items()}

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield all of it: MuJoCo connects two frames by constraints alone."""
        yield ": left out"
