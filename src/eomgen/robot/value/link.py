"""Links, and frames on them."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..fields import LATER, Numbers, below
from ..geometry import LINEAR, Placement, Vector
from .link_beam import LinkBeam
from .modes import LinkModes

INERTIA_KEYS = ("xx", "yy", "zz", "xy", "xz", "yz")
BASE = "base"


@dataclass(frozen=True)
class Link:
    """A body: mass (kg), com (m, link frame), inertia (kg m^2, INERTIA_KEYS, about com, link axes).

    modes: of a link that bends, whose mass, com and inertia are those while nothing bends; None of a rigid one.
    beam, modal_damping: what modes were made of, for ``with_value`` and pictures; no equation has them.
    """

    name: str
    mass: float
    com: Vector
    inertia: tuple[float, float, float, float, float, float]
    modes: LinkModes | None = field(default=None, metadata=LATER)
    beam: LinkBeam | None = field(default=None, metadata=LATER)
    modal_damping: float | None = field(default=None, metadata=LATER)

    def numbers(self) -> Numbers:
        """Yield all numbers by the names of parameters: "mass", "com.x"."""
        yield "mass", self.mass
        yield from below("com", zip(LINEAR, self.com, strict=True))
        yield from below("inertia", zip(INERTIA_KEYS, self.inertia, strict=True))
        if self.modes is not None:
            yield from self.modes.numbers()


@dataclass(frozen=True)
class Frame:
    """A point of interest on a link (or on the base)."""

    name: str
    link: str
    placement: Placement = field(default_factory=Placement)
