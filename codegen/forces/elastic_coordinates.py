"""Coordinates beside those of the tree that have a force: it acts along the rows of their derivatives by q.

They are coordinates of one frame as seen from another (``relative_placement``), of cut joints and bushings, or what
couplings are off.  A deviation s with the row J = ds/dq is resisted like that of any joint's coordinate, with J^T r.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from eomgen.names import kind_of
from eomgen.robot.geometry import ANGULAR

from ..tree.bound import BoundLaw
from ..tree.composite import Rows
from ..tree.constraints import Direction, FramePair
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, add_row, along, is_zero
from .element import ForceElement, ImplicitShare, Slopes, SparseRow, StateSite
from .internal_states.formula import StateEffect
from .internal_states.formulas import StateLaw
from .joint_stiffness import CoordinateMatrix, StiffnessMatrix, combined
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
    state_laws: its laws with internal states.
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
    state_laws: tuple[StateLaw, ...] = ()

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
        return linear + effect(self.law, s, rate, f, load)

    def state_effects(
        self, v: Sequence[Scalar], f: Functions, dt: Scalar = 0.0
    ) -> Iterator[tuple[StateLaw, StateEffect]]:
        """Yield its laws with internal states and what they do, arguments as of ``resists``."""
        for law in self.state_laws:
            yield law, law.effect(*self._after(v, dt), v, f)

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


def moved_by(coordinates: Iterable[ElasticCoordinate]) -> list[int]:
    """Return the indices of the tree's coordinates that move some of these, each once."""
    return list(dict.fromkeys(i for one in coordinates for i in one.jacobian_row))


@dataclass(frozen=True)
class CoupledCoordinates:
    """Coordinates of one frame as seen from another that matrices couple: K (s + tau s') + D s' + p resists them.

    members: the coordinates, by whose places here the matrices go.
    """

    members: Sequence[ElasticCoordinate]
    spring: StiffnessMatrix
    damping: CoordinateMatrix

    @classmethod
    def of(
        cls,
        members: Mapping[str, ElasticCoordinate],
        stiffness: Mapping[str, Scalar],
        damping: Mapping[str, Scalar],
    ) -> CoupledCoordinates:
        """Make them of coordinates by their names, and of the numbers of both matrices."""
        index = {name: place for place, name in enumerate(members)}
        spring = StiffnessMatrix.of(stiffness, damping, index)
        return cls(tuple(members.values()), spring, CoordinateMatrix.of(damping, index))

    def forces(self, v: Sequence[Scalar], dt: Scalar = 0.0) -> Iterator[tuple[ElasticCoordinate, Scalar]]:
        """Yield coordinates with the forces against the deviations to which the rates v lead after dt."""
        rates = [coordinate.rate(v) for coordinate in self.members]
        here = [coordinate.s for coordinate in self.members]
        there = here if is_zero(dt) else [s + dt * rate for s, rate in zip(here, rates, strict=True)]
        spring, damper = self.spring.rows(there, rates), self.damping.times(rates)
        for place in sorted({*spring, *damper}):
            yield self.members[place], spring.get(place, 0.0) + damper.get(place, 0.0)

    def rows(self, v: Sequence[Scalar], dt: Scalar = 0.0) -> dict[int, Scalar]:
        """Return the same forces by coordinates of the tree."""
        rows: dict[int, Scalar] = {}
        for coordinate, force in self.forces(v, dt):
            add_row(rows, force, coordinate.jacobian_row)
        return rows

    def energy(self) -> Scalar:
        """Return what the springs store."""
        return self.spring.energy([coordinate.s for coordinate in self.members])

    def add_to(self, share: ImplicitShare, f: Functions, *, turns: bool = False) -> None:
        """Add forces where the velocities lead to, and c D + c^2 K with the coordinates' directions, which may turn.

        One matrix alone is written as rank-one rows that depend on numbers alone, once for all steps; the sum of both
        makes as many rows, which depend on c.
        """
        forces = self.rows(share.v, share.ahead)
        is_damped = self.damping.entries or (self.spring.matrix.entries and not is_zero(self.spring.lag))
        if (self.spring.matrix.entries and self.damping.entries) or (turns and share.counts_turning and is_damped):
            rows = [coordinate.jacobian_row for coordinate in self.members]
            share.among(forces, rows, self.slopes, turns=turns)
        else:
            share.along_all(forces, partial(self.directions, f))

    def slopes(self, c: Scalar, square: Scalar) -> Rows:
        """Return c D + square K by places of coordinates, on and above the diagonal."""
        slopes = self.spring.slopes(c, square)
        for pair, entry in self.damping.scaled(c).items():
            slopes[pair] = slopes.get(pair, 0.0) + entry
        return slopes

    def directions(self, f: Functions, c: Scalar, square: Scalar) -> list[tuple[SparseRow, Scalar]]:
        """Return rank-one rows with slopes, whose sum is c D + square K with the coordinates' directions.

        Those of each matrix depend on numbers alone, and on neither c nor square.
        """
        directions = [(row, (c * self.spring.lag + square) * d) for row, d in self.spring.matrix.directions(f)]
        directions += [(row, c * d) for row, d in self.damping.directions(f)]
        arms = [coordinate.jacobian_row for coordinate in self.members]
        return [(combined(row, arms), slope) for row, slope in directions]

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give what each coordinate of the tree feels of the springs by itself."""
        for i in moved_by(self.members):
            arms = [coordinate.jacobian_row.get(i, 0.0) for coordinate in self.members]
            felt: Scalar = 0.0
            for place, force in self.spring.matrix.times(arms).items():
                felt = felt + force * arms[place]
            yield i, felt


class ElasticCoordinates(ForceElement):
    """All such coordinates of one family.

    TURNS: whether their directions may turn far within a step of an implicit method.
    """

    TURNS: ClassVar[bool] = False

    @property
    @abstractmethod
    def members(self) -> Sequence[ElasticCoordinate]:
        """The coordinates where q is."""

    @property
    @abstractmethod
    def coupled(self) -> Sequence[CoupledCoordinates]:
        """Coordinates of them that matrices couple."""

    def forces(self, v: Sequence[Scalar]) -> Iterator[tuple[ElasticCoordinate, Scalar]]:
        """Give coordinates with resisting forces; one may have several."""
        for coordinate in self.members:
            yield coordinate, coordinate.resists(v, self.at.functions).force
            yield from ((coordinate, law.force) for _, law in coordinate.state_effects(v, self.at.functions))
        for coupled in self.coupled:
            yield from coupled.forces(v)

    def force_on(self, coordinate: ElasticCoordinate, v: Sequence[Scalar]) -> Scalar:
        """Return the whole force on one of the coordinates."""
        force = coordinate.resists(v, self.at.functions).force
        for _, law in coordinate.state_effects(v, self.at.functions):
            force = force + law.force
        for coupled in self.coupled:
            for other, more in coupled.forces(v):
                force = force + more if other is coordinate else force
        return force

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the forces along ds/dq."""
        for coordinate, force in self.forces(v):
            yield from ((i, force * arm) for i, arm in coordinate.jacobian_row.items())
        for coordinate in self.members:
            for at, law in coordinate.state_effects(v, self.at.functions):
                yield from law.state_rows(at.states)

    def energies(self) -> Iterator[Scalar]:
        """Give energies of the deviations."""
        still, f = self.at.still, self.at.functions
        yield from (coordinate.resists(still, f).energy for coordinate in self.members)
        yield from (law.energy for coordinate in self.members for _, law in coordinate.state_effects(still, f))
        yield from (coupled.energy() for coupled in self.coupled)

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints between both frames hold of the forces."""
        for coordinate, force in self.forces(v):
            yield from coordinate.wrenches(force)

    def add_slopes(self, slopes: Slopes) -> None:
        """Add derivatives, differentiating the graph."""
        for coordinate in self.members:
            if coordinate.has_force:
                force = coordinate.resists(slopes.v, self.at.functions).force
                slopes.differentiate(
                    {i: force * arm for i, arm in coordinate.jacobian_row.items()},
                    moved_by((coordinate, *coordinate.carriers)),
                )
            for at, law in coordinate.state_effects(slopes.v, self.at.functions):
                rows = {i: law.force * arm for i, arm in coordinate.jacobian_row.items()}
                slopes.differentiate(rows | dict(law.state_rows(at.states)), [*coordinate.jacobian_row, *at.states])
        for coupled in self.coupled:
            slopes.differentiate(coupled.rows(slopes.v), moved_by(coupled.members))

    def advance(self, share: ImplicitShare) -> None:
        """Push forces of laws with internal states, and what drives these."""
        for coordinate in self.members:
            for at, law in coordinate.state_effects(share.v, self.at.functions, share.ahead):
                for i, arm in coordinate.jacobian_row.items():
                    share.push(i, law.force * arm)
                for k, force in law.state_rows(at.states):
                    share.push(k, force)

    def add_rows(self, share: ImplicitShare) -> None:
        """Add forces where the rates lead to, and their slopes."""
        for coordinate in self.members:
            if coordinate.has_force:
                law = coordinate.resists(share.v, self.at.functions, share.ahead)
                share.along(coordinate.jacobian_row, law, turns=self.TURNS)
            for at, stateful in coordinate.state_effects(share.v, self.at.functions, share.ahead):
                share.in_internal_states(StateSite(coordinate.jacobian_row, at.states), stateful.slopes)
        for coupled in self.coupled:
            coupled.add_to(share, self.at.functions, turns=self.TURNS)

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give those of the description's numbers."""
        for coordinate in self.members:
            yield from ((i, coordinate.described * (arm * arm)) for i, arm in coordinate.jacobian_row.items())
        for coupled in self.coupled:
            yield from coupled.stiffnesses()

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
