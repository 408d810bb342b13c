"""Beams: uniform elastic members between two links, and the links and joints that they are made of.

A beam of N segments becomes N joints, each at the middle of a segment, where the stiffness of S. P. Timoshenko's beam
is diagonal, and N + 1 links, which carry the nodes between segments.  Forces and moments at the tip deflect it there
as they deflect the continuous beam, for any N.  Masses stand at the nodes, those of both ends, which are halves, a
sixth of a segment inside of them (the first correction of Euler and Maclaurin), so that its weight does so, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ...identifiers import is_identifier
from ...limits import LARGEST, MOST_SEGMENTS, is_usable
from ...names import NAME_LENGTH, show
from ..geometry import COORDINATES, Matrix, Placement, Vector, turn_inertia
from ..sections import AXES
from .coordinate import Coordinate
from .joint import Joint
from .link import Link

TIP = "_tip"  # behind a beam's name: the fixed joint that carries its child
_POSITIVE = ("length", "E", "G", "A", "Iy", "Iz", "J", "density")
_INSIDE = 1.0 / 6.0  # of a segment: by how much the halves of both ends stand inside of them


@dataclass(frozen=True)
class Beam:
    """A uniform beam from a link to another one, straight where its coordinates are zero.

    placement: of its root, in the frame of ``parent``; it runs along ``axis`` of that.  The frame of ``child`` stands
    at its tip, parallel to the root's.  length: m.  E, G: Young's and shear modulus, N/m^2.  A: area of the section,
    m^2.  Iy, Iz: its second moments about its axes y and z, m^4, which follow the beam's cyclically: of a beam along z
    they are the root's x and y.  J: torsion constant, m^4.  shear: coefficients k of the shear stiffness k G A along y
    and z.  density: kg/m^3.  damping: of each coordinate of a segment by its stiffness, s.  rigid: coordinates of
    segments that do not move.
    """

    name: str
    parent: str
    child: str
    length: float
    segments: int
    E: float
    G: float
    A: float
    Iy: float
    Iz: float
    J: float
    shear: tuple[float, float]
    density: float
    axis: str = "x"
    placement: Placement = field(default_factory=Placement)
    damping: tuple[float, ...] = (0.0,) * 6
    rigid: tuple[str, ...] = ()

    @property
    def span(self) -> float:
        """Length of a segment, m."""
        return self.length / self.segments

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.density * self.A * self.length

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of its links, from the root to the tip: boom0, boom1, ...; joints that carry them have them, too."""
        return tuple(f"{self.name}{k}" for k in range(self.segments + 1))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of its joints, from the root to the one that carries the child."""
        return (*self.link_names, self.name + TIP)

    def segment_stiffness(self) -> dict[str, float]:
        """Return the stiffness of a segment at its middle, N/m and N m/rad, by coordinate; x along the beam."""
        span = self.span
        shear_y, shear_z = (k * self.G * self.A for k in self.shear)
        bend_y, bend_z = self.E * self.Iy, self.E * self.Iz
        # 12 EI / (l^3 (1 + p)) with p = 12 EI / (shear l^2)
        along_y, along_z = 12.0 * bend_z / span**3, 12.0 * bend_y / span**3
        return {
            "x": self.E * self.A / span,
            "y": along_y / (1.0 + along_y * span / shear_y),
            "z": along_z / (1.0 + along_z * span / shear_z),
            "alpha": self.G * self.J / span,
            "beta": bend_y / span,
            "gamma": bend_z / span,
        }

    def node_inertia(self) -> tuple[float, tuple[float, float, float]]:
        """Return mass, kg, and moments of inertia about the section's axes, kg m^2, of what an inner node carries."""
        span = self.span
        about_y, about_z = self.density * self.Iy * span, self.density * self.Iz * span
        return self.density * self.A * span, (about_y + about_z, about_y, about_z)

    def line(self) -> str:
        """Return what it is, on one line."""
        moving = sum(key not in self.rigid for key in COORDINATES)
        stiffness = {"EA": self.E * self.A, "GJ": self.G * self.J, "EIy": self.E * self.Iy, "EIz": self.E * self.Iz}
        numbers = ", ".join(f"{key} {x:.6g}" for key, x in stiffness.items())
        where = f"beam {self.name} from {self.parent} to {self.child}, {self.length:g} m along {self.axis}"
        links = (
            f"links {self.name}0 to {self.link_names[-1]}, {self.segments} x {moving} coordinates, {self.mass:.6g} kg"
        )
        return f"{where}: {links}; {numbers} (N, N m^2), shear {self.shear[0]:.4g}, {self.shear[1]:.4g}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        values = {key: getattr(self, key) for key in ("parent", "child", "axis", "segments", *_POSITIVE)}
        lists = {key: list(getattr(self, key)) for key in ("shear", "damping", "rigid")}
        links = {"links": list(self.link_names), "joints": list(self.joint_names)}
        return {"name": self.name, **values, **lists, **links, "mass": self.mass}

    def conflict(self) -> tuple[str, str] | None:
        """Return the key and the message of what is not allowed; None if all is right."""
        for key in _POSITIVE:
            if not 0.0 < getattr(self, key) <= LARGEST:
                return key, f"got {getattr(self, key)!r}; allowed: a number greater than 0, up to {LARGEST:g}"
        if not 1 <= self.segments <= MOST_SEGMENTS:
            return "segments", f"got {self.segments!r}; allowed: a whole number from 1 to {MOST_SEGMENTS}"
        if self.axis not in AXES:
            return "axis", f"got {show(self.axis)}; allowed: {', '.join(AXES)}"
        if len(self.shear) != 2 or not all(0.0 < x <= LARGEST for x in self.shear):
            return "shear", f"got {show(list(self.shear))}; allowed: two numbers greater than 0, along y and z"
        if len(self.damping) != len(COORDINATES) or not all(0.0 <= x <= LARGEST for x in self.damping):
            allowed = f"six numbers that are at least 0, for {', '.join(COORDINATES)}"
            return "damping", f"got {show(list(self.damping))}; allowed: {allowed}"
        if not set(self.rigid) < set(COORDINATES) or len(set(self.rigid)) < len(self.rigid):
            allowed = f"some of {', '.join(COORDINATES)}, each once, not all"
            return "rigid", f"got {show(list(self.rigid))}; allowed: {allowed}"
        if not is_identifier(self.joint_names[-2]) or not is_identifier(self.joint_names[-1]):
            return "name", f"links and joints are called after it; allowed: at most {NAME_LENGTH - len(TIP)} characters"
        return self._unusable()

    def _unusable(self) -> tuple[str, str] | None:
        """Return the key and the message of a number of its segments that no robot can have."""
        try:
            mass, inertia = self.node_inertia()
            numbers = {f"stiffness {key}": x for key, x in self.segment_stiffness().items()}
            numbers |= {f"damping {key}": numbers[f"stiffness {key}"] * self.damping[i] for i, key in _NUMBERED}
            numbers |= {"mass": mass, **{f"inertia {key * 2}": x for key, x in zip("xyz", inertia, strict=True)}}
        except (ZeroDivisionError, OverflowError):
            return "", "its segments have no stiffness that can be computed with; allowed: numbers of usual sizes"
        for what, x in numbers.items():
            if not is_usable(x) or (x == 0.0 and not what.startswith("damping")):
                return "", f"its segments have the {what} {x:g}; allowed: sizes from 1e-30 to {LARGEST:g}"
        return None

    def links(self) -> tuple[Link, ...]:
        """Return its links, from the root to the tip."""
        span, turn, (mass, (xx, yy, zz)) = self.span, AXES[self.axis], self.node_inertia()
        whole, half = (xx, yy, zz, 0.0, 0.0, 0.0), (xx / 2.0, yy / 2.0, zz / 2.0, 0.0, 0.0, 0.0)
        first, *between, last = self.link_names
        return (
            Link(first, mass / 2.0, _along(turn, span * _INSIDE), turn_inertia(half, turn)),
            *(Link(name, mass, (span / 2.0, 0.0, 0.0), whole) for name in between),
            Link(last, mass / 2.0, (span / 2.0 - span * _INSIDE, 0.0, 0.0), half),
        )

    def joints(self) -> tuple[Joint, ...]:
        """Return its joints, from the root to the one that carries the child."""
        span, turn, names = self.span, AXES[self.axis], self.link_names
        stiffness = self.segment_stiffness()
        coordinates = {
            key: Coordinate(stiffness=stiffness[key], damping=self.damping[i] * stiffness[key] or None)
            for i, key in _NUMBERED
            if key not in self.rigid
        }
        back: Matrix = tuple(zip(*turn, strict=True))  # type: ignore[assignment]  # three columns of three
        between = Placement((span, 0.0, 0.0))
        middles = (Placement(_along(turn, span / 2.0), turn), *(between for _ in names[2:]))
        return (
            Joint(names[0], self.parent, names[0], "fixed", self.placement),
            *(
                Joint(name, parent, name, "fixed", placement, coordinates=coordinates)
                for parent, name, placement in zip(names, names[1:], middles, strict=False)
            ),
            Joint(self.joint_names[-1], names[-1], self.child, "fixed", Placement((span / 2.0, 0.0, 0.0), back)),
        )


_NUMBERED = tuple(enumerate(COORDINATES))


def _along(turn: Matrix, distance: float) -> Vector:
    """Return the point at a distance along the beam, in the axes of its root."""
    return (turn[0][0] * distance + 0.0, turn[1][0] * distance + 0.0, turn[2][0] * distance + 0.0)
