"""Coordinates of joints: their springs, dampers, friction, contacts and limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from ..bounds import Limits
from ..fields import LATER, Picklable
from ..geometry import COORDINATES, LINEAR
from ..internal_states.bouc_wen import elastic_share
from ..internal_states.drives import DRIVE
from ..laws import BASIC, GAUSSIAN, NUMBERS, SHAPES, Curve, active_laws, defaults

ACROSS: Mapping[str, tuple[str, ...]] = MappingProxyType(  # translations across a coordinate's axis
    {name: tuple(x for x in LINEAR if x != axis) for name, axis in zip(COORDINATES, LINEAR * 2, strict=True)}
)
COORDINATE_NUMBERS = tuple(number.key for number in BASIC)  # of any coordinate; each may be a run-time parameter
_RANKS: Mapping[str, int] = MappingProxyType(  # places of laws' numbers in their table, but for a curve's
    {key: rank for rank, key in enumerate(NUMBERS) if key != "curve"}
)


@dataclass(frozen=True)
class Friction:
    """Friction at the velocity v: sgn(v) (C + (static - coulomb) / (1 + (v / stribeck)^2)) + viscous v.

    With the shape "gaussian" the excess of static friction falls as exp(-(v / stribeck)^2).  C is coulomb, and with a
    ``coefficient`` (load-dependent friction) coulomb + coefficient radius N, N the load of the joint (``carriers``);
    ``radius`` (m) is the friction radius of a rotation, and 1 of a translation.
    coulomb, static: N or N m; stribeck: m/s or rad/s; viscous: N s/m or N m s/rad.  sgn(v) is v / sqrt(v^2 +
    smoothing^2); smoothing (m/s or rad/s) becomes 4e-8, or 1e-6 stribeck if that is less, where it is None.

    With a ``bristle_stiffness`` sigma_0 (N/m or N m/rad) it is LuGre's, which has a state z (m or rad):
    z' = v - sigma_0 |v| z / g(v), F = sigma_0 z + sigma_1(v) z' + viscous v, with the Gaussian g(v) and
    sigma_1(v) = ``bristle_damping`` exp(-(v / ``fade``)^2), constant without ``fade`` (m/s or rad/s).
    """

    coulomb: float = 0.0
    static: float | None = None
    stribeck: float | None = None
    viscous: float | None = None
    smoothing: float | None = None
    coefficient: float | None = field(default=None, metadata=LATER)
    radius: float | None = field(default=None, metadata=LATER)
    shape: str | None = field(default=None, metadata=LATER)
    bristle_stiffness: float | None = field(default=None, metadata=LATER)
    bristle_damping: float | None = field(default=None, metadata=LATER)
    fade: float | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        if self.shape not in (None, *SHAPES):
            raise ValueError(f"shape {self.shape!r}")
        if self.bristle_stiffness is not None and self.shape is None:
            object.__setattr__(self, "shape", GAUSSIAN)
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
class Coordinate(Picklable):
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
        laws = any(law.name not in ("friction", DRIVE) for law in active_laws(self.law()))
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
        own = ((key, value) for key, value in vars(self).items() if key in _RANKS)
        given = {**dict(own), **(self.friction.numbers() if self.friction else {}), **self.further}
        known = [key for key, value in given.items() if value is not None and key in _RANKS]
        numbers = {key: given[key] for key in sorted(known, key=_RANKS.__getitem__)}
        return numbers | {f"curve.{i}": force for i, (_, force) in enumerate(self.curve or ())}

    def without_states(self) -> Coordinate:
        """Return the coordinate with the friction that bristles slide with, and without other laws that have states.

        The share of hysteresis that is elastic stays, as stiffness, but beside a clearance or a curve, whose springs do
        not act on the deviation alone.
        """
        numbers = self.law()
        with_states = {law.name for law in active_laws(numbers) if law.states is not None and law.states(numbers)}
        if not with_states:
            return self
        friction = self.friction
        if friction is not None and "friction" in with_states:
            friction = replace(friction, bristle_stiffness=None, bristle_damping=None, fade=None)
        further = {key: number for key, number in self.further.items() if key.partition(".")[0] not in with_states}
        return replace(self, friction=friction, further=further, **self._with_spring(elastic_share(numbers)))

    def _with_spring(self, stiffness: float) -> dict[str, Any]:
        """Return the fields by which a linear spring is added, N/m or N m/rad; none where they mean something else."""
        if not stiffness or self.clearance is not None or self.curve is not None:
            return {}
        sides = {"stiffness": self.stiffness or 0.0}
        sides |= {} if self.stiffness_negative is None else {"stiffness_negative": self.stiffness_negative}
        return {key: side + stiffness for key, side in sides.items()}

    def without_drive(self) -> Coordinate:
        """Return the coordinate with a force in the place of a drive with states."""
        others = {key: number for key, number in self.further.items() if not key.startswith(f"{DRIVE}.")}
        return self if len(others) == len(self.further) else replace(self, further=others)

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


def unloaded(coordinates: Mapping[str, Coordinate]) -> dict[str, Coordinate]:
    """Return the coordinates without load-dependent friction where there is no load any more."""
    unloaded = dict(coordinates)
    for name, others in load_dependent(coordinates).items():
        friction = unloaded[name].friction
        if friction is not None and not others:
            unloaded[name] = replace(unloaded[name], friction=replace(friction, coefficient=None, radius=None))
    return unloaded
