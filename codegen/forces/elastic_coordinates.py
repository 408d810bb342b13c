"""Coordinates beside those of the tree that have a force: it acts along the rows of their derivatives by q.

They are coordinates of one frame as seen from another (``relative_placement``), of cut joints and bushings, or what
couplings are off.  A deviation s with the row J = ds/dq is resisted like that of any joint's coordinate, with J^T r.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from eomgen.names import kind_of
from eomgen.robot.geometry import ANGULAR

from ..tree.bound import BoundLaw
from ..tree.constraints import Direction, FramePair
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, along, is_zero
from .element import ForceElement, ImplicitShare, Slopes
from .laws import Effect, bearing_load, effect, without_friction
from .relative_placement import cosine_of
from .scalar_functions import Functions


@dataclass(frozen=True)
class ElasticCoordinate:
    """A coordinate with a force: s, ds/dq by the index of the coordinate, and the law.

    described: its stiffness by the description's numbers.
    pair: the frames that it is of, with its direction there; None of a coupling's.  name: below its element's.
    carriers: coordinates of the same cut joint that press on it, where its friction depends on that.
    turn: sine and cosine of an angle, offset included.
    """

    s: Scalar
    jacobian_row: dict[int, Scalar]
    law: BoundLaw
    described: float = 0.0
    pair: FramePair | None = None
    direction: Direction | None = None
    name: str = ""
    carriers: tuple[ElasticCoordinate, ...] = ()
    turn: tuple[Scalar, Scalar] | None = None

    @property
    def has_force(self) -> bool:
        """Whether it has a law; one that a journal feels may have none."""
        return bool(self.law.numbers) or not (is_zero(self.law.stiffness) and is_zero(self.law.damping))

    def rate(self, v: Sequence[Scalar]) -> Scalar:
        """Return ds/dt."""
        return along(self.jacobian_row, v)

    def resists(self, v: Sequence[Scalar], f: Functions, dt: Scalar = 0.0) -> Effect:
        """Return the force against the deviation to which the rates v lead after dt, its slopes and energy."""
        s, rate = self._after(v, dt)
        k, c = self.law.stiffness, self.law.damping
        linear = Effect(k * s + c * rate, k, c, 0.5 * k * s * s)
        load = bearing_load([other.presses(v, f, dt) for other in self.carriers], f)[0] if self.carriers else 0.0
        return linear + effect(self.law.numbers, self.law.knots, s, rate, f, load)

    def moved_by(self) -> list[int]:
        """Return the indices of the coordinates on which its force depends, those that move it first."""
        return list(dict.fromkeys(i for one in (self, *self.carriers) for i in one.jacobian_row))

    def presses(self, v: Sequence[Scalar], f: Functions, dt: Scalar) -> Effect:
        """Return the effect of its springs, contacts and dampers alone, arguments as of ``resists``."""
        s, rate = self._after(v, dt)
        return without_friction(self.law, s, rate, f)

    def on_second(self, force: Scalar) -> Wrench:
        """Return the resisting force's wrench on the second frame's link, in the common body's axes."""
        assert self.direction is not None
        return self.direction.wrench(-1.0 * force)

    def wrenches(self, force: Scalar) -> Iterator[tuple[int, Wrench]]:
        """Return the tree's joint wrenches that hold the resisting force, as of ``FramePair.wrenches``."""
        if self.pair is not None:
            wrench = self.on_second(force)
            yield from self.pair.wrenches(wrench.force, wrench.moment)

    def _after(self, v: Sequence[Scalar], dt: Scalar) -> tuple[Scalar, Scalar]:
        rate = self.rate(v)
        return self.s if is_zero(dt) else self.s + dt * rate, rate


class ElasticCoordinates(ForceElement):
    """All such coordinates of one family."""

    @property
    @abstractmethod
    def members(self) -> Sequence[ElasticCoordinate]:
        """The coordinates where q is."""

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the forces along ds/dq."""
        for coordinate in self.members:
            force = coordinate.resists(v, self.at.functions).force
            yield from ((i, force * arm) for i, arm in coordinate.jacobian_row.items())

    def energies(self) -> Iterator[Scalar]:
        """Give energies of the deviations."""
        yield from (coordinate.resists(self.at.still, self.at.functions).energy for coordinate in self.members)

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints between both frames hold of the forces."""
        for coordinate in self.members:
            yield from coordinate.wrenches(coordinate.resists(v, self.at.functions).force)

    def add_slopes(self, slopes: Slopes) -> None:
        """Add derivatives, differentiating the graph."""
        for coordinate in self.members:
            if coordinate.has_force:
                force = coordinate.resists(slopes.v, self.at.functions).force
                slopes.differentiate(
                    {i: force * arm for i, arm in coordinate.jacobian_row.items()}, coordinate.moved_by()
                )

    def add_rows(self, share: ImplicitShare) -> None:
        """Add forces where the rates lead to, and their slopes."""
        for coordinate in self.members:
            if coordinate.has_force:
                share.along(coordinate.jacobian_row, coordinate.resists(share.v, self.at.functions, share.ahead))

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give those of the description's numbers."""
        for coordinate in self.members:
            yield from ((i, coordinate.described * (arm * arm)) for i, arm in coordinate.jacobian_row.items())

    def poles(self, moving: Collection[int]) -> Iterator[tuple[str, Scalar]]:
        """Give cos(beta) of frames whose angles have forces, and are moved by these coordinates."""
        turned = {
            coordinate.pair.where: coordinate.pair
            for coordinate in self.members
            if coordinate.pair is not None
            and kind_of(coordinate.name) in ANGULAR
            and not coordinate.jacobian_row.keys().isdisjoint(moving)
        }
        yield from ((where, cosine_of(pair, self.at.functions)) for where, pair in turned.items())
