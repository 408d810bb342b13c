"""Damping of joints' motions: rows and their derivatives.

The coordinates of eq. (3) move a joint's origin with (x', y', z') in the joint's axes, and turn its child with an
angular velocity w about the axes of alpha, beta and gamma.  These are unit vectors of which the second is normal to
both others, and the first and the third enclose the angle whose cosine is sin(beta); so

    |w|^2 = alpha'^2 + beta'^2 + gamma'^2 + 2 sin(beta) alpha' gamma' = v^T G v,

and a damping d of w, which takes the power d |w|^2 whatever the axes, resists the coordinates with r = d G v.  A
damping matrix D resists them with D v; what is proportional to a stiffness matrix acts with that (``joint_stiffness``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

from eomgen.robot.elements.joint_damping import MOVED
from eomgen.robot.parameter_names import MOTIONS

from ..tree.composite import Rows
from ..tree.spatial import Scalar
from .element import ForceRows, ImplicitShare, Slopes
from .joint_stiffness import CoordinateMatrix

FRONT, MIDDLE, BACK = MOVED["angular"]


@dataclass(frozen=True)
class Damper:
    """A joint's damping d of one kind: the indices of what it slows down.

    across: of alpha and gamma where both move, sin(beta), and the index of beta, -1 of one that does not move, with
    its cosine; None of others.
    """

    damping: Scalar
    indices: tuple[int, ...]
    across: tuple[int, int, Scalar, int, Scalar] | None = None

    def slopes(self, c: Scalar = 1.0, _square: Scalar = 0.0) -> Rows:
        """Give c d G on and above the diagonal, which is never negative: dr/dv, and what implicit steps take."""
        d = c * self.damping
        slopes: Rows = {(i, i): d for i in self.indices}
        if self.across is not None:
            alpha, gamma, sine, _, _ = self.across
            slopes[alpha, gamma] = d * sine
        return slopes

    def rows(self, v: Sequence[Scalar]) -> dict[int, Scalar]:
        """Return r_i."""
        rates = {i: v[i] for i in self.indices}
        if self.across is not None:
            alpha, gamma, sine, _, _ = self.across
            rates[alpha], rates[gamma] = v[alpha] + sine * v[gamma], v[gamma] + sine * v[alpha]
        return {i: self.damping * rate for i, rate in rates.items()}

    def add_slopes(self, slopes: Slopes) -> None:
        """Add the shares of dr/dq and dr/dv."""
        by_q, by_v, v = slopes.by_q, slopes.by_v, slopes.v
        for (i, j), slope in self.slopes().items():
            for key in {(i, j), (j, i)}:
                by_v[key] = by_v.get(key, 0.0) + slope
        if self.across is not None and self.across[3] >= 0:
            alpha, gamma, _, beta, cosine = self.across
            bend = self.damping * cosine
            for i, j in ((alpha, gamma), (gamma, alpha)):
                by_q[i, beta] = by_q.get((i, beta), 0.0) + bend * v[j]


class JointDampers(ForceRows):
    """Dampings of all joints' motions, but those that are proportional to a stiffness matrix."""

    FAMILY: ClassVar[str] = MOTIONS

    @cached_property
    def dampers(self) -> list[Damper]:
        """The dampings where q is, each joint with a comment in front of its values."""
        at, dampers = self.at, list[Damper]()
        for joint in at.bound.joint_damping:
            numbers = {key: damping for key, damping in joint.numbers.items() if key in MOVED}
            if numbers:
                at.note(f"{joint.joint}: damping of its motion")
            for key, damping in numbers.items():
                moved = {name: joint.index[name] for name in MOVED[key] if name in joint.index}
                if FRONT not in moved or BACK not in moved:
                    dampers.append(Damper(damping, tuple(moved.values())))
                    continue
                beta, sine, cosine = moved.get(MIDDLE, -1), 0.0, 1.0
                if beta >= 0:
                    sine, cosine = at.sincos(at.q[beta] + at.bound.angle_offsets[beta])
                dampers.append(Damper(damping, tuple(moved.values()), (moved[FRONT], moved[BACK], sine, beta, cosine)))
        return dampers

    @cached_property
    def matrices(self) -> list[CoordinateMatrix]:
        """The damping matrices, each joint with a comment in front of its values."""
        matrices = list[CoordinateMatrix]()
        for joint in self.at.bound.joint_damping:
            matrix = CoordinateMatrix.of(joint.numbers, joint.index)
            if matrix.entries:
                self.at.note(f"{joint.joint}: its damping matrix")
                matrices.append(matrix)
        return matrices

    def rows(self, q: Sequence[Scalar], v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give d G v and D v, with the directions where the tree is."""
        for damper in self.dampers:
            yield from damper.rows(v).items()
        for matrix in self.matrices:
            yield from matrix.times(v).items()

    def add_slopes(self, slopes: Slopes) -> None:
        """Add dr/dq and dr/dv."""
        for damper in self.dampers:
            damper.add_slopes(slopes)
        for matrix in self.matrices:
            matrix.add_to(slopes.by_v)

    def add_blocks(self, share: ImplicitShare) -> None:
        """Add d G and D."""
        for damper in self.dampers:
            share.in_joint(damper.slopes)
        for matrix in self.matrices:
            share.in_joint(partial(_damped, matrix))


def _damped(matrix: CoordinateMatrix, c: Scalar, _square: Scalar) -> Rows:
    """Return c D on and above the diagonal."""
    return matrix.scaled(c)
