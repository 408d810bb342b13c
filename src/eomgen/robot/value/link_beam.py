"""A link that is a beam: what its modes are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from ...identifiers import is_identifier
from ...limits import LARGEST, MOST_BEAM_MODES, is_usable
from ...names import listed, show
from ..fields import LATER, Picklable
from ..sections import AXES, SHAPES

TIP, ROOT = "tip", "root"  # nodes at the ends; the link itself stands at the root
OF_SECTION = ("A", "Iy", "Iz", "J")  # numbers that follow from the form of a section
_POSITIVE = ("length", "E", "G", *OF_SECTION, "density")


@dataclass(frozen=True)
class BeamModes:
    """Numbers of a beam's modes: that bend it along y and z of its section, twist it, and stretch it."""

    y: int = 0
    z: int = 0
    torsion: int = 0
    axial: int = 0

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of modes by direction, in the order of the modal coordinates."""
        return {"y": self.y, "z": self.z, "torsion": self.torsion, "axial": self.axial}


@dataclass(frozen=True)
class LinkBeam(Picklable):
    """A straight uniform beam from the origin of its link's frame, where it is clamped, along an axis of that.

    length: m.  E, G: Young's and shear modulus, N/m^2.  A: area of the section, m^2.  Iy, Iz: its second moments about
    its axes y and z, m^4, which follow the beam's cyclically, as those of ``Beam``.  J: torsion constant, m^4.  shear:
    coefficients k of the shear stiffness k G A along y and z.  density: kg/m^3.  section: its kind and dimensions, m,
    where all of A, Iy, Iz and J are those of one.
    nodes: distances from the root, m, of nodes between the ends, by their names.
    """

    length: float
    E: float
    G: float
    A: float
    Iy: float
    Iz: float
    J: float
    shear: tuple[float, float]
    density: float
    modes: BeamModes
    axis: str = "x"
    section: tuple[str, tuple[float, ...]] | None = field(default=None, metadata=LATER)
    nodes: Mapping[str, float] = field(default_factory=dict, hash=False, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", MappingProxyType(dict(self.nodes)))

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.density * self.A * self.length

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        values = {key: getattr(self, key) for key in ("axis", *_POSITIVE)}
        kind = {} if self.section is None else {"section": {self.section[0]: list(self.section[1])}}
        whole = {**values, **kind, "shear": list(self.shear), "modes": dict(self.modes.counts), "mass": self.mass}
        return whole | ({"nodes": dict(self.nodes)} if self.nodes else {})

    def conflict(self) -> tuple[str, str] | None:
        """Return the key and the message of what is not allowed; None if all is right."""
        for key in _POSITIVE:
            if not 0.0 < getattr(self, key) <= LARGEST:
                return key, f"got {getattr(self, key)!r}; allowed: a number greater than 0, up to {LARGEST:g}"
        if self.axis not in AXES:
            return "axis", f"got {show(self.axis)}; allowed: {', '.join(AXES)}"
        if len(self.shear) != 2 or not all(0.0 < x <= LARGEST for x in self.shear):
            return "shear", f"got {show(list(self.shear))}; allowed: two numbers greater than 0, along y and z"
        for key, count in self.modes.counts.items():
            if not 0 <= count <= MOST_BEAM_MODES:
                return f"modes.{key}", f"got {count!r}; allowed: a whole number from 0 to {MOST_BEAM_MODES}"
        if not any(self.modes.counts.values()):
            return "modes", f"there are none; allowed: one or more of {', '.join(self.modes.counts)}"
        for name, place in self.nodes.items():
            if not is_identifier(name) or name in (TIP, ROOT):
                return "nodes", f"got the name {show(name)}; allowed: identifiers but {ROOT} and {TIP}"
            if not 0.0 < place <= self.length:
                return f"nodes.{name}", f"got {place!r}; allowed: above 0, up to the length, {self.length:g} m"
        return self._wrong_section() or self._unusable()

    def _wrong_section(self) -> tuple[str, str] | None:
        """Return the key and the message of a section that there is not."""
        if self.section is None:
            return None
        kind, sizes = self.section
        shape = SHAPES.get(kind)
        if shape is None or len(sizes) != len(shape.names):
            return "section", f"got {show([kind, list(sizes)])}; allowed: one of {listed(SHAPES)} with its dimensions"
        if not all(0.0 < x <= LARGEST for x in sizes) or not shape.fits(sizes):
            return "section", f"got {show([kind, list(sizes)])}; allowed: {shape.rule}"
        return None

    def _unusable(self) -> tuple[str, str] | None:
        """Return the key and the message of numbers that no beam can be computed with."""
        try:
            bends = {key: self.E * x / self.length**3 for key, x in (("y", self.Iz), ("z", self.Iy))}
            shears = {key: k * self.G * self.A / self.length for key, k in zip("yz", self.shear, strict=True)}
            twist, stretch = self.G * self.J / self.length, self.E * self.A / self.length
            about = {key: self.density * x * self.length for key, x in (("y", self.Iy), ("z", self.Iz))}
        except (ZeroDivisionError, OverflowError):
            return "", "its stiffness cannot be computed with; allowed: numbers of usual sizes"
        numbers = {f"bending stiffness along {key}": x for key, x in bends.items()}
        numbers |= {f"shear stiffness along {key}": x for key, x in shears.items()}
        numbers |= {"torsional stiffness": twist, "axial stiffness": stretch, "mass": self.mass}
        numbers |= {f"moment of inertia of its sections about {key}": x for key, x in about.items()}
        for what, x in numbers.items():
            if not is_usable(x) or x == 0.0:
                return "", f"its {what} is {x:g}; allowed: sizes from 1e-30 to {LARGEST:g}"
        for key, bend in bends.items():
            if bend / shears[key] > _SOFTEST:
                where = f"its shear stiffness along {key} is {shears[key]:.3g} N/m, that of bending {bend:.3g} N/m"
                return "", f"{where}; allowed: a beam that does not shear above {_SOFTEST:g} times as far as it bends"
        return None


_SOFTEST = 1e6
