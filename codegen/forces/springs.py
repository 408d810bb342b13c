"""Point-to-point springs: rows, derivatives and wrenches of forces along a line, in closed form.

d is the vector from a spring's first point to its second, in the axes of the last body that carries both: what moves
that body moves both points alike and does not appear.  With s = d.d / 2, g = ds/dq, w = g.v and the length
L = sqrt(2 s + REST^2) the tension T(L - free length, w / L) pulls with the force (T / L) d, so that

    r_i = p g_i,    p = T / L,    dr_i/dq_j = p H_ij + g_i (dp/ds g_j + dp/dw (H v)_j),    dr_i/dv_j = dp/dw g_i g_j

with H = d2s/dq2.  A coordinate with the axis e through o that carries the point x of a spring moves it by near =
e x (x - o), and far = e x (y - o) is what it would do to the other point y; for a translation both are e.  Then
g_j = +-d . near_j; on one side H_ij = far_i . near_j with i in front of j, across it is -near_i . near_j.

REST, far below any length that matters, keeps T / L finite where the points meet.  A spring of free length 0 without
a curve has p = stiffness: no length is computed, and nothing is divided by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from eomgen.robot.elements import Spring
from eomgen.robot.numbers import SMALLEST

from ..tree.bound import BoundElement
from ..tree.composite import Rows
from ..tree.constraints import Side, common_body
from ..tree.recursion import Wrench
from ..tree.spatial import Scalar, Vec, add, along, cross, dot, is_zero, matvec, scale, subtract, transpose
from .element import ForceElement, ImplicitShare, Setting, Slopes, add_to
from .laws import Effect, steepest, tension

REST = SMALLEST  # m


@dataclass(frozen=True)
class Arm:
    """A coordinate that moves one of the points: ``sign`` -1 for the first, 1 for the second; ``slope`` is its g."""

    index: int
    sign: float
    near: Vec
    far: Vec
    slope: Scalar


@dataclass(frozen=True)
class Pull:
    """p = T / L (N/m), its slopes by s and w, and the stored energy (J)."""

    ratio: Scalar
    by_s: Scalar
    by_w: Scalar
    energy: Scalar


class PointSpring:
    """One spring: its vector d, and g and H as above."""

    def __init__(self, at: Setting, spring: BoundElement, v: Sequence[Scalar]) -> None:
        self.spring, self.v, self.f = spring, v, at.functions
        top = common_body(at.model, spring.ends[0][0], spring.ends[1][0])
        first, second = (Side(at, top, end) for end in spring.ends)
        self.sides = ((first, -1.0), (second, 1.0))
        points = first.pose.origin, second.pose.origin
        self.d = subtract(points[1], points[0])
        self.arms = [*_arms(first, -1.0, *points), *_arms(second, 1.0, *points[::-1])]
        self.g = {arm.index: arm.slope for arm in self.arms}
        self.square = dot(self.d, self.d)

    def rate(self) -> Scalar:
        """Return w = d . d_dot."""
        return along(self.g, self.v)

    def length(self) -> Scalar:
        """Return L."""
        return self.f.sqrt(self.square + REST * REST)

    def pull(self) -> Pull:
        """Return p at the elongation and its rate."""
        numbers, linear = self.spring.numbers, not self.spring.knots and "smoothing" not in self.spring.numbers
        if linear and is_zero(numbers["free_length"]):
            k, c = numbers["stiffness"], numbers["damping"]
            energy = 0.5 * (k * self.square)
            if is_zero(c):
                return Pull(k, 0.0, 0.0, energy)
            inverse = 1.0 / (self.square + REST * REST)
            drag = c * inverse
            along = drag * self.rate()
            return Pull(k + along, -2.0 * (along * inverse), drag, energy)
        inverse = 1.0 / self.length()
        rate = self.rate() * inverse
        T = tension(numbers, self.spring.knots, self.length() - numbers["free_length"], rate, self.f)
        square = inverse * inverse
        by_s = square * (T.by_s - inverse * (T.force + T.by_v * rate))
        return Pull(T.force * inverse, by_s, T.by_v * square, T.energy)

    def forces(self) -> tuple[Scalar, Scalar]:
        """Return length (m) and tension (N)."""
        L = self.length()
        e = L - self.spring.numbers["free_length"]
        return L, tension(self.spring.numbers, self.spring.knots, e, self.rate() / L, self.f).force

    def ahead(self, dt: Scalar) -> tuple[dict[int, Scalar], Effect]:
        """Return dL/dq, and T with its slopes at the elongation that the rate leads to after dt."""
        L, f = self.length(), self.f
        inverse = 1.0 / L
        rate = self.rate() * inverse
        e = L - self.spring.numbers["free_length"] + dt * rate
        T = tension(self.spring.numbers, self.spring.knots, e, rate, f)
        return {index: value * inverse for index, value in self.g.items()}, T

    def hessian(self) -> Rows:
        """Return H."""
        H: Rows = {}
        for place, one in enumerate(self.arms):
            for other in self.arms[place:]:
                same = one.sign == other.sign
                value = dot(one.far, other.near) if same else -dot(one.near, other.near)
                H[one.index, other.index] = H[other.index, one.index] = value
        return H

    def add_slopes(self, slopes: Slopes) -> None:
        """Add the spring's share of dr/dq and dr/dv."""
        pull, H, g, v = self.pull(), self.hessian(), self.g, slopes.v
        turned: dict[int, Scalar] = dict.fromkeys(g, 0.0)  # H v
        for (i, j), value in H.items():
            turned[i] = turned[i] + value * v[j]
        for j in g:
            slope = pull.by_s * g[j] + pull.by_w * turned[j]
            for i in g:
                add_to(slopes.by_q, (i, j), pull.ratio * H[i, j] + g[i] * slope)
                add_to(slopes.by_v, (i, j), pull.by_w * (g[i] * g[j]))

    def stiffness(self) -> Rows:
        """Return stiffness (dd/dq)^T dd/dq: of a curve its steepest piece's, of a cable as if it were taut."""
        numbers, knots = self.spring.numbers, self.spring.knots
        k = steepest(knots, [numbers[f"curve.{i}"] for i in range(len(knots))], self.f) if knots else 0.0
        k = k + numbers["stiffness"]
        return {
            (one.index, other.index): k * (one.sign * other.sign * dot(one.near, other.near))
            for one in self.arms
            for other in self.arms
        }

    def wrenches(self) -> Iterator[tuple[int, Wrench]]:
        """Yield wrenches of joints on the bodies between both points for p, each at its body's origin in its axes."""
        force = scale(self.pull().ratio, self.d)
        for side, sign in self.sides:
            held = scale(sign, force)
            for k, pose in zip(side.path, side.poses, strict=True):
                back = transpose(pose.rotation)
                arm = subtract(side.pose.origin, pose.origin)
                yield k, Wrench(matvec(back, held), matvec(back, cross(arm, held)))


def _arms(side: Side, sign: float, point: Vec, other: Vec) -> Iterator[Arm]:
    """Yield moment arms from the common body to the point; rotations read g off the moment of d, shared in a joint."""
    pull = subtract(other, point)  # sign d is -pull
    for column in side.columns(point):
        e, arm = column.axis, column.arm
        if column.is_rotation:
            slope = dot(e, cross(pull, arm))
            yield Arm(column.index, sign, cross(e, arm), cross(e, add(arm, pull)), slope)
        else:
            yield Arm(column.index, sign, e, e, -dot(e, pull))


class PointSprings(ForceElement):
    """All springs, dampers and cables between points of two links."""

    FAMILY: ClassVar[str] = Spring.TABLE

    def lengths_and_tensions(self, v: Sequence[Scalar]) -> list[Scalar]:
        """Give the length (m) and the tension (N) of every spring."""
        return [x for spring in self.springs(v) for x in spring.forces()]

    def length_rows(self) -> list[dict[int, Scalar]]:
        """Give derivatives of the lengths by the coordinates."""
        springs = [(1.0 / spring.length(), spring.g) for spring in self.springs(self.at.still)]
        return [{i: x * inverse for i, x in g.items()} for inverse, g in springs]

    def stiffness(self) -> Rows:
        """Give what the springs stiffen at most, the sum of k (dd/dq)^T dd/dq."""
        total: Rows = {}
        for spring in self.springs(self.at.still):
            for place, value in spring.stiffness().items():
                add_to(total, place, value)
        return total

    def springs(self, v: Sequence[Scalar]) -> list[PointSpring]:
        """Give the springs at the velocities v, each with a comment in front of its values."""
        at, springs = self.at, list[PointSpring]()
        for spring in at.bound.elements[self.FAMILY]:
            at.note(f"{spring.name}: between {spring.links[0]} and {spring.links[1]}")
            springs.append(PointSpring(at, spring, v))
        return springs

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give p g."""
        for spring in self.springs(v):
            ratio = spring.pull().ratio
            yield from ((i, ratio * value) for i, value in spring.g.items())

    def energies(self) -> Iterator[Scalar]:
        """Give the springs' energies."""
        yield from (spring.pull().energy for spring in self.springs(self.at.still))

    def wrenches(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Wrench]]:
        """Give what joints between both points hold: the forces pass them by."""
        for spring in self.springs(v):
            yield from spring.wrenches()

    def add_slopes(self, slopes: Slopes) -> None:
        """Add dr/dq and dr/dv."""
        for spring in self.springs(slopes.v):
            spring.add_slopes(slopes)

    def advance(self, share: ImplicitShare) -> None:
        """Push the tensions where their rates lead to, in the directions that the springs have."""
        for row, T in [spring.ahead(share.ahead) for spring in share.made(self, self.springs)]:
            for i, arm in row.items():
                share.push(i, T.force * arm)

    def add_rows(self, share: ImplicitShare) -> None:
        """Add the tensions' slopes."""
        for spring in share.made(self, self.springs):
            row, T = spring.ahead(share.ahead)
            share.along(row, Effect(by_s=T.by_s, by_v=T.by_v))

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give the diagonal of what the springs stiffen at most."""
        for spring in self.springs(self.at.still):
            yield from ((i, value) for (i, j), value in spring.stiffness().items() if i == j)
