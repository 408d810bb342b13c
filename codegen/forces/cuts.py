"""Forces in the six coordinates of cut joints, and of elastic couplings.

A coordinate e of a cut joint's frame b as seen from a (``relative_placement``) with a force keeps to its offset:
s = e - offset is resisted like the deviation of any joint's coordinate, along the row de/dq.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

from eomgen.names import parameter_name
from eomgen.robot.laws import stiffness_of
from eomgen.robot.value import ANGULAR, COORDINATES

from ..tree.bound import Bound, BoundLaw
from ..tree.constraints import Closure, Direction
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, along, is_zero
from .element import ForceElement, ImplicitShare, Kernels, Slopes
from .laws import Effect, effect, load_of, pressing
from .relative_placement import coordinates_of, cosine_of
from .scalar_functions import Functions


@dataclass(frozen=True)
class ElasticLoopCoordinate:
    """A coordinate with a force outside of the tree's own: s, ds/dq by the index of the coordinate, and the law.

    closure: of a cut joint's coordinate, with its direction there and its name; None of a coupling's.
    turn: sine and cosine of an angle, offset included.
    carriers: coordinates of the same cut joint that press on it, where its friction depends on that.
    """

    s: Scalar
    arms: dict[int, Scalar]
    law: BoundLaw
    closure: Closure | None = None
    direction: Direction | None = None
    carriers: tuple[ElasticLoopCoordinate, ...] = ()
    name: str = ""
    turn: tuple[Scalar, Scalar] | None = None

    @property
    def has_force(self) -> bool:
        """Whether it has a law; one that a journal feels may have none."""
        return bool(self.law.numbers) or not (is_zero(self.law.stiffness) and is_zero(self.law.damping))

    def rate(self, v: Sequence[Scalar]) -> Scalar:
        """ds/dt."""
        return along(self.arms, v)

    def resists(self, v: Sequence[Scalar], f: Functions, dt: Scalar = 0.0) -> Effect:
        """The force that resists the deviation to which the rates v lead after dt, its slopes and energy."""
        s, rate = self._after(v, dt)
        k, c = self.law.stiffness, self.law.damping
        linear = Effect(k * s + c * rate, k, c, 0.5 * k * s * s)
        load = load_of([other.presses(v, f, dt) for other in self.carriers], f)[0] if self.carriers else 0.0
        return linear + effect(self.law.numbers, self.law.knots, s, rate, f, load)

    def moved_by(self) -> list[int]:
        """Indices of the coordinates on which its force depends, its own arms' first."""
        return list(dict.fromkeys(i for one in (self, *self.carriers) for i in one.arms))

    def presses(self, v: Sequence[Scalar], f: Functions, dt: Scalar) -> Effect:
        """Effect of its springs, contacts and dampers alone, arguments as of ``resists``."""
        s, rate = self._after(v, dt)
        return pressing(self.law, s, rate, f)

    def wrenches(self, force: Scalar) -> Iterator[tuple[int, Wrench]]:
        """Wrenches of the tree's joints that hold the resisting force, as of ``Closure.wrenches``."""
        if self.closure is not None and self.direction is not None:
            wrench = self.direction.wrench(-1.0 * force)
            yield from self.closure.wrenches(wrench.force, wrench.moment)

    def _after(self, v: Sequence[Scalar], dt: Scalar) -> tuple[Scalar, Scalar]:
        rate = self.rate(v)
        return self.s if is_zero(dt) else self.s + dt * rate, rate


class ElasticLoopCoordinates(ForceElement):
    """All coordinates of cut joints with a force, then elastic couplings, in the order of ``Model.cut_laws``."""

    @cached_property
    def members(self) -> list[ElasticLoopCoordinate]:
        """The coordinates where q is."""
        at, found = self.at, list[ElasticLoopCoordinate]()
        if not (at.bound.cut_laws or at.bound.couplings):
            return found
        for closure in at.closures():
            names = [name for name in COORDINATES if (closure.number, name) in at.bound.cut_laws]
            if names:
                found += _of_loop(at.bound, closure, names, at.functions)
        for coupling in at.bound.couplings:
            if coupling.law is not None:
                found.append(ElasticLoopCoordinate(coupling.gap(at.q), dict(coupling.arms), coupling.law))
        return found

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the forces along ds/dq."""
        for own in self.members:
            force = own.resists(v, self.at.functions).force
            yield from ((i, force * arm) for i, arm in own.arms.items())

    def energies(self) -> Iterator[Scalar]:
        """Give energies of the deviations."""
        yield from (own.resists(self.at.still, self.at.functions).energy for own in self.members)

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints hold of the forces between a loop's links."""
        for own in self.members:
            yield from own.wrenches(own.resists(v, self.at.functions).force)

    def wrenches_in_cuts(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give the forces on the loops' second links."""
        for own in self.members:
            if own.closure is not None and own.direction is not None:
                force = own.resists(v, self.at.functions).force
                yield own.closure.number, own.direction.wrench(-1.0 * force)

    def add_slopes(self, slopes: Slopes) -> None:
        """Add derivatives, differentiating the graph."""
        for own in self.members:
            if own.has_force:
                force = own.resists(slopes.v, self.at.functions).force
                slopes.differentiate({i: force * arm for i, arm in own.arms.items()}, own.moved_by())

    def add_rows(self, share: ImplicitShare) -> None:
        """Add forces where the rates lead to, and their slopes."""
        for own in self.members:
            if own.has_force:
                share.along(own.arms, own.resists(share.v, self.at.functions, share.ahead))

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give those of the description's numbers."""
        model = self.at.model
        for own, (owner, name, given) in zip(self.members, model.cut_laws, strict=True):
            path = ("loops", owner, name) if name else ("couplings", owner)
            numbers = {key: model.parameters.get(parameter_name(*path, key), 0.0) for key in ("stiffness", "damping")}
            knots = tuple(deviation for deviation, _ in given.curve or ())
            k = stiffness_of({**numbers, **given.law()}, knots)
            yield from ((i, k * (arm * arm)) for i, arm in own.arms.items())

    def poles(self, moving: Collection[int]) -> Iterator[tuple[str, Scalar]]:
        """Give cos(beta) of loops whose angles have forces, and are moved by these coordinates."""
        moved = [own for own in self.members if own.name in ANGULAR and not own.arms.keys().isdisjoint(moving)]
        turned = {own.closure.number: own.closure for own in moved if own.closure is not None}
        yield from ((closure.where, cosine_of(closure, self.at.functions)) for closure in turned.values())

    KERNELS: ClassVar[Kernels] = {
        "cut_forces": (
            "values",
            lambda self, v: [x for own in self.members for x in (own.s, own.resists(v, self.at.functions).force)],
        ),
        "cut_jacobian": ("rows", lambda self, v: [own.arms for own in self.members]),
    }


def _of_loop(bound: Bound, closure: Closure, names: Sequence[str], f: Functions) -> Iterator[ElasticLoopCoordinate]:
    offset = bound.cut_offsets[closure.number]
    found: dict[str, ElasticLoopCoordinate] = {}
    for name, (value, direction, turn, arms) in coordinates_of(closure, names, f).items():
        law = bound.cut_laws[closure.number, name]
        s = value - offset[COORDINATES.index(name)]
        found[name] = ElasticLoopCoordinate(s, arms, law, closure, direction, name=name, turn=turn)
    for own in found.values():
        yield replace(own, carriers=tuple(found[COORDINATES[other]] for other in own.law.carriers))
