"""Couplings: coordinates that move together, rigidly or through a spring."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from ...names import NAME_LENGTH, component_name, joint_of
from ..fields import LATER, Picklable
from .coordinate import Coordinate
from .joint import CUT_NUMBERS, Joint
from .sliding import SlidingShapes

PER_RADIAN = 0.5 / math.pi  # revolutions per radian


@dataclass(frozen=True)
class Coupling(Picklable):
    """Coordinates that move together: value(of) = sum of ratio * value(coordinate) + offset.

    of: the name of a coordinate; to: ratios by the names of others, in the unit of ``of`` per theirs; none where
    ``of`` keeps to the offset.  law: forces in what value(of) deviates from the right side, in units of ``of``, without
    armature and role; None where the coupling is rigid.  is_constraint: keeps a coordinate that a rigid coupling would
    make a follower (``Robot.followers``), and a row of the constraint.
    bends: pairs of coordinates, each pair once, and a number b for what else is added: b x y of two, b x^2 / 2 of one
    with itself; how far the node of a link that bends is drawn in.
    sliding: what else is added where a joint slides along a beam that bends; its coefficients are constants.
    pitch: of the screw whose z is ``of``, m per revolution: the ratio is pitch / (2 pi), and no parameter.
    """

    name: str
    of: str
    to: Mapping[str, float] = field(hash=False)
    offset: float | None = None
    law: Coordinate | None = None
    is_constraint: bool = field(default=False, metadata=LATER)
    bends: tuple[tuple[str, str, float], ...] = field(default=(), metadata=LATER)
    sliding: SlidingShapes | None = field(default=None, metadata=LATER)
    pitch: float | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", MappingProxyType(dict(self.to)))

    @property
    def others(self) -> tuple[str, ...]:
        """Names of the coordinates that ``of`` depends on."""
        return tuple(dict.fromkeys((*self.to, *(name for pair in self.products for name in pair))))

    @property
    def products(self) -> tuple[tuple[str, str], ...]:
        """Pairs of coordinates by which the second derivative of the right side does not vanish."""
        sliding = self.sliding.products if self.sliding is not None else ()
        return (*(pair[:2] for pair in self.bends), *sliding)

    def numbers(self) -> dict[str, float | None]:
        """Return numbers by the names of parameters: "ratio.finger1.gamma", "offset"; None where not set."""
        if self.pitch is not None:
            return {}
        numbers: dict[str, float | None] = {f"ratio.{name}": ratio for name, ratio in self.to.items()}
        numbers["offset"] = self.offset
        return numbers | (self.law.numbers(CUT_NUMBERS) if self.law else {})

    @property
    def pitch_name(self) -> str:
        """Name of the pitch as a parameter; "" of a coupling that is none of a screw."""
        return "" if self.pitch is None else f"joints.{joint_of(self.of)}.pitch"

    def value(self, of: Callable[[str], Any]) -> Any:
        """Return what the coordinate has to be by the description's numbers.

        Args:
            of: gives the value of another coordinate by its name, a number or an array.
        """
        value: Any = self.offset or 0.0
        for name, ratio in self.to.items():
            value = value + ratio * of(name)
        for name, other, bend in self.bends:
            value = value + bend * (0.5 if name == other else 1.0) * of(name) * of(other)
        return value if self.sliding is None else value + self.sliding.value(of)

    def without_states(self) -> Coupling:
        """Return the coupling without laws that have states."""
        return replace(self, law=self.law and self.law.without_states())

    def rigid(self, moving: Container[str]) -> Coupling | None:
        """Return the coupling without its spring where only some coordinates move; None if none is left."""
        law = None if self.law is None or self.law.has_stiffness else self.law.without_states()
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


def with_screws(couplings: Iterable[Coupling], joints: Iterable[Joint]) -> tuple[Coupling, ...]:
    """Return couplings of a robot, behind others those by which z of its screws follows gamma.

    Args:
        couplings: with or without those of screws, of which ``is_constraint`` alone counts.
        joints: of the robot.
    """
    given = tuple(couplings)
    constraints = {x.of for x in given if x.pitch is not None and x.is_constraint}
    made = []
    for joint in joints:
        if joint.pitch is not None:
            z, gamma = (component_name(joint.name, kind) for kind in ("z", joint.principal))
            to = {gamma: PER_RADIAN * joint.pitch}
            name = f"{joint.name[: NAME_LENGTH - 2]}_z"
            made.append(Coupling(name, z, to, is_constraint=z in constraints, pitch=joint.pitch))
    return (*(x for x in given if x.pitch is None), *made)


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
