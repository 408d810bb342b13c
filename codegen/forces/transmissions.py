"""Transmissions between motors and joints: forces in their deflections.

A transmission's force f in its deflection phi = motor / ratio - principal coordinate acts on both ends: f / ratio
resists the motor, and -f the joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from eomgen.names import kind_of
from eomgen.robot.parameter_names import JOINTS
from eomgen.robot.value import MOTOR

from ..tree.bound import BoundTransmission
from ..tree.spatial import Scalar
from .element import ForceRows, ImplicitShare, Slopes
from .laws import Effect, effect

# The motor, what is behind it, and its effects: by stiffness and damping, and by laws
Deflected = tuple[int, BoundTransmission, Effect, Effect]


class Transmissions(ForceRows):
    """Springs and dampers between all motors and the coordinates that they drive."""

    FAMILY: ClassVar[str] = JOINTS

    @classmethod
    def has(cls, family: str, owner: str) -> bool:
        """Tell whether numbers are those of a motor's table."""
        return super().has(family, owner) and kind_of(owner) == MOTOR

    def carried(self, v: Sequence[Scalar]) -> dict[int, Scalar]:
        """Return what gears carry to their joints, by the motors' indices; N m or N on the joint's side."""
        return {motor: (one + other).force for motor, _, one, other in self._deflections(self.at.q, v)}

    def energies(self) -> Iterator[Scalar]:
        """Give the energies of the deflections."""
        yield from ((one + other).energy for *_, one, other in self._deflections(self.at.q, self.at.still))

    def add_slopes(self, slopes: Slopes) -> None:
        """Add what the slopes of a deflection's force are on both ends."""
        for motor, between, one, other in self._deflections(slopes.q, slopes.v):
            p, inverse, whole = between.principal, between.inverse_ratio, one + other
            across = [slope * inverse for slope in (whole.by_s, whole.by_rate)]
            slopes.add((motor, motor), *(x * inverse for x in across))
            slopes.add((motor, p), *(-x for x in across))
            slopes.add((p, motor), *(-x for x in across))
            slopes.add((p, p), whole.by_s, whole.by_rate)

    def add_rows(self, share: ImplicitShare) -> None:
        """Add the slopes in the deflections."""
        for motor, _, linear, law in self._deflections(share.q, share.v):
            share.in_transmission(motor, linear, law)

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the forces on motors and joints."""
        for motor, between, one, other in self._deflections(q, v):
            force = (one + other).force
            yield motor, force * between.inverse_ratio
            yield between.principal, -force

    def _deflections(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> list[Deflected]:
        """Return motors with their transmissions and effects; forces in units of the joint's side."""
        deflections, f = list[Deflected](), self.at.functions
        for motor, between in self.at.bound.transmissions.items():
            phi, rate = (x[motor] * between.inverse_ratio - x[between.principal] for x in (q, v))
            k, b = between.law.stiffness, between.law.damping
            linear = Effect(k * phi + b * rate, k, b, 0.5 * k * phi * phi)
            nonlinear = effect(between.law, phi, rate, f)
            deflections.append((motor, between, linear, nonlinear))
        return deflections
