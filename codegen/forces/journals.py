"""Journals in round bearings: rows, derivatives and energy of the contacts, in closed form.

A point of the journal's axis, c = (X, Y) off the bearing's, touches where e = |c| is beyond the clearance.  With
n = c / e, t = n turned by a quarter, and the rates c_dot, the normal force N is that of the end of a clearance at the
deviation e and its rate e_dot = n . c_dot (``laws.contact``); the friction T = coefficient N v_t / sqrt(v_t^2 +
smoothing^2) resists the sliding v_t = t . c_dot + radius gamma_dot.  The coordinates feel

    r_i = N a_i + T s_i,    a_i = n . dc/dq_i,    b_i = t . dc/dq_i,    s_i = dv_t/dv_i.

In front of and behind the middle of a bearing with a length, at h = +-length / 2 on the journal's axis, eq. (3) has
X = x + h sin(beta), Y = y - h sin(alpha) cos(beta).  Offsets of coordinates are not felt, as springs do not feel them.

REST, far below any clearance that matters, keeps n finite where both axes meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from eomgen.robot.elements.journal import CROSSWISE, TILTING, TURNING
from eomgen.robot.numbers import SMALLEST
from eomgen.robot.parameter_names import BEARINGS

from ..tree.bound import BoundJointElement
from ..tree.composite import Rows
from ..tree.spatial import Scalar
from .element import ForceElement, ImplicitShare, Slopes, add_to
from .laws import Effect, contact
from .scalar_functions import Functions

REST = SMALLEST  # m
Pair = tuple[Scalar, Scalar]
SparseRow = dict[int, Scalar]


@dataclass(frozen=True)
class Place:
    """c of a point of the journal's axis (m), with its first and second derivatives by the coordinates' indices."""

    at: Pair
    first: Mapping[int, Pair]
    second: Mapping[tuple[int, int], Pair]

    def rate(self, v: Sequence[Scalar]) -> Pair:
        """Return c_dot."""
        return _moved(self.first, v)

    def bent(self, j: int, v: Sequence[Scalar]) -> Pair:
        """Return the derivative of c_dot by the coordinate j."""
        return _moved({k: arm for (one, k), arm in self.second.items() if one == j}, v)


def _moved(slopes: Mapping[int, Pair], v: Sequence[Scalar]) -> Pair:
    x: Scalar = 0.0
    y: Scalar = 0.0
    for i, (by_x, by_y) in slopes.items():
        x, y = x + by_x * v[i], y + by_y * v[i]
    return x, y


class BearingContact:
    """A contact at the rates v."""

    def __init__(self, journal: BoundJointElement, place: Place, v: Sequence[Scalar], f: Functions) -> None:
        self.journal, self.place, self.v, self.f = journal, place, v, f
        x, y = place.at
        e = f.sqrt(x * x + y * y + REST * REST)
        self.inverse = 1.0 / e
        self.n: Pair = (x * self.inverse, y * self.inverse)
        self.t: Pair = (-1.0 * self.n[1], self.n[0])
        self.rate = place.rate(v)
        numbers = journal.numbers
        self.normal: Effect = contact(numbers, numbers["stiffness"], e, dot(self.n, self.rate), f)
        radius = numbers.get("friction.radius")
        self.spin: SparseRow = {} if radius is None else {journal.index[TURNING]: radius}
        self._slide()

    def ahead(self, dt: Scalar) -> BearingContact:
        """Return the contact where the rates lead to after dt, with the derivatives that c has here."""
        at = (self.place.at[0] + dt * self.rate[0], self.place.at[1] + dt * self.rate[1])
        return BearingContact(self.journal, replace(self.place, at=at), self.v, self.f)

    def _slide(self) -> None:
        """Return T, its slopes by N and v_t, and its secant T / v_t."""
        numbers = self.journal.numbers
        if "friction.coefficient" not in numbers:
            self.friction = self.by_load = self.by_slide = self.secant = 0.0
            return
        slide = dot(self.t, self.rate)
        for i, arm in self.spin.items():
            slide = slide + arm * self.v[i]
        smoothing = numbers["friction.smoothing"]
        square = smoothing * smoothing
        inverse = 1.0 / self.f.sqrt(slide * slide + square)
        self.by_load = numbers["friction.coefficient"] * (slide * inverse)
        self.friction = self.normal.force * self.by_load
        self.secant = numbers["friction.coefficient"] * (self.normal.force * inverse)
        self.by_slide = self.secant * (square * (inverse * inverse))

    def rows(self) -> SparseRow:
        """Return r_i."""
        N, T = self.normal.force, self.friction
        push = (N * self.n[0] + T * self.t[0], N * self.n[1] + T * self.t[1])
        rows = {i: dot(push, arm) for i, arm in self.place.first.items()}
        return rows | {i: T * arm for i, arm in self.spin.items()}

    def approach(self) -> SparseRow:
        """Return a_i."""
        return {i: dot(self.n, arm) for i, arm in self.place.first.items()}

    def around(self) -> SparseRow:
        """Return b_i."""
        return {i: dot(self.t, arm) for i, arm in self.place.first.items()}

    def slopes(self, dt: Scalar, square: Scalar) -> Rows:
        """Add up the slopes in a linearly implicit step, a matrix over the joint's coordinates, never negative."""
        slopes: Rows = {}
        for row, slope in self.directions(dt, square):
            scaled = {i: slope * arm for i, arm in row.items()}
            for i, one in scaled.items():
                for j, other in row.items():
                    if i <= j:
                        add_to(slopes, (i, j), one * other)
        return slopes

    def directions(self, dt: Scalar, square: Scalar) -> list[tuple[SparseRow, Scalar]]:
        """Return directions of the joint's coordinates with slopes, and these, which are never negative.

        Along n the tangent of N; across, where N turns with the journal, N / e; of friction the secant, without the
        slope by its load, which is not symmetric.
        """
        toward = self.f.max(dt * self.normal.by_v + square * self.normal.by_s, 0.0)
        turning = square * (self.normal.force * self.inverse)
        around, rubbing = self.around(), dt * self.secant
        parts = [(self.approach(), toward), (around, turning if self.spin else turning + rubbing)]
        if self.spin:
            parts.append((around | self.spin, rubbing))
        return parts

    def add_slopes(self, slopes: Slopes) -> None:
        """Add the contact's share of dr/dq and dr/dv."""
        N, T = self.normal.force, self.friction
        a, b = self.approach(), self.around()
        s, v = b | self.spin, self.v
        for j in s:
            load = self.normal.by_v * a.get(j, 0.0)
            slide = self.by_load * load + self.by_slide * s[j]
            for i in s:
                add_to(slopes.by_v, (i, j), load * a.get(i, 0.0) + slide * s[i])
        near, across = dot(self.n, self.rate), dot(self.t, self.rate)
        for j in self.place.first:
            bent, turn = self.place.bent(j, v), self.inverse * b[j]
            load = self.normal.by_s * a[j] + self.normal.by_v * (across * turn + dot(self.n, bent))
            slide = self.by_load * load + self.by_slide * (dot(self.t, bent) - near * turn)
            for i in s:
                x = self.place.second.get((i, j), (0.0, 0.0))
                closer = b.get(i, 0.0) * turn + dot(self.n, x)
                past = dot(self.t, x) - a.get(i, 0.0) * turn
                add_to(slopes.by_q, (i, j), load * a.get(i, 0.0) + slide * s[i] + N * closer + T * past)


class BearingContacts(ForceElement):
    """The contacts of all journals of joints in their bearings."""

    FAMILY: ClassVar[str] = BEARINGS

    def contacts(self, v: Sequence[Scalar]) -> list[BearingContact]:
        """Give the contacts at the velocities v, each journal with a comment in front of its values."""
        at, contacts = self.at, list[BearingContact]()
        for journal in at.bound.journals:
            at.note(f"{journal.joint}: its journal in the bearing")
            contacts += (BearingContact(journal, place, v, at.functions) for place in places(journal, at.q, self._turn))
        return contacts

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give the contacts' forces."""
        for one in self.contacts(v):
            yield from one.rows().items()

    def energies(self) -> Iterator[Scalar]:
        """Give energies of the penetrations."""
        yield from (one.normal.energy for one in self.contacts(self.at.still))

    def add_slopes(self, slopes: Slopes) -> None:
        """Add dr/dq and dr/dv."""
        for one in self.contacts(slopes.v):
            one.add_slopes(slopes)

    def advance(self, share: ImplicitShare) -> None:
        """Push the forces where the velocities lead to."""
        for one in [one.ahead(share.ahead) for one in share.made(self, self.contacts)]:
            for i, force in one.rows().items():
                share.push(i, force)

    def add_blocks(self, share: ImplicitShare) -> None:
        """Add the contacts' slopes."""
        for one in share.made(self, self.contacts):
            share.in_joint(one.ahead(share.ahead).slopes)

    def stiffnesses(self) -> Iterator[tuple[int, Scalar]]:
        """Give the stiffness of all contacts as if they touched along x and along y."""
        for one in self.contacts(self.at.still):
            for i, (x, y) in one.place.first.items():
                yield i, one.journal.numbers["stiffness"] * (x * x + y * y)

    def _turn(self, i: int) -> tuple[Scalar, Scalar]:
        return self.at.sincos(self.at.q[i])


def dot(one: Pair, other: Pair) -> Scalar:
    """Return the scalar product."""
    return one[0] * other[0] + one[1] * other[1]


def places(
    journal: BoundJointElement, q: Sequence[Scalar], sincos: Callable[[int], tuple[Scalar, Scalar]]
) -> Iterator[Place]:
    """Return the points that may touch: the middle, or both ends, that towards positive z first.

    Args:
        q: coordinates that the indices of the journal are of.
        sincos: sine and cosine of one of them, by its index.
    """
    x, y = (journal.index[name] for name in CROSSWISE)
    first: dict[int, Pair] = {x: (1.0, 0.0), y: (0.0, 1.0)}
    if "length" not in journal.numbers:
        yield Place((q[x], q[y]), first, {})
        return
    alpha, beta = (journal.index[name] for name in TILTING)
    (sa, ca), (sb, cb) = sincos(alpha), sincos(beta)
    for sign in (1.0, -1.0):
        h = sign * (0.5 * journal.numbers["length"])
        along_x, along_y = h * sb, -1.0 * (h * sa)
        down, tilted = along_y * cb, -1.0 * (h * ca)
        crossed = -1.0 * (tilted * sb)
        yield Place(
            (q[x] + along_x, q[y] + down),
            {**first, alpha: (0.0, tilted * cb), beta: (h * cb, -1.0 * (along_y * sb))},
            {
                (alpha, alpha): (0.0, -1.0 * down),
                (alpha, beta): (0.0, crossed),
                (beta, alpha): (0.0, crossed),
                (beta, beta): (-1.0 * along_x, -1.0 * down),
            },
        )
