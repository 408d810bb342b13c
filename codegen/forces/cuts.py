"""Forces in the six coordinates of cut joints, and of elastic couplings.

Frame b on a loop's second link, seen from frame a on its first, is T(x, y, z) . Rx(alpha) . Ry(beta) . Rz(gamma),
eq. (3).  A coordinate e with a force keeps to its offset: s = e - offset is resisted like the deviation of any joint's
coordinate, along the row de/dq.  With R the rotation of b as seen from a,

    beta = atan2(R02, c),    alpha = atan2(-R12, R22),    gamma = atan2(-R01, R00),    c = cos(beta) = |(R12, R22)|,

and the rates of the angles are the relative angular velocity along the dual vectors of their axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from eomgen.errors import DescriptionError
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR

from ..tree.bound import Bound, BoundLaw
from ..tree.constraints import Closure, Direction
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, Vec, add, along, dot, is_zero, scale
from .laws import Effect, effect, load_of, pressing
from .scalar_functions import Functions

POLE = 1e-7  # cosine of beta, below which alpha and gamma turn about one axis


@dataclass(frozen=True)
class Deviating:
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
    carriers: tuple[Deviating, ...] = ()
    name: str = ""
    turn: tuple[Scalar, Scalar] | None = None

    @property
    def has_force(self) -> bool:
        """Whether it has a law; one that a journal feels may have none."""
        return bool(self.law.law) or not (is_zero(self.law.stiffness) and is_zero(self.law.damping))

    def rate(self, v: Sequence[Scalar]) -> Scalar:
        """ds/dt."""
        return along(self.arms, v)

    def resists(self, v: Sequence[Scalar], f: Functions, dt: Scalar = 0.0) -> Effect:
        """The force that resists the deviation to which the rates v lead after dt, its slopes and energy."""
        s, rate = self._after(v, dt)
        k, c = self.law.stiffness, self.law.damping
        linear = Effect(k * s + c * rate, k, c, 0.5 * k * s * s)
        load = load_of([other.presses(v, f, dt) for other in self.carriers], f)[0] if self.carriers else 0.0
        return linear + effect(self.law.law, self.law.knots, s, rate, f, load)

    def moved_by(self) -> list[int]:
        """Indices of the coordinates on which its force depends, its own arms' first."""
        return list(dict.fromkeys(i for one in (self, *self.carriers) for i in one.arms))

    def presses(self, v: Sequence[Scalar], f: Functions, dt: Scalar) -> Effect:
        """Effect of its springs, contacts and dampers alone, arguments as of ``resists``."""
        s, rate = self._after(v, dt)
        return pressing(self.law.stiffness, self.law.damping, self.law.law, self.law.knots, s, rate, f)

    def wrenches(self, force: Scalar) -> Iterator[tuple[int, Wrench]]:
        """Wrenches of the tree's joints that hold the resisting force, as of ``Closure.wrenches``."""
        if self.closure is not None and self.direction is not None:
            wrench = self.direction.wrench(-1.0 * force)
            yield from self.closure.wrenches(wrench.force, wrench.moment)

    def _after(self, v: Sequence[Scalar], dt: Scalar) -> tuple[Scalar, Scalar]:
        rate = self.rate(v)
        return self.s if is_zero(dt) else self.s + dt * rate, rate


def deviating(bound: Bound, closures: Sequence[Closure], q: Sequence[Scalar], f: Functions) -> list[Deviating]:
    """All coordinates of cut joints with a force, then elastic couplings, in the order of ``Model.cut_laws``."""
    found: list[Deviating] = []
    for closure in closures:
        names = [name for name in COORDINATES if (closure.number, name) in bound.cut_laws]
        if names:
            found += _of_loop(bound, closure, names, f)
    for coupling in bound.couplings:
        if coupling.law is not None:
            found.append(Deviating(coupling.gap(q), dict(coupling.arms), coupling.law))
    return found


def _of_loop(bound: Bound, closure: Closure, names: Sequence[str], f: Functions) -> Iterator[Deviating]:
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
    found: dict[str, Deviating] = {}
    for name, value, direction, arms in zip(names, values, directions, closure.arms(directions), strict=True):
        law = bound.cut_laws[closure.number, name]
        moved = {index: arm for index, arm in arms.items() if not is_zero(arm)}
        s = value - offset[COORDINATES.index(name)]
        found[name] = Deviating(s, moved, law, closure, direction, name=name, turn=turns.get(name))
    for name, own in found.items():
        others = bound.cut_carriers.get((closure.number, name), ())
        yield replace(own, carriers=tuple(found[other] for other in others))


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
