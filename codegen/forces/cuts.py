"""Forces in the six coordinates of cut joints, and of elastic couplings.

Frame b on a loop's second link, seen from frame a on its first, is T(x, y, z) . Rx(alpha) . Ry(beta) . Rz(gamma),
eq. (3).  A coordinate e with a force keeps to its offset: s = e - offset is resisted like the deviation of any joint's
coordinate, along the row de/dq.  With R the rotation of b as seen from a,

    beta = atan2(R02, c),    alpha = atan2(-R12, R22),    gamma = atan2(-R01, R00),    c = cos(beta) = |(R12, R22)|,

and the rates of the angles are the relative angular velocity along the dual vectors of their axes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

from eomgen.errors import DescriptionError
from eomgen.names import parameter_name
from eomgen.robot.laws import stiffness_of
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR

from ..tree.bound import Bound, BoundLaw
from ..tree.constraints import Closure, Direction
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, Vec, add, along, dot, is_zero, scale
from .element import POLE, ForceElement, ImplicitShare, Kernels, Slopes
from .laws import Effect, effect, load_of, pressing
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
        yield from ((closure.name, cosine_of(closure, self.at.functions)) for closure in turned.values())

    KERNELS: ClassVar[Kernels] = {
        "cut_forces": (
            "values",
            lambda self, v: [x for own in self.members for x in (own.s, own.resists(v, self.at.functions).force)],
        ),
        "cut_jacobian": ("rows", lambda self, v: [own.arms for own in self.members]),
    }


def _of_loop(bound: Bound, closure: Closure, names: Sequence[str], f: Functions) -> Iterator[ElasticLoopCoordinate]:
    offset = bound.cut_offsets[closure.number]
    values, directions, turns = [], [], dict[str, tuple[Scalar, Scalar] | None]()
    angles = _angles(closure, f) if any(name in ANGULAR for name in names) else {}
    for name in names:
        if name in LINEAR:
            axis = closure.axes_a[LINEAR.index(name)]
            values.append(dot(axis, closure.distance))
            directions.append(Direction(axis, is_rotation=False))
        else:
            value, vector, turns[name] = angles[name]
            values.append(value)
            directions.append(Direction(vector, is_rotation=True))
    found: dict[str, ElasticLoopCoordinate] = {}
    for name, value, direction, arms in zip(names, values, directions, closure.arms(directions), strict=True):
        law = bound.cut_laws[closure.number, name]
        moved = {index: arm for index, arm in arms.items() if not is_zero(arm)}
        s = value - offset[COORDINATES.index(name)]
        found[name] = ElasticLoopCoordinate(s, moved, law, closure, direction, name=name, turn=turns.get(name))
    for own in found.values():
        yield replace(own, carriers=tuple(found[COORDINATES[other]] for other in own.law.carriers))


def cosine_of(closure: Closure, f: Functions) -> Scalar:
    """The cosine of beta, from 0 on, of the second frame as seen from the first."""
    R = closure.pose().rotation
    return f.sqrt(R[1][2] * R[1][2] + R[2][2] * R[2][2])


def _angles(closure: Closure, f: Functions) -> dict[str, tuple[Scalar, Vec, tuple[Scalar, Scalar] | None]]:
    """alpha, beta and gamma of b as seen from a, and the dual vectors of their axes, in the common body's axes.

    Of alpha and beta with sine and cosine.

    Raises:
        DescriptionError: nothing turns the frames against each other, and beta is at +-pi/2.
    """
    x, y, z = closure.axes_a
    R = closure.pose().rotation
    cosine = cosine_of(closure, f)
    if isinstance(cosine, float) and cosine < POLE:
        raise DescriptionError(
            f"its frames stay at beta = {'-' if R[0][2] < 0.0 else ''}90 degrees to each other, where alpha and gamma"
            " turn about one axis; allowed: placements whose frames are turned otherwise, or no tables of alpha, beta"
            " and gamma",
            where=f"loops.{closure.name}",
            source=closure.source,
        )
    inverse = 1.0 / cosine
    sin_alpha, cos_alpha, sin_beta = -1.0 * (R[1][2] * inverse), R[2][2] * inverse, R[0][2]
    behind_y = add(scale(cos_alpha, y), scale(sin_alpha, z))
    behind_z = scale(inverse, add(scale(-1.0 * sin_alpha, y), scale(cos_alpha, z)))
    return {
        "alpha": (f.atan2(-1.0 * R[1][2], R[2][2]), add(x, scale(-1.0 * sin_beta, behind_z)), (sin_alpha, cos_alpha)),
        "beta": (f.atan2(sin_beta, cosine), behind_y, (sin_beta, cosine)),
        "gamma": (f.atan2(-1.0 * R[0][1], R[0][0]), behind_z, None),
    }
