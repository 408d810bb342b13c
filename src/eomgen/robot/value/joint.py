"""Joints of the tree, their motors, and loop joints.

A joint's transform from its parent link to its child link is, with eq. (3) of the paper in the middle,

    A = placement . axis_turn . T(x, y, z) . Rx(alpha) . Ry(beta) . Rz(gamma) . axis_turn^T

where ``axis_turn`` is the identity unless the description is a URDF, whose joint axes have any direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from ..bounds import Limits
from ..elements import JOINT_ELEMENTS, JointElement
from ..elements.joint_damping import JointDamping
from ..elements.joint_element import elements_left
from ..elements.joint_stiffness import JointStiffness
from ..elements.journal import Radial
from ..fields import LATER, Numbers, Picklable, below
from ..geometry import COORDINATES, IDENTITY, Matrix, Placement
from ..joint_types import CUTS, OWN_COORDINATES, PRINCIPAL
from .coordinate import Coordinate, Friction, unloaded

MOTOR = "motor"  # the coordinate of a joint's motor, behind the six
CUT_NUMBERS = ("stiffness", "damping")  # those of a loop joint's, which moves no inertia


class Jointed(Picklable):
    """A joint of the tree or of a loop: coordinates in canonical order, and force elements of it as a whole."""

    coordinates: Mapping[str, Coordinate]

    def __post_init__(self) -> None:
        ordered = {name: self.coordinates[name] for name in COORDINATES if name in self.coordinates}
        object.__setattr__(self, "coordinates", MappingProxyType(ordered))

    @property
    def elements(self) -> dict[str, JointElement]:
        """Force elements of the joint as a whole, by their tables."""
        elements: dict[str, JointElement | None] = {table: getattr(self, table, None) for table in JOINT_ELEMENTS}
        return {table: element for table, element in elements.items() if element is not None}


@dataclass(frozen=True)
class Motor(Picklable):
    """A motor behind an elastic gear (flexible joint, SEA): one more coordinate, the rotor's angle, rad at its shaft.

    inertia: of the rotor about its axis, kg m^2.  ratio: of the gear, rad of the motor per rad (or m) of the
    joint's principal coordinate; negative where the sense is reversed.  transmission: the force in the deflection phi =
    motor / ratio - principal coordinate, which pulls the joint after the motor; in units of the joint's side, without
    friction, armature and role: ``Coordinate(stiffness=2e4)``, say (``Robot.with_value`` takes a motor by the keys of
    TOML).  friction: of the rotor's bearings, N m and rad/s at the shaft.  prescribed: the rotor's motion is, as that
    of a position-controlled motor.  further: numbers of the rotor's other laws, as in Coordinate: stops of its angle,
    rad and N m at the shaft.  limits: of its motion and its drive, at the shaft.

    Source: M. W. Spong, "Modeling and Control of Elastic Joint Robots", Journal of Dynamic Systems, Measurement, and
    Control 109 (1987): of a rotor, the energy of its spin alone counts.
    """

    inertia: float
    ratio: float
    transmission: Coordinate
    friction: Friction | None = None
    prescribed: bool = False
    further: Mapping[str, float] = field(default_factory=dict, hash=False, metadata=LATER)
    limits: Limits | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "further", self.rotor.further)

    @property
    def rotor(self) -> Coordinate:
        """Coordinate properties of the rotor alone; its inertia as an armature."""
        return Coordinate(
            armature=self.inertia,
            friction=self.friction,
            prescribed=self.prescribed,
            further=self.further,
            limits=self.limits,
        )

    def without_states(self) -> Motor:
        """Return the motor as ``Coordinate.without_states`` leaves its rotor and transmission."""
        rotor = self.rotor.without_states()
        transmission = self.transmission.without_states()
        return replace(self, transmission=transmission, friction=rotor.friction, further=rotor.further)

    def numbers(self) -> dict[str, float | None]:
        """Return numbers by the names of parameters: "inertia", "stiffness", "friction.coulomb"; None where not set."""
        drive = {"inertia": self.inertia, "ratio": self.ratio}
        return {**drive, **self.transmission.numbers(CUT_NUMBERS), **self.rotor.law()}


@dataclass(frozen=True)
class Joint(Jointed):
    """A joint: where it is, which of its six coordinates are active (canonical order), and their properties.

    offset: constants in the order of COORDINATES (m, rad) that are added to the six coordinates, active or not, before
    they move anything: errors of manufacturing, wear or temperature; None where the description has none.
    motor: drives the principal coordinate through an elastic transmission; None where the drive acts on it itself.
    limits: range of the principal coordinate, m or rad; ``limits_of`` has all that bounds a coordinate.
    radial: contact of the child's journal in the parent's round bearing; None where there is none.
    damping: of its motion as a whole, beside that of its coordinates; None where there is none.
    stiffness: between its coordinates, beside that of each of them; None where there is none.
    pitch: of a screw, m per revolution: its z is pitch gamma / (2 pi), a coupling of the robot (``Robot.couplings``).
    """

    name: str
    parent: str
    child: str
    type: str
    placement: Placement = field(default_factory=Placement)
    axis_turn: Matrix = IDENTITY
    coordinates: Mapping[str, Coordinate] = field(default_factory=dict)
    limits: tuple[float, float] | None = None
    offset: tuple[float | None, ...] = (None,) * 6
    motor: Motor | None = None
    radial: Radial | None = field(default=None, metadata=LATER)
    damping: JointDamping | None = field(default=None, metadata=LATER)
    stiffness: JointStiffness | None = field(default=None, metadata=LATER)
    pitch: float | None = field(default=None, metadata=LATER)

    @property
    def principal(self) -> str:
        """The coordinate that drives move and ``limits`` bound; "" where the type has none."""
        return PRINCIPAL.get(self.type, "")

    @property
    def slides(self) -> bool:
        """Whether it moves along its axis by its type, without being free."""
        return bool(self.principal) and "z" in OWN_COORDINATES[self.type]

    @property
    def is_free(self) -> bool:
        """Whether all six coordinates move by the joint's type."""
        return OWN_COORDINATES.get(self.type) == COORDINATES

    @property
    def all_coordinates(self) -> dict[str, Coordinate]:
        """Active coordinates and, behind them, the motor's: those of q, in its order."""
        return {**self.coordinates, **({MOTOR: self.motor.rotor} if self.motor else {})}

    def numbers(self) -> Numbers:
        """Yield all numbers that may be parameters, by their names below the joint's; None where one is not set."""
        for name, coordinate in self.coordinates.items():
            yield from below(name, coordinate.numbers().items())
        if self.motor is not None:
            yield from below(MOTOR, self.motor.numbers().items())
        for table, element in self.elements.items():
            yield from below(table, element.numbers(tuple(self.coordinates)))
        yield from below("offset", zip(COORDINATES, self.offset, strict=True))
        if self.pitch is not None:
            yield "pitch", self.pitch
        yield from below("placement", self.placement.numbers())

    def limits_of(self, name: str) -> Limits:
        """Return the limits of a coordinate of the joint, or of its motor's; an empty one where it has none."""
        owner = self.motor if name == MOTOR else self.coordinates.get(name)
        limits = (owner.limits if owner is not None else None) or Limits()
        if self.limits is None or name != self.principal:
            return limits
        lower, upper = (x if math.isfinite(x) else None for x in self.limits)
        return replace(limits, lower=lower, upper=upper)

    def with_limits(self, name: str, limits: Limits) -> Joint:
        """Return the joint with these limits of an active coordinate, or of its motor's."""
        if name == MOTOR:
            assert self.motor is not None
            return replace(self, motor=replace(self.motor, limits=limits or None))
        ends, rest = self.limits, limits
        if name == self.principal:
            ends = (limits.lower, limits.upper) if limits.lower is not None and limits.upper is not None else None
            rest = limits if ends is None else replace(limits, lower=None, upper=None)
        coordinate = replace(self.coordinates[name], limits=rest or None)
        return replace(self, limits=ends, coordinates={**self.coordinates, name: coordinate})

    @property
    def range(self) -> tuple[float, float]:
        """Lower and upper limit of the principal coordinate, m or rad; infinite where there is none."""
        return self.limits_of(self.principal).range

    def without_states(self) -> Joint:
        """Return the joint without laws that have states."""
        coordinates = {name: coordinate.without_states() for name, coordinate in self.coordinates.items()}
        return replace(self, coordinates=coordinates, motor=self.motor and self.motor.without_states())

    def rigid(self, *, loose: bool = False) -> Joint:
        """Return the joint with deviations locked, and its motor's inertia as an armature of inertia ratio^2.

        Without stops and internal states: drives use it, do not push a joint off its stop, and have no bristles.

        loose: keep deviations without a stiffness, which loops hold: those of a universal joint, say.
        """
        keep = OWN_COORDINATES[self.type]
        held = {name for element in self.elements.values() for name in element.held}
        locked = {k for k, v in self.coordinates.items() if v.has_stiffness or k in held or not loose}
        left_free = (k for k, v in self.coordinates.items() if k in keep or v.prescribed or k not in locked)
        kept = {k: self.coordinates[k].unstopped().without_states() for k in left_free}
        if self.motor is not None:
            name = self.principal
            principal = kept[name]
            armature = (principal.armature or 0.0) + self.motor.inertia * self.motor.ratio**2
            kept[name] = replace(principal, armature=armature, prescribed=principal.prescribed or self.motor.prescribed)
        left: dict[str, Any] = elements_left(self.elements, kept)
        made = replace(self, coordinates=unloaded(kept), motor=None, **left)
        if self.motor is None or self.motor.limits is None:
            return made
        return made.with_limits(name, self.limits_of(name).within(self.motor.limits.behind(self.motor.ratio)))


@dataclass(frozen=True)
class Loop(Jointed):
    """A loop joint (cut): its type (``joint_types.CUTS``) and its frame on each of the two links that it joins.

    Its six coordinates are those of the second frame as seen from the first, T(x, y, z) . Rx(alpha) . Ry(beta) .
    Rz(gamma).  One with properties in ``coordinates`` (without armature and role) has that force; of the others those
    that the type leaves free are free, the rest are rigid.  offset: as that of a joint: a rigid coordinate keeps to it,
    and forces act on what it deviates from it.
    radial: contact of the second link's journal in the first one's round bearing; None where there is none.
    stiffness, damping: between those coordinates that have properties, by matrices; None where there are none.
    """

    name: str
    links: tuple[str, str]
    type: str
    placements: tuple[Placement, Placement] = (Placement(), Placement())
    coordinates: Mapping[str, Coordinate] = field(default_factory=dict, hash=False, metadata=LATER)
    offset: tuple[float | None, ...] = field(default=(None,) * 6, metadata=LATER)
    radial: Radial | None = field(default=None, metadata=LATER)
    damping: JointDamping | None = field(default=None, metadata=LATER)
    stiffness: JointStiffness | None = field(default=None, metadata=LATER)

    def numbers(self) -> Numbers:
        """Yield all numbers that may be parameters, by their names below the loop's; None where one is not set."""
        for name, coordinate in self.coordinates.items():
            yield from below(name, coordinate.numbers(CUT_NUMBERS).items())
        for table, element in self.elements.items():
            yield from below(table, element.numbers(tuple(self.coordinates)))
        yield from below("offset", zip(COORDINATES, self.offset, strict=True))
        for place, placement in enumerate(self.placements):
            yield from below(f"placements.{place}", placement.numbers())

    def without_states(self) -> Loop:
        """Return the loop without laws that have states."""
        return replace(self, coordinates={name: x.without_states() for name, x in self.coordinates.items()})

    def rigid(self) -> Loop:
        """Return the loop with every coordinate that its type blocks rigid."""
        blocked = [component.name for component in CUTS[self.type]]
        kept = {k: coordinate.without_states() for k, coordinate in self.coordinates.items() if k not in blocked}
        left: dict[str, Any] = elements_left(self.elements, kept)
        return replace(self, coordinates=unloaded(kept), **left)
