"""Forces of coordinates themselves, Q_P of eq. (13): linear in coordinate and rate, and what ``laws`` add to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from eomgen.names import kind_of
from eomgen.robot.parameter_names import JOINTS
from eomgen.robot.value import MOTOR

from ..tree.spatial import Scalar
from .element import ForceElement, ImplicitShare, Slopes
from .laws import Effect, bearing_load, effect, without_friction


class CoordinateLaws(ForceElement):
    """Springs, dampers and laws of all coordinates, those of motors at their shafts."""

    FAMILY: ClassVar[str] = JOINTS

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell whether numbers are those of coordinates and no motor's."""
        return super().has(family, owner) and kind_of(owner) != MOTOR

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give -Q_P."""
        yield from self._rows(self.at.q, v)

    def energies(self) -> Iterator[Scalar]:
        """Give energies of linear springs, then of laws."""
        q = self.at.q
        for law, s in zip(self.at.bound.laws, q, strict=True):
            yield 0.5 * law.stiffness * s * s
        yield from (law.energy for law in self._effects(q, self.at.still).values())

    def add_slopes(self, slopes: Slopes) -> None:
        """Add slopes of laws; those of straight lines are in ``residual_derivatives``."""
        bound, q, v, f = self.at.bound, slopes.q, slopes.v, self.at.functions
        effects = self._effects(q, v)
        for i, law in effects.items():
            slopes.add((i, i), law.by_s, law.by_rate)
        for i, law in effects.items():
            others = bound.laws[i].carriers
            carried = [self._without_friction(j, q, v) for j in others]
            for j, one, slope in zip(others, carried, bearing_load(carried, f)[1] if others else (), strict=True):
                slopes.add((i, j), law.by_load * slope * one.by_s, law.by_load * slope * one.by_v)

    def advance(self, share: ImplicitShare) -> None:
        """Push -Q_P."""
        for i, force in self._rows(share.q, share.v):
            share.push(i, force)

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of straight lines and laws."""
        for i, law in enumerate(self.at.bound.laws):
            share.on_coordinate(i, law.stiffness, law.damping)
        for i, acting in self._effects(share.q, share.v).items():
            share.bend(i, acting)

    def _rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        laws = self.at.bound.laws
        yield from enumerate([x.stiffness * s + x.damping * rate for x, s, rate in zip(laws, q, v, strict=True)])
        yield from ((i, law.force) for i, law in self._effects(q, v).items())

    def _effects(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> dict[int, Effect]:
        """Return effects of laws beyond eq. (13), by the index of the coordinate."""
        effects, f = dict[int, Effect](), self.at.functions
        for i, law in enumerate(self.at.bound.laws):
            if law.numbers:
                load = (
                    bearing_load([self._without_friction(j, q, v) for j in law.carriers], f)[0] if law.carriers else 0.0
                )
                effects[i] = effect(law.numbers, law.knots, q[i], v[i], f, load)
        return effects

    def _without_friction(self, j: int, q: Sequence[Scalar], v: Sequence[Scalar]) -> Effect:
        """Return the effect, without friction, of a coordinate that presses on others."""
        return without_friction(self.at.bound.laws[j], q[j], v[j], self.at.functions)
