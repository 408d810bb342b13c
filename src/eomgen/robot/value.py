"""The immutable robot value: a description's values, checked, and nothing that is derived from them.

A joint's transform from its parent link to its child link is, with eq. (3) of the paper in the middle,

    A = placement . axis_turn . T(x, y, z) . Rx(alpha) . Ry(beta) . Rz(gamma) . axis_turn^T

where ``axis_turn`` is the identity unless the description is a URDF, whose joint axes have any direction.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from ..errors import UnknownNameError, renamed
from ..lazily import from_above
from ..names import NAME_LENGTH, html_table, joint_of, kind_of, nearest_or_all, show, split_component
from ..once import kept
from .bounds import Limits
from .cuts import CUTS
from .elements import JOINT_ELEMENTS, Element, JointElement, LinkElement
from .elements.joint_damping import JointDamping
from .elements.journal import Radial
from .elements.spring import Spring as Spring
from .geometry import ANGULAR as ANGULAR
from .geometry import COORDINATES as COORDINATES
from .geometry import IDENTITY, Matrix, Vector
from .geometry import LINEAR as LINEAR
from .geometry import Placement as Placement
from .laws import BASIC, GAUSSIAN, NUMBERS, SHAPES, active_laws, defaults
from .laws import Curve as Curve

ACROSS: Mapping[str, tuple[str, ...]] = MappingProxyType(  # translations across a coordinate's axis
    {name: tuple(x for x in LINEAR if x != axis) for name, axis in zip(COORDINATES, LINEAR * 2, strict=True)}
)
JOINT_TYPES = ("revolute", "prismatic", "fixed", "free")
PRINCIPAL = {"revolute": "gamma", "prismatic": "z"}
MOTOR = "motor"  # the coordinate of a joint's motor, behind the six
COORDINATE_NUMBERS = tuple(number.key for number in BASIC)  # of any coordinate; each may be a run-time parameter
CUT_NUMBERS = ("stiffness", "damping")  # those of a loop joint's, which moves no inertia
INERTIA_KEYS = ("xx", "yy", "zz", "xy", "xz", "yz")
BASE = "base"
LATER: Mapping[str, bool] = MappingProxyType({"later": True})  # marks fields that older records do not have


Numbers = Iterator[tuple[str, float | None]]  # by names of parameters below an owner's; None where one is not set


def _below(table: str, numbers: Iterable[tuple[str, float | None]]) -> Numbers:
    """Yield numbers by their names with that of the table in front."""
    yield from ((f"{table}.{key}", value) for key, value in numbers)


class _Picklable:
    """A record whose fields may be mapping proxies, which cannot be pickled."""

    def __reduce__(self) -> tuple[object, ...]:
        values = (dict(x) if isinstance(x, MappingProxyType) else x for x in vars(self).values())
        return type(self), tuple(values)


class _Jointed(_Picklable):
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
class Friction:
    """Friction at the velocity v: sgn(v) (C + (static - coulomb) / (1 + (v / stribeck)^2)) + viscous v.

    With the shape "gaussian" the excess of static friction falls as exp(-(v / stribeck)^2).  C is coulomb, and with a
    ``coefficient`` (load-dependent friction) coulomb + coefficient radius N, N the load of the joint (``carriers``);
    ``radius`` (m) is the friction radius of a rotation, and 1 of a translation.
    coulomb, static: N or N m; stribeck: m/s or rad/s; viscous: N s/m or N m s/rad.  sgn(v) is v / sqrt(v^2 +
    smoothing^2); smoothing (m/s or rad/s) becomes 4e-8, or 1e-6 stribeck if that is less, where it is None.
    """

    coulomb: float = 0.0
    static: float | None = None
    stribeck: float | None = None
    viscous: float | None = None
    smoothing: float | None = None
    coefficient: float | None = field(default=None, metadata=LATER)
    radius: float | None = field(default=None, metadata=LATER)
    shape: str | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        if self.shape not in (None, *SHAPES):
            raise ValueError(f"shape {self.shape!r}")
        if self.shape == SHAPES[0] or self.stribeck is None:  # one value for one curve
            object.__setattr__(self, "shape", None)
        for key, value in defaults(self.numbers()).items():
            object.__setattr__(self, key.removeprefix("friction."), value)

    @classmethod
    def of(cls, numbers: Mapping[str, float]) -> Friction:
        """Make friction of its numbers, by the names of ``numbers`` without "friction."."""
        fields: dict[str, Any] = dict(numbers)
        if GAUSSIAN in fields:
            fields |= {"stribeck": fields.pop(GAUSSIAN), "shape": GAUSSIAN}
        return cls(**fields)

    def numbers(self) -> dict[str, float]:
        """Return the numbers that are set, by their names: "friction.coulomb"; stribeck has its curve's name."""
        names = {"stribeck": self.shape or "stribeck"}
        fields = {key: value for key, value in vars(self).items() if value is not None and key != "shape"}
        return {f"friction.{names.get(key, key)}": value for key, value in fields.items()}


@dataclass(frozen=True)
class Coordinate(_Picklable):
    """Properties of one active coordinate; None means that the description does not set the value.

    stiffness: N/m or N m/rad, damping: N s/m or N m s/rad (eq. 13), armature: reflected rotor inertia, kg or kg m^2,
    added to the diagonal of the mass matrix.  prescribed: its motion is prescribed; its row is the force for that.

    The others make further forces that resist a deviation s, N or N m: ``preload`` at s = 0; ``cubic`` (N/m^3 or
    N m/rad^3) times s^3; ``stiffness_negative`` in the place of stiffness where s < 0; ``friction``; ``curve``,
    measured points (s, force) in the place of springs.  With a ``clearance`` (half of it, m or rad) springs act on
    the penetration d of its ends alone, times 1 + ``restitution_damping`` (s/m or s/rad) d_dot, never pulling, and set
    in over ``smoothing`` (m or rad), which becomes a twentieth of the clearance where it is None.
    ``further``: the numbers of laws that have no field here, by their names in ``laws.NUMBERS``.
    ``limits``: of its motion and of its drive; of a principal coordinate ``Joint.limits`` has the range, where both
    ends are set.
    """

    stiffness: float | None = None
    damping: float | None = None
    armature: float | None = None
    preload: float | None = None
    cubic: float | None = None
    stiffness_negative: float | None = None
    clearance: float | None = None
    restitution_damping: float | None = None
    smoothing: float | None = None
    friction: Friction | None = None
    curve: Curve | None = None
    prescribed: bool = False
    further: Mapping[str, float] = field(default_factory=dict, hash=False, metadata=LATER)
    limits: Limits | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        further = dict(self.further)
        for key, value in defaults(self.law()).items():
            if key in vars(self):
                object.__setattr__(self, key, value)
            else:
                further[key] = value
        object.__setattr__(self, "further", MappingProxyType(further))

    @property
    def carries(self) -> bool:
        """Whether springs, contacts or dampers of the coordinate carry a force."""
        laws = any(law.name != "friction" for law in active_laws(self.law()))
        return laws or self.stiffness is not None or self.damping is not None

    @property
    def has_stiffness(self) -> bool:
        """Whether any of its numbers counts as a stiffness."""
        return bool(self.stiffness) or any(law.stiffness for law in active_laws(self.law()))

    def numbers(self, keys: Sequence[str] = COORDINATE_NUMBERS) -> dict[str, float | None]:
        """Return numbers by the names of parameters, some of ``COORDINATE_NUMBERS``; None where one is not set."""
        return {key: getattr(self, key) for key in keys} | self.law()

    def law(self) -> dict[str, float]:
        """Return numbers beyond stiffness, damping and armature, by their names: "cubic", "curve.0"."""
        fields = {**vars(self), **(self.friction.numbers() if self.friction else {}), **self.further}
        numbers = {key: fields[key] for key in NUMBERS if key != "curve" and fields.get(key) is not None}
        return numbers | {f"curve.{i}": force for i, (_, force) in enumerate(self.curve or ())}

    def unstopped(self) -> Coordinate:
        """Return the coordinate without stops."""
        others = {key: number for key, number in self.further.items() if not key.startswith("stops.")}
        return self if len(others) == len(self.further) else replace(self, further=others)

    def with_numbers(self, numbers: Mapping[str, float]) -> Coordinate:
        """Return the coordinate with these numbers, by the names of ``law`` or "stiffness", in place of the old ones.

        A law that descriptions have as a table is replaced as a whole, and defaults follow anew.
        """
        kept = {key: value for key, value in self.law().items() if key in NUMBERS}
        for law in active_laws(numbers):
            for number in law.numbers:
                if law.has_table or number.default:
                    kept.pop(number.key, None)
        kept.update(numbers)
        fields: dict[str, Any] = {key: kept.pop(key, None) for key in NUMBERS if key in vars(self) and key != "curve"}
        fields |= {key: kept.pop(key, getattr(self, key)) for key in COORDINATE_NUMBERS}
        friction = {key[9:]: kept.pop(key) for key in NUMBERS if key.startswith("friction.") and key in kept}
        return replace(self, **fields, friction=Friction.of(friction) if friction else None, further=kept)


def carriers(name: str, coordinates: Mapping[str, Coordinate]) -> tuple[str, ...]:
    """Return the names of a joint's coordinates whose springs, contacts and dampers load one with friction.

    These are the translations across it; of a rotation those across its axis.  Moments, friction and rigid constraints
    do not count.

    Args:
        name: of the coordinate with load-dependent friction.
        coordinates: active ones of the joint, or those of a loop joint that have a table.
    """
    return tuple(other for other in ACROSS[name] if other in coordinates and coordinates[other].carries)


def load_dependent(coordinates: Mapping[str, Coordinate]) -> dict[str, tuple[str, ...]]:
    """Return coordinates with load-dependent friction, each with its ``carriers``."""
    frictions = {
        name: coordinate.friction for name, coordinate in coordinates.items() if coordinate.friction is not None
    }
    return {name: carriers(name, coordinates) for name, x in frictions.items() if x.coefficient is not None}


def _unloaded(coordinates: Mapping[str, Coordinate]) -> dict[str, Coordinate]:
    """Return the coordinates without load-dependent friction where there is no load any more."""
    unloaded = dict(coordinates)
    for name, others in load_dependent(coordinates).items():
        friction = unloaded[name].friction
        if friction is not None and not others:
            unloaded[name] = replace(unloaded[name], friction=replace(friction, coefficient=None, radius=None))
    return unloaded


@dataclass(frozen=True)
class Motor(_Picklable):
    """A motor behind an elastic gear (flexible joint, SEA): one more coordinate, the rotor's angle, rad at its shaft.

    inertia: of the rotor about its axis, kg m^2.  ratio: of the gear, rad of the motor per rad (or m) of the
    joint's principal coordinate; negative where the sense is reversed.  transmission: the force in the deflection phi =
    motor / ratio - principal coordinate, which pulls the joint after the motor; in units of the joint's side, without
    friction, armature and role.  friction: of the rotor's bearings, N m and rad/s at the shaft.  prescribed: the
    rotor's motion is, as that of a position-controlled motor.  further: numbers of the rotor's other laws, as in
    Coordinate: stops of its angle, rad and N m at the shaft.  limits: of its motion and its drive, at the shaft.

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

    def numbers(self) -> dict[str, float | None]:
        """Return numbers by the names of parameters: "inertia", "stiffness", "friction.coulomb"; None where not set."""
        drive = {"inertia": self.inertia, "ratio": self.ratio}
        return {**drive, **self.transmission.numbers(CUT_NUMBERS), **self.rotor.law()}


@dataclass(frozen=True)
class Link:
    """A rigid body: mass (kg), com (m, link frame), inertia (kg m^2, INERTIA_KEYS, about com, link axes)."""

    name: str
    mass: float
    com: Vector
    inertia: tuple[float, float, float, float, float, float]

    def numbers(self) -> Numbers:
        """Yield all numbers by the names of parameters: "mass", "com.x"."""
        yield "mass", self.mass
        yield from _below("com", zip(LINEAR, self.com, strict=True))
        yield from _below("inertia", zip(INERTIA_KEYS, self.inertia, strict=True))


@dataclass(frozen=True)
class Joint(_Jointed):
    """A joint: where it is, which of its six coordinates are active (canonical order), and their properties.

    offset: constants in the order of COORDINATES (m, rad) that are added to the six coordinates, active or not, before
    they move anything: errors of manufacturing, wear or temperature; None where the description has none.
    motor: drives the principal coordinate through an elastic transmission; None where the drive acts on it itself.
    limits: range of the principal coordinate, m or rad; ``limits_of`` has all that bounds a coordinate.
    radial: contact of the child's journal in the parent's round bearing; None where there is none.
    damping: of its motion as a whole, beside that of its coordinates; None where there is none.
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

    @property
    def all_coordinates(self) -> dict[str, Coordinate]:
        """Active coordinates and, behind them, the motor's: those of q, in its order."""
        return {**self.coordinates, **({MOTOR: self.motor.rotor} if self.motor else {})}

    def numbers(self) -> Numbers:
        """Yield all numbers that may be parameters, by their names below the joint's; None where one is not set."""
        for name, coordinate in self.coordinates.items():
            yield from _below(name, coordinate.numbers().items())
        if self.motor is not None:
            yield from _below(MOTOR, self.motor.numbers().items())
        for table, element in self.elements.items():
            yield from _below(table, element.law().items())
        yield from _below("offset", zip(COORDINATES, self.offset, strict=True))
        yield from _below("placement", self.placement.numbers())

    def limits_of(self, name: str) -> Limits:
        """Return the limits of a coordinate of the joint, or of its motor's; an empty one where it has none."""
        owner = self.motor if name == MOTOR else self.coordinates.get(name)
        limits = (owner.limits if owner is not None else None) or Limits()
        if self.limits is None or PRINCIPAL.get(self.type) != name:
            return limits
        lower, upper = (x if math.isfinite(x) else None for x in self.limits)
        return replace(limits, lower=lower, upper=upper)

    @renamed(given="limits")
    def with_limits(self, name: str, limits: Limits) -> Joint:
        """Return the joint with these limits of an active coordinate, or of its motor's."""
        if name == MOTOR:
            assert self.motor is not None
            return replace(self, motor=replace(self.motor, limits=limits or None))
        ends, rest = self.limits, limits
        if PRINCIPAL.get(self.type) == name:
            ends = (limits.lower, limits.upper) if limits.lower is not None and limits.upper is not None else None
            rest = limits if ends is None else replace(limits, lower=None, upper=None)
        coordinate = replace(self.coordinates[name], limits=rest or None)
        return replace(self, limits=ends, coordinates={**self.coordinates, name: coordinate})

    @property
    def range(self) -> tuple[float, float]:
        """Lower and upper limit of the principal coordinate, m or rad; infinite where there is none."""
        return self.limits_of(PRINCIPAL.get(self.type, "")).range

    def rigid(self, *, loose: bool = False) -> Joint:
        """Return the joint with deviations locked, and its motor's inertia as an armature of inertia ratio^2.

        Without stops: drives use this model, and do not push a joint off its stop.

        loose: keep deviations without a stiffness, which loops hold: those of a universal joint, say.
        """
        keep = COORDINATES if self.type == "free" else (PRINCIPAL.get(self.type),)
        touching = self.radial.coordinates if self.radial else ()
        locked = {k for k, v in self.coordinates.items() if v.has_stiffness or k in touching or not loose}
        kept = {k: v.unstopped() for k, v in self.coordinates.items() if k in keep or v.prescribed or k not in locked}
        if self.motor is not None:
            name = PRINCIPAL[self.type]
            principal = kept[name]
            armature = (principal.armature or 0.0) + self.motor.inertia * self.motor.ratio**2
            kept[name] = replace(principal, armature=armature, prescribed=principal.prescribed or self.motor.prescribed)
        left: dict[str, Any] = {table: element.left_with(kept) for table, element in self.elements.items()}
        made = replace(self, coordinates=_unloaded(kept), motor=None, **left)
        if self.motor is None or self.motor.limits is None:
            return made
        return made.with_limits(name, self.limits_of(name).within(self.motor.limits.behind(self.motor.ratio)))


@dataclass(frozen=True)
class Frame:
    """A point of interest on a link (or on the base)."""

    name: str
    link: str
    placement: Placement = field(default_factory=Placement)


@dataclass(frozen=True)
class Loop(_Jointed):
    """A loop joint (cut): its type (``cuts.CUTS``) and its frame on each of the two links that it joins.

    Its six coordinates are those of the second frame as seen from the first, T(x, y, z) . Rx(alpha) . Ry(beta) .
    Rz(gamma).  One with properties in ``coordinates`` (without armature and role) has that force; of the others those
    that the type leaves free are free, the rest are rigid.  offset: as that of a joint: a rigid coordinate keeps to it,
    and forces act on what it deviates from it.
    radial: contact of the second link's journal in the first one's round bearing; None where there is none.
    """

    name: str
    links: tuple[str, str]
    type: str
    placements: tuple[Placement, Placement] = (Placement(), Placement())
    coordinates: Mapping[str, Coordinate] = field(default_factory=dict, hash=False, metadata=LATER)
    offset: tuple[float | None, ...] = field(default=(None,) * 6, metadata=LATER)
    radial: Radial | None = field(default=None, metadata=LATER)

    def numbers(self) -> Numbers:
        """Yield all numbers that may be parameters, by their names below the loop's; None where one is not set."""
        for name, coordinate in self.coordinates.items():
            yield from _below(name, coordinate.numbers(CUT_NUMBERS).items())
        for table, element in self.elements.items():
            yield from _below(table, element.law().items())
        yield from _below("offset", zip(COORDINATES, self.offset, strict=True))
        for place, placement in enumerate(self.placements):
            yield from _below(f"placements.{place}", placement.numbers())

    def rigid(self) -> Loop:
        """Return the loop with every coordinate that its type blocks rigid."""
        blocked = [component.name for component in CUTS[self.type]]
        kept = {name: coordinate for name, coordinate in self.coordinates.items() if name not in blocked}
        left: dict[str, Any] = {table: element.left_with(kept) for table, element in self.elements.items()}
        return replace(self, coordinates=_unloaded(kept), **left)


@dataclass(frozen=True)
class Coupling(_Picklable):
    """Coordinates that move together: value(of) = sum of ratio * value(coordinate) + offset.

    of: the name of a coordinate; to: ratios by the names of others, in the unit of ``of`` per theirs; none where
    ``of`` keeps to the offset.  law: forces in what value(of) deviates from the right side, in units of ``of``, without
    armature and role; None where the coupling is rigid.  is_constraint: keeps a coordinate that a rigid coupling would
    make a follower (``Robot.followers``), and a row of the constraint.
    """

    name: str
    of: str
    to: Mapping[str, float] = field(hash=False)
    offset: float | None = None
    law: Coordinate | None = None
    is_constraint: bool = field(default=False, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", MappingProxyType(dict(self.to)))

    def numbers(self) -> dict[str, float | None]:
        """Return numbers by the names of parameters: "ratio.finger1.gamma", "offset"; None where not set."""
        numbers: dict[str, float | None] = {f"ratio.{name}": ratio for name, ratio in self.to.items()}
        numbers["offset"] = self.offset
        return numbers | (self.law.numbers(CUT_NUMBERS) if self.law else {})

    def rigid(self, moving: Container[str]) -> Coupling | None:
        """Return the coupling without its spring where only some coordinates move; None if none is left."""
        law = None if self.law is not None and self.law.has_stiffness else self.law
        to = {name: ratio for name, ratio in self.to.items() if name in moving}
        if self.of in moving:
            return replace(self, to=to, law=law)
        lead = next((name for name, ratio in to.items() if ratio != 0.0), None)
        if lead is None or law is not None:
            return None
        ratio = to.pop(lead)
        offset = None if self.offset is None else -self.offset / ratio
        solved = {name: -x / ratio for name, x in to.items()}
        return Coupling(self.name[: NAME_LENGTH - 6] + "_rigid", lead, solved, offset)  # its numbers are others


def first_contradiction(couplings: Sequence[Coupling]) -> tuple[Coupling, str] | None:
    """Return a rigid coupling that depends on others, and how; None if all of them are independent."""
    said: dict[str, Coupling] = {}
    for coupling in couplings:
        if coupling.law is None:
            if coupling.of in said:
                return coupling, f"{coupling.of} follows from the coupling {said[coupling.of].name}"
            said[coupling.of] = coupling
    resolved: set[str] = set()
    for start in said:
        path: dict[str, Iterator[str]] = {start: iter(said[start].to)}  # coordinates that follow from the next one
        while path:
            last = next(reversed(path))
            below = next((name for name in path[last] if name in said and name not in resolved), None)
            if below is None:
                resolved.add(last)
                del path[last]
            elif below in path:
                names = list(path)
                circle = [said[name].name for name in names[names.index(below) :]]
                return said[last], f"it goes round in a circle: {' -> '.join([*circle, circle[0]])}"
            else:
                path[below] = iter(said[below].to)
    return None


def _in_loops(robot: Robot) -> set[str]:
    """Return the names of the joints on a loop: they move the two sides of its loop joint against each other."""
    above = {joint.child: joint for joint in robot.joints}

    def path(link: str) -> set[str]:
        names = set()
        while link in above:
            names.add(above[link].name)
            link = above[link].parent
        return names

    return {name for loop in robot.loops for name in path(loop.links[0]) ^ path(loop.links[1])}


@dataclass(frozen=True)
class Robot(_Picklable):
    """A validated robot.  Links exclude the base; ``base`` is the base link's name in the description.

    joints are in depth-first order; ``loops`` are the joints that close it, cut; ``springs`` act between points of
    links, other ``elements`` between frames of links; ``couplings`` join coordinates; ``tunable`` names parameters that
    stay run-time values; ``notes`` are one-line remarks about the reading (an inertia that was projected, say), for the
    user to see.
    driven: names of the actuated coordinates (of a joint or its motor, which is the same drive); None: the
    principal ones.  home: where simulations start and assembly begins, m or rad by coordinate; default 0.
    """

    name: str
    gravity: Vector
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...] = ()
    tunable: tuple[str, ...] = ()
    base: str = BASE
    source: str = ""
    notes: tuple[str, ...] = ()
    loops: tuple[Loop, ...] = ()
    springs: tuple[Spring, ...] = ()
    driven: tuple[str, ...] | None = field(default=None, metadata=LATER)
    home: Mapping[str, float] = field(default_factory=dict, hash=False, metadata=LATER)
    couplings: tuple[Coupling, ...] = field(default=(), metadata=LATER)
    elements: tuple[Element, ...] = field(default=(), metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "home", MappingProxyType(dict(self.home)))

    def _repr_html_(self) -> str:
        """Return a small table, for notebooks."""
        rows = {
            "source": self.source or "none",
            "gravity, m/s^2": ", ".join(f"{x:g}" for x in self.gravity),
            "links": len(self.links),
            "mass, kg": f"{sum(link.mass for link in self.links):.6g}",
            "joints": len(self.joints),
            "coordinates": sum(len(joint.all_coordinates) for joint in self.joints) - len(self.followers),
            "loops": len(self.loops),
            "springs between points": len(self.springs),
            "other force elements": len(self.elements),
            "couplings": len(self.couplings),
            "frames": ", ".join(frame.name for frame in self.frames) or "none",
        }
        return html_table(f"Robot {self.name}", rows)

    def show(self, path: Path | str | None = None, *, browser: bool | None = None) -> Any:
        """Show the robot as a page with a slider for each joint; nothing is simulated or compiled.

        Args:
            path: to write the page to, .html; None for none.
            browser: whether to open it; by default unless a notebook shows it, or it is written to a path.

        Returns:
            The page: notebooks show it below their cell, ``save(path)`` writes it, ``open()`` opens it in the browser.

        Raises:
            InputError: the file cannot be written.
        """
        return from_above(".export.live.view", "show_robot")(self, path, browser=browser)

    @property
    def link_elements(self) -> tuple[LinkElement, ...]:
        """All force elements between two links, springs first."""
        return (*self.springs, *self.elements)

    def numbers(self) -> Numbers:
        """Yield every number of the description that may be a parameter, by its name; None where one is not set."""
        yield from _below("gravity", zip(LINEAR, self.gravity, strict=True))
        for link in self.links:
            yield from _below(f"links.{link.name}", link.numbers())
        for joint in self.joints:
            yield from _below(f"joints.{joint.name}", joint.numbers())
        for frame in self.frames:
            yield from _below(f"frames.{frame.name}.placement", frame.placement.numbers())
        for loop in self.loops:
            yield from _below(f"loops.{loop.name}", loop.numbers())
        for coupling in self.couplings:
            yield from _below(f"couplings.{coupling.name}", coupling.numbers().items())
        for element in self.link_elements:
            yield from _below(element.prefix, element.numbers())

    def link(self, name: str) -> Link:
        """Return the link of that name; UnknownNameError if there is none."""
        return _of_name("link", name, self.links)

    def joint(self, name: str) -> Joint:
        """Return the joint of that name; UnknownNameError if there is none."""
        return _of_name("joint", name, self.joints)

    def limits_of(self, coordinate: str) -> Limits:
        """Return the limits of a coordinate by its name, "joint1.gamma"; an empty one where it has none."""
        joint, name = split_component(coordinate)
        return self.joint(joint).limits_of(name)

    @property
    def is_closed(self) -> bool:
        """True if something beside the tree holds coordinates: loops, or couplings but those of ``followers``."""
        return bool(self.loops or len(self.couplings) > len(self.followers))

    @property
    def followers(self) -> dict[str, Coupling]:
        """Couplings by the coordinates that they make followers, each behind its leaders.

        A follower is no coordinate of kernels: its position, velocity and acceleration are those that its leaders give
        it.  Of rigid couplings those stay constraints whose dependent coordinate moves a loop, belongs to a joint with
        a motor, a journal or damping as a whole, follows a motor, or has a drive and
        follows several, and those that ``is_constraint`` keeps.
        """
        acted_on = {x.name for x in self.joints if (x.motor, x.radial, x.damping) != (None, None, None)}
        shared = {x.of for x in self.couplings if len(x.to) - [*x.to.values()].count(0.0) != 1}
        acted_on |= {joint_of(name) for name in self.driven or () if name in shared}
        kept = _in_loops(self) | acted_on
        rigid = [x for x in self.couplings if x.law is None and not x.is_constraint]
        left = {x.of: x for x in rigid if joint_of(x.of) not in kept and all(kind_of(name) != MOTOR for name in x.to)}
        behind: dict[str, list[str]] = {}
        for name, coupling in left.items():
            for other in coupling.to.keys() & left.keys():
                behind.setdefault(other, []).append(name)
        ahead = {name: len(coupling.to.keys() & left.keys()) for name, coupling in left.items()}
        ready = [name for name, count in ahead.items() if not count]
        for name in ready:  # which grows
            for other in behind.get(name, ()):
                ahead[other] -= 1
                ready += [other] if not ahead[other] else []
        return {name: left[name] for name in ready}

    def with_constraints(self) -> Robot:
        """Return the robot without followers: all rigid couplings are rows of the constraint."""
        couplings = tuple(replace(x, is_constraint=True) if x.law is None else x for x in self.couplings)
        return replace(self, couplings=couplings) if self.followers else self

    @kept
    def rigid(self) -> Robot:
        """Return the robot with deviations locked: principal and prescribed coordinates and free joints move.

        Stops of joints are left out.

        Where there are loops, coordinates without a stiffness move, too: the loops hold them.

        Loop joints are rigid in what their types block, couplings with a stiffness where that contradicts no other one.
        Transmissions are rigid: a motor counts as an armature, and the motion of one that is prescribed as its joint's.
        Springs and other force elements between links that then do not move against each other are left out.
        """
        joints = [joint.rigid(loose=bool(self.loops)) for joint in self.joints]
        loops = [loop.rigid() for loop in self.loops]
        carrier = {self.base: self.base}
        for joint in joints:
            carrier[joint.child] = joint.child if joint.coordinates else carrier[joint.parent]
        springs = tuple(s for s in self.springs if carrier[s.links[0]] != carrier[s.links[1]])
        elements = tuple(x for x in self.elements if carrier[x.links[0]] != carrier[x.links[1]])
        moving = {f"{joint.name}.{name}" for joint in joints for name in joint.coordinates}
        drives = {f"{j.name}.{MOTOR}": f"{j.name}.{PRINCIPAL[j.type]}" for j in self.joints if j.motor is not None}
        driven = None if self.driven is None else dict.fromkeys(drives.get(name, name) for name in self.driven)
        couplings: tuple[Coupling, ...] = ()
        for coupling in self.couplings:
            stiff = coupling.rigid(moving)
            if stiff is not None:
                fits = first_contradiction((*couplings, stiff)) is None
                couplings += (stiff if fits else coupling,)
        made = replace(self, name=self.name[:42] + "_rigid", joints=tuple(joints), loops=tuple(loops))
        more = replace(made, couplings=couplings).followers.keys() - self.followers.keys()  # are coordinates here, too
        made = replace(
            made,
            springs=springs,
            elements=elements,
            driven=None if driven is None else tuple(name for name in driven if name in moving),
            home={name: value for name, value in self.home.items() if name in moving},
            couplings=tuple(replace(x, is_constraint=True) if not x.law and x.of in more else x for x in couplings),
        )
        left = {name for name, _ in made.numbers()}
        return replace(made, tunable=tuple(name for name in self.tunable if name in left))

    def with_value(self, path: str, value: Any) -> Robot:
        """Return the robot with one value of its description changed, checked as those that are loaded.

        Args:
            path: keys and names with dots: a parameter ("links.arm.mass", "joints.joint1.x.stiffness", "gravity.z"), or
                a whole value ("links.arm.com", "joints.joint1.limits").
            value: a number, a list, a text or a mapping, in SI units; numbers that follow from it follow anew.

        Raises:
            DescriptionError: there is no such value (says what is there), or no robot can have it.
        """
        return self.with_values({path: value})

    def with_values(self, changes: Mapping[str, Any]) -> Robot:
        """Return the robot with several values changed at once, by their paths; see ``with_value``."""
        changed: Robot = from_above(".description.changing", "with_values")(self, changes)
        return changed

    def with_coordinates(self, coordinates: Mapping[str, Mapping[str, Coordinate]]) -> Robot:
        """Return the robot with these coordinates (by joint, then by name) active, too."""
        joints = tuple(
            replace(joint, coordinates={**joint.coordinates, **coordinates.get(joint.name, {})})
            for joint in self.joints
        )
        return replace(self, joints=joints)


_Named = TypeVar("_Named", Link, Joint)


def _of_name(what: str, name: str, items: Iterable[_Named]) -> _Named:
    """Return the item of that name; UnknownNameError if there is none."""
    known = {item.name: item for item in items}
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(f"{what}: {show(name)} is unknown{nearest_or_all(str(name), known)}")
    return known[name]
