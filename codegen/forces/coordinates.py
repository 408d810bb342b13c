"""Forces of coordinates themselves, Q_P of eq. (13): linear in coordinate and rate, and whatever ``laws`` add to them.

LuGre friction has a state z, the deflection of bristles:

    z' = v - sigma_0 |v| z / g(v),    F = sigma_0 z + sigma_1(v) z' + viscous v,
    g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)^2),    sigma_1(v) = bristle_damping exp(-(v / fade)^2).

C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A New Model for Control of Systems with Friction", IEEE
Transactions on Automatic Control 40 (1995).  It stores sigma_0 z^2 / 2: sigma_0 is the inertia of the state, so that
powers of generalized forces are those that friction takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from eomgen.names import kind_of
from eomgen.robot.laws import BRISTLES
from eomgen.robot.parameter_names import JOINTS
from eomgen.robot.value import MOTOR

from ..tree.spatial import Scalar
from .element import ForceElement, ImplicitShare, Slopes, StateSlopes
from .laws import Effect, bearing_load, effect, without_friction
from .scalar_functions import Functions


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


@dataclass(frozen=True)
class Bristles:
    """Friction at (v, z): the resisting force, the rate of z, and slopes of both."""

    force: Scalar
    rate: Scalar
    slopes: StateSlopes


def lugre(numbers: Mapping[str, Scalar], v: Scalar, z: Scalar, f: Functions) -> Bristles:
    """Return the friction of a coordinate's numbers at its velocity v, m/s or rad/s, and the deflection z, m or rad."""
    stiffness = numbers[BRISTLES]
    level, bend = _sliding(numbers, v, f)
    inverse = 1.0 / level
    speed, sign = f.max(v, -1.0 * v), 2.0 * f.step(v) - 1.0
    pull = stiffness * inverse  # over which bristles give way, per z
    rate = v - speed * (pull * z)
    g_z = -1.0 * (speed * pull)
    g_v = 1.0 - (pull * z) * (sign - speed * (bend * inverse))
    damping, fading = _damping(numbers, v, f)
    force, f_v, f_z = stiffness * z + damping * rate, damping * g_v + fading * rate, stiffness + damping * g_z
    viscous = numbers.get("friction.viscous", 0.0)
    return Bristles(force + viscous * v, rate, StateSlopes(f_v + viscous, f_z, g_v, g_z, stiffness))


def _sliding(numbers: Mapping[str, Scalar], v: Scalar, f: Functions) -> tuple[Scalar, Scalar]:
    """Return g(v) and its slope."""
    coulomb = numbers["friction.coulomb"]
    if "friction.static" not in numbers:
        return coulomb, 0.0
    inverse = 1.0 / numbers["friction.gaussian"]
    x = v * inverse
    more = (numbers["friction.static"] - coulomb) * f.exp(-1.0 * (x * x))
    return coulomb + more, -2.0 * inverse * (x * more)


def _damping(numbers: Mapping[str, Scalar], v: Scalar, f: Functions) -> tuple[Scalar, Scalar]:
    """Return sigma_1(v) and its slope."""
    damping = numbers.get("friction.bristle_damping", 0.0)
    if "friction.fade" not in numbers:
        return damping, 0.0
    inverse = 1.0 / numbers["friction.fade"]
    x = v * inverse
    faded = damping * f.exp(-1.0 * (x * x))
    return faded, -2.0 * inverse * (x * faded)


class BristleFriction(ForceElement):
    """LuGre friction of all coordinates that have it."""

    FAMILY: ClassVar[str] = JOINTS

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell of no numbers: they are those of coordinates' laws."""
        return False

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give forces on coordinates, and minus the rates of their states times sigma_0, their inertia."""
        for (i, k), law in self._laws(v).items():
            yield i, law.force
            yield k, -1.0 * (law.slopes.inertia * law.rate)

    def state_energies(self, v: Sequence[Scalar]) -> Iterator[Scalar]:
        """Give what the bristles store."""
        for i, k in self.at.model.remembering.items():
            yield 0.5 * self.at.bound.laws[i].numbers[BRISTLES] * (v[k] * v[k])

    def add_slopes(self, slopes: Slopes) -> None:
        """Add slopes of forces and of states' rates."""
        for (i, k), law in self._laws(slopes.v).items():
            by = law.slopes
            slopes.add((i, i), 0.0, by.f_v)
            slopes.add((i, k), 0.0, by.f_z)
            slopes.add((k, i), 0.0, -1.0 * (by.inertia * by.g_v))
            slopes.add((k, k), 0.0, -1.0 * (by.inertia * by.g_z))

    def advance(self, share: ImplicitShare) -> None:
        """Push forces, and what drives the states."""
        for i, force in self.resist(share.v):
            share.push(i, force)

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of forces and of states' rates."""
        for (i, k), law in self._laws(share.v).items():
            share.in_memory(i, k, law.slopes)

    def _laws(self, v: Sequence[Scalar]) -> dict[tuple[int, int], Bristles]:
        """Return the friction of each coordinate by its index and that of its state."""
        laws, f = self.at.bound.laws, self.at.functions
        return {(i, k): lugre(laws[i].numbers, v[i], v[k], f) for i, k in self.at.model.remembering.items()}
