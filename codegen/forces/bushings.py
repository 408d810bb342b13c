"""Bushings: each of the six coordinates e of its second frame as seen from its first is resisted by k e + c e_dot.

The force acts along the row de/dq; coordinates and rows are those of ``relative_placement``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from eomgen.robot.elements import Bushing
from eomgen.robot.geometry import ANGULAR

from ..tree.constraints import Direction, FramePair
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, along, is_zero
from .element import Arms, Deflection, ForceElement, ImplicitShare, Slopes
from .laws import Effect
from .relative_placement import coordinates_of, cosine_of


@dataclass(frozen=True)
class BushingCoordinate:
    """One coordinate with a force: its value, row, direction, stiffness and damping, and the described stiffness."""

    name: str
    value: Scalar
    arms: Arms
    direction: Direction
    pair: FramePair
    stiffness: Scalar
    damping: Scalar
    described: float

    def resists(self, v: Sequence[Scalar], dt: Scalar = 0.0) -> Effect:
        """Give the force that resists where the rates v lead after dt, its slopes and energy."""
        k, c, rate = self.stiffness, self.damping, along(self.arms, v)
        e = self.value if is_zero(dt) else self.value + dt * rate
        return Effect(k * e + c * rate, k, c, 0.5 * k * e * e)


class Bushings(ForceElement):
    """All bushings."""

    @cached_property
    def members(self) -> list[BushingCoordinate]:
        """The coordinates where q is, bushing by bushing."""
        at, found = self.at, list[BushingCoordinate]()
        for bushing in at.bound.elements[Bushing.TABLE]:
            at.note(f"{bushing.name}: bushing between {bushing.links[0]} and {bushing.links[1]}")
            where = f"{Bushing.TABLE}.{bushing.name}"
            pair = FramePair(at.model, at.joints, bushing.ends, where)
            known = {key: f"{where}.{key}" for key in bushing.numbers}
            parameters = at.model.parameters
            described = {key: parameters[name] for key, name in known.items() if name in parameters}
            slopes = Bushing.slopes(described)
            for name, (value, direction, _, arms) in coordinates_of(pair, list(slopes), at.functions).items():
                k, c = bushing.numbers[f"stiffness.{name}"], bushing.numbers[f"damping.{name}"]
                found.append(
                    BushingCoordinate(f"{bushing.name}.{name}", value, arms, direction, pair, k, c, slopes[name][0])
                )
        return found

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the forces along de/dq."""
        for own in self.members:
            force = own.resists(v).force
            yield from ((i, force * arm) for i, arm in own.arms.items())

    def deflections(self, v: Sequence[Scalar]) -> Iterator[Deflection]:
        """Give all six coordinates with a force of each bushing."""
        yield from (Deflection(own.name, own.value, own.resists(v).force, own.arms) for own in self.members)

    def energies(self) -> Iterator[Scalar]:
        """Give energies of the coordinates."""
        yield from (own.resists(self.at.still).energy for own in self.members)

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints between both links hold: the forces pass them by."""
        for own in self.members:
            wrench = own.direction.wrench(-1.0 * own.resists(v).force)
            yield from own.pair.wrenches(wrench.force, wrench.moment)

    def add_slopes(self, slopes: Slopes) -> None:
        """Add derivatives, differentiating the graph."""
        for own in self.members:
            force = own.resists(slopes.v).force
            slopes.differentiate({i: force * arm for i, arm in own.arms.items()}, list(own.arms))

    def add_rows(self, share: ImplicitShare) -> None:
        """Add forces where the rates lead to, and their slopes."""
        for own in self.members:
            share.along(own.arms, own.resists(share.v, share.ahead))

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give those of the description's numbers."""
        for own in self.members:
            yield from ((i, own.described * (arm * arm)) for i, arm in own.arms.items())

    def poles(self, moving: Collection[int]) -> Iterator[tuple[str, Scalar]]:
        """Give cos(beta) of bushings whose angles have forces, and are moved by these coordinates."""
        angles = {f".{name}" for name in ANGULAR}
        turned = {
            own.pair.where: own.pair
            for own in self.members
            if own.name[own.name.rindex(".") :] in angles and not own.arms.keys().isdisjoint(moving)
        }
        yield from ((where, cosine_of(pair, self.at.functions)) for where, pair in turned.items())
